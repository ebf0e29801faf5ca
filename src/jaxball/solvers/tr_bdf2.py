"""TR-BDF2."""

import math
from typing import ClassVar

import numpy as np

from .diagonal import AbstractDiagonallyImplicit, diagonally_implicit
from .stages import combine
from .tableau import Tableau

GAMMA = 2 - math.sqrt(2)
W, D = math.sqrt(2) / 4, GAMMA / 2
# The difference to the embedded formula of order 3.
ERROR = np.array([[(4 * W - 1) / 3, -1 / 3, 2 * D / 3]])


class TRBDF2(AbstractDiagonallyImplicit):
    """TR-BDF2, as in MATLAB's ode23tb: the trapezoidal rule to t₀ + (2 − √2) h, then the BDF formula of order 2.

    Order 2, L-stable, stiffly accurate. For stiff problems at low accuracy, with f that is expensive or
    not smooth. Both stages share one matrix, and an embedded formula of order 3 estimates the error (Bank et
    al. 1985; Hosea & Shampine 1996).

    **Arguments:**

    - ``root_finder``: :class:`~jaxball.solvers.SimplifiedNewton` or :class:`~jaxball.solvers.FixedPoint`.
    """

    tableau: ClassVar[Tableau] = diagonally_implicit([GAMMA, 1.0], [[D, 0.0], [W, D]])
    first: ClassVar[np.ndarray] = np.array([[D], [W]])

    def estimated_error(self, K, h, before):
        return combine(ERROR, K)[0]
