"""What follows the end of a mode of a body on its plane: the next mode, and the state with which it begins."""

from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...interface.status import Status
from ...numerics.norms import root
from ..hybrid import START, Accuracy, Transition, at_zero
from . import friction, slip as slips
from .impact import impact
from .modes import CAUSES, Cause, ContactState, Mode
from .released import ReleasedState, Response, rates, slip_velocity, with_slip

if TYPE_CHECKING:
    from .body_on_plane import BodyOnPlane

WINDOW = -3  # no cause: the end of the time for which the direction of a slip was known beforehand
LONGEST_WINDOW = 0.1  # of √(r/g): the longest time for which the direction of a slip that begins is known beforehand
BEFORE_KINK = 0.999  # of the time until the next kink: the same
LONGEST = 0.25  # power of rounding: the longest time, in √(r/g), over which a slip is followed to its end in this way
COARSER = 0.3  # the same over the cube root of the tolerance, because the error of the response halfway grows like this
HALFWAY = 0.5  # through the time, and the speed, of a slip that ends
END, MIDDLE, IMPACT, MODE = range(4)  # what follows a mode, in this order


def transition(
    plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, event: Int[Array, ""], accuracy: Accuracy
) -> Transition:
    """What follows a :class:`Cause` for which a mode ends, the end of a window, or the start of a run."""
    starts = event == START
    cause = jnp.where(starts, int(Cause.START), event)
    heading = jax.lax.stop_gradient(plane.step_reference(t, state, accuracy))
    heading = heading._replace(least=heading.speed)
    which = jnp.argmax(jnp.asarray(CAUSES)[state.mode.astype(int)] == cause)
    t, before, slope = at_zero(
        lambda t, state: plane.guards_in_step(t, state, heading),
        t,
        state,
        plane.field(t, state),
        which,
        cause > int(Cause.START),
    )
    done = _next_mode(plane, t, before, cause, accuracy.tolerance)
    return Transition(
        t=done.t,
        before=done.before,
        after=done.state,
        event=jnp.where(starts, int(Cause.LANDS), cause),
        slope=slope,
        switches=jnp.where(starts, done.lands, done.decides & (cause != WINDOW)),
        crowds=cause != int(Cause.LANDS),
        # A slip has ended in ever shorter steps.
        pauses=(cause == int(Cause.STOPS)) & done.decides,
        status=jnp.where(cause == int(Cause.JAMS), int(Status.JAMMED), int(Status.SUCCESS)),
    )


def _next_mode(
    plane: "BodyOnPlane",
    t: Float[Array, ""],
    state: ContactState,
    cause: Int[Array, ""],
    tolerance: Float[Array, ""],
) -> "_Progress":
    """The state that follows the end of a mode, in a solve with this tolerance.

    First, a slip that ends is followed to its end. Next comes an impact, if the body lands, then the mode for the
    velocities after it, and then the direction in which a slip begins. All but the last need the response of the
    body, whose formulas are long, and so share one loop. A negative cause means none, and the mode continues, with
    the direction of its velocity.
    """
    before, starts = state, cause == int(Cause.START)
    lands = (cause == int(Cause.LANDS)) | starts & (state.height <= 0) & (state.V[2] < 0)
    still = (cause == int(Cause.GIVES_WAY)) | state.is_in(Mode.ROLLING)
    flies = (cause == int(Cause.LIFTS)) | starts & ((state.height > 0) | (state.V[2] > 0))
    zero = jnp.zeros_like(state.height)
    state = eqx.tree_at(
        lambda x: (x.height, x.begun), state, (jnp.where(starts, state.height, 0.0), slips.Beginning.none(zero))
    )

    def needed(carry: _Progress, stage: Int[Array, ""]) -> Bool[Array, ""]:
        ends = (cause == int(Cause.STOPS)) & ((stage == END) | (stage == MIDDLE) & carry.decides)
        return ends | (stage == IMPACT) & lands | (stage == MODE) & carry.decides

    def advanced(carry: _Progress, stage: Int[Array, ""]) -> _Progress:
        now, where = carry.ahead
        found = plane.response(now, eqx.tree_at(lambda x: x.mode, where, zero + int(Mode.SLIDING)))
        return jax.lax.switch(
            stage,
            (
                lambda carry: _ending(plane, carry, found, tolerance),
                lambda carry: _ended(plane, carry, found),
                lambda carry: _struck(plane, carry, found),
                lambda carry: _decided(plane, carry, found, cause),
            ),
            carry,
        )

    def part(carry: _Progress, stage: Int[Array, ""]) -> tuple[_Progress, None]:
        return jax.lax.cond(needed(carry, stage), advanced, lambda carry, _: carry, carry, stage), None

    decides, no = cause >= int(Cause.START), jnp.asarray(False)
    first = _Progress(t, before, state, (t, state), still, flies, lands, decides, no)
    done = jax.lax.scan(part, first, jnp.arange(END, MODE + 1))[0]
    return done._replace(state=_begun(plane, done))


def _ending(plane: "BodyOnPlane", carry: "_Progress", found: Response, tolerance: Float[Array, ""]) -> "_Progress":
    """Halfway to the end of a slip, if it has one."""
    end = _end(plane, carry, found)
    longest = jnp.maximum(float(jnp.finfo(end.time.dtype).eps) ** LONGEST, COARSER * jnp.cbrt(tolerance))
    soon = end.time <= longest * plane.unit_of_time()
    halfway = _slowed(plane, carry, found, carry.state, end, HALFWAY)
    return carry._replace(ahead=(carry.t + HALFWAY * end.time, halfway), decides=end.comes & soon)


def _ended(plane: "BodyOnPlane", carry: "_Progress", found: Response) -> "_Progress":
    """At the end of a slip, with the response halfway."""
    end, t = _end(plane, carry, found), carry.t
    state = _slowed(plane, carry, found, carry.ahead[1], end, 1.0)
    state = eqx.tree_at(lambda x: x.rubbed, state, state.rubbed + end.rubbed)
    t = t + end.time
    return carry._replace(t=t, before=state, state=state, ahead=(t, state), still=jnp.asarray(True))


def _end(plane: "BodyOnPlane", carry: "_Progress", found: Response) -> slips.End:
    slip = slip_velocity(plane.body, carry.t, carry.state.released)
    return slips.end(found, plane.coefficient(slip, HALFWAY), slip)


def _slowed(
    plane: "BodyOnPlane", carry: "_Progress", found: Response, where: ContactState, end: slips.End, share: float
) -> ContactState:
    """The state after a share of the time in which a slip ends, with the rates ``where`` the response was found."""
    time, slip = share * end.time, slip_velocity(plane.body, carry.t, carry.state.released)
    braking = jnp.where(end.time > 0, slip / jnp.where(end.time > 0, end.time, 1.0), 0.0).at[2].set(0.0)
    moved = rates(plane.body, where.released, found, -braking, end.normal)
    return carry.state.moved(jax.tree.map(lambda x, rate: x + time * rate, carry.state.released, moved))


def _struck(plane: "BodyOnPlane", carry: "_Progress", found: Response) -> "_Progress":
    """After an impact. A rebound that is too slow is treated as none."""
    t, state, contact = carry.t, carry.state, plane.contact
    slip = slip_velocity(plane.body, t, state.released)
    coming = -slip[2]
    unit = root(jnp.abs(plane.body.gravity) * plane.body.radius)
    rebounds = contact.restitution * coming > contact.slowest * unit
    e = jnp.where(rebounds, contact.restitution, 0.0)
    done = impact(plane.body, t, state.released, found, plane.coefficient(slip), e)
    V = done.state.V.at[2].set(jnp.where(rebounds, done.state.V[2], 0.0))
    after = state.moved(ReleasedState(done.state.body, V, state.height))
    after = eqx.tree_at(lambda x: x.struck, after, state.struck - done.work)
    return carry._replace(
        state=after,
        ahead=(t, after),
        still=carry.still | done.collision.sticks,
        flies=carry.flies | (after.V[2] > 0),
    )


def _decided(plane: "BodyOnPlane", carry: "_Progress", found: Response, cause: Int[Array, ""]) -> "_Progress":
    """In the mode that follows, by the forces that each mode would need."""
    t, state, body, contact = carry.t, carry.state, plane.body, plane.contact
    given, flies = state.released, carry.flies
    slip = slip_velocity(body, t, given)
    still = carry.still | plane.is_still(slip, state)
    R = friction.rolling(found).R
    holds = (friction.margin(R, contact.static) >= 0) & (R[2] > 0) & (contact.static > 0)
    rolls = still & holds & (cause != int(Cause.GIVES_WAY))
    sigma = jax.lax.cond(
        still & ~rolls & ~flies,
        lambda: friction.first_slip(found, plane.coefficient(slip, 0.0)).sigma,
        lambda: friction.slip_direction(slip, jnp.zeros_like(slip[:2])),
    )
    mu = plane.coefficient(jnp.where(still, 0.0, slip))
    flies |= ~rolls & ~(friction.sliding(found, mu, sigma).normal > 0)
    mode = jnp.where(flies, int(Mode.FLIGHT), jnp.where(rolls, int(Mode.ROLLING), int(Mode.SLIDING)))
    # The rest of a slip that ends is dissipated by friction.
    stopped = with_slip(body, given, found, slip, jnp.zeros_like(slip))
    state = _where(still & ~flies, state.moved(stopped), state)
    V = state.V.at[2].set(jnp.where(flies & (cause != int(Cause.LIFTS)), state.V[2], 0.0))
    begins = (mode == int(Mode.SLIDING)) & still
    begun = slips.Beginning.along(t, sigma)
    after = eqx.tree_at(lambda x: (x.V, x.mode, x.begun), state, (V, mode.astype(V.dtype), begun))
    return carry._replace(state=after, begins=begins)


def _begun(plane: "BodyOnPlane", done: "_Progress") -> ContactState:
    """With the direction of a slip that begins, for as long as it is computed in advance."""
    t, state = done.t, done.state
    begins = done.begins & (plane.coefficient(state.V, 0.0) > 0)
    kinks = jax.lax.stop_gradient(plane.driving_kinks())
    kink = jnp.min(jnp.where(kinks > t, kinks, jnp.inf), initial=jnp.inf)
    longest = jax.lax.stop_gradient(jnp.minimum(LONGEST_WINDOW * plane.unit_of_time(), BEFORE_KINK * (kink - t)))
    sigma = state.begun.sigma
    if plane.body.planar:
        begun = slips.Beginning.along(t + longest, sigma)
    else:
        begun = jax.lax.cond(
            begins,
            lambda: slips.beginning(plane.body, plane.coefficient, t, state.released, sigma, longest),
            lambda: slips.Beginning.along(t + longest, sigma),
        )
    return eqx.tree_at(lambda x: x.begun, state, _where(begins, begun, slips.Beginning.none(t)))


class _Progress(NamedTuple):
    """A transition in progress: time, the state at the mode's end, the current one, and where to find the response.

    ``still`` says that it does not slip, ``flies`` that it leaves the plane, ``lands`` that it comes down, ``decides``
    that the mode has ended, and ``begins`` that a slip begins.
    """

    t: Float[Array, ""]
    before: ContactState
    state: ContactState
    ahead: tuple[Float[Array, ""], ContactState]
    still: Bool[Array, ""]
    flies: Bool[Array, ""]
    lands: Bool[Array, ""]
    decides: Bool[Array, ""]
    begins: Bool[Array, ""]


def _where(condition: Bool[Array, ""], first: Any, second: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)
