"""The schedules and signals of a solution, the simulation with them, and the evidence for the solution of a file."""

import dataclasses
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .... import programs
from ....files.scenario import Units
from ....files.scenario.initial import starting_angles
from ....files.scenario.scenario import Scenario
from ....interface.printing import repr_html
from ....interface.wording import number_of
from ....physics.body import System
from ....physics.prescribed.schedules import PiecewiseAcceleration
from ....physics.prescribed.signals import PiecewiseSignal
from ....physics.state import BallState, DiskState
from ....programs.batches import map_rows
from ....simulation.equilibrium import imbalance
from ..problem.run import Run, locate_centre
from ..problem.space import DesignError
from .collocation import SHARP
from .problem import with_free_joints
from .rolling import Rolling, rolling
from .solution import POINTS_OF_INTERVAL, Solution
from .solve import FreeEndTime, Guess, fix_end, solve_from_guess, solve_from_guess_with_free_end


def schedules(solution: Solution) -> list[PiecewiseAcceleration]:
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

    It is the polynomial u on each interval, then, for as long again, the values of :meth:`Solution.holding`.
    """
    first, mesh = len(rolling(solution.problem).system.accelerated), solution.path.mesh
    # A run that goes on past the end shows the robot at rest, for as long again.
    times = np.append(mesh, 2 * mesh[-1] - mesh[0])
    constant = np.eye(1, solution.path.controls.shape[1])
    return [
        PiecewiseSignal(times, np.concatenate([values, value * constant]))
        for values, value in zip(_polynomials(solution)[first:], solution.holding(), strict=True)
    ]


def holding(solution: Solution) -> Float[np.ndarray, " motors"]:
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
    return rolling(solution.problem).with_schedules(solution.schedules(), signals_of(solution))


@programs.compile_quickly()
def scenario(solution: Solution, title: str = "", saves: int = 201) -> Scenario:
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
    problem, scenario = rolling(solution.problem), solution.scenario()
    if problem.constraints:
        # Ends of intervals belong to two of them.
        scenario = dataclasses.replace(scenario, times=np.unique(solution.path.within(POINTS_OF_INTERVAL)))
    run = scenario.simulate(solver=solver, rtol=tolerance, atol=tolerance, throw=True)
    system = run.system
    seen, M, r = run.observables, float(problem.system.total_mass), float(problem.system.radius)
    times = jnp.asarray(run.times)
    centres = np.asarray(_centres(system.prepare(), times, run.state))
    gap = centres - _centres_of(solution, np.asarray(times))
    schedules = solution.schedules()
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


# The allowed error of a simulation, in units of the mesh's tolerance.
ALLOWED_SIMULATION_ERROR = 10.0


class ControlFile(NamedTuple):
    """The content of a problem file with a table ``[control]``.

    - ``problem``: the problem to be solved; ``easy``: the same with other weights, from which continuation starts, or
      None.
    - ``saves``: the number of save times of the scenario found.
    - ``intervals``, ``tolerance``: of the first mesh, and of :func:`mesh_errors`.
    - ``violation``: how much a constraint may be violated; ``barrier``: with which the search begins.
    - ``units``: those of the scenario, if it states them.
    - ``free_end_time``: if the end time is to be found, which has no ``easy`` problem.
    """

    title: str
    problem: Rolling
    easy: Rolling | None
    saves: int
    intervals: int
    tolerance: float
    violation: float
    barrier: float
    guess: Guess
    units: Units | None = None
    free_end_time: FreeEndTime | None = None


class Point(NamedTuple):
    """A point of the branch: its parameter from 0 to 1, and weights and means of the objectives."""

    share: float
    weights: dict[str, float]
    means: dict[str, float]


class Controlled(NamedTuple):
    """A solution and the evidence for it.

    - ``first``: the solution from which continuation started; ``solution`` itself without continuation.
    - ``curvature``: :meth:`Solution.least_curvature`, also by a free end time.
    - ``seen``: the schedules simulated by a solver of another kind.
    - ``tolerance``: of the mesh; ``violation``: of constraints.
    - ``elapsed``: how long it took, in seconds.
    - ``units``: those of the scenario, if it states them.
    - ``free_end_time``: if the end time was found.
    """

    first: Solution
    solution: Solution
    branch: tuple[Point, ...]
    curvature: float
    seen: Resimulated
    tolerance: float
    violation: float
    elapsed: float
    units: Units | None = None
    free_end_time: FreeEndTime | None = None

    _repr_html_ = repr_html

    def __repr__(self) -> str:
        seen = self.seen
        lines = [
            f"Optimal control, {'' if self.good else 'not '}confirmed: a path in "
            f"{number_of(len(self.solution.errors), 'interval')}",
            f"  its simulation is up to {seen.apart:.2g} radii away, and misses its end by {seen.missed:.2g} radii",
            f"  the least curvature is {self.curvature:.3g}: "
            f"{'a strict minimum' if self.curvature > 0 else 'no strict minimum'}",
            *(f"  {name} is violated by {by:.2g}" for name, by in self.broken.items()),
        ]
        return "\n".join(lines)

    @property
    def good(self) -> bool:
        """Whether it is a strict minimum, its simulation follows its path to rest, and the constraints hold."""
        seen = self.seen
        near = max(seen.apart, seen.speed, seen.away, seen.missed) <= ALLOWED_SIMULATION_ERROR * self.tolerance
        return self.curvature > 0 and near and not self.broken

    @property
    def broken(self) -> dict[str, float]:
        """The violated constraints, and their violations."""
        return {name: by for name, by in self.seen.violations.items() if not by <= self.violation}


def solve_control(
    file: ControlFile,
    say: Callable[[str], None] = lambda line: None,
    keep: Callable[[Solution], None] = lambda solution: None,
) -> Controlled:
    """Solves a problem: from its guess by Newton's method, and by continuation if it has an easier problem.

    Finally, the barrier of constraints is brought close to zero. An end time is free from the first solution on.

    ``say`` is called with a line for each point of the branch, and ``keep`` with the point.

    **Raises:** :class:`~jaxball.studies.design.DesignError` where no solution is found.
    """
    began = time.perf_counter()
    branch: list[Point] = []

    def visit(solution: Solution) -> None:
        objectives = rolling(solution.problem).objectives
        weights = {name: float(objective.weight) for name, objective in objectives.items()}
        branch.append(Point(solution.parameter, weights, solution.means()))
        keep(solution)
        say(_line(branch[-1]))

    def sharper(solution: Solution) -> None:
        collocation = solution.collocation
        worst = np.max(solution.violations())
        solution = fix_end(solution)
        keep(solution)
        end = "" if file.free_end_time is None else f"   end {solution.path.mesh[-1]:.8g}"
        say(f"barrier {collocation.barrier:.0e}   {collocation.steps.size} intervals   violation {worst:.1e}{end}")

    problem = file.problem
    say("compiling, and solving from the guess")
    mesh = np.linspace(float(problem.start), float(problem.end), file.intervals + 1)
    rough = _first_solution(file, file.easy or problem, mesh)
    first = fix_end(rough)
    if file.easy is None:
        visit(first)
    else:
        rough = first.continue_to(problem, file.tolerance, visit)[1]
    sharp = rough
    if rough.collocation.inequalities:
        sharp = rough.sharpen(tolerance=file.tolerance, violation=file.violation, visit=sharper)
    solution = fix_end(sharp)
    say("simulating by another solver")
    seen, curvature = solution.resimulate(), sharp.least_curvature()
    elapsed = time.perf_counter() - began
    return Controlled(
        first=first,
        solution=solution,
        branch=tuple(branch),
        curvature=curvature,
        seen=seen,
        tolerance=file.tolerance,
        violation=file.violation,
        elapsed=elapsed,
        units=file.units,
        free_end_time=file.free_end_time,
    )


def _first_solution(file: ControlFile, problem: Rolling, mesh: np.ndarray) -> Solution:
    """Finds the solution by Newton's method from the guess, or otherwise from the motion without constraints."""

    def start(problem: Rolling, guess: Guess) -> Solution:
        how = {"stages": 3, "tolerance": file.tolerance, "guess": guess, "barrier": file.barrier}
        if file.free_end_time is None:
            return solve_from_guess(problem, mesh, **how)
        return solve_from_guess_with_free_end(problem, mesh, file.free_end_time, **how)

    try:
        return start(problem, file.guess)
    except DesignError:
        if not problem.constraints:
            raise
    # Without constraints Newton's method converges more easily, and its motion is a better start than rest.
    free = start(eqx.tree_at(lambda p: p.constraints, problem, {}), file.guess).path
    try:
        return start(problem, lambda *arguments: free)
    except DesignError as error:
        raise DesignError(
            "The constraints must leave a motion near that without them, but Newton's method finds none with barriers "
            f"from {file.barrier:g} to {SHARP:g}; check whether they contradict each other or the end of the motion, "
            "or start with more intervals."
        ) from error


def _line(point: Point) -> str:
    values = "   ".join(f"{name} {value:.6g}" for name, value in point.means.items())
    return f"share {point.share:6.3f}   {values}"
