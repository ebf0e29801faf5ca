"""The balances of a run, sampled within the steps of its solver."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..physics.moments import Moments
from ..physics.packing import Packing
from ..simulation.trajectory import Interpolant, Trajectory
from ..simulation.watch import room_for
from ..solvers.dense.steps import Steps
from .quantities import quantities

# Enough for the polynomials that dense output is made of, times factors that vary as they do.
NODES = 10
GAUSS = np.polynomial.legendre.leggauss(NODES)
FRACTIONS = np.concatenate([[0.0], (1 + GAUSS[0]) / 2, [1.0]])
WEIGHTS = GAUSS[1] / 2
DISPLACEMENT = 1e-6


@dataclasses.dataclass(frozen=True)
class Drift:
    """How far a quantity departed from its balance in a run.

    - ``residual``: the largest |A(t) − A(t0) − ∫ R dt| at the ends of the steps, where dA/dt = R is the law.
    - ``sensitivity``: the largest change of A, along the run, for a change of every component of the state by its
      tolerance, Σ |∂A/∂x_j| (atol + rtol |x_j|).
    """

    residual: float
    sensitivity: float


@dataclasses.dataclass(frozen=True)
class Samples:
    """The balances along a run: the drift by the name of the law, and the moments and axis at the nodes."""

    drifts: dict[str, Drift]
    moments: Moments | None
    axis: Float[np.ndarray, "steps nodes 3"] | None


def sample(trajectory: Trajectory[Any, Any], rtol: float, atol: float) -> Samples:
    """The balances of a trajectory with dense output.

    A quantity is looked at where steps end, and its rate is integrated over each step by the rule of Gauss and
    Legendre on the dense output. Steps end at kinks, so that the rate is smooth within them.
    """
    interpolant = trajectory.interpolant
    assert interpolant is not None
    times, vectors, taken = (np.asarray(found) for found in _nodes(trajectory, room_for(trajectory)))
    starts, size = vectors[:, 0], vectors.shape[-1]
    change = DISPLACEMENT * (1 + np.abs(starts))
    displaced = starts[:, None] + change[:, None] * np.eye(size)[None]
    t = np.concatenate([times.ravel(), np.repeat(times[:, 0], size)])
    x = np.concatenate([vectors.reshape(-1, size), displaced.reshape(-1, size)])
    found = _evaluate(interpolant.packing, jnp.asarray(t), jnp.asarray(x))
    count, number = int(taken.sum()), times.size
    lengths = (times[:, -1] - times[:, 0])[:count]

    def along(leaf: Any) -> np.ndarray:
        return np.asarray(leaf)[:number].reshape(*times.shape, -1)[:count]

    drifts = {}
    for name, (value, rate) in found.balances.items():
        A, moved = along(value), np.asarray(value)[number:].reshape(len(starts), size, -1)[:count]
        slope = np.abs(moved - A[:, :1]) / change[:count, :, None]
        allowed = (atol + rtol * np.abs(starts[:count]))[:, :, None]
        drifts[name] = Drift(
            residual=drift(A[:, 0], A[:, -1], along(rate)[:, 1:-1], lengths),
            sensitivity=float(np.max(np.sum(slope * allowed, axis=1))),
        )
    if found.moments is None:
        return Samples(drifts, None, None)
    moments = jax.tree.map(lambda leaf: np.asarray(leaf)[:number].reshape(*times.shape, *leaf.shape[1:])[:count], found)
    return Samples(drifts, moments.moments, moments.axis)


def drift(
    start: Float[np.ndarray, "steps k"],
    end: Float[np.ndarray, "steps k"],
    rate: Float[np.ndarray, "steps nodes k"],
    lengths: Float[np.ndarray, " steps"],
) -> float:
    """The largest |A(t) − A(t0) − ∫ R dt| at the ends of steps, from A at their ends and R at Gauss's nodes."""
    integrals = np.cumsum(lengths[:, None] * np.einsum("snk,n->sk", rate, WEIGHTS), axis=0)
    return float(np.max(np.abs(end - start[:1] - integrals)))


@eqx.filter_jit
def _nodes(trajectory: Trajectory[Any, Any], room: int) -> tuple[Array, Array, Array]:
    """Times and vectors at the ends and Gauss's nodes of each step, and which steps were taken."""
    interpolant = trajectory.interpolant
    assert isinstance(interpolant, Interpolant)
    steps = Steps.of(interpolant.solution, room, trajectory.reached)
    fractions = jnp.asarray(FRACTIONS, steps.start.dtype)
    times = steps.start[:, None] + (steps.end - steps.start)[:, None] * fractions[None]

    def one(place):
        index, t = place
        return steps.state(index, t)

    # Steps that were not taken stand for the first, so that all numbers are finite.
    index = jnp.where(steps.taken, jnp.arange(steps.start.size), 0)
    times = times[index]
    places = jnp.repeat(index, fractions.size), times.reshape(-1)
    return times, jax.lax.map(one, places).reshape(*times.shape, -1), steps.taken


@eqx.filter_jit
def _evaluate(packing: Packing[Any, Any], times: Float[Array, " rows"], vectors: Float[Array, "rows size"]) -> Any:
    # One by one: as a batch, a long formula on small vectors takes XLA several times as long to compile.
    return jax.lax.map(lambda at: quantities(packing.system, at[0], packing.unpack(*at)), (times, vectors))
