"""The versions of what computes a study."""

import importlib.metadata
import subprocess
from pathlib import Path

PACKAGES = ("jaxball", "jax", "jaxlib", "diffrax", "numpy", "scipy")


def versions() -> dict[str, str]:
    """The version of each package, and the git commit of a working copy of jaxball, empty where there is none."""
    found = {f"{name}_version": importlib.metadata.version(name) for name in PACKAGES}
    return found | {"commit": _commit()}


def _commit() -> str:
    here = Path(__file__)
    try:
        # An installed package may lie in a folder of somebody else's repository, which does not track it.
        _git("ls-files", "--error-unmatch", here.name)
        return _git("rev-parse", "HEAD")
    except (OSError, subprocess.CalledProcessError):
        return ""


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(Path(__file__).parent), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
