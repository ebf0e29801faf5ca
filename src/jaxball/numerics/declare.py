"""What a class says of a number, once, in its field: its dimension and the rule that it must obey.

From ``radius: Float[Array, "*group"] = eqx.field(converter=number(LENGTH, POSITIVE))`` follow the conversion of the
argument, the condition on it (:func:`jaxball.physics.conditions.on_numbers`), and its key in files with its unit
(``jaxball.files.scenario.own``). The name is that of the field, and the shape that of its annotation.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, NamedTuple, get_args

import numpy as np
from jaxtyping import Array, Float

from .arrays import AnyArray, Numbers, namespace_of, require_shape, to_array

ROUNDED = 1e-3  # 1.5708 is a right angle


class Rule(NamedTuple):
    """A condition on finite numbers, with the words before and after "numbers" that describe it.

    - ``allows``: whether they meet it, as a function of a flat NumPy array, or of a traced one.
    - ``phrase``: what they must be, if not "a … number …" or a list of such.
    - ``is_angle``: whether they are radians, for which degrees are often taken.
    """

    before: str
    allows: Callable[[Float[AnyArray, " numbers"]], Any]
    after: str = ""
    phrase: str = ""
    is_angle: bool = False

    def holds(self, x: Float[AnyArray, "..."]) -> Any:
        """Returns whether numbers are finite, and the rule allows them; an infinite one might fulfil it otherwise."""
        return namespace_of(x).isfinite(x).all() & self.allows(x.reshape(-1))

    def words(self, shape: tuple[int | str | None, ...]) -> str:
        """Describes numbers of this shape, in which None or a letter stands for one or more."""
        before, after = self.before, self.after
        if self.phrase or not shape:
            return self.phrase or f"a {before} number{after}"
        counts = [f"{n} " if isinstance(n, int) else "" for n in shape]
        inner = f"{counts[-1]}{before} {'number' if shape[-1] == 1 else 'numbers'}{after}"
        return f"a list of {inner}" if len(shape) == 1 else f"a list of {counts[0]}rows of {inner}"


FINITE = Rule("finite", lambda x: np.True_)
POSITIVE = Rule("positive", lambda x: (x > 0).all())
NOT_NEGATIVE = Rule("non-negative", lambda x: (x >= 0).all())
FROM_0 = NOT_NEGATIVE._replace(phrase="0 or positive")
NOT_ALL_ZERO = Rule("finite", lambda x: (x != 0).any(), ", not all zero")
BETWEEN_0_AND_1 = Rule("finite", lambda x: ((x >= 0) & (x <= 1)).all(), " from 0 to 1", "between 0 and 1")
FROM_1 = Rule("finite", lambda x: (x >= 1).all(), " from 1 on", "1 or more")
DIRECTION = NOT_ALL_ZERO._replace(phrase="a direction, three finite numbers that are not all 0")
INCREASING = Rule("increasing", lambda x: (x[1:] > x[:-1]).all())


def within(limit: float, words: str) -> Rule:
    """Returns the rule that an angle in radians is no further than ``limit``, in ``words``, from 0."""
    return Rule(
        "finite", lambda x: (abs(x) <= limit + ROUNDED).all(), f" of radians from -{words} to {words}", is_angle=True
    )


QUARTER_TURN, FULL_TURN = within(math.pi / 2, "π/2"), within(2 * math.pi, "2π")


class Dimension(NamedTuple):
    """The dimension of a number by the exponents of length, time and mass.

    - ``coordinate``: the exponent of a coordinate, which is an angle, or a length along a slider or in a tube. That of
      a torque about a hinge is -1, because it is an energy over an angle; along a slider it is a force.
    """

    length: int
    time: int
    mass: int = 0
    coordinate: int = 0


LENGTH, TIME, ANGLE = Dimension(1, 0), Dimension(0, 1), Dimension(0, 0, 0, 1)
RATE, ACCELERATION = Dimension(0, -1, 0, 1), Dimension(0, -2, 0, 1)  # of angles
VELOCITY, PER_LENGTH = Dimension(1, -1), Dimension(-1, 0)
PER_TIME, PER_TIME_SQUARED = Dimension(0, -1), Dimension(0, -2)
OF_MOMENTUM, OF_FORCE, OF_TORQUE = Dimension(1, -1, 1), Dimension(1, -2, 1), Dimension(2, -2, 1)
OF_DRAG, OF_ROTATIONAL_DRAG = Dimension(0, -1, 1), Dimension(2, -1, 1)
# What drives a coordinate, and the coefficients of forces that are linear in it or in its rate.
EFFORT, STIFFNESS, DAMPING = Dimension(2, -2, 1, -1), Dimension(2, -2, 1, -2), Dimension(2, -1, 1, -2)
PER_RATE = Dimension(0, 1, 0, -1)
OF_MASS, OF_INERTIA, OF_GRAVITY = Dimension(0, 0, 1), Dimension(2, 0, 1), Dimension(1, -2)


@dataclasses.dataclass
class Declared:
    """What is said of a field of numbers, by its name and the shape of its annotation, where a letter is any length.

    - ``dimension``: None if it is not stated, such as that of a direction.
    - ``rule``: what files ask of the numbers, and conditions of physics where there are some; None for that they are
      finite, for which there is no condition.
    - ``by_size``: whether a design scales them by their size, where it would otherwise by their dimension.
    """

    dimension: Dimension | None = None
    rule: Rule | None = None
    by_size: bool = False
    name: str = dataclasses.field(default="x", init=False)
    shape: tuple[int | str, ...] = dataclasses.field(default=(), init=False)
    batch: bool = dataclasses.field(default=False, init=False)

    def belong_to(self, name: str, annotation: Any) -> None:
        """Takes the name of a field, and from its annotation the shape; before that a ``*batch`` may have more axes.

        It applies to the arguments of a constructor: transformations of JAX, which add axes, do not call it.
        """
        array = next(kind for kind in (annotation, *get_args(annotation)) if hasattr(kind, "dim_str"))
        axes = array.dim_str.split()
        self.name, self.batch = name, "*batch" in axes
        self.shape = tuple(int(axis) if axis.isdecimal() else axis for axis in axes if not axis.startswith("*"))

    def convert(self, x: Numbers) -> Float[Array, "..."]:
        """Converts an argument to an array of the shape; an error names it."""
        array = to_array(x, self.name)
        require_shape(self.name, array, self.shape, batch=self.batch)
        return array


class Given(Declared):
    """The declaration, and converter, of numbers that an object always has."""

    def __call__(self, x: Numbers) -> Float[Array, "..."]:
        return self.convert(x)


class GivenOrNone(Declared):
    """The declaration, and converter, of numbers that may be left out."""

    def __call__(self, x: Numbers | None) -> Float[Array, "..."] | None:
        return None if x is None else self.convert(x)


def number(dimension: Dimension | None = None, rule: Rule | None = None, *, by_size: bool = False) -> Given:
    """Declares a field that is a number, or an array of numbers if its annotation is; see :class:`Declared`."""
    return Given(dimension, rule, by_size)


def number_or_none(
    dimension: Dimension | None = None, rule: Rule | None = None, *, by_size: bool = False
) -> GivenOrNone:
    """Declares a field like that of :func:`number`, which may be None."""
    return GivenOrNone(dimension, rule, by_size)


def declarations(kind: type) -> dict[str, Declared]:
    """Returns what is declared of the fields of a class, by their names."""
    fields: dict[str, Any] = getattr(kind, "__dataclass_fields__", {})
    converters = {name: field.metadata.get("converter") for name, field in fields.items()}
    return {name: converter for name, converter in converters.items() if isinstance(converter, Declared)}


def shapes_of_fields(kind: type) -> dict[str, tuple[int | str, ...]]:
    """Returns the shapes that declarations require of the fields of a class, by name."""
    return {name: declared.shape for name, declared in declarations(kind).items() if not declared.batch}
