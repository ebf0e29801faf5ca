"""Which disturbed starts come back to a motion under feedback: closed loops in vector lanes, on all cores."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .. import programs
from ..interface.arguments import whole_number
from ..interface.names import leave_to
from ..interface.printing import Printed
from ..interface.status import BACK_WITHIN
from ..numerics.arrays import Numbers, positive_number, to_numpy
from ..physics.body import System
from ..physics.contact.law import Contact
from ..physics.forces.force import AbstractWrench
from ..programs.operation import in_threads
from ..simulation.grid import Grid, grid_of
from .feedback import AbstractFeedback
from .loop import plant_of, run_loop
from .sampled import SampledSystem
from .weights import Weights, weight_matrix

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure
    import xarray


class Outcome(NamedTuple):
    """How a closed loop ended: its deviation, and the extremes over its samples of the contact force.

    - ``xi``: at the end, shape (n,).
    - ``least_normal_force``, ``friction_needed``: the least N, and the largest |f| / N, at the samples.
    """

    xi: Float[np.ndarray | Array, "*starts n"]
    least_normal_force: Float[np.ndarray | Array, "*starts"]
    friction_needed: Float[np.ndarray | Array, "*starts"]


class Basin(Printed):
    """Which starts come back to a motion.

    - ``starts``: their deviations in local coordinates, shape (runs, n).
    - ``ends``: how each run ended.
    - ``remaining``: √(ξ·Q ξ / tr Q) at the end, which a start that comes back has below ``within``.
    - ``returned``: whether it comes back, without leaving the plane at a sample, and without slipping at one if
      ``friction`` was given.
    - ``grid``: the two directions and their values, if the starts are of a grid.
    - ``system``: the system that was simulated.
    - ``directions``: the names of the local coordinates.
    """

    starts: Float[np.ndarray, "runs n"]
    ends: Outcome
    remaining: Float[np.ndarray, " runs"]
    returned: Bool[np.ndarray, " runs"]
    within: float
    grid: Grid | None
    system: System
    directions: tuple[str, ...] = eqx.field(static=True)

    @property
    def share(self) -> float:
        """The share of starts that come back."""
        return float(np.mean(self.returned))

    def dataset(self) -> "xarray.Dataset":
        """Returns the map over both directions of a grid.

        **Raises:** ``ValueError`` for starts that are not of a grid.
        """
        if self.grid is None:
            raise ValueError(
                "Argument `starts` must be a dictionary of two directions, each with a row of values, where a map is "
                "needed, but it was an array."
            )
        variables = {
            "returned": (self.returned, "whether the start comes back", ""),
            "remaining": (self.remaining, "weighted deviation at the end", ""),
            "least_normal_force": (
                self.ends.least_normal_force,
                "least normal force at the samples",
                "mass length/time²",
            ),
            "friction_needed": (self.ends.friction_needed, "largest |f| / N at the samples", ""),
        }
        return self.grid.dataset(variables, {"within": self.within})

    def __repr__(self) -> str:
        count = int(np.sum(self.returned))
        return f"Basin: {count:,} of {len(self.returned):,} starts come back, {self.share:.1%}"

    @leave_to("..plot.control:basin_map")
    def plot(self, ax: "matplotlib.axes.Axes | None" = None) -> "matplotlib.axes.Axes":
        """Draws in colour which starts of a grid come back; its first direction is on the vertical axis.

        **Raises:** ``ValueError`` for starts that are not of a grid, and when ``ax`` is three-dimensional.
        """
        raise NotImplementedError


def basin(
    feedback: AbstractFeedback,
    starts: Mapping[str, Numbers] | Numbers,
    *,
    Q: Weights = 1.0,
    within: float = BACK_WITHIN,
    friction: float | None = None,
    system: System | None = None,
    limits: Numbers | Mapping[str, Numbers] | None = None,
    delay: int = 0,
    push: AbstractWrench | None = None,
    samples: int | None = None,
    contact: Contact | None = None,
    threads: int | None = None,
) -> Basin:
    if contact is not None and friction is not None:
        raise ValueError(
            "Argument `friction` must be left out with `contact`, because the robot slips by that, but both are given."
        )
    plant, names = plant_of(feedback, system, limits, push, contact), feedback.nominal.state(0).directions
    grid, xi = _starts(starts, names)
    weights = weight_matrix("Q", Q, names)
    positive_number("within", within)
    count = feedback.nominal.samples if samples is None else whole_number("samples", samples, 1)
    late = whole_number("delay", delay, 0)
    with in_threads(threads):
        ends = jax.vmap(lambda start: _outcome(feedback, plant, count, late, start))(jnp.asarray(xi))
    ends = jax.tree.map(np.asarray, ends)
    # Runs that failed end in NaN, which compares as not returned.
    with np.errstate(invalid="ignore"):
        remaining = np.sqrt(np.einsum("ki,ij,kj->k", ends.xi, weights, ends.xi) / np.trace(weights))
        returned = remaining < within
        if contact is None:
            returned &= ends.least_normal_force > 0
        if friction is not None:
            returned &= ends.friction_needed <= friction
    return Basin(xi, ends, remaining, returned, within, grid, plant.system, names)


def _starts(
    values: Mapping[str, Numbers] | Numbers, names: tuple[str, ...]
) -> tuple[Grid | None, Float[np.ndarray, "runs n"]]:
    if not isinstance(values, Mapping):
        xi = to_numpy(values, "starts")
        if xi.ndim != 2 or xi.shape[1] != len(names) or not len(xi):
            raise ValueError(
                f"Argument `starts` must be of shape (runs, {len(names)}), a column for each of {', '.join(names)}, "
                f"but its shape is {xi.shape}."
            )
        return None, xi
    grid = grid_of(values, "starts")
    for name in grid.names:
        if name not in names:
            raise ValueError(f"Argument `starts` must name two of {', '.join(names)}, but it names {name!r}.")
    xi = np.zeros((len(grid.cells), len(names)))
    xi[:, [names.index(name) for name in grid.names]] = grid.cells
    return grid, xi


@programs.filter_jit
def _outcome(feedback: AbstractFeedback, plant: SampledSystem, samples: int, delay: int, xi: Array) -> Outcome:
    start = feedback.sampled.displace(feedback.nominal.state(0), xi)
    loop = run_loop(feedback, plant, start, samples, delay)

    def contact_force(t: Array, moving: Any, u: Array) -> tuple[Array, Array]:
        force = plant.as_solved(plant.hold(u)).prepare().plane_reaction(t, moving)
        return force.normal, force.ratio

    # At the start of each sample, with the input that is held from there on: an input jumps between samples.
    before = jax.tree.map(lambda leaf: leaf[:-1], loop.moving)
    normal, ratio = jax.lax.map(lambda arguments: contact_force(*arguments), (loop.times[:-1], before, loop.u))
    return Outcome(loop.xi[-1], jnp.min(normal), jnp.max(ratio))
