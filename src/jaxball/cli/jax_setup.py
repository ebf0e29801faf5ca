"""JAX as the command line uses it."""

# A run of no more steps, the default of `max_steps`, seldom takes as much longer as its program takes less to compile.
SHORT_RUN = 16384


def set_up_jax() -> None:
    """Imports JAX, with float64 and the settings for fast solves on a CPU, and begins to load compiled programs.

    A command calls this once there is nothing left to refuse that needs no numbers, and imports its work after it.
    """
    import jax

    from .. import cache, cpu

    cpu.prepare()
    jax.config.update("jax_enable_x64", True)
    cache.load_early()
