"""The attributes of a store: its study, and the versions that computed it."""

import importlib.metadata
import json
import os
import subprocess
from pathlib import Path
from typing import Any

from .errors import StoreError
from .study import Study

PACKAGES = ("jaxball", "jax", "jaxlib", "diffrax", "numpy", "scipy")
LAYOUT = "3"  # increased when the layout of stores changes


def identity_of(study: Study) -> dict[str, str]:
    """Everything that the numbers in a store depend on, as attributes."""
    return {**study.identity(), **versions(), "layout": LAYOUT}


def differences(attributes: dict[str, Any], wanted: dict[str, str]) -> list[str]:
    """The names of the attributes that differ from ``wanted``."""
    return [name for name, value in wanted.items() if attributes.get(name) != value]


def read_attributes(folder: Path) -> dict[str, Any]:
    """The attributes of a store.

    **Raises:** :class:`StoreError` when there is nothing at ``folder``, or something other than the store of a study.
    """
    if not os.path.lexists(folder):
        raise StoreError(f'There must be the store of a study at "{folder}", but nothing is there.')
    try:
        attributes = json.loads((folder / "zarr.json").read_text(encoding="utf-8"))["attributes"]
    except (OSError, ValueError, KeyError, TypeError):
        attributes = None
    if not isinstance(attributes, dict) or not {"scenario", "axes", "settings"} <= attributes.keys():
        raise StoreError(f'"{folder}" must be the store of a study, but it is something else; it is left as it is.')
    return attributes


def versions() -> dict[str, str]:
    """The version of each package, and the git commit of a working copy of jaxball, empty where there is none."""
    known = {f"{name}_version": importlib.metadata.version(name) for name in PACKAGES}
    return known | {"commit": _commit()}


def _commit() -> str:
    here = Path(__file__)
    try:
        # An installed package may lie within an unrelated repository, which does not track it.
        _git("ls-files", "--error-unmatch", here.name)
        return _git("rev-parse", "HEAD")
    except (OSError, subprocess.CalledProcessError):
        return ""


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(Path(__file__).parent), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
