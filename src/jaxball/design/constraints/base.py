"""What a constraint is."""

import abc

from jaxtyping import Array, Float

from ..plane import Requirement
from ..run import Run


class AbstractConstraint(Requirement):
    """Signed violations, dimensionless: positive where violated, and at most 0 in a design that fulfils it.

    Lengths are in radii r, forces in weights M g, times in √(r/g).
    """

    @abc.abstractmethod
    def __call__(self, run: Run) -> Float[Array, "..."]:
        """The violation at each place or time at which it is evaluated."""


class AbstractRunningConstraint(AbstractConstraint):
    """What a motion fulfils at each time by the state and the actuation at that time."""

    def margins(self, run: Run) -> Float[Array, "t ..."]:
        """What is not negative where the constraint holds, with second derivatives everywhere.

        Near the boundary it is minus the violation, to first order; if not overridden, everywhere.
        """
        return -self(run)
