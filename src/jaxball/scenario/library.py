"""The scenarios that come with the package, one file each."""

import difflib
import importlib.resources
import tomllib

from .values import ScenarioError


def _folder():
    return importlib.resources.files("jaxball") / "scenarios"


def builtin_scenarios() -> tuple[str, ...]:
    """The names of the built-in scenarios, in alphabetical order."""
    names = (item.name for item in _folder().iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml")))


def builtin_text(name: str) -> str:
    """The text of a built-in scenario's file, comments included.

    **Arguments:**

    - ``name``: of a built-in scenario.

    **Raises:** :class:`ScenarioError` when there is none of that name.
    """
    if name not in builtin_scenarios():
        raise ScenarioError(
            f'Argument `name` must be one of {", ".join(builtin_scenarios())}, but it is "{name}"{nearest(name)}.'
        )
    return (_folder() / f"{name}.toml").read_text(encoding="utf-8")


def builtin_title(name: str) -> str:
    """The title of a built-in scenario.

    **Arguments:**

    - ``name``: of a built-in scenario.
    """
    return tomllib.loads(builtin_text(name))["title"]


def nearest(name: str) -> str:
    """A hint for a name that is nearly that of a built-in scenario; empty where there is none."""
    near = difflib.get_close_matches(name, builtin_scenarios(), n=1)
    return f"; did you mean {near[0]}" if near else ""
