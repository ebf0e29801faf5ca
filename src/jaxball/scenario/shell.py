"""Whether rails and masses stay inside the shell."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..body import Disk, System
from ..motion import AbstractPrescribedMotion, Driven, Fixed, OnRail, Oscillating
from ..rails import AbstractRail
from ..schedules import Sinusoids
from ..status import Status
from ..trajectory import Trajectory
from .lengths import length
from .values import ScenarioError, key_error

RAIL_SAMPLES = 4096
MOST_SAMPLES = 2**18
SAMPLES_PER_WAVE = 64
FLAT = 1e-9


def check_inside(system: System, times: np.ndarray) -> None:
    """Raises a :class:`ScenarioError` when a rail or a prescribed motion leaves the shell, or a disk's plane.

    A closed rail must lie inside the shell as a whole; on an open one, and in free motion, the mass
    must stay inside from the first of ``times`` to the last.
    """
    system = _on_the_host(system)
    for index, item in enumerate(system.point_masses):
        path, motion = f"masses[{index}]", item.motion
        if isinstance(motion, Fixed):
            _check_position(motion, f"{path}.position", system)
            continue
        if isinstance(motion, OnRail | Driven):
            _check_rail(motion.rail, f"{path}.rail", system)
        if isinstance(motion, Oscillating) or (isinstance(motion, OnRail) and motion.rail.period is None):
            _check_motion(motion, path, system, times)


def check_start(system: System, theta: Float[np.ndarray, " driven"]) -> None:
    """Raises a :class:`ScenarioError` when a driven mass starts outside the shell."""
    if not system.driven:
        return
    system = _on_the_host(system)
    masses, radius = system.point_masses, float(system.radius)
    for slot, index in enumerate(system.driven):
        motion = masses[index].motion
        assert isinstance(motion, Driven)
        place = np.asarray(rail_points(motion.rail, jnp.asarray(theta[slot : slot + 1])))
        distance = float(length(place)[0])
        if distance >= radius:
            raise key_error(
                "initial.theta",
                f"angles at which each mass is inside the shell of radius {radius:g}",
                f"{theta.tolist()}, which puts mass {index} at the distance {distance:.6g} from the centre",
            )


def mark_escape(trajectory: Trajectory) -> Trajectory:
    """The trajectory, with the status LEFT_SHELL if a driven mass is outside the shell at a saved time.

    ``reached`` is then the first such time. Prescribed motions are the business of :func:`check_inside`.
    """
    if not trajectory.ok or not trajectory.system.driven:
        return trajectory
    distance = length(np.asarray(trajectory.observables.mass_positions_body))
    outside = np.flatnonzero(np.max(distance, axis=1) > float(trajectory.system.radius))
    if not outside.size:
        return trajectory
    status = jnp.asarray(int(Status.LEFT_SHELL), dtype=trajectory.status.dtype)
    when = jnp.asarray(trajectory.times)[outside[0]]
    return eqx.tree_at(lambda x: (x.status, x.reached), trajectory, (status, when))


@eqx.filter_jit
def rail_points(rail: AbstractRail, theta):
    """ζ at many θ, compiled once for a family of rails."""
    return rail.points(theta)


@eqx.filter_jit
def _places(motion: AbstractPrescribedMotion, times):
    prepared: Any = motion.prepare()
    return jax.vmap(lambda t: prepared.kinematics(t).chi)(times)


def _on_the_host(system: System) -> System:
    """The system with NumPy arrays, which are taken apart much faster."""
    return jax.tree.map(np.asarray, system)


def _check_position(motion: Fixed, path: str, system: System) -> None:
    place, radius = np.asarray(motion.position, dtype=float), float(system.radius)
    if not length(place) < radius:
        raise key_error(path, f"a point inside the shell of radius {radius:g}", str(place.tolist()))
    _check_plane(place[None], path, system)


def reach(
    rail: AbstractRail, radius: float
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Many θ, the points of a rail there, and how far it comes from the centre near each of them.

    They go once round a closed rail, and along an open one from 0 to ``radius``.
    """
    theta = np.linspace(0.0, radius if rail.period is None else rail.period, RAIL_SAMPLES + 1)
    points = np.asarray(rail_points(rail, jnp.asarray(theta)))
    return theta, points, _peaks(length(points))


def _check_rail(rail: AbstractRail, path: str, system: System) -> None:
    radius = float(system.radius)
    theta, points, distance = reach(rail, radius)
    _check_plane(points, path, system)
    k = int(np.argmax(distance))
    if rail.period is not None and not distance[k] < radius:
        raise ScenarioError(
            f"Key `{path}` must be a curve inside the shell of radius {radius:g}, but it is "
            f"{distance[k]:.6g} from the centre at theta = {theta[k]:.6g}."
        )


def _check_motion(motion: AbstractPrescribedMotion, path: str, system: System, times: np.ndarray) -> None:
    path = f"{path}.free" if isinstance(motion, Oscillating) else f"{path}.schedule"
    radius, t = float(system.radius), _sample_times(motion, times)
    places = np.asarray(_places(motion, jnp.asarray(t)))
    _check_plane(places, path, system)
    outside = np.flatnonzero(~(_peaks(length(places)) < radius))
    if not outside.size:
        return
    k = int(outside[0])
    fine = np.linspace(t[max(k - 1, 0)], t[k], t.size)
    beyond = ~(length(np.asarray(_places(motion, jnp.asarray(fine)))) < radius)
    when = float(fine[int(np.argmax(beyond))]) if np.any(beyond) else float(t[k])
    raise ScenarioError(
        f"Key `{path}` must keep the mass inside the shell of radius {radius:g} from t = {times[0]:g} to "
        f"t = {times[-1]:g}, but the mass leaves it at t = {when:.6g}."
    )


def _sample_times(motion: AbstractPrescribedMotion, times: np.ndarray) -> np.ndarray:
    """Times fine enough for the fastest sinusoid, the kinks among them."""
    start, end = float(times[0]), float(times[-1])
    waves = motion.path if isinstance(motion, Oscillating) else getattr(motion, "schedule", None)
    series = waves.series if isinstance(waves, Sinusoids) else waves
    fastest = float(np.max(np.abs(getattr(series, "frequency", np.zeros(1))), initial=0.0))
    wanted = max(RAIL_SAMPLES, SAMPLES_PER_WAVE * fastest * (end - start) / (2 * np.pi))
    even = np.linspace(start, end, int(min(2 ** np.ceil(np.log2(wanted)), MOST_SAMPLES)) + 1)
    kinks = np.asarray(jax.tree.map(jnp.asarray, motion).kinks(), dtype=float)
    return np.unique(np.concatenate([even, kinks[(kinks > start) & (kinks < end)]]))


def _peaks(y: np.ndarray) -> np.ndarray:
    """``y``, which may be infinite, its local maxima raised to the top of the parabola through the nearest samples."""
    with np.errstate(invalid="ignore"):
        before, after = y[1:-1] - y[:-2], y[1:-1] - y[2:]
        bend = before + after
        peak = (before >= 0) & (after >= 0) & (bend > 0)
        slope = np.where(peak, before - after, 0.0)
        rise = slope * (slope / np.where(peak, bend, 1.0)) / 8
    return np.concatenate([y[:1], y[1:-1] + rise, y[-1:]])


def _check_plane(points: np.ndarray, path: str, system: System) -> None:
    if isinstance(system, Disk) and np.max(np.abs(points[:, 1])) > FLAT * float(system.radius):
        worst = points[int(np.argmax(np.abs(points[:, 1])))]
        raise ScenarioError(
            f"Key `{path}` must lie in the plane of a disk, E1 and E3, but it passes "
            f"{[round(x, 6) for x in worst.tolist()]}."
        )
