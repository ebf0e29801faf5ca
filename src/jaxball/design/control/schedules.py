"""The schedules of the masses in a solution, as a scenario, and that scenario simulated."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...physics.schedules import PiecewiseAcceleration
from ...scenario import Scenario
from ...scenario.initial import starting_angles
from ..constraints import AbstractRunningConstraint
from ..run import Run
from .rolling import rolling
from .solution import PLACES, Solution


def schedules_of(solution: Solution) -> list[PiecewiseAcceleration]:
    """θ(t) of each mass: θ̈ is the polynomial u on each interval, so that at the knots θ and θ̇ are the solution's.

    **Arguments:**

    - ``solution``: a :class:`Solution` of a :class:`Rolling`.
    """
    problem, path = rolling(solution.problem), solution.path
    powers = np.arange(path.controls.shape[1])
    coefficients = path.control_coefficients / np.diff(path.mesh)[:, None, None] ** powers[:, None]
    return [
        PiecewiseAcceleration(theta, path.mesh, coefficients[:, :, k], rate)
        for k, (theta, rate) in enumerate(zip(problem.state.theta, problem.state.thetadot, strict=True))
    ]


def scenario_of(solution: Solution, title: str = "", saves: int = 201) -> Scenario:
    """The scenario in which the masses move as the solution asks for, which ``jaxball simulate`` runs.

    **Arguments:**

    - ``solution``: a :class:`Solution` of a :class:`Rolling`.
    - ``title``: of the scenario.
    - ``saves``: how many times are saved.
    """
    problem = rolling(solution.problem)
    state = problem.state
    names = [field.name for field in dataclasses.fields(state) if not field.name.startswith("theta")]
    fields = {name: getattr(state, name) for name in names}
    times = np.linspace(float(problem.start), float(problem.end), saves)
    return Scenario(title, problem.with_schedules(schedules_of(solution)), type(state)(**fields), times)


class Resimulated(NamedTuple):
    """A simulation of a solution's schedules beside the solution; lengths in radii.

    - ``apart``: the largest distance between the simulated path and the solution's.
    - ``speed``: the largest of |Ω| and |θ̇| at the end.
    - ``away``, ``below``: the horizontal distance of the centre of mass from the geometric centre at the end, and how
      far it is below.
    - ``missed``: the distance of the geometric centre from its place at the end; 0 where it is free.
    - ``margin``: the least normal force, over M g; ``friction``: the largest |f| / N. Both at the saved times.
    - ``violations``: by how much each constraint is violated at most; negative where it holds everywhere.
    """

    apart: float
    speed: float
    away: float
    below: float
    missed: float
    margin: float
    friction: float
    violations: dict[str, float]


def resimulated(solution: Solution, solver: str = "gauss16", tolerance: float = 1e-11) -> Resimulated:
    """The solution's schedules simulated by a solver of another kind.

    Constraints are evaluated ten times an interval of the mesh.

    **Arguments:**

    - ``solution``: a :class:`Solution` of a :class:`Rolling`.
    - ``solver``: its name, as in a scenario file.
    - ``tolerance``: of that solver.

    **Raises:** :class:`~jaxball.SolveError` where the solve fails.
    """
    problem, scenario = rolling(solution.problem), scenario_of(solution)
    if problem.constraints:
        scenario = dataclasses.replace(scenario, times=np.unique(solution.path.within(PLACES)))
    run = scenario.simulate(solver=solver, rtol=tolerance, atol=tolerance, throw=True)
    seen, M, r = run.observables, float(problem.system.total_mass), float(problem.system.radius)
    gap = np.asarray(run.state.z) - places(solution, np.asarray(run.times))
    thetadot = starting_angles(tuple(schedules_of(solution)), problem.end)["thetadot"]
    centre = np.asarray(seen.centre_of_mass_space[-1])
    missed = 0.0 if problem.place is None else np.linalg.norm(run.state.z[-1] - problem.place)
    masses_on_rails = problem.with_schedules(schedules_of(solution))
    return Resimulated(
        apart=float(np.max(np.abs(gap) if gap.ndim == 1 else np.linalg.norm(gap, axis=1))) / r,
        speed=float(max(np.linalg.norm(seen.angular_velocity_body[-1]), np.max(np.abs(thetadot)))),
        away=float(np.linalg.norm(centre[:2])) / r,
        below=-float(centre[2]) / r,
        missed=float(missed) / r,
        margin=float(np.min(seen.normal_force)) / (M * float(problem.system.gravity)),
        friction=float(np.max(seen.friction_ratio)),
        violations=_violations(
            Run(masses_on_rails, jnp.asarray(run.times), run.state, run.status), problem.constraints
        ),
    )


def _violations(run: Run, constraints: dict[str, AbstractRunningConstraint]) -> dict[str, float]:
    largest = eqx.filter_jit(lambda run: {name: jnp.max(one(run)) for name, one in constraints.items()})(run)
    return {name: float(by) for name, by in largest.items()}


def places(solution: Solution, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k *d"]:
    """Where a solution has the geometric centre: (z1, z2) of a ball, z of a disk.

    **Arguments:**

    - ``solution``: a :class:`Solution` of a :class:`Rolling`.
    - ``times``: shape (k,).
    """
    packing = rolling(solution.problem).packing
    unpacked = jax.jit(jax.vmap(packing.unpack))(jnp.asarray(times), jnp.asarray(solution.path.states(times)))
    return np.asarray(unpacked.z)
