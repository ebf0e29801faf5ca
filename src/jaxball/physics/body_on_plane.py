"""A body on a plane that rolls, slides or flies, as one system whose modes follow each other.

While a mode lasts, its motion is that of a smooth field, and functions that are positive say that it may last. Where
one of them falls to zero it ends, and what follows is decided there:

- rolling ends where it would need more friction than μ_s N, or where the plane would have to pull;
- sliding ends where the slip velocity vanishes, or where the plane would have to pull;
- flight ends where the body comes down, with an impact.

On the plane, what does not slip rolls if friction can hold it, and else begins to slip as ``friction.first_slip`` says.
"""

from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..numerics.norms import root
from . import friction
from .body import AbstractBody
from .conditions import Condition, Problem
from .contact_law import Contact
from .impact import impact
from .modes import Cause, ContactState, Guide, Mode
from .released import PlacedState, ReleasedState, Response, rates, released, response, slip_velocity, with_slip
from .system import AbstractSystem

SLOW = 1000  # times the tolerances: a slip that ends and is slower may be led by the forces; of errors of many steps
STILL = 30  # times the tolerances: a slip that ends and is slower keeps its direction, and is over in no time
LED_SLIP = 2 / friction.LED**2  # times the tolerances: a slip that has begun and is slower may be led further
ROUNDING = 8  # of velocities, and of accelerations, in units of rounding: what is smaller is none
IMPACT, MODE, TURN = range(3)  # what follows a mode, in this order
# In the place of a cause, where no mode has ended: the forces lead the direction of a slip further, or no longer.
LED_ON, LET_GO = -2, -3
NEWTON_STEPS = 3  # to the direction of a slip that is led, from that with which it began


class BodyOnPlane(AbstractSystem[ContactState]):
    """A ball or a disk with a law of contact."""

    body: AbstractBody
    contact: Contact

    title: ClassVar[str] = "body on a plane"
    state_type: ClassVar[Any] = ContactState

    # Conditions, kinks and confinement are those of the body, with those of the law.

    def conditions(self) -> Iterator[Condition]:
        yield from self.body.conditions()
        yield from self.contact.conditions()

    def start_conditions(self, t: Float[Array, ""], state: ContactState) -> Iterator[Condition]:
        yield from self.body.start_conditions(t, state.body)
        if self.body.planar:
            holds = state.V[1] == 0
            yield Condition(holds, "state.V", state.V, "in the plane of the disk, with 0 for its second entry")

    def numbers(self) -> Iterator[tuple[str, Array]]:
        yield from self.body.numbers()

    def prepare(self) -> "BodyOnPlane":
        return BodyOnPlane(self.body.prepare(), self.contact)

    def driving_kinks(self) -> Float[Array, " kinks"]:
        """All kinks: friction of sliding is proportional to N, which jumps with prescribed accelerations."""
        return jnp.concatenate([self.body.driving_kinks(), self.body.motion_kinks()])

    def confined(self, times: Float[Array, " T"], state: ContactState) -> Bool[Array, ""]:
        return self.body.confined(times, state.body)

    def time_of_leaving(self, times: Float[Array, " T"], states: ContactState) -> Float[Array, ""] | None:
        return self.body.time_of_leaving(times, states.body)

    def breaches(self, times: Any, state: ContactState | None, states: ContactState | None) -> Iterator[Problem]:
        bodies = (None if given is None else given.body for given in (state, states))
        yield from self.body.breaches(times, *bodies)

    # What a solve advances. A body is looked at with a versor of length 1, because near the end of a slip small errors
    # turn it far.

    def from_packed(self, t: Float[Array, ""], packed: ContactState) -> ContactState:
        V = jnp.where(packed.is_in(Mode.ROLLING), released(self.body, t, packed.body).V, packed.V)
        return eqx.tree_at(lambda x: x.V, packed, V)

    def packed_field(self, t: Float[Array, ""], packed: ContactState) -> ContactState:
        state = self.from_packed(t, packed.projected())
        body, moved, rolls = state.body, self.field(t, state), state.is_in(Mode.ROLLING)
        speeds = jnp.concatenate([body.Omega, body.thetadot])
        gains = jnp.concatenate([moved.body.Omega, moved.body.thetadot])
        g, r = self.body.gravity, self.body.radius
        least = ROUNDING * float(jnp.finfo(g.dtype).eps) * jnp.minimum(g, g / r)
        rests = rolls & jnp.all(speeds == 0) & jnp.all(jnp.abs(gains) <= least)
        # Rounding must not set a body in motion that friction holds; its derivatives stay as they are.
        moved = jax.tree.map(lambda x: x - jnp.where(rests, jax.lax.stop_gradient(x), 0.0), moved)
        return eqx.tree_at(lambda x: x.V, moved, jnp.where(rolls, 0.0, moved.V))

    def field(self, t: Float[Array, ""], state: ContactState, found: Response | None = None) -> ContactState:
        """ẋ; ``found`` is the response, if it is known."""
        found = self.response(t, state) if found is None else found
        acting = self.interaction(t, state, found)
        slip = jnp.where(state.is_in(Mode.ROLLING), 0.0, slip_velocity(self.body, t, state.released))
        moved = rates(self.body, state.released, found, acting.slip_acceleration, acting.normal)
        rates_of_all = jax.tree.map(jnp.zeros_like, state).moved(moved)
        turning = 0.0 if self.body.planar else self._turning(t, state, slip, acting.slip_acceleration)
        rubbing = -jnp.sum(acting.R[:2] * slip[:2])
        sigmadot = turning * friction.left(state.sigma)
        bending = jnp.where(state.led, state.bending, 0.0)
        return eqx.tree_at(lambda x: (x.rubbed, x.sigma, x.turning), rates_of_all, (rubbing, sigmadot, bending))

    # The plane.

    def response(self, t: Float[Array, ""], state: ContactState) -> Response:
        """How the body moves under each reaction."""
        return response(self.body, t, state.released, touching=~state.is_in(Mode.FLIGHT))

    def interaction(self, t: Float[Array, ""], state: ContactState, found: Response) -> friction.Interaction:
        """The reaction of the plane in the mode that the state is in."""
        sigma = self._direction(t, state, found)
        sliding = friction.sliding(found, self.contact.sliding, sigma)
        rolling, flying = friction.rolling(found), friction.flight(found)

        def choose(*each: Array) -> Array:
            return jnp.where(state.is_in(Mode.ROLLING), each[0], jnp.where(state.is_in(Mode.SLIDING), *each[1:]))

        return jax.tree.map(choose, rolling, sliding, flying)

    def _direction(self, t: Float[Array, ""], state: ContactState, found: Response) -> Float[Array, "2"]:
        """σ of the friction: that of the state, or where the forces lead it, theirs."""
        sigma = friction.unit(state.sigma)
        if self.body.planar:
            return sigma
        speed = jnp.sum(slip_velocity(self.body, t, state.released)[:2] * sigma)
        led = friction.led_direction(found, self.contact.sliding, sigma, speed * state.turning, NEWTON_STEPS)
        return jnp.where(state.led, led, sigma)

    def _turning(
        self, t: Float[Array, ""], state: ContactState, slip: Float[Array, "3"], gain: Float[Array, "3"]
    ) -> Float[Array, ""]:
        """The rate at which σ turns: the slip acceleration across it over the speed."""
        sigma = friction.unit(state.sigma)
        speed = jnp.sum(slip[:2] * sigma)
        eps = float(jnp.finfo(t.dtype).eps)
        moves = ~self.is_still(t, state.released, ROUNDING * eps, 0.0) & ~state.led
        rate = jnp.where(moves, friction.across(sigma, gain) / jnp.where(moves, speed, 1.0), state.turning)
        turns = state.is_in(Mode.SLIDING) & (state.guide != int(Guide.NONE)) & (self.contact.sliding > 0)
        return jnp.where(turns, rate, 0.0)

    def lasting(self, t: Float[Array, ""], state: ContactState, found: Response | None = None) -> Float[Array, "3"]:
        """Three functions that are positive while the mode lasts; ``CAUSES`` says for what each of them stands.

        ``found`` is the response, if it is known.
        """
        found = self.response(t, state) if found is None else found
        acting = self.interaction(t, state, found)
        slip, one = slip_velocity(self.body, t, state.released), jnp.ones_like(state.height)
        spare = friction.margin(acting.R, self.contact.static)
        # On a smooth plane, a slip that ends is the beginning of another.
        forward = jnp.where(self.contact.sliding > 0, jnp.sum(slip[:2] * state.sigma), one)
        rolls, slides = state.is_in(Mode.ROLLING), state.is_in(Mode.SLIDING)
        return jnp.stack(
            [
                jnp.where(rolls, spare, jnp.where(slides, forward, state.height)),
                jnp.where(rolls | slides, acting.R[2], one),
                jnp.where(slides, acting.solvability, one),
            ]
        )

    def guide(
        self, t: Float[Array, ""], state: ContactState, found: Response, rtol: Float[Array, ""], atol: Float[Array, ""]
    ) -> Float[Array, ""]:
        """What turns the direction of a slip that is about to end: a :class:`Guide`, as a number.

        Where it is slow, its direction turns ever faster, and what it does is of no consequence to the tolerances.
        """
        if self.body.planar:
            return jnp.zeros_like(t)
        slides, released = state.is_in(Mode.SLIDING), state.released
        soon = friction.LED * self._unit_of_time()
        slip, sigma = slip_velocity(self.body, t, released), friction.unit(state.sigma)
        end = friction.end_of_slip(found, self.contact.sliding, slip, sigma, soon)
        # The forces take over where the slip is so slow that the velocities do not feel it.
        most = 1 / jnp.maximum(jnp.abs(end.angle), 1 / SLOW)
        led = slides & end.led & self.is_still(t, released, most * rtol, most * atol)
        steady = slides & end.comes & self.is_still(t, released, STILL * rtol, STILL * atol)
        guide = jnp.where(led, int(Guide.FORCES), jnp.where(steady, int(Guide.NONE), int(Guide.SLIP)))
        return guide.astype(t.dtype)

    def stepped(self, t: Float[Array, ""], state: ContactState, guide: Float[Array, ""]) -> ContactState:
        """The state after a step in which its mode lasted; ``guide`` is what turns a slip's direction from now on."""
        slip, begins = slip_velocity(self.body, t, state.released), state.led & (t < state.until)
        ends = ~begins & (guide == int(Guide.FORCES))
        # A slip that came near its end and did not end has turned round.
        turned = state.is_in(Mode.SLIDING) & ~begins & (jnp.sum(slip[:2] * state.sigma) <= 0)
        return eqx.tree_at(
            lambda x: (x.sigma, x.guide, x.until, x.turning, x.bending),
            state,
            (
                jnp.where(turned, friction.slip_direction(slip, state.sigma), friction.unit(state.sigma)),
                jnp.where(begins, state.guide, guide),
                jnp.where(begins, state.until, _never(t)),
                *(jnp.where(ends, 0.0, rate) for rate in (state.turning, state.bending)),
            ),
        )

    def led_to_here(self, t: Float[Array, ""], state: ContactState) -> Bool[Array, ""]:
        """Whether the forces lead the direction of a slip that has begun, and were to do so until now."""
        return state.is_in(Mode.SLIDING) & state.led & (t == state.until)

    def is_led_on(
        self, t: Float[Array, ""], state: ContactState, rtol: Float[Array, ""], atol: Float[Array, ""]
    ) -> Bool[Array, ""]:
        """Whether they still lead it, because it is so slow that its velocity does not feel what this neglects."""
        return self.is_still(t, state.released, LED_SLIP * rtol, LED_SLIP * atol)

    def direction_weight(self, t: Float[Array, ""], state: ContactState) -> Float[Array, ""]:
        """The weight of an error of σ beside those of velocities, which it comes into with the speed of the slip."""
        slip = jnp.abs(jnp.sum(slip_velocity(self.body, t, state.released)[:2] * state.sigma))
        speed = self._speed(state.released)
        slides = state.is_in(Mode.SLIDING) & (slip < speed)
        return jnp.where(slides, slip / jnp.where(slides, speed, 1.0), 1.0)

    def has_stopped(
        self, t: Float[Array, ""], state: ContactState, rtol: Float[Array, ""], atol: Float[Array, ""]
    ) -> Bool[Array, ""]:
        """Whether a slip with no speed along σ is over: what is left across σ is an error of many steps."""
        return self.is_still(t, state.released, SLOW * rtol, SLOW * atol)

    def is_still(
        self, t: Float[Array, ""], state: ReleasedState, rtol: Float[Array, ""] | float, atol: Float[Array, ""] | float
    ) -> Bool[Array, ""]:
        """Whether the slip velocity is zero to these tolerances."""
        slip = slip_velocity(self.body, t, state)
        return root(jnp.sum(slip[:2] ** 2)) <= atol + rtol * self._speed(state)

    def _unit_of_time(self) -> Float[Array, ""]:
        """√(r/g); √r without gravity."""
        g = jnp.abs(self.body.gravity)
        return root(self.body.radius / jnp.where(g > 0, g, 1.0))

    def _speed(self, state: ReleasedState) -> Float[Array, ""]:
        """A speed beside which errors of velocities are seen."""
        return root(jnp.sum(state.V**2)) + self.body.radius * root(jnp.sum(state.body.Omega**2))

    # How modes begin.

    def start(self, t: Float[Array, ""], state: ReleasedState | PlacedState) -> ContactState:
        """The state with which a solve starts, whose mode is still to be decided, by ``followed``.

        A state of rolling is one without slip. What does not slip is held to be rolling.
        """
        rolls = not isinstance(state, ReleasedState)
        given = released(self.body, t, state) if rolls else state
        zero, still = jnp.zeros_like(given.height), jnp.zeros_like(given.V[:2])
        mode = zero + int(Mode.ROLLING if rolls else Mode.FLIGHT)
        return ContactState(given.body, given.V, given.height, zero, zero, mode, still, zero, _never(zero), zero, zero)

    def followed(self, t: Float[Array, ""], state: ContactState, cause: Int[Array, ""]) -> ContactState:
        """What follows where a mode ends.

        An impact comes first, if the body comes down, then the mode with the velocities after it, and then how the
        direction of a slip that begins will turn. All need the response of the body, whose formulas are long, and so
        are one loop. With ``LED_ON`` for a cause, only the last is looked at again.
        """
        starts = cause == int(Cause.START)
        lands = (cause == int(Cause.LANDS)) | starts & (state.height <= 0) & (state.V[2] < 0)
        still = (cause == int(Cause.GIVES_WAY)) | (cause == int(Cause.STOPS)) | state.is_in(Mode.ROLLING)
        flies = (cause == int(Cause.LIFTS)) | starts & ((state.height > 0) | (state.V[2] > 0))
        zero = jnp.zeros_like(state.height)
        state = eqx.tree_at(lambda x: (x.height, x.guide), state, (jnp.where(starts, state.height, 0.0), zero))
        moment = friction.MOMENT * self._unit_of_time()
        stages = [IMPACT, MODE] if self.body.planar else [IMPACT, MODE, TURN]

        def needed(carry: _Following, stage: Int[Array, ""]) -> Bool[Array, ""]:
            return jnp.where(stage == IMPACT, lands, (stage == MODE) | carry.state.led)

        def advanced(carry: _Following, stage: Int[Array, ""]) -> _Following:
            now = t + jnp.where(stage == TURN, moment, 0.0)
            found = self.response(now, eqx.tree_at(lambda x: x.mode, carry.ahead, zero + int(Mode.SLIDING)))
            carry = jax.lax.switch(
                jnp.where((stage == MODE) & (cause <= LED_ON), TURN + 1, stage),
                (
                    lambda carry: self._struck(t, carry, found),
                    lambda carry: self._decided(t, carry, found, cause),
                    lambda carry: self._guided(t, carry, found, cause, moment),
                    lambda carry: self._led(t, carry, found, cause),
                ),
                carry,
            )
            state = carry.state
            acting = friction.sliding(found, self.contact.sliding, state.sigma)
            moving = rates(self.body, state.released, found, acting.slip_acceleration, acting.normal)
            moves = (stage == MODE) & state.led
            ahead = jax.tree.map(lambda x, rate: x + jnp.where(moves, moment * rate, 0.0), state.released, moving)
            return carry._replace(ahead=state.moved(ahead), R=acting.R)

        def part(carry: _Following, stage: Int[Array, ""]) -> tuple[_Following, None]:
            return jax.lax.cond(needed(carry, stage), advanced, lambda carry, _: carry, carry, stage), None

        first = _Following(state, state, jnp.zeros_like(state.V), still, flies)
        return jax.lax.scan(part, first, jnp.asarray(stages))[0].state

    def _struck(self, t: Float[Array, ""], carry: "_Following", found: Response) -> "_Following":
        """After an impact. A rebound that is too slow is none."""
        state, contact = carry.state, self.contact
        coming = -slip_velocity(self.body, t, state.released)[2]
        unit = root(jnp.abs(self.body.gravity) * self.body.radius)
        rebounds = contact.restitution * coming > contact.slowest * unit
        e = jnp.where(rebounds, contact.restitution, 0.0)
        done = impact(self.body, t, state.released, found, contact.sliding, e)
        V = done.state.V.at[2].set(jnp.where(rebounds, done.state.V[2], 0.0))
        after = state.moved(ReleasedState(done.state.body, V, state.height))
        after = eqx.tree_at(lambda x: x.struck, after, state.struck - done.work)
        return carry._replace(
            state=after, still=carry.still | done.collision.sticks, flies=carry.flies | (after.V[2] > 0)
        )

    def _decided(
        self, t: Float[Array, ""], carry: "_Following", found: Response, cause: Int[Array, ""]
    ) -> "_Following":
        """In the mode that follows, by the forces that each mode would need; they lead a slip that begins."""
        state, body, contact = carry.state, self.body, self.contact
        given, flies = state.released, carry.flies
        slip = slip_velocity(body, t, given)
        still = carry.still | self.is_still(t, given, ROUNDING * float(jnp.finfo(slip.dtype).eps), 0.0)
        R = friction.rolling(found).R
        holds = (friction.margin(R, contact.static) >= 0) & (R[2] > 0) & (contact.static > 0)
        rolls = still & holds & (cause != int(Cause.GIVES_WAY))
        sigma = jax.lax.cond(
            still & ~rolls & ~flies,
            lambda: friction.first_slip(found, contact.sliding).sigma,
            lambda: friction.slip_direction(slip, state.sigma),
        )
        flies |= ~rolls & ~(friction.sliding(found, contact.sliding, sigma).normal > 0)
        mode = jnp.where(flies, int(Mode.FLIGHT), jnp.where(rolls, int(Mode.ROLLING), int(Mode.SLIDING)))
        # What is left of a slip that ends is taken by the friction that would have taken it.
        stopped = with_slip(body, given, found, slip, jnp.zeros_like(slip))
        state = _where(still & ~flies, state.moved(stopped), state)
        V = state.V.at[2].set(jnp.where(flies & (cause != int(Cause.LIFTS)), state.V[2], 0.0))
        begins = (mode == int(Mode.SLIDING)) & still & (not body.planar)
        guide = jnp.where(begins, float(Guide.FORCES), 0.0).astype(V.dtype)
        after = eqx.tree_at(lambda x: (x.V, x.mode, x.sigma, x.guide), state, (V, mode.astype(V.dtype), sigma, guide))
        return carry._replace(state=after)

    def _led(self, t: Float[Array, ""], carry: "_Following", found: Response, cause: Int[Array, ""]) -> "_Following":
        """In the direction in which it was led; where it is led on, in that in which a slip would begin now."""
        state, on = carry.state, cause == LED_ON
        speed = jnp.sum(slip_velocity(self.body, t, state.released)[:2] * state.sigma)
        across = jnp.where(on, 0.0, speed * state.turning)
        sigma = friction.led_direction(found, self.contact.sliding, state.sigma, across, NEWTON_STEPS)
        guide = jnp.where(on, float(Guide.FORCES), float(Guide.SLIP)).astype(sigma.dtype)
        return carry._replace(state=eqx.tree_at(lambda x: (x.sigma, x.guide), state, (sigma, guide)))

    def _guided(
        self,
        t: Float[Array, ""],
        carry: "_Following",
        later: Response,
        cause: Int[Array, ""],
        moment: Float[Array, ""],
    ) -> "_Following":
        """With what turns the direction of a slip that begins; ``later`` is the response after a moment.

        Where it was led before, for about as long, the rate at which it turns has changed by what one sees.
        """
        state = carry.state
        led = friction.led(later, carry.R, self.contact.sliding, state.sigma, moment)
        guide = jnp.where(led.applies, state.guide, 0.0)
        bending = jnp.where(cause == LED_ON, state.bending + (led.turning - state.turning) / led.time, 0.0)
        after = eqx.tree_at(
            lambda x: (x.guide, x.until, x.turning, x.bending), state, (guide, t + led.time, led.turning, bending)
        )
        return carry._replace(state=after)


class _Following(NamedTuple):
    """On the way from a mode to the next: the state, the same a moment ahead, and the reaction of sliding.

    ``still`` says that it does not slip, ``flies`` that it leaves the plane.
    """

    state: ContactState
    ahead: ContactState
    R: Float[Array, "3"]
    still: Bool[Array, ""]
    flies: Bool[Array, ""]


def _never(like: Float[Array, ""]) -> Float[Array, ""]:
    """A time before all others. It is the same in all steps, because multistep methods remember what they advance."""
    return jnp.full_like(like, -(float(jnp.finfo(like.dtype).max) ** 0.5))


def _where(condition: Bool[Array, ""], first: ContactState, second: ContactState) -> ContactState:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)


def body_of(system: Any, state: Any) -> tuple[Any, Any]:
    """A system and its state; where they are those of a body on its plane, those of the body."""
    return (system.body, state.body) if isinstance(system, BodyOnPlane) else (system, state)
