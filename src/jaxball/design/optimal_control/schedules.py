"""Turns a solution into schedules and motors' signals, puts these into its scenario, and simulates that."""

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import programs
from ...physics.body import System
from ...physics.prescribed.schedules import PiecewiseAcceleration
from ...physics.prescribed.signals import PiecewiseSignal
from ...physics.state import BallState, DiskState
from ...programs.batches import map_rows
from ...scenario import Scenario
from ...scenario.initial import starting_angles
from ...simulation.equilibrium import imbalance
from ..problem.run import Run, locate_centre
from .inputs import with_free_joints
from .rolling import Rolling, rolling
from .solution import POINTS_OF_INTERVAL, Solution


def schedules_of(solution: Solution) -> list[PiecewiseAcceleration]:
    """Returns θ(t) of the accelerated coordinates of a ``solution`` of a :class:`Rolling`, masses first and then
    joints.

    θ̈ is the polynomial u on each interval, so that at the knots θ and θ̇ are the solution's.
    """
    problem, mesh = rolling(solution.problem), solution.path.mesh
    places = np.asarray(problem.system.accelerated, dtype=int)
    start = zip(problem.state.theta[places], problem.state.thetadot[places], strict=True)
    polynomials = _polynomials(solution)[: len(places)]
    return [
        PiecewiseAcceleration(theta, mesh, values, rate)
        for values, (theta, rate) in zip(polynomials, start, strict=True)
    ]


def signals_of(solution: Solution) -> list[PiecewiseSignal]:
    """Returns Q(t) of each motor in a ``solution`` of a :class:`Rolling`.

    It is the polynomial u on each interval, then, for as long again, the values of :func:`holding`.
    """
    first, mesh = len(rolling(solution.problem).system.accelerated), solution.path.mesh
    # A run that goes on past the end shows the robot at rest, for as long again.
    times = np.append(mesh, 2 * mesh[-1] - mesh[0])
    constant = np.eye(1, solution.path.controls.shape[1])
    return [
        PiecewiseSignal(times, np.concatenate([values, value * constant]))
        for values, value in zip(_polynomials(solution)[first:], holding(solution), strict=True)
    ]


def holding(solution: Solution) -> Float[np.ndarray, " motors"]:
    """Computes the force or torque of each motor that holds the robot at the end of a ``solution`` of a
    :class:`Rolling`.
    """
    problem = rolling(solution.problem)
    return np.asarray(_holding(problem, jnp.asarray(solution.path.knots[-1])))


@programs.jit
def _holding(problem: Rolling, x: Float[Array, " n"]) -> Float[Array, " motors"]:
    return -problem.imbalance_at_end(x).efforts[problem.motor_slots]


def _polynomials(solution: Solution) -> Float[np.ndarray, "m N s"]:
    """Computes the coefficients of each control, for the powers of the time since the start of each interval."""
    path = solution.path
    powers = np.arange(path.controls.shape[1])
    # `control_coefficients` are for fractions of an interval.
    coefficients = path.control_coefficients / np.diff(path.mesh)[:, None, None] ** powers[:, None]
    return np.moveaxis(coefficients, 2, 0)


def system_of(solution: Solution) -> System:
    """Returns the robot with the motion of a ``solution`` of a :class:`Rolling`."""
    return rolling(solution.problem).with_schedules(schedules_of(solution), signals_of(solution))


@programs.compile_quickly()
def scenario_of(solution: Solution, title: str = "", saves: int = 201) -> Scenario:
    """Returns the scenario with the motion of a solution, for ``jaxball simulate``.

    **Arguments:**

    - ``solution``: a :class:`Solution` of a :class:`Rolling`.
    - ``title``: of the scenario.
    - ``saves``: the number of save times.
    """
    problem = rolling(solution.problem)
    times = np.linspace(float(problem.start), float(problem.end), saves)
    return Scenario(title, system_of(solution), with_free_joints(problem.system, problem.state), times)


class Resimulated(NamedTuple):
    """A simulation of a solution's schedules compared with the solution; lengths in radii.

    - ``apart``: the largest distance between the simulated path and the solution's.
    - ``speed``: the largest of |Ω| and |θ̇| at the end.
    - ``away``, ``below``: at the end, how far the centre of mass is beside the vertical through the contact point, and
      below the geometric centre.
    - ``missed``: the distance of the geometric centre from ``place`` at the end; 0 where that is free.
    - ``margin``: the least normal force, over M g; ``friction``: the largest |f| / N. Both at the saved times.
    - ``violations``: the largest violation of each constraint; negative where it holds everywhere.
    """

    apart: float
    speed: float
    away: float
    below: float
    missed: float
    margin: float
    friction: float
    violations: dict[str, float]


@programs.compile_quickly()
def resimulate(solution: Solution, solver: str = "gauss16", tolerance: float = 1e-11) -> Resimulated:
    """Simulates the solution's schedules by a solver of another kind.

    Constraints are evaluated ten times per interval of the mesh.

    **Arguments:**

    - ``solution``: a :class:`Solution` of a :class:`Rolling`.
    - ``solver``: its name, as in a scenario file.
    - ``tolerance``: of that solver.

    **Raises:** :class:`~jaxball.SolveError` where the solve fails.
    """
    problem, scenario = rolling(solution.problem), scenario_of(solution)
    if problem.constraints:
        # Ends of intervals belong to two of them.
        scenario = dataclasses.replace(scenario, times=np.unique(solution.path.within(POINTS_OF_INTERVAL)))
    run = scenario.simulate(solver=solver, rtol=tolerance, atol=tolerance, throw=True)
    system = run.system
    seen, M, r = run.observables, float(problem.system.total_mass), float(problem.system.radius)
    times = jnp.asarray(run.times)
    centres = np.asarray(_centres(system.prepare(), times, run.state))
    gap = centres - _centres_of(solution, np.asarray(times))
    schedules = schedules_of(solution)
    # θ̇ of a mass or a joint with a schedule is not in the state of the simulation.
    rates = [*starting_angles(tuple(schedules), problem.end)["thetadot"]] if schedules else []
    whole = Run(system, times, run.state, run.status)
    largest = _largest(problem.constraints, whole)
    beside, below = _off_balance(system, problem.end, jax.tree.map(lambda leaf: leaf[-1], run.state))
    # `place` may have one number or two; the centre in space has three on a surface.
    missed = 0.0 if problem.place is None else np.linalg.norm(centres[-1, : problem.place.size] - problem.place)
    return Resimulated(
        apart=float(np.max(np.linalg.norm(gap, axis=1))) / r,
        speed=float(np.max(np.abs([np.linalg.norm(seen.angular_velocity_body[-1]), *rates, *seen.joint_rates[-1]]))),
        away=float(np.linalg.norm(beside)) / r,
        below=float(below) / r,
        missed=float(missed) / r,
        margin=float(np.min(seen.normal_force)) / (M * float(problem.system.gravity)),
        friction=float(np.max(seen.friction_ratio)),
        violations={name: float(by) for name, by in largest.items()},
    )


@programs.filter_jit
def _largest(constraints: Mapping[str, Any], run: Run) -> dict[str, Float[Array, ""]]:
    """Computes the largest violation of each constraint."""
    return {name: jnp.max(constraint(run)) for name, constraint in constraints.items()}


@programs.filter_jit
def _off_balance(system: System, t, state) -> tuple[Float[Array, "2"], Float[Array, ""]]:
    """Computes how far the centre of mass is beside the place where it could rest, and below the geometric centre."""
    left = imbalance(system.prepare(), t, state)
    return left.beside, left.below


def places(solution: Solution, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k *d"]:
    """Computes the position of the geometric centre at ``times``, shape (k,), in a ``solution`` of a :class:`Rolling`.

    It is (z1, z2) for a ball, z for a disk, and on a surface where the centre is along e1 and e2, or along e1.
    """
    centres = _centres_of(solution, times)
    return centres[:, 0] if rolling(solution.problem).system.planar else centres[:, :2]


def _centres_of(solution: Solution, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k d"]:
    """Returns the geometric centre at ``times``, as :func:`locate_centre` has it."""
    problem, states = rolling(solution.problem), jnp.asarray(solution.path.states(times))
    unpacked = _unpack(problem, jnp.asarray(times), states)
    return np.asarray(_centres(problem.packing.system, jnp.asarray(times), unpacked))


@programs.jit
def _unpack(problem: Rolling, times, states) -> BallState | DiskState:
    return map_rows(problem.packing.unpack, times, states)


@programs.filter_jit
def _centres(prepared: System, times, states) -> Float[Array, "k d"]:
    return map_rows(lambda t, state: locate_centre(prepared, t, state), times, states)
