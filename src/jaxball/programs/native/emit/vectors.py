"""Short arrays and those with a short first axis, which are computed in vectors along it: up to eight lanes in each.

Such an array remains an array of single numbers, so that all rules work with it: its elements are the lanes of vectors,
one or two vectors for each place along the other axes. An operation takes whole vectors where its operands are their
lanes in order. Only lanes that are read individually are extracted.
"""

import functools
import itertools
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ..ir.elements import (
    Element,
    Lane,
    Pair,
    Vector,
    is_known,
    llvm_type,
    write_element,
)
from ..limits import FEWEST_ALWAYS, LANES, MOST_ROWS, MOST_TO_PACK, SHORTEST_AXIS
from .builder import Builder


def side_by_side(
    builder: Builder,
    dtypes: Sequence[np.dtype],
    results: Sequence[np.dtype],
    columns: Sequence[Sequence[Element]],
    compute: Callable[..., Sequence[Element]],
) -> list[list[Element]]:
    """Evaluates ``compute`` for each lane, in vectors where that takes less time, else lane by lane.

    - ``columns``: of each operand the numbers of the lanes; ``dtypes``: their types.
    - ``results``: the types of the results; the list has the numbers of the lanes of each.
    """
    if not _pays(builder, (*dtypes, *results), columns):
        return list(map(list, zip(*(compute(*row) for row in zip(*columns, strict=True)), strict=True)))
    width, parts = _parts(columns)
    rows: list[list[Element]] = [[] for _ in results]
    for part in parts:
        computed = compute(*[pack(builder, dtype, column, width) for dtype, column in zip(dtypes, part, strict=True)])
        for row, dtype, number in zip(rows, results, computed, strict=True):
            row += builder.lanes_of(dtype, number, len(part[0]))
    return rows


def _pays(builder: Builder, dtypes: Sequence[np.dtype], columns: Sequence[Sequence[Element]]) -> bool:
    """Returns whether numbers of these types are computed in vectors."""
    if any(dtype.kind == "c" for dtype in dtypes):
        return False
    all_known = True
    for column in columns:
        for element in column:
            if isinstance(element, (Vector, Pair)):
                return False
            all_known = all_known and not isinstance(element, str)
    # One number for all lanes is computed once, and known ones while compiling.
    if all_known or all(map(_is_uniform, columns)):
        return False
    if FEWEST_ALWAYS <= len(columns[0]) <= LANES:
        return True
    width, parts = _parts(columns)
    return all(sum(_cost(builder, column, width) for column in part) <= MOST_TO_PACK for part in parts)


def _parts(columns: Sequence[Sequence[Element]]) -> tuple[int, list[list[Sequence[Element]]]]:
    """Returns the width of the vectors that columns take, and the lanes of each."""
    count = len(columns[0])
    return width_for(count), [[column[part] for column in columns] for part in vectors_of(count)]


def is_of_vectors(shape: Sequence[int]) -> bool:
    """Returns whether operations on an array of that shape may be computed in vectors along its first axis."""
    return bool(shape) and SHORTEST_AXIS <= shape[0] <= MOST_ROWS


def width_for(count: int) -> int:
    """Returns the number of lanes of the vectors that ``count`` elements take."""
    return LANES if count >= FEWEST_ALWAYS else LANES // 2


@functools.cache
def vectors_of(count: int) -> tuple[slice, ...]:
    """Returns the elements of each of the vectors that a first axis takes, of about equal length."""
    parts = -(-count // LANES)
    ends = [count * k // parts for k in range(parts + 1)]
    return tuple(itertools.starmap(slice, itertools.pairwise(ends)))


def pack(builder: Builder, dtype: np.dtype, numbers: Sequence[Element], width: int) -> Element:
    """Packs the numbers of the lanes into a vector, or returns the number that all of them are."""
    if _is_uniform(numbers):
        return numbers[0]
    if all(map(is_known, numbers)):
        texts = [write_element(number) for number in numbers]
        # Lanes beyond the axis compute what the last one does: other numbers might need the loops and branches of rare
        # cases, such as huge angles, which are executed if any lane needs them.
        texts += texts[-1:] * (width - len(texts))
        kind = llvm_type(dtype)
        return Vector(f"<{', '.join(f'{kind} {text}' for text in texts)}>", width)
    vectors, lanes = _sources(numbers, width)
    # The usual case, in which one operation follows another in vectors: nothing is written.
    if len(vectors) == 1 and lanes == list(range(len(numbers))):
        return vectors[0]
    if 1 <= len(vectors) <= 2:
        lanes += lanes[-1:] * (width - len(lanes))
        return builder.shuffle(dtype, vectors[0], vectors[1] if len(vectors) > 1 else None, lanes)
    return builder.gather(dtype, numbers, width)


def are_handed_on(shape: Sequence[int], dtype: np.dtype) -> bool:
    """Returns whether loops and branches hand the numbers of such an array on in vectors."""
    return len(shape) > 1 and FEWEST_ALWAYS <= shape[0] <= MOST_ROWS and dtype.kind != "c"


def number_of_vectors(shape: Sequence[int]) -> int:
    """Counts the vectors along its first axis that an array takes."""
    return len(vectors_of(shape[0])) * math.prod(shape[1:])


def in_vectors(builder: Builder, dtype: np.dtype, shape: Sequence[int], numbers: Sequence[Element]) -> list[Element]:
    """Returns the numbers of an array, row by row, as vectors along its first axis."""
    places = len(numbers) // shape[0]
    columns = [numbers[place::places] for place in range(places)]
    # All of one width, and never a single number: the other end of the jump or of the call expects these types.
    vectors = [pack(builder, dtype, column[part], LANES) for column in columns for part in vectors_of(shape[0])]
    return [builder.spread(dtype, vector, LANES) for vector in vectors]


def one_by_one(builder: Builder, dtype: np.dtype, shape: Sequence[int], vectors: Sequence[Element]) -> list[Element]:
    """Returns the numbers of an array, row by row, from vectors along its first axis."""
    counts = [part.stop - part.start for part in vectors_of(shape[0])]
    lanes = [builder.lanes_of(dtype, vector, count) for vector, count in zip(vectors, itertools.cycle(counts))]
    columns = [list(itertools.chain(*lanes[k : k + len(counts)])) for k in range(0, len(lanes), len(counts))]
    return row_by_row(columns)


def _is_uniform(numbers: Sequence[Element]) -> bool:
    # By their text, as 0 and −0 are equal numbers that give different results.
    first = write_element(numbers[0])
    return all((number if isinstance(number, str) else write_element(number)) == first for number in numbers)


def _sources(numbers: Sequence[Element], width: int) -> tuple[list[Vector], list[int]]:
    """Returns the vectors of one width, two at most, whose lanes the numbers are, and which lanes; no vectors where
    they are not.
    """
    vectors: list[Vector] = []
    lanes = []
    for number in numbers:
        if not isinstance(number, Lane) or number.vector.width != width:
            return [], []
        if number.vector not in vectors:
            vectors.append(number.vector)
        lanes.append(width * vectors.index(number.vector) + number.position)
    return (vectors, lanes) if len(vectors) <= 2 else ([], [])


def _cost(builder: Builder, numbers: Sequence[Element], width: int) -> int:
    """Counts the instructions, in every turn of the loop that is being written, that make a vector of numbers."""
    # Made once before the loop.
    if all(map(builder.is_same_in_every_turn, numbers)):
        return 0
    if _is_uniform(numbers):
        return 1
    # LLVM makes one load of neighbouring ones.
    if all(map(builder.is_loaded, numbers)):
        return 1
    vectors, lanes = _sources(numbers, width)
    if not vectors:
        return len(numbers)
    return int(len(vectors) > 1 or lanes != list(range(len(numbers))))


def row_by_row(columns: Sequence[Sequence[Element]]) -> list[Element]:
    """Lists the elements of an array row by row, from its elements along the first axis for each place along the other
    axes.
    """
    return [element for row in zip(*columns, strict=True) for element in row]


def in_columns(shape: Sequence[int], arrays: Sequence[Sequence[Element]]) -> Iterator[list[Sequence[Element]]]:
    """Yields, for each place along the other axes, the elements along the first axis, for each array.

    - ``arrays``: the elements row by row, or a single one.
    """
    count, places = shape[0], math.prod(shape[1:])
    for place in range(places):
        yield [[elements[0]] * count if len(elements) == 1 else elements[place::places] for elements in arrays]
