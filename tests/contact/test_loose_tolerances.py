"""Runs of several modes at loose tolerances: they reach their ends in the modes that those at tight ones have."""

import equinox as eqx
import jax
import numpy as np
import pytest

from jaxball import Ball, BallState, Circle, ConstantRate, Contact, OnRail, PointMass, load_scenario
from jaxball.physics import ReleasedState
from jaxball.simulation.ensemble import simulate_ensemble

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


def balls_that_stick():
    """Random balls with an offset and a mass on a rail, whose friction holds more than it has while they slip."""
    random, rows = np.random.default_rng(2), ROWS

    def ball(moments, offset, mass, rail, centre, rate):
        motion = OnRail(Circle(rail, centre), ConstantRate(0.0, rate))
        return Ball(mass=1.0, gravity=9.81, inertia=moments, offset=offset, masses=[PointMass(mass, motion)])

    def law(sliding, more):
        return Contact(friction=sliding, static_friction=more * sliding, capacity=64)

    offset, centre = 0.1 * random.normal(size=(2, rows, 3))
    numbers = random.uniform(0.35, 0.5, (rows, 3)), offset, random.uniform(0.1, 0.6, rows)
    balls = jax.vmap(ball)(*numbers, random.uniform(0.2, 0.7, rows), centre, random.uniform(-5.0, 5.0, rows))
    laws = jax.vmap(law)(random.uniform(0.02, 0.15, rows), random.uniform(1.05, 1.8, rows))
    q, Omega = random.normal(size=(rows, 4)), 2 * random.normal(size=(rows, 3))
    return balls, (q / np.linalg.norm(q, axis=1, keepdims=True), Omega), laws


@pytest.mark.long
def test_a_ball_that_slips_and_rolls_again_errs_as_one_that_starts_with_an_error():
    """By no more than twice what an error of the tolerance in its start grows to: each step adds a part of it."""
    balls, (q, Omega), laws = balls_that_stick()

    def runs(tolerance, q, Omega):
        starts = jax.vmap(lambda q, Omega: BallState(q=q, Omega=Omega))(q, Omega)
        limits = {"rtol": tolerance, "atol": tolerance, "max_steps": 4000}
        run = simulate_ensemble(balls, (0.0, 3.0), starts, contact=laws, **limits).trajectory
        assert np.all(np.asarray(run.status) == 0)
        ends = np.concatenate([np.asarray(x)[:, -1] for x in (run.state.z, run.state.q, run.state.Omega)], axis=1)
        return ends, np.asarray(run.contact.switches.target)

    (exact, modes), error = runs(1e-12, q, Omega), 1e-6
    # Errors of the attitude, and of Ω, along each axis of the body.
    turned = [q + 0.5 * error * np.array(turn) for turn in np.eye(4)]
    pushed = [Omega + error * np.array(axis) for axis in np.eye(3)]
    starts = [*((other, Omega) for other in turned), *((q, other) for other in pushed)]
    growth = np.max([np.linalg.norm(runs(1e-12, *start)[0] - exact, axis=1) / error for start in starts], axis=0)
    slips_and_rolls = np.sum(modes >= 0, axis=1) >= 2
    assert np.sum(slips_and_rolls) > ROWS // 8
    for tolerance in (1e-6, 1e-8):
        ends, same = runs(tolerance, q, Omega)
        np.testing.assert_array_equal(same, modes)
        errors = np.linalg.norm(ends - exact, axis=1)
        assert np.all(errors[slips_and_rolls] < 2 * tolerance * np.maximum(growth, 1.0)[slips_and_rolls])
