"""System identification: the parameters of a ball from what was recorded of its motion, with their uncertainties."""

import dataclasses
from collections.abc import Callable
from statistics import NormalDist

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import programs
from ...interface.printing import repr_html
from ...numerics.arrays import to_numpy
from ...numerics.fitting import find_determined, fit_unknowns, where_finite
from .problem.requirements import places
from .problem.run import Run, Solve, run_of
from .problem.space import DesignError, DesignSpace, Parametrisation

# A combination of parameters that is uncertain by this fraction of its scale counts as undetermined.
UNCERTAIN = 0.5


@dataclasses.dataclass(frozen=True)
class Identification:
    """Parameters found from a path.

    - ``names``, ``estimates``: the variables and their values.
    - ``deviations``: their standard deviations, to first order: σ² (JᵀJ)⁻¹; infinite for those in ``unseen``.
    - ``correlations``: between the errors of the estimates, shape (n, n).
    - ``noise``: the standard deviation of the path's noise, from the residuals.
    - ``singular_values``: of J, in scales of the variables.
    - ``unseen``: combinations of the variables, in scales, that do not change the path, shape (k, n);
      ``uncertain``: those that change it so little that they are uncertain by half of their scale or more.
    - ``ok``: whether the last step was negligible, within 60 evaluations.
    """

    names: tuple[str, ...]
    estimates: Float[np.ndarray, " n"]
    deviations: Float[np.ndarray, " n"]
    correlations: Float[np.ndarray, "n n"]
    noise: float
    singular_values: Float[np.ndarray, " n"]
    unseen: Float[np.ndarray, "k n"]
    uncertain: Float[np.ndarray, "l n"]
    ok: bool

    def intervals(self, confidence: float = 0.95) -> Float[np.ndarray, "n 2"]:
        """Computes the confidence interval of each parameter."""
        half = NormalDist().inv_cdf((1 + confidence) / 2) * self.deviations
        return np.stack([self.estimates - half, self.estimates + half], axis=1)

    @property
    def alike(self) -> list[tuple[str, ...]]:
        """Sets of parameters that the path cannot distinguish; a single one is not determined by it at all."""
        sizes = np.abs([*self.unseen, *self.uncertain])
        large = [size > 0.1 * np.max(size) for size in sizes]
        return [tuple(name for name, part in zip(self.names, parts, strict=True) if part) for parts in large]

    _repr_html_ = repr_html

    def __repr__(self) -> str:
        rows = [
            f"  {name} = {value:.8g} ± {error:.2g}"
            for name, value, error in zip(self.names, self.estimates, self.deviations, strict=True)
        ]
        for names in self.alike:
            verb = "does not determine" if len(names) == 1 else "cannot tell apart"
            rows.append(f"  the path {verb} {' and '.join(names)}")
        return "\n".join([f"noise {self.noise:.3g}", *rows])


def identify(
    space: DesignSpace,
    path: Float[np.ndarray, "T *d"],
    quantity: Callable[[Run], Float[Array, "T *d"]] | None = None,
) -> Identification:
    path = to_numpy(path, "path")
    times, solve = space.scenario.times, Solve.of(space.scenario, diffrax.ForwardMode())
    if quantity is None:
        place = np.shape(space.placed.z)
        shape, each = (times.size, *place), f"{'two numbers' if place else 'one number'} each"
        must = f"be a position for each of the {times.size} save times, {each}"
    else:
        shape = jax.eval_shape(lambda y: quantity(run_of(space.candidate(y), solve)), jnp.asarray(space.start)).shape
        must = f"have the shape {shape} of the quantity at the {times.size} save times"
    if path.shape != shape:
        raise DesignError(f"Argument `path` must {must}, but its shape is {path.shape}.")
    unknown = np.flatnonzero(~np.isfinite(path.reshape(times.size, -1)).all(axis=1))
    if unknown.size:
        others = unknown.size - 1
        more = f", and so {'is' if others == 1 else 'are'} {others} more" if others else ""
        raise DesignError(
            f"Argument `path` must be finite, but the position at t = {times[unknown[0]]:g}, `path[{unknown[0]}]`, is "
            f"{path[unknown[0]].tolist()}{more}; leave such times out of the scenario and of the path."
        )
    if quantity is None:
        path = np.asarray(places("path")(path))
    recorded, seen = jnp.asarray(path), space.parametrisation
    of_run = _position if quantity is None else quantity
    evaluate = where_finite(lambda y: _residuals_and_slopes(seen, recorded, jnp.asarray(y), solve, of_run))
    if not np.all(np.isfinite(evaluate(tuple(space.start))[0])):
        raise DesignError(
            "The scenario must be simulated to its end at the start of the identification, but it is not."
        )
    y, converged = fit_unknowns(evaluate, space.start)
    return _estimate(space, y, *evaluate(tuple(y)), converged)


def _position(run: Run) -> Float[Array, "T 2"]:
    return run.z


# No closure of a call: scenarios and paths that differ in numbers alone share one program.
@programs.filter_jit
def _residuals_and_slopes(
    seen: Parametrisation,
    path: Float[Array, "T *d"],
    y: Float[Array, " n"],
    solve: Solve,
    quantity: Callable[[Run], Float[Array, "T *d"]],
) -> tuple[Float[Array, " residuals"], Float[Array, "residuals n"]]:
    def residuals(y: Float[Array, " n"]) -> Float[Array, " residuals"]:
        return jnp.ravel(quantity(run_of(seen.candidate(y), solve)) - path)

    return residuals(y), jax.jacfwd(residuals)(y)


@programs.filter_jit
def _numbers_and_slopes(seen: Parametrisation, y: Float[Array, " n"]) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    return seen.numbers(y), jax.jacfwd(seen.numbers)(y)


def _estimate(space: DesignSpace, y: np.ndarray, r: np.ndarray, J: np.ndarray, converged: bool) -> Identification:
    """Computes the estimates at the unknowns y, with their errors from the Jacobian J."""
    times = space.scenario.times.size
    _, s, Vt = np.linalg.svd(J, full_matrices=False)
    seen = find_determined(s)
    of_each_time = np.abs(J.reshape(times, -1, len(y)))
    # Columns of the path that no parameter moves, as z2 of a straight path, say nothing about the noise of the fit.
    rows = int(np.sum(np.any(of_each_time > 0, axis=(0, 2)))) * times
    # Parameters that were fitted use up as many residuals; at least one is left to divide by.
    noise = float(np.sqrt(r @ r / max(rows - int(np.sum(seen)), 1)))
    covariance = noise**2 * (Vt[seen].T / s[seen] ** 2) @ Vt[seen]
    x, slopes = map(np.asarray, _numbers_and_slopes(space.parametrisation, jnp.asarray(y)))
    # From unknowns y to numbers x within their bounds; each x depends on its own y, so that the Jacobian is diagonal.
    slope = np.diag(slopes)
    deviations = np.abs(slope) * np.sqrt(np.diag(covariance))
    # A parameter that takes part in an unseen combination is not determined, however well the others are.
    undetermined = np.asarray(np.any(np.abs(Vt[~seen]) > 1e-3, axis=0))
    size = np.sqrt(np.where(np.diag(covariance) > 0, np.diag(covariance), 1.0))
    correlations = covariance / size[:, None] / size[None]
    # A correlation with infinite variance has no meaning.
    correlations = np.where(undetermined[:, None] | undetermined[None], np.eye(len(y)), correlations)
    return Identification(
        names=space.names,
        estimates=x,
        deviations=np.where(undetermined, np.inf, deviations),
        correlations=correlations,
        noise=noise,
        singular_values=s,
        unseen=Vt[~seen],
        uncertain=Vt[seen & (noise > UNCERTAIN * s)],
        ok=converged,
    )
