"""How far a motion is from the exact one: its path, its slip and its energy."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxball import Scenario
from jaxball.numerics.arrays import to_array
from jaxball.physics.body import Disk, System
from jaxball.physics.contact.released import ReleasedState, energy_of_released, slip_velocity
from jaxball.physics.state import BallState, DiskState
from jaxball.simulation.trajectory import Trajectory

from .contract import Motion


class Exact(NamedTuple):
    """The exact motion: the centre's path, its speed of slip and energy at each time, and the units of errors."""

    path: Float[np.ndarray, "T 2"]
    slip: Float[np.ndarray, " T"]
    energy: Float[np.ndarray, " T"]
    radius: float
    weight: float  # M g r
    speed: float  # √(g r)


class Errors(NamedTuple):
    """The largest errors over the run: of the path in radii, of the speed of slip in √(g r), of the energy in M g r."""

    path: float
    slip: float
    energy: float


def exact(scenario: Scenario) -> Exact:
    """The motion by a run of the scenario; raises a ``RuntimeError`` if the run fails."""
    system: Any = scenario.system
    run = scenario.simulate(throw=True)
    r = float(system.radius)
    g = float(system.gravity)
    return Exact(*_measure(run), r, float(system.total_mass) * g * r, float(np.sqrt(g * r)))


def of_run(run: Trajectory[Any, Any], true: Exact) -> Errors:
    """The errors of another run of the scenario."""
    return _between(*_measure(run), true)


def _measure(run: Trajectory[Any, Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Measures the path, the speed of slip and the energy along a run."""
    path = np.asarray(run.observables.geometric_centre)[:, :2]
    slips = np.linalg.norm(run.history.over_time.get("slip", np.zeros((len(path), 3))), axis=-1)
    return path, slips, np.asarray(run.observables.energy)


def errors(scenario: Scenario, motion: Motion, true: Exact) -> Errors:
    """The errors of a motion."""
    system: Any = scenario.system
    speed, energy = _of_states(system, to_array(scenario.times), states(system, motion))
    return _between(motion.centre[:, :2], np.asarray(speed), np.asarray(energy), true)


def _between(path: np.ndarray, slip: np.ndarray, energy: np.ndarray, true: Exact) -> Errors:
    return Errors(
        float(np.max(np.linalg.norm(path - true.path, axis=-1))) / true.radius,
        float(np.max(np.abs(slip - true.slip))) / true.speed,
        float(np.max(np.abs(energy - true.energy))) / true.weight,
    )


def states(system: System, motion: Motion) -> ReleasedState:
    """A motion as the states of a body that need not roll."""
    height = motion.centre[:, 2] - float(system.radius)
    if isinstance(system, Disk):
        phidot = -motion.Omega[:, 1]
        phi = -2 * np.unwrap(np.arctan2(motion.q[:, 2], motion.q[:, 0]))
        body = DiskState(phi=phi, phidot=phidot, z=motion.centre[:, 0], theta=motion.theta, thetadot=motion.thetadot)
    else:
        body = BallState(motion.q, motion.Omega, motion.centre[:, :2], motion.theta, motion.thetadot)
    return ReleasedState(body, motion.V, height)


@eqx.filter_jit
def _of_states(system: System, times: Any, state: ReleasedState) -> tuple[Any, Any]:
    """The speed of slip along the plane, and the energy."""
    system = system.prepare()

    def one(t: Any, state: ReleasedState) -> tuple[Any, Any]:
        slip = slip_velocity(system, t, state)
        return jnp.sqrt(jnp.sum(slip[:2] ** 2)), energy_of_released(system, t, state)

    return jax.vmap(one)(times, state)
