"""Charts of the largest Lyapunov exponent over two parameters."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import diffrax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import programs
from ...interface.arguments import require_callable, traceable
from ...numerics.arrays import Numbers, to_array
from ...physics.packing import normal_of, phase_point
from ...physics.system import AbstractState, AbstractSystem
from ...simulation.arguments import check_solver, check_steps, check_tolerances
from ...simulation.deviations import Steps
from ...simulation.grid import grid_of
from .spectrum import Method, interval_edges, system_spectrum

if TYPE_CHECKING:
    import xarray

Make = Callable[[Float[Array, ""], Float[Array, ""]], tuple[AbstractSystem, AbstractState]]


def chart(
    make: Make,
    parameters: Mapping[str, Numbers],
    times: Numbers,
    *,
    transient: float = 0.0,
    interval: float = 10.0,
    solver: diffrax.AbstractAdaptiveSolver | None = None,
    rtol: Numbers = 1e-8,
    atol: Numbers = 1e-8,
    max_steps: int = 16384,
    chunk: int = 128,
    workers: int | None = None,
    progress: Callable[[int, int], Any] | None = None,
) -> "xarray.Dataset":
    """Computes the largest Lyapunov exponent at each pair of values of two parameters.

    **Arguments:**

    - ``make``: a function of both parameters that returns a system and its initial state; traced, so it must not branch
      on them.
    - ``parameters``: two names with the values of each, of shapes (n,) and (m,).
    - ``times``, ``transient``, ``interval``, ``solver``, ``rtol``, ``atol``, ``max_steps``: as for
      :func:`lyapunov_spectrum`.
    - ``chunk``: how many cells are solved between two calls of ``progress``.
    - ``workers``: how many threads solve them; by default the number of this process's cores.
    - ``progress``: called with the number of cells done and the number of all, after each chunk.

    **Returns:** a data set over both parameters with

    - ``exponent``: the largest exponent in 1/time, NaN where the normal force was not positive throughout, or where the
      solve failed;
    - ``exponent_regardless``: the same whatever the normal force; the equations of motion continue where a real ball
      would leave the plane;
    - ``standard_error``: as in :class:`LyapunovSpectrum`;
    - ``least_normal_force``: the least N at the start and at the ends of the steps, infinite for a system that does not
      roll on a plane;
    - ``status``: the number of a :class:`~jaxball.Status`, 0 where the solve reached its end.

    **Raises:** ``ValueError`` unless there are two parameters, each with a row of numbers, and for invalid times, and
    :class:`~jaxball.simulation.PrecisionError` when float32 cannot reach the tolerances.
    """
    grid = grid_of(parameters)
    edges, skipped = interval_edges(times, transient, interval)
    require_callable("make", make, "first", "second")
    rtol, atol = map(to_array, check_tolerances(rtol, atol))
    method = Method(Steps(check_solver(solver), rtol, atol, check_steps(max_steps)), 1, skipped, None)
    rows = grid.map(lambda cell: _solve(make, method, cell, to_array(edges)), chunk, workers, progress)
    exponent, error, force, status = np.moveaxis(rows, -1, 0)
    variables = {
        "exponent": (np.where(force > 0, exponent, np.nan), "largest Lyapunov exponent", "1/time"),
        "exponent_regardless": (exponent, "largest Lyapunov exponent, whatever the normal force", "1/time"),
        "standard_error": (error, "standard error of the exponent", "1/time"),
        "least_normal_force": (force, "least normal force", "mass length/time^2"),
        "status": (status.astype(int), "how the solve ended", ""),
    }
    span = {"start": float(edges[0]), "averaged_from": float(edges[skipped]), "end": float(edges[-1])}
    return grid.dataset(variables, span)


@programs.filter_jit
def _solve(make: Make, method: Method, cell: Float[Array, "2"], edges: Float[Array, " edges"]) -> Float[Array, "4"]:
    """Returns the exponent, its standard error, the least normal force and the status."""
    with traceable("make", make):
        system, state = make(cell[0], cell[1])
    state = phase_point(system, state)
    # The normal is that of the phase point, which is known only now that there is one.
    spectrum = system_spectrum(method._replace(normal=normal_of(state)), system, state, edges)
    force = jnp.full_like(cell[0], jnp.inf) if spectrum.least_normal_force is None else spectrum.least_normal_force
    return jnp.stack([spectrum.exponents[0], spectrum.standard_error[0], force, spectrum.status.astype(cell.dtype)])
