"""The estimates of a filter or a smoother, their covariances, and statistics that test whether these are right.

At one moment an estimate is a belief: a state, biases of sensors, and the covariance of the errors of both.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.special import gammaincinv

from ... import programs
from ...interface.arguments import refusal, require_count
from ...interface.compat import is_traced
from ...interface.names import leave_to
from ...interface.printing import Printed
from ...interface.wording import number_of
from ...physics.contact.slipping import Estimated

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

# Of a covariance scaled to a diagonal of 1, an eigenvalue below which a combination is known, but for rounding.
KNOWN_EXACTLY = 1e-12

# Of the terms that add up to a variance, the size below which their sum is rounding, in units of the last place.
CANCELS = 500


class Belief(NamedTuple):
    """An estimate: its errors are the local coordinates of the true state around ``state``, then those of biases."""

    state: Estimated
    bias: Float[Array, " biases"]
    P: Float[Array, "n n"]

    def move(self, change: Float[Array, " n"]) -> "Belief":
        """Changes the estimate by an error, and takes the covariance to local coordinates around the new state."""
        xi, bias_change = change[: change.size - self.bias.size], change[change.size - self.bias.size :]
        state = self.state.retract(xi)
        # The errors were counted around the old state; around the new one, local coordinates are turned.
        turn = jax.jacfwd(lambda d: state.difference(self.state.retract(xi + d)))(jnp.zeros_like(xi))
        G = jnp.eye(len(self.P), dtype=self.P.dtype).at[: xi.size, : xi.size].set(turn)
        return Belief(state, self.bias + bias_change, symmetric(G @ self.P @ G.T))


def symmetric(P: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Returns the symmetric part, without the rounding of products."""
    return 0.5 * (P + P.T)


def propagate(F: Float[Array, "m n"], P: Float[Array, "n n"]) -> Float[Array, "m m"]:
    """Computes F P Fᵀ, the covariance of what depends on errors as F says.

    Where variances cancel but for rounding, as those of a rate do that is the same however a slip began, it is 0.
    """
    moved, size = F @ P @ F.T, jnp.sum((jnp.abs(F) @ jnp.abs(P)) * jnp.abs(F), axis=1)
    uncertain = jnp.diagonal(moved) > CANCELS * jnp.finfo(moved.dtype).eps * size
    return jnp.where(uncertain[:, None] & uncertain[None], symmetric(moved), 0.0)


def deviations_in(P: Float[Array, "*samples n n"]) -> Float[Array, "*samples n"]:
    """Returns the standard deviations in covariances; a variance below 0 is rounding."""
    return jnp.sqrt(jnp.maximum(jnp.diagonal(P, axis1=-2, axis2=-1), 0.0))


def is_uncertain(P: Float[Array, "n n"]) -> Bool[Array, " n"]:
    """Returns whether there is any doubt about each principal direction of a covariance."""
    return _principal(P)[0] > KNOWN_EXACTLY


def inverse(P: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Computes the inverse of a covariance on the directions that are uncertain, 0 on directions that are known."""
    values, vectors, size = _principal(P)
    uncertain = values > KNOWN_EXACTLY
    # Directions that are known exactly would be divided by 0; the inner `where` keeps that out of the derivative,
    # too.
    weights = jnp.where(uncertain, 1.0 / jnp.where(uncertain, values, 1.0), 0.0)
    scaled = vectors / size[:, None]
    return (scaled * weights[None]) @ scaled.T


def _principal(P: Float[Array, "n n"]) -> tuple[Float[Array, " n"], Float[Array, "n n"], Float[Array, " n"]]:
    """Computes eigenvalues and vectors of a covariance scaled to a diagonal of 1, and the scales."""
    # Eigenvalues of coordinates with different units do not compare; scaled by their deviations they do.
    size = deviations_in(P)
    size = jnp.where(size > 0, size, 1.0)
    values, vectors = jnp.linalg.eigh(P / size[:, None] / size[None])
    return values, vectors, size


class Filtered(NamedTuple):
    """A pass of a filter over K samples.

    - ``belief``: with each sample's reading; ``ahead``: before it.
    - ``F``: the derivative of the flow of errors from each sample to the next.
    - ``innovation``, ``S``, ``there``: reading less expectation, 0 where nothing was read, its covariance, and where
      something was.
    """

    belief: Belief
    ahead: Belief
    F: Float[Array, "K_less_one n n"]
    innovation: Float[Array, "K m"]
    S: Float[Array, "K m m"]
    there: Bool[Array, "K m"]

    @property
    def nis(self) -> Float[Array, " K"]:
        """The normalised innovation squared; NaN where nothing was read."""
        return jnp.where(self.read > 0, jax.vmap(_weigh)(self.S, self.innovation), jnp.nan)

    @property
    def read(self) -> Int[Array, " K"]:
        """How many numbers were read at each sample."""
        return jnp.sum(self.there, axis=1)


class Followed(NamedTuple):
    """The estimates of a closed loop at its samples and its end, where nothing was read: NaN, and 0 in ``read``.

    - ``belief``: with each sample's reading.
    - ``nis``, ``read``: the normalised innovation squared, and how many numbers were read.
    """

    belief: Belief
    nis: Float[Array, " K"]
    read: Int[Array, " K"]


class AbstractEstimate(Printed):
    """The state of a robot at each sample, as far as its sensors tell, and how sure that is.

    - ``times``: of the samples, shape (K,).
    - ``directions``: the local coordinates of a state, by name.
    - ``biases``: the estimated biases, by name.
    - ``filtered``: the pass of the filter that made the estimates.
    """

    times: Float[Array, " K"]
    directions: tuple[str, ...] = eqx.field(static=True)
    biases: tuple[str, ...] = eqx.field(static=True)
    filtered: eqx.AbstractVar[Any]  # Filtered or Followed

    @property
    def state(self) -> Estimated:
        """The estimated states, with the samples as leading axis."""
        return self.filtered.belief.state

    @property
    def bias_values(self) -> Float[Array, "K biases"]:
        """The estimated biases of sensors, in the order of ``biases``."""
        return self.filtered.belief.bias

    @property
    def covariance(self) -> Float[Array, "K n n"]:
        """Of the errors of local coordinates and biases, in the order of ``directions`` and ``biases``."""
        return self.filtered.belief.P

    @property
    def nis(self) -> Float[Array, " K"]:
        """The normalised innovation squared νᵀS⁻¹ν: distributed as χ², with as many degrees as were read.

        NaN where nothing was.
        """
        return self.filtered.nis

    @property
    def read(self) -> Int[Array, " K"]:
        """How many numbers were read at each sample."""
        return self.filtered.read

    @property
    def bias(self) -> dict[str, Float[Array, " K"]]:
        """The estimated biases of sensors, by name."""
        return {name: self.bias_values[:, k] for k, name in enumerate(self.biases)}

    @property
    def deviations(self) -> dict[str, Float[Array, " K"]]:
        """The standard deviation of each error, by name."""
        size = deviations_in(self.covariance)
        return {name: size[:, k] for k, name in enumerate((*self.directions, *self.biases))}

    def errors(self, truth: Estimated) -> Float[Array, "K directions"]:
        """Computes the local coordinates of the true states around the estimated ones.

        **Arguments:**

        - ``truth``: the states at the samples, of the same kind, as a simulation has them; with a law of contact, as
          ``truth`` of the filter returns them.

        **Raises:** ``TypeError`` for another kind of state, ``ValueError`` for another number of them.
        """
        if type(truth) is not type(self.state):
            raise refusal("truth", f"the states at the samples, a {type(self.state).__name__}", truth)
        counts = [jax.tree.leaves(states)[0].shape[0] for states in (truth, self.state)]
        require_count("Argument `truth`", counts[0], counts[1], "sample")
        return jax.vmap(lambda estimated, true: estimated.difference(true))(self.state, truth)

    def nees(self, truth: Estimated) -> Float[Array, " K"]:
        """Computes the normalised estimation error squared ξᵀP⁻¹ξ: distributed as χ², with ``degrees`` degrees, if P is
        right.

        **Arguments** and **raises:** as :meth:`errors`.
        """
        n = len(self.directions)
        return jax.vmap(_weigh)(self.covariance[:, :n, :n], self.errors(truth))

    @property
    def uncertain(self) -> Int[Array, " K"]:
        """How many directions of each estimated state are uncertain: the degrees of freedom of ``nees``."""
        n = len(self.directions)
        return jax.vmap(lambda P: jnp.sum(is_uncertain(P[:n, :n])))(self.covariance)

    @property
    def degrees(self) -> int:
        """How many directions of the last estimated state are uncertain."""
        # The last row of a closed loop is NaN.
        finite = jnp.isfinite(self.covariance[:, 0, 0])
        return int(self.uncertain[jnp.sum(finite) - 1])

    @leave_to("...plot.control:estimate")
    def plot(self, truth: Estimated | None = None, confidence: float = 0.95) -> "matplotlib.figure.Figure":
        """Draws the errors over time, the biases of sensors, and in the last panels normalised squares.

        Bands show where errors, and around their estimates biases, lie with this probability if the filter is right;
        where the truth is known, lines show the errors. The normalised squares of innovations, and of errors where the
        truth is known, lie between the dashed lines with the same probability.

        **Arguments:**

        - ``truth``: the states at the samples, as a simulation has them.
        - ``confidence``: the probability.

        **Raises:** as :meth:`errors`; ``ValueError`` for a probability that is not between 0 and 1.
        """
        raise NotImplementedError


class LoopEstimate(AbstractEstimate):
    """What a filter in a closed loop estimated, at the samples and at the end of the run, where it is NaN.

    The arguments are those of an :class:`AbstractEstimate`.
    """

    filtered: Followed


class Estimate(AbstractEstimate):
    """What a filter has found, as an :class:`AbstractEstimate`, with the whole pass of the filter.

    - ``filtered``: the whole pass of the filter.
    - The others: as in an :class:`AbstractEstimate`.
    """

    filtered: Filtered

    @property
    def innovations(self) -> Float[Array, "K m"]:
        """Each reading less what was expected of it, divided by its standard deviation; NaN where nothing was read."""
        size = jnp.sqrt(jnp.diagonal(self.filtered.S, axis1=1, axis2=2))
        return jnp.where(self.filtered.there, self.filtered.innovation / size, jnp.nan)

    def smoothed(self) -> "Estimate":
        """Computes the estimates with all readings, also those after each sample: by Rauch's, Tung's and Striebel's
        smoother.
        """
        return _smooth(self)

    def __repr__(self) -> str:
        if is_traced(self.times):
            return "Estimate, traced"
        read = int(np.sum(np.asarray(self.read)))
        lines = [f"Estimate at {number_of(len(self.times), 'sample')}, from {number_of(read, 'reading')}"]
        for name, size in self.deviations.items():
            lines.append(f"  {name}: ±{float(size[0]):.3g} at the start, ±{float(size[-1]):.3g} at the end")
        return "\n".join(lines)


def chi2_bounds(degrees: int, runs: int = 1, confidence: float = 0.95) -> tuple[float, float]:
    """Computes the interval in which the mean of ``runs`` independent χ² numbers lies with this probability.

    **Arguments:**

    - ``degrees``: their degrees of freedom.
    - ``runs``: how many are averaged.
    - ``confidence``: the probability.
    """
    low, high = bounds_of_squares(np.asarray(degrees * runs), confidence)
    return float(low) / runs, float(high) / runs


def bounds_of_squares(degrees: Int[np.ndarray, "*K"], confidence: float) -> list[Float[np.ndarray, "*K"]]:
    """Returns the bounds between which squares lie that are distributed as χ²; NaN without degrees of freedom."""
    tail = (1 - confidence) / 2
    return [np.where(degrees > 0, largest_square(p, np.maximum(degrees, 1)), np.nan) for p in (tail, 1 - tail)]


def largest_square(share: float, degrees: Int[np.ndarray, "*K"] | int) -> Float[np.ndarray, "*K"]:
    """Computes the number below which a share of squares lies that are distributed as χ²."""
    # `scipy.stats` has it, too, and takes a second to import.
    return np.asarray(2 * gammaincinv(np.asarray(degrees) / 2, share))


@programs.filter_jit
def _smooth(estimate: Estimate) -> Estimate:
    filtered = estimate.filtered

    def back(later: Belief, sample: tuple[Belief, Belief, Array]) -> tuple[Belief, Belief]:
        now, ahead, F = sample
        # The covariance ahead is singular where something is known exactly; the inverse leaves these directions out.
        gain = now.P @ F.T @ inverse(ahead.P)
        change = jnp.concatenate([ahead.state.difference(later.state), later.bias - ahead.bias])
        P = now.P + gain @ (later.P - ahead.P) @ gain.T
        # By `move`, because the earlier state changes and its covariance is taken along.
        earlier = now._replace(P=P).move(gain @ change)
        return earlier, earlier

    # At the last sample, the filter has already used all readings.
    last, before = (jax.tree.map(lambda x, part=part: x[part], filtered.belief) for part in (-1, np.s_[:-1]))
    following = jax.tree.map(lambda x: x[1:], filtered.ahead)
    beliefs = jax.lax.scan(back, last, (before, following, filtered.F), reverse=True)[1]
    whole = jax.tree.map(lambda x, end: jnp.concatenate([x, end[None]]), beliefs, last)
    return Estimate(estimate.times, estimate.directions, estimate.biases, filtered._replace(belief=whole))


def _weigh(P: Float[Array, "n n"], x: Float[Array, " n"]) -> Float[Array, ""]:
    """Computes xᵀP⁻¹x, without what is known."""
    return x @ inverse(P) @ x
