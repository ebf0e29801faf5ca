"""The extreme values of the contact force over a whole run, with the times at which they occur."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .. import programs
from ..interface.arguments import require
from ..interface.printing import Printed, format_value, is_single
from ..interface.status import Status
from ..numerics.calculus import with_derivatives, with_second_derivatives
from ..numerics.flows import move_to_peak
from ..physics.hybrid import entry
from ..physics.packing import Packing
from ..physics.rolling import AbstractRollingSystem, Reaction
from ..programs.derivatives.differentiation import differentiate_where
from ..solvers.dense.maxima import maxima, move
from ..solvers.dense.steps import Steps
from .simulate import simulate
from .trajectory import Interpolant, Trajectory, always_rolls

# Of the weight, or of 1: anything smaller counts as zero, and leaves a constant value constant.
ROUNDING_OF_EXTREME = 1e-12
MOST_STEPS_OF_SAMPLE = 256  # of a run under feedback
SAME_VALUE = 1e-8  # the relative change that a constant value may have


class ContactExtremes(Printed):
    """How close what rolls on a plane came to leaving the plane or slipping, and when.

    The times are refined between the saved ones, to the accuracy of the solver's dense output. The values have the
    right first and second derivatives; the times have none, except where the extreme is at a kink of the motion or at
    the end of the run.

    - ``least_normal_force``: the smallest N, mass length/time².
    - ``friction_needed``: μ_min, the largest |f| / N; with less friction the ball would slip. Infinite where
      N ≤ 0 somewhere.
    - ``largest_friction``: the largest |f|, mass length/time².
    - ``weight``: M g, mass length/time².
    - ``constant``: whether N, |f| / N and |f| are constant to within rounding, shape (3,); their times then mean
      nothing.
    - ``least_normal_force_time``, ``friction_needed_time``, ``largest_friction_time``: when.

    **Example:**

    >>> from jaxball import Disk, Fixed, PointMass, contact_extremes, simulate
    >>> disk = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, Fixed((0.5, 0.0, 0.0)))])
    >>> extremes = contact_extremes(simulate(disk, [0.0, 1.0, 2.0], dense=True))
    >>> round(float(extremes.margin), 4), bool(extremes.holds)
    (0.98, True)
    """

    least_normal_force: Float[Array, "*batch"]
    least_normal_force_time: Float[Array, "*batch"]
    friction_needed: Float[Array, "*batch"]
    friction_needed_time: Float[Array, "*batch"]
    largest_friction: Float[Array, "*batch"]
    largest_friction_time: Float[Array, "*batch"]
    weight: Float[Array, "*batch"]
    constant: Bool[Array, "*batch 3"] = eqx.field(default_factory=lambda: jnp.zeros(3, bool))

    @property
    def margin(self) -> Float[Array, "*batch"]:
        """The smallest N / (M g): 1 at rest on the plane, 0 where the ball would leave it."""
        return self.least_normal_force / self.weight

    @property
    def holds(self) -> Bool[Array, "*batch"]:
        """Whether the ball stayed on the plane, N > 0 throughout."""
        return self.least_normal_force > 0

    @property
    def when(self) -> tuple[str, str]:
        """The times at which N is least and |f| / N largest, as text. For one run, not for a batch."""
        times = self.least_normal_force_time, self.friction_needed_time
        pairs = zip(times, np.asarray(self.constant)[:2], strict=True)
        first, second = ("throughout" if same else f"at t = {float(t):.6g}" for t, same in pairs)
        return first, second

    def __repr__(self) -> str:
        if not is_single(self.least_normal_force):
            return format_value(self)
        least = float(self.least_normal_force)
        lines = [f"least normal force {least:.10g} {self.when[0]}, {least / float(self.weight):.4g} of the weight"]
        if np.isfinite(self.friction_needed):
            mu = float(self.friction_needed)
            lines.append(f"friction needed, max |f|/N, {mu if mu > ROUNDING_OF_EXTREME else 0.0:.10g} {self.when[1]}")
        else:
            lines.append("the body would leave the plane, so no friction is enough")
        return "\n".join(lines)


def contact_extremes(trajectory: Trajectory[Any, Any]) -> ContactExtremes:
    """Finds the extreme values of N, |f| / N and |f| within the steps of a run, not just at its saved times.

    NaN for a run that could not start. A run under feedback is solved again from each sample to the next, with the
    inputs that acted: just before a sample the last ones still act, and at it those that are held from there on.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns with ``dense=True``, or ``run`` of a
      :class:`~jaxball.control.ClosedLoop`.

    **Raises:** ``ValueError`` when the trajectory was made without ``dense=True`` or with a law of contact, and
    ``TypeError`` for a system that does not touch a plane.

    **Example:**

    >>> from jaxball import Disk, Fixed, PointMass, contact_extremes, simulate
    >>> disk = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, Fixed((0.5, 0.0, 0.0)))])
    >>> contact_extremes(simulate(disk, [0.0, 1.0, 2.0], dense=True))
    least normal force 1.47002... at t = 1.162..., 0.98 of the weight
    friction needed, max |f|/N, 0.12 at t = 0
    """
    require("trajectory", trajectory, Trajectory, "what jaxball.simulate returns, or `run` of a closed loop")
    if not isinstance(trajectory.system, AbstractRollingSystem):
        raise TypeError(
            "Argument `trajectory` must be of a system that rolls on a plane, such as a Ball, but it is of a "
            f"{type(trajectory.system).__name__}."
        )
    if not always_rolls(trajectory):
        raise ValueError(
            "Argument `trajectory` must be of a body without modes, but it is of one with "
            f"{trajectory.history.described}; its forces at the saved times are in `observables`."
        )
    if not trajectory.history.restarts:
        times = jnp.asarray(trajectory.times)
        return _extremes_of_samples(trajectory.system, times, trajectory.state, trajectory.reached)
    if trajectory.interpolant is None:
        raise ValueError(
            "Argument `trajectory` must have dense output; call simulate(..., dense=True). The forces at the saved "
            "times are in `observables`."
        )
    return _extremes(trajectory.interpolant, trajectory.reached, trajectory.status)


@programs.filter_jit
def _extremes(interpolant: Interpolant, reached: Float[Array, ""], status: Array) -> ContactExtremes:
    started = status != Status.IMPOSSIBLE
    interpolant, reached = differentiate_where(started, (interpolant, reached))
    packing, steps = interpolant.packing, Steps.of(interpolant.solution, reached)

    def forces_and_rates(t, x):
        return jnp.concatenate([_evaluate_sizes(packing, t, x), packing.field(t, x)])

    peaks = maxima(steps, forces_and_rates, 3)
    N, _, f = jnp.diagonal(peaks.values)
    mu = Reaction(-peaks.values[1, 0], peaks.values[1, 2] ** 2).ratio
    extremes = (-N, peaks.time[0], mu, peaks.time[1], f, peaks.time[2])
    extremes = with_derivatives(extremes, _at, steps, packing, peaks.step, peaks.time)
    weight = packing.system.weight
    constant = _are_same(peaks.size, peaks.least, weight)
    operands = steps, packing, peaks.step, peaks.time, constant
    extremes = with_second_derivatives(extremes, "extremes of the contact force", _at_peaks, *operands)
    return ContactExtremes(
        *(jnp.where(started, value, jnp.nan) for value in (*extremes, weight)), constant=constant & started
    )


def _are_same(largest: Float[Array, "3"], least: Float[Array, "3"], weight: Float[Array, ""]) -> Bool[Array, "3"]:
    """Returns whether N, |f| / N and |f| are constant to within rounding."""
    sizes = jax.lax.stop_gradient(jnp.stack([weight, jnp.ones_like(weight), weight]))
    return largest - least <= jnp.maximum(SAME_VALUE * jnp.abs(largest), ROUNDING_OF_EXTREME * jnp.abs(sizes))


@programs.filter_jit
def _extremes_of_samples(
    system: AbstractRollingSystem, times: Float[Array, " T"], states: Any, reached: Float[Array, ""]
) -> ContactExtremes:
    """Finds the extremes of a run whose inputs change at its saved times, ``times``: of all solves between these."""

    def extremes_from(k: Int[Array, ""]) -> ContactExtremes:
        ends, start = times[k + jnp.arange(2)], jax.tree.map(lambda leaf: leaf[k], states)
        run = simulate(system, ends, start, dense=True, max_steps=MOST_STEPS_OF_SAMPLE, inside=False)
        assert run.interpolant is not None
        return _extremes(run.interpolant, run.reached, run.status)

    each = jax.lax.map(extremes_from, jnp.arange(times.size - 1))
    happened = times[1:] <= reached
    quantities = [
        (each.least_normal_force, each.least_normal_force_time, -1),
        (each.friction_needed, each.friction_needed_time, 1),
        (each.largest_friction, each.largest_friction_time, 1),
    ]
    extremes, sizes = [], []
    for value, time, sign in quantities:
        # A value that is not a number must not be passed over in silence: it counts as the largest.
        size = jax.lax.stop_gradient(jnp.where(jnp.isnan(value), jnp.inf, sign * value))
        best = jnp.argmax(jnp.where(happened, size, -jnp.inf))
        extremes += [value[best], time[best]]
        sizes.append(size)
    largest = jnp.stack([jnp.max(size, where=happened, initial=-jnp.inf) for size in sizes])
    least = jnp.stack([jnp.min(size, where=happened, initial=jnp.inf) for size in sizes])
    weight, began = each.weight[0], happened[0]
    constant = jnp.all(each.constant, axis=0, where=happened[:, None]) & _are_same(largest, least, weight)
    return ContactExtremes(
        *(jnp.where(began, value, jnp.nan) for value in (*extremes, weight)), constant=constant & began
    )


def _evaluate_sizes(packing: Packing, t: Float[Array, ""], x: Float[Array, " size"]) -> Float[Array, "3"]:
    """Computes the functions that are largest at the extremes."""
    force = packing.system.plane_reaction(t, packing.unpack(t, x))
    # The angle is largest where |f| / N is, and has no spike where N is small.
    return jnp.stack([-force.normal, force.angle, force.friction])


def _at(steps: Steps, packing: Packing, index: Int[Array, "3"], times: Float[Array, "3"]) -> tuple[Array, ...]:
    """Computes N, |f| / N and |f|, each with its time, at three times in steps, with their first derivatives."""
    times, vectors = _move_each(steps, packing, index, times)
    return _extremes_at(packing, times, times, vectors)


def _at_peaks(
    steps: Steps, packing: Packing, index: Int[Array, "3"], times: Float[Array, "3"], constant: Bool[Array, "3"]
) -> tuple[Array, ...]:
    """Computes the same as :func:`_at`, with second derivatives of the values, for which the times of extremes within
    steps move to the zeros of the rates.
    """
    times, vectors = _move_each(steps, packing, index, times)
    lengths = (steps.end - steps.start)[index]

    def to_peak(sample: tuple[Array, ...]) -> tuple[Float[Array, ""], Float[Array, " size"]]:
        which, t, x, length = sample
        return move_to_peak(packing.field, lambda t, x: entry(which, _evaluate_sizes(packing, t, x)), t, x, length)

    moved = jax.lax.map(to_peak, (jnp.arange(3), times, vectors, jnp.where(constant, 0.0, lengths)))
    return _extremes_at(packing, times, *moved)


def _move_each(
    steps: Steps, packing: Packing, index: Int[Array, "3"], times: Float[Array, "3"]
) -> tuple[Float[Array, "3"], Float[Array, "3 size"]]:
    """Returns times in steps and the vectors then, with the derivatives of the ends of the run and of kinks."""
    kinks = packing.system.kinks()
    return jax.vmap(lambda i, t: move(steps, kinks, i, t))(index, times)


def _extremes_at(
    packing: Packing, named: Float[Array, "3"], times: Float[Array, "3"], vectors: Float[Array, "3 size"]
) -> tuple[Array, ...]:
    """Computes N, |f| / N and |f| at three times, each with the time that is ``named``."""
    force = jax.lax.map(
        lambda sample: packing.system.plane_reaction(sample[0], packing.unpack(*sample)), (times, vectors)
    )
    return force.normal[0], named[0], force.ratio[1], named[1], force.friction[2], named[2]
