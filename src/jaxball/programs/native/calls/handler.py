"""The function by which XLA calls a compiled program, as LLVM IR: a handler of its typed foreign-function interface.

XLA hands over a frame: where its arguments, its results and its own functions lie. The layout of the frame is part of
XLA's stable interface (``xla/ffi/api/c_api.h``, beside ``jax.ffi.include_dir()``); offsets below are those of 64 bits.

Where an argument of XLA has one axis more than a row has, that axis counts rows. The handler fills a table of where the
arrays of the call lie, with all their rows, and from which each row is read. It has the rows computed by threads of the
CPU (``row_threads``) or by those of a GPU (``grid``).
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ..emit.values import size_of
from ..ir.program import Value


class Rows(NamedTuple):
    """What a program that computes a block of rows at once takes of them.

    - ``block``: how many there are; ``taken``: which arguments have them as leading axis. All results have.
    """

    block: int
    taken: tuple[bool, ...]


class Part(NamedTuple):
    """An argument or a result of a program, as it is in one row.

    - ``rank``: how many axes a row has; ``size``: its bytes.
    - ``in_rows``: whether the program takes or gives a block of rows of it.
    """

    rank: int
    size: int
    in_rows: bool


# The table has these numbers, at these offsets. Bases and steps of all parts follow, from argument to argument and from
# result to result; the step of a result that all rows share is 0.
NEXT, DONE, USERS, ROWS, BLOCKS, STOPPED, PARTS = 0, 8, 16, 24, 32, 40, 48


def part_of(value: Value, in_rows: bool) -> Part:
    """Describes an argument or a result."""
    shape = value.shape[1:] if in_rows else value.shape
    return Part(len(shape), size_of(shape) * value.dtype.itemsize, in_rows)


def bytes_of_table(parts: Sequence[Part]) -> int:
    """Returns the length of the table in bytes."""
    return PARTS + 16 * len(parts)


def write_places(takes: Sequence[Part], gives: Sequence[Part], first: str) -> Iterator[str]:
    """Writes where the arrays of a row lie, from ``%shared``: ``%own.j`` of each part, in ``%inputs`` and ``%outputs``.

    - ``first``: the number of the row, or of the first one of a block.
    """
    yield f"  %inputs = alloca [{max(len(takes), 1)} x ptr], align 8"
    yield f"  %outputs = alloca [{max(len(gives), 1)} x ptr], align 8"
    for j in range(len(takes) + len(gives)):
        base, step = PARTS + 16 * j, PARTS + 16 * j + 8
        listed = f"%inputs, i64 {8 * j}" if j < len(takes) else f"%outputs, i64 {8 * (j - len(takes))}"
        yield f"  %base.place.{j} = getelementptr i8, ptr %shared, i64 {base}"
        yield f"  %base.{j} = load ptr, ptr %base.place.{j}"
        yield f"  %step.place.{j} = getelementptr i8, ptr %shared, i64 {step}"
        yield f"  %step.{j} = load i64, ptr %step.place.{j}"
        yield f"  %offset.{j} = mul i64 {first}, %step.{j}"
        yield f"  %own.{j} = getelementptr i8, ptr %base.{j}, i64 %offset.{j}"
        yield f"  %place.{j} = getelementptr i8, ptr {listed}"
        yield f"  store ptr %own.{j}, ptr %place.{j}"


def handler(takes: Sequence[Part], gives: Sequence[Part], block: int) -> str:
    """Writes ``call(frame)``, which XLA calls, beside ``compute_all(frame, shared)``, which computes the rows.

    ``compute_all`` returns an error of XLA's, or null, and frees the table ``shared``.

    - ``block``: how many rows are computed together.
    """
    return "\n".join([_DECLARED, "define ptr @call(ptr %frame) {", *_body_of_call(takes, gives, block), "}", ""])


def _body_of_call(takes: Sequence[Part], gives: Sequence[Part], block: int) -> Iterator[str]:
    """Writes the body of a call by XLA: it answers what the handler is, or computes the blocks of the arrays that the
    frame names.
    """
    parts = [*takes, *gives]
    yield from _ANSWER
    yield "  %one = alloca i64, align 8"
    yield "  store i64 1, ptr %one"
    yield f"  %shared = call ptr @malloc(i64 {bytes_of_table(parts)})"
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
            # An array without an axis of rows is the same for all: its step from row to row is 0.
            yield f"  %is_row.{j} = icmp ne i64 %rank.{j}, {parts[j].rank}"
            yield f"  %count.place.{j} = select i1 %is_row.{j}, ptr %dims.{j}, ptr %one"
            yield f"  %count.{j} = load i64, ptr %count.place.{j}"
            before = "1" if j == 0 else f"%rows.{j - 1}"
            yield f"  %rows.{j} = select i1 %is_row.{j}, i64 %count.{j}, i64 {before}"
            yield f"  %step.{j} = select i1 %is_row.{j}, i64 {parts[j].size}, i64 0"
            yield f"  %base.place.{j} = getelementptr i8, ptr %shared, i64 {PARTS + 16 * j}"
            yield f"  store ptr %data.{j}, ptr %base.place.{j}"
            yield f"  %step.place.{j} = getelementptr i8, ptr %shared, i64 {PARTS + 16 * j + 8}"
            yield f"  store i64 %step.{j}, ptr %step.place.{j}"
    # Arrays with rows have equally many, so any of them says how many; the last one's number was handed on so far.
    rows = f"%rows.{len(parts) - 1}" if parts else "1"
    yield f"  %more = add i64 {rows}, {block - 1}"
    yield f"  %blocks = udiv i64 %more, {block}"
    for name, offset, value in (
        ("next", NEXT, "0"),
        ("done", DONE, "0"),
        ("users", USERS, "1"),
        ("stopped", STOPPED, "0"),
    ):
        yield f"  %{name}.place = getelementptr i8, ptr %shared, i64 {offset}"
        yield f"  store i64 {value}, ptr %{name}.place"
    yield f"  %rows.place = getelementptr i8, ptr %shared, i64 {ROWS}"
    yield f"  store i64 {rows}, ptr %rows.place"
    yield f"  %blocks.place = getelementptr i8, ptr %shared, i64 {BLOCKS}"
    yield "  store i64 %blocks, ptr %blocks.place"
    yield "  %error = call ptr @compute_all(ptr %frame, ptr %shared)"
    yield "  ret ptr %error"


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

# Where XLA's table has its functions.
_PLACES = {
    "Error_Create": 48,
    "Error_Destroy": 64,
    "Stream_Get": 80,
    "DeviceMemory_Allocate": 120,
    "DeviceMemory_Free": 128,
    "ThreadPool_Schedule": 136,
    "ThreadPool_NumThreads": 144,
}


def load_function(name: str) -> str:
    """Writes the lines that read a function of XLA's as ``%function`` from its table ``%api``."""
    return f"""\
  %function.place = getelementptr i8, ptr %api, i64 {_PLACES[name]}
  %function = load ptr, ptr %function.place"""


def write_arguments(length: int, first: str, /, **others: str) -> str:
    """Writes the lines that make ``%arguments`` of a function of XLA's.

    - ``length``: the bytes of this structure.
    - ``first``: the pointer in it that each function takes; ``others``: those behind it, by names, of 8 bytes each.
    """
    lines = [
        f"  %arguments = alloca [{-(-length // 8) * 8} x i8], align 8",
        f"  call void @begin_arguments(ptr %arguments, i64 {length}, ptr {first})",
    ]
    for k, (name, value) in enumerate(others.items()):
        lines.append(f"  %{name}.place = getelementptr i8, ptr %arguments, i64 {24 + 8 * k}")
        lines.append(f"  store {value}, ptr %{name}.place")
    return "\n".join(lines)


_DECLARED = f"""
declare ptr @malloc(i64)
declare void @free(ptr)

define internal void @begin_arguments(ptr %arguments, i64 %size, ptr %first) {{
  store i64 %size, ptr %arguments
  %extension = getelementptr i8, ptr %arguments, i64 8
  store ptr null, ptr %extension
  %first.place = getelementptr i8, ptr %arguments, i64 16
  store ptr %first, ptr %first.place
  ret void
}}

define internal void @drop_error(ptr %api, ptr %error) {{
{write_arguments(24, "%error")}
{load_function("Error_Destroy")}
  call void %function(ptr %arguments)
  ret void
}}
"""
