"""Where the arrays of a call lie, with all their rows: a table that is filled once, and from which each row is read."""

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
