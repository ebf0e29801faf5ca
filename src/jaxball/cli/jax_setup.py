"""Sets JAX up for a command: the device, float64, fast solves on a CPU, and the kept programs of the command."""

import os
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from .options import BadInputError

if TYPE_CHECKING:
    from ..files.scenario.scenario import Scenario


PLATFORMS = {"cpu": "cpu", "gpu": "cuda,cpu"}  # by the names that users give to devices


def set_up_jax(device: str | None = None) -> None:
    """Imports JAX, with float64 and the settings for fast solves on a CPU, and begins to load compiled programs.

    A command calls this after all checks that need no JAX, and then imports its work.

    - ``device``: ``"cpu"`` or ``"gpu"``; None for the one that JAX chooses, which is a GPU where there is one.
    """
    if device is not None:
        # Before JAX is imported, which reads it once.
        os.environ["JAX_PLATFORMS"] = PLATFORMS[device]
    try:
        import jax
    except ValueError as error:
        raise _explain_refusal(error) from None

    from ..programs import cache, cpu

    # Before a backend starts, for which it sets how it compiles.
    cpu.prepare()
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_traceback_in_locations_limit", 0)  # About a tenth of the time that lowering takes.
    _require_platform(device)
    cache.load_early()


def _explain_refusal(error: ValueError) -> BadInputError:
    """Explains an environment variable that JAX cannot read; JAX's own sentence uses another name for it."""
    reason = str(error).splitlines()[0] if str(error) else "JAX does not say which"
    of_jax = [name for name in sorted(os.environ) if name.startswith("JAX_")]
    named = [name for name in of_jax if name in reason or name.lower() in reason] or of_jax
    which = f"Variable `{named[0]}`" if len(named) == 1 else f"Variables {', '.join(f'`{name}`' for name in named)}"
    values = ", ".join(f'"{os.environ[name]}"' for name in named)
    return BadInputError(f"{which} must have a value that JAX can read, but it is {values}: {reason}; leave it out.")


def _require_platform(device: str | None = None) -> None:
    """Raises a :class:`BadInputError` where JAX is told to use a device that does not exist."""
    variables = {
        name: os.environ.get(name, "") for name in ("JAX_PLATFORMS", "JAX_PLATFORM_NAME", "JAX_DEFAULT_DEVICE")
    }
    devices = {name: value for name, value in variables.items() if value not in ("", "cpu")}
    if not devices:
        return
    import jax
    import jax.numpy as jnp

    try:
        # Both, because a device can be listed and yet refuse to work.
        jax.devices()
        jnp.zeros(())
        if device == "gpu" and jax.default_backend() != "gpu":  # JAX takes the next platform where one is not there
            raise RuntimeError("JAX finds no GPU")
    except (RuntimeError, AssertionError, ValueError) as error:
        reason = str(error).splitlines()[0].rstrip(".") if str(error) else "JAX finds none"
        if device is not None:
            raise BadInputError(
                f"Option `--device` must name a device that JAX can use here, but it is {device}: {reason}; install "
                "JAX for it with pip install 'jax[cuda13]', or leave the option out."
            ) from None
        names = " and ".join(f"`{name}`" for name in devices)
        values = " and ".join(f'"{value}"' for value in devices.values())
        raise BadInputError(
            f"Variable {names} must name a device that JAX can use here, but it is {values}: {reason}; leave it out, "
            "or set it to cpu."
        ) from None


def compile_for(scenario: "Scenario") -> AbstractContextManager[None]:
    """Compiles programs in this block quickly, unless the scenario allows many steps.

    Up to that many, an optimised program seldom saves the time that optimising it takes.
    """
    from ..programs.program import compile_quickly

    return compile_quickly(scenario.max_steps <= type(scenario).max_steps)
