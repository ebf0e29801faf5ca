"""The balances of a run: each law's quantity and its rate, at the ends of steps and at Gauss nodes within."""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import programs
from ...numerics.linear import product
from ...numerics.vectors import add, apply, convert, cross, dot, hat, in_three
from ...physics.body import AbstractBody
from ...physics.contact.body_on_plane import BodyOnPlane, has_contact
from ...physics.contact.modes import ContactState
from ...physics.contact.released import rolling_contact
from ...physics.contact.slide import spinning_loss
from ...physics.dynamics.equations import accelerations
from ...physics.dynamics.footing import footing, footing_of_released
from ...physics.dynamics.load import Load, load, velocities
from ...physics.dynamics.locked import jellett, jellett_rate, routh_integrals
from ...physics.dynamics.moments import Moments, kinematics, point_mass_values, principal_inertia
from ...physics.grounds import Footing
from ...physics.grounds.ground import Ground
from ...physics.observables import Observables, compute_observables, movement, observe
from ...physics.packing import Packing, ravel_state
from ...physics.prescribed.frames import frisvad
from ...physics.prescribed.motion import Kinematics
from ...physics.state import BallState, DiskState
from ...simulation.solvers.dense.steps import Steps
from ...simulation.trajectory import Interpolant, Trajectory

CENTRED_DISTANCE = 1e-12  # of the radius of gyration: a distance from the geometric centre that counts as zero
# Enough for the polynomials of dense output, multiplied by factors that vary on the same scale.
GAUSS_NODES = 10
# Programs are compiled for multiples of this number of steps, so that there are few of them.
STEPS_AT_A_TIME = 64
GAUSS = np.polynomial.legendre.leggauss(GAUSS_NODES)
FRACTIONS = np.concatenate([[0.0], (1 + GAUSS[0]) / 2, [1.0]])
WEIGHTS = GAUSS[1] / 2
DISPLACEMENT = 1e-6
MATTER_AT_REST = 1e-12  # a speed of the ground's matter below which it is rounding


class Balance(NamedTuple):
    """A quantity and its rate of change according to the law."""

    value: Float[Array, "*shape"]
    rate: Float[Array, "*shape"]


class Quantities(NamedTuple):
    """Balances by the name of their law, and the moments of the masses, which determine which laws hold.

    ``matter`` is the velocity of the ground's matter under a body that may slip.
    """

    balances: dict[str, Balance]
    moments: Moments | None
    axis: Float[Array, "3"] | None
    matter: Float[Array, "3"] | None = None


def quantities(system: Any, t: Float[Array, ""], state: Any) -> Quantities:
    """Computes the balances of any system in one state; for a body with joints that stick, the balances of the body."""
    if has_contact(system):
        return _of_contact(system, t, state)
    if not isinstance(system.shown, AbstractBody):
        laws, rates = system.laws(t, state)._asdict(), system.law_rates(t, state)
        balances = {n: Balance(value, rates[n]) if n in rates else _constant(value) for n, value in laws.items()}
        return Quantities(balances, None, None)
    lost = state.lost if isinstance(state, ContactState) else 0.0
    system, state = system.shown, system.state_to_show(state)
    observables, in_space = observe(system, t, state), state.in_space()
    energy = Balance(observables.energy + lost, observables.power)
    if system.shape is not None:
        norm = jnp.sqrt(jnp.sum(in_space.q**2))
        balances = {"energy": energy, "momentum": contact_momentum_balance(system, t, state), "norm": _constant(norm)}
        return Quantities(balances | {"rolling": rolling_balance(system, t, state)}, None, None)
    motion, r = accelerations(system, t, state), system.radius
    acting = load(system, t, state).with_torque(motion.dry)
    Lambda, Omega = in_space.Lambda, in_space.Omega
    Gamma = Lambda[2]
    body_moments = motion.body_moments
    arguments = body_moments, r, Omega, Gamma
    axis = axis_of(body_moments)
    axial = routh_integrals(*_about(axis, *arguments))
    momentum = contact_momentum_balance(system, t, state)
    balances = {
        "energy": energy,
        "momentum": momentum,
        "chaplygin": _constant(momentum.value),
        "jellett-rate": Balance(jellett(*arguments), jellett_rate(*arguments, acting.force, acting.torque)),
        "jellett": _constant(axial.jellett),
        "routh": _constant(axial.routh),
        "norm": _constant(jnp.sqrt(jnp.sum(in_space.q**2))),
        "rolling": rolling_balance(system, t, state),
    }
    if isinstance(system.ground, Ground) and system.ground.turntable is not None:
        balances["moving-energy"] = moving_energy_balance(system, t, in_space, observables)
    return Quantities(balances, body_moments, axis)


def _of_contact(plane: BodyOnPlane, t: Float[Array, ""], state: ContactState) -> Quantities:
    """Computes the balances of a body that may slip and fly: those to which it does not matter how the ground acts at
    the contact point, also in an impact, and its energy, with all that friction, impacts and strikes of joints
    have dissipated.
    """
    motion, system = movement(plane, t, state), plane.body
    seen, body = compute_observables(system, t, motion), motion.state
    assert motion.slip is not None
    rubbing = -dot(motion.R, motion.slip.velocity) + spinning_loss(plane, t, state, motion.dry)
    # Over a surface the point of reference is the one nearest to it, also in flight, to which that means nothing.
    under = footing_of_released(system, t, state.body, state.V, state.height, True)
    acting = motion.acting.with_torque(motion.dry)._replace(footing=under)
    momentum = _momentum_balance(system, t, body, acting, state.V - _centre_velocity(system, body, under))
    balances = {
        "energy": Balance(seen.energy + state.lost, seen.power + rubbing),
        "momentum": momentum,
        "norm": _constant(jnp.sqrt(jnp.sum(body.q**2))),
    }
    matter = rolling_contact(system, t, state.body)[1].velocity
    if system.shape is not None:
        return Quantities(balances, None, None, matter)
    assert isinstance(motion.body_moments, Moments)
    arguments = motion.body_moments, system.radius, body.Omega, body.Lambda[2]
    axis = axis_of(motion.body_moments)
    balances |= {
        "chaplygin": _constant(momentum.value),
        "jellett-rate": Balance(jellett(*arguments), jellett_rate(*arguments, acting.force, acting.torque)),
        "jellett": _constant(routh_integrals(*_about(axis, *arguments)).jellett),
    }
    return Quantities(balances, motion.body_moments, axis, matter)


def rolling_balance(system: AbstractBody, t: Float[Array, ""], state: BallState | DiskState) -> Balance:
    """Returns the position of the geometric centre, on the plane or over a surface, and its velocity by the
    constraint.
    """
    under, in_space = footing(system, t, state), state.in_space()
    velocity = _centre_velocity(system, in_space, under)
    return Balance(in_space.z, velocity[:2]) if under.centre is None else Balance(under.centre, velocity)


def _centre_velocity(system: AbstractBody, state: BallState, under: Footing) -> Float[Array, "3"]:
    """Computes ω × r n + w."""
    return add(cross(apply(state.Lambda, state.Omega), _arm_in_space(system, state, under)[0]), under.velocity)


def _arm_in_space(
    system: AbstractBody, state: BallState, under: Footing
) -> tuple[Float[Array, "3"], Float[Array, "3"] | None]:
    """Computes the arm from the contact to the centre, r n of a sphere, and its rate: of one that is no sphere Λ∇h, as
    Λ turns.
    """
    r, shape = system.radius, system.shape
    if shape is None:
        n = jnp.zeros_like(state.Omega).at[2].set(1.0) if under.normal is None else under.normal
        return r * n, convert(lambda rate: r * rate, under.normal_rate)
    turning = product(state.Lambda, hat(state.Omega))
    return jax.jvp(lambda Lambda: apply(Lambda, shape.arm(Lambda[2])), (state.Lambda,), (turning,))


def contact_momentum_balance(system: AbstractBody, t: Float[Array, ""], state: BallState | DiskState) -> Balance:
    """Computes the balance of the momentum about the contact point of a body that rolls."""
    acting = load(system, t, state).with_torque(accelerations(system, t, state).dry)
    return _momentum_balance(system, t, state, acting)


def _momentum_balance(
    system: AbstractBody,
    t: Float[Array, ""],
    state: BallState | DiskState,
    acting: Load,
    slip: Float[Array, "3"] | None = None,
) -> Balance:
    """Computes the angular momentum about the contact point in space axes, ΛΠ, and its rate, mass by mass.

    About a point that moves with the velocity ċ, L̇ = Σ s × m(**g** − Ẍ) + r e3 × F + T − ċ × P, with s from the contact
    point to a mass, and here ċ = ω × r e3 + w: Goldstein, Poole & Safko, Classical Mechanics, 3rd edition, section 1.2,
    with a moving point of reference, in axes that move by X. On a surface its normal n takes the place of e3, and the
    point of reference moves by r ṅ less than the centre. With a ``slip``, the velocity of the lowest point over the
    ground, space axes, that point is the one of reference, also in flight.
    """
    in_space, under = state.in_space(), acting.footing
    Lambda = in_space.Lambda
    seen = _in_space(system, t, state, under, slip)
    lift = system.gravity * system.up if system.ground is None else system.ground.lift(t, system.gravity)
    arm, arm_rate = _arm_in_space(system, in_space, under)
    moves = add(_centre_velocity(system, in_space, under), convert(jnp.negative, arm_rate), slip)
    rate = cross(seen.moment, -lift) - cross(moves, seen.P)
    push = convert(lambda force: cross(arm, apply(Lambda, force)), acting.force)
    return Balance(seen.Pi, add(rate, push, convert(lambda torque: apply(Lambda, torque), acting.torque)))


def moving_energy_balance(
    system: AbstractBody, t: Float[Array, ""], state: BallState, observables: Observables
) -> Balance:
    """Computes the moving energy E − W L on a level turntable at the rate W, and its rate of change.

    L = e3·(ΛΠ + (z − c) × ΛP) is the angular momentum about the turntable's axis. Forces that do work on E through the
    velocity u of the table do none on E − W L: its rate is Ė minus (f + F)·u, W T₃ and ẆL. It is constant for steady W
    without actuation inside (Bizyaev, Borisov & Mamaev, arXiv:1807.08438).
    """
    ground = system.ground
    assert isinstance(ground, Ground)
    assert ground.turntable is not None
    _, W, Wdot = ground.turntable.turning.derivatives(t)
    acting = load(system, t, state).with_torque(accelerations(system, t, state).dry)
    seen, aside = _in_space(system, t, state, acting.footing), in_three(state.z - ground.turntable.centre)
    L = seen.Pi[2] + cross(aside, seen.P)[2]
    push = observables.friction
    if acting.force is not None:
        push = push + apply(state.Lambda, acting.force)[:2]
    assert acting.footing.velocity is not None
    rate = observables.power - jnp.sum(push * acting.footing.velocity[:2]) - Wdot * L
    if acting.torque is not None:
        rate = rate - W * dot(acting.torque, state.Gamma)
    return Balance(observables.energy - W * L, rate)


class _InSpace(NamedTuple):
    """ΛP, ΛΠ, and Σ m Λs with s from the contact point, over all masses; velocities are relative to the plane."""

    P: Float[Array, "3"]
    Pi: Float[Array, "3"]
    moment: Float[Array, "3"]


def _in_space(
    system: AbstractBody,
    t: Float[Array, ""],
    state: BallState | DiskState,
    under: Footing,
    slip: Float[Array, "3"] | None = None,
) -> _InSpace:
    in_space, r = state.in_space(), system.radius
    Lambda, Omega = in_space.Lambda, in_space.Omega
    arm = apply(Lambda.T, _arm_in_space(system, in_space, under)[0]) / r
    points = kinematics(system, t, (state.theta, state.thetadot, state.thetadot))  # accelerations are not used
    chi = jnp.concatenate([system.offset[None], points.chi])
    chidot = jnp.concatenate([jnp.zeros((1, 3), dtype=Omega.dtype), points.chidot])
    m = jnp.concatenate([system.mass[None], point_mass_values(system)])[:, None]
    s = r * arm[None] + chi
    Y = velocities(r, Kinematics(chi, chidot, jnp.zeros_like(chi)), Omega, arm)
    Y = add(Y, convert(lambda v: apply(Lambda.T, v)[None], add(under.velocity, slip)))
    Pi = apply(principal_inertia(system), Omega) + jnp.sum(m * jax.vmap(cross)(s, Y), axis=0)
    return _InSpace(*(apply(Lambda, v) for v in (jnp.sum(m * Y, axis=0), Pi, jnp.sum(m * s, axis=0))))


def axis_of(body_moments: Moments) -> Float[Array, "3"]:
    """Returns the only axis about which the ball can be a body of revolution.

    It passes through the centre of mass; where that is the geometric centre, it is the body axis whose moment differs
    most from the others.
    """
    J = jnp.diagonal(body_moments.J)
    height = jnp.sqrt(jnp.sum(body_moments.p**2))
    centred = height <= CENTRED_DISTANCE * jnp.sqrt(body_moments.M * jnp.max(J))
    odd = jnp.argmax(jnp.abs(J - jnp.median(J)))
    coordinate = jnp.where(jnp.arange(3) == odd, jnp.ones_like(J), 0.0)
    # The inner `where` keeps the division by 0 away where the axis is a coordinate's.
    return jnp.where(centred, coordinate, body_moments.p / jnp.where(centred, 1.0, height))


def _about(axis: Float[Array, "3"], body_moments: Moments, r, Omega, Gamma):
    """Returns the moments and vectors in axes turned so that E3 is ``axis``."""
    turn = jnp.stack([*frisvad(axis), axis])

    def turn_matrix(matrix):
        return product(product(turn, matrix), turn.T)

    p, pdot, pddot, l, ldot = (
        apply(turn, v)
        for v in (body_moments.p, body_moments.pdot, body_moments.pddot, body_moments.l, body_moments.ldot)
    )
    J, Jdot = turn_matrix(body_moments.J), turn_matrix(body_moments.Jdot)
    about = Moments(M=body_moments.M, p=p, pdot=pdot, J=J, Jdot=Jdot, l=l, pddot=pddot, ldot=ldot)
    return about, r, apply(turn, Omega), apply(turn, Gamma)


def _constant(value: Float[Array, "*shape"]) -> Balance:
    return Balance(value, jnp.zeros_like(value))


@dataclasses.dataclass(frozen=True)
class Drift:
    """The departure of a quantity from its balance in a run.

    - ``residuals``: |A(t) − A(t0) − ∫ R dt| at the end of each step, where dA/dt = R is the law; of a vector, the
      largest component.
    - ``sensitivity``: the largest change of A, along the run, for a change of every component of the state by its
      tolerance, Σ |∂A/∂x_j| (atol + rtol |x_j|); at least the rounding of A, as where a solve keeps a versor's length.
    """

    residuals: Float[np.ndarray, " steps"]
    sensitivity: float

    @property
    def residual(self) -> float:
        """The largest residual."""
        return float(np.max(self.residuals))


@dataclasses.dataclass(frozen=True)
class Samples:
    """The balances along a run: the ends of its steps, the drift by the name of the law, and the moments and axis at
    the nodes. ``ground_moves`` says whether the ground's matter moves under a body that may slip.
    """

    times: Float[np.ndarray, " steps"]
    drifts: dict[str, Drift]
    moments: Moments | None
    axis: Float[np.ndarray, "steps nodes 3"] | None
    ground_moves: bool = False


def sample(trajectory: Trajectory[Any, Any], rtol: float, atol: float) -> Samples:
    """Evaluates the balances of a trajectory with dense output.

    A quantity is evaluated where steps end, and its rate is integrated over each step by Gauss–Legendre quadrature on
    the dense output. Steps end at kinks, so the rate is smooth within each.
    """
    interpolant = trajectory.interpolant
    assert interpolant is not None
    times, vectors, valid = map(np.asarray, _nodes(trajectory, _room_for(trajectory)))
    starts, size = vectors[:, 0], vectors.shape[-1]
    # A time that never comes is the largest number: displaced by a part of itself it would overflow.
    change = DISPLACEMENT * (1 + np.minimum(np.abs(starts), np.finfo(starts.dtype).max ** 0.5))
    displaced = starts[:, None] + change[:, None] * np.eye(size)[None]
    t = np.concatenate([times.ravel(), np.repeat(times[:, 0], size)])
    x = np.concatenate([vectors.reshape(-1, size), displaced.reshape(-1, size)])
    evaluated = _evaluate(interpolant.packing, jnp.asarray(t), jnp.asarray(x))
    count, number = int(valid.sum()), times.size
    lengths = (times[:, -1] - times[:, 0])[:count]

    def along(leaf: Any) -> np.ndarray:
        return np.asarray(leaf)[:number].reshape(*times.shape, -1)[:count]

    drifts, varies = {}, np.asarray(_varies(interpolant.packing, jnp.asarray(x[0])))
    for name, (value, rate) in evaluated.balances.items():
        A, A_displaced = along(value), np.asarray(value)[number:].reshape(len(starts), size, -1)[:count]
        slope = varies[None, :, None] * np.abs(A_displaced - A[:, :1]) / change[:count, :, None]
        allowed = (atol + rtol * np.abs(starts[:count]))[:, :, None]
        rounding = np.finfo(A.dtype).eps * np.max(np.abs(A))
        drifts[name] = Drift(
            residuals=drift(A[:, 0], A[:, -1], along(rate)[:, 1:-1], lengths),
            sensitivity=float(max(np.max(np.sum(slope * allowed, axis=1)), rounding)),
        )
    ground_moves = False
    if evaluated.matter is not None:
        ground_moves = bool(np.max(np.linalg.norm(along(evaluated.matter), axis=2)) > MATTER_AT_REST)
    if evaluated.moments is None:
        return Samples(times[:count, -1], drifts, None, None, ground_moves)
    at_nodes = jax.tree.map(
        lambda leaf: np.asarray(leaf)[:number].reshape(*times.shape, *leaf.shape[1:])[:count], evaluated
    )
    return Samples(times[:count, -1], drifts, at_nodes.moments, at_nodes.axis, ground_moves)


def _varies(packing: Packing[Any, Any], x: Float[Array, " size"]) -> Float[Array, " size"]:
    """Returns 1 for each entry of a vector that errors of a solve change, 0 for entries that only say which mode it is
    in.
    """
    state = jax.tree.map(jnp.ones_like, packing.unravel(x))
    if isinstance(state, ContactState):
        of_mode = ("mode", "begun", "near", "rolls", "spin", "rolling", "slips")
        labels = {name: jax.tree.map(jnp.zeros_like, getattr(state, name)) for name in of_mode}
        state = dataclasses.replace(state, **labels)
    return ravel_state(state)[0]


def drift(
    start: Float[np.ndarray, "steps k"],
    end: Float[np.ndarray, "steps k"],
    rate: Float[np.ndarray, "steps nodes k"],
    lengths: Float[np.ndarray, " steps"],
) -> Float[np.ndarray, " steps"]:
    """Computes the largest component of |A(t) − A(t0) − ∫ R dt| at each step's end, from A there and R at Gauss's
    nodes.
    """
    integrals = np.cumsum(lengths[:, None] * np.einsum("snk,n->sk", rate, WEIGHTS), axis=0)
    return np.max(np.abs(end - start[:1] - integrals), axis=1)


@programs.filter_jit
def _nodes(trajectory: Trajectory[Any, Any], room: int) -> tuple[Array, Array, Array]:
    """Returns the times and vectors at the ends and Gauss's nodes of each step, and which steps were taken."""
    interpolant = trajectory.interpolant
    assert isinstance(interpolant, Interpolant)
    steps = Steps.of(interpolant.solution, trajectory.reached, room)
    # The first step replaces those that were not taken, so that all numbers are finite.
    index, valid = jnp.where(steps.taken, jnp.arange(steps.start.size), 0), steps.taken
    start, end = steps.start[index], steps.end[index]
    if steps.resumed is not None:  # rates jump where a pause ends, so that it is a step of its own
        resumed = steps.resumed[index]
        start, end = jnp.stack([start, resumed], axis=1).ravel(), jnp.stack([resumed, end], axis=1).ravel()
        index, valid = jnp.repeat(index, 2), jnp.repeat(valid, 2)
    fractions = jnp.asarray(FRACTIONS, start.dtype)
    times = start[:, None] + (end - start)[:, None] * fractions[None]
    nodes = jnp.repeat(index, fractions.size), times.reshape(-1)
    states = jax.lax.map(lambda node: steps.state(*node), nodes)
    return times, states.reshape(*times.shape, -1), valid


@programs.filter_jit
def _evaluate(packing: Packing[Any, Any], times: Float[Array, " rows"], vectors: Float[Array, "rows size"]) -> Any:
    # One after another: as a batch, a long formula on small vectors takes XLA several times as long to compile.
    return jax.lax.map(lambda row: quantities(packing.system, row[0], packing.unpack(*row)), (times, vectors))


def _room_for(trajectory: Trajectory[Any, Any]) -> int:
    """Returns how many steps to examine: the steps that were taken, and a few more."""
    interpolant: Any = trajectory.interpolant
    largest = interpolant.solution.interpolation.ts.shape[-1] - 1
    accepted = int(np.asarray(trajectory.steps) - np.asarray(trajectory.rejected))
    return min(largest, STEPS_AT_A_TIME * -(-max(accepted, 1) // STEPS_AT_A_TIME))
