"""The two systems of sections 4 and 5 against the paper's words and known numbers of the configuration."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import load_scenario, paper
from jaxball.physics.observables import observe

START = jnp.asarray(0.0)


@pytest.mark.thorough
def test_the_balls_mass_is_nearly_above_its_centre():
    """Section 5; θ_a is rounded to four digits, which leaves Σ m χ off the axis by some 1e-5."""
    seen = jax.jit(observe)(paper.ball(), START, jaxball.BallState())
    p = 4 * np.asarray(seen.centre_of_mass_body)  # M = 4
    np.testing.assert_allclose(p, [2.6e-5, -7.9e-6, 0.683213], rtol=0, atol=6e-7)
    np.testing.assert_allclose(seen.energy, 0.68321332, rtol=0, atol=6e-9)


@pytest.mark.thorough
def test_the_disks_masses_hang_below_its_centre():
    """Section 4; the heights are -.9, -.63..., -.36... and -.1."""
    seen = jax.jit(observe)(paper.disk(), START, jaxball.DiskState())
    points = np.asarray(seen.mass_positions_body)
    np.testing.assert_allclose(points[:, :2], 0, rtol=0, atol=1e-16)
    np.testing.assert_allclose(points[:, 2], [-0.9, -0.6 - 1 / 30, -0.3 - 2 / 30, -0.1], rtol=0, atol=2e-16)


@pytest.mark.parametrize(("system", "total"), [(paper.ball(), 4), (paper.disk(), 5)])
def test_total_masses(system, total):
    assert system.total_mass == total


@pytest.mark.parametrize(("system", "signs"), [(paper.ball(), (1, 1, 1)), (paper.disk(), (-1, 1, -1, 1))])
@pytest.mark.parametrize(("t", "height"), [(0.05, 1.0), (0.1, 1.0), (0.15, 0.5), (0.19, 0.1), (0.2, 0.0), (7.0, 0.0)])
def test_actuation_is_the_paper_s_pulse(system, signs, t, height):
    """``eq_prescribed_u_disk`` and ``eq_prescribed_u_ball``."""
    u = [item.motion.schedule.prepare().derivatives(jnp.asarray(t))[2] for item in system.point_masses]
    np.testing.assert_allclose(u, np.multiply(signs, height), rtol=0, atol=1e-14)


@pytest.mark.parametrize(("name", "system"), [("ball", paper.ball()), ("disk", paper.disk())])
def test_the_built_in_scenario_is_the_same_system(name, system):
    scenario = load_scenario(name)
    ours, theirs = jax.tree.flatten(system), jax.tree.flatten(scenario.system)
    assert ours[1] == theirs[1]
    for a, b in zip(ours[0], theirs[0], strict=True):
        np.testing.assert_array_equal(a, b)
