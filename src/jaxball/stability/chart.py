"""Charts of the stability of periodic motions over two parameters.

For users, who give a function that makes each system; ``sweep.charts`` gives it a scenario's, for ``jaxball periodic``.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .. import programs
from ..grid import grid_of
from ..interface.arguments import require_callable, traceable
from ..numerics.arrays import Numbers, to_array
from ..physics.packing import phase_point
from ..physics.system import AbstractState, AbstractSystem
from ..simulation.arguments import check_steps, check_tolerances
from .periodic import PERIODIC_TOLERANCE, equations_of, multipliers_of
from .shooting import Search, Shot, shoot

if TYPE_CHECKING:
    import xarray

Make = Callable[[Float[Array, ""], Float[Array, ""]], tuple[AbstractSystem, AbstractState, Float[Array, ""]]]


def floquet_chart(
    make: Make,
    parameters: Mapping[str, Numbers],
    *,
    t: Numbers = 0.0,
    rtol: Numbers = PERIODIC_TOLERANCE,
    atol: Numbers = PERIODIC_TOLERANCE,
    iterations: int = 20,
    max_steps: int = 4096,
    chunk: int = 128,
    workers: int | None = None,
    progress: Callable[[int, int], Any] | None = None,
) -> "xarray.Dataset":
    """Computes the stability of a periodic motion at each pair of values of two parameters.

    **Arguments:**

    - ``make``: a function of both parameters that returns a system, and a state and a period near the motion, as for
      :func:`periodic_motion`; traced, so it must not branch on them.
    - ``parameters``: two names with the values of each, of shapes (n,) and (m,).
    - ``t``, ``rtol``, ``atol``, ``iterations``, ``max_steps``: as for :func:`periodic_motion`.
    - ``chunk``: how many cells are solved between two calls of ``progress``.
    - ``workers``: how many threads solve them; by default the number of this process's cores.
    - ``progress``: called with the number of cells done and the number of all, after each chunk.

    **Returns:** a data set over both parameters with

    - ``growth``: the largest real part of an exponent, in 1/time; NaN where no motion was found;
    - ``multiplier``: the size of the largest multiplier, and ``angle``, its argument from 0 to π: 0 where deviations
      keep their sign in a period, π where they change it;
    - ``period``, ``residual``, ``least_normal_force``: as in :class:`PeriodicMotion`;
    - ``closed``: whether a motion was found;
    - ``status``: the number of a :class:`~jaxball.Status`, 0 where the last solve reached its end.

    **Raises:** as :func:`periodic_motion`, and ``ValueError`` unless there are two parameters, each with a row of
    numbers.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> import jax.numpy as jnp
    >>> from jaxball import Disk, DiskState, Ground, HarmonicSeries, Oscillating
    >>> from jaxball.stability import floquet_chart
    >>> def shaken(amplitude, frequency):
    ...     motion = Oscillating(HarmonicSeries(jnp.zeros(3), amplitude * jnp.eye(3)[2:], frequency[None]))
    ...     disk = Disk(mass=1.0, inertia=0.36, offset=(0.0, 0.0, -0.2), ground=Ground(motion=motion))
    ...     return disk, DiskState(), 2 * jnp.pi / frequency
    >>> chart = floquet_chart(shaken, {"amplitude": [0.05, 0.3], "frequency": [0.7, 0.894]})  # it rocks at 0.447
    >>> (chart["growth"] > 1e-6).values.tolist()
    [[False, True], [False, True]]
    """
    grid = grid_of(parameters)
    require_callable("make", make, "first", "second")
    rtol, atol = map(to_array, check_tolerances(rtol, atol))
    cells, start = grid.cells, to_array(t)
    forced, angles = _equations(make, cells, float(start))
    search = Search(forced, angles, check_steps(iterations), check_steps(max_steps), start, rtol, atol)
    shots = grid.map(lambda cell: _solve(make, search, cell), chunk, workers, progress)
    system = make(*to_array(cells[0]))[0]
    growth, multiplier = np.full(len(cells), np.nan), np.full(len(cells), complex(np.nan))
    # Without a closed motion its multipliers mean nothing.
    for k in np.flatnonzero(shots.closed):
        shot = jax.tree.map(lambda leaf, k=k: leaf[k], shots)
        (multiplier[k], *_), (exponent, *_) = multipliers_of(shot, system, forced)
        growth[k] = exponent.real
    return grid.dataset(
        {
            "growth": (growth, "largest growth rate of deviations", "1/time"),
            "multiplier": (np.abs(multiplier), "size of the largest multiplier", ""),
            "angle": (np.abs(np.angle(multiplier)), "argument of the largest multiplier", "rad"),
            "period": (shots.period, "period", "time"),
            # The part that is not closed; whole turns are taken off already.
            "residual": (np.max(np.abs(shots.returned.gain), axis=1), "distance from the start after a period", ""),
            "least_normal_force": (shots.returned.least_normal_force, "least normal force", "mass length/time^2"),
            "closed": (shots.closed, "whether a periodic motion was found", ""),
            "status": (shots.returned.status, "how the last solve ended", ""),
        }
    )


@programs.filter_jit
def _solve(make: Make, search: Search, cell: Float[Array, "2"]) -> Shot:
    with traceable("make", make):
        system, state, period = make(cell[0], cell[1])
    return shoot(search, system, phase_point(system, state), jnp.asarray(period), None)


def _equations(make: Make, cells: Float[np.ndarray, "cells 2"], t: float) -> tuple[bool, tuple[bool, ...]]:
    """Finds whether the equations depend on time, and which components are angles, judged by the first cell and the
    last.
    """
    kinds = []
    # Over the whole chart: equations that are steady in one corner may be forced in the other.
    for cell in cells[[0, -1]]:
        system, state, period = make(*to_array(cell))
        kinds.append(equations_of(system, phase_point(system, state), t, float(period)))
    angles = np.all([angles for _, angles in kinds], axis=0)
    return any(forced for forced, _ in kinds), tuple(angles.tolist())
