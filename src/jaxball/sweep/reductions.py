"""The results that a study finds in each run while it is computed."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from ..ensemble import REDUCTIONS, AbstractReduction, Drift, Integral, Maximum, Minimum
from ..ensemble.runge_kutta import fits
from ..interface.wording import did_you_mean
from ..physics.body import AbstractBody
from ..scenario import Scenario
from ..scenario.functions import imported
from ..scenario.own import own_class, trying_class
from ..scenario.solvers import SOLVERS
from ..scenario.table import Key, read_one_of
from ..scenario.values import Text, key_error, shown
from .errors import StudyError

KINDS: Mapping[str, type[Any]] = {"maximum": Maximum, "minimum": Minimum, "integral": Integral, "drift": Drift}
OWN = "reduction"  # of a user's class
CHOICES = {kind: {"name": Key(Text()), kind: Key(Text())} for kind in (*KINDS, OWN)}


@dataclasses.dataclass(frozen=True)
class Find:
    """A reduction by name: one of ``jaxball.ensemble.REDUCTIONS``, that of a module's function, or a module's class."""

    name: str
    kind: str = ""
    function: str = ""

    def reduction(self) -> AbstractReduction:
        """The reduction itself.

        **Raises:** :class:`~jaxball.ScenarioError` when there is no such function or class.
        """
        if not self.kind:
            return REDUCTIONS[self.name]
        if self.kind == OWN:
            kind = own_class(self.function, "find", AbstractReduction)
            with trying_class("find", self.function):
                return kind()
        return KINDS[self.kind](imported("find", self.function))


def read_finds(values: Any, template: Scenario) -> tuple[Find, ...]:
    """The reductions that the key `find` lists.

    **Raises:** :class:`~jaxball.scenario.ScenarioError`, with one sentence, for a result that cannot be found for this
    scenario.
    """
    if not isinstance(values, list):
        raise key_error("find", "a list of names and tables", shown(values))
    finds = tuple(_read(item, f"find[{k}]", template) for k, item in enumerate(values))
    names = [find.name for find in finds]
    if len(set(names)) < len(names):
        raise key_error("find", "a list of different names", shown(names))
    if finds and not solved_in_lanes(template):
        raise StudyError(
            "Key `find` must be empty for an implicit solver, `dae`, `project` or `step_to_times`, with which runs are "
            "not computed in lanes, but it is not."
        )
    for find in finds:
        find.reduction()
    return finds


def solved_in_lanes(template: Scenario) -> bool:
    """Whether the rows of a study are computed in lanes."""
    plain = template.step_to_times or template.dae or template.project
    return not plain and fits(SOLVERS[template.solver]())


def _read(value: Any, path: str, template: Scenario) -> Find:
    if isinstance(value, str):
        if value not in REDUCTIONS or not isinstance(template.system, AbstractBody):
            known = list(REDUCTIONS) if isinstance(template.system, AbstractBody) else []
            hint = f"the names are {', '.join(known)}" if known else "there are none for this system"
            raise StudyError(
                f"Key `{path}` must be a table or a name that is known, but it is {shown(value)}"
                f"{did_you_mean(value, known, hint)}"
            )
        return Find(value)
    kind, table = read_one_of(value, path, CHOICES)
    return Find(table["name"], kind, table[kind])
