"""The space of designs: a scenario as a function of a vector z of unbounded variables of order one."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...numerics.arrays import to_array
from ...physics.body import Ball, Disk, System
from ...physics.frames import principal_angles
from ...physics.state import BallState, DiskState
from ...scenario import Scenario, read_document
from ...scenario.body import rolling_state
from ...scenario.errors import UntraceableError
from ...scenario.files import Structure
from ...scenario.paths import key_of, value_at, with_numbers
from ...scenario.values import Numbers, kinds_of_numbers
from .variables import Bounds, DesignError, Variable, default_scale, expanded


class Candidate(NamedTuple):
    """The simulation inputs for one z.

    **Arguments:**

    - ``system``: the body.
    - ``state``: at the first of the times.
    - ``times``: the save times, shape (T,).
    """

    system: System
    state: BallState | DiskState
    times: Float[Array, " T"]


class DesignSpace:
    """The scenarios that a design may choose from: a document with ``variables`` in place of some of its numbers.

    - ``document``: a scenario, as the TOML document of its file.
    - ``scenario``: what it describes.
    - ``variables``: the design variables, one for each entry of z; paths with ``[*]`` expanded.

    **Raises:** :class:`DesignError` where a number cannot be a variable, because it is in two variables, has no
    derivative, or determines the angles of ``initial.balance``; and where a start is outside its bounds.
    """

    def __init__(self, document: Mapping[str, Any], variables: Sequence[Variable]):
        self.document = dict(document)
        self.scenario = read_document(self.document)
        if not isinstance(self.scenario.system, Ball | Disk):
            raise DesignError(
                f"Key `kind` must be ball or disk to be designed, but it is {self.scenario.system.title.lower()}."
            )
        rolling_state(self.scenario.state, self.scenario.contact, "a design is", DesignError)
        self.variables = tuple(one for variable in variables for one in expanded(variable, self.document))
        self._paths = tuple(path for variable in self.variables for path in variable.paths)
        _check_paths(self._paths, self.document)
        with kinds_of_numbers() as kinds:
            self._structure = Structure(self.document, self._paths)
        try:
            jax.eval_shape(self._structure.build, jnp.zeros(len(self._paths)))
        except UntraceableError:
            raise DesignError(
                f"Variables {', '.join(self._paths)} must not change a body in balance, but one does; give the angles "
                "of the masses instead of `initial.balance`."
            ) from None
        x = [self._start_of(variable) for variable in self.variables]
        self.bounds = self._bounds(x, kinds)
        self.start = self.bounds.variables(np.asarray(x))

    @property
    def size(self) -> int:
        """How many variables there are."""
        return len(self.variables)

    @property
    def names(self) -> tuple[str, ...]:
        """The first path of each variable."""
        return tuple(variable.name for variable in self.variables)

    def numbers(self, z: Float[Array, " n"]) -> Float[Array, " n"]:
        """The values of the variables, within their bounds."""
        return self.bounds.numbers(z)

    def candidate(self, z: Float[Array, " n"]) -> Candidate:
        """The system, the state and the times of z; traceable."""
        return self.candidate_of(self.numbers(z))

    def candidate_of(self, x: Float[Array, " n"]) -> Candidate:
        """The system, the state and the times for values ``x`` of the variables."""
        parts = self._structure.build(self._at_paths(x))
        times = self.scenario.times
        moved = parts.times.array(times.size) if self._moves("time") else to_array(times)
        return Candidate(parts.system, parts.state, moved)  # pyright: ignore[reportArgumentType]

    def document_of(self, x: Float[np.ndarray, " n"]) -> dict[str, Any]:
        """The scenario's document with values ``x`` of the variables."""
        values = np.concatenate([value * np.asarray(v.factors) for value, v in zip(x, self.variables, strict=True)])
        document = with_numbers(self.document, dict(zip(self._paths, values.tolist(), strict=True)))
        if self._moves("initial.versor"):
            q = np.asarray(document["initial"]["versor"])
            document["initial"] = {**document["initial"], "versor": (q / np.linalg.norm(q)).tolist()}
        for frame in _frames_by_angles(document):
            frame["azimuth"], frame["elevation"] = principal_angles(frame["azimuth"], frame["elevation"])
        if self._moves("time") and "step" in document["time"]:
            document["time"] = {**document["time"], "saves": self.scenario.times.size}
            del document["time"]["step"]
        return document

    def scenario_of(self, x: Float[np.ndarray, " n"]) -> Scenario:
        """The scenario with values ``x`` of the variables.

        **Raises:** :class:`~jaxball.ScenarioError` where they are impossible.
        """
        return read_document(self.document_of(x))

    def _moves(self, table: str) -> bool:
        return any(path.startswith(table) for path in self._paths)

    def _start_of(self, variable: Variable) -> float:
        x = variable.start
        x = float(value_at(self.document, variable.name)) / variable.factors[0] if x is None else x
        if not variable.lower <= x <= variable.upper:
            raise DesignError(
                f"Variable `{variable.name}` must start between its bounds {variable.lower:g} and {variable.upper:g}, "
                f"but it starts at {x:g}."
            )
        return x

    def _bounds(self, x: list[float], kinds: Mapping[str, Numbers]) -> Bounds:
        system = self.scenario.system
        assert isinstance(system, Ball | Disk)
        dimensions = [kinds[key_of(variable.name)].dimension for variable in self.variables]
        scale = [
            default_scale(dimension, value, system) if variable.scale is None else variable.scale
            for variable, value, dimension in zip(self.variables, x, dimensions, strict=True)
        ]
        lower, upper = ([getattr(v, side) for v in self.variables] for side in ("lower", "upper"))
        return Bounds(np.asarray(lower, dtype=float), np.asarray(upper, dtype=float), np.asarray(scale, dtype=float))

    def _at_paths(self, x: Float[Array, " n"]) -> Float[Array, " paths"]:
        column = np.repeat(np.arange(self.size), [len(variable.paths) for variable in self.variables])
        factors = np.concatenate([np.asarray(variable.factors, dtype=float) for variable in self.variables])
        return x[column] * jnp.asarray(factors, dtype=x.dtype)


def _frames_by_angles(value: Any) -> Iterator[dict[str, Any]]:
    """The frames of rails anywhere in a document that are given by spherical angles."""
    if isinstance(value, dict) and "elevation" in value:
        yield value
    elif isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from _frames_by_angles(item)


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
