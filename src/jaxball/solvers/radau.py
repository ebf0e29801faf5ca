"""Radau IIA collocation."""

import equinox as eqx

from .collocation import AbstractCollocation
from .errors import AbstractErrorEstimate, EmbeddedError
from .newton import SimplifiedNewton
from .stages import AbstractStageIteration
from .tableau import Tableau, radau_right

STAGES = (3, 5, 7)


class RadauIIA(AbstractCollocation):
    """Radau IIA with 3, 5 or 7 stages: orders 5, 9 and 13.

    Collocation at the Radau points, the last of which is the end of the step. A- and L-stable, stiffly accurate, and of
    full order in the algebraic variables of M ẋ = g(t, x) with index 1. The method of the codes radau5 and radau; the
    paper uses the former.

    **Arguments:**

    - ``stages``: 3 for accuracies to about 1e-6, 5 to about 1e-9, 7 beyond; at loose tolerances on rough
      solutions, fewer stages.
    - ``root_finder``: :class:`SimplifiedNewton`, or :class:`FixedPoint` if the problem is not stiff.
    - ``error``: :class:`EmbeddedError`, or :class:`TailError` and :class:`StepError` for smooth problems.

    Source: Hairer & Wanner, *Solving Ordinary Differential Equations II* (1996), sections IV.5 and IV.8;
    Hairer & Wanner, *Stiff differential equations solved by Radau methods*, J. Comput. Appl. Math. 111
    (1999) 93–111, for 5 and 7 stages.

    **Raises:** ``ValueError`` for another number of stages.

    **Example:**

    >>> import diffrax
    >>> from jaxball.solvers import RadauIIA
    >>> RadauIIA(stages=5).order(diffrax.ODETerm(lambda t, y, args: -y))
    9
    """

    stages: int = eqx.field(static=True, default=3)
    root_finder: AbstractStageIteration = SimplifiedNewton()
    error: AbstractErrorEstimate = EmbeddedError()

    def __check_init__(self):
        if self.stages not in STAGES:
            raise ValueError(f"Argument `stages` must be 3, 5 or 7, but it is {self.stages}.")

    @property
    def tableau(self) -> Tableau:
        """The coefficients."""
        return radau_right(self.stages)

    def order(self, terms) -> int:
        return 2 * self.stages - 1
