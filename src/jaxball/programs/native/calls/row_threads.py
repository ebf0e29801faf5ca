"""The rows of a call, computed by threads of a CPU, as LLVM IR.

A program is one of a single call or of a block of rows. Block after block is computed by whichever thread is free: of
XLA's, or of Python's, which call ``rows(shared)``. A block is the same to the last bit, whatever thread computes it.
"""

from collections.abc import Iterator, Sequence

from ..limits import MOST_HELPER_THREADS, PATIENCE, SPARE
from .handler import BLOCKS, DONE, ROWS, STOPPED, USERS, Part, load_function, write_arguments, write_places

NEVER = 2**63 - 1  # instructions: XLA's threads do not look for signals


def rows_in_threads(takes: Sequence[Part], gives: Sequence[Part], block: int, workspace: int, triple: str) -> str:
    """Writes ``rows(shared)`` for Python and ``compute_all(frame, shared)`` for XLA, beside a program's ``main``.

    - ``block``: how many rows ``main`` computes; ``workspace``: the bytes that it works in.
    - ``triple``: LLVM's name of the target.
    """
    padded = sum(block * part.size for part in (*takes, *gives) if part.in_rows)
    lines = [
        _DECLARED.replace("SPARE", str(SPARE)).replace("WORKSPACE", str(-(-max(workspace, 1) // 64) * 64)),
        _MODE.get(triple.partition("-")[0], _NO_MODE),
        *(_PADDING if padded else ()),
        "define internal void @block(ptr %shared, i64 %k, ptr %control) {",
        *_body_of_block(takes, gives, block, padded),
        "}",
        _THREADS,
    ]
    return "\n".join(lines)


def _body_of_block(takes: Sequence[Part], gives: Sequence[Part], block: int, padded: int) -> Iterator[str]:
    """Writes block number ``k``: where its rows lie, padded where there are fewer, and the program."""
    parts = [*takes, *gives]
    yield f"  %first = mul i64 %k, {block}"
    yield from write_places(takes, gives, "%first")
    # The program reads and writes whole blocks, and behind the last row lies memory of others. What pads it is the last
    # row once more: zeros might take more steps than any row.
    if padded:
        yield f"  %rows.place = getelementptr i8, ptr %shared, i64 {ROWS}"
        yield "  %rows = load i64, ptr %rows.place"
        yield "  %left = sub i64 %rows, %first"
        yield f"  %short = icmp slt i64 %left, {block}"
        yield "  br i1 %short, label %pad, label %compute"
        yield "pad:"
        yield f"  %memory = call ptr @malloc(i64 {padded})"
        offset = 0
        for j, part in enumerate(parts):
            if part.in_rows:
                yield f"  %padded.{j} = getelementptr i8, ptr %memory, i64 {offset}"
                if j < len(takes):
                    operands = f"ptr %padded.{j}, ptr %own.{j}, i64 {part.size}, i64 %left, i64 {block}"
                    yield f"  call void @repeat_last({operands})"
                yield f"  store ptr %padded.{j}, ptr %place.{j}"
                offset += block * part.size
        yield "  br label %compute"
        yield "compute:"
        yield "  %given = phi ptr [ null, %0 ], [ %memory, %pad ]"
    yield "  %mode = call i64 @standard_mode()"
    yield "  %workspace = call ptr @take_workspace()"
    yield "  call void @main(ptr %control, ptr %workspace, ptr %inputs, ptr %outputs)"
    yield "  call void @give_back_workspace(ptr %workspace)"
    yield "  call void @restore_mode(i64 %mode)"
    if padded:
        yield "  br i1 %short, label %cut, label %done"
        yield "cut:"
        offset = 0
        for j, part in enumerate(parts):
            if part.in_rows and j >= len(takes):
                yield f"  %bytes.{j} = mul i64 %left, {part.size}"
                yield f"  %cut.{j} = getelementptr i8, ptr %given, i64 {offset}"
                yield f"  call ptr @memcpy(ptr %own.{j}, ptr %cut.{j}, i64 %bytes.{j})"
            offset += block * part.size * part.in_rows
        yield "  call void @free(ptr %given)"
        yield "  br label %done"
        yield "done:"
    yield "  ret void"


# Memory to work in is kept: to get and give back large memory costs more than a short run.
_DECLARED = """
declare ptr @aligned_alloc(i64, i64)
declare ptr @memcpy(ptr, ptr, i64)
declare i32 @sched_yield()
@spare = internal global [SPARE x ptr] zeroinitializer, align 8

define internal ptr @take_workspace() {
entry:
  br label %look
look:
  %k = phi i64 [ 0, %entry ], [ %next, %nothing ]
  %place = getelementptr ptr, ptr @spare, i64 %k
  %kept = atomicrmw xchg ptr %place, ptr null seq_cst
  %found = icmp ne ptr %kept, null
  br i1 %found, label %taken, label %nothing
taken:
  ret ptr %kept
nothing:
  %next = add i64 %k, 1
  %more = icmp slt i64 %next, SPARE
  br i1 %more, label %look, label %new
new:
  %memory = call ptr @aligned_alloc(i64 64, i64 WORKSPACE)
  ret ptr %memory
}

define internal void @give_back_workspace(ptr %workspace) {
entry:
  br label %look
look:
  %k = phi i64 [ 0, %entry ], [ %next, %taken ]
  %place = getelementptr ptr, ptr @spare, i64 %k
  %tried = cmpxchg ptr %place, ptr null, ptr %workspace seq_cst seq_cst
  %kept = extractvalue { ptr, i1 } %tried, 1
  br i1 %kept, label %done, label %taken
taken:
  %next = add i64 %k, 1
  %more = icmp slt i64 %next, SPARE
  br i1 %more, label %look, label %drop
drop:
  call void @free(ptr %workspace)
  br label %done
done:
  ret void
}
"""

# XLA's threads take numbers below the smallest normal one for 0; ours do not.
_NO_MODE = """
define internal i64 @standard_mode() alwaysinline {
  ret i64 0
}
define internal void @restore_mode(i64 %mode) alwaysinline {
  ret void
}
"""
# 8064 are all exceptions of x86-64 masked, rounding to the nearest, and no flushing to 0; on ARM, that is 0.
_MODE = {
    "x86_64": """
declare void @llvm.x86.sse.stmxcsr(ptr)
declare void @llvm.x86.sse.ldmxcsr(ptr)
define internal i64 @standard_mode() {
  %place = alloca i64, align 8
  store i64 0, ptr %place
  call void @llvm.x86.sse.stmxcsr(ptr %place)
  %mode = load i64, ptr %place
  store i64 8064, ptr %place
  call void @llvm.x86.sse.ldmxcsr(ptr %place)
  ret i64 %mode
}
define internal void @restore_mode(i64 %mode) {
  %place = alloca i64, align 8
  store i64 %mode, ptr %place
  call void @llvm.x86.sse.ldmxcsr(ptr %place)
  ret void
}
""",
    "aarch64": """
declare i64 @llvm.aarch64.get.fpcr()
declare void @llvm.aarch64.set.fpcr(i64)
define internal i64 @standard_mode() {
  %mode = call i64 @llvm.aarch64.get.fpcr()
  call void @llvm.aarch64.set.fpcr(i64 0)
  ret i64 %mode
}
define internal void @restore_mode(i64 %mode) {
  call void @llvm.aarch64.set.fpcr(i64 %mode)
  ret void
}
""",
}
_MODE["arm64"] = _MODE["aarch64"]

_PADDING = """
define internal void @repeat_last(ptr %padded, ptr %own, i64 %size, i64 %left, i64 %block) {
entry:
  %last = sub i64 %left, 1
  br label %copy
copy:
  %k = phi i64 [ 0, %entry ], [ %next, %copy ]
  %is_own = icmp slt i64 %k, %left
  %source = select i1 %is_own, i64 %k, i64 %last
  %to.offset = mul i64 %k, %size
  %from.offset = mul i64 %source, %size
  %to = getelementptr i8, ptr %padded, i64 %to.offset
  %from = getelementptr i8, ptr %own, i64 %from.offset
  call ptr @memcpy(ptr %to, ptr %from, i64 %size)
  %next = add i64 %k, 1
  %more = icmp slt i64 %next, %block
  br i1 %more, label %copy, label %done
done:
  ret void
}
""".splitlines()

# `next` says which blocks are taken, and `done` how many are finished: each is counted when its results are written,
# and the order of atomic additions makes these visible to whoever sees them all counted.
# A thread that comes late finds nothing left to do. So the caller waits only for blocks that somebody computes, and
# neither needs the other threads nor how many there are. What is shared is freed by the last who uses it.
# A helper counts as a user before it is scheduled, because it may run, and leave, before the next instruction here. XLA
# of older versions has a shorter table of functions, without a pool of threads: the caller then computes alone.
_THREADS = f"""
define internal void @compute_blocks(ptr %shared, ptr %control) {{
entry:
  %blocks.place = getelementptr i8, ptr %shared, i64 {BLOCKS}
  %blocks = load i64, ptr %blocks.place
  %done.place = getelementptr i8, ptr %shared, i64 {DONE}
  %stopped.place = getelementptr i8, ptr %control, i64 8
  store i8 0, ptr %stopped.place
  br label %choose
choose:
  %k = atomicrmw add ptr %shared, i64 1 seq_cst
  %is_left = icmp slt i64 %k, %blocks
  br i1 %is_left, label %compute, label %end
compute:
  call void @block(ptr %shared, i64 %k, ptr %control)
  %before = atomicrmw add ptr %done.place, i64 1 seq_cst
  %stopped = load i8, ptr %stopped.place
  %goes.on = icmp eq i8 %stopped, 0
  br i1 %goes.on, label %choose, label %end
end:
  ret void
}}

define void @rows(ptr %shared) {{
  %control = alloca [32 x i8], align 8
  store i64 {PATIENCE}, ptr %control
  %all.place = getelementptr i8, ptr %control, i64 24
  %all.stopped = getelementptr i8, ptr %shared, i64 {STOPPED}
  store ptr %all.stopped, ptr %all.place
  %state.place = getelementptr i8, ptr %control, i64 16
  %state = call ptr @PyEval_SaveThread()
  store ptr %state, ptr %state.place
  call void @compute_blocks(ptr %shared, ptr %control)
  %last = load ptr, ptr %state.place
  call void @PyEval_RestoreThread(ptr %last)
  ret void
}}

define internal void @work(ptr %shared) {{
  %control = alloca [32 x i8], align 8
  store i64 {NEVER}, ptr %control
  call void @compute_blocks(ptr %shared, ptr %control)
  ret void
}}

define internal void @leave(ptr %shared) {{
  %users.place = getelementptr i8, ptr %shared, i64 {USERS}
  %users = atomicrmw sub ptr %users.place, i64 1 seq_cst
  %is_last = icmp eq i64 %users, 1
  br i1 %is_last, label %last, label %end
last:
  call void @free(ptr %shared)
  br label %end
end:
  ret void
}}

define internal void @help(ptr %shared) {{
  call void @work(ptr %shared)
  call void @leave(ptr %shared)
  ret void
}}

define internal i64 @threads_of(ptr %api, ptr %context) {{
  %number = alloca i64, align 8
  store i64 1, ptr %number
{write_arguments(32, "%context", number="ptr %number")}
{load_function("ThreadPool_NumThreads")}
  %error = call ptr %function(ptr %arguments)
  %none = icmp eq ptr %error, null
  br i1 %none, label %known, label %unknown
known:
  %threads = load i64, ptr %number
  ret i64 %threads
unknown:
  call void @drop_error(ptr %api, ptr %error)
  ret i64 1
}}

define internal ptr @compute_all(ptr %frame, ptr %shared) {{
entry:
  %blocks.place = getelementptr i8, ptr %shared, i64 {BLOCKS}
  %blocks = load i64, ptr %blocks.place
  %others = sub i64 %blocks, 1
  %several = icmp sgt i64 %others, 0
  br i1 %several, label %look, label %compute
look:
  %api.place = getelementptr i8, ptr %frame, i64 16
  %api = load ptr, ptr %api.place
  %context.place = getelementptr i8, ptr %frame, i64 24
  %context = load ptr, ptr %context.place
  %size = load i64, ptr %api
  %has_pool = icmp sge i64 %size, 152
  br i1 %has_pool, label %count, label %compute
count:
  %threads = call i64 @threads_of(ptr %api, ptr %context)
  %others.threads = sub i64 %threads, 1
  %fewer.blocks = icmp slt i64 %others, %others.threads
  %useful = select i1 %fewer.blocks, i64 %others, i64 %others.threads
  %few = icmp slt i64 %useful, {MOST_HELPER_THREADS}
  %helpers = select i1 %few, i64 %useful, i64 {MOST_HELPER_THREADS}
  %users.place = getelementptr i8, ptr %shared, i64 {USERS}
{write_arguments(40, "%context", task="ptr @help", data="ptr %shared")}
{load_function("ThreadPool_Schedule")}
  br label %more
more:
  %k = phi i64 [ 0, %count ], [ %next, %begun ]
  %is_more = icmp slt i64 %k, %helpers
  br i1 %is_more, label %begin, label %compute
begin:
  %users = atomicrmw add ptr %users.place, i64 1 seq_cst
  %error = call ptr %function(ptr %arguments)
  %next = add i64 %k, 1
  %is_begun = icmp eq ptr %error, null
  br i1 %is_begun, label %begun, label %alone
begun:
  br label %more
alone:
  %users.again = atomicrmw sub ptr %users.place, i64 1 seq_cst
  call void @drop_error(ptr %api, ptr %error)
  br label %compute
compute:
  call void @work(ptr %shared)
  %done.place = getelementptr i8, ptr %shared, i64 {DONE}
  br label %wait
wait:
  %done = load atomic i64, ptr %done.place seq_cst, align 8
  %is_done = icmp sge i64 %done, %blocks
  br i1 %is_done, label %end, label %pause
pause:
  %paused = call i32 @sched_yield()
  br label %wait
end:
  call void @leave(ptr %shared)
  ret ptr null
}}
"""
