"""JAX as the command line uses it."""

import os
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from .options import BadInputError

if TYPE_CHECKING:
    from ..scenario import Scenario


def set_up_jax() -> None:
    """Imports JAX, with float64 and the settings for fast solves on a CPU, and begins to load compiled programs.

    A command calls this once there is nothing left to refuse that needs no numbers, and imports its work after it.
    """
    import jax

    from .. import cache, cpu

    cpu.prepare()
    jax.config.update("jax_enable_x64", True)
    _require_platform()
    cache.load_early()


def _require_platform() -> None:
    """Raises a :class:`BadInputError` where JAX is told to compute on what is not there."""
    wanted = os.environ.get("JAX_PLATFORMS", "")
    if wanted in ("", "cpu"):
        return
    import jax

    try:
        jax.devices()
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0] if str(error) else "JAX finds none"
        raise BadInputError(
            f'Variable `JAX_PLATFORMS` must name what JAX can compute on here, but it is "{wanted}": {reason}; leave '
            "it out, or set it to cpu."
        ) from None


def compiled_for(scenario: "Scenario") -> AbstractContextManager[None]:
    """Programs of this block are compiled quickly, unless the scenario's run may take more steps than by default.

    Up to these, an optimised program seldom saves the time that optimising it takes.
    """
    from ..numerics.programs import compiled_quickly

    return compiled_quickly(scenario.max_steps <= type(scenario).max_steps)
