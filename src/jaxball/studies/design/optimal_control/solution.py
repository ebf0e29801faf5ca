"""A solution of an optimal control problem: its violations, curvature and motion, and others by continuation from it.

``solve`` refines the mesh by it, and reports describe it.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
import scipy.sparse
from jaxtyping import Array, Float, Int

from .... import programs
from ....files.scenario.initial import starting_angles
from ....files.scenario.scenario import Scenario
from ....physics.body import System
from ....physics.prescribed.schedules import PiecewiseAcceleration
from ....physics.prescribed.signals import PiecewiseSignal
from ....programs.batches import map_rows
from ....simulation.equilibrium import imbalance
from ..continuation import CORRECTION_TOLERANCE, Branch, follow, newton, solver
from ..problem.run import Run, locate_centre
from ..problem.space import DesignError
from .collocation import SHARP, Collocation, in_time
from .problem import MOTOR_LIMITS, VIOLATION, AbstractControlProblem, Path, with_free_joints
from .refinement import finer_mesh, margins, mesh_errors, newton_from, path_of
from .rolling import Rolling, rolling

MOST_REFINEMENTS = 8
# Steps in the homotopy parameter, from 0 to 1.
FIRST_HOMOTOPY_STEP, LONGEST_HOMOTOPY_STEP = 0.05, 0.2
# A branch that turns may go back past its start and still reach its end, but seldom from far away.
BRANCH_WITHIN = (-0.5, 1.5)
# The initial barrier on a finer mesh, and its factors: at first, and where it can fall no further.
AGAIN, STEP, SHORTEST_STEP = 1e-4, 0.1, 0.95
MOST_BARRIERS = 12
# By as much violations are smaller where motors have limits, which cut them off in a simulation.
CUT_OFF = 0.1
# A barrier above the last one, except for rounding, is solved for to this accuracy.
NEARLY_LAST, ROUGH = 1 + 1e-9, 1e-3
# The number of points, including both ends, at which inequalities are evaluated in each interval.
POINTS_OF_INTERVAL = 11


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


class Solution(NamedTuple):
    """A solved problem.

    - ``collocation``, ``y``, ``parameter``: the equations, their solution and λ.
    - ``errors``: those of :func:`mesh_errors`.
    """

    collocation: Collocation
    y: Float[np.ndarray, " size"]
    parameter: float
    errors: Float[np.ndarray, " N"]

    @property
    def path(self) -> Path:
        """States and controls."""
        return path_of(self.collocation, self.y)

    @property
    def problem(self) -> AbstractControlProblem:
        """The problem at λ."""
        return self.collocation.problem_at(self.parameter)

    def violations(self) -> Float[np.ndarray, " N"]:
        """Computes the largest violation of an inequality in each interval, between the nodes too; 0 where all hold."""
        times = self.path.within(POINTS_OF_INTERVAL)
        values = margins(self.collocation, self.path, np.ravel(times), self.parameter)
        return np.max(-values.reshape(*times.shape, self.collocation.inequalities), axis=(1, 2), initial=0.0)

    def means(self) -> dict[str, float]:
        """Computes the mean of each objective's integrand over the run of a :class:`Rolling`, without its weight.

        It is that by the weights of Gauss.
        """
        rolling(self.problem)
        collocation = self.collocation
        terms = collocation.along(self.path, "terms", np.ravel(collocation.times), self.parameter)
        return {name: float(np.ravel(collocation.weights) @ values) for name, values in terms.items()}

    def least_curvature(self) -> float:
        """Computes the smallest eigenvalue of the Lagrangian's second derivative by controls that keep conditions.

        Inequalities count with the curvature of their barrier. Where the barrier is small, only changes along active
        constraints matter, because changes across them are costly.

        Controls have the norm (1/T ∫ |u|² dt)^½, and numbers that are free at the start their own size, so that it does
        not depend on the mesh: where the cost is w |u|² only, it is 2 w. A solution with a positive curvature is a
        strict local minimum.
        """
        collocation = self.collocation
        places, count, held = collocation.places, collocation.unconstrained, collocation.held > 0
        matrix = collocation.jacobian(self.y, self.parameter)[0].tocsr()
        # In the order of time each state follows from the ones before: the matrix of the states is triangular by
        # blocks, and its factors fill little.
        states = in_time(places.nodes, places.knots[1:, None], first=places.knots[0, held])
        equations = in_time(places.at_nodes, places.at_knots[:, None], first=places.at_start[held])
        # What the start leaves free is chosen, as controls are.
        controls = np.append(np.ravel(places.controls), places.knots[0, ~held])
        A = matrix[equations]
        # On the null space of all conditions: the states follow from the controls, and only those combinations of
        # controls are kept that change no end condition.
        change = -solver(A[:, states], np.arange(states.size))(A[:, controls].toarray())
        basis = scipy.linalg.null_space(matrix[places.at_end][:, states] @ change)
        along = np.zeros((count, basis.shape[1]))
        along[states], along[controls] = change @ basis, basis
        hessian = along.T @ (_condense(matrix, np.ravel(places.excess), count) @ along)
        weights = np.append(
            np.repeat(np.ravel(collocation.weights), places.controls.shape[2]), np.ones(np.count_nonzero(~held))
        )
        # In this metric a control that is 1 all the time has length 1.
        metric = basis.T @ (weights[:, None] * basis)
        return float(scipy.linalg.eigh(hessian, metric, eigvals_only=True, subset_by_index=(0, 0))[0])

    def continue_to(
        self,
        problem: Rolling,
        tolerance: float = 1e-6,
        visit: Callable[["Solution"], None] = lambda solution: None,
    ) -> tuple[Branch, "Solution"]:
        """Follows the branch to ``problem``, and solves at its end on a fine enough mesh.

        With constraints, :meth:`sharpen` refines the mesh, after the barrier has fallen.

        The parameter of the branch goes from 0 at one problem to 1 at the other, as in :meth:`Rolling.between`.

        **Arguments:**

        - ``tolerance``: the largest error of an interval of the mesh.
        - ``visit``: called with each solution on the way.

        **Raises:** :class:`~jaxball.studies.design.DesignError` where the branch does not reach its end, or where
        Newton's method finds no solution on a finer mesh.
        """
        before = self.collocation
        collocation = before.with_changes(problem=(self.problem, problem), vary=Rolling.between)
        # The length of the branch is measured in the mean of the states, so that steps do not depend on the number of
        # intervals; multipliers have no part in it.
        knots = np.ravel(collocation.places.knots)
        weights = np.zeros(collocation.size)
        weights[knots] = 1 / knots.size
        branch = follow(
            collocation,
            self.y,
            0.0,
            1.0,
            step=FIRST_HOMOTOPY_STEP,
            longest=LONGEST_HOMOTOPY_STEP,
            within=BRANCH_WITHIN,
            weights=weights,
            visit=lambda y, share: visit(Solution(collocation, y, share, np.zeros(0))),
        )
        last = Solution(collocation, branch.y[-1], float(branch.parameter[-1]), np.zeros(0))
        if branch.ended != "end":
            raise DesignError(
                f"The branch must lead to the problem, but it ends after {last.parameter:.3g} of the way "
                f"({branch.ended}, with {len(branch.folds)} turning points); use smaller steps, a finer mesh, or "
                "another path."
            )
        errors = mesh_errors(collocation, last.y, 1.0)
        # With constraints the barrier is still large, and `sharpen` refines the mesh once the solution has come to its
        # place.
        if np.max(errors) <= tolerance or collocation.inequalities:
            return branch, last._replace(errors=errors)
        return branch, solve_near(collocation, last.path, 1.0, tolerance)

    def sharpen(
        self,
        barrier: float = SHARP,
        tolerance: float = 1e-6,
        violation: float = VIOLATION,
        visit: Callable[["Solution"], None] = lambda solution: None,
    ) -> "Solution":
        """Solves with a small barrier, on meshes refined until the inequalities hold between the nodes as well.

        Where Newton's method finds none on a finer mesh, it is the last one found, as its errors and violations show.

        The barrier falls in steps, each solved by Newton's method from the solution before. In a convex problem the
        cost then exceeds the minimum by at most µ for each inequality (Boyd & Vandenberghe, Convex Optimization,
        section 11.2.2).

        **Arguments:**

        - ``barrier``: µ at the end.
        - ``tolerance``: of :func:`mesh_errors`; ``violation``: of :meth:`violations`, of which a tenth is allowed where
          motors have limits.
        - ``visit``: called with the solution on each mesh.

        **Raises:** :class:`~jaxball.studies.design.DesignError` where the barrier cannot be lowered.
        """
        collocation, y, parameter, sharp = self.collocation, self.y, self.parameter, self
        if not collocation.inequalities:
            return self
        allowed = violation * (CUT_OFF if MOTOR_LIMITS in getattr(self.problem, "constraints", {}) else 1.0)
        for _ in range(MOST_BARRIERS):
            try:
                collocation, y = _lower_barrier(collocation, y, parameter, barrier)
            except DesignError:
                # The first barrier could not fall: nothing sharper than the given solution is known.
                if sharp is self:
                    raise
                break
            errors = mesh_errors(collocation, y, parameter)
            sharp = Solution(collocation, y, parameter, errors)
            visit(sharp)
            # Errors and violations over what is allowed, so that one mesh serves both.
            excess = np.maximum(errors / tolerance, sharp.violations() / allowed)
            if np.max(excess) <= 1:
                break
            finer = finer_mesh(collocation.mesh, excess, 1.0, collocation.stages + 1)
            on_finer = collocation.with_changes(mesh=finer, barrier=max(barrier, AGAIN))
            try:
                collocation, y = newton_from(on_finer, sharp.path, parameter)
            except DesignError:
                break
        return sharp

    def schedules(self) -> list[PiecewiseAcceleration]:
        """Returns θ(t) of the accelerated coordinates of a :class:`Rolling`, masses first and then joints.

        θ̈ is the polynomial u on each interval, so that at the knots θ and θ̇ are the solution's.
        """
        problem, mesh = rolling(self.problem), self.path.mesh
        places = np.asarray(problem.system.accelerated, dtype=int)
        start = zip(problem.state.theta[places], problem.state.thetadot[places], strict=True)
        return [
            PiecewiseAcceleration(theta, mesh, values, rate)
            for values, (theta, rate) in zip(self._polynomials()[: len(places)], start, strict=True)
        ]

    def signals(self) -> list[PiecewiseSignal]:
        """Returns Q(t) of each motor of a :class:`Rolling`.

        It is the polynomial u on each interval, then, for as long again, the values of :meth:`holding`.
        """
        first, mesh = len(rolling(self.problem).system.accelerated), self.path.mesh
        # A run that goes on past the end shows the robot at rest, for as long again.
        times = np.append(mesh, 2 * mesh[-1] - mesh[0])
        constant = np.eye(1, self.path.controls.shape[1])
        return [
            PiecewiseSignal(times, np.concatenate([values, value * constant]))
            for values, value in zip(self._polynomials()[first:], self.holding(), strict=True)
        ]

    def _polynomials(self) -> Float[np.ndarray, "m N s"]:
        """Computes the coefficients of each control, for the powers of the time since the start of each interval."""
        powers = np.arange(self.path.controls.shape[1])
        # `control_coefficients` are for fractions of an interval.
        coefficients = self.path.control_coefficients / np.diff(self.path.mesh)[:, None, None] ** powers[:, None]
        return np.moveaxis(coefficients, 2, 0)

    def holding(self) -> Float[np.ndarray, " motors"]:
        """Computes the force or torque of each motor that holds the robot of a :class:`Rolling` at its end."""
        return np.asarray(_holding(rolling(self.problem), jnp.asarray(self.path.knots[-1])))

    def places(self, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k *d"]:
        """Computes the position of the geometric centre of a :class:`Rolling` at ``times``, shape (k,).

        It is (z1, z2) for a ball, z for a disk, and on a surface where the centre is along e1 and e2, or along e1.
        """
        centres = self._centres(times)
        return centres[:, 0] if rolling(self.problem).system.planar else centres[:, :2]

    def _centres(self, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k d"]:
        """Returns the geometric centre at ``times``, as :func:`locate_centre` has it."""
        states = jnp.asarray(self.path.states(times))
        return np.asarray(_centres_along(rolling(self.problem), jnp.asarray(times), states))

    @programs.compile_quickly()
    def scenario(self, title: str = "", saves: int = 201) -> Scenario:
        """Returns the scenario with the motion of a :class:`Rolling`, for ``jaxball simulate``.

        **Arguments:**

        - ``title``: of the scenario.
        - ``saves``: the number of save times.
        """
        problem = rolling(self.problem)
        robot = problem.with_schedules(self.schedules(), self.signals())
        times = np.linspace(float(problem.start), float(problem.end), saves)
        return Scenario(title, robot, with_free_joints(problem.system, problem.state), times)

    @programs.compile_quickly()
    def resimulate(self, solver: str = "gauss16", tolerance: float = 1e-11) -> Resimulated:
        """Simulates the schedules of a :class:`Rolling` by a solver of another kind.

        Constraints are evaluated ten times per interval of the mesh.

        **Arguments:**

        - ``solver``: its name, as in a scenario file.
        - ``tolerance``: of that solver.

        **Raises:** :class:`~jaxball.SolveError` where the solve fails.
        """
        problem, scenario = rolling(self.problem), self.scenario()
        if problem.constraints:
            # Ends of intervals belong to two of them.
            scenario = dataclasses.replace(scenario, times=np.unique(self.path.within(POINTS_OF_INTERVAL)))
        run = scenario.simulate(solver=solver, rtol=tolerance, atol=tolerance, throw=True)
        system = run.system
        seen, M, r = run.observables, float(problem.system.total_mass), float(problem.system.radius)
        times = jnp.asarray(run.times)
        centres = np.asarray(_centres(system.prepare(), times, run.state))
        gap = centres - self._centres(np.asarray(times))
        schedules = self.schedules()
        # θ̇ of a mass or a joint with a schedule is not in the state of the simulation.
        rates = [*starting_angles(tuple(schedules), problem.end)["thetadot"]] if schedules else []
        whole = Run(system, times, run.state, run.status)
        largest = _largest(problem.constraints, whole)
        beside, below = _off_balance(system, problem.end, jax.tree.map(lambda leaf: leaf[-1], run.state))
        # `place` may have one number or two; the centre in space has three on a surface.
        missed = 0.0 if problem.place is None else np.linalg.norm(centres[-1, : problem.place.size] - problem.place)
        turning = np.linalg.norm(seen.angular_velocity_body[-1])
        return Resimulated(
            apart=float(np.max(np.linalg.norm(gap, axis=1))) / r,
            speed=float(np.max(np.abs([turning, *rates, *seen.joint_rates[-1]]))),
            away=float(np.linalg.norm(beside)) / r,
            below=float(below) / r,
            missed=float(missed) / r,
            margin=float(np.min(seen.normal_force)) / (M * float(problem.system.gravity)),
            friction=float(np.max(seen.friction_ratio)),
            violations={name: float(by) for name, by in largest.items()},
        )


@programs.jit
def _holding(problem: Rolling, x: Float[Array, " n"]) -> Float[Array, " motors"]:
    return -problem.imbalance_at_end(x).efforts[problem.motor_slots]


@programs.filter_jit
def _largest(constraints: Mapping[str, Any], run: Run) -> dict[str, Float[Array, ""]]:
    """Computes the largest violation of each constraint."""
    return {name: jnp.max(constraint(run)) for name, constraint in constraints.items()}


@programs.filter_jit
def _off_balance(system: System, t, state) -> tuple[Float[Array, "2"], Float[Array, ""]]:
    """Computes how far the centre of mass is beside the place where it could rest, and below the geometric centre."""
    left = imbalance(system.prepare(), t, state)
    return left.beside, left.below


@programs.jit
def _centres_along(problem: Rolling, times, states: Float[Array, "k n"]) -> Float[Array, "k d"]:
    packing = problem.packing
    return map_rows(lambda t, x: locate_centre(packing.system, t, packing.unpack(t, x)), times, states)


@programs.filter_jit
def _centres(prepared: System, times, states) -> Float[Array, "k d"]:
    return map_rows(lambda t, state: locate_centre(prepared, t, state), times, states)


def _condense(matrix: scipy.sparse.csr_array, excess: Int[np.ndarray, " i"], count: int) -> scipy.sparse.csr_array:
    """Reduces second derivatives to states and controls: those by the inequalities' unknowns are eliminated."""
    # Each inequality's own unknown has one diagonal entry, so that eliminating it needs no solve.
    inverse = scipy.sparse.diags_array(1 / matrix[excess][:, excess].diagonal())
    return matrix[:count, :count] - matrix[:count][:, excess] @ inverse @ matrix[excess][:, :count]


def solve_near(collocation: Collocation, path: Path, parameter: float = 0.0, tolerance: float = 1e-6) -> Solution:
    """Solves near a path, on meshes refined until no interval's error exceeds ``tolerance``.

    **Arguments:**

    - ``collocation``: the equations on the first mesh.
    - ``path``: where Newton's method starts.
    - ``parameter``: λ.

    **Raises:** :class:`~jaxball.studies.design.DesignError` where Newton's method finds no solution.
    """
    rounds = 0
    while True:
        collocation, y = newton_from(collocation, path, parameter)
        errors = mesh_errors(collocation, y, parameter)
        if np.max(errors) <= tolerance or rounds == MOST_REFINEMENTS:
            return Solution(collocation, y, parameter, errors)
        path, rounds = path_of(collocation, y), rounds + 1
        finer = finer_mesh(collocation.mesh, errors, tolerance, collocation.stages + 1)
        collocation = collocation.with_changes(mesh=finer)


def _lower_barrier(
    collocation: Collocation, y: Float[np.ndarray, " size"], parameter: float, barrier: float
) -> tuple[Collocation, Float[np.ndarray, " size"]]:
    """Finds the solution with a smaller barrier, by steps that become shorter where Newton's method fails."""
    step = STEP
    while collocation.barrier > barrier:
        following = step * collocation.barrier
        last = following < NEARLY_LAST * barrier
        lower = collocation.with_changes(barrier=barrier if last else following)
        try:
            y = newton(lower, y, parameter, CORRECTION_TOLERANCE if last else ROUGH)
        except DesignError:
            # A shorter step of the barrier: its factor comes closer to 1.
            step = math.sqrt(step)
            if step > SHORTEST_STEP:
                raise DesignError(
                    f"The barrier must fall to {barrier:g}, but below {collocation.barrier:.2g} Newton's method finds "
                    "no solution; check whether the inequalities leave one, or start with more intervals or a smaller "
                    "barrier."
                ) from None
            continue
        collocation = lower
    return collocation, y
