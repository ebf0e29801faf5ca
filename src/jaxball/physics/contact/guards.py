"""What ends a mode of a body on its ground: the guards, and what the end of a step means.

In this order: those of the contact (``CAUSES``), under exact dry resistance those of rolling and of spinning, and two
for each joint that dry friction or a stop may hold. The guard of a thing that moves is its rate in its direction, and
of one that is held the friction that is to spare.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...numerics.vectors import root
from ..dynamics.rest import needs
from ..dynamics.sticking import sticking_guards, sticking_slots
from ..dynamics.stops import Stops, has_stops, rubs, sides
from ..hybrid import NONE, START, WINDOW, Accuracy, Assessment, GuardedStep
from . import friction, over_surface as over, slip as slips
from .modes import CAUSES, ContactState, Mode, SwitchCause, cause_of
from .released import ReleasedState, Response, slip_velocity
from .slide import slide, slide_of
from .slip import Heading
from .turning import approach_rest, guards_of_turning, heading_of_rolling

if TYPE_CHECKING:
    from .body_on_plane import BodyOnPlane

OF_CONTACT, OF_TURNING = 3, 2  # guards of the contact, and of rolling and of spinning
FIRST_OF_JOINTS = 16  # among the events of a step: that of the first guard of the joints, more than any cause
FORCES = 32  # in units of rounding of the forces whose sum a reaction is: one that is smaller counts as zero
RISEN = 1e-6  # of √(r/g): a body that rises counts as being as high as after this time, at least
SLOW_DISK = 0.55  # as slip.SLOW, for a disk: its slip does not turn, but must exceed the error of a mode's end
NOTHING = 1e-9  # a normal force below this part of its size in a step counts as zero


class Headings(NamedTuple):
    """The headings of a slip and of rolling as a step begins; None without a law of contact or exact dry resistance."""

    slip: Heading | None
    rolling: Heading | None


def headings(plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, accuracy: Accuracy) -> Headings:
    """Returns the headings as a step begins."""
    of_slip = None
    if plane.contact is not None:
        sliding = slide(plane, t, state)
        sigma = state.direction(t, sliding)
        size = plane.speed_of(state.released)
        power = SLOW_DISK if plane.body.planar else slips.SLOW
        of_slip = Heading.of(sigma, sliding, size, accuracy.atol + accuracy.rtol * size, power)
    return Headings(of_slip, None if state.rolls is None else heading_of_rolling(plane, t, state, accuracy))


def headings_at_rest(plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState) -> Headings:
    """Returns the headings without a solve, along which a slip and rolling end where their velocities vanish."""
    zero, of_slip = jnp.zeros_like(plane.body.radius), None
    if plane.contact is not None:
        sigma = state.direction(t, slide(plane, t, state))
        of_slip = Heading(sigma, zero, zero)
    return Headings(of_slip, None if state.rolls is None else Heading(plane.direction(t, state), zero, zero))


def with_fixed_speeds(plane: "BodyOnPlane", reference: Headings) -> Headings:
    """Returns the headings for which the guards of a slip and of rolling that end are exactly zero: the speed counts as
    fixed.
    """
    slip, rolling = reference
    if rolling is not None:
        # A ball's rolling is given to ``end_rolling`` while it still has this speed. That of a disk does not turn, and
        # is followed to exactly zero.
        rolling = rolling._replace(least=jnp.zeros_like(rolling.speed) if plane.body.planar else rolling.speed)
    return Headings(None if slip is None else slip._replace(least=slip.speed), rolling)


def guards(
    plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, reference: Headings
) -> Float[Array, " guards"]:
    """Computes the guards. A slip, and rolling, last while they go along their headings."""
    values, forces = [], plane.forces(t, state)
    if reference.slip is not None and forces.response is not None:
        values.append(guards_of_contact(plane, t, state, reference.slip, forces.response, forces.acting))
    if reference.rolling is not None:
        height = plane.body.height_of_centre(state.body.Gamma)
        spare = needs(plane.resistance, height, forces.acting.torque, forces.acting.normal)
        of_turning = guards_of_turning(plane, t, state, spare, reference.rolling)
        values.append(jnp.where(state.is_in(Mode.FLIGHT), 1.0, of_turning))
    if state.slips is not None:
        values.append(sticking_guards(plane.body, t, state.body, state.slips, forces.holding))
    return jnp.concatenate(values)


def guards_of_contact(
    plane: "BodyOnPlane",
    t: Float[Array, ""],
    state: ContactState,
    heading: Heading,
    response: Response,
    acting: friction.Interaction,
) -> Float[Array, "3"]:
    """Computes the guards of the contact in its mode, in the order of ``CAUSES``; 1 for one that it does not have."""
    slack = rounding_of_force(plane, state, response)
    slip, unit = slip_velocity(plane.body, t, state.released), jnp.ones_like(state.height)
    spare = friction.margin(acting.grip, plane.law.static_friction) + slack
    # A slip on a smooth ground, or against friction that fades, never ends: its guard must not fall.
    forward = jnp.where(plane.slips_end, jnp.sum(slide_of(plane, slip, t, state) * heading.sigma) - heading.least, unit)
    # A body that rises does not land, where rounding takes its height below zero as it lifts.
    above = jnp.maximum(
        state.height + over.rounding_of_height(plane.body, t, state),
        jnp.where(slip[2] > 0, RISEN * slips.unit_of_time(plane.body) * slip[2], -jnp.inf),
    )
    above = over.clearance_for_landing(plane.body, t, state, above)
    rolls, slides = state.is_in(Mode.ROLLING), state.is_in(Mode.SLIDING)
    return jnp.stack(
        [
            jnp.where(rolls, spare, jnp.where(slides, forward, above)),
            jnp.where(rolls | slides, acting.R[2] + slack, unit),
            jnp.where(slides, acting.solvability, unit),
        ]
    )


def rounding_of_force(
    plane: "BodyOnPlane", state: ContactState | ReleasedState, response: Response
) -> Float[Array, ""]:
    """Estimates the rounding of N and |f|, with which a body still rolls where friction just holds it.

    Nor does it leave a plane on which nothing presses it. It grows with the weight and with the rotation.
    """
    R, Omega = jax.lax.stop_gradient((response.rolling.reaction, state.body.Omega))
    # The mass that a normal acceleration of the contact has to move, (D⁻¹)₃₃.
    m = jax.lax.stop_gradient(response.yielding.reaction[2, 2])
    g, r = jax.lax.stop_gradient((jnp.abs(plane.body.gravity), plane.body.radius))
    scale, limits = root(jnp.sum(R**2)) + m * (g + r * jnp.sum(Omega**2)), jnp.finfo(R.dtype)
    # Positive also where nothing acts at all, so that a guard of 0 there is not an event.
    return FORCES * float(limits.eps) * scale + float(limits.tiny) ** 0.5


# What the end of a step means.


def first_of_turning(state: ContactState) -> int:
    """Returns the index of the guard of rolling, before that of spinning."""
    return 0 if state.mode is None else OF_CONTACT


def first_of_joints(state: ContactState) -> int:
    """Returns the index of the first guard of the joints."""
    return first_of_turning(state) + (0 if state.rolls is None else OF_TURNING)


def assess(plane: "BodyOnPlane", step: GuardedStep, accuracy: Accuracy) -> Assessment:
    """Finds the cause that the guard which is zero stands for, from ``FIRST_OF_JOINTS`` on for those of joints, or that
    a slip or rolling has ended although no guard is zero; and the longest next step.
    """
    assessed = Assessment(jnp.full_like(step.zero, NONE), jnp.full_like(step.end, jnp.inf))
    if plane.contact is not None:
        of_contact = step._replace(zero=jnp.where(step.zero >= OF_CONTACT, NONE, step.zero))
        assessed = _assess_contact(plane, of_contact, accuracy)
    if step.state.rolls is not None:
        assessed = _assess_turning(plane, step, accuracy, assessed)
    if step.state.slips is None:
        return assessed
    first = first_of_joints(step.state)
    ends = (step.zero >= first) & step.has_fallen
    return assessed._replace(event=jnp.where(ends, FIRST_OF_JOINTS + step.zero - first, assessed.event))


def _assess_contact(plane: "BodyOnPlane", step: GuardedStep, accuracy: Accuracy) -> Assessment:
    """Assesses the guards of the contact, as if there were no others.

    Where friction gives way because the normal force vanishes, the body lifts off. The longest next step is infinite,
    except where a slip slows down.
    """
    state, least, values = step.state, step.reference.slip.least, step.guards
    sliding = slide(plane, step.end, state)
    errors = slips.ERRORS * (accuracy.atol + accuracy.rtol * plane.speed_of(state.released))
    # A slip that does not continue along its heading may be at its end.
    slow = root(jnp.sum(sliding**2)) <= 2 * least + errors
    # The friction that can be had vanishes with the normal force, so both guards fall together, in either order.
    cause = cause_of(state.mode, step.zero)
    weightless = values[1, -1] <= NOTHING * step.largest[1]
    cause = jnp.where((cause == int(SwitchCause.GIVES_WAY)) & weightless, int(SwitchCause.LIFTS), cause)
    ends = (step.zero != NONE) & jnp.where(cause == int(SwitchCause.STOPS), slow, step.has_fallen)
    # The guard is the speed along the heading less ``least``, so these are the speeds at both ends of the step.
    before, after = values[0, 0] + least, values[0, -1] + least
    slides = state.is_in(Mode.SLIDING)
    slows_down = slides & plane.slips_end
    stops = slows_down & slow & slips.nears_its_end(before, after, least)
    otherwise = jnp.where(step.timed & slides, WINDOW, jnp.where(stops, int(SwitchCause.STOPS), NONE))
    longest = slips.longest_step(before, after, least, step.end - step.start, accuracy)
    longest = jnp.where(slows_down & ~ends, longest, jnp.inf)
    return Assessment(jnp.where(ends, cause, otherwise), longest)


def _assess_turning(plane: "BodyOnPlane", step: GuardedStep, accuracy: Accuracy, of_contact: Assessment) -> Assessment:
    """Assesses the guards of rolling and spinning, besides what is known of the contact."""
    state: Any = step.state
    guard = first_of_turning(state)
    spins = step.zero == guard + 1
    turns = (step.zero == guard) | spins
    rolls = (state.rolls != 0) & ~state.is_in(Mode.FLIGHT) & plane.resists_rolling
    stops, ends = rolls & (step.zero == guard), turns & step.has_fallen
    nears, longest = jnp.zeros_like(turns), of_contact.longest
    if not plane.body.planar and plane.resists_rolling:
        # The rate along the heading also falls to zero where a ball turns aside at speed: only a slow one may be at its
        # end.
        slow, nears, braked = approach_rest(plane, step, step.reference.rolling, guard, accuracy)
        ends, nears = turns & jnp.where(stops, slow, step.has_fallen), rolls & nears
        longest = jnp.minimum(longest, jnp.where(rolls & ~ends, braked, jnp.inf))
    rolling = jnp.where(state.rolls == 0, int(SwitchCause.BREAKS_LOOSE), int(SwitchCause.ROLLING_ENDS))
    spinning = jnp.where(state.spin == 0, int(SwitchCause.BEGINS_TO_SPIN), int(SwitchCause.SPINNING_ENDS))
    cause, event = jnp.where(spins, spinning, rolling), of_contact.event
    event = jnp.where((event == NONE) & step.timed & rolls, WINDOW, event)
    event = jnp.where((event < 0) & nears, int(SwitchCause.ROLLING_ENDS), event)
    return Assessment(jnp.where(ends, cause, event), longest)


def guard_of(state: ContactState, event: Int[Array, ""]) -> Int[Array, ""]:
    """Returns the guard of an event; 0 where no guard has it."""
    guard = jnp.zeros_like(event)
    if state.mode is not None:
        guard = jnp.argmax(jnp.asarray(CAUSES)[state.mode.astype(int)] == event)
    if state.rolls is not None:
        turns, spins = (is_one_of(event, *causes) for causes in (_OF_ROLLING, _OF_SPINNING))
        first = first_of_turning(state)
        guard = jnp.where(turns, first, jnp.where(spins, first + 1, guard))
    if state.slips is None:
        return guard
    return jnp.where(event >= FIRST_OF_JOINTS, first_of_joints(state) + event - FIRST_OF_JOINTS, guard)


def cause_of_event(plane: "BodyOnPlane", state: ContactState, event: Int[Array, ""]) -> Int[Array, ""]:
    """Returns the :class:`SwitchCause` of an event in a state."""
    if state.slips is None:
        return event
    # Which joint it was and what it does is in the directions before and after.
    which, stuck = of_joint(state, event), state.slips == 0
    stops, leaves = int(SwitchCause.JOINT_STOPS), int(SwitchCause.JOINT_BREAKS_LOOSE)
    cause = jnp.where(jnp.any(which & stuck), leaves, stops)
    if has_stops(plane.body):
        side = sides(plane.body, state.slips, state.body.theta[sticking_slots(plane.body)])
        cause = jnp.where(jnp.any(which & (side != 0)), int(SwitchCause.JOINT_LEAVES_STOP), cause)
        strikes = jnp.any(find_struck(plane, state, event) != 0)
        cause = jnp.where(strikes, int(SwitchCause.JOINT_STRIKES), cause)
    return jnp.where(event >= FIRST_OF_JOINTS, cause, event)


def of_joint(state: ContactState, event: Int[Array, ""]) -> Bool[Array, " sticking"]:
    """Returns which joint an event is of."""
    count = state.slips.size
    return (event >= FIRST_OF_JOINTS) & (np.arange(count) == (event - FIRST_OF_JOINTS) % count)


def find_struck(plane: "BodyOnPlane", state: ContactState, event: Int[Array, ""]) -> Float[Array, " sticking"]:
    """Returns the side of the stop that a joint strikes at an event, or at the start of a run: 1, −1 or 0 for none."""
    first, slides, slots = event - FIRST_OF_JOINTS < state.slips.size, rubs(plane.body), sticking_slots(plane.body)
    # Of a joint with friction the second guard is the gap ahead, of another one both are gaps, the upper first.
    side = jnp.where(slides, jnp.where(first, 0.0, state.slips), jnp.where(first, 1.0, -1.0))
    side = jnp.where(of_joint(state, event) & (state.slips != 0), side, 0.0)
    closing = Stops.of(plane.body).find_closing(state.body.theta[slots], state.body.thetadot[slots])
    # Of several that strike at the start the first alone does it here: an event follows for each of the others.
    first = jnp.cumsum(closing != 0) == 1
    return jnp.where(event == START, jnp.where(first, closing, 0.0), side)


def is_one_of(cause: Int[Array, ""], *causes: SwitchCause) -> Bool[Array, ""]:
    """Returns whether a cause is one of several."""
    return jnp.any(jnp.stack([cause == int(each) for each in causes]))


_OF_ROLLING = SwitchCause.ROLLING_ENDS, SwitchCause.BREAKS_LOOSE
_OF_SPINNING = SwitchCause.SPINNING_ENDS, SwitchCause.BEGINS_TO_SPIN
