"""The public names of a package: what ``dir`` shows and ``from ... import *`` imports."""

from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any


def interface(names: Mapping[str, Any], *packages: str) -> tuple[list[str], Callable[[], list[str]]]:
    """``__all__`` and ``__dir__`` of a package, from its ``globals()`` at the end of its ``__init__``.

    Modules are left out, but for ``packages``, the public ones within it, which ``dir`` shows too.
    """
    public = sorted(
        name for name, value in names.items() if not (name.startswith("_") or isinstance(value, ModuleType))
    )
    return public, lambda: sorted([*public, *packages])
