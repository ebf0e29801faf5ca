"""Describes what is installed and set, for a report of an error: ``jaxball --version --json`` prints it."""

import importlib.metadata
import os
import platform
from typing import Any

from .. import __version__

PACKAGES = (
    "jax", "jaxlib", "diffrax", "equinox", "optimistix", "jaxtyping", "llvmlite", "numpy", "scipy", "matplotlib",
    "xarray", "h5netcdf", "zarr", "mujoco",
)  # fmt: skip
SETTINGS = ("JAXBALL_", "JAX_", "XLA_", "CUDA_VISIBLE_DEVICES", "OMP_NUM_THREADS")


def installation() -> dict[str, Any]:
    """Describes the versions, the processor, the devices, the compilers and the settings of the environment."""
    import jax  # here, because --version alone does without

    from ..programs.native import gpu
    from ..programs.native.choice import current_choice
    from ..programs.native.targets import machine

    return {
        "jaxball": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processor": machine.processor_name() if machine.is_present() else platform.processor(),
        "cores": os.cpu_count(),
        "packages": {name: _version(name) for name in PACKAGES},
        "compiler": current_choice(),
        "backend": jax.default_backend(),
        "devices": [device.device_kind for device in jax.devices()],
        "gpu": gpu.why_not() or "available",
        "settings": {name: value for name, value in sorted(os.environ.items()) if name.startswith(SETTINGS)},
    }


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None
