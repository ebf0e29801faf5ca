"""Whose a store is: what its attributes say of the study and of the versions that computed it."""

import json
import os
from pathlib import Path
from typing import Any

from .errors import StoreError
from .study import Study
from .versions import versions

LAYOUT = "2"  # counted up when stores are written otherwise


def identity_of(study: Study) -> dict[str, str]:
    """All that the numbers in a store depend on, as attributes."""
    return {**study.identity(), **versions(), "layout": LAYOUT}


def differences(attributes: dict[str, Any], wanted: dict[str, str]) -> list[str]:
    """The names of the attributes that are not as ``wanted``."""
    return [name for name, value in wanted.items() if attributes.get(name) != value]


def read_attributes(folder: Path) -> dict[str, Any]:
    """The attributes of a store.

    **Raises:** :class:`StoreError` when there is nothing at ``folder``, or something other than the store of a study.
    """
    if not os.path.lexists(folder):
        raise StoreError(f'There must be the store of a study at "{folder}", but there is nothing.')
    try:
        attributes = json.loads((folder / "zarr.json").read_text(encoding="utf-8"))["attributes"]
    except (OSError, ValueError, KeyError, TypeError):
        attributes = None
    if not isinstance(attributes, dict) or not {"scenario", "axes", "settings"} <= attributes.keys():
        raise StoreError(f'"{folder}" must be the store of a study, but it is something else; it is left as it is.')
    return attributes
