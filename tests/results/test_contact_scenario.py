"""The scenario of a saved run with a law of contact."""

import jax
import numpy as np
import pytest

import jaxball
from jaxball import Contact, DiskState, ReleasedState
from jaxball.results import saved_scenario

DISK = jaxball.Disk(mass=1.0, inertia=0.5)


@pytest.fixture(scope="module")
def run():
    """A disk that bounces twice, with room for one switch fewer than there are."""
    start = ReleasedState(DiskState(phidot=1.0), V=(1.0, 0.0, 0.0), height=0.5)
    contact = Contact(friction=0.3, restitution=0.5, capacity=4)
    return jaxball.simulate(DISK, np.linspace(0.0, 3.5, 8), start, contact=contact, throw=True)


def assert_same(one, other):
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


@pytest.mark.thorough
def test_its_scenario_starts_as_it_did(run, tmp_path):
    scenario = saved_scenario(run.save(tmp_path / "run.npz"))
    assert_same(scenario.state, run.start)
    assert_same(scenario.contact, run.contact.law)
