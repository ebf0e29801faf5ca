"""Runs of several modes at loose tolerances: they reach their ends in the modes that those at tight ones have."""

import equinox as eqx
import jax
import numpy as np
import pytest

from jaxball import BallState, Contact, ReleasedState, load_scenario
from jaxball.ensemble import simulate_ensemble

ROWS = 128
TIMES = (0.0, 2.0)


def thrown_balls():
    """The paper's ball with its moving masses, with other offsets; half of them are thrown, and some bounce."""
    random = np.random.default_rng(1)
    paper = load_scenario("ball").system
    falls = random.random(ROWS) < 0.5
    q, Omega, V, offset = (random.normal(size=(ROWS, n)) for n in (4, 3, 3, 3))
    V[:, 2] *= falls
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    height = np.where(falls, random.uniform(0.0, 0.5, ROWS), 0.0)

    def thrown(q, Omega, V, height):
        return ReleasedState(BallState(q=q, Omega=Omega), V=V, height=height)

    def law(sliding, restitution):
        return Contact(friction=sliding, restitution=restitution, capacity=64)

    balls = jax.vmap(lambda offset: eqx.tree_at(lambda ball: ball.offset, paper, offset))(0.1 * offset)
    laws = jax.vmap(law)(random.uniform(0.02, 0.8, ROWS), random.choice([0.0, 0.3], ROWS))
    return balls, jax.vmap(thrown)(q, 3 * Omega, V, height), laws


@pytest.mark.thorough
def test_every_run_reaches_its_end_and_errs_by_a_few_tolerances():
    """Where the search for the end of a mode failed, a run stood still until it had no steps left."""
    balls, starts, laws = thrown_balls()

    def runs(tolerance):
        limits = {"rtol": tolerance, "atol": tolerance, "max_steps": 4000}
        return simulate_ensemble(balls, TIMES, starts, contact=laws, **limits).trajectory

    exact = runs(1e-11)
    modes = np.asarray(exact.contact.switches.target)
    for tolerance in (1e-6, 1e-4, 1e-3):
        loose = runs(tolerance)
        assert np.all(np.asarray(loose.status) == 0)
        same = np.all(np.asarray(loose.contact.switches.target) == modes, axis=1)
        assert np.sum(~same) <= 1  # which touches the plane for a thousandth of the time, or passes it by as closely
        errors = np.linalg.norm(np.asarray(loose.state.z - exact.state.z)[same, -1], axis=1)
        assert np.median(errors) < tolerance
        assert np.max(errors) < 10 * tolerance
        assert np.mean(loose.steps) < 40  # a third of what a search takes that passes zeros by
