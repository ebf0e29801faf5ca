"""θ of the masses on rails among the observables, whatever moves them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import (
    Circle,
    ConstantRate,
    Disk,
    DiskState,
    Driven,
    Fixed,
    FunctionLaw,
    OnRail,
    PointMass,
    Sinusoids,
    Tube,
)
from tests.support.sentences import refuses


def swing(t, state, stiffness):
    return jnp.stack([-stiffness * state.theta[0]])


MASSES = (
    PointMass(0.1, OnRail(Circle(0.9), ConstantRate(0.3, rate=2.0))),
    PointMass(0.2, Fixed((0.0, 0.0, -0.5))),
    PointMass(0.3, Driven(Circle(0.5))),
    PointMass(0.1, OnRail(Tube((1.0, 0.0, 0.0)), Sinusoids(0.1, amplitude=[0.2], frequency=[3.0]))),
    PointMass(0.1, OnRail(Circle(0.8), ConstantRate(-1.0, rate=1.0))),
)


@pytest.fixture(scope="module")
def run():
    disk = Disk(mass=1.0, inertia=0.5, masses=MASSES, law=FunctionLaw(swing, 4.0))
    return jaxball.simulate(
        disk, np.linspace(0.0, 2.0, 9), DiskState(theta=[0.4], thetadot=[0.0]), rtol=1e-12, atol=1e-12
    )


def test_angles_and_rates_in_the_order_of_the_masses(run):
    t, seen = np.asarray(run.times), run.observables
    angles = [0.3 + 2 * t, 0.4 * np.cos(2 * t), 0.1 + 0.2 * np.sin(3 * t), t - 1]
    rates = [2 + 0 * t, -0.8 * np.sin(2 * t), 0.6 * np.cos(3 * t), 1 + 0 * t]
    np.testing.assert_allclose(seen.mass_angles, np.stack(angles, axis=1), atol=1e-10)
    np.testing.assert_allclose(seen.mass_rates, np.stack(rates, axis=1), atol=1e-10)


def test_files_name_the_masses(run, tmp_path):
    data = run.to_dataset()
    assert data["rail"].values.tolist() == ["masses[0]", "masses[2]", "masses[3]", "masses[4]"]
    np.testing.assert_array_equal(data["mass_angles"].sel(rail="masses[2]"), run.state.theta[:, 0])


def test_masses_take_another_schedule_or_a_law():
    held = MASSES[2].follow(ConstantRate(0.2, rate=0.0))
    assert float(held.schedule(jnp.array(1.0))) == 0.2
    assert MASSES[0].follow_law().schedule is None
    with refuses(ValueError, "motion"):
        MASSES[1].follow_law()


def test_a_body_without_rails_has_none():
    seen = jaxball.observe(Disk(mass=1.0, inertia=0.5), jnp.array(0.0), DiskState())
    assert jax.tree.map(jnp.shape, (seen.mass_angles, seen.mass_rates)) == ((0,), (0,))
