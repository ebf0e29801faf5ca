"""The extreme values of the contact force over a whole run, with the times at which they occur."""

from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .. import programs
from ..interface.arguments import require
from ..interface.printing import Printed, format_value, is_single
from ..interface.status import Status
from ..physics.contact.law import Contact
from ..physics.packing import Packing
from ..physics.rolling import AbstractRollingSystem
from ..programs.derivatives.differentiation import differentiate_where, without_derivatives
from .observers import Observation, Observers, Seen, Step
from .quantities import friction, half_tangent, normal_force, tangent, values
from .simulate import simulate
from .solvers.dense.peaks import Peaks
from .solvers.dense.steps import Steps
from .trajectory import Interpolant, Trajectory

# Of the weight, or of 1: anything smaller counts as zero, and leaves a constant value constant.
ROUNDING = 1e-12
MOST_STEPS_OF_SAMPLE = 256  # of a run under feedback
STEPS_OF_BOUNCES = 16  # times these, with a law of contact
SAME_VALUE = 1e-8  # the relative change that a constant value may have
# Relative to values, and in units of rounding: what forces vary by less is no peak.
NEGLIGIBLE_FORCE, ROUNDINGS = 1e-9, 64
OBSERVATION = Observation(values, (normal_force, half_tangent, friction), ((0, -1.0), (1, 1.0), (2, 1.0)))


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
        least = float(self.least_normal_force) + 0.0  # not −0, as in flight
        lines = [f"least normal force {least:.10g} {self.when[0]}, {least / float(self.weight):.4g} of the weight"]
        if np.isfinite(self.friction_needed):
            mu = float(self.friction_needed)
            lines.append(f"friction needed, max |f|/N, {mu if mu > ROUNDING else 0.0:.10g} {self.when[1]}")
        else:
            lines.append("the body would leave the plane, so no friction is enough")
        return "\n".join(lines)


def contact_extremes(trajectory: Trajectory[Any, Any]) -> ContactExtremes:
    """Finds the extreme values of N, |f| / N and |f| within the steps of a run, not just at its saved times.

    Of a run with modes these are the forces in the mode that the body is in: all 0 in flight, and the friction of the
    law while the body slides, so that |f| / N is then its coefficient. Impulses of impacts are not among them.

    NaN for a run that could not start. A run under feedback is solved again from each sample to the next, with the
    inputs that acted: just before a sample the last ones still act, and at it those that are held from there on.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns with ``dense=True``, or ``run`` of a
      :class:`~jaxball.control.loop.ClosedLoop`.

    **Raises:** ``ValueError`` when the trajectory was made without ``dense=True``, and ``TypeError`` for a system that
    does not touch a plane.

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
    if not trajectory.history.restarts:
        times = jnp.asarray(trajectory.times)
        system, states, law = trajectory.system, trajectory.state, None
        if (contact := trajectory.contact) is not None:
            law, states = contact.law, contact.states_of(cast(Any, system), states).released
        return _extremes_of_samples(system, law, times, states, trajectory.reached)
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
    (N, half, f), times, seen = _observe(steps, packing)
    extremes = (N, times[0], tangent(half), times[1], f, times[2])
    weight = packing.system.shown.weight
    constant = _are_same(seen.value[0], seen.least, weight)
    return ContactExtremes(
        *(jnp.where(started, value, jnp.nan) for value in (*extremes, weight)), constant=constant & started
    )


def _observe(steps: Steps, packing: Packing) -> tuple[Float[Array, "3"], Float[Array, "3"], Peaks]:
    """Observes the steps of a run that has ended, whose dense output is as exact as they are: the extremes, when they
    occur, and what has been seen.
    """
    tolerance = jnp.maximum(NEGLIGIBLE_FORCE, ROUNDINGS * float(jnp.finfo(steps.start.dtype).eps))

    def observers_of(packing: Packing) -> Observers:
        return Observers(OBSERVATION, packing, tolerance, tolerance, tolerance)

    def step_of(steps: Steps, k: Int[Array, ""]) -> Step:
        states = jax.tree_util.Partial(lambda step, t: step.evaluate(t), steps.step(k))
        # The number of the step is all that it takes to find it again.
        return Step(*steps.ends(k), k[None].astype(steps.start.dtype), states, states)

    fixed, still = without_derivatives((steps, packing))
    looking = observers_of(still)
    run = fixed.start[0], fixed.end[jnp.maximum(fixed.count - 1, 0)]

    def look(k: Int[Array, ""], seen: Seen) -> Seen:
        return looking.observe(seen, step_of(fixed, k), run, jnp.asarray(True), reverse=False)

    seen = jax.lax.fori_loop(0, fixed.count, look, looking.begin(fixed.start[:1]))
    assert seen.best is not None

    def again(start: Array, end: Array, number: Float[Array, "1"]) -> Step:
        k = number[0].astype(int)
        return step_of(differentiate_where(fixed.taken[k], steps), k)

    return *observers_of(packing).extremes(seen.best, again), seen.best


def most_steps_of_sample(contact: Contact | None) -> int:
    """Returns how many steps the solve of a sample may take; with a law of contact more, because bounces pile up."""
    return MOST_STEPS_OF_SAMPLE * (1 if contact is None else STEPS_OF_BOUNCES)


def _are_same(largest: Float[Array, "3"], least: Float[Array, "3"], weight: Float[Array, ""]) -> Bool[Array, "3"]:
    """Returns whether N, |f| / N and |f| are constant to within rounding."""
    sizes = jax.lax.stop_gradient(jnp.stack([weight, jnp.ones_like(weight), weight]))
    return largest - least <= jnp.maximum(SAME_VALUE * jnp.abs(largest), ROUNDING * jnp.abs(sizes))


@programs.filter_jit
def _extremes_of_samples(
    system: AbstractRollingSystem,
    contact: Contact | None,
    times: Float[Array, " T"],
    states: Any,
    reached: Float[Array, ""],
) -> ContactExtremes:
    """Finds the extremes of a run whose inputs change at its saved times, ``times``: of all solves between these."""

    def extremes_from(k: Int[Array, ""]) -> ContactExtremes:
        ends, start = times[k + jnp.arange(2)], jax.tree.map(lambda leaf: leaf[k], states)
        most = most_steps_of_sample(contact)
        run = simulate(system, ends, start, contact=contact, dense=True, max_steps=most, inside=False)
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
