"""The contracts of objectives and constraints."""

import abc
from collections.abc import Callable, Iterable, Mapping

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ...interface.arguments import require_callable_with
from ...interface.printing import Printed
from ...numerics.declare import number
from ...numerics.quadrature import integrate_samples
from ...physics.body import System
from .run import Run
from .space import DesignError


class Requirement(Printed):
    """A requirement on a motion: an objective or a constraint."""

    def unreachable_by_disk(self) -> str:
        """Names what a requirement asks that a disk, which rolls along e1 and turns about e2, cannot do; empty if
        nothing.
        """
        return ""

    def impossible_in(self, radius: float) -> str:
        """Says what it requires, as a clause, that no body of this radius can fulfil; empty if nothing."""
        return ""


class OfFunction(Requirement):
    """A requirement by a user's function of (run, parameters)."""

    function: Callable[[Run, PyTree], Float[Array, "..."]] = eqx.field(static=True)
    parameters: PyTree = None

    def __check_init__(self):
        require_callable_with("function", self.function, self.parameters, "run")


class AbstractObjective(Requirement):
    """A dimensionless number that a design minimises: lengths in radii r, forces in weights M g, times in √(r/g).

    ``weight`` multiplies it in the sum of objectives; it can change without compiling again.
    """

    weight: Float[Array, ""] = eqx.field(converter=number(), default=1.0, kw_only=True)

    @abc.abstractmethod
    def __call__(self, run: Run) -> Float[Array, ""]:
        """Computes the value of the objective, without the weight."""

    def in_units(self, value: float, length: float, time: float) -> str:
        """Formats a value as the length, the angle or the time that it stands for; empty if it is none of them.

        ``length`` and ``time`` are r and √(r/g) in units of the scenario.
        """
        return ""


class AbstractRunningObjective(AbstractObjective):
    """The mean over the run of a function of the time and of the state and the actuation at that time.

    Optimal control can use only such objectives. ``weight`` is the factor in the sum of objectives.
    """

    @abc.abstractmethod
    def integrand(self, run: Run) -> Float[Array, " t"]:
        """Evaluates the integrand at the times of the run."""

    def __call__(self, run: Run):
        return mean_in_time(run, self.integrand(run)[:, None])[0]


def mean_in_time(run: Run, values: Float[Array, "t k"]) -> Float[Array, " k"]:
    """Computes the means of k functions over the run by their values at its times, as ``integrate_samples`` does."""
    return integrate_samples(run.times, values, run.system.kinks()) / (run.times[-1] - run.times[0])


def evaluate_objectives(objectives: Iterable[AbstractObjective], run: Run) -> list[Float[Array, ""]]:
    """Evaluates objectives; those that are means over the run together, whose rule is the same."""
    objectives = list(objectives)
    means = [type(item).__call__ is AbstractRunningObjective.__call__ for item in objectives]
    values = [
        item.integrand(run)
        for item, is_mean in zip(objectives, means, strict=True)
        if is_mean and isinstance(item, AbstractRunningObjective)
    ]
    of_means = iter(mean_in_time(run, jnp.stack(values, axis=1)) if values else ())
    return [next(of_means) if is_mean else item(run) for item, is_mean in zip(objectives, means, strict=True)]


class AbstractConstraint(Requirement):
    """Signed violations, dimensionless: positive where violated, and at most 0 in a design that fulfils it.

    Lengths are in radii r, forces in weights M g, times in √(r/g).
    """

    @abc.abstractmethod
    def __call__(self, run: Run) -> Float[Array, "..."]:
        """Computes the violation at each point or time at which it is evaluated."""


class AbstractRunningConstraint(AbstractConstraint):
    """A constraint on the state and the actuation at each time, the only kind that optimal control can use."""

    def margins(self, run: Run) -> Float[Array, "t ..."]:
        """Evaluates a function that is nonnegative where the constraint holds, with second derivatives everywhere.

        Near the boundary it is minus the violation, to first order; by default, everywhere.
        """
        return -self(run)


def require_possible(radius: float, requirements: Mapping[str, Requirement]) -> None:
    """Refuses objectives and constraints that no body of a radius can meet, whatever the search finds.

    **Raises:** :class:`DesignError`, with the name of the first one.
    """
    for name, requirement in requirements.items():
        beyond = requirement.impossible_in(radius)
        if beyond:
            raise DesignError(
                f"`{name}` must be possible in a body of radius {radius:g}, but {beyond}; give a smaller one."
            )


def require_reachable(system: System, requirements: Mapping[str, Requirement]) -> None:
    """Refuses objectives and constraints that no disk can meet.

    **Raises:** :class:`DesignError`, with the name of the first one, where the system is a disk.
    """
    for name, requirement in requirements.items() if system.planar else ():
        beyond = requirement.unreachable_by_disk()
        if beyond:
            raise DesignError(
                f"`{name}` must be within reach of a disk, which rolls along e1 and turns about e2, but it requires "
                f"{beyond}; give positions as single numbers, or use a ball."
            )
