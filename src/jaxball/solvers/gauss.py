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

    A-stable and symmetric. It keeps every quadratic invariant, the norm |q| of a versor among them, as
    closely as the iteration is solved, and nearly keeps energy; it does not damp stiff components (R(∞) = ±1).
    With fixed-point iteration and 6 to 12 stages, the method for smooth, non-stiff problems at tight
    tolerances, down to rounding.

    The vector field must be smooth within each step: give its kinks to :class:`StepToKinks`. A jump after the
    last node of a step is in no stage and in no estimate, and the result is wrong without a word.

    **Arguments:**

    - ``stages``: from 2 to 20; 8 suits tolerances from 1e-6 to 1e-13.
    - ``root_finder``: :class:`FixedPoint`, or :class:`SimplifiedNewton` (up to 12 stages) where the problem
      is stiff.
    - ``error``: :class:`TailError`, :class:`StepError` where the solution is wanted at the ends of steps
      alone, or :class:`EmbeddedError` (odd numbers of stages).

    Source: Hairer, Lubich & Wanner, *Geometric Numerical Integration* (2006), sections II.1.3, IV.2.1 and
    VIII.6; Antoñana, Makazaga & Murua, *Numer. Algorithms* 76 (2017) 861–880, on its fixed-point iteration.

    **Raises:** ``ValueError`` for a number of stages that does not go with the other arguments.

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
