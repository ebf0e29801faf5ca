"""The number by which chosen rows of a study are coloured."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..view.document import ColourScale
from .results import label_of, result_names, values_of
from .rows import PictureError, Rows, listed
from .symbols import in_plain_text, number_label

if TYPE_CHECKING:
    import xarray


def sweep_scale(data: "xarray.Dataset", rows: Sequence[int], by: str | None = None) -> ColourScale | None:
    """A number of a study in some of its rows, by which their bodies are coloured.

    **Arguments:**

    - ``data``: the store of a study, as :func:`jaxball.sweep.open_dataset` opens it.
    - ``rows``: the numbers of the rows, from 0.
    - ``by``: the path of a number that the study changes, or a result such as ``"z[0]"``, at the end; by default the
      first number that differs between the rows.

    **Returns:** the number by its symbol and unit, as in ``Ω₃(t₀) (rad/time)``; None if no number is given and none
    differs.

    **Raises:** :class:`PictureError` if the study has no number of that name.
    """
    places = np.asarray(rows, dtype=int)
    chosen = Rows(data, places, np.zeros((places.size, 0), dtype=int), data["status"].values[places].astype(int))
    paths = [str(path) for path in listed(data, "paths")]
    if by is None:
        by = next(iter(chosen.varying()), None)
    if by is None:
        return None
    if by in paths:
        return ColourScale(in_plain_text(number_label(by)), chosen.number(by).tolist(), chosen.is_logarithmic(by))
    results = result_names(data)
    if by not in results:
        raise PictureError(
            f"Number `{by}` must be one that the study changes, {', '.join(paths)}, or one of its results, "
            f"{', '.join(results)}."
        )
    return ColourScale(in_plain_text(label_of(data, by)), values_of(chosen, by).tolist())
