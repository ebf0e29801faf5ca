"""The functions by which a compiled program is called for many rows, and by XLA, as LLVM IR.

XLA calls a handler of its typed foreign-function interface.

XLA hands over a frame: where its arguments, its results and its own functions lie. The layout of the frame is part of
XLA's stable interface (``xla/ffi/api/c_api.h``, beside ``jax.ffi.include_dir()``); offsets below are those of 64 bits.

A program is one of a single call or of a block of rows. Where an argument of XLA has one axis more than a row has, that
axis counts rows, and the handler computes all of them: block after block, each by whichever of XLA's threads is free.
Python calls ``rows(shared)``, in threads of its own. A block is the same to the last bit, whatever thread computes it.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

MOST_HELPERS = 255  # threads that compute blocks besides the one that calls
SPARE = 16  # memories to work in that a program keeps for its next calls

# Instructions between two checks for signals: a few milliseconds; and more than there are, for XLA's threads.
PATIENCE, NEVER = 5_000_000, 2**63 - 1


class Rows(NamedTuple):
    """What a program that computes a block of rows at once takes of them.

    - ``block``: how many there are; ``taken``: which arguments have them as leading axis. All results have.
    """

    block: int
    taken: tuple[bool, ...]


class Part(NamedTuple):
    """An argument or a result of a program, as a row of it is.

    - ``rank``: how many axes a row has; ``size``: its bytes.
    - ``in_rows``: whether the program takes or gives a block of rows of it.
    """

    rank: int
    size: int
    in_rows: bool


# What the threads share that compute the blocks of a call, at these offsets. Bases and steps of all parts follow, from
# argument to argument and from result to result; the step of what all rows share is 0.
_NEXT, _DONE, _USERS, _ROWS, _BLOCKS, _STOPPED, _PARTS = 0, 8, 16, 24, 32, 40, 48


def handler(takes: Sequence[Part], gives: Sequence[Part], block: int, workspace: int, triple: str) -> str:
    """The text of ``call(frame)``, which XLA calls, beside a program's ``main``.

    - ``block``: how many rows ``main`` computes; ``workspace``: the bytes that it works in.
    - ``triple``: LLVM's name of the target.
    """
    parts = [*takes, *gives]
    padded = sum(block * part.size for part in parts if part.in_rows)
    lines = [
        _DECLARED.replace("SPARE", str(SPARE)).replace("WORKSPACE", str(-(-max(workspace, 1) // 64) * 64)),
        _MODE.get(triple.partition("-")[0], _NO_MODE),
        *(_PADDING if padded else ()),
        "define internal void @block(ptr %shared, i64 %k, ptr %control) {",
        *_body_of_block(takes, gives, block, padded),
        "}",
        _THREADS,
        "define ptr @call(ptr %frame) {",
        *_body_of_call(takes, gives, block),
        "}",
        "",
    ]
    return "\n".join(lines)


def _body_of_block(takes: Sequence[Part], gives: Sequence[Part], block: int, padded: int) -> Iterator[str]:
    """Block number ``k``: where its rows lie, padded where there are fewer, and the program."""
    parts = [*takes, *gives]
    yield f"  %first = mul i64 %k, {block}"
    yield f"  %inputs = alloca [{max(len(takes), 1)} x ptr], align 8"
    yield f"  %outputs = alloca [{max(len(gives), 1)} x ptr], align 8"
    for j, _ in enumerate(parts):
        base, step = _PARTS + 16 * j, _PARTS + 16 * j + 8
        listed = f"%inputs, i64 {8 * j}" if j < len(takes) else f"%outputs, i64 {8 * (j - len(takes))}"
        yield f"  %base.place.{j} = getelementptr i8, ptr %shared, i64 {base}"
        yield f"  %base.{j} = load ptr, ptr %base.place.{j}"
        yield f"  %step.place.{j} = getelementptr i8, ptr %shared, i64 {step}"
        yield f"  %step.{j} = load i64, ptr %step.place.{j}"
        yield f"  %offset.{j} = mul i64 %first, %step.{j}"
        yield f"  %own.{j} = getelementptr i8, ptr %base.{j}, i64 %offset.{j}"
        yield f"  %place.{j} = getelementptr i8, ptr {listed}"
        yield f"  store ptr %own.{j}, ptr %place.{j}"
    if padded:
        yield f"  %rows.place = getelementptr i8, ptr %shared, i64 {_ROWS}"
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
                    given = f"ptr %padded.{j}, ptr %own.{j}, i64 {part.size}, i64 %left, i64 {block}"
                    yield f"  call void @repeat_last({given})"
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


def _body_of_call(takes: Sequence[Part], gives: Sequence[Part], block: int) -> Iterator[str]:
    """A call by XLA: what the handler is, or the blocks of the arrays that the frame names."""
    parts = [*takes, *gives]
    yield from _ANSWER
    yield "  %one = alloca i64, align 8"
    yield "  store i64 1, ptr %one"
    yield f"  %shared = call ptr @malloc(i64 {_PARTS + 16 * len(parts)})"
    for list_name, offset, start, count in (("args", 72, 0, len(takes)), ("rets", 112, len(takes), len(gives))):
        if count:
            yield f"  %{list_name}.place = getelementptr i8, ptr %frame, i64 {offset}"
            yield f"  %{list_name} = load ptr, ptr %{list_name}.place"
        for j in range(start, start + count):
            yield f"  %entry.{j} = getelementptr i8, ptr %{list_name}, i64 {8 * (j - start)}"
            yield f"  %buffer.{j} = load ptr, ptr %entry.{j}"
            yield f"  %data.place.{j} = getelementptr i8, ptr %buffer.{j}, i64 24"
            yield f"  %data.{j} = load ptr, ptr %data.place.{j}"
            yield f"  %rank.place.{j} = getelementptr i8, ptr %buffer.{j}, i64 32"
            yield f"  %rank.{j} = load i64, ptr %rank.place.{j}"
            yield f"  %dims.place.{j} = getelementptr i8, ptr %buffer.{j}, i64 40"
            yield f"  %dims.{j} = load ptr, ptr %dims.place.{j}"
            yield f"  %is_row.{j} = icmp ne i64 %rank.{j}, {parts[j].rank}"
            yield f"  %count.place.{j} = select i1 %is_row.{j}, ptr %dims.{j}, ptr %one"
            yield f"  %count.{j} = load i64, ptr %count.place.{j}"
            before = "1" if j == 0 else f"%rows.{j - 1}"
            yield f"  %rows.{j} = select i1 %is_row.{j}, i64 %count.{j}, i64 {before}"
            yield f"  %step.{j} = select i1 %is_row.{j}, i64 {parts[j].size}, i64 0"
            yield f"  %base.place.{j} = getelementptr i8, ptr %shared, i64 {_PARTS + 16 * j}"
            yield f"  store ptr %data.{j}, ptr %base.place.{j}"
            yield f"  %step.place.{j} = getelementptr i8, ptr %shared, i64 {_PARTS + 16 * j + 8}"
            yield f"  store i64 %step.{j}, ptr %step.place.{j}"
    rows = f"%rows.{len(parts) - 1}" if parts else "1"
    yield f"  %more = add i64 {rows}, {block - 1}"
    yield f"  %blocks = udiv i64 %more, {block}"
    for name, offset, value in (
        ("next", _NEXT, "0"),
        ("done", _DONE, "0"),
        ("users", _USERS, "1"),
        ("stopped", _STOPPED, "0"),
    ):
        yield f"  %{name}.place = getelementptr i8, ptr %shared, i64 {offset}"
        yield f"  store i64 {value}, ptr %{name}.place"
    yield f"  %rows.place = getelementptr i8, ptr %shared, i64 {_ROWS}"
    yield f"  store i64 {rows}, ptr %rows.place"
    yield f"  %blocks.place = getelementptr i8, ptr %shared, i64 {_BLOCKS}"
    yield "  store i64 %blocks, ptr %blocks.place"
    yield "  call void @compute_together(ptr %frame, ptr %shared)"
    yield "  ret ptr null"


# An extension of type 1 asks what the handler is: for version 0.1 of the interface, without traits, and stateless.
_ANSWER = """\
  %extension.place = getelementptr i8, ptr %frame, i64 8
  %extension = load ptr, ptr %extension.place
  %plain = icmp eq ptr %extension, null
  br i1 %plain, label %execute, label %extended
extended:
  %type.place = getelementptr i8, ptr %extension, i64 8
  %type = load i32, ptr %type.place
  %asked = icmp eq i32 %type, 1
  br i1 %asked, label %answer, label %execute
answer:
  %metadata.place = getelementptr i8, ptr %extension, i64 24
  %metadata = load ptr, ptr %metadata.place
  %major = getelementptr i8, ptr %metadata, i64 24
  store i32 0, ptr %major
  %minor = getelementptr i8, ptr %metadata, i64 28
  store i32 1, ptr %minor
  %traits = getelementptr i8, ptr %metadata, i64 32
  store i32 0, ptr %traits
  %state = getelementptr i8, ptr %metadata, i64 40
  store i64 0, ptr %state
  ret ptr null
execute:""".splitlines()

# Memory to work in is kept: to get and give back large memory costs more than a short run.
_DECLARED = """
declare ptr @malloc(i64)
declare ptr @aligned_alloc(i64, i64)
declare void @free(ptr)
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

# A thread that comes late finds nothing left to do. So the caller waits only for blocks that somebody computes, and
# neither needs the other threads nor how many there are. What is shared is freed by the last who uses it.
_THREADS = f"""
define void @rows(ptr %shared) {{
entry:
  %blocks.place = getelementptr i8, ptr %shared, i64 {_BLOCKS}
  %blocks = load i64, ptr %blocks.place
  %control = alloca [32 x i8], align 8
  store i64 {PATIENCE}, ptr %control
  %all.place = getelementptr i8, ptr %control, i64 24
  %all.stopped = getelementptr i8, ptr %shared, i64 {_STOPPED}
  store ptr %all.stopped, ptr %all.place
  %stopped.place = getelementptr i8, ptr %control, i64 8
  store i8 0, ptr %stopped.place
  %state.place = getelementptr i8, ptr %control, i64 16
  %state = call ptr @PyEval_SaveThread()
  store ptr %state, ptr %state.place
  br label %choose
choose:
  %k = atomicrmw add ptr %shared, i64 1 seq_cst
  %is_left = icmp slt i64 %k, %blocks
  br i1 %is_left, label %compute, label %end
compute:
  call void @block(ptr %shared, i64 %k, ptr %control)
  %stopped = load i8, ptr %stopped.place
  %goes.on = icmp eq i8 %stopped, 0
  br i1 %goes.on, label %choose, label %end
end:
  %last = load ptr, ptr %state.place
  call void @PyEval_RestoreThread(ptr %last)
  ret void
}}
define internal void @work(ptr %shared) {{
entry:
  %blocks.place = getelementptr i8, ptr %shared, i64 {_BLOCKS}
  %blocks = load i64, ptr %blocks.place
  %done.place = getelementptr i8, ptr %shared, i64 {_DONE}
  %control = alloca [32 x i8], align 8
  store i64 {NEVER}, ptr %control
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
  br label %choose
end:
  ret void
}}

define internal void @leave(ptr %shared) {{
  %users.place = getelementptr i8, ptr %shared, i64 {_USERS}
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
  %arguments = alloca [32 x i8], align 8
  store i64 32, ptr %arguments
  %extension = getelementptr i8, ptr %arguments, i64 8
  store ptr null, ptr %extension
  %context.place = getelementptr i8, ptr %arguments, i64 16
  store ptr %context, ptr %context.place
  %number.place = getelementptr i8, ptr %arguments, i64 24
  store ptr %number, ptr %number.place
  %asked.place = getelementptr i8, ptr %api, i64 144
  %asked = load ptr, ptr %asked.place
  %error = call ptr %asked(ptr %arguments)
  %none = icmp eq ptr %error, null
  br i1 %none, label %known, label %unknown
known:
  %threads = load i64, ptr %number
  ret i64 %threads
unknown:
  call void @drop_error(ptr %api, ptr %error)
  ret i64 1
}}

define internal void @drop_error(ptr %api, ptr %error) {{
  %arguments = alloca [24 x i8], align 8
  store i64 24, ptr %arguments
  %extension = getelementptr i8, ptr %arguments, i64 8
  store ptr null, ptr %extension
  %error.place = getelementptr i8, ptr %arguments, i64 16
  store ptr %error, ptr %error.place
  %destroy.place = getelementptr i8, ptr %api, i64 64
  %destroy = load ptr, ptr %destroy.place
  call void %destroy(ptr %arguments)
  ret void
}}

define internal void @compute_together(ptr %frame, ptr %shared) {{
entry:
  %blocks.place = getelementptr i8, ptr %shared, i64 {_BLOCKS}
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
  %few = icmp slt i64 %useful, {MOST_HELPERS}
  %helpers = select i1 %few, i64 %useful, i64 {MOST_HELPERS}
  %users.place = getelementptr i8, ptr %shared, i64 {_USERS}
  %arguments = alloca [40 x i8], align 8
  store i64 40, ptr %arguments
  %extension = getelementptr i8, ptr %arguments, i64 8
  store ptr null, ptr %extension
  %context.argument = getelementptr i8, ptr %arguments, i64 16
  store ptr %context, ptr %context.argument
  %task = getelementptr i8, ptr %arguments, i64 24
  store ptr @help, ptr %task
  %data = getelementptr i8, ptr %arguments, i64 32
  store ptr %shared, ptr %data
  %schedule.place = getelementptr i8, ptr %api, i64 136
  %schedule = load ptr, ptr %schedule.place
  br label %more
more:
  %k = phi i64 [ 0, %count ], [ %next, %begun ]
  %is_more = icmp slt i64 %k, %helpers
  br i1 %is_more, label %begin, label %compute
begin:
  %users = atomicrmw add ptr %users.place, i64 1 seq_cst
  %error = call ptr %schedule(ptr %arguments)
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
  %done.place = getelementptr i8, ptr %shared, i64 {_DONE}
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
  ret void
}}
"""
