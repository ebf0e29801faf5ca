"""The scenarios that come with the package, one file each."""

import os
import re

from ..interface.wording import did_you_mean
from .errors import ScenarioError

_FOLDER = os.path.join(os.path.dirname(__file__), "builtin")
_TITLE = re.compile(r'^title = "(.*)"$', re.MULTILINE)  # every title is such a line, and TOML takes long to parse


def builtin_scenarios() -> tuple[str, ...]:
    """The names of the built-in scenarios, in alphabetical order.

    **Example:**

    >>> from jaxball.scenario import builtin_scenarios
    >>> builtin_scenarios()[:3]
    ('axisymmetric-pendulum', 'axisymmetric-pendulum-on-a-slope', 'ball')
    """
    return tuple(sorted(name.removesuffix(".toml") for name in os.listdir(_FOLDER) if name.endswith(".toml")))


def builtin_text(name: str) -> str:
    """The text of a built-in scenario's file, comments included.

    **Arguments:**

    - ``name``: of a built-in scenario.

    **Raises:** :class:`ScenarioError` when there is none of that name.

    **Example:**

    >>> from jaxball.scenario import builtin_text
    >>> print(builtin_text("disk").splitlines()[2])
    title = "The paper's disk: four masses on concentric circles"
    """
    if name not in builtin_scenarios():
        raise ScenarioError(
            f'Argument `name` must be the name of a built-in scenario, but it is "{name}"{nearest_builtin(name)}'
        )
    with open(os.path.join(_FOLDER, f"{name}.toml"), encoding="utf-8") as file:
        return file.read()


def builtin_title(name: str) -> str:
    """The title of a built-in scenario.

    **Arguments:**

    - ``name``: of a built-in scenario.

    **Example:**

    >>> from jaxball.scenario import builtin_title
    >>> builtin_title("disk")
    "The paper's disk: four masses on concentric circles"
    """
    title = _TITLE.search(builtin_text(name))
    assert title is not None
    return title[1]


def nearest_builtin(name: str) -> str:
    """The end of a sentence about a name that is not that of a built-in scenario."""
    return did_you_mean(name, builtin_scenarios(), "`jaxball scenarios` lists them")
