"""Charts of the largest Lyapunov exponent over two numbers of a scenario's document."""

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from ..chaos import chart
from ..interface.status import Status
from ..scenario import read_document
from ..scenario.contact import rolling_state
from ..scenario.paths import check_number
from ..scenario.solvers import SOLVERS
from .axes import Ranged
from .rows import read_rows
from .study import Study

if TYPE_CHECKING:
    import xarray


def scenario_chart(
    document: Mapping[str, Any],
    axes: tuple[Ranged, Ranged],
    *,
    end: float | None = None,
    transient: float = 0.0,
    interval: float = 10.0,
    progress: Callable[[int, int], Any] | None = None,
) -> "xarray.Dataset":
    """:func:`jaxball.chaos.chart` of a scenario with other numbers at the paths of two ``axes``.

    Cells that no body can have are IMPOSSIBLE. ``end`` is instead of the scenario's; all others are those of the chart.

    **Raises:** :class:`~jaxball.ScenarioError` where a path names no number or none of the cells can be, and as the
    chart does.
    """
    for axis in axes:
        check_number(document, axis.path)
    template = read_document(dict(document))
    rolling_state(template.state, template.contact, "Lyapunov exponents are")
    rows = math.prod(axis.size for axis in axes)
    study = Study(
        title="", document=dict(document), axes=axes, save="end", contact=False, detachment=False, finds=(), chunk=rows
    )
    cells = study.rows_of(0)
    possible, batch = read_rows(study, template, cells, study.values(cells))
    if batch is None:
        study.scenario(0)  # raises, and says why
        raise AssertionError("The first of the impossible rows can be read.")
    place = np.zeros(rows, dtype=int)
    place[possible] = np.arange(len(possible))
    places = jnp.asarray(place.reshape([axis.size for axis in axes]))
    several = jax.tree.map(jnp.asarray, (batch.system, batch.state))

    def make(up, right):
        at = places[up.astype(int), right.astype(int)]
        return jax.tree.map(lambda leaf: leaf[at], several)

    data = chart(
        make,
        {axis.path: np.arange(axis.size) for axis in axes},
        (template.times[0], template.times[-1] if end is None else end),
        transient=transient,
        interval=interval,
        solver=SOLVERS[template.solver](),
        rtol=template.rtol,
        atol=template.atol,
        progress=progress,
    )
    impossible = np.setdiff1d(cells, possible)
    for name in ("exponent", "exponent_regardless", "standard_error", "least_normal_force"):
        data[name].values.ravel()[impossible] = np.nan
    data["status"].values.ravel()[impossible] = Status.IMPOSSIBLE
    return data.assign_coords({axis.path: axis.values(np.arange(axis.size))[:, 0] for axis in axes})
