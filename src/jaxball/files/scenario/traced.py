"""Scenarios as traceable functions of some of their numbers, which studies and problems of design vary.

Reading a file takes as long as many runs: a document is read once, while it is traced, and then its numbers change in a
compiled program.
"""

import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
from jaxtyping import Array, Float

from ...physics.contact.law import Contact
from ...physics.contact.released import ReleasedState
from ...physics.sensors import AbstractSensor
from ...physics.system import AbstractState, AbstractSystem
from ...simulation.events import AbstractEvent
from .closed_loop import LoopNumbers, loop_numbers
from .files import Contents, read_contents
from .paths import with_numbers
from .solve import SaveTimes
from .values import Conditions, collect_conditions


class Parts(NamedTuple):
    """The parts of a scenario that depend on the numbers of its document.

    ``sensors`` and ``events`` are all that there are, ``loop`` is what determines its closed loop, or None without
    feedback.
    """

    system: AbstractSystem
    state: AbstractState | ReleasedState
    contact: Contact | None
    times: SaveTimes
    rtol: Any
    atol: Any
    sensors: dict[str, AbstractSensor]
    events: dict[str, AbstractEvent]
    loop: LoopNumbers | None

    @classmethod
    def of(cls, contents: Contents, document: Mapping[str, Any]) -> "Parts":
        """Returns the parts of a file with these ``contents``, whose whole is ``document``."""
        solve, loop = contents.solve, None
        if contents.feedback is not None:
            times = contents.times
            loop = loop_numbers(contents, document, (times.end - times.start) / (times.count - 1))
        main = contents.system, contents.state, contents.contact, contents.times, solve["rtol"], solve["atol"]
        return cls(*main, contents.sensors, contents.events, loop)


def trace(
    document: Mapping[str, Any], paths: tuple[str, ...], values: Float[Array, " paths"]
) -> tuple[Parts, Conditions]:
    """Builds the parts of a document from ``values`` at ``paths``, which must be traced, and the conditions on them.

    - ``paths``: of numbers that do not determine how much is computed: see :func:`~.paths.check_number`. Parts that do
      not depend on them are known.

    **Raises:** :class:`~.errors.UntraceableError` where something depends on them that cannot be traced.
    """
    with collect_conditions() as conditions:
        traced = with_numbers(document, dict(zip(paths, values, strict=True)))
        return Parts.of(read_contents(traced), traced), conditions


@dataclass(frozen=True)
class Outline:
    """A document without the numbers at some paths, as a traceable function of these.

    Equal ones, of any documents, are the same function.

    - ``text``: the document without its title and with 0 at the paths, as JSON.
    - ``paths``: of numbers that do not determine how much is computed: see :func:`~.paths.check_number`.
    """

    text: str
    paths: tuple[str, ...]

    @classmethod
    def of(cls, document: Mapping[str, Any], paths: tuple[str, ...]) -> "Outline":
        """Returns the outline of a document with numbers at these paths."""
        # The numbers are arguments, and a title changes nothing: documents that differ in these are one program.
        rest = with_numbers(document, dict.fromkeys(paths, 0.0))
        rest.pop("title", None)
        return cls(json.dumps(rest, default=lambda array: array.tolist()), paths)

    @functools.partial(jax.jit, static_argnums=0)
    def build(self, values: Float[Array, " paths"]) -> Parts:
        """Builds the contents of the document with ``values`` at the paths, possible or not.

        **Raises:** :class:`~.errors.UntraceableError` where something depends on them that cannot be traced.
        """
        return trace(json.loads(self.text), self.paths, values)[0]
