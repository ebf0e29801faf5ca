"""Derivatives of ensembles, by forward and by reverse mode, and the form that compiled functions give them."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Disk, DiskState, Ground
from jaxball.programs import native
from jaxball.simulation.ensemble import Maximum, simulate_ensemble
from tests.support.sentences import refuses

SLOPE, END = 0.3, 2.0
INERTIAS = np.linspace(0.2, 1.0, 20)


def placed(system, t, state):
    """z, which grows down the slope."""
    return state.z


FOUND = {"furthest": Maximum(placed)}


def rolled(inertias, **settings):
    """How far disks roll down a slope, at the end and at most."""
    disks = jax.vmap(lambda d: Disk(mass=1.0, inertia=d, gravity=9.81, ground=Ground(SLOPE)))(inertias)
    settings = {"in_axes": (0, None), "reductions": FOUND, "max_steps": 64} | settings
    many = simulate_ensemble(disks, [0.0, END], DiskState(), **settings)
    return many.state.z[:, -1], many.reductions.get("furthest")


def distance(inertias):
    """½ g sin α t² / (1 + d / (m r²))."""
    return 9.81 * np.sin(SLOPE) * END**2 / 2 / (1 + inertias)


def slope(inertias):
    """Its derivative."""
    return -distance(inertias) / (1 + inertias)


@pytest.mark.long
def test_forward_mode():
    one = jnp.ones(INERTIAS.size)
    (ends, most), slopes = jax.jit(lambda d: jax.jvp(rolled, (d,), (one,)))(jnp.asarray(INERTIAS))
    for found, changes in ((ends, slopes[0]), (most, slopes[1])):
        np.testing.assert_allclose(jnp.abs(found), distance(INERTIAS), rtol=1e-9)
        np.testing.assert_allclose(jnp.abs(changes), -slope(INERTIAS), rtol=1e-8)


@pytest.mark.long
def test_reverse_mode():
    weights = jnp.linspace(1.0, 2.0, INERTIAS.size)

    def total(d):
        ends, most = rolled(d)
        return jnp.sum(weights * (ends + 2 * most))

    found = jaxball.jit(jax.grad(total))(jnp.asarray(INERTIAS))
    np.testing.assert_allclose(jnp.abs(found), -3 * weights * slope(INERTIAS), rtol=1e-8)


@pytest.mark.thorough
def test_what_is_chosen_is_kept_to():
    with refuses(TypeError, "adjoint"):
        jax.grad(lambda d: jnp.sum(rolled(d, adjoint=diffrax.ForwardMode())[0]))(jnp.asarray(INERTIAS))


@pytest.mark.thorough
def test_a_compiled_function_computes_runs_side_by_side_in_whatever_way_it_is_compiled():
    """Eight in vectors natively. XLA calls the same program, as one operation."""

    @jax.jit
    def ends(inertias):
        return rolled(inertias, reductions={})[0]

    given = jnp.asarray(INERTIAS)
    assert "<8 x double>" in native.Lowered(lambda arrays: [ends(*arrays)], [given], "ends").as_text()
    assert "jaxball_" in ends.lower(given).as_text()
    np.testing.assert_allclose(jaxball.jit(ends)(given), ends(given), rtol=1e-12)
