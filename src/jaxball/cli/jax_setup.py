"""JAX as the command line uses it."""

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

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
    cache.load_early()


def compiled_for(scenario: "Scenario") -> AbstractContextManager[None]:
    """Programs of this block are compiled quickly, unless the scenario's run may take more steps than by default.

    Up to these, an optimised program seldom saves the time that optimising it takes.
    """
    from ..numerics.programs import compiled_quickly

    return compiled_quickly(scenario.max_steps <= type(scenario).max_steps)
