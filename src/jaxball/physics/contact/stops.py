"""The strike of a joint on its hard stop, with Newton's restitution: one impulse at the joint changes all velocities.

It takes no time. Without a law of contact the body keeps rolling, by whatever impulse of its ground. With one the
contact keeps its mode if it can: in rolling the impulse of the ground must be within the cone of static friction, in
sliding it is I₃ (e3 − μσ) with I₃ ≥ 0, as long as the slip does not reverse. If not, the ground gives no impulse where
the body then rises, and else that of an impact without restitution (``impact``), the joint with its rate after the
strike. There, friction may end in another mode than it begins, and restitution would then create energy: e is smaller,
so that it does not. A rise slower than the law's ``slowest`` is none: otherwise the body would land at once and take
the joint off its stop, only to be lifted again, without end. Friction in joints and dry resistance at the ground are
finite and give no impulse. A joint that rests against another stop is held there as far as that stop pushes it.
"""

import dataclasses
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...numerics.vectors import apply, dot, inverse, root
from ..dynamics.coupling import join_coordinates
from ..dynamics.dry_friction import release
from ..dynamics.equations import equations
from ..dynamics.sticking import Reach, Stops, among_free, of_sticking, put, rubs, sides, sticking_slots
from . import friction
from .guards import Progress, find_struck
from .impact import collision, slowest_rise
from .modes import ContactState, Mode
from .released import combine_rows, slip_velocity, with_rise, with_velocities

if TYPE_CHECKING:
    from .body_on_plane import BodyOnPlane

ROUNDING = 64  # of the rate that a strike may give a joint, and of an impulse, in units of rounding


class _Strike(NamedTuple):
    """A joint that strikes the stop on a ``side`` with a ``speed``, and the restitution ``e``; in the state all that
    gives no impulse is loose.
    """

    side: Float[Array, " sticking"]
    speed: Float[Array, ""]
    e: Float[Array, ""]
    state: ContactState

    @property
    def which(self) -> Bool[Array, " sticking"]:
        """Which joint it is."""
        return self.side != 0

    @property
    def change(self) -> Float[Array, ""]:
        """The change of its rate."""
        return -(1 + self.e) * self.speed * jnp.sum(self.side)


class _Blow(NamedTuple):
    """What a strike does: changes of Ω and θ̇, the energy ``lost``, and the impulses that hold other joints.

    With a law of contact also the slip velocity ``after`` it, and whether nothing slips.
    """

    Omega: Float[Array, "3"]
    thetadot: Float[Array, " coordinates"]
    lost: Float[Array, ""]
    holding: Float[Array, " sticking"]
    after: Float[Array, "3"] | None = None
    still: Bool[Array, ""] | None = None


def strike_stop(plane: "BodyOnPlane", done: Progress, event: Int[Array, ""]) -> Progress:
    """Applies the strike of a joint on its stop."""
    t, body, stops, slots = done.t, plane.body, Stops.of(plane.body), sticking_slots(plane.body)
    side = jax.lax.stop_gradient(find_struck(plane, done.state, event))
    which = side != 0
    theta = put(body, done.state.body.theta, which, stops.at(side))
    state = eqx.tree_at(lambda x: x.body.theta, _in_mode(plane, done), theta)
    speed = jnp.maximum(jnp.sum(side * state.body.thetadot[slots]), 0.0)
    e = jnp.sum(jnp.where(which, stops.restitution, 0.0))
    reach, natural = Reach.of(body, t, state.body), _natural_speed(plane, t, state, which)
    slowest = jnp.sum(jnp.where(which, stops.slowest * natural / reach.mean, 0.0))
    rebounds = e * speed > slowest
    rests = sides(body, state.slips, theta[slots])
    loose = _loose(state, jnp.where(rests == 0, 1.0, 0.0))
    strike = _Strike(side, speed, jnp.where(rebounds, e, 0.0), loose)
    strike = strike._replace(state=_hold_resting(plane, t, strike, rests))
    e, blow = _without_gain(plane, t, strike)
    rebounds &= e > 0
    rates = put(body, state.body.thetadot + blow.thetadot, which, -e * speed * side)
    # The largest rate that the strike could give another joint: what is rounding of it did not set it in motion.
    size = jnp.abs(state.body.thetadot[slots]) + speed * jnp.sum(jnp.where(which, reach.mean, 0.0)) / reach.mean
    moves = jnp.abs(rates[slots]) > ROUNDING * float(jnp.finfo(size.dtype).eps) * size
    moves = jnp.where(which, rebounds, moves & (strike.state.slips != 0))
    slides = rubs(body)
    slips = jnp.where(moves, jnp.where(slides, jnp.sign(rates[slots]), 1.0), 0.0)
    slips = jnp.where(slides | which | (state.slips == 0), slips, 1.0)
    slips = jax.lax.stop_gradient(slips)
    rates = put(body, rates, slips == 0, jnp.zeros_like(slips))
    state = _loose(state, slips)
    state = dataclasses.replace(state, stop_loss=state.stop_loss + blow.lost)
    done = done._replace(strikes=jnp.any(which))
    if blow.after is None:
        moved = state.body.with_Omega(state.body.Omega + blow.Omega)
        return done._replace(state=state.move(eqx.tree_at(lambda x: x.thetadot, moved, rates)))
    return _with_contact(plane, done, state, blow, rates)


def _in_mode(plane: "BodyOnPlane", done: Progress) -> ContactState:
    """Returns the state in its mode of contact, which it does not say as a run starts, or after a landing."""
    state = done.state
    if state.mode is None:
        return state
    slip = slip_velocity(plane.body, done.t, state.released)
    still = state.is_in(Mode.ROLLING) | done.still | plane.is_still(slip[:2], state)
    mode = jnp.where(done.flies, int(Mode.FLIGHT), jnp.where(still, int(Mode.ROLLING), int(Mode.SLIDING)))
    return dataclasses.replace(state, mode=mode.astype(state.mode.dtype))


def _loose(state: ContactState, slips: Float[Array, " sticking"]) -> ContactState:
    """Returns the state in which dry resistance holds nothing, with these directions of joints."""
    state = dataclasses.replace(state, slips=slips)
    if state.rolls is None:
        return state
    return dataclasses.replace(state, rolls=jnp.ones_like(state.rolls), spin=jnp.ones_like(state.spin))


def _natural_speed(
    plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, which: Bool[Array, " sticking"]
) -> Float[Array, ""]:
    """Computes √(g r); without gravity, the acceleration of the joint's masses takes the place of g."""
    body, slots = plane.body, sticking_slots(plane.body)
    free = plane.field(t, dataclasses.replace(state, slips=jnp.where(which, 1.0, state.slips)))
    gains = jnp.abs(free.body.thetadot[slots]) * Reach.of(body, t, state.body).mean
    g = jnp.abs(body.gravity)
    g = jnp.where(g > 0, g, jnp.sum(jnp.where(which, gains, 0.0)))
    return jax.lax.stop_gradient(root(g * body.radius))


def _hold_resting(
    plane: "BodyOnPlane", t: Float[Array, ""], strike: _Strike, rests: Float[Array, " sticking"]
) -> ContactState:
    """Returns the state in which joints that rest against other stops are held as far as these push them."""
    groups = zip(plane.body.mechanism_groups, plane.body.mechanism_order, strict=True)
    if sum(len(order) * len(group.stops) for group, order in groups) == 1:
        return strike.state

    def weigh(slips: Array) -> tuple[Array, None]:
        holding = _blow(plane, t, strike._replace(state=dataclasses.replace(strike.state, slips=slips))).holding
        pulls = (slips == 0) & (rests * holding > 0)
        return jnp.where(pulls, jnp.abs(holding), -jnp.inf), None

    none = jnp.zeros(rests.size, bool)
    slips = release(strike.state.slips, weigh, lambda slips, _, off: jnp.where(off, 1.0, slips), none)
    return dataclasses.replace(strike.state, slips=jax.lax.stop_gradient(slips))


def _without_gain(plane: "BodyOnPlane", t: Float[Array, ""], strike: _Strike) -> tuple[Float[Array, ""], _Blow]:
    """Computes the strike with as much of its restitution as creates no energy."""
    if plane.contact is None:
        return strike.e, _blow(plane, t, strike)

    def attempt(tried: tuple[Array, Array, Array], k: Array) -> tuple[tuple[Array, Array, Array], _Blow]:
        e, lost, first = tried
        # With all that is held at its end, the energy after a strike grows as e².
        share = first / jnp.where(lost < 0, first - lost, 1.0)
        less = jnp.where(k == 2, e * root(jnp.maximum(share, 0.0)), 0.0)
        e = jnp.where(k == 0, 0.0, jnp.where(k == 1, strike.e, jnp.where(lost < 0, less, e)))
        blow = _blow(plane, t, strike._replace(e=e))
        slack = ROUNDING * float(jnp.finfo(e.dtype).eps) * jnp.abs(first)
        lost = jnp.where(k == 0, blow.lost, blow.lost + slack)
        return (e, lost, jnp.where(k == 0, blow.lost, first)), blow

    none = jnp.zeros_like(t)
    (e, _, _), blows = jax.lax.scan(attempt, (none, none, none), jnp.arange(4))
    return e, jax.tree.map(lambda x: x[-1], blows)


def _blow(plane: "BodyOnPlane", t: Float[Array, ""], strike: _Strike) -> _Blow:
    """Computes what a strike does, where joints with the direction 0 are held."""
    state, which = strike.state, strike.which
    efforts = among_free(plane.body, jnp.abs(strike.side))
    if plane.contact is not None:
        return _blow_on_contact(plane, t, strike, efforts)
    body = plane.moving(state)
    motion = equations(body, t, state.body)
    Omega, joints = motion.matrix.solve(jnp.zeros_like(state.body.Omega), efforts)
    impulse = strike.change / _of_struck(which, of_sticking(body, joints))
    thetadot = join_coordinates(jnp.zeros_like(state.body.theta), motion.links, joints)
    holding = of_sticking(body, motion.lacking(efforts, Omega, joints))
    return _Blow(impulse * Omega, impulse * thetadot, _compute_loss(strike, impulse), impulse * holding)


def _of_struck(which: Bool[Array, " sticking"], rates: Float[Array, " sticking"]) -> Float[Array, ""]:
    """Returns the rate that a unit impulse gives the joint that strikes; 1 without one."""
    return jnp.where(jnp.any(which), jnp.sum(jnp.where(which, rates, 0.0)), 1.0)


def _compute_loss(strike: _Strike, impulse: Float[Array, ""]) -> Float[Array, ""]:
    """Computes what the impulse of a stop takes from the energy, −½ I (θ̇⁻ + θ̇⁺)."""
    return -0.5 * (1 - strike.e) * strike.speed * jnp.sum(strike.side) * impulse


def _blow_on_contact(plane: "BodyOnPlane", t: Float[Array, ""], strike: _Strike, efforts: list[Array]) -> _Blow:
    state, slots = strike.state, sticking_slots(plane.body)
    response = plane.response(t, state, efforts=efforts)
    pushed, yielding = response.pushed, response.yielding
    assert pushed is not None
    gain = _of_struck(strike.which, pushed.thetaddot[slots])
    by_slip = jnp.sum(jnp.where(strike.which, yielding.thetaddot[:, slots], 0.0), axis=1)
    # With the rate of the joint after the strike, the impulse of the ground is R₀ + S Δv_s.
    R0 = strike.change / gain * pushed.reaction
    S = yielding.reaction - by_slip[:, None] * pushed.reaction[None] / gain
    before, after, still = _slip_after(plane, t, state, R0, inverse(S), slowest_rise(plane, response))
    change = after - before
    impulse = (strike.change - jnp.sum(by_slip * change)) / gain
    of_ground = jnp.where(state.is_in(Mode.FLIGHT), 0.0, R0 + combine_rows(change, S))
    Omega, thetadot, holding = (
        impulse * getattr(pushed, name) + combine_rows(change, getattr(yielding, name))
        for name in ("Omegadot", "thetaddot", "holding")
    )
    lost = _compute_loss(strike, impulse) - 0.5 * dot(of_ground, before + after)
    return _Blow(Omega, thetadot, lost, holding, after, still)


def _slip_after(
    plane: "BodyOnPlane",
    t: Float[Array, ""],
    state: ContactState,
    R0: Float[Array, "3"],
    D: Float[Array, "3 3"],
    slowest: Float[Array, ""],
) -> tuple[Float[Array, "3"], Float[Array, "3"], Bool[Array, ""]]:
    """Computes the slip velocity before and after a strike in which the ground would give the impulse R₀ to a contact
    that rolls on, and whether nothing slips after it. A body that would rise slower than ``slowest`` stays on its
    ground.
    """
    rolls, slides, flies = (state.is_in(mode) for mode in (Mode.ROLLING, Mode.SLIDING, Mode.FLIGHT))
    slip = slip_velocity(plane.body, t, state.released)
    before = jnp.where(rolls, 0.0, jnp.where(flies, slip, slip.at[2].set(0.0)))
    free = before - apply(D, R0)
    slack = ROUNDING * float(jnp.finfo(R0.dtype).eps) * jax.lax.stop_gradient(root(jnp.sum(R0**2)))
    rolls_on = rolls & (friction.margin(R0, plane.law.static_friction) >= -slack)
    sigma = state.direction(t, before[:2])
    rising = apply(D, friction.push(plane.coefficient(before), sigma))
    solvable = rising[2] > 0
    normal = (before - free)[2] / jnp.where(solvable, rising[2], 1.0)
    slid = (free + normal * rising).at[2].set(0.0)
    slides_on = slides & solvable & (normal >= -slack) & (jnp.sum(sigma * slid[:2]) > 0)

    def strike_ground() -> tuple[Array, Array]:
        hit = collision(D, free, plane.coefficient(free), jnp.zeros_like(t))
        return hit.slip, hit.sticks

    goes_on = rolls_on | slides_on | flies
    hit, sticks = jax.lax.cond(goes_on, lambda: (free, jnp.zeros_like(goes_on)), strike_ground)
    # What takes the rise away is an impulse along the normal, which loses its energy.
    stays = ~flies & (hit[2] > 0) & (hit[2] < slowest)
    pulled = hit - D[:, 2] * hit[2] / jnp.where(stays, D[2, 2], 1.0)
    hit = jnp.where(stays, pulled.at[2].set(0.0), hit)
    after = jnp.where(rolls_on, 0.0, jnp.where(slides_on, slid, hit))
    return before, after, rolls_on | sticks


def _with_contact(
    plane: "BodyOnPlane", done: Progress, state: ContactState, blow: _Blow, rates: Float[Array, " coordinates"]
) -> Progress:
    """Returns the progress after a strike of a body with a law of contact."""
    t, before = done.t, slip_velocity(plane.body, done.t, state.released)
    assert blow.after is not None
    assert blow.still is not None
    response = plane.response(t, state)
    moved = with_velocities(plane.body, state.released, response, blow.Omega, blow.thetadot, blow.after - before)
    flew = state.is_in(Mode.FLIGHT)
    rise = jnp.where(blow.after[2] > plane.rounding_of_velocity(state), blow.after[2], 0.0)
    V = jnp.where(flew, moved.V, with_rise(plane.body, t, moved, rise))
    moved = dataclasses.replace(moved, V=V, body=eqx.tree_at(lambda x: x.thetadot, moved.body, rates))
    return done._replace(state=state.move(moved), still=blow.still, flies=done.flies | ~flew & (rise > 0))
