"""A document as a function of some of its numbers: a structure that is read once, and the vector of the numbers."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
from jaxtyping import Array, Bool, Float

from ..physics.contact_law import Contact
from ..physics.released import ReleasedState
from ..physics.system import AbstractState, AbstractSystem
from .files import Contents, read_contents
from .paths import with_numbers
from .times import SaveTimes
from .traced import Conditions, traced_conditions


class Parts(NamedTuple):
    """The parts of a scenario that depend on the numbers of its document."""

    system: AbstractSystem
    state: AbstractState | ReleasedState
    contact: Contact | None
    times: SaveTimes
    rtol: Any
    atol: Any

    @classmethod
    def of(cls, contents: Contents) -> "Parts":
        """Those of a file."""
        solve = contents.solve
        return cls(contents.system, contents.state, contents.contact, contents.times, solve["rtol"], solve["atol"])


class Structure:
    """A document as a traceable function of the numbers at ``paths``.

    - ``document``: as in the file, including numbers at these paths.
    - ``scenario``, ``parts``: its contents as it is.
    - ``paths``: of numbers that do not determine how much is computed: see :func:`~.paths.check_number`.

    **Raises:** :class:`~jaxball.ScenarioError` as :func:`~jaxball.scenario.read_document`; where ``values`` are used,
    :class:`~.errors.UntraceableError` where something depends on them that cannot be traced.
    """

    def __init__(self, document: Mapping[str, Any], paths: tuple[str, ...]):
        self.document, self.paths = dict(document), paths
        contents = read_contents(self.document)
        self.scenario, self.parts = contents.scenario(), Parts.of(contents)
        self._build = jax.jit(lambda values: self.traced(values)[0])

    def build(self, values: Float[Array, " paths"]) -> Parts:
        """The contents of the document with ``values`` at ``paths``, possible or not."""
        return self._build(values)

    def conditions(self, values: Float[Array, " paths"]) -> dict[str, Bool[Array, ""]]:
        """Whether each rule that involves ``values`` holds, by the path of the rule's key."""
        results: dict[str, Bool[Array, ""]] = {}
        for path, holds in self.traced(values)[1].holds:
            results[path] = results[path] & holds() if path in results else holds()
        return results

    def traced(self, values: Float[Array, " paths"]) -> tuple[Parts, Conditions]:
        """What ``values``, which must be traced, make, and the conditions on them. What they do not change is known."""
        numbers = dict(zip(self.paths, values, strict=True))
        with traced_conditions() as conditions:
            contents = read_contents(with_numbers(self.document, numbers))
        return Parts.of(contents), conditions
