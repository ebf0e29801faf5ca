"""Checks of a gradient against directional differences over a range of steps, and against forward mode."""

from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..problem.variables import DesignError
from .optimise import Optimiser
from .program import Multipliers, augmented_lagrangian

STEPS = tuple(10.0 ** -np.arange(1.0, 6.5, 0.5))
STENCIL = (-2.0, -1.0, 1.0, 2.0)
FIVE_POINTS = np.asarray([1.0, -8.0, 8.0, -1.0]) / 12
MODES_AGREE, DIFFERENCES_AGREE = 1e-5, 1e-3


class GradientCheck(NamedTuple):
    """The derivative along one direction by several methods, relative to the length of the gradient.

    - ``gradient``: by the gradient that the search uses: in reverse mode, or in forward mode for Gauss–Newton.
    - ``forward``: in forward mode, along that direction only.
    - ``steps``, ``differences``: by the five-point formula with each step.
    """

    gradient: float
    forward: float
    steps: tuple[float, ...]
    differences: tuple[float, ...]

    @property
    def between_modes(self) -> float:
        """|forward − gradient|."""
        return abs(self.forward - self.gradient)

    @property
    def from_differences(self) -> float:
        """The least |difference − gradient| over the steps, between truncation and rounding errors."""
        errors = np.abs(np.asarray(self.differences) - self.gradient)
        return float(np.min(errors[np.isfinite(errors)], initial=np.inf))

    @property
    def good(self) -> bool:
        """Whether the gradient can be trusted."""
        return self.between_modes < MODES_AGREE and self.from_differences < DIFFERENCES_AGREE

    def __repr__(self) -> str:
        rows = [
            f"  step {h:8.1e}  error {abs(d - self.gradient):8.1e}"
            for h, d in zip(self.steps, self.differences, strict=True)
        ]
        return "\n".join([f"  gradient against forward mode {self.between_modes:.1e}", *rows])


def check_gradient(optimiser: Optimiser, y: Float[np.ndarray, " n"], seed: int = 0) -> GradientCheck:
    """The derivative, along a random direction at ``y``, of a sum of all objectives and constraints.

    The sum is the augmented Lagrangian with multipliers so large that every point of every constraint counts.

    **Arguments:**

    - ``optimiser``: whose sum and gradient are checked.
    - ``y``: the unknowns of its program, shape (n,).
    - ``seed``: of the direction.

    **Raises:** :class:`DesignError` where ``y`` cannot be simulated or the gradient is not finite.
    """
    direction = np.random.default_rng(seed).normal(size=y.shape)
    direction /= np.linalg.norm(direction)
    first = optimiser.evaluate(y[None], optimiser.penalised(1)).at
    violations = first.violations[0]
    if not (np.all(np.isfinite(violations)) and np.all(np.isfinite(first.terms[0]))):
        raise DesignError("The design at which the gradient is checked must be simulated to its end, but it is not.")
    counted = 2 * np.maximum(0.0, -violations) + 1
    multipliers = Multipliers(counted, np.asarray(1.0), np.zeros(counted.size))
    shifts = np.asarray([0.0, *(h * k for h in STEPS for k in STENCIL)])
    points = y[None] + shifts[:, None] * direction[None]
    repeated = jax.tree.map(lambda x: np.broadcast_to(x, (len(points), *x.shape)), multipliers)
    at = optimiser.evaluate(points, repeated)
    gradient = at.gradient[0]
    if not np.all(np.isfinite(gradient)):
        entries = zip(optimiser.program.names, np.isfinite(gradient), strict=True)
        names = dict.fromkeys(name for name, finite in entries if not finite)
        raise DesignError(f"The gradient at the start must be finite, but it is not for {', '.join(names)}.")
    size = float(np.linalg.norm(gradient)) or 1.0
    differences = at.value[1:].reshape(len(STEPS), 4) @ FIVE_POINTS / np.asarray(STEPS)
    forward = _forward(optimiser, *jax.tree.map(jnp.asarray, (y, direction, multipliers)))
    return GradientCheck(
        float(gradient @ direction) / size, forward / size, STEPS, tuple(float(d) for d in differences / size)
    )


def require_good(check: GradientCheck) -> None:
    """Raises a :class:`DesignError` where a gradient cannot be trusted.

    **Arguments:**

    - ``check``: what :func:`check_gradient` returns.
    """
    if not check.good:
        raise DesignError(
            f"The gradient must agree with differences to {DIFFERENCES_AGREE:g} and with forward mode to "
            f"{MODES_AGREE:g}, but it is off by {check.from_differences:.1e} and {check.between_modes:.1e}; tighten "
            f"`solve.rtol` and `solve.atol`, or start elsewhere.\n{check}"
        )


def _forward(
    optimiser: Optimiser, y: Float[Array, " n"], direction: Float[Array, " n"], multipliers: Multipliers
) -> float:
    program = optimiser.program

    def value(y):
        return augmented_lagrangian(program, program.evaluate(y, diffrax.ForwardMode()), multipliers)

    return float(jax.jit(lambda y, v: jax.jvp(value, (y,), (v,))[1])(y, direction))
