"""Equilibrium: what would set a body at rest in motion, and where its masses must be for it to rest.

It rests where its centre of mass is on the vertical through the contact point, and nothing moves its free joints.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Bool, Float

from .. import programs
from ..interface.arguments import refusal, require, require_count
from ..interface.printing import Printed
from ..numerics.arrays import Numbers, to_array, to_numpy
from ..numerics.vectors import apply, cross, dot
from ..physics.body import Ball, Disk, System
from ..physics.dynamics.coupling import join_coordinates, joint_forces, linkages, with_free_joints
from ..physics.dynamics.equations import angles_in_state
from ..physics.dynamics.load import load
from ..physics.dynamics.moments import kinematics, point_mass_values, velocity_moments
from ..physics.dynamics.parameters import BodyParameters
from ..physics.grounds import AbstractSurface
from ..physics.grounds.ground import Ground, require_plane
from ..physics.grounds.surface import ON_CHART, Coordinates
from ..physics.state import BallState, DiskState, PlacedState, RotationState, State

STARTS = 256
BALANCED = 1e-10  # of the radius: the centre of mass is this close to the vertical, ...
ROUNDING = 64  # ... or this close in units of rounding, which in float32 is more
SAME_BALANCE = 1e-6  # between angles, or the square root of rounding where that is more, as in float32
# What counts as motion of a ground, and how far beside a body it is looked for, in radii.
STILL, BESIDE = 1e-9, 1e-3


class Balance(Printed):
    """The outcome of :func:`balance`.

    - ``ok``: whether there is a solution.
    - ``theta``: the angles of the free masses, rad on a closed rail and length in a tube, shape (k,); without a
      solution, the nearest miss.
    - ``above``: whether the centre of mass is then above the geometric centre; on a slope, higher than it.
    - ``residual``: the distance, a length, of the centre of mass from the vertical through the contact point; on a
      level plane this vertical passes through the geometric centre.
    - ``solutions``, ``solutions_above``: every solution found, shape (n, k), and its ``above``, shape (n,); the
      chosen one first.
    - ``message``: a sentence that says all this.

    **Example:**

    >>> from jaxball import Circle, ConstantRate, Disk, OnRail, PointMass, balance
    >>> mass = PointMass(0.5, OnRail(Circle(0.5), ConstantRate(-1.0)))
    >>> balanced = balance(Disk(mass=1.0, inertia=0.5, masses=[mass]), [0], above=True)
    >>> balanced.above, round(float(balanced.theta[0]), 6)
    (True, 1.570796)
    """

    ok: bool
    theta: Float[Array, " k"]
    above: bool
    residual: float
    solutions: Float[Array, "n k"]
    solutions_above: Bool[Array, " n"]
    message: str

    def __repr__(self) -> str:
        others = len(self.solutions) - 1
        number = "one other solution" if others == 1 else f"{others} other solutions"
        more = f"\n  and {number}, in `solutions`" if others > 0 else ""
        return f"Balance: {self.message}{more}"


def balance(
    system: System,
    free: Sequence[int],
    *,
    guess: Numbers | None = None,
    above: bool | None = None,
    state: State | None = None,
    t: Numbers = 0.0,
) -> Balance:
    """Solves for angles that put the system's centre of mass above or below the geometric centre.

    On a slope, of a plane or of a surface at the ``z`` of ``state``, they put it on the vertical through the contact
    point instead, where the weight has no moment about this point, so that a body whose masses do not move can rest. No
    angles do so where the slope is so steep that r sin a exceeds the greatest possible distance of the centre of mass
    from the geometric centre.

    This is how section 5 finds its θ_a: the paper fixes θ1 = 0 and solves for θ2 and θ3. The search starts from many
    points at once and reports all solutions that it finds: for the paper's ball there are two. Where more than two
    angles are free, solutions are not isolated, and each start may find another.

    **Arguments:**

    - ``system``: a :class:`~jaxball.Ball` or a :class:`~jaxball.Disk`.
    - ``free``: the indices (from 0) of the masses whose θ is free; each must be on a rail.
    - ``guess``: the solution nearest to it is chosen; if not given, the one nearest to the angles of the masses at
      ``t``.
    - ``above``: True or False to accept only a centre of mass above, or below, the geometric centre; on a slope, only
      one that is higher, or lower, than this centre.
    - ``state``: gives the orientation, θ of the driven masses, and the place on a surface; upright at ``z`` = 0 if not
      given.
    - ``t``: the time at which the schedules and free motions are read.

    **Raises:** ``ValueError`` when ``free`` names no mass or one that is not on a rail, when ``guess`` has another
    length, when the ground moves or has a turntable, and when the place is not on it.

    **Example:**

    >>> from jaxball import Circle, ConstantRate, Disk, OnRail, PointMass, balance
    >>> mass = PointMass(0.5, OnRail(Circle(0.5), ConstantRate(-1.0)))
    >>> balance(Disk(mass=1.0, inertia=0.5, masses=[mass]), [0])
    Balance: With the angles (-1.570796327) the centre of mass is exactly below the geometric centre.
      and one other solution, in `solutions`
    """
    require("system", system, (Ball, Disk), "a Ball or a Disk")
    require("above", above, (bool, np.bool_, type(None)), "True, False or None")
    up, normal = _up_and_normal(system, state, t)
    if isinstance(free, str) or not isinstance(free, Sequence | np.ndarray):
        raise refusal("free", "a list of indices of masses", free)
    rails, now = _free_rails(system, free, state, t)
    guess = now if guess is None else to_numpy(guess, "guess")
    require_count("Argument `guess`", guess.shape, len(now), "mass in `free`")
    offset, masses, total, Lambda = _others(system, free, state, t)
    starts = _starts(rails, np.asarray(system.radius), guess)
    prepared = tuple(rail.prepare() for rail in rails)
    candidates = _search(prepared, masses, offset, total, Lambda, system.radius * normal, up, to_array(starts))
    end = _Candidates(*(np.array(x) for x in candidates))
    return _choose(end, rails, guess, above, float(system.radius), sloping=bool(dot(up, normal) < 1))


def with_angles(system: System, free: Sequence[int], theta: Numbers, t: Numbers = 0.0) -> System:
    """Returns the same system with the schedules of the masses ``free`` moved so that they have ``theta`` at ``t``.

    **Arguments:**

    - ``system``: a :class:`~jaxball.Ball` or a :class:`~jaxball.Disk`.
    - ``free``: indices of masses, from 0.
    - ``theta``: their angles, rad on a closed rail and length in a tube, shape (k,).
    - ``t``: the time at which they have them.

    **Raises:** ``ValueError`` where there is no such mass, or it has no schedule, and unless each has an angle.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Circle, ConstantRate, Disk, OnRail, PointMass
    >>> from jaxball.simulation import with_angles
    >>> mass = PointMass(0.5, OnRail(Circle(0.5), ConstantRate(0.0, rate=2.0)))
    >>> moved = with_angles(Disk(mass=1.0, inertia=0.5, masses=[mass]), [0], [1.0], t=3.0)
    >>> schedule = moved.point_masses[0].motion.schedule
    >>> float(schedule(jnp.array(3.0)))
    1.0
    """
    masses, angles = list(system.point_masses), to_array(theta, "theta")
    if not isinstance(free, Sequence | np.ndarray):
        raise refusal("free", "a list of numbers of masses, from 0, such as [0, 2]", free)
    require_count("Argument `theta`", angles.shape, len(free), "mass in `free`")
    for index, angle in zip(free, angles, strict=True):
        if not -len(masses) <= index < len(masses):
            raise ValueError(
                f"Argument `free` must name masses of the body, from 0 to {len(masses) - 1}, but it names {index}."
            )
        schedule = masses[index].schedule
        if schedule is None:
            kind = type(masses[index].motion).__name__
            raise ValueError(
                f"Argument `free` must name masses with a schedule, but mass {index} is {kind}; "
                "give the angle of a driven mass in the initial state."
            )
        masses[index] = masses[index].follow(schedule.starting_at(angle, to_array(t)))
    return system.with_masses(masses, system.law)


def _free_rails(system, free, state, t):
    rails, angles = [], []
    masses = system.point_masses
    for index in free:
        if index not in system.on_rails:
            raise ValueError(
                f"Argument `free` must name masses on a rail, from 0 to {len(masses) - 1}, but it names {index}."
            )
        rails.append(masses[index].rail)
        if (schedule := masses[index].schedule) is not None:
            angles.append(float(schedule.prepare()(to_array(t))))
        else:
            angles.append(0.0 if state is None else float(state.theta[system.driven.index(index)]))
    if not rails:
        raise ValueError("Argument `free` must name at least one mass, but it is empty.")
    return rails, np.asarray(angles)


def _up_and_normal(system: System, state: State | None, t: Numbers) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Returns upwards, and the normal of the ground at the contact point, space axes; refuses a ground that moves."""
    ground, e3 = system.ground, to_array([0.0, 0.0, 1.0])
    must = "be on a plane at rest, where the weight alone decides whether a body rests, but its `ground`"
    if isinstance(ground, AbstractSurface):
        if ground.driven:
            raise ValueError(f"Argument `system` must {must} is driven by its law.")
        state = system.upright_state() if state is None else state
        if not isinstance(state, PlacedState):
            raise refusal("state", "a state with the place of the body on its ground", state)
        normal, moves = _hold_at_rest(ground, to_array(t), system.radius, state.z)
        if not jnp.all(jnp.isfinite(normal)):
            raise ValueError(f"Argument `state` must have {ON_CHART} as `z`, but it is {np.asarray(state.z).tolist()}.")
        if moves:
            raise ValueError(f"Argument `system` must {must.replace('plane', 'ground')} moves there at t = {t}.")
        return e3, normal
    if ground is not None and not isinstance(ground, Ground):
        require_plane(ground, "`balance`")
    if isinstance(ground, Ground) and ground.moves:
        raise ValueError(f"Argument `system` must {must} has a {ground.moves}.")
    return (e3 if ground is None else ground.up()), e3


@programs.filter_jit
def _hold_at_rest(
    ground: AbstractSurface, t: Float[Array, ""], r: Float[Array, ""], z: Coordinates
) -> tuple[Float[Array, "3"], Bool[Array, ""]]:
    """Returns the normal of a surface under a body at rest, and whether its matter moves or begins to move there."""
    held = ground.prepare().footing(t, r, z, jnp.zeros(3, t.dtype))
    moves = [part for part in (held.velocity, held.acceleration, held.spin) if part is not None]
    assert held.normal is not None
    return held.normal, jnp.any(jnp.stack(moves) != 0)


@programs.filter_jit
def moves_under(
    surface: AbstractSurface, t: Float[Array, ""], r: Float[Array, ""], g: Float[Array, ""], z: Coordinates
) -> Bool[Array, ""]:
    """Returns whether a prepared surface moves, or begins to, where a body of radius ``r`` is at rest, and beside that.

    Motion is what exceeds rounding, in units of g and ``r``. A rigid surface that is at rest in three places is so
    everywhere.
    """
    steps = jnp.concatenate(
        [jnp.zeros_like(z)[None], BESIDE * r * jnp.eye(z.size, dtype=z.dtype).reshape(-1, *z.shape)]
    )
    held = jax.vmap(lambda step: surface.footing(t, r, z + step, jnp.zeros(3, t.dtype)))(steps)
    speed = jnp.sqrt(g * r)
    units = ((held.velocity, speed), (held.acceleration, g), (held.spin, speed / r))
    return jnp.any(jnp.stack([jnp.abs(part) / unit for part, unit in units if part is not None]) > STILL)


def _others(system, free, state, t):
    """Computes Σ m χ of all but the free masses; returns it with the free masses' m, M, and Λ."""
    t = to_array(t)
    state = system.upright_state() if state is None else state
    chi = kinematics(system, t, angles_in_state(system, t, state)).chi
    m = point_mass_values(system)
    held = np.setdiff1d(np.arange(chi.shape[0]), np.asarray(free))
    offset = system.mass * system.offset + jnp.sum(m[held, None] * chi[held], axis=0)
    return offset, m[np.asarray(free)], system.total_mass, state.Lambda


def _starts(rails, radius, guess):
    """Returns the guess and an even cover of the box of all angles (the R-sequence of Roberts)."""
    k = len(rails)
    # The root of xᵏ⁺¹ = x + 1, the golden ratio for one angle, by which the points are spread.
    ratio = 2.0
    for _ in range(60):
        ratio = (1 + ratio) ** (1 / (k + 1))
    steps = (1 / ratio) ** np.arange(1, k + 1)
    unit = (0.5 + np.arange(1, STARTS)[:, None] * steps) % 1
    low = np.array([-radius if rail.period is None else 0.0 for rail in rails])
    width = np.array([2 * radius if rail.period is None else rail.period for rail in rails])
    return np.concatenate([guess[None], low + unit * width])


@programs.filter_jit
def _search(rails, masses, offset, total, Lambda, over_contact, up, starts):
    def places(theta):
        return jnp.stack([rail(angle) for rail, angle in zip(rails, theta, strict=True)])

    def centre(theta):
        return apply(Lambda, offset + jnp.sum(masses[:, None] * places(theta), axis=0)) / total

    def aside(theta):
        """Computes the vector from the contact point to the centre of mass × the vertical."""
        return cross(over_contact + centre(theta), up)

    def one(start):
        # Least squares, because there are as many angles as there are masses, more or fewer than conditions, and there
        # need not be a solution.
        solution = optimistix.least_squares(
            lambda theta, _: aside(theta),
            optimistix.LevenbergMarquardt(rtol=1e-14, atol=1e-14),
            start,
            max_steps=200,
            throw=False,
        )
        theta = solution.value
        farthest = jnp.max(jnp.sum(places(theta) ** 2, axis=1))
        return theta, jnp.sqrt(jnp.sum(aside(theta) ** 2)), dot(centre(theta), up), jnp.sqrt(farthest)

    return jax.vmap(one)(starts)


class _Candidates(NamedTuple):
    """Where the search ended from each start."""

    theta: np.ndarray
    miss: np.ndarray  # distance of the centre of mass from the vertical
    height: np.ndarray  # of the centre of mass over the geometric centre
    farthest: np.ndarray  # distance of the outermost free mass from the geometric centre


def _choose(end: _Candidates, rails, guess, above, radius, sloping) -> Balance:
    # On an open rail, the search may leave the shell.
    theta, miss = end.theta, np.where(end.farthest < radius, end.miss, np.inf)
    for j, rail in enumerate(rails):
        if rail.period is not None:
            # Of angles that differ by full turns, the one nearest to the guess.
            theta[:, j] = guess[j] + (theta[:, j] - guess[j] + rail.period / 2) % rail.period - rail.period / 2
    rounding = float(np.finfo(end.miss.dtype).eps)
    good = miss < max(BALANCED, ROUNDING * rounding) * radius
    if above is not None:
        good &= (end.height > 0) == above
    indices, apart = list[int](), max(SAME_BALANCE, rounding**0.5)
    for i in np.argsort(np.sum((theta - guess) ** 2, axis=1), kind="stable"):
        if good[i] and all(np.max(np.abs(theta[i] - theta[j])) > apart for j in indices):
            indices.append(int(i))
    best = indices[0] if indices else int(np.argmin(np.where(np.isfinite(miss), miss, np.inf)))
    return Balance(
        ok=bool(indices),
        theta=to_array(theta[best]),
        above=bool(end.height[best] > 0),
        residual=float(miss[best]),
        solutions=to_array(theta[indices]),
        solutions_above=jnp.asarray(end.height[indices] > 0),
        message=_message(bool(indices), theta[best], miss[best], end.height[best], above, sloping),
    )


def _message(success, theta, miss, height, above, sloping) -> str:
    side = "above" if height > 0 else "below"
    angles = ", ".join(f"{angle:.10g}" for angle in theta)
    position = side if success else {None: "above or below", True: "above", False: "below"}[above]
    goal = f"exactly {position} the geometric centre"
    if sloping:
        side_wanted = {"above": ", higher than the centre", "below": ", lower than the centre"}.get(position, "")
        goal = f"on the vertical through the contact point{side_wanted}"
    if success:
        return f"With the angles ({angles}) the centre of mass is {goal}."
    return (
        f"No angles of these masses put the centre of mass {goal}; the angles ({angles}) leave it {miss:.3g} from the "
        f"vertical, {side} the centre."
    )


class Imbalance(NamedTuple):
    """What would set a body at rest in motion; all of it is 0 in equilibrium.

    - ``torque``: of the load about the contact point, space axes, mass length²/time².
    - ``efforts``: on each free joint, its force minus that which would hold up its masses; 0 for joints that a law
      drives.
    - ``p``, ``weight``: Λp = Σ m Λχ, and γ, what a unit of mass weighs, upward; space axes.
    - ``M``: the whole mass.
    """

    torque: Float[Array, "3"]
    efforts: Float[Array, " coordinates"]
    p: Float[Array, "3"]
    weight: Float[Array, "3"]
    M: Float[Array, ""]

    @property
    def beside(self) -> Float[Array, "2"]:
        """The horizontal distance of the centre of mass from where it could rest; on a level plane, from the centre."""
        # The torque of the weight is γ × Σ m s: with γ upwards, the horizontal lever turned by a right angle.
        turned = jnp.stack([self.torque[1], -self.torque[0]])
        return turned / (self.M * self.weight[2])

    @property
    def below(self) -> Float[Array, ""]:
        """How far the centre of mass is below the geometric centre, along the vertical, length."""
        size = jnp.sqrt(jnp.sum(self.weight**2))
        return -jnp.sum(self.p * self.weight) / (self.M * size)


def imbalance(system: BodyParameters, t: Float[Array, ""], state: BallState | RotationState | DiskState) -> Imbalance:
    """Computes the imbalance of a body in the configuration of ``state``, with all velocities 0; ``system`` is
    prepared.
    """
    still = eqx.tree_at(lambda s: s.thetadot, state, jnp.zeros_like(state.thetadot))
    still = still.with_Omega(jnp.zeros_like(state.Omega))
    angles = (still.theta, still.thetadot, still.thetadot)
    links = linkages(system, t, angles)
    body_moments, acting = velocity_moments(system, t, angles[:2], links), load(system, t, still)
    weight = acting.weight
    joints = zip(with_free_joints(links), joint_forces(t, still, links), strict=True)
    efforts = [Q - jnp.sum(link.weights * weight[None, None], axis=-1) for link, Q in joints]
    Lambda = state.Lambda
    return Imbalance(
        torque=apply(Lambda, acting.about_contact(body_moments, system.radius)),
        efforts=join_coordinates(still.thetadot, links, efforts),
        p=apply(Lambda, body_moments.p),
        weight=apply(Lambda, weight),
        M=body_moments.M,
    )
