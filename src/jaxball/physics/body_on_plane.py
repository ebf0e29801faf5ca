"""A body on a plane that rolls, slides or flies, as one hybrid system with a mode for each.

Within a mode, the motion follows a smooth field, and guard functions are positive. Where one of them falls to zero, the
mode ends, and the next one is decided there:

- rolling ends where it would need more friction than μ_s N, or where the normal force falls to zero;
- sliding ends where the slip velocity vanishes, or where the normal force falls to zero;
- flight ends where the body lands, with an impact.

On the plane, a body that does not slip rolls if friction can hold it, and otherwise begins to slip as
``friction.first_slip`` determines.
"""

from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..numerics.norms import root
from . import friction, slip as slips
from .body import AbstractBody
from .conditions import Condition, Problem
from .contact_law import Contact
from .impact import impact
from .modes import Cause, ContactState, Mode
from .released import PlacedState, ReleasedState, Response, rates, released, response, slip_velocity, with_slip
from .system import AbstractSystem

ROUNDING = 8  # of velocities, and of accelerations, in units of rounding: what is smaller is none
SLOW = 0.4  # power of rounding: of the speed of a body, the slip that is followed to its end in no step of a solve
ERRORS = 30  # of velocities, in tolerances: a slip that ends may be faster by so much
UNTOLD = 10  # the same: of a slip as slow as that, steps cannot tell the direction
RISEN = 1e-6  # of √(r/g): the time in which a body that lifts has left the plane
WINDOW = 0.1  # of √(r/g): the longest time for which the direction of a slip that begins is known beforehand
BEFORE_KINK = 0.999  # of the time until the next kink: the same
SLOW_DISK = 0.55  # the same for a disk, whose slip does not turn; more than the error of the time at which a mode ends
LONGEST = 0.25  # power of rounding: the longest time, in √(r/g), over which a slip is followed to its end in this way
COARSER = 0.3  # the same over the cube root of the tolerance, because the error of the response halfway grows like this
HALFWAY = 0.5  # through the time, and the speed, of a slip that ends
END, MIDDLE, IMPACT, MODE = range(4)  # what follows a mode, in this order


class Heading(NamedTuple):
    """Along σ, the ``speed`` of a slip as a step begins, and the ``least`` one with which it is not about to end."""

    sigma: Float[Array, "2"]
    speed: Float[Array, ""]
    least: Float[Array, ""]

    def as_numbers(self) -> Float[Array, "4"]:
        """The numbers of a heading, in one array."""
        return jnp.concatenate([self.sigma, self.speed[None], self.least[None]])

    @classmethod
    def of_numbers(cls, numbers: Float[Array, "4 *lanes"]) -> "Heading":
        """The inverse of ``as_numbers``."""
        return cls(numbers[:2], numbers[2], numbers[3])


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
        """All kinks: sliding friction is proportional to N, which jumps with prescribed accelerations."""
        return jnp.concatenate([self.body.driving_kinks(), self.body.motion_kinks()])

    def confined(self, times: Float[Array, " T"], state: ContactState) -> Bool[Array, ""]:
        return self.body.confined(times, state.body)

    def time_of_leaving(self, times: Float[Array, " T"], states: ContactState) -> Float[Array, ""] | None:
        return self.body.time_of_leaving(times, states.body)

    def breaches(self, times: Any, state: ContactState | None, states: ContactState | None) -> Iterator[Problem]:
        bodies = (None if given is None else given.body for given in (state, states))
        yield from self.body.breaches(times, *bodies)

    # What a solve advances. A body is evaluated with a versor of length 1, because near the end of a slip small errors
    # turn it far.

    def to_packed(self, t: Float[Array, ""], state: ContactState) -> ContactState:
        slip = slip_velocity(self.body, t, state.released)
        slip = slip.at[:2].set(jnp.where(self._is_still(slip, state), 0.0, slip[:2]))
        slip = jnp.where(state.is_in(Mode.ROLLING), 0.0, slip)
        return eqx.tree_at(lambda x: x.V, state, jnp.where(state.is_in(Mode.FLIGHT), state.V, slip))

    def from_packed(self, t: Float[Array, ""], packed: ContactState) -> ContactState:
        V = packed.V + released(self.body, t, packed.body).V
        return eqx.tree_at(lambda x: x.V, packed, jnp.where(packed.is_in(Mode.FLIGHT), packed.V, V))

    def packed_field(self, t: Float[Array, ""], packed: ContactState) -> ContactState:
        state = self.from_packed(t, packed.projected())
        found, rolls = self.response(t, state), state.is_in(Mode.ROLLING)
        body, moved = state.body, self.field(t, state, found)
        speeds = jnp.concatenate([body.Omega, body.thetadot])
        gains = jnp.concatenate([moved.body.Omega, moved.body.thetadot])
        g, r = self.body.gravity, self.body.radius
        least = ROUNDING * float(jnp.finfo(g.dtype).eps) * jnp.minimum(g, g / r)
        rests = rolls & jnp.all(speeds == 0) & jnp.all(jnp.abs(gains) <= least)
        # Rounding must not set in motion a body that friction holds; its derivatives are unchanged.
        moved = jax.tree.map(lambda x: x - jnp.where(rests, jax.lax.stop_gradient(x), 0.0), moved)
        # The rate of the slip velocity, without the rounding of a difference.
        acting = self.interaction(t, state, found)
        slipping = jnp.where(rolls, 0.0, acting.slip_acceleration)
        V = jnp.where(packed.is_in(Mode.FLIGHT), moved.V, slipping)
        return eqx.tree_at(lambda x: x.V, moved, V)

    def field(self, t: Float[Array, ""], state: ContactState, found: Response | None = None) -> ContactState:
        """ẋ; ``found`` is the response, if it is known."""
        found = self.response(t, state) if found is None else found
        acting = self.interaction(t, state, found)
        slip = jnp.where(state.is_in(Mode.ROLLING), 0.0, slip_velocity(self.body, t, state.released))
        moved = rates(self.body, state.released, found, acting.slip_acceleration, acting.normal)
        rates_of_all = jax.tree.map(jnp.zeros_like, state).moved(moved)
        return eqx.tree_at(lambda x: x.rubbed, rates_of_all, -jnp.sum(acting.R[:2] * slip[:2]))

    # The plane.

    def response(self, t: Float[Array, ""], state: ContactState) -> Response:
        """How the body moves under each reaction."""
        return response(self.body, t, state.released, touching=~state.is_in(Mode.FLIGHT))

    def coefficient(self, slip: Float[Array, "3"], share: float = 1.0) -> Float[Array, ""]:
        """The kinetic friction coefficient at a share of the speed of a slip."""
        return self.contact.coefficient(share * root(jnp.sum(slip[:2] ** 2)))

    def interaction(self, t: Float[Array, ""], state: ContactState, found: Response) -> friction.Interaction:
        """The reaction of the plane in the mode that the state is in."""
        slip = slip_velocity(self.body, t, state.released)
        sliding = friction.sliding(found, self.coefficient(slip), state.direction(t, slip))
        rolling, flying = friction.rolling(found), friction.flight(found)

        def choose(*each: Array) -> Array:
            return jnp.where(state.is_in(Mode.ROLLING), each[0], jnp.where(state.is_in(Mode.SLIDING), *each[1:]))

        return jax.tree.map(choose, rolling, sliding, flying)

    def heading(
        self, t: Float[Array, ""], state: ContactState, rtol: Float[Array, ""], atol: Float[Array, ""]
    ) -> Heading:
        """The heading of a slip as a step begins, in a solve with these tolerances."""
        slip = slip_velocity(self.body, t, state.released)
        sigma = state.direction(t, slip)
        speed = jnp.maximum(jnp.sum(slip[:2] * sigma), 0.0)
        power = SLOW_DISK if self.body.planar else SLOW
        rest = self._speed(state.released)
        least = jnp.maximum(float(jnp.finfo(speed.dtype).eps) ** power * rest, UNTOLD * (atol + rtol * rest))
        return Heading(sigma, speed, jnp.minimum(least, 0.5 * speed))

    def guards(
        self, t: Float[Array, ""], state: ContactState, heading: Heading, found: Response | None = None
    ) -> Float[Array, "3"]:
        """The three guard functions, positive while the mode lasts; ``CAUSES`` gives the meaning of each.

        ``heading`` is that of the step, and ``found`` the response, if it is known.
        """
        found = self.response(t, state) if found is None else found
        acting = self.interaction(t, state, found)
        slip, one = slip_velocity(self.body, t, state.released), jnp.ones_like(state.height)
        spare = friction.margin(acting.R, self.contact.static)
        # On a smooth plane, the end of a slip is the beginning of another.
        forward = jnp.where(self.coefficient(slip) > 0, jnp.sum(slip[:2] * heading.sigma) - heading.least, one)
        # A body that rises does not land, where rounding takes its height below zero as it lifts.
        above = jnp.maximum(state.height, jnp.where(slip[2] > 0, RISEN * self._unit_of_time() * slip[2], -jnp.inf))
        rolls, slides = state.is_in(Mode.ROLLING), state.is_in(Mode.SLIDING)
        return jnp.stack(
            [
                jnp.where(rolls, spare, jnp.where(slides, forward, above)),
                jnp.where(rolls | slides, acting.R[2], one),
                jnp.where(slides, acting.solvability, one),
            ]
        )

    def is_slow(
        self,
        t: Float[Array, ""],
        state: ContactState,
        heading: Heading,
        rtol: Float[Array, ""],
        atol: Float[Array, ""],
    ) -> Bool[Array, ""]:
        """Whether a slip that does not continue along its heading is so slow that it may be at its end."""
        slip = slip_velocity(self.body, t, state.released)
        errors = ERRORS * (atol + rtol * self._speed(state.released))
        return root(jnp.sum(slip[:2] ** 2)) <= 2 * heading.least + errors

    def _is_still(self, slip: Float[Array, "3"], state: ContactState | ReleasedState) -> Bool[Array, ""]:
        """Whether the slip velocity is zero up to rounding."""
        least = ROUNDING * float(jnp.finfo(slip.dtype).eps) * self._speed(state)
        return root(jnp.sum(slip[:2] ** 2)) <= least

    def _unit_of_time(self) -> Float[Array, ""]:
        """√(r/g); √r without gravity."""
        g = jnp.abs(self.body.gravity)
        return root(self.body.radius / jnp.where(g > 0, g, 1.0))

    def _speed(self, state: ReleasedState | ContactState) -> Float[Array, ""]:
        """A reference speed for errors of velocities."""
        return root(jnp.sum(state.V**2)) + self.body.radius * root(jnp.sum(state.body.Omega**2))

    # How modes begin.

    def start(self, t: Float[Array, ""], state: ReleasedState | PlacedState) -> ContactState:
        """The state with which a solve starts; its mode is decided by ``followed``.

        A rolling state is one without slip. A body that does not slip counts as rolling.
        """
        rolls = not isinstance(state, ReleasedState)
        given = released(self.body, t, state) if rolls else state
        zero = jnp.zeros_like(given.height)
        mode = zero + int(Mode.ROLLING if rolls else Mode.FLIGHT)
        return ContactState(given.body, given.V, given.height, zero, zero, mode, slips.Beginning.none(zero))

    def followed(
        self,
        t: Float[Array, ""],
        state: ContactState,
        cause: Int[Array, ""],
        kinks: Float[Array, " kinks"],
        tolerance: Float[Array, ""],
    ) -> "Followed":
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

        def needed(carry: _Following, stage: Int[Array, ""]) -> Bool[Array, ""]:
            ends = (cause == int(Cause.STOPS)) & ((stage == END) | (stage == MIDDLE) & carry.decides)
            return ends | (stage == IMPACT) & lands | (stage == MODE) & carry.decides

        def advanced(carry: _Following, stage: Int[Array, ""]) -> _Following:
            now, where = carry.ahead
            found = self.response(now, eqx.tree_at(lambda x: x.mode, where, zero + int(Mode.SLIDING)))
            return jax.lax.switch(
                stage,
                (
                    lambda carry: self._ending(carry, found, tolerance),
                    lambda carry: self._ended(carry, found),
                    lambda carry: self._struck(carry, found),
                    lambda carry: self._decided(carry, found, cause),
                ),
                carry,
            )

        def part(carry: _Following, stage: Int[Array, ""]) -> tuple[_Following, None]:
            return jax.lax.cond(needed(carry, stage), advanced, lambda carry, _: carry, carry, stage), None

        first = _Following(t, before, state, (t, state), still, flies, cause >= int(Cause.START), jnp.asarray(False))
        done = jax.lax.scan(part, first, jnp.arange(END, MODE + 1))[0]
        state = self._begun(done, kinks)
        return Followed(done.t, done.before, state, done.decides, lands)

    def _ending(self, carry: "_Following", found: Response, tolerance: Float[Array, ""]) -> "_Following":
        """Halfway to the end of a slip, if it has one."""
        end = self._end(carry, found)
        longest = jnp.maximum(float(jnp.finfo(end.time.dtype).eps) ** LONGEST, COARSER * jnp.cbrt(tolerance))
        soon = end.time <= longest * self._unit_of_time()
        halfway = self._slowed(carry, found, carry.state, end, HALFWAY)
        return carry._replace(ahead=(carry.t + HALFWAY * end.time, halfway), decides=end.comes & soon)

    def _ended(self, carry: "_Following", found: Response) -> "_Following":
        """At the end of a slip, with the response halfway."""
        end, t = self._end(carry, found), carry.t
        state = self._slowed(carry, found, carry.ahead[1], end, 1.0)
        state = eqx.tree_at(lambda x: x.rubbed, state, state.rubbed + end.rubbed)
        t = t + end.time
        return carry._replace(t=t, before=state, state=state, ahead=(t, state), still=jnp.asarray(True))

    def _end(self, carry: "_Following", found: Response) -> slips.End:
        slip = slip_velocity(self.body, carry.t, carry.state.released)
        return slips.end(found, self.coefficient(slip, HALFWAY), slip)

    def _slowed(
        self, carry: "_Following", found: Response, where: ContactState, end: slips.End, share: float
    ) -> ContactState:
        """The state after a share of the time in which a slip ends, with the rates ``where`` the response was found."""
        time, slip = share * end.time, slip_velocity(self.body, carry.t, carry.state.released)
        braking = jnp.where(end.time > 0, slip / jnp.where(end.time > 0, end.time, 1.0), 0.0).at[2].set(0.0)
        moved = rates(self.body, where.released, found, -braking, end.normal)
        return carry.state.moved(jax.tree.map(lambda x, rate: x + time * rate, carry.state.released, moved))

    def _struck(self, carry: "_Following", found: Response) -> "_Following":
        """After an impact. A rebound that is too slow is treated as none."""
        t, state, contact = carry.t, carry.state, self.contact
        slip = slip_velocity(self.body, t, state.released)
        coming = -slip[2]
        unit = root(jnp.abs(self.body.gravity) * self.body.radius)
        rebounds = contact.restitution * coming > contact.slowest * unit
        e = jnp.where(rebounds, contact.restitution, 0.0)
        done = impact(self.body, t, state.released, found, self.coefficient(slip), e)
        V = done.state.V.at[2].set(jnp.where(rebounds, done.state.V[2], 0.0))
        after = state.moved(ReleasedState(done.state.body, V, state.height))
        after = eqx.tree_at(lambda x: x.struck, after, state.struck - done.work)
        return carry._replace(
            state=after,
            ahead=(t, after),
            still=carry.still | done.collision.sticks,
            flies=carry.flies | (after.V[2] > 0),
        )

    def _decided(self, carry: "_Following", found: Response, cause: Int[Array, ""]) -> "_Following":
        """In the mode that follows, by the forces that each mode would need."""
        t, state, body, contact = carry.t, carry.state, self.body, self.contact
        given, flies = state.released, carry.flies
        slip = slip_velocity(body, t, given)
        still = carry.still | self._is_still(slip, state)
        R = friction.rolling(found).R
        holds = (friction.margin(R, contact.static) >= 0) & (R[2] > 0) & (contact.static > 0)
        rolls = still & holds & (cause != int(Cause.GIVES_WAY))
        sigma = jax.lax.cond(
            still & ~rolls & ~flies,
            lambda: friction.first_slip(found, self.coefficient(slip, 0.0)).sigma,
            lambda: friction.slip_direction(slip, jnp.zeros_like(slip[:2])),
        )
        mu = self.coefficient(jnp.where(still, 0.0, slip))
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

    def _begun(self, done: "_Following", kinks: Float[Array, " kinks"]) -> ContactState:
        """With the direction of a slip that begins, for as long as it is computed in advance."""
        t, state = done.t, done.state
        begins = done.begins & (self.coefficient(state.V, 0.0) > 0)
        kink = jnp.min(jnp.where(kinks > t, kinks, jnp.inf), initial=jnp.inf)
        longest = jax.lax.stop_gradient(jnp.minimum(WINDOW * self._unit_of_time(), BEFORE_KINK * (kink - t)))
        sigma = state.begun.sigma
        if self.body.planar:
            begun = slips.Beginning.along(t + longest, sigma)
        else:
            begun = jax.lax.cond(
                begins,
                lambda: slips.beginning(self.body, self.coefficient, t, state.released, sigma, longest),
                lambda: slips.Beginning.along(t + longest, sigma),
            )
        return eqx.tree_at(lambda x: x.begun, state, _where(begins, begun, slips.Beginning.none(t)))


class Followed(NamedTuple):
    """The transition after a mode: the time, the states before and after, whether it has ended and the body landed."""

    t: Float[Array, ""]
    before: ContactState
    state: ContactState
    ends: Bool[Array, ""]
    lands: Bool[Array, ""]


class _Following(NamedTuple):
    """A transition in progress: time, the state at the mode's end, the current one, and where to find the response.

    ``still`` says that it does not slip, ``flies`` that it leaves the plane, ``decides`` that the mode has ended, and
    ``begins`` that a slip begins.
    """

    t: Float[Array, ""]
    before: ContactState
    state: ContactState
    ahead: tuple[Float[Array, ""], ContactState]
    still: Bool[Array, ""]
    flies: Bool[Array, ""]
    decides: Bool[Array, ""]
    begins: Bool[Array, ""]


def _where(condition: Bool[Array, ""], first: Any, second: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)


def body_of(system: Any, state: Any) -> tuple[Any, Any]:
    """A system and its state; for a body on its plane, those of the body."""
    return (system.body, state.body) if isinstance(system, BodyOnPlane) else (system, state)
