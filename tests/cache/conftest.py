"""These tests have folders of their own."""

import jax
import pytest
from jax.experimental.compilation_cache.compilation_cache import reset_cache


@pytest.fixture(autouse=True)
def without_the_folders_of_all_tests(monkeypatch):
    """JAX's own cache, beside which XLA's programs are not kept, and jaxball's."""
    from jaxball.cache import current

    monkeypatch.setenv("JAXBALL_NO_CACHE", "1")
    monkeypatch.delenv("JAXBALL_CACHE_DIR", raising=False)
    folder = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", None)
    reset_cache()
    with current.kept_in(None):
        yield
    jax.config.update("jax_compilation_cache_dir", folder)
    reset_cache()
