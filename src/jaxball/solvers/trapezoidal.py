"""The trapezoidal rule."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from .diagonal import AbstractDiagonallyImplicit, diagonally_implicit
from .tableau import Tableau


class Trapezoidal(AbstractDiagonallyImplicit):
    """The trapezoidal rule, y₁ = y₀ + h/2 (f₀ + f₁), as in MATLAB's ode23t.

    Order 2, A-stable and not L-stable: it adds no damping, and stiff components that the steps do not resolve oscillate
    for a long time. For low accuracy.

    The error h³y‴/12 is taken from the second divided difference of f over this step and the one before (Shampine,
    Reichelt & Kierzenka 1999). On a first step and after a jump there is none, and the difference to Euler's rule is
    used instead, which is too large and makes the step short.

    **Arguments:**

    - ``root_finder``: :class:`~jaxball.solvers.SimplifiedNewton` or :class:`~jaxball.solvers.FixedPoint`.
    """

    tableau: ClassVar[Tableau] = diagonally_implicit([1.0], [[0.5]])
    first: ClassVar[np.ndarray] = np.array([[0.5]])

    def estimated_error(self, K, h, before):
        k0, k1 = K
        # h³/12 times the second derivative of f, from f at three times; k₀ = h f₀, k₁ = h f₁.
        second = k1 - k0 - (k0 - h * before.f_start) * h / before.length
        return jnp.where(before.known, h / (6 * (h + before.length)) * second, (k1 - k0) / 2)
