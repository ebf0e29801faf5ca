"""A function of two parameters over a grid of their values, as a labelled data set, for charts and basins."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from ..interface.arguments import require, whole_number
from ..interface.status import Status
from ..numerics.arrays import Numbers, to_array, to_numpy
from ..programs.batches import in_threads, join_batches
from ..programs.cpu import cores
from ..programs.operation import in_threads as rows_in_threads

if TYPE_CHECKING:
    import xarray


class Grid(NamedTuple):
    """Every pair of values of two parameters.

    - ``names``: those of the parameters.
    - ``values``: theirs, of shapes (n,) and (m,).
    """

    names: tuple[str, ...]
    values: tuple[Float[np.ndarray, " values"], ...]

    @property
    def cells(self) -> Float[np.ndarray, "cells 2"]:
        """The pairs, those of the first value of the first parameter first."""
        return np.stack([grid.ravel() for grid in np.meshgrid(*self.values, indexing="ij")], axis=1)

    def map(
        self,
        solve: Callable[[Float[Array, "2"]], Any],
        chunk: int,
        workers: int | None,
        progress: Callable[[int, int], Any] | None,
    ) -> Any:
        """Computes what ``solve`` returns for each cell, as arrays with the cells as first axis; ``chunk`` of them at a
        time.

        ``workers`` threads, by default as many as this process has cores, solve chunks at the same time, and share the
        rows of a chunk where there are fewer chunks. ``progress`` is called with the number of cells done and the
        number of all after each chunk.
        """
        cells, chunk = self.cells, whole_number("chunk", chunk, 1)
        workers = cores() if workers is None else whole_number("workers", workers, 1)
        threads_of_a_chunk = max(1, workers // -(-len(cells) // chunk))

        def solve_chunk(batch: Any) -> Any:
            with rows_in_threads(threads_of_a_chunk):
                return jax.vmap(solve)(to_array(cells[batch]))

        results = in_threads(
            solve_chunk,
            len(cells),
            min(chunk, len(cells)),
            workers,
            progress=progress,
        )
        return join_batches(results, len(cells))

    def dataset(
        self, variables: Mapping[str, tuple[Any, str, str]], attributes: Mapping[str, Any] | None = None
    ) -> "xarray.Dataset":
        """Builds a data set of variables over both parameters, each an array with the cells as only axis, its meaning
        and its units.
        """
        # Imported here, because it takes longer than all of jaxball's own modules.
        import xarray

        shape = tuple(map(len, self.values))
        return xarray.Dataset(
            {
                name: (self.names, np.reshape(array, shape), {"long_name": meaning, "units": units})
                for name, (array, meaning, units) in variables.items()
            },
            dict(zip(self.names, self.values, strict=True)),
            {**(attributes or {}), "statuses": ", ".join(f"{item.value} {item.name}" for item in Status)},
        )


def grid_of(parameters: Mapping[str, Numbers], argument: str = "parameters") -> Grid:
    """Builds the grid of two named parameters, each with a row of values; ``argument`` is what messages call them.

    **Raises:** ``TypeError`` and ``ValueError`` for other parameters.
    """
    require(argument, parameters, Mapping, "a dictionary of two parameters, each with its values")
    if len(parameters) != 2:
        raise ValueError(
            f"Argument `{argument}` must name two parameters, but it names {len(parameters)}: {list(parameters)}."
        )
    values = [to_numpy(value, f"{argument}[{name!r}]") for name, value in parameters.items()]
    for name, value in zip(parameters, values, strict=True):
        if value.ndim != 1 or value.size == 0:
            raise ValueError(
                f"Argument `{argument}` must give each parameter a row of values, but `{name}` has the shape "
                f"{value.shape}."
            )
    return Grid(tuple(parameters), tuple(values))
