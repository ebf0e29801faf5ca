"""What a package offers: the names that ``dir`` shows and that ``from ... import *`` takes."""

from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any


def interface(names: Mapping[str, Any], *packages: str) -> tuple[list[str], Callable[[], list[str]]]:
    """``__all__`` and ``__dir__`` of a package, from its ``globals()`` at its end: what it has but modules.

    ``dir`` shows ``packages`` too, which are those within it that belong to the interface.
    """
    offered = sorted(
        name for name, value in names.items() if not (name.startswith("_") or isinstance(value, ModuleType))
    )
    return offered, lambda: sorted([*offered, *packages])
