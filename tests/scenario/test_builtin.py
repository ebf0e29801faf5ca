"""The built-in scenarios stay on the ground and do what their comments say; others are in files of their own."""

import functools
import json
import tomllib
from importlib.resources import files

import jax
import numpy as np
import pytest

from jaxball import load_scenario
from jaxball.files.scenario import builtin_scenarios
from jaxball.files.scenario.sources import builtin_text, builtin_title

from .runs import rolling_run

NAMES = (
    "axisymmetric-pendulum",
    "axisymmetric-pendulum-on-a-slope",
    "ball",
    "chaplygin-sphere",
    "chaplygin-top",
    "disk",
    "disk-in-ball",
    "ellipse-and-eight",
    "gyroscopic-pendulum",
    "moball",
    "norma",
    "pendulum",
    "pendulum-and-yoke",
    "pendulum-on-a-slope",
    "roboball",
    "roboball-2",
    "rolling-robot",
    "rotunbot",
    "routh-sphere",
    "six-tubes",
    "spokes",
    "stopping-ball",
    "three-rotors",
    "turntable",
    "vibrating-plane",
    "yoke-robot",
)
ON_SURFACES = (
    "ball-and-plate",
    "ball-in-a-bowl",
    "ball-off-a-sphere",
    "golfers-dilemma",
    "tilting-plate",
    "washboard",
    "wheel-in-a-half-pipe",
)
RELEASED = (
    "bouncing-ball",
    "bowling-ball",
    "draw-shot",
    "hoop-with-backspin",
    "hopping-hoop",
    "jumping-ball",
    "masse-shot",
    "slipping-ball",
    "tippe-top",
)
CONSERVATIVE = (
    "chaplygin-sleigh",
    "free-rigid-body",
    "heavy-top",
    "nonholonomic-particle",
    "rattleback",
    "suslov",
    "vakonomic-particle",
)
CLASSICAL = (*CONSERVATIVE, "oblate-ball")


@pytest.fixture(scope="module")
def runs():
    """Scenarios with their trajectories and observables, each solved once, in which the body stays on its ground."""

    @functools.cache
    def run(name):
        trajectory, _, seen = rolling_run(name)
        return trajectory, jax.tree.map(np.asarray, seen)

    return run


def reference(name):
    values = json.loads((files("jaxball.paper") / "data" / f"paper_{name}.json").read_text())["values"]
    return np.array([[float(x) for x in values[str(t)]] for t in range(21)])


def test_names():
    assert builtin_scenarios() == tuple(sorted(NAMES + ON_SURFACES + RELEASED + CLASSICAL))


@pytest.mark.parametrize("name", NAMES + ON_SURFACES + RELEASED + CLASSICAL)
def test_titles_are_those_of_the_documents(name):
    assert builtin_title(name) == tomllib.loads(builtin_text(name))["title"]


@pytest.mark.long
def test_energy_changes_by_the_work_done(runs):
    """Trapezia of step 0.1 are good to about 1e-2 of a power whose changes take about a unit of time."""
    for name in ("pendulum", "six-tubes", "chaplygin-sphere", "ellipse-and-eight"):
        trajectory, seen = runs(name)
        work = np.sum((seen.power[1:] + seen.power[:-1]) / 2 * np.diff(np.asarray(trajectory.times)))
        energy = seen.kinetic_energy + seen.potential_energy
        assert abs(work - (energy[-1] - energy[0])) < 2e-2 * np.ptp(energy), name


@pytest.mark.thorough
def test_ball_is_the_papers(runs):
    trajectory, _ = runs("ball")
    state = np.concatenate([trajectory.state.q, trajectory.state.Omega, trajectory.state.z], axis=1)[::10]
    np.testing.assert_allclose(state, reference("ball")[:, 6:], rtol=0, atol=1e-7)


@pytest.mark.thorough
def test_disk_is_the_papers(runs):
    trajectory, _ = runs("disk")
    state = np.stack([trajectory.state.phi, trajectory.state.phidot], axis=1)[::10]
    np.testing.assert_allclose(state, reference("disk")[:, -2:], rtol=0, atol=1e-10)


@pytest.mark.thorough
def test_disk_in_ball_rolls_as_the_disk(runs):
    disk, ball = runs("disk")[0].state, runs("disk-in-ball")[0].state
    np.testing.assert_allclose(ball.z[:, 0], disk.z, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ball.Omega[:, 1], -disk.phidot, rtol=0, atol=1e-9)


@pytest.mark.thorough
def test_routh_sphere_conserves_energy_and_jellett(runs):
    """Jellett's integral by its formula for masses on E3; both hold to the solver's tolerance of 1e-10."""
    trajectory, seen = runs("routh-sphere")
    m, h = np.array([1.0, 0.3, 0.1]), np.array([0.0, 0.6, -0.2])
    centre = np.sum(m * h) / np.sum(m)
    d1, d3 = 0.4 + np.sum(m * (h - centre) ** 2), 0.5
    G, W = seen.vertical_body.T, np.asarray(trajectory.state.Omega).T
    jellett = d1 * (W[0] * G[0] + W[1] * G[1]) + d3 * W[2] * (G[2] + centre)
    assert np.ptp(jellett) < 1e-8
    assert np.ptp(seen.kinetic_energy + seen.potential_energy) < 1e-8
    assert np.ptp(G[2]) > 1e-2


@pytest.mark.thorough
def test_chaplygin_sphere_keeps_its_centre_of_mass(runs):
    _, seen = runs("chaplygin-sphere")
    assert np.max(np.abs(seen.centre_of_mass_body)) < 1e-15
    assert np.ptp(seen.kinetic_energy + seen.potential_energy) > 1e-2


@pytest.mark.thorough
def test_chaplygin_top_conserves_energy_and_rolls_over(runs):
    """Γ3 takes both signs, as no motion near rest would have it."""
    _, seen = runs("chaplygin-top")
    assert np.ptp(seen.kinetic_energy + seen.potential_energy) < 1e-8
    assert np.ptp(np.sign(seen.vertical_body[:, 2])) == 2


@pytest.mark.thorough
def test_rolling_robot_is_driven_round_at_a_constant_rate(runs):
    """θ = −π/2 + 1.5 t in the plane of E1 and E3."""
    trajectory, seen = runs("rolling-robot")
    angle = 1.5 * np.asarray(trajectory.times)
    place = 0.8 * np.stack([np.sin(angle), 0 * angle, -np.cos(angle)], axis=1)
    np.testing.assert_allclose(seen.mass_positions_body[:, 0], place, atol=1e-13)


@pytest.mark.long
def test_pendulum_on_a_slope_holds_the_ball(runs):
    """Where the ball rests, M g r sin a = m g l sin ψ of the pendulum is the torque of the spring, κ (φ − ψ), but for
    what dry friction may hold, 0.02 M g r."""
    trajectory, _ = runs("pendulum-on-a-slope")
    low, high = 1.5 * np.sin(0.1) + np.array([-1, 1]) * 0.02 * 1.5
    assert np.arcsin(low / 0.3) + low / 0.2 < trajectory.state.z[-1, 0] < np.arcsin(high / 0.3) + high / 0.2
    assert np.linalg.norm(trajectory.state.Omega[-1]) < 0.01
    np.testing.assert_array_equal(trajectory.state.z[:, 1], 0.0)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name in ("free-rigid-body", "nonholonomic-particle") else ())
        for name in CONSERVATIVE
    ],
)
def test_classical_systems_keep_their_laws(name):
    """Between steps the solver interpolates, to about a hundred times its tolerance of 1e-10 or 1e-12."""
    trajectory = load_scenario(name).simulate(throw=True)
    for law, values in trajectory.laws._asdict().items():
        changes = np.abs(np.asarray(values - values[:1]))
        assert np.max(changes) < 3e-8, law


def test_the_sleigh_comes_round_as_in_closed_form():
    """ω = Ω₀ sech κt and v = V₀ tanh κt from the cusp on, κ = m a V₀/(I + m a²) and V₀² = Ω₀² (I + m a²)/m."""
    scenario = load_scenario("chaplygin-sleigh")
    m, inertia, a = (float(getattr(scenario.system, name)) for name in ("mass", "inertia", "ahead"))
    V = np.sqrt((inertia + m * a**2) / m)
    kappa = m * a * V / (inertia + m * a**2)
    run = scenario.simulate(throw=True)
    t, theta = np.asarray(run.times) - 4.0, np.asarray(run.state.q[:, 2])
    v = run.state.qdot[:, 0] * np.cos(theta) + run.state.qdot[:, 1] * np.sin(theta)
    np.testing.assert_allclose(run.state.qdot[:, 2], 1 / np.cosh(kappa * t), rtol=0, atol=1e-9)
    np.testing.assert_allclose(v, V * np.tanh(kappa * t), rtol=0, atol=1e-9)
    turned = 2 * np.arctan(np.tanh(kappa * t / 2)) / kappa
    np.testing.assert_allclose(theta, turned - turned[0], rtol=0, atol=1e-9)
