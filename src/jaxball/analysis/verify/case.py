"""The runs that a verification compares, each computed when it is first needed, and how far a result can be trusted."""

import dataclasses
import math
from functools import cached_property, partial
from typing import Any

import diffrax
import equinox as eqx
import jax
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Bool, Float

from ... import programs
from ...files.scenario.body import require_whole_run
from ...files.scenario.scenario import Scenario
from ...files.scenario.solvers import SOLVERS
from ...interface.printing import repr_html
from ...interface.status import Status
from ...numerics.arrays import to_array
from ...physics.contact.released import ReleasedState
from ...physics.system import AbstractState, AbstractSystem
from ...simulation.arguments import FINEST
from ...simulation.deviations import generic_vectors
from ...simulation.simulate import FEW_STEPS, simulate
from ...simulation.trajectory import Trajectory
from .samples import Samples, sample

REFERENCE = 1e-13
MOST_STEPS_VERIFIED = 2**18
DEVIATION = 1e-7
DIRECTIONS = 4
SAFETY = 10  # because step-size control keeps an estimate of the error, in the mean square, to the tolerance
INTERPOLATION = 10  # the interpolation error at the saved times, in steps
ERROR_ALLOWED = 1e-3
LEAST_ERROR = 1e-16
NEXT_TO_IMPACT = 1e-6  # of the length of a run: how well the times of impacts are known


@dataclasses.dataclass(frozen=True, eq=False)
class Case:
    """A scenario and its runs; ``given`` is a run that was computed before."""

    scenario: Scenario
    given: Trajectory[Any, Any] | None = None

    @property
    def state(self) -> Any:
        """The initial state, an ``AbstractState``; with a law of contact also a ``ReleasedState``."""
        require_whole_run(self.scenario, "the laws of a verification are")
        return self.scenario.state

    @property
    def tolerance(self) -> float:
        """The larger of both tolerances."""
        return max(self.scenario.rtol, self.scenario.atol)

    @property
    def finest(self) -> float:
        """The tolerance of the reference run."""
        return max(FINEST["float64"], min(REFERENCE, self.tolerance / 10))

    @cached_property
    def run(self) -> Trajectory[Any, Any]:
        """The scenario's own run, with dense output."""
        return self.scenario.simulate(dense=True)

    @property
    def steps(self) -> int:
        """The number of steps whose errors add up in the run; see :meth:`Case.expected`."""
        return int(self.run.steps) + INTERPOLATION

    @cached_property
    def samples(self) -> Samples:
        """The balances along the run."""
        return sample(self.run, self.scenario.rtol, self.scenario.atol)

    @cached_property
    def reference(self) -> Trajectory[Any, Any]:
        """The same motion by Dopri8 at a tolerance of 1e-13, or a tenth of the run's if that is tighter."""
        return self.precise(self.state)

    def precise(self, state: Any) -> Trajectory[Any, Any]:
        """Computes the motion from an initial state, as precise as possible."""
        return self.other(diffrax.Dopri8(), state=state, tolerance=self.finest)

    def other(
        self,
        solver: diffrax.AbstractAdaptiveSolver,
        *,
        system: AbstractSystem | None = None,
        state: Any = None,
        tolerance: float | None = None,
        dae: bool = False,
    ) -> Trajectory[Any, Any]:
        """Repeats the run with other settings; ``tolerance`` replaces the larger of rtol and atol, the other in
        proportion.
        """
        factor = 1.0 if tolerance is None else tolerance / self.tolerance
        solve = partial(
            simulate,
            self.scenario.system if system is None else system,
            self.scenario.times,
            self.state if state is None else state,
            solver=solver,
            rtol=factor * self.scenario.rtol,
            atol=factor * self.scenario.atol,
            dae=dae,
            contact=self.scenario.contact,
            max_step=self.scenario.max_step,
        )
        if system is None and not dae and solver == SOLVERS[self.scenario.solver]():
            # With dense output it is the program of the run itself, which is compiled already.
            trajectory = solve(dense=True, max_steps=FEW_STEPS[-1])
            if int(trajectory.status) != Status.MAX_STEPS:
                return trajectory
        return solve(max_steps=MOST_STEPS_VERIFIED)

    @cached_property
    def weights(self) -> Float[np.ndarray, " size"]:
        """The scale of each component of the state: 1 + max |x| where both tolerances are equal."""
        largest = np.max(np.abs(flat(self.reference.state)), axis=0)
        return (self.scenario.atol + self.scenario.rtol * largest) / self.tolerance

    def distance(self, a: AbstractState, b: AbstractState) -> Float[np.ndarray, " T"]:
        """Computes the distance of two motions at each saved time: the largest difference of a component over its
        weight.

        It is 0 at an impact, where the velocities before it may be compared with those after it.
        """
        distance = np.max(np.abs(flat(a) - flat(b)) / self.weights[None], axis=1)
        return np.where(self.jumps, 0.0, distance)

    @cached_property
    def jumps(self) -> Bool[np.ndarray, " T"]:
        """Whether velocities jump at a saved time, or next to it, as far as the run knows when."""
        times = np.asarray(self.scenario.times)
        if self.scenario.contact is None:
            return np.zeros(len(times), bool)
        jumps = np.asarray(self.run.switches.times)
        jumps = jumps[np.isfinite(jumps) & (jumps > times[0])]
        return np.any(np.abs(times[:, None] - jumps[None]) <= NEXT_TO_IMPACT * (times[-1] - times[0]), axis=1)

    @cached_property
    def errors(self) -> Float[np.ndarray, " T"]:
        """The error of the run at each saved time, against the reference."""
        return self.distance(self.run.state, self.reference.state)

    @cached_property
    def growth(self) -> Float[np.ndarray, " T"]:
        """The factor by which small deviations of the initial state have grown, at least 1; NaN if unknown.

        It is the largest over four generic directions, which grow less than the fastest one by about the square root
        of the dimension. It is measured with runs from nearby states, because tangents would need a program of their
        own.
        """
        factors = []
        for direction in generic_vectors(DIRECTIONS, self.weights.size):
            change = DEVIATION * direction / np.linalg.norm(direction) * self.weights
            nearby = self.precise(_displace(self.scenario.system, self.scenario.times[0], self.state, change))
            # A constrained body cannot start from every nearby state.
            if nearby.ok:
                deviation = self.distance(nearby.state, self.reference.state)
                factors.append(deviation / deviation[0])
        # Small deviations may shrink; an error that was made stays.
        return np.maximum(1.0, np.max(factors, axis=0)) if factors else np.full(len(self.scenario.times), np.nan)

    @property
    def expected(self) -> float:
        """The error that the tolerances explain: steps × tolerance × growth, times a safety factor of 10.

        Each step adds an error of about the tolerance, which then grows as any deviation does.
        """
        return SAFETY * self.steps * self.tolerance * float(np.max(self.growth))


@programs.filter_jit
def _displace(system: AbstractSystem, t: Float[ArrayLike, ""], state: Any, change: Float[Array, " size"]) -> Any:
    body = state.body if isinstance(state, ReleasedState) else state
    vector, unravel = ravel_pytree(body)
    # Projected, so that a displaced state keeps its constraints, such as |q| = 1.
    moved = system.prepare().projected(to_array(t), unravel(vector + change))
    return eqx.tree_at(lambda x: x.body, state, moved) if isinstance(state, ReleasedState) else moved


def flat(state: AbstractState) -> Float[np.ndarray, "T size"]:
    """Returns states along a leading axis as rows."""
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(state)]
    return np.concatenate([leaf.reshape(leaf.shape[0], -1) for leaf in leaves], axis=1)


@dataclasses.dataclass(frozen=True)
class Trust:
    """How far ahead a result can be trusted.

    Errors are relative to 1 + |x|, component by component, like the tolerances if both are equal.

    - ``error``: the largest error of the run, measured against a run at a tolerance of 1e-13.
    - ``growth``: the largest factor by which a small deviation of the initial state grows in the run.
    - ``lyapunov_time``: the time in which it grows e-fold on average, the inverse of the finite-time Lyapunov exponent.
    - ``horizon``: the time at which the error reaches 1e-3. Beyond the end of the run it is extrapolated with the mean
      growth rate, and is too early where the motion is regular.
    - ``end``: when the run ended.
    """

    error: float
    growth: float
    lyapunov_time: float
    horizon: float
    end: float

    _repr_html_ = repr_html

    def __repr__(self) -> str:
        growth = f"{self.growth:.3g}-fold, e-fold in {self.lyapunov_time:.3g}"
        reached = self.horizon <= self.end
        bound = f"reaches {ERROR_ALLOWED:g} at" if reached else f"stays below {ERROR_ALLOWED:g} until"
        return f"error {self.error:.1e}; small deviations grow {growth}; the error {bound} t = {self.horizon:.3g}"


def trust(case: Case) -> Trust | None:
    """Estimates how far ahead the run can be trusted, from its error and the growth of small deviations.

    With their growth G over a run of length T, log(G) / T is the finite-time Lyapunov exponent, and the error is
    extrapolated at that rate. In a regular motion deviations grow linearly in time and the exponent falls as
    log(T) / T, so the error stays small for longer than this says. None where the reference run failed.
    """
    if not case.reference.ok:
        return None
    times = np.asarray(case.scenario.times)
    # Once it was wrong, a run is not trusted again where its error happens to be small.
    errors = np.maximum.accumulate(case.errors)
    error, growth = float(errors[-1]), float(np.max(case.growth))
    lyapunov_time = float(times[-1] - times[0]) / math.log(growth) if growth > 1 else math.inf
    late = ~(errors <= ERROR_ALLOWED)
    if late.any():
        horizon = float(times[int(np.argmax(late))])
    else:
        horizon = float(times[-1]) + lyapunov_time * math.log(ERROR_ALLOWED / max(error, LEAST_ERROR))
    return Trust(error=error, growth=growth, lyapunov_time=lyapunov_time, horizon=horizon, end=float(times[-1]))
