"""Gauss collocation."""

import equinox as eqx

from .collocation import AbstractCollocation
from .errors import AbstractErrorEstimate, EmbeddedError, TailError
from .fixed_point import FixedPoint
from .newton import SimplifiedNewton
from .stages import AbstractStageIteration
from .tableau import Tableau, gauss

MOST_STAGES = 20
# With more, the modes of A⁻¹ are too nearly parallel for float64.
MOST_STAGES_NEWTON = 12


class Gauss(AbstractCollocation):
    """Gauss collocation with s stages: order 2s, the highest that s stages can have.

    A-stable and symmetric. It preserves every quadratic invariant, including the norm |q| of a versor, as accurately as
    the iteration is solved, and nearly preserves energy; it does not damp stiff components (R(∞) = ±1). With
    fixed-point iteration and 6 to 12 stages, it is the method of choice for smooth, non-stiff problems at tight
    tolerances, down to rounding.

    The vector field must be smooth within each step: give its kinks to :class:`StepToKinks`. A jump after the last node
    of a step is seen by no stage and no estimate, and the result is silently wrong.

    **Arguments:**

    - ``stages``: from 2 to 20; 8 suits tolerances from 1e-6 to 1e-13.
    - ``root_finder``: :class:`FixedPoint`, or :class:`SimplifiedNewton` (up to 12 stages) if the problem is stiff.
    - ``error``: :class:`TailError`, :class:`StepError` if the solution is needed only at the ends of steps, or
      :class:`EmbeddedError` (odd numbers of stages).

    Source: Hairer, Lubich & Wanner, *Geometric Numerical Integration* (2006), sections II.1.3, IV.2.1 and
    VIII.6; Antoñana, Makazaga & Murua, *Numer. Algorithms* 76 (2017) 861–880, on its fixed-point iteration.

    **Raises:** ``ValueError`` for a number of stages that does not fit the other arguments.

    **Example:**

    >>> import diffrax
    >>> from jaxball.solvers import Gauss
    >>> Gauss(stages=4).order(diffrax.ODETerm(lambda t, y, args: -y))
    8
    """

    stages: int = eqx.field(static=True, default=8)
    root_finder: AbstractStageIteration = FixedPoint()
    error: AbstractErrorEstimate = TailError()

    def __check_init__(self):
        newton = isinstance(self.root_finder, SimplifiedNewton)
        most = MOST_STAGES_NEWTON if newton else MOST_STAGES
        if not 2 <= self.stages <= most:
            with_newton = " with SimplifiedNewton" if newton else ""
            raise ValueError(f"Argument `stages` must be from 2 to {most}{with_newton}, but it is {self.stages}.")
        if isinstance(self.error, EmbeddedError) and self.stages % 2 == 0:
            raise ValueError(
                "Argument `stages` must be odd with EmbeddedError, which needs a real eigenvalue of A⁻¹, "
                f"but it is {self.stages}; use TailError."
            )

    @property
    def tableau(self) -> Tableau:
        """The coefficients."""
        return gauss(self.stages)

    def order(self, terms) -> int:
        return 2 * self.stages
