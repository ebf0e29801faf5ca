"""Whether a robot can rest at the end that is asked of it, by the reach of its centre of mass alone.

At rest the centre of mass is on the vertical through the contact point: on a slope α it is r sin α beside the geometric
centre, and with a ``depth`` it is that far below it, too. No equations of motion are needed to see that it cannot get
there, whereas Newton's method only fails to converge.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import minimize

from ... import programs
from ...physics.grounds import AbstractSurface
from ...physics.grounds.ground import Ground
from ..problem.run import locate_centre
from ..problem.space import DesignError
from .guess import hold_along, moment
from .rolling import Rolling

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

    def nearness(theta: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = _distance(problem, jnp.asarray(theta))
        return float(value), np.asarray(slope)

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
