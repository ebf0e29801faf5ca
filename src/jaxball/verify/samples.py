"""The balances of a run, evaluated at the ends of the solver's steps and at Gauss nodes within them."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..numerics import programs
from ..physics.moments import Moments
from ..physics.packing import Packing
from ..simulation.trajectory import Interpolant, Trajectory
from ..simulation.watch import room_for
from ..solvers.dense.steps import Steps
from .quantities import quantities

# Enough for the polynomials of dense output, multiplied by factors that vary on the same scale.
NODES = 10
GAUSS = np.polynomial.legendre.leggauss(NODES)
FRACTIONS = np.concatenate([[0.0], (1 + GAUSS[0]) / 2, [1.0]])
WEIGHTS = GAUSS[1] / 2
DISPLACEMENT = 1e-6


@dataclasses.dataclass(frozen=True)
class Drift:
    """The departure of a quantity from its balance in a run.

    - ``residuals``: |A(t) − A(t0) − ∫ R dt| at the end of each step, where dA/dt = R is the law; of a vector, the
      largest component.
    - ``sensitivity``: the largest change of A, along the run, for a change of every component of the state by its
      tolerance, Σ |∂A/∂x_j| (atol + rtol |x_j|).
    """

    residuals: Float[np.ndarray, " steps"]
    sensitivity: float

    @property
    def residual(self) -> float:
        """The largest residual."""
        return float(np.max(self.residuals))


@dataclasses.dataclass(frozen=True)
class Samples:
    """The balances along a run: the ends of its steps, the drift by the name of the law, and the moments and axis at
    the nodes.
    """

    times: Float[np.ndarray, " steps"]
    drifts: dict[str, Drift]
    moments: Moments | None
    axis: Float[np.ndarray, "steps nodes 3"] | None


def sample(trajectory: Trajectory[Any, Any], rtol: float, atol: float) -> Samples:
    """The balances of a trajectory with dense output.

    A quantity is evaluated where steps end, and its rate is integrated over each step by Gauss–Legendre quadrature on
    the dense output. Steps end at kinks, so the rate is smooth within each.
    """
    interpolant = trajectory.interpolant
    assert interpolant is not None
    times, vectors, taken = map(np.asarray, _nodes(trajectory, room_for(trajectory)))
    starts, size = vectors[:, 0], vectors.shape[-1]
    change = DISPLACEMENT * (1 + np.abs(starts))
    displaced = starts[:, None] + change[:, None] * np.eye(size)[None]
    t = np.concatenate([times.ravel(), np.repeat(times[:, 0], size)])
    x = np.concatenate([vectors.reshape(-1, size), displaced.reshape(-1, size)])
    evaluated = _evaluate(interpolant.packing, jnp.asarray(t), jnp.asarray(x))
    count, number = int(taken.sum()), times.size
    lengths = (times[:, -1] - times[:, 0])[:count]

    def along(leaf: Any) -> np.ndarray:
        return np.asarray(leaf)[:number].reshape(*times.shape, -1)[:count]

    drifts = {}
    for name, (value, rate) in evaluated.balances.items():
        A, A_displaced = along(value), np.asarray(value)[number:].reshape(len(starts), size, -1)[:count]
        slope = np.abs(A_displaced - A[:, :1]) / change[:count, :, None]
        allowed = (atol + rtol * np.abs(starts[:count]))[:, :, None]
        drifts[name] = Drift(
            residuals=drift(A[:, 0], A[:, -1], along(rate)[:, 1:-1], lengths),
            sensitivity=float(np.max(np.sum(slope * allowed, axis=1))),
        )
    if evaluated.moments is None:
        return Samples(times[:count, -1], drifts, None, None)
    at_nodes = jax.tree.map(
        lambda leaf: np.asarray(leaf)[:number].reshape(*times.shape, *leaf.shape[1:])[:count], evaluated
    )
    return Samples(times[:count, -1], drifts, at_nodes.moments, at_nodes.axis)


def drift(
    start: Float[np.ndarray, "steps k"],
    end: Float[np.ndarray, "steps k"],
    rate: Float[np.ndarray, "steps nodes k"],
    lengths: Float[np.ndarray, " steps"],
) -> Float[np.ndarray, " steps"]:
    """The largest component of |A(t) − A(t0) − ∫ R dt| at each step's end, from A there and R at Gauss's nodes."""
    integrals = np.cumsum(lengths[:, None] * np.einsum("snk,n->sk", rate, WEIGHTS), axis=0)
    return np.max(np.abs(end - start[:1] - integrals), axis=1)


@programs.filter_jit
def _nodes(trajectory: Trajectory[Any, Any], room: int) -> tuple[Array, Array, Array]:
    """Times and vectors at the ends and Gauss's nodes of each step, and which steps were taken."""
    interpolant = trajectory.interpolant
    assert isinstance(interpolant, Interpolant)
    steps = Steps.of(interpolant.solution, trajectory.reached, room)
    fractions = jnp.asarray(FRACTIONS, steps.start.dtype)
    times = steps.start[:, None] + (steps.end - steps.start)[:, None] * fractions[None]

    # The first step replaces those that were not taken, so that all numbers are finite.
    index = jnp.where(steps.taken, jnp.arange(steps.start.size), 0)
    times = times[index]
    nodes = jnp.repeat(index, fractions.size), times.reshape(-1)
    states = jax.lax.map(lambda node: steps.state(*node), nodes)
    return times, states.reshape(*times.shape, -1), steps.taken


@programs.filter_jit
def _evaluate(packing: Packing[Any, Any], times: Float[Array, " rows"], vectors: Float[Array, "rows size"]) -> Any:
    # One after another: as a batch, a long formula on small vectors takes XLA several times as long to compile.
    return jax.lax.map(lambda row: quantities(packing.system, row[0], packing.unpack(*row)), (times, vectors))
