"""The rows of a call, computed by the threads of a GPU, each of which runs a program from its beginning to its end.

Two modules of LLVM IR. One is the kernel: a thread finds the number of its row, where the row's arrays lie, and calls
the program. The other runs on the CPU beside XLA's handler: it starts the kernel on XLA's stream.
"""

from collections.abc import Iterator, Sequence

from ..limits import FEWEST_THREADS, MOST_LOCAL, ROWS_OF_LAUNCH, THREADS
from .handler import DONE, NEXT, ROWS, Part, bytes_of_table, load_function, write_arguments, write_places

MEMORY = DONE  # where the array to work in is: a number of the table that a grid does not need

OUT_OF_MEMORY, OUT_OF_RESOURCES = 2, 701  # CUDA's numbers of errors


def kernel(takes: Sequence[Part], gives: Sequence[Part], workspace: int) -> str:
    """Writes ``kernel(table)`` beside a program's ``main``: each thread of a grid computes row after row.

    - ``workspace``: the bytes that ``main`` works in.
    """
    table = f"ptr byval([{bytes_of_table([*takes, *gives])} x i8]) align 8 %shared"
    lines = [f"declare i32 @llvm.nvvm.read.ptx.sreg.{register}()" for _, register in _NUMBERS]
    lines += [f"define ptx_kernel void @kernel({table}) {{", "entry:"]
    for name, register in _NUMBERS:
        lines.append(f"  %{name}.short = call i32 @llvm.nvvm.read.ptx.sreg.{register}()")
        lines.append(f"  %{name} = zext i32 %{name}.short to i64")
    lines += [
        "  %before = mul i64 %group, %group.length",
        "  %thread = add i64 %before, %thread.in.group",
        "  %threads = mul i64 %groups, %group.length",
        *_compute_rows(takes, gives, workspace),
    ]
    return "\n".join(lines)


_NUMBERS = (
    ("group", "ctaid.x"),
    ("groups", "nctaid.x"),
    ("group.length", "ntid.x"),
    ("thread.in.group", "tid.x"),
)


def emulation(takes: Sequence[Part], gives: Sequence[Part], workspace: int) -> str:
    """Writes ``emulate(table, thread, threads)``, for a CPU: what one of the kernel's threads does."""
    head = ["define void @emulate(ptr %shared, i64 %thread, i64 %threads) {", "entry:"]
    return "\n".join([*head, *_compute_rows(takes, gives, workspace)])


def _compute_rows(takes: Sequence[Part], gives: Sequence[Part], workspace: int) -> Iterator[str]:
    """Writes the computation of the rows of thread ``%thread`` of ``%threads``."""
    if uses_array(workspace):
        yield f"  %memory.place = getelementptr i8, ptr %shared, i64 {MEMORY}"
        yield "  %memory = load ptr, ptr %memory.place"
        yield f"  %memory.offset = mul i64 %thread, {workspace}"
        yield "  %workspace = getelementptr i8, ptr %memory, i64 %memory.offset"
    else:
        yield f"  %workspace = alloca [{max(workspace, 1)} x i8], align 16"
    yield f"  %next.place = getelementptr i8, ptr %shared, i64 {NEXT}"
    yield "  %next = load i64, ptr %next.place"
    yield "  %first = add i64 %next, %thread"
    yield f"  %rows.place = getelementptr i8, ptr %shared, i64 {ROWS}"
    yield "  %rows = load i64, ptr %rows.place"
    yield "  br label %row"
    yield "row:"
    # Threads side by side take rows side by side, which they read together.
    yield "  %k = phi i64 [ %first, %entry ], [ %following, %compute ]"
    yield "  %is_row = icmp slt i64 %k, %rows"
    yield "  br i1 %is_row, label %compute, label %end"
    yield "compute:"
    yield from write_places(takes, gives, "%k")
    yield "  call void @main(ptr null, ptr %workspace, ptr %inputs, ptr %outputs)"
    yield "  %following = add i64 %k, %threads"
    yield "  br label %row"
    yield "end:"
    yield "  ret void"
    yield "}"
    yield ""


def uses_array(workspace: int) -> bool:
    """Returns whether threads work in an array of XLA's."""
    return workspace > MOST_LOCAL


def launcher(workspace: int) -> str:
    """Writes ``compute_all(frame, shared)`` for XLA's handler, and ``connect``, which must be called before it.

    - ``workspace``: the bytes that each run works in.
    """
    size = workspace if uses_array(workspace) else 0
    return _LAUNCHER.replace("WORKSPACE", str(size))


_LACKS_MEMORY = (
    "The GPU has not enough memory left for runs, of which each needs %ld bytes besides its arrays (CUDA error %d). "
    "Set the environment variable XLA_PYTHON_CLIENT_MEM_FRACTION to 0.5, so that JAX reserves less for arrays; map "
    "over fewer rows at a time, for example by jax.lax.map with batch_size; or set JAXBALL_COMPILER to xla."
)
_FAILED = (
    "The GPU did not start runs, of which each needs %ld bytes besides its arrays (CUDA error %d). Set the environment "
    "variable JAXBALL_COMPILER to xla to run them through XLA."
)


def _text(name: str, content: str) -> str:
    return f'@{name} = private constant [{len(content) + 1} x i8] c"{content}\\00"'


# The table is an argument of the kernel, by value: what the next slice writes to it does not reach the one before. The
# array to work in is given back as soon as all is started, because whoever gets it next runs on the same stream.
# Where memory lacks, half as many threads are tried, and half of these: each then computes more rows.
_LAUNCHER = f"""
declare i32 @snprintf(ptr, i64, ptr, ...)
{_text("lacks_memory", _LACKS_MEMORY)}
{_text("failed", _FAILED)}
@launch.place = internal global ptr null
@kernel.place = internal global ptr null
@resident.place = internal global i64 0

define void @connect(ptr %launch, ptr %kernel, i64 %resident) {{
  store ptr %launch, ptr @launch.place
  store ptr %kernel, ptr @kernel.place
  store i64 %resident, ptr @resident.place
  ret void
}}

define internal ptr @compute_all(ptr %frame, ptr %shared) {{
entry:
  %api.place = getelementptr i8, ptr %frame, i64 16
  %api = load ptr, ptr %api.place
  %context.place = getelementptr i8, ptr %frame, i64 24
  %context = load ptr, ptr %context.place
  %rows.place = getelementptr i8, ptr %shared, i64 {ROWS}
  %rows = load i64, ptr %rows.place
  %resident = load i64, ptr @resident.place
  %is_few = icmp slt i64 %rows, %resident
  %wanted = select i1 %is_few, i64 %rows, i64 %resident
  %wanted.up = add i64 %wanted, {THREADS - 1}
  %wanted.groups = udiv i64 %wanted.up, {THREADS}
  %useful = mul i64 %wanted.groups, {THREADS}
{write_arguments(32, "%context", stream="ptr null")}
{load_function("Stream_Get")}
  %no_stream = call ptr %function(ptr %arguments)
  %has_stream = icmp eq ptr %no_stream, null
  br i1 %has_stream, label %memory, label %end
memory:
  %works_in_array = icmp ne i64 WORKSPACE, 0
  br i1 %works_in_array, label %allocate, label %begin
allocate:
  %threads.tried = phi i64 [ %useful, %memory ], [ %half, %fewer ]
  %size = mul i64 %threads.tried, WORKSPACE
  %array = call ptr @allocate(ptr %api, ptr %context, i64 %size)
  %is_there = icmp ne ptr %array, null
  br i1 %is_there, label %begin, label %fewer
fewer:
  %half.groups = udiv i64 %threads.tried, {2 * THREADS}
  %half = mul i64 %half.groups, {THREADS}
  %is_enough = icmp sge i64 %half, {FEWEST_THREADS}
  br i1 %is_enough, label %allocate, label %fail
begin:
  %threads = phi i64 [ {ROWS_OF_LAUNCH}, %memory ], [ %threads.tried, %allocate ]
  %memory.array = phi ptr [ null, %memory ], [ %array, %allocate ]
  %memory.size = phi i64 [ 0, %memory ], [ %size, %allocate ]
  %memory.place = getelementptr i8, ptr %shared, i64 {MEMORY}
  store ptr %memory.array, ptr %memory.place
  %stream = load ptr, ptr %stream.place
  %parameters = alloca [1 x ptr], align 8
  store ptr %shared, ptr %parameters
  %launch = load ptr, ptr @launch.place
  %kernel = load ptr, ptr @kernel.place
  %next.place = getelementptr i8, ptr %shared, i64 {NEXT}
  br label %slice
slice:
  %first = phi i64 [ 0, %begin ], [ %following, %start ]
  %result.before = phi i32 [ 0, %begin ], [ %result, %start ]
  %is_left = icmp slt i64 %first, %rows
  %is_well = icmp eq i32 %result.before, 0
  %goes.on = and i1 %is_left, %is_well
  br i1 %goes.on, label %start, label %finish
start:
  %after = add i64 %first, {ROWS_OF_LAUNCH}
  %is_last = icmp slt i64 %rows, %after
  %following = select i1 %is_last, i64 %rows, i64 %after
  store i64 %first, ptr %next.place
  store i64 %following, ptr %rows.place
  %left = sub i64 %following, %first
  %has_more = icmp slt i64 %left, %threads
  %count = select i1 %has_more, i64 %left, i64 %threads
  %up = add i64 %count, {THREADS - 1}
  %groups = udiv i64 %up, {THREADS}
  %groups.short = trunc i64 %groups to i32
  %result = call i32 %launch(ptr %kernel, i32 %groups.short, i32 1, i32 1, i32 {THREADS}, i32 1, i32 1, i32 0, \
ptr %stream, ptr %parameters, ptr null)
  br label %slice
finish:
  call void @give_back(ptr %api, ptr %context, ptr %memory.array, i64 %memory.size)
  br i1 %is_well, label %end, label %fail
fail:
  %failure = phi i32 [ {OUT_OF_MEMORY}, %fewer ], [ %result.before, %finish ]
  %error = call ptr @new_error(ptr %api, i32 %failure)
  br label %end
end:
  %returned = phi ptr [ %no_stream, %entry ], [ null, %finish ], [ %error, %fail ]
  call void @free(ptr %shared)
  ret ptr %returned
}}

define internal ptr @allocate(ptr %api, ptr %context, i64 %size) {{
{write_arguments(48, "%context", size="i64 %size", alignment="i64 128", data="ptr null")}
{load_function("DeviceMemory_Allocate")}
  %error = call ptr %function(ptr %arguments)
  %is_well = icmp eq ptr %error, null
  br i1 %is_well, label %got, label %failed
got:
  %data = load ptr, ptr %data.place
  ret ptr %data
failed:
  call void @drop_error(ptr %api, ptr %error)
  ret ptr null
}}

define internal void @give_back(ptr %api, ptr %context, ptr %array, i64 %size) {{
  %is_there = icmp ne ptr %array, null
  br i1 %is_there, label %free, label %end
free:
{write_arguments(40, "%context", size="i64 %size", data="ptr %array")}
{load_function("DeviceMemory_Free")}
  %error = call ptr %function(ptr %arguments)
  %is_well = icmp eq ptr %error, null
  br i1 %is_well, label %end, label %failed
failed:
  call void @drop_error(ptr %api, ptr %error)
  br label %end
end:
  ret void
}}

define internal ptr @new_error(ptr %api, i32 %result) {{
  %lacks = icmp eq i32 %result, {OUT_OF_MEMORY}
  %lacks.other = icmp eq i32 %result, {OUT_OF_RESOURCES}
  %lacks.any = or i1 %lacks, %lacks.other
  %format = select i1 %lacks.any, ptr @lacks_memory, ptr @failed
  %code = select i1 %lacks.any, i32 8, i32 13
  %message = alloca [512 x i8], align 8
  %length = call i32 (ptr, i64, ptr, ...) @snprintf(ptr %message, i64 512, ptr %format, i64 WORKSPACE, i32 %result)
{write_arguments(28, "%message", code="i32 %code")}
{load_function("Error_Create")}
  %error = call ptr %function(ptr %arguments)
  ret ptr %error
}}
"""
