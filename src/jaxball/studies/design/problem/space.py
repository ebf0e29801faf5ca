"""The space of designs: a scenario as a function of its variables, numbers with scales and bounds."""

import dataclasses
import functools
import itertools
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .... import programs
from ....files.scenario import read_document
from ....files.scenario.body import require_whole_run
from ....files.scenario.errors import ScenarioError, UntraceableError, each_of
from ....files.scenario.files import with_defaults
from ....files.scenario.paths import check_number, key_of, numbers_of, value_at, walk, with_numbers
from ....files.scenario.scenario import Scenario
from ....files.scenario.traced import Outline
from ....files.scenario.units import dimension_of
from ....files.scenario.values import Numbers, kinds_of_numbers
from ....interface.arguments import require
from ....interface.names import leave_to
from ....numerics.arrays import to_array
from ....numerics.declare import OF_GRAVITY, Dimension
from ....physics.body import System
from ....physics.contact.law import Contact
from ....physics.contact.released import ReleasedState
from ....physics.prescribed.frames import principal_angles
from ....physics.state import BallState, DiskState

if TYPE_CHECKING:
    from ..identify import Identification
    from .run import Run

# A start on a bound, from which it could not move away, is moved inside by this fraction of its scale.
INSIDE = 1e-3


class DesignError(ScenarioError):
    """A design problem cannot be posed, or cannot be resumed; the message is one sentence that says which."""


@dataclasses.dataclass(frozen=True)
class Variable:
    """A number that a design may change: free, bounded, or shared by several entries of the scenario.

    - ``paths``: the path of the number that it sets, such as ``masses[0].rail.radius``, or several that share it, where
      ``[*]`` means all entries of a list. The first has the number itself.
    - ``factors``: its factor at each path, such as −1 for an opposite pulse; 1 if not given.
    - ``lower``: its lower bound; none if not given. It never passes its bounds.
    - ``upper``: its upper bound; none if not given.
    - ``scale``: the size of change to expect; derived from its dimension if not given.
    - ``start``: the value to start from; by default the number at the first path.

    **Raises:** :class:`DesignError` for a lower bound that is not below the upper one, for a scale that is not
    positive, and unless there is one factor for each path.

    **Example:**

    >>> from jaxball.studies.design import Variable
    >>> pulses = ("masses[0].schedule.height", "masses[1].schedule.height")
    >>> variable = Variable(pulses, factors=(1.0, -1.0), lower=0.1)
    >>> variable.lower, variable.upper
    (0.1, inf)
    """

    paths: tuple[str, ...] | str
    lower: float = -math.inf
    upper: float = math.inf
    scale: float | None = None
    factors: tuple[float, ...] = ()
    start: float | None = None

    def __post_init__(self):
        if isinstance(self.paths, str):  # one path; its letters are no paths
            object.__setattr__(self, "paths", (self.paths,))
        if not self.factors:
            object.__setattr__(self, "factors", (1.0,) * len(self.paths))
        if len(self.factors) != len(self.paths) or not self.paths:
            raise DesignError(
                f"Variable `{self.name}` must have one factor for each of its {len(self.paths)} paths, but it has "
                f"{len(self.factors)}."
            )
        if not self.lower < self.upper:
            raise DesignError(
                f"Variable `{self.name}` must have a lower bound below its upper one, but they are {self.lower!r} and "
                f"{self.upper!r}."
            )
        if self.scale is not None and not 0 < self.scale < math.inf:
            raise DesignError(f"Variable `{self.name}` must have a positive scale, but it is {self.scale!r}.")

    @property
    def name(self) -> str:
        """The first path."""
        return self.paths[0] if self.paths else "?"


def expand_variable(variable: Variable, document: Mapping[str, Any], key: str = "") -> list[Variable]:
    """Expands a variable with ``[*]`` in its path into one for each number whose path matches.

    ``key`` is that of its path, which sentences name.

    **Raises:** :class:`DesignError` when no number matches, when such a variable has several paths, and
    when a path names no number.
    """
    if "*" not in variable.name:
        for index, path in enumerate(variable.paths):
            try:
                path_key = f"{key}[{index}]" if variable.paths[1:] else key
                check_number(document, path, key=path_key, every=True, has_defaults=True)
            except ScenarioError as error:
                # The error is about the problem file and not about the scenario.
                raise DesignError(str(error)) from None
        return [variable]
    if len(variable.paths) > 1:
        raise DesignError(f"Variable `{variable.name}` must have no other path, because it stands for many numbers.")
    pattern = re.escape(variable.name).replace(r"\*", r"\d+")
    paths = [path for path in numbers_of(document) if re.fullmatch(pattern, path)]
    if not paths:
        raise DesignError(f"Variable `{variable.name}` must match a number of the scenario, but none has such a path.")
    return [dataclasses.replace(variable, paths=(path,)) for path in paths]


def default_scale(dimension: Dimension | None, value: float, system: System) -> float:
    """Returns the scale of a number of this ``dimension``; its own magnitude, or 1, if its key declares none.

    Lengths are measured in radii r of the shell, times in √(r/g), and angles in radians. What has a mass in it, and
    gravity, are scaled as if they declared none.
    """
    if dimension is None or dimension.mass or dimension == OF_GRAVITY:
        # No mass can be made of r and g; the size of the number itself is the best guess.
        return abs(value) or 1.0
    r, g = float(system.radius), abs(float(system.gravity))
    # Without gravity there is no such unit of time.
    time = math.sqrt(r / g) if g > 0 else 1.0
    return r**dimension.length * time**dimension.time


class Bounds(NamedTuple):
    """The lower and upper bounds of n numbers, infinite where there are none, and their scales.

    Within them the numbers are functions of unbounded ones, after MINUIT: an optimum on a bound is an interior
    stationary point of the unbounded variable, at which the Hessian is definite, so that it is nothing special to a
    quasi-Newton method (James & Roos, Comput. Phys. Commun. 10 (1975) 343).

    **Arguments:**

    - ``lower``, ``upper``, ``scale``: one entry for each number, shape (n,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> import numpy as np
    >>> from jaxball.studies.design.problem.space import Bounds
    >>> bounds = Bounds(lower=np.array([0.0]), upper=np.array([2.0]), scale=np.array([1.0]))
    >>> print(bounds.numbers(jnp.array([-jnp.pi / 2])), bounds.numbers(jnp.array([0.0])))
    [0.] [1.]
    """

    lower: Float[Array | np.ndarray, " n"]
    upper: Float[Array | np.ndarray, " n"]
    scale: Float[Array | np.ndarray, " n"]

    def numbers(self, y: Float[Array, " n"]) -> Float[Array, " n"]:
        """Computes the numbers of unbounded variables: scale y, scale (√(1 + y²) − 1) from one bound, or a sine between
        two.
        """
        lower, upper, scale = (jnp.asarray(side, dtype=y.dtype) for side in self)
        below, above = jnp.isfinite(lower), jnp.isfinite(upper)
        # Finite numbers in the places of infinite bounds: 0 times infinity in a branch that is not chosen would make
        # the gradient NaN.
        low, high = jnp.where(below, lower, 0.0), jnp.where(above, upper, 0.0)
        away = scale * (jnp.sqrt(1 + y**2) - 1)
        middle, half = (low + high) / 2, (high - low) / 2
        # Divided by half, so that dx/dy = scale in the middle however far the bounds are. Where there are not two
        # bounds, half may be 0, and 0 / 0 would make the gradient NaN although it is not chosen.
        both = middle + half * jnp.sin(scale * y / jnp.where(half > 0, half, 1.0))
        return jnp.where(below & above, both, jnp.where(below, low + away, jnp.where(above, high - away, scale * y)))

    def variables(self, x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Computes the unbounded variables of numbers; numbers on a bound are moved slightly inside."""
        below, above = np.isfinite(self.lower), np.isfinite(self.upper)
        low, high = np.where(below, self.lower, 0.0), np.where(above, self.upper, 0.0)
        half = np.where(below & above, (high - low) / 2, 1.0)
        # Not more than half the distance of the bounds, or a point inside of one would be outside of the other.
        inside = INSIDE * np.where(below & above, np.minimum(self.scale, half), self.scale)
        x = np.where(below, np.maximum(x, low + inside), x)
        x = np.where(above, np.minimum(x, high - inside), x)
        away = np.where(below, x - low, high - x) / self.scale
        # Only of the branch that is used: the root of a negative number would warn.
        one_sided = np.sqrt((1 + np.where(below ^ above, away, 0.0)) ** 2 - 1)
        both = half / self.scale * np.arcsin(np.clip((x - (low + high) / 2) / half, -1, 1))
        return np.where(below & above, both, np.where(below ^ above, one_sided, x / self.scale))


class Candidate(NamedTuple):
    """The simulation inputs for one z.

    **Arguments:**

    - ``system``: the body.
    - ``state``: at the first of the times.
    - ``times``: the save times, shape (T,).
    - ``contact``: the law of contact, if the body may slip.
    """

    system: System
    state: BallState | DiskState | ReleasedState
    times: Float[Array, " T"]
    contact: Contact | None = None


class Parametrisation(eqx.Module):
    """The system, the state and the times of a scenario as functions of its variables: a PyTree of numbers.

    Those that differ in numbers alone share compiled programs.

    - ``bounds``: of the variables; ``factors``: of each variable at each of its paths.
    - ``values_of_others``: the numbers of the document that the variables do not set.
    - ``times``: the save times, shape (T,), where no variable moves them.
    - ``outline``: the document without these numbers; the paths of the variables come first.
    - ``counts``: how many paths each variable has.
    """

    bounds: Bounds
    factors: Float[Array, " paths"]
    values_of_others: Float[Array, " others"]
    times: Float[Array, " T"]
    outline: Outline = eqx.field(static=True)
    counts: tuple[int, ...] = eqx.field(static=True)

    @property
    def size(self) -> int:
        """How many variables there are."""
        return len(self.counts)

    @property
    def moves_times(self) -> bool:
        """Whether a variable is a time."""
        return any(path.startswith("time") for path in self.outline.paths[: sum(self.counts)])

    def numbers(self, z: Float[Array, " n"]) -> Float[Array, " n"]:
        """Computes the values of the variables, within their bounds."""
        return self.bounds.numbers(z)

    def candidate(self, z: Float[Array, " n"]) -> Candidate:
        """Builds the system, the state and the times of z."""
        return self.candidate_of(self.numbers(z))

    def candidate_of(self, x: Float[Array, " n"]) -> Candidate:
        """Builds the system, the state and the times for values ``x`` of the variables."""
        # One entry for each path, since a variable may set several.
        column = np.repeat(np.arange(self.size), self.counts)
        parts = self.outline.build(jnp.concatenate([x[column] * self.factors, self.values_of_others]))
        times = parts.times.array(self.times.size) if self.moves_times else self.times
        return Candidate(parts.system, parts.state, times, parts.contact)  # pyright: ignore[reportArgumentType]


class DesignSpace:
    """The scenarios that a design may choose from: a document with ``variables`` in place of some of its numbers.

    - ``document``: a scenario, as the TOML document of its file.
    - ``scenario``: what it describes, with the body ``system`` and its ``state`` at the start.
    - ``variables``: the design variables, one for each entry of z; paths with ``[*]`` expanded.
    - ``parametrisation``: what it describes as a function of z, for compiled programs.
    - ``unit_of``: the unit of each by its name, after a space; empty where that is not known or stated.

    **Raises:** :class:`DesignError` where a number cannot be a variable, because it is in two variables, has no
    derivative, or determines the angles of ``initial.balance``; and where a start is outside its bounds.
    """

    def __init__(self, document: Mapping[str, Any], variables: Sequence[Variable]):
        must_be = "the document of a scenario's file, such as tomllib.loads(write_scenario(scenario))"
        require("document", document, Mapping, must_be)
        self.document = dict(document)
        with kinds_of_numbers() as kinds:
            self.scenario = read_document(self.document)
            numbers = (path.replace("*", "0") for variable in variables for path in variable.paths)
            # Within the block: it reads the defaults that it writes, whose kinds are needed as well.
            self.document = with_defaults(self.document, self.scenario, numbers)
        system = self.scenario.system
        if not isinstance(system, System):
            raise DesignError(f"Key `kind` must be ball or disk to be designed, but it is {system.title.lower()}.")
        require_whole_run(self.scenario, "a design is", DesignError)
        state = self.scenario.state
        assert isinstance(state, BallState | DiskState | ReleasedState)
        self.system, self.state = system, state
        expand = functools.partial(expand_variable, document=self.document)
        places = enumerate(variables)
        expansions = each_of(*(functools.partial(expand, entry, key=f"variables[{k}].path") for k, entry in places))
        self.variables = tuple(itertools.chain.from_iterable(expansions))
        self._paths = tuple(path for variable in self.variables for path in variable.paths)
        _check_paths(self._paths, self.document)
        x = [self._start_of(variable) for variable in self.variables]
        self.bounds = self._bounds(x, kinds)
        outline = _outline(self.document, self._paths, kinds)
        self.parametrisation = Parametrisation(
            bounds=Bounds(*map(jnp.asarray, self.bounds)),
            factors=to_array([factor for variable in self.variables for factor in variable.factors]),
            values_of_others=to_array(
                [float(value_at(self.document, path)) for path in outline.paths[len(self._paths) :]]
            ),
            times=to_array(self.scenario.times),
            outline=outline,
            counts=tuple(len(variable.paths) for variable in self.variables),
        )
        self.unit_of = {name: self._unit_of(name, kinds) for name in self.names}
        self.start = self.bounds.variables(np.asarray(x))

    @property
    def placed(self) -> BallState | DiskState:
        """The state of the body at the start, without what a law of contact adds."""
        return self.state.body if isinstance(self.state, ReleasedState) else self.state  # pyright: ignore

    @property
    def size(self) -> int:
        """How many variables there are."""
        return len(self.variables)

    @property
    def names(self) -> tuple[str, ...]:
        """The first path of each variable."""
        return tuple(variable.name for variable in self.variables)

    def numbers(self, z: Float[Array, " n"]) -> Float[Array, " n"]:
        """Computes the values of the variables, within their bounds."""
        return self.bounds.numbers(z)

    def values(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Computes the values of the variables, within their bounds, for known z, such as ``start``."""
        return np.asarray(_numbers(self.bounds, jnp.asarray(z)))

    def units(self, x: Float[np.ndarray, " n"]) -> tuple[float, float]:
        """Returns the radius and the gravity for values ``x`` of the variables."""
        radius, gravity = _units(self.parametrisation, jnp.asarray(x))
        return float(radius), float(gravity)

    def candidate(self, z: Float[Array, " n"]) -> Candidate:
        """Builds the system, the state and the times of z; traceable."""
        return self.parametrisation.candidate(z)

    def candidate_of(self, x: Float[Array, " n"]) -> Candidate:
        """Builds the system, the state and the times for values ``x`` of the variables."""
        return self.parametrisation.candidate_of(x)

    def document_of(self, x: Float[np.ndarray, " n"]) -> dict[str, Any]:
        """Returns the scenario's document with values ``x`` of the variables."""
        values = np.concatenate([value * np.asarray(v.factors) for value, v in zip(x, self.variables, strict=True)])
        document = with_numbers(self.document, dict(zip(self._paths, values.tolist(), strict=True)))
        # The search treats four components as free numbers, whereas a file must have a versor of length 1.
        if self._moves("initial.versor"):
            q = np.asarray(document["initial"]["versor"])
            document["initial"] = {**document["initial"], "versor": (q / np.linalg.norm(q)).tolist()}
        # Angles may have grown by any number of turns; files allow the principal ones.
        for frame in [table for _, table in walk(document) if isinstance(table, dict) and "elevation" in table]:
            frame["azimuth"], frame["elevation"] = principal_angles(frame["azimuth"], frame["elevation"])
        # A step that no longer divides the duration would change the number of save times.
        if self._moves("time") and "step" in document["time"]:
            document["time"] = {**document["time"], "saves": self.scenario.times.size}
            del document["time"]["step"]
        return document

    def scenario_of(self, x: Float[np.ndarray, " n"]) -> Scenario:
        """Returns the scenario with values ``x`` of the variables.

        **Raises:** :class:`~jaxball.ScenarioError` where they are impossible.
        """
        return read_document(self.document_of(x))

    def _moves(self, table: str) -> bool:
        return any(path.startswith(table) for path in self._paths)

    def _start_of(self, variable: Variable) -> float:
        x = variable.start
        # The number at a path is the variable times its factor.
        x = float(value_at(self.document, variable.name)) / variable.factors[0] if x is None else x
        if not variable.lower <= x <= variable.upper:
            raise DesignError(
                f"Variable `{variable.name}` must start between its bounds {variable.lower:g} and {variable.upper:g}, "
                f"but it starts at {x:g}."
            )
        return x

    def _unit_of(self, name: str, kinds: Mapping[str, Numbers]) -> str:
        units = self.scenario.units
        unit = "" if units is None else units.of(dimension_of(name, kinds, self.document))
        return f" {unit}" if unit not in ("", "1") else ""

    def _bounds(self, x: list[float], kinds: Mapping[str, Numbers]) -> Bounds:
        read = [kinds[key_of(variable.name)] for variable in self.variables]
        dimensions = [None if kind.by_size else kind.dimension for kind in read]
        scale = [
            default_scale(dimension, value, self.system) if variable.scale is None else variable.scale
            for variable, value, dimension in zip(self.variables, x, dimensions, strict=True)
        ]
        lower, upper = ([getattr(v, side) for v in self.variables] for side in ("lower", "upper"))
        return Bounds(np.asarray(lower, dtype=float), np.asarray(upper, dtype=float), np.asarray(scale, dtype=float))

    @leave_to("..identify")
    def identify(
        self,
        path: Float[np.ndarray, "T *d"],
        quantity: "Callable[[Run], Float[Array, 'T *d']] | None" = None,
    ) -> "Identification":
        """Finds the parameters with which the scenario's path fits a recorded one best, in the mean square.

        ``path`` is that of the geometric centre at the scenario's save times, two numbers each, one for a disk; or,
        with ``quantity``, what this function of the run has then, such as angles of joints, one row for each of these
        times and all in the same unit. The noise is assumed to be independent, with equal variances. The search is that
        of Levenberg and Marquardt, by SciPy's ``least_squares``, which shortens a step to a scenario that cannot be
        simulated.

        **Raises:** :class:`DesignError` when the path does not have one position for each save time, or not the shape
        of the quantity, or is not finite, and when the start cannot be simulated.
        """
        raise NotImplementedError


_numbers = programs.jit(Bounds.numbers)


@programs.filter_jit
def _units(parametrisation: Parametrisation, x: Float[Array, " n"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    system = parametrisation.candidate_of(x).system
    return system.radius, system.gravity


def _outline(document: Mapping[str, Any], paths: tuple[str, ...], kinds: Mapping[str, Numbers]) -> Outline:
    """Returns the document without the numbers of the variables, and without all others that can be left out.

    **Raises:** :class:`DesignError` where those of the variables cannot.
    """
    others = tuple(
        path for path in numbers_of(document) if path not in paths and _may_be_left_out(path, kinds, document)
    )
    # All numbers as arguments if possible, so that problems that differ in numbers share programs; otherwise only
    # those of the variables.
    for left_out in dict.fromkeys(((*paths, *others), paths)):
        outline = Outline.of(document, left_out)
        try:
            jax.eval_shape(outline.build, jnp.zeros(len(left_out)))
        except UntraceableError:
            continue
        return outline
    raise DesignError(
        f"Variables {', '.join(paths)} must not change a body in balance, but one does; give the angles of the masses "
        "instead of `initial.balance`."
    )


def _may_be_left_out(path: str, kinds: Mapping[str, Numbers], document: Mapping[str, Any]) -> bool:
    """Returns whether a number is one on which the structure of a scenario does not depend."""
    if path.startswith("time."):
        # The number of save times is part of the structure; only where `saves` gives it are the ends free to change.
        return path in ("time.start", "time.end") and "saves" in document["time"]
    # Matrices must be rotations, which is checked when they are read, and tolerances are static.
    return key_of(path) in kinds and not path.startswith("solve.") and ".frame.matrix" not in path


def _check_paths(paths: tuple[str, ...], document: Mapping[str, Any]) -> None:
    if not paths:
        raise DesignError("A design must have one variable or more, but it has none.")
    for path in paths:
        if paths.count(path) > 1:
            raise DesignError(f"Path `{path}` must be in one variable, but it is in {paths.count(path)}.")
        if path.startswith(("solve.", "time.step", "time.at")) or ".frame.matrix" in path:
            raise DesignError(
                f"Path `{path}` must be a number that can change on its own and on which the motion depends smoothly, "
                "but those of the solve, single save times and entries of rotation matrices are not; of times, "
                "`time.start` and `time.end` can be varied, and of frames, their angles or versors."
            )
