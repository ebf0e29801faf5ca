"""The polynomials that a collocation method finds: states, their rates and controls at any time."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...solvers.tableau import gauss


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
        at = np.concatenate([[0.0], gauss(self.nodes.shape[1]).c])
        return _coefficients(at, np.concatenate([self.knots[:-1, None], self.nodes], axis=1))

    @property
    def control_coefficients(self) -> Float[np.ndarray, "N s m"]:
        """The coefficients of the powers of (t − t_k) / h_k, the constant first."""
        return _coefficients(gauss(self.nodes.shape[1]).c, self.controls)

    def within(self, count: int) -> Float[np.ndarray, "N count"]:
        """Times spaced evenly in each interval, including both ends."""
        return self.mesh[:-1, None] + np.diff(self.mesh)[:, None] * np.linspace(0.0, 1.0, count)

    def states(self, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k n"]:
        """x(t)."""
        interval, share = self._places(times)
        return _values(self.state_coefficients[interval], share)

    def rates(self, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k n"]:
        """ẋ(t)."""
        interval, share = self._places(times)
        coefficients = self.state_coefficients
        slopes = coefficients[:, 1:] * np.arange(1.0, coefficients.shape[1])[:, None]
        return _values(slopes[interval], share) / np.diff(self.mesh)[interval, None]

    def inputs(self, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k m"]:
        """u(t)."""
        interval, share = self._places(times)
        return _values(self.control_coefficients[interval], share)

    def _places(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The interval of each time, and how far within it the time is, from 0 to 1."""
        interval = np.clip(np.searchsorted(self.mesh, times, side="right") - 1, 0, len(self.mesh) - 2)
        return interval, (times - self.mesh[interval]) / np.diff(self.mesh)[interval]


def _coefficients(at: Float[np.ndarray, " s"], values: Float[np.ndarray, "N s d"]) -> Float[np.ndarray, "N s d"]:
    return np.einsum("ij,kjd->kid", np.linalg.inv(np.vander(at, increasing=True)), values)


def _values(coefficients: Float[np.ndarray, "k s d"], share: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k d"]:
    powers = np.vander(share, coefficients.shape[1], increasing=True)
    return np.einsum("ks,ksd->kd", powers, coefficients)
