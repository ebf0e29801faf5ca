"""Python names in files, as "module:name": which of them may be imported, and what they name.

A file is data except for these names, so a module is imported only where one is written out, only from where Python
finds modules and from the current folder, and only if the variable ``JAXBALL_FILES_IMPORT`` of the environment, where
it is set, lists it.
"""

import contextlib
import importlib
import os
import sys
from collections.abc import Iterator
from typing import Any

from .errors import ScenarioError, describe

VARIABLE = "JAXBALL_FILES_IMPORT"


def is_python_name(value: Any) -> bool:
    """Returns whether a value of a file has the form "module:name"."""
    return isinstance(value, str) and ":" in value


def import_name(path: str, named: str, what: str = "function") -> Any:
    """Imports the object that the key at ``path`` names; modules are found in the current folder, too.

    ``what`` says in messages what it must be, "function" or "class".

    **Raises:** :class:`ScenarioError` where there is no such name, where its module may not be imported, and where it
    cannot be called.
    """
    module, _, name = named.partition(":")
    _require_permission(path, named, module)
    try:
        with _current_folder():
            target = getattr(importlib.import_module(module), name)
    except (Exception, SystemExit) as error:  # of any kind: the module is the user's, and may be a script that exits
        reason = f"{error}" if isinstance(error, ImportError | AttributeError) else f"{type(error).__name__}: {error}"
        reason = " ".join(reason.split())
    else:
        if callable(target):
            return target
        reason = f"it is not a {what}"
    many, form = ("functions", "module:function") if what == "function" else ("classes", "module:Class")
    raise ScenarioError(
        f'Key `{path}` must name {many} that can be imported as "{form}", but {describe(named)} cannot: '
        f"{reason.rstrip('.')}."
    )


def name_of(value: Any, path: str) -> str | None:
    """Returns the "module:name" by which a function or a class can be imported; None where there is none."""
    name = f"{getattr(value, '__module__', '')}:{getattr(value, '__qualname__', '')}"
    # What a script defines has another name where the file is read.
    if not name.startswith("__main__:"):
        with contextlib.suppress(ScenarioError):
            # The name may stand for another object by now.
            if import_name(path, name) is value:
                return name
    return None


def _require_permission(path: str, named: str, module: str) -> None:
    listed = os.environ.get(VARIABLE)
    if listed is None:
        return
    allowed = [name.strip() for name in listed.split(",") if name.strip()]
    if not any(module == name or module.startswith(f"{name}.") for name in allowed):
        raise ScenarioError(
            f"Key `{path}` must name something in a module that {VARIABLE} allows files to import, but it is "
            f"{describe(named)}; that variable of the environment lists {', '.join(allowed) or 'none'}."
        )


@contextlib.contextmanager
def _current_folder() -> Iterator[None]:
    """Searches the current folder last for modules within the block, as Python does for a script."""
    added = "" not in sys.path
    if added:
        # Last, so that no file in it hides a module of Python.
        sys.path.append("")
    try:
        yield
    finally:
        if added:
            sys.path.remove("")
