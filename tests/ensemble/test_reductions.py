"""What is found of runs while they are computed is what their trajectories say afterwards."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import Ball, Disk, DiskState, Free, Ground, contact_extremes
from jaxball.simulation.ensemble import REDUCTIONS, Drift, Integral, Maximum, Minimum, program, simulate_ensemble

from .test_runs import disks, single

MASSES = np.linspace(0.5, 2.0, 5)
SPAN = np.array([0.0, 11.3])


def angle(system, t, state):
    """φ, which rocks between −1 and 1."""
    return state.phi


def swing(system, t, state):
    """φ̇ cos t, which has no closed integral that a rule could know."""
    return state.phidot * jnp.cos(t)


ALL = REDUCTIONS | {"most": Maximum(angle), "least": Minimum(angle), "wave": Integral(swing), "apart": Drift(angle)}


@pytest.fixture(scope="module")
def found():
    system, state = disks(MASSES)
    return simulate_ensemble(system, SPAN, state, reductions=ALL).reductions


@pytest.fixture(scope="module")
def trajectories():
    return [single(*disks(MASSES), k, times=SPAN, dense=True) for k in range(MASSES.size)]


@pytest.mark.long
@pytest.mark.parametrize("name", ["least_normal_force", "friction_needed", "largest_friction"])
def test_contact_is_that_of_single_runs(found, trajectories, name):
    wanted = [contact_extremes(trajectory) for trajectory in trajectories]
    np.testing.assert_allclose(found[name], [getattr(item, name) for item in wanted], rtol=1e-9)
    for k, trajectory in enumerate(
        trajectories
    ):  # what is extreme occurs again and again, so that the time may be another
        again = contact_extremes(
            single(*disks(MASSES), k, times=[0.0, float(found[f"{name}_time"][k]) + 1e-4], dense=True)
        )
        np.testing.assert_allclose(getattr(again, name), getattr(contact_extremes(trajectory), name), rtol=1e-7)


@pytest.mark.long
def test_extremes_lie_between_the_steps(found):
    # A disk that rocks from rest at φ = 1 comes to rest at −1 and at 1 again: energy is constant.
    np.testing.assert_allclose(found["most"], 1, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found["least"], -1, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found["apart"], 2, rtol=0, atol=1e-8)


@pytest.mark.thorough
def test_energy_does_not_drift(found):
    assert np.all(found["energy_drift"] < 1e-8)
    assert np.all(found["energy_drift"] > 0)


@pytest.mark.thorough
def test_integrals_are_those_of_the_trajectories(found, trajectories):
    nodes, weights = np.polynomial.legendre.leggauss(200)
    times = SPAN[1] / 2 * (nodes + 1)
    for k, trajectory in enumerate(trajectories):
        state = trajectory.at(times)
        wanted = SPAN[1] / 2 * np.sum(weights * np.asarray(state.phidot) * np.cos(times))
        np.testing.assert_allclose(found["wave"][k], wanted, rtol=0, atol=1e-8)
        distance = SPAN[1] / 2 * np.sum(weights * np.abs(state.phidot))  # r = 1; |φ̇| has corners
        np.testing.assert_allclose(found["distance"][k], distance, rtol=2e-2)


@pytest.mark.thorough
def test_the_largest_angular_speed_is_that_at_the_bottom(found, trajectories):
    for k, trajectory in enumerate(trajectories):
        fine = np.abs(np.asarray(trajectory.at(np.linspace(*SPAN, 4001)).phidot)).max()
        assert fine - 1e-7 <= found["largest_angular_speed"][k] < fine + 1e-6


@pytest.mark.thorough
def test_a_run_that_cannot_start_finds_nothing():
    system, state = disks(MASSES)
    system.mass[1] = -1.0
    found = simulate_ensemble(system, SPAN, state, reductions=ALL).reductions
    assert np.isnan(found["distance"][1])
    assert np.all(np.isfinite(found["distance"][np.array([0, 2])]))


@pytest.mark.slow
def test_derivatives_of_reductions():
    system, state = disks(MASSES)

    def highest(scale):
        scaled = jax.tree.map(lambda leaf: leaf * scale, state)
        found = simulate_ensemble(system, SPAN, scaled, reductions={"most": Maximum(angle), "least": Minimum(angle)})
        return found.reductions["most"], found.reductions["least"]

    _, (most, least) = jax.jvp(highest, (jnp.ones(()),), (jnp.ones(()),))
    np.testing.assert_allclose(most, 1, rtol=0, atol=1e-6)
    np.testing.assert_allclose(least, -1, rtol=0, atol=1e-6)


@pytest.mark.long
def test_a_quantity_that_is_written_anew_is_known_again():
    """It moves at a constant speed: the largest place is twice the speed, times the factor that the quantity holds."""
    disk, states = Disk(mass=1.0, inertia=0.5), DiskState(phidot=jnp.array([-1.0, -2.0]))
    states = jax.tree.map(lambda x: jnp.broadcast_to(x, (2, *x.shape)) if x.shape[:1] != (2,) else x, states)

    def largest(factor):
        quantity = Maximum(lambda system, t, state: factor * state.z)
        runs = simulate_ensemble(disk, [0.0, 2.0], states, in_axes=(None, 0), reductions={"most": quantity})
        return runs.reductions["most"]

    np.testing.assert_allclose(largest(1.0), [2.0, 4.0], rtol=1e-12)
    compiled = program._compile.cache_info().misses
    np.testing.assert_allclose(largest(1.0), [2.0, 4.0], rtol=1e-12)
    assert program._compile.cache_info().misses == compiled
    np.testing.assert_allclose(largest(3.0), [6.0, 12.0], rtol=1e-12)
    slopes = jax.jacfwd(largest)(3.0)
    np.testing.assert_allclose(slopes, [2.0, 4.0], rtol=1e-9)


def test_a_ground_that_would_have_to_pull_needs_infinite_friction():
    """A plane that falls faster than g: N = m (g + Ẍ₃) = 1 − 2 sin t, without any friction."""
    ground = Ground(motion=Free(lambda t, _: jnp.stack([0.0 * t, 0.0 * t, 2 * jnp.sin(t)])))
    balls = jax.vmap(lambda mass: Ball(mass=mass, inertia=(0.4, 0.4, 0.4), ground=ground))(jnp.array([1.0, 2.0]))
    found = simulate_ensemble(balls, [0.0, 2.0], reductions=REDUCTIONS).reductions
    np.testing.assert_allclose(found["least_normal_force"], [-1.0, -2.0], rtol=1e-9)
    np.testing.assert_array_equal(found["friction_needed"], np.inf)


def test_a_quantity_that_is_no_number_has_no_largest_value():
    system, state = disks(MASSES[:2])
    reductions = {"bad": Maximum(lambda system, t, state: jnp.where((t > 2) & (t < 8), jnp.nan, t))}
    found = simulate_ensemble(system, SPAN, state, reductions=reductions).reductions
    np.testing.assert_array_equal(found["bad"], np.nan)
    np.testing.assert_array_equal(found["bad_time"], np.nan)
