"""Charts over two numbers of a scenario's document: largest Lyapunov exponents, and stability of periodic motions."""

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...analysis.chaos import chart
from ...analysis.stability import floquet_chart
from ...analysis.stability.periodic import PERIODIC_TOLERANCE
from ...files.scenario import read_document
from ...files.scenario.body import rolling_state
from ...files.scenario.files import with_defaults
from ...files.scenario.paths import check_number, value_at
from ...files.scenario.scenario import Scenario
from ...files.scenario.solvers import SOLVERS
from ...interface.status import Status
from .axes import Ranged
from .rows import read_rows
from .study import Study

if TYPE_CHECKING:
    import xarray

Axes = tuple[Ranged, Ranged]


def scenario_chart(
    document: Mapping[str, Any],
    axes: Axes,
    *,
    end: float | None = None,
    transient: float = 0.0,
    interval: float = 10.0,
    progress: Callable[[int, int], Any] | None = None,
) -> "xarray.Dataset":
    """Computes :func:`jaxball.analysis.chaos.chart` of a scenario with other numbers at the paths of two ``axes``.

    Cells with impossible parameters are IMPOSSIBLE. ``end`` replaces the scenario's; other arguments are the chart's.

    **Raises:** :class:`~jaxball.ScenarioError` where a path names no number or all cells are impossible, and as the
    chart does.
    """
    cells = _Cells(document, axes, "Lyapunov exponents are")
    template = cells.template
    data = chart(
        cells.start_of,
        cells.indices,
        (template.times[0], template.times[-1] if end is None else end),
        transient=transient,
        interval=interval,
        solver=SOLVERS[template.solver](),
        rtol=template.rtol,
        atol=template.atol,
        max_steps=template.max_steps,
        progress=progress,
    )
    return cells.finish(data, ("exponent", "exponent_regardless", "standard_error", "least_normal_force"))


def scenario_floquet_chart(
    document: Mapping[str, Any],
    axes: Axes,
    period: float | str,
    *,
    iterations: int = 20,
    progress: Callable[[int, int], Any] | None = None,
) -> "xarray.Dataset":
    """Computes :func:`jaxball.analysis.stability.floquet_chart` of a scenario with other numbers at the paths of two
    ``axes``.

    ``period`` is one number near the period of all motions, or the path of an angular frequency, which may differ
    between cells. Each motion is searched for near the scenario's initial state. Cells with impossible parameters are
    IMPOSSIBLE.

    **Raises:** as :func:`scenario_chart` and the chart itself.
    """
    cells = _Cells(document, axes, "periodic motions are")
    template = cells.template
    periods = cells.periods(period)

    # All scenarios have been read; the chart is traced over the numbers of cells, by which it only picks one.
    def make(up, right):
        return *cells.start_of(up, right), periods[up.astype(int), right.astype(int)]

    data = floquet_chart(
        make,
        cells.indices,
        t=template.times[0],
        # Multipliers need a finer solve than a run may have asked for.
        rtol=min(template.rtol, PERIODIC_TOLERANCE),
        atol=min(template.atol, PERIODIC_TOLERANCE),
        iterations=iterations,
        max_steps=template.max_steps,
        progress=progress,
    )
    # Impossible cells were solved with numbers of another one.
    data["closed"].values.flat[cells.impossible] = False
    return cells.finish(data, ("growth", "multiplier", "angle", "period", "residual", "least_normal_force"))


class _Cells:
    """The scenarios of the cells of a chart, all read before the first is solved."""

    def __init__(self, document: Mapping[str, Any], axes: Axes, what: str):
        self.template: Scenario = read_document(dict(document))
        document = with_defaults(document, self.template, (axis.path for axis in axes))
        for axis in axes:
            check_number(document, axis.path, has_defaults=True)
        self.document, self.axes = document, axes
        rolling_state(self.template, what)
        rows = math.prod(axis.size for axis in axes)
        # All cells are one chunk of a study, which is never written.
        study = Study("", dict(document), axes, chunk=rows)
        cells = study.rows_of(0)
        possible, batch = read_rows(study, self.template, cells, study.values(cells))
        if batch is None:
            study.scenario(0)  # raises an error that says why
            raise AssertionError("The first of the impossible rows can be read.")
        self.impossible: Int[np.ndarray, " n"] = np.setdiff1d(cells, possible)
        # Impossible cells take the first possible row, so that there is something to solve; their results become NaN.
        place = np.zeros(rows, dtype=int)
        place[possible] = np.arange(len(possible))
        self._places = jnp.asarray(place.reshape([axis.size for axis in axes]))
        self._several = jax.tree.map(jnp.asarray, (batch.system, batch.state))

    @property
    def indices(self) -> dict[str, Int[np.ndarray, " n"]]:
        """The parameters of the chart: the path of each axis, and the numbers of its values."""
        return {axis.path: np.arange(axis.size) for axis in self.axes}

    def start_of(self, up: Float[Array, ""], right: Float[Array, ""]) -> tuple[Any, Any]:
        """Picks the system and the initial state of a cell, by the numbers of its values; traceable."""
        row = self._places[up.astype(int), right.astype(int)]
        return jax.tree.map(lambda leaf: leaf[row], self._several)

    def periods(self, period: float | str) -> Float[Array, "n m"]:
        """Returns the period of each cell."""
        values = [axis.values(np.arange(axis.size))[:, 0] for axis in self.axes]
        named = dict(zip((axis.path for axis in self.axes), np.meshgrid(*values, indexing="ij"), strict=True))
        shape = tuple(axis.size for axis in self.axes)
        if not isinstance(period, str):
            return jnp.full(shape, period)
        frequency = named[period] if period in named else value_at(self.document, period)
        return 2 * jnp.pi / jnp.broadcast_to(jnp.asarray(frequency), shape)

    def finish(self, data: "xarray.Dataset", unknown: tuple[str, ...]) -> "xarray.Dataset":
        """Adds the values of the chart's axes, and makes it NaN where the parameters are impossible."""
        for name in unknown:
            data[name].values.flat[self.impossible] = np.nan
        data["status"].values.flat[self.impossible] = Status.IMPOSSIBLE
        return data.assign_coords({axis.path: axis.values(np.arange(axis.size))[:, 0] for axis in self.axes})
