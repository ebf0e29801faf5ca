"""The energy that each law has taken from a body since the start of its run."""

from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .. import programs
from ..interface.arguments import require, require_one_run
from ..interface.printing import Printed
from ..interface.status import Status
from ..numerics.vectors import dot
from ..physics.body import AbstractBody
from ..physics.contact.body_on_plane import BodyOnPlane, has_contact
from ..physics.contact.slide import spinning_loss
from ..physics.mechanisms.forces import AbstractJointForce
from ..physics.observables import compute_observables, movement
from ..physics.packing import Packing
from ..programs.derivatives.differentiation import with_unknown_derivatives
from .solvers.dense.steps import AfterPauses, Steps
from .trajectory import Interpolant, Trajectory

POINTS = 8  # in each step: as exact as the dense output, as in ``verify``
OF_RESISTANCE = 2  # powers before those of joints


class EnergyLosses(Printed):
    """The energies that laws have dissipated at the saved times of a run, mass length²/time²; NaN beyond its end.

    - ``slip``, ``impacts``: by friction where the body slides, and by impacts, shape (T,).
    - ``dry``: by dry friction against rolling and spinning, smoothed or exact, shape (T,).
    - ``viscous``: by all else of its resistance, at the contact and from the medium, shape (T,).
    - ``joints``: by the friction and the dampers in each joint of every mechanism, in their order, shape (T, joints).
    - ``stops``: where joints strike their HardStops, by the impulse there, shape (T,).

    **Example:**

    >>> from jaxball import Ball, BallState, Contact, simulate
    >>> from jaxball.physics import ReleasedState
    >>> ball, start = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4)), ReleasedState(BallState(), V=(1.0, 0.0, 0.0))
    >>> run = simulate(ball, [0.0, 9.0], start, contact=Contact(0.1), dense=True)
    >>> round(float(run.energy_losses().total[-1]), 6)  # 1/7 m v², until it rolls
    0.142857
    """

    slip: Float[Array, " T"]
    impacts: Float[Array, " T"]
    dry: Float[Array, " T"]
    viscous: Float[Array, " T"]
    joints: Float[Array, "T joints"]
    stops: Float[Array, " T"]

    @property
    def total(self) -> Float[Array, " T"]:
        """What all of them have dissipated, shape (T,)."""
        return self.slip + self.impacts + self.dry + self.viscous + jnp.sum(self.joints, axis=-1) + self.stops


def energy_losses(trajectory: Trajectory[Any, Any]) -> EnergyLosses:
    require("trajectory", trajectory, Trajectory, "what jaxball.simulate returns")
    if not isinstance(trajectory.system, AbstractBody):
        raise TypeError(
            "Argument `trajectory` must be of a Ball or a Disk, whose laws are known one by one, but it is of a "
            f"{type(trajectory.system).__name__}."
        )
    if trajectory.interpolant is None:
        raise ValueError("Argument `trajectory` must have dense output; call simulate(..., dense=True).")
    require_one_run(trajectory.status, "Function `energy_losses`", "call it within jax.vmap")
    times = jnp.asarray(trajectory.times)
    parameters = trajectory.system, trajectory.start
    lost = _integrate(trajectory.interpolant, times, trajectory.reached, trajectory.status, parameters)
    contact, none = trajectory.contact, 0.0 * lost[:, 0]
    slip, impacts = (none, none) if contact is None else (contact.friction_loss, contact.impact_loss)
    stops = getattr(trajectory.history, "stop_loss", None)
    stops = none if stops is None else stops
    return EnergyLosses(slip, impacts, lost[:, 0], lost[:, 1], lost[:, OF_RESISTANCE:], stops)


@programs.filter_jit
def _integrate(
    interpolant: Interpolant, times: Float[Array, " T"], reached: Float[Array, ""], status: Array, parameters: Any
) -> Float[Array, "T laws"]:
    """Integrates the power of each law up to each time."""
    packing, steps = interpolant.packing, Steps.of(interpolant.solution, reached)

    def over(k: Int[Array, ""], until: Float[Array, ""] | None = None) -> Float[Array, " laws"]:
        """Integrates over a step, with the pause before it, or over the part of both before a time."""
        (start, end), states = steps.ends(k), steps.step(k)
        ends = [start, end]
        if isinstance(steps.interpolation, AfterPauses):
            # Where a mode ends, both ends of the pause move with the event.
            ends.insert(0, jax.lax.stop_gradient(steps.times[k] - start) + start)
        ends = ends if until is None else [jnp.minimum(end, until) for end in ends]

        def between(low: Float[Array, ""], high: Float[Array, ""]) -> Float[Array, " laws"]:
            nodes, weights = (jnp.asarray(x, times.dtype) for x in np.polynomial.legendre.leggauss(POINTS))
            places = low + (high - low) * (1 + nodes) / 2
            each = jax.lax.map(lambda t: _powers(packing, t, states.evaluate(t)), places)
            return (high - low) / 2 * jnp.sum(weights[:, None] * each, axis=0)

        return jnp.sum(jnp.stack([between(low, high) for low, high in pairwise(ends)]), axis=0)

    nothing = jnp.zeros(jax.eval_shape(over, steps.count).shape, times.dtype)
    count = steps.start.size
    # The steps are computed once more for derivatives: what they keep would fill the memory.
    in_steps = jax.checkpoint(lambda k: jax.lax.cond(k < steps.count, over, lambda k: nothing, k))
    each = jax.lax.map(in_steps, jnp.arange(count))
    before = jnp.cumsum(each, axis=0) - each

    def up_to(t: Float[Array, ""]) -> Float[Array, " laws"]:
        k = jnp.clip(jnp.sum(steps.taken & (steps.start <= t)) - 1, 0, count - 1)
        return before[k] + over(k, t)

    lost = jax.lax.map(jax.checkpoint(up_to), times)
    happened = (times <= reached) & (status != Status.IMPOSSIBLE)
    return with_unknown_derivatives(jnp.where(happened[:, None], lost, jnp.nan), parameters)


@jax.jit
def _powers(packing: Packing, t: Float[Array, ""], x: Float[Array, " size"]) -> Float[Array, " laws"]:
    """Computes the power that dry friction at the contact, all other resistance, and each joint dissipate."""
    system, state = packing.system, packing.unpack(t, x)
    motion = movement(system, t, state)
    body = system.moving(state) if isinstance(system, BodyOnPlane) else system
    seen, shown = compute_observables(body, t, motion), system.state_to_show(state)
    dry, slip = jnp.zeros_like(t), jnp.zeros_like(t)
    if motion.dry is not None:
        dry = -dot(motion.dry, motion.acting.resisted)  # relative to the matter of the ground, which may turn
    if motion.slip is not None:
        slip = -dot(motion.R, motion.slip.velocity)
    if has_contact(system) and system.pivot is not None:
        spun = spinning_loss(system, t, state, motion.dry)
        dry, slip = dry - spun, slip + spun
    drives = [drive for mechanism in body.mechanisms for drive in mechanism.drives]
    lost = [dry, seen.dissipation - dry - slip]
    for k, drive in enumerate(drives):
        theta, rate = seen.joint_angles[k], seen.joint_rates[k]
        forces = drive.dissipating if isinstance(drive, AbstractJointForce) else ()
        effort = sum((force(t, theta, rate, shown) for force in forces), jnp.zeros_like(t))
        lost.append(-effort * rate)
    return jnp.stack(lost)
