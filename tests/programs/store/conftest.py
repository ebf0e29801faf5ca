"""These tests have folders of their own, and programs that are optimised, of which there is one for each function."""

import jax
import pytest
from jax.experimental.compilation_cache.compilation_cache import reset_cache


@pytest.fixture(autouse=True)
def without_the_folders_of_all_tests(monkeypatch):
    """JAX's own cache, beside which XLA's programs are not kept, and jaxball's."""
    from jaxball.interface.compat import settings
    from jaxball.programs.store import current

    monkeypatch.setenv("JAXBALL_NO_CACHE", "1")
    monkeypatch.delenv("JAXBALL_CACHE_DIR", raising=False)
    folder, unoptimised = jax.config.jax_compilation_cache_dir, settings()["jax_disable_most_optimizations"]
    jax.config.update("jax_disable_most_optimizations", False)
    jax.config.update("jax_compilation_cache_dir", None)
    reset_cache()
    with current.keep_within(None):
        yield
    jax.config.update("jax_disable_most_optimizations", unoptimised)
    jax.config.update("jax_compilation_cache_dir", folder)
    reset_cache()
