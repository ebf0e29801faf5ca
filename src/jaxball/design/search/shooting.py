"""Multiple shooting: a run cut in pieces that are simulated side by side and joined by equality constraints.

The states at which the pieces start are additional unknowns, and equality constraints require that each piece ends
where the next one starts (Bock & Plitt, A multiple shooting algorithm for direct solution of optimal control problems,
IFAC Proc. 17 (1984) 1603). An error at the start of a run then grows only over a piece, not over the whole run. Single
shooting is the case of one piece, without such unknowns.
"""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from ...physics.body import Ball, Disk, System
from ...physics.state import BallState, DiskState
from ...scenario.initial import INITIAL
from ..problem.problem import ConstraintLayout, Evaluation, Problem, merged
from ..problem.run import Run, Solve, run_of
from ..problem.space import Candidate, DesignSpace
from ..problem.variables import DesignError, default_scale
from .program import AbstractProgram, Settings

CONTINUITY = "continuity"


class Components:
    """States of the kind of ``state`` as vectors of order one: each component, a versor's four too, over its scale."""

    def __init__(self, system: System, state: BallState | DiskState):
        kinds = {name: key.kind for name, key in INITIAL["disk" if isinstance(state, DiskState) else "ball"].items()}
        scales = []
        for field in dataclasses.fields(state):
            dimension = getattr(kinds.get(field.name), "dimension", None)
            size = np.size(getattr(state, field.name))
            scales.append(np.full(size, default_scale(dimension, 1.0, system)))
        self.scale = np.concatenate(scales)
        self._unravel = ravel_pytree(state)[1]

    @property
    def size(self) -> int:
        """How many there are."""
        return self.scale.size

    def pack(self, state: Any) -> Float[Array, " components"]:
        """The components of a state."""
        x = ravel_pytree(state)[0]
        return x / jnp.asarray(self.scale, dtype=x.dtype)

    def unpack(self, components: Float[Array, " components"]) -> Any:
        """The state of the components, its versor normalised."""
        return self._unravel(components * jnp.asarray(self.scale, dtype=components.dtype)).projected()


def starting_points(space: DesignSpace, settings: Settings) -> Float[np.ndarray, "starts n"]:
    """The given design first, then others: normally distributed about it, or uniformly between two bounds."""
    random, bounds = np.random.default_rng(settings.seed), space.bounds
    shape = (settings.starts - 1, space.size)
    both = np.isfinite(bounds.lower) & np.isfinite(bounds.upper)
    low, high = np.where(both, bounds.lower, 0.0), np.where(both, bounds.upper, 1.0)
    anywhere = low + (high - low) * random.uniform(size=shape)
    about = space.start + settings.spread * random.normal(size=shape)
    others = [np.where(both, bounds.variables(x), y) for x, y in zip(anywhere, about, strict=True)]
    return np.stack([space.start, *others])


@dataclasses.dataclass(frozen=True)
class Shooting(AbstractProgram):
    """A problem whose runs are simulated in ``intervals`` pieces with equal numbers of samples.

    The unknowns y are those of the design space and, ball by ball, the components of the state at each joint, where a
    piece after the first starts. Continuity is the last constraint.

    **Arguments:**

    - ``problem``: the problem to solve.

    **Raises:** :class:`DesignError` where the steps between save times cannot be divided equally.
    """

    problem: Problem
    intervals: int = 1

    def __post_init__(self):
        if self.intervals < 1 or self._steps % self.intervals:
            raise DesignError(
                f"Key `search.intervals` must divide the number of steps between save times, {self._steps}, but it is "
                f"{self.intervals}; choose another number, or another number of save times."
            )

    @property
    def weights(self):
        return self.problem.weights

    @property
    def layout(self):
        layout = self.problem.layout
        return ConstraintLayout({**layout.sizes, CONTINUITY: self.joints * self.components.size}, layout.balls)

    @property
    def equal(self):
        return self.layout.spread({CONTINUITY: 1.0}) > 0

    @property
    def names(self):
        states = np.repeat(np.arange(1, self.intervals), self.components.size)
        return (*self.problem.space.names, *(f"the state at joint {k}" for k in np.tile(states, self.problem.balls)))

    @property
    def joints(self) -> int:
        """How many joints there are between the pieces."""
        return self.intervals - 1

    @functools.cached_property
    def components(self) -> Components:
        """The unknowns of the states."""
        system, state = self.problem.space.scenario.system, self.problem.space.scenario.state
        assert isinstance(system, Ball | Disk)
        assert isinstance(state, BallState | DiskState)
        return Components(system, state)

    def starts(self, settings):
        return self.joined(starting_points(self.problem.space, settings))

    def joined(self, y: Float[np.ndarray, "starts n"]) -> Float[np.ndarray, "starts unknowns"]:
        """The unknowns at which the pieces of designs join: those of the designs, and the states of their runs.

        Where a run failed before a joint, it is the last state that it reached.
        """
        if not self.joints:
            return y
        problem, pack = self.problem, jax.vmap(self.components.pack)

        def states(y: Float[Array, " n"]) -> Float[Array, "balls t components"]:
            solve = problem.solve()
            return problem.of_each(problem.space.candidate(y), lambda one: pack(run_of(one, solve).state))

        saved = np.asarray(jax.jit(jax.vmap(states))(jnp.asarray(y)))
        finite = np.all(np.isfinite(saved), axis=-1)
        last = np.max(np.where(finite, np.arange(self._steps + 1), 0), axis=-1)
        rows = np.minimum(self._rows[1:, 0], last[..., None])
        return np.concatenate([y, np.reshape(np.take_along_axis(saved, rows[..., None], axis=2), (len(y), -1))], axis=1)

    def design(self, y: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " n"]:
        """The unknowns of the design space among them."""
        return y[: self.problem.space.size]

    def numbers(self, y):
        n = self.problem.space.size
        return jnp.concatenate([self.problem.space.numbers(y[:n]), y[n:]])

    def simulate(self, numbers, adjoint=None):
        problem, solve, n = self.problem, self.problem.solve(adjoint), self.problem.space.size
        states = jnp.reshape(numbers[n:], (problem.balls, self.joints, self.components.size))
        candidate = problem.space.candidate_of(numbers[:n])
        return problem.of_each(candidate, lambda one, states: self.in_pieces(one, states, solve), states)

    def assess(self, runs):
        def of_ball(run: Run, defects: Float[Array, "joints components"]) -> Evaluation:
            at = self.problem.evaluate_run(run)
            return at._replace(violations=jnp.concatenate([at.violations, jnp.ravel(defects)]))

        return merged(jax.vmap(of_ball)(*runs))

    def in_pieces(
        self, candidate: Candidate, states: Float[Array, "joints components"], solve: Solve
    ) -> tuple[Run, Float[Array, "joints components"]]:
        """The run in pieces from ``states``, and the gap between the end of each and the start of the next."""

        def piece(times: Float[Array, " t"], state: BallState | DiskState) -> tuple[Any, Int[Array, ""]]:
            run = run_of(candidate._replace(times=times, state=state), solve)
            return run.state, run.status

        later = jax.vmap(self.components.unpack)(states)
        begin = jax.tree.map(lambda x, others: jnp.concatenate([x[None], others]), candidate.state, later)
        pieces, status = jax.vmap(piece)(candidate.times[self._rows], begin)
        whole = jax.tree.map(lambda x: jnp.concatenate([*x[:, :-1], x[-1, -1:]]), pieces)
        ends = jax.tree.map(lambda x: x[:-1, -1], pieces)
        pack = jax.vmap(self.components.pack)
        return Run(candidate.system, candidate.times, whole, jnp.max(status)), pack(ends) - pack(later)

    @property
    def _steps(self) -> int:
        return self.problem.space.scenario.times.size - 1

    @property
    def _rows(self) -> np.ndarray:
        """The samples of each piece; its last is the first of the next."""
        each = self._steps // self.intervals
        return np.arange(self.intervals)[:, None] * each + np.arange(each + 1)[None]
