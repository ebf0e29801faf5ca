"""The contract of optimal control problems, and the polynomials that solve them."""

import abc
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...solvers.tableau import gauss

# The violation of an inequality that is allowed between the nodes.
VIOLATION = 1e-4


class AbstractControlProblem(eqx.Module):
    """Minimise the mean over [start, end] of a running cost, from a given state to one that fulfils end conditions.

    min 1/T ∫ cost(t, x, u) dt  with  ẋ = rate(t, x, u),  x(start) = x_a,  conditions(x(end)) = 0,
    inequalities(t, x, u) ≥ 0,  T = end − start.

    The conditions are in fact conditions(x(end)) = ``softness`` · multipliers, with softness 0 in the problem to be
    solved. A positive softness replaces them by the cost |conditions|² / (2 softness), so that a problem is regular
    even where some of them are redundant to first order; from there, continuation brings the softness to 0.
    """

    start: eqx.AbstractVar[Float[Array, ""]]
    end: eqx.AbstractVar[Float[Array, ""]]
    softness: eqx.AbstractVar[Float[Array, ""]]

    @property
    @abc.abstractmethod
    def controls(self) -> int:
        """The number m of controls."""

    @property
    @abc.abstractmethod
    def initial(self) -> Float[Array, " n"]:
        """x_a."""

    @property
    def free_at_start(self) -> tuple[int, ...]:
        """The indices of the entries of x that x_a does not determine at the start; by default none."""
        return ()

    @abc.abstractmethod
    def rate(self, t: Float[Array, ""], x: Float[Array, " n"], u: Float[Array, " m"]) -> Float[Array, " n"]:
        """Computes ẋ."""

    @abc.abstractmethod
    def cost(self, t: Float[Array, ""], x: Float[Array, " n"], u: Float[Array, " m"]) -> Float[Array, ""]:
        """Computes the running cost at one time."""

    @abc.abstractmethod
    def conditions(self, x: Float[Array, " n"]) -> Float[Array, " k"]:
        """Returns the conditions that must vanish at the end."""

    def inequalities(self, t: Float[Array, ""], x: Float[Array, " n"], u: Float[Array, " m"]) -> Float[Array, " i"]:
        """Returns the functions that must not be negative at any time, with second derivatives everywhere; by default
        none.
        """
        return jnp.zeros_like(t, shape=(0,))


class Path(NamedTuple):
    """States of degree s and controls of degree s − 1 on each interval of a mesh.

    - ``mesh``: times, the start first and the end last, shape (N + 1,).
    - ``knots``, ``nodes``: the states at the starts and the ends of intervals, and at the nodes of Gauss.
    - ``controls``: at the nodes.
    """

    mesh: Float[np.ndarray, " N_plus_one"]
    knots: Float[np.ndarray, "N_plus_one n"]
    nodes: Float[np.ndarray, "N s n"]
    controls: Float[np.ndarray, "N s m"]

    @property
    def state_coefficients(self) -> Float[np.ndarray, "N s_plus_one n"]:
        """The coefficients of the powers of (t − t_k) / h_k, the constant first."""
        fractions = np.concatenate([[0.0], gauss(self.nodes.shape[1]).c])
        return _coefficients(fractions, np.concatenate([self.knots[:-1, None], self.nodes], axis=1))

    @property
    def control_coefficients(self) -> Float[np.ndarray, "N s m"]:
        """The coefficients of the powers of (t − t_k) / h_k, the constant first."""
        return _coefficients(gauss(self.nodes.shape[1]).c, self.controls)

    def within(self, count: int) -> Float[np.ndarray, "N count"]:
        """Returns times spaced evenly in each interval, including both ends."""
        return self.mesh[:-1, None] + np.diff(self.mesh)[:, None] * np.linspace(0.0, 1.0, count)

    def states(self, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k n"]:
        """Evaluates x(t)."""
        interval, share = self._places(times)
        return _values(self.state_coefficients[interval], share)

    def rates(self, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k n"]:
        """Evaluates ẋ(t)."""
        interval, share = self._places(times)
        coefficients = self.state_coefficients
        slopes = coefficients[:, 1:] * np.arange(1.0, coefficients.shape[1])[:, None]
        return _values(slopes[interval], share) / np.diff(self.mesh)[interval, None]

    def inputs(self, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k m"]:
        """Evaluates u(t)."""
        interval, share = self._places(times)
        return _values(self.control_coefficients[interval], share)

    def _places(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Finds the interval of each time, and how far within it the time is, from 0 to 1."""
        # The last knot belongs to the last interval, not to one after it.
        interval = np.clip(np.searchsorted(self.mesh, times, side="right") - 1, 0, len(self.mesh) - 2)
        return interval, (times - self.mesh[interval]) / np.diff(self.mesh)[interval]


def _coefficients(fractions: Float[np.ndarray, " s"], values: Float[np.ndarray, "N s d"]) -> Float[np.ndarray, "N s d"]:
    return np.einsum("ij,kjd->kid", np.linalg.inv(np.vander(fractions, increasing=True)), values)


def _values(coefficients: Float[np.ndarray, "k s d"], share: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k d"]:
    powers = np.vander(share, coefficients.shape[1], increasing=True)
    return np.einsum("ks,ksd->kd", powers, coefficients)
