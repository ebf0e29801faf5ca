"""The description of the machine and of the packages, which is part of every result."""

import importlib.metadata
import os
import platform
from pathlib import Path

PACKAGES = (
    "jaxball", "jax", "jaxlib", "diffrax", "equinox", "optimistix", "numpy",
    "scipy", "numba", "numbalsoda", "heyoka", "casadi",
)  # fmt: skip
VECTOR_UNITS = ("sse4_2", "avx", "avx2", "fma", "avx512f", "avx512dq", "asimd", "sve")


def description() -> dict[str, object]:
    """The machine, the settings of XLA, and the versions of Python and of the installed packages."""
    return {"machine": machine(), "XLA_FLAGS": os.environ.get("XLA_FLAGS", ""), "versions": versions(PACKAGES)}


def machine() -> dict[str, object]:
    """The processor, its vector units as far as the system lists them, its cores, and the system."""
    info = _processor()
    flags = info.get("flags", info.get("Features", "")).split()
    return {
        "cpu": info.get("model name") or platform.processor() or platform.machine(),
        "vector_units": [unit for unit in VECTOR_UNITS if unit in flags],
        "cores": os.cpu_count(),
        "system": platform.platform(),
    }


def versions(packages: tuple[str, ...]) -> dict[str, str]:
    """The versions of Python and of those ``packages`` that are installed."""
    known = {"python": platform.python_version()}
    for package in packages:
        try:
            known[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return known


def _processor() -> dict[str, str]:
    """What Linux says about the first processor; empty elsewhere."""
    path = Path("/proc/cpuinfo")
    if not path.exists():
        return {}
    first, _, _ = path.read_text(encoding="utf-8").partition("\n\n")
    pairs = (line.partition(":") for line in first.splitlines())
    return {key.strip(): value.strip() for key, _, value in pairs}
