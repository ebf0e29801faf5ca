"""The numbers of a document in many rows."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from ..numbers import list_of, value_at


class Columns:
    """The numbers and the lists of numbers of a document, some of which change from row to row."""

    def __init__(self, document: Mapping[str, Any], paths: tuple[str, ...], values: Float[np.ndarray, "rows numbers"]):
        self.document, self.paths, self.values = document, paths, values

    @property
    def rows(self) -> int:
        """How many rows there are."""
        return len(self.values)

    def change(self, *names: str) -> bool:
        """Whether a number changes in any of the lists or tables ``names``."""
        return any(re.match(rf"{re.escape(name)}($|[.\[])", path) for path in self.paths for name in names)

    def changing(self) -> list[str]:
        """The paths of the numbers, and of the lists of numbers, that change."""
        return list(dict.fromkeys(list_of(path)[0] for path in self.paths))

    def at(self, name: str) -> Float[np.ndarray, "rows ..."]:
        """A number or a list of numbers in every row."""
        base = np.asarray(value_at(self.document, name), dtype=float)
        found = np.broadcast_to(base, (self.rows, *base.shape))
        for column, path in enumerate(self.paths):
            above, place = list_of(path)
            if above == name:
                found = found if found.flags.writeable else found.copy()
                found[(slice(None), *place)] = self.values[:, column]
        return found
