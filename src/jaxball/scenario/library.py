"""The scenarios that come with the package, one file each."""

import importlib.resources
import tomllib

from ..interface.wording import did_you_mean
from .values import ScenarioError


def _folder():
    return importlib.resources.files("jaxball.scenario") / "builtin"


def builtin_scenarios() -> tuple[str, ...]:
    """The names of the built-in scenarios, in alphabetical order.

    **Example:**

    >>> from jaxball.scenario import builtin_scenarios
    >>> builtin_scenarios()[:3]
    ('ball', 'chaplygin-sphere', 'chaplygin-top')
    """
    names = (item.name for item in _folder().iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml")))


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
            f'Argument `name` must be that of a built-in scenario, but it is "{name}"{nearest_builtin(name)}'
        )
    return (_folder() / f"{name}.toml").read_text(encoding="utf-8")


def builtin_title(name: str) -> str:
    """The title of a built-in scenario.

    **Arguments:**

    - ``name``: of a built-in scenario.

    **Example:**

    >>> from jaxball.scenario import builtin_title
    >>> builtin_title("disk")
    "The paper's disk: four masses on concentric circles"
    """
    return tomllib.loads(builtin_text(name))["title"]


def nearest_builtin(name: str) -> str:
    """The end of a sentence about a name that is not that of a built-in scenario."""
    return did_you_mean(name, builtin_scenarios(), "`jaxball scenarios` lists them")
