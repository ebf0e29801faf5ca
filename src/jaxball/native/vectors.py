"""Arrays whose first axis has as many elements as a vector has lanes: what is computed of them is computed in vectors.

Such an array remains an array of single numbers, so that all rules know it: its elements are the lanes of vectors, one
vector for each place along the other axes, and lane k of the vector ``%v7`` has the name ``%v7.k``. An operation finds
the vectors by these names. Of the lanes, only those are taken out that something reads by itself.
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from .builder import Builder
from .elements import LANES, Element, Lanes, Pair, is_known, llvm_type, written


def side_by_side(
    builder: Builder,
    dtypes: Sequence[np.dtype],
    results: Sequence[np.dtype],
    rows: Sequence[Sequence[Element]],
    compute: Callable[..., Sequence[Element]],
) -> list[list[Element]] | None:
    """What ``compute`` gives for each of the rows, computed in vectors; None where it is to be computed one by one.

    - ``rows``: the operands of the lanes, one row a lane; ``dtypes``: their types.
    - ``results``: the types of what is computed; the list has a row for each lane.
    """
    if len(rows) != LANES or any(dtype.kind == "c" for dtype in (*dtypes, *results)):
        return None
    columns = list(zip(*rows, strict=True))
    if any(isinstance(element, Lanes | Pair) for column in columns for element in column):
        return None
    operands = [packed(builder, dtype, column) for dtype, column in zip(dtypes, columns, strict=True)]
    if all(is_known(operand) or operand.startswith("<") for operand in operands):
        return None
    found = compute(*operands)
    return [list(row) for row in zip(*map(builder.lanes_of, results, found), strict=True)]


def packed(builder: Builder, dtype: np.dtype, numbers: Sequence[Element]) -> Element:
    """The numbers of the lanes as a vector, or the number that all of them are."""
    texts = [written(number) for number in numbers]
    if all(text == texts[0] for text in texts):
        return numbers[0]
    if all(map(is_known, numbers)):
        kind = llvm_type(dtype)
        return Lanes(f"<{', '.join(f'{kind} {text}' for text in texts)}>")
    vector = texts[0].partition(".")[0]
    if builder.is_vector(vector) and texts == lane_names(vector):
        return Lanes(vector)
    return builder.gathered(dtype, numbers)


def lane_names(vector: str) -> list[str]:
    """The names of a vector's lanes."""
    return [f"{vector}.{lane}" for lane in range(LANES)]


def in_rows(shape: Sequence[int], arrays: Iterable[np.ndarray]) -> list[list[list[Element]]]:
    """For each place along the other axes, for each lane, the elements of arrays that have the shape or are single."""
    flat = [
        np.broadcast_to(elements.reshape(1, 1), (LANES, 1)) if elements.shape != tuple(shape) else elements
        for elements in arrays
    ]
    columns = [elements.reshape(LANES, -1) for elements in flat]
    count = int(np.prod(shape[1:], dtype=int))
    return [
        [[column[lane, place if column.shape[1] > 1 else 0] for column in columns] for lane in range(LANES)]
        for place in range(count)
    ]
