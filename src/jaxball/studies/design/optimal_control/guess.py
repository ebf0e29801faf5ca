"""Makes the initial guess of an optimal control problem: a ball or a disk that rolls along the desired path.

It refuses an end at which the robot cannot rest. There the centre of mass is on the vertical through the contact point:
on a slope α it is r sin α beside the geometric centre, and with a ``depth`` it is that far below it, too. No equations
of motion are needed to see that it cannot get there, whereas Newton's method only fails to converge.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from .... import programs
from ....numerics import versor
from ....numerics.vectors import apply, cross
from ....physics.dynamics.footing import locate_surface
from ....physics.dynamics.load import load
from ....physics.dynamics.locked import contact_momentum, contact_momentum_rate
from ....physics.dynamics.moments import velocity_moments
from ....physics.grounds import AbstractSurface
from ....physics.grounds.ground import Ground
from ....physics.state import BallState, DiskState
from ....simulation.equilibrium import imbalance
from ....simulation.solvers.tableau import gauss
from ..objectives import FollowTrajectory
from ..problem.run import locate_centre
from ..problem.space import DesignError
from .problem import Path
from .rolling import Rolling

# The number of times per interval of the mesh.
TIMES = 10
# The number of corrections of the angles at each time, and their damping where the rails cannot follow.
CORRECTIONS, DAMPING = 3, 1e-4


@programs.compile_quickly()
def rolling_along(problem: Rolling, mesh: Float[np.ndarray, " N_plus_one"], stages: int = 3) -> Path:
    times = np.linspace(mesh[0], mesh[-1], TIMES * (len(mesh) - 1) + 1)
    target = _target_path(problem, times)
    theta, thetadot = (np.tile(np.asarray(x), (len(times), 1)) for x in (problem.state.theta, problem.state.thetadot))
    state = _rolling_states(problem, target, (theta, thetadot))
    tilts = bool(problem.system.driven_ground)
    # The masses hang as at the start until gravity's moment is known along the path. A plate leaves the centre of
    # mass where it is and turns n instead, so that M r n takes the place of Λp.
    hanging = np.tile(_initial_moment(problem), (len(times), 1))
    before = state if tilts else _with_masses_for(problem, times, state, hanging)
    # Only once: each repetition differentiates twice, and at rest the desired acceleration has a kink.
    Pi, rate = _momenta(problem, jnp.asarray(times), before)
    # The excess of d(ΛΠ)/dt over the effect of the forces and of the contact point's motion.
    leaning = _moment_with_torque(problem, hanging, CubicSpline(times, Pi)(times, 1) - np.asarray(rate))
    if tilts:
        theta = np.asarray(_angles(problem, jnp.asarray(times), jnp.asarray(leaning)))
        state = _rolling_states(problem, target, (theta, CubicSpline(times, theta)(times, 1)))
    else:
        state = _with_masses_for(problem, times, state, leaning)
    x = CubicSpline(times, _pack_states(problem, times, state))
    nodes = mesh[:-1, None] + np.diff(mesh)[:, None] * gauss(stages).c
    size = x(mesh).shape[1]
    # From spline derivatives, because the controls must produce the rates of the path that is returned.
    u = driving(problem, np.ravel(nodes), x(nodes).reshape(-1, size), x(nodes, 1).reshape(-1, size))
    return Path(mesh, x(mesh), x(nodes), u.reshape(*nodes.shape, -1))


@programs.compile_quickly()
def driving(
    problem: Rolling, times: Float[np.ndarray, " k"], states: Float[np.ndarray, "k n"], rates: Float[np.ndarray, "k n"]
) -> Float[np.ndarray, "k m"]:
    """Finds the controls with which ẋ comes closest to ``rates``."""
    free, columns = (np.asarray(part) for part in _affine(problem, *map(jnp.asarray, (times, states))))
    # The rates are those of a desired path, which m controls cannot give to n states in general: least squares.
    return np.einsum("kmn,kn->km", np.linalg.pinv(columns), rates - free)


@programs.jit
def _affine(problem: Rolling, times, states) -> tuple[Float[Array, "k n"], Float[Array, "k n m"]]:
    """Computes ẋ without controls, and its derivative by them."""
    off = jnp.zeros(problem.controls, states.dtype)

    def one(t, x):
        # Accelerations and motors' forces enter the equations of motion linearly, so that this derivative holds for
        # all u.
        rate, change = jax.linearize(lambda u: problem.rate(t, x, u), off)
        return rate, jax.vmap(change, out_axes=1)(jnp.eye(problem.controls, dtype=states.dtype))

    return jax.vmap(one)(times, states)


def _target_path(problem: Rolling, times: Float[np.ndarray, " t"]) -> CubicSpline:
    """Returns z(t)."""
    for objective in problem.objectives.values():
        if isinstance(objective, FollowTrajectory):
            return CubicSpline(times, objective.targets(jnp.asarray(times)))
    raise DesignError(
        "Argument `problem` must have an objective that prescribes the path in time, a FollowTrajectory, but its "
        f"objectives are {sorted(problem.objectives)}; start from rest."
    )


def _rolling_states(
    problem: Rolling, path: CubicSpline, angles: tuple[Float[np.ndarray, "t m"], Float[np.ndarray, "t m"]]
) -> BallState | DiskState:
    """Returns the states along the desired path with these θ and θ̇, and ω as if its direction changed slowly."""
    times, start = path.x, problem.state
    held = hold_along(problem, *map(jnp.asarray, (times, path(times), *angles)))
    if not np.all(np.isfinite(held.centre)):
        raise DesignError(
            "Argument `problem` must have a desired path that is over its ground, where that is not vertical, but at "
            f"t = {times[np.argmin(np.isfinite(held.centre).all(axis=1))]:.4g} it is not; start from rest."
        )
    over = CubicSpline(times, held.centre)(times, 1) - held.velocity
    # ω × r n is the velocity of the centre over the ground, so that rolling without spin has ω = n × (ċ − w) / r.
    rates = CubicSpline(times, np.cross(held.normal, over) / float(problem.system.radius))
    # Rotations by the integral of ω over each step are exact where its direction stays the same.
    omega, turns = rates(times), np.diff(rates.antiderivative()(times), axis=0)
    if isinstance(start, DiskState):
        # A disk rolls by Ω = (0, −φ̇, 0).
        phi = start.phi - np.cumsum(np.append(0.0, turns[:, 1]))
        return DiskState(phi, -omega[:, 1], held.z, *angles)
    # SciPy has the scalar part of a quaternion last.
    steps = np.roll(Rotation.from_rotvec(turns).as_quat(), 1, axis=1)
    q, Omega = _orientations(start.q, jnp.asarray(steps), jnp.asarray(omega))
    return BallState(q, Omega, held.z, *angles)


class _Held(NamedTuple):
    """How the ground holds the body along the desired path: z of the states, c, n, and w."""

    z: Float[Array, "t *d"]
    centre: Float[Array, "t 3"]
    normal: Float[Array, "t 3"]
    velocity: Float[Array, "t 3"]


@programs.jit
def hold_along(problem: Rolling, times, wanted: Float[Array, "t 2"], theta, thetadot) -> _Held:
    """Finds how the ground holds the body with its centre at ``wanted``; NaN from where it is not over the ground."""
    start, r = problem.state, problem.system.radius
    first = jnp.zeros((len(times), 3), wanted.dtype)
    if _surface_at(problem, problem.start, start.theta, start.thetadot) is None:
        z = wanted[:, 0] if problem.system.planar else wanted
        return _Held(z, first.at[:, :2].set(wanted), first.at[:, 2].set(1.0), first)

    def step(z, at):
        t, place, *angles = at
        surface = _surface_at(problem, t, *angles)
        assert surface is not None
        # Each time's search begins at the place before, which is near, because the steps of time are small.
        for _ in range(CORRECTIONS):

            def gap(z, surface=surface, t=t, place=place):
                away = surface.place_of_centre(t, r, z)[:2] - place
                return away if z.ndim else away[0]

            slope = jnp.atleast_2d(jax.jacfwd(gap)(z))
            z = z - jnp.linalg.solve(slope, jnp.atleast_1d(gap(z))).reshape(z.shape)
        touch = surface.touch_at(t, z)
        return z, _Held(z, touch.p + r * touch.n, touch.n, touch.w)

    return jax.lax.scan(step, start.z, (times, wanted, theta, thetadot))[1]


def _surface_at(problem: Rolling, t: Float[Array, ""], theta, thetadot) -> AbstractSurface | None:
    state = dataclasses.replace(problem.state, theta=theta, thetadot=thetadot)
    return locate_surface(problem.packing.system, t, state)


@programs.jit
def _orientations(
    q: Float[Array, "4"], steps: Float[Array, "t_minus_one 4"], omega: Float[Array, "t 3"]
) -> tuple[Float[Array, "t 4"], Float[Array, "t 3"]]:
    """Computes the versors after successive rotations in space, and Ω = Λ⁻¹ω."""

    def turn(q, step):
        q = versor.product(step, q)
        return q, q

    q = jnp.concatenate([q[None], jax.lax.scan(turn, q, steps)[1]])
    return q, jax.vmap(lambda q, omega: apply(versor.rotation_matrix(q).T, omega))(q, omega)


def _moment_with_torque(problem: Rolling, hanging, moment) -> Float[np.ndarray, "t 3"]:
    """Computes Λp with its length unchanged, moved sideways so that gravity has the given ``moment``."""
    weight = np.asarray(_weight(problem))
    up = weight / np.linalg.norm(weight)
    # γ × p has no component along γ, so that only the sideways part of a moment can be met; this is the smallest
    # change of p.
    moved = hanging + np.cross(moment, weight) / np.sum(weight**2)
    size, height = np.linalg.norm(hanging, axis=1), hanging @ up
    beside = moved - (moved @ up)[:, None] * up
    side = np.linalg.norm(beside, axis=1)
    if np.any(side >= size):
        unit = float(problem.system.total_mass * problem.system.radius)
        raise DesignError(
            "Argument `problem` must have a desired motion to which gravity can accelerate the ball, but the centre "
            f"of mass would have to be {np.max(side) / unit:.3g} r to the side of the geometric centre, and it is only "
            f"{size[0] / unit:.3g} r away from it; give the motion more time, start with the centre of mass farther "
            "below, or start from rest."
        )
    # The centre of mass stays on the side of the geometric centre, above or below, on which it is at the start.
    return beside + np.copysign(np.sqrt(size**2 - side**2), height)[:, None] * up


def _with_masses_for(problem: Rolling, times, state, p: Float[np.ndarray, "t 3"]) -> BallState | DiskState:
    """Returns the states with masses positioned to give Λp."""
    theta = _angles(problem, jnp.asarray(times), _in_body(state, jnp.asarray(p)))
    return dataclasses.replace(state, theta=theta, thetadot=CubicSpline(times, theta)(times, 1))


def moment(problem: Rolling, t: Float[Array, ""], theta: Float[Array, " m"]) -> Float[Array, "3"]:
    """Computes p = Σ m χ."""
    return velocity_moments(problem.packing.system, t, (theta, jnp.zeros_like(theta))).p


@programs.jit
def _weight(problem: Rolling) -> Float[Array, "3"]:
    """Computes γ at the start, in space axes."""
    return imbalance(problem.without_controls, problem.start, problem.state).weight


@programs.jit
def _initial_moment(problem: Rolling) -> Float[Array, "3"]:
    """Computes Λp at the start, or M r n of a plate."""
    if problem.system.driven_ground:
        return _normal(problem, problem.start, problem.state.theta)
    return apply(problem.state.Lambda, moment(problem, problem.start, problem.state.theta))


def _normal(problem: Rolling, t: Float[Array, ""], theta: Float[Array, " m"]) -> Float[Array, "3"]:
    """Computes M r n of a plate."""
    surface = _surface_at(problem, t, theta, jnp.zeros_like(theta))
    assert surface is not None
    return problem.system.total_mass * problem.system.radius * surface.normal(t, problem.state.z)


@programs.jit
def _in_body(state, x: Float[Array, "t 3"]) -> Float[Array, "t 3"]:
    """Computes Λ⁻¹x."""
    return jax.vmap(lambda pose, x: pose.Lambda.T @ x)(state, x)


@programs.jit
def _angles(problem: Rolling, times, goals: Float[Array, "t 3"]) -> Float[Array, "t m"]:
    """Finds θ for given p, or for given M r n of a plate."""
    of_angles = _normal if problem.system.driven_ground else moment

    def step(theta, sample):
        t, goal = sample
        theta = _nearest_angles(functools.partial(of_angles, problem, t), theta, goal)
        return theta, theta

    return jax.lax.scan(step, problem.state.theta, (times, goals))[1]


def _nearest_angles(
    moment: Callable[[Float[Array, " m"]], Float[Array, "3"]], theta: Float[Array, " m"], goal: Float[Array, "3"]
) -> Float[Array, " m"]:
    """Finds the θ with the moment ``goal``, by the smallest changes (Levenberg's method)."""
    for _ in range(CORRECTIONS):
        J = jax.jacfwd(moment)(theta)
        # Fewer equations than angles: of all solutions the one with the smallest change, damped where the rails
        # cannot follow.
        square = J @ J.T
        damped = square + DAMPING * jnp.trace(square) * jnp.eye(3)
        theta = theta + J.T @ jnp.linalg.solve(damped, goal - moment(theta))
    return theta


@programs.jit
def _momenta(problem: Rolling, times, state) -> tuple[Float[Array, "t 3"], Float[Array, "t 3"]]:
    """Computes ΛΠ, and its rate by the equations of motion."""
    system = problem.without_controls

    def one(t, state):
        moments, Omega, r = velocity_moments(system, t, (state.theta, state.thetadot)), state.Omega, system.radius
        acting = load(system, t, state).of_momenta(r, Omega)
        Pi = contact_momentum(moments, r, Omega, acting.Gamma)
        rate = contact_momentum_rate(moments, r, acting, Pi, Omega)
        return apply(state.Lambda, Pi), apply(state.Lambda, rate + cross(Omega, Pi))

    return jax.vmap(one)(times, state)


@programs.jit
def _pack_states(problem: Rolling, times, state) -> Float[Array, "t n"]:
    return jax.vmap(problem.packing.pack)(times, state)


STEPS_TO_PLACE = 33  # from the start to the end, between which places on a curved ground are found
STARTS, SEED = 12, 0  # of the search for the largest distance
BEYOND = 1e-3  # what is demanded must exceed the reach by this, in radii: more than the search may miss


@programs.compile_quickly()
def require_holdable(problem: Rolling) -> None:
    """Refuses an end at which the centre of mass cannot be where the robot could rest.

    It is not known, and nothing is refused, where a force or a plate's angles help, and where the place is free on a
    curved ground.

    **Raises:** :class:`DesignError` for an end that nothing can hold.
    """
    system = problem.system
    if system.force is not None or system.driven_ground:
        return
    slope, depth = _find_slope(problem), 0.0 if problem.depth is None else float(problem.depth)
    needed = float(np.hypot(np.sin(slope), depth))
    if not needed > BEYOND:  # also where the place is not on the ground
        return
    reach = _find_reach(problem)
    if reach > needed - BEYOND:
        return
    place = "" if problem.place is None else f" at `place` = {np.round(np.asarray(problem.place), 6).tolist()}"
    beside = f"on a slope of {slope:.3g} rad{place} it must be {np.sin(slope):.3g} r beside it" if slope > 0 else ""
    below = f"`depth` asks for {depth:.3g} r below it" if depth else ""
    ways = "end where the ground is less steep" if beside else "", "ask for less `depth`" if below else ""
    raise DesignError(
        "The end must be one at which the robot can rest, but the centre of mass comes at most "
        f"{reach:.3g} r away from the geometric centre, and {' and '.join(filter(None, (beside, below)))}; "
        f"{', '.join(filter(None, ways))}, or give the masses more weight or a longer way."
    )


def _find_slope(problem: Rolling) -> float:
    """Finds the slope of the ground at the end, rad; 0 where the place is free on a curved ground."""
    ground, e3 = problem.system.ground, np.array([0.0, 0.0, 1.0])
    if isinstance(ground, Ground):
        return 0.0 if ground.moves else _angle(np.asarray(ground.up()), e3)
    if not isinstance(ground, AbstractSurface) or problem.place is None:
        return 0.0
    return _angle(np.asarray(_normal_at_end(problem)), e3)


def _angle(normal: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"]) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(normal, up)), normal @ up))


@programs.jit
def _normal_at_end(problem: Rolling) -> Float[Array, "3"]:
    """Computes n where the body is at its ``place`` at the end."""
    theta, place = problem.state.theta, problem.place
    assert place is not None
    first = locate_centre(problem.packing.system, problem.end, problem.state)[: place.size]
    # Charts of curved grounds are searched from one place to the next.
    centres = jnp.zeros((STEPS_TO_PLACE, 2)).at[:, : place.size].set(jnp.linspace(first, place, STEPS_TO_PLACE))
    angles = jnp.broadcast_to(theta, (STEPS_TO_PLACE, theta.size))
    times = jnp.full(STEPS_TO_PLACE, problem.end)
    return hold_along(problem, times, centres, angles, jnp.zeros_like(angles)).normal[-1]


def _find_reach(problem: Rolling) -> float:
    """Finds how far from the geometric centre the centre of mass can be, in radii."""
    start = np.asarray(problem.state.theta)
    if not start.size:
        return float(np.sqrt(-_distance(problem, jnp.asarray(start))[0]))
    others = np.random.default_rng(SEED).uniform(-np.pi, np.pi, (STARTS - 1, start.size))

    def nearness(theta: np.ndarray) -> list[np.ndarray]:
        return [np.asarray(part) for part in _distance(problem, jnp.asarray(theta))]

    # In a tube it has no largest distance, and the search ends far away.
    least = min(minimize(nearness, theta, jac=True, method="BFGS").fun for theta in (start, *others))
    return float(np.sqrt(-least))


@programs.jit
def _distance(problem: Rolling, theta: Float[Array, " m"]) -> tuple[Float[Array, ""], Float[Array, " m"]]:
    """Computes −|p|² / (M r)², with its gradient."""
    system = problem.system

    def one(theta: Float[Array, " m"]) -> Float[Array, ""]:
        p = moment(problem, problem.end, theta) / (system.total_mass * system.radius)
        return -jnp.sum(p**2)

    return jax.value_and_grad(one)(theta)
