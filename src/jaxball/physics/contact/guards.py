"""What ends a mode of a body on its ground: the guards, and what the end of a step means.

In this order: those of the contact (``CAUSES``), under exact dry resistance those of rolling and of spinning, and two
for each joint that dry friction or a stop may hold. The guard of a thing that moves is its rate in its direction, and
of one that is held the friction that is to spare.
"""

import dataclasses
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from ...interface.status import Status
from ...numerics.arrays import select_tree
from ...numerics.time_inputs import depends_on_time
from ...numerics.vectors import root
from ..dynamics.dry_friction import needs
from ..dynamics.sticking import Stops, has_stops, rubs, sides, sticking_guards, sticking_slots
from ..hybrid import NONE, START, WINDOW, Accuracy, Assessment, GuardedStep, Transition
from . import friction, over_surface as over, slip as slips
from .modes import CAUSES, ContactState, Mode, SwitchCause, cause_of
from .over_surface import has_surface
from .released import ReleasedState, Response, slip_velocity
from .slide import slide, slide_of, slide_size
from .slip import Heading, approach_rest, guards_of_turning, heading_of_rolling
from .window import Beginning

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
        spare = needs(plane.static_levels, height, forces.acting.torque, forces.acting.normal)
        of_turning = guards_of_turning(plane, t, state, spare, reference.rolling)
        values.append(jnp.where(state.is_in(Mode.FLIGHT), 1.0, of_turning))
    if state.slips is not None:
        values.append(sticking_guards(plane.body, t, state.body, state.slips, forces.holding))
    return jnp.concatenate(values)


def guards_follow_motion(plane: "BodyOnPlane", t: Float[Array, ""], packed: ContactState, reference: Headings) -> bool:
    """Returns whether steps that follow the motion follow the guards, too, however long they are: these are smooth
    functions of the packed state that vary no faster than it does, and nothing varies with time alone.

    That is known before anything is computed.
    """
    # The height over a surface, or of a convex shape, may vary faster than the place and the attitude.
    if has_surface(plane.body) or plane.body.shape is not None:
        return False
    # In a window the direction of a slip varies with time, but only as a polynomial that steps resolve.
    x, unravel = ravel_pytree(dataclasses.replace(packed, begun=None))
    numbers, unravel_numbers = ravel_pytree((plane, reference))

    def values(t: Float[Array, ""], x: Float[Array, " size"], numbers: Float[Array, " numbers"]) -> Array:
        plane, reference = unravel_numbers(numbers)
        return guards(plane, t, plane.from_packed(t, unravel(x)), reference)

    return not depends_on_time(jax.make_jaxpr(values)(t, x, numbers))


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

    Nor does it leave a plane on which nothing presses it. It grows with the weight, with the rotation, and with a force
    that pulls the body, which is no larger than the reaction and what it accelerates.
    """
    rolling = response.rolling
    R, Omegadot, Omega = jax.lax.stop_gradient((rolling.reaction, rolling.Omegadot, state.body.Omega))
    # The mass that a normal acceleration of the contact has to move, (D⁻¹)₃₃.
    m = jax.lax.stop_gradient(response.yielding.reaction[2, 2])
    g, r = jax.lax.stop_gradient((jnp.abs(plane.body.gravity), plane.body.radius))
    turning = jnp.sum(Omega**2) + 2 * root(jnp.sum(Omegadot**2))
    scale, limits = root(jnp.sum(R**2)) + m * (g + r * turning), jnp.finfo(R.dtype)
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


class Progress(NamedTuple):
    """A transition in progress: time, the state at the mode's end, and the current one.

    ``still`` says that it does not slip, ``flies`` that it leaves the ground, ``lands`` that it comes down, ``decides``
    that the mode has ended, and ``begins`` that a slip begins. ``stands`` says that rolling has ended against exact dry
    resistance, and ``turns`` that it begins. ``strikes`` says that a joint has struck its stop; None without stops.
    """

    t: Float[Array, ""]
    before: ContactState
    state: ContactState
    still: Bool[Array, ""]
    flies: Bool[Array, ""]
    lands: Bool[Array, ""]
    decides: Bool[Array, ""]
    begins: Bool[Array, ""]
    stands: Bool[Array, ""]
    turns: Bool[Array, ""]
    strikes: Bool[Array, ""] | None

    @classmethod
    def of(cls, plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, event: Int[Array, ""]) -> "Progress":
        """Begins a transition."""
        starts, no = event == START, jnp.asarray(False)
        strikes = None if state.stop_loss is None else no
        decides = starts | (event >= 0)
        if state.mode is None:
            state_in_mode = _without_windows(plane, t, state, decides, no)
            return cls(t, state, state_in_mode, no, no, no, decides, no, no, no, strikes)
        rise = _rise(plane, t, state)
        # What has happened to a joint does not concern a body in flight.
        goes_on = (event >= FIRST_OF_JOINTS) & state.is_in(Mode.FLIGHT)
        return cls(
            t=t,
            before=state,
            state=_without_windows(plane, t, state, decides, starts | goes_on),
            still=(event == int(SwitchCause.GIVES_WAY)) | state.is_in(Mode.ROLLING),
            flies=(event == int(SwitchCause.LIFTS)) | goes_on | starts & ((state.height > 0) | (rise > 0)),
            lands=(event == int(SwitchCause.LANDS)) | starts & (state.height <= 0) & (rise < 0),
            decides=decides,
            begins=no,
            stands=no,
            turns=no,
            strikes=strikes,
        )

    def finish(self, cause: Int[Array, ""], slope: Float[Array, ""], pauses: Bool[Array, ""]) -> Transition:
        """Returns the transition for a :class:`SwitchCause`, WINDOW or START.

        ``pauses`` says that the mode has ended in ever shorter steps, which is so where a slip does.
        """
        starts = cause == START
        # A start is no switch, except for a body that starts with an impact.
        first, begins, crowds = int(SwitchCause.LANDS), self.lands, cause != int(SwitchCause.LANDS)
        if self.strikes is not None:
            first, begins = jnp.where(self.lands, first, int(SwitchCause.JOINT_STRIKES)), begins | self.strikes
            crowds &= cause != int(SwitchCause.JOINT_STRIKES)
        return Transition(
            t=self.t,
            before=self.before,
            after=self.state,
            event=jnp.where(starts, first, cause),
            slope=slope,
            switches=jnp.where(starts, begins, self.decides & (cause != WINDOW)),
            # Bounces follow each other in ever shorter times, but ``slowest`` of the law puts an end to them.
            crowds=crowds,
            pauses=pauses & self.decides,
            status=jnp.where(cause == int(SwitchCause.JAMS), int(Status.JAMMED), int(Status.SUCCESS)),
        )


def _without_windows(
    plane: "BodyOnPlane",
    t: Float[Array, ""],
    state: ContactState,
    decides: Bool[Array, ""],
    keeps_height: Bool[Array, ""],
) -> ContactState:
    """Returns the state on the ground, or at its height, with the directions that are still known beforehand."""
    # All other events happen on the ground, where a landing is met only up to rounding.
    height, begun, rolling, none = state.height, state.begun, state.rolling, Beginning.none(t)
    ended = Beginning.none(t, slide_size(plane))
    if height is not None:
        height = jnp.where(keeps_height, height, 0.0)
    # The end of one window leaves the other in force; a new mode leaves neither.
    if begun is not None:
        begun = ended if rolling is None else select_tree(decides | (begun.until <= t), ended, begun)
    if rolling is not None and not plane.body.planar:  # the direction of a disk's rolling does not turn
        rolling = select_tree(decides | (rolling.until <= t), none, rolling)
    return dataclasses.replace(state, height=height, begun=begun, rolling=rolling)


def _rise(plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState) -> Float[Array, ""]:
    """Computes the rate at which a body leaves its ground; 0 if it is rounding, but not for a ball on a plane."""
    rate = slip_velocity(plane.body, t, state.released)[2]
    if not has_surface(plane.body) and plane.body.shape is None:
        return rate
    return jnp.where(jnp.abs(rate) > plane.rounding_of_velocity(state), rate, 0.0)
