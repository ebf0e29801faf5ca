"""The floating-point type in which the tests run, and what rounding errors are in it."""

import importlib

import jax
import jax.numpy as jnp
import pytest

X64 = jax.config.read("jax_enable_x64")
RATIO = float(jnp.finfo(jnp.result_type(float)).eps / jnp.finfo("float64").eps)
differences_need_float64 = pytest.mark.skipif(not X64, reason="differences over 1e-5 are rounding alone in float32")


def scaled(bound: float) -> float:
    """A bound that allows for some roundings in float64, for as many roundings in the type in use."""
    return bound * RATIO


# Releases of JAX have it in one of two places.
enable_x64 = (jax if hasattr(jax, "enable_x64") else importlib.import_module("jax.experimental")).enable_x64
