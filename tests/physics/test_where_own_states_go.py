"""States of one's own where runs are parts of something else: filters, feedback, environments, files with units.

All are linear, so that each has a closed form.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pyarrow.parquet
import pytest
from scipy.linalg import expm

from jaxball import Disk, DiskState, Motor, Scenario, ScenarioError, read_scenario, ring_rotor, simulate, write_scenario
from jaxball.control import tvlqr
from jaxball.control.environments import Environment, HoldSpeed, ObservedState, Uniform
from jaxball.control.estimation import ErrorStateFilter
from jaxball.files.scenario import Units
from jaxball.physics import OwnStates
from jaxball.physics.sensors import AbstractSensor, Gyroscope, SensorErrors
from jaxball.studies.sweep import open_store
from tests.support.scripts import printed_by
from tests.support.sentences import refuses
from tests.sweep.studies import study

M, D, R, G = 1.1, 0.5, 0.9, 2.0
RING, RADIUS = 0.4, 0.5
ROTOR, SHELL = RING * RADIUS**2, D + (M + RING) * R**2
TAU, H = 0.3, 0.1


def lag(t, state, tau):
    return (state.phidot - state.own) / tau


def wheel_disk(tau=TAU, **others):
    """A disk with a wheel on its axis, and a filter of first order of φ̇."""
    rotor = ring_rotor(RING, RADIUS, axis=(0.0, 1.0, 0.0), drive=Motor(0.0, limit=1.0))
    own = OwnStates(lag, tau, names="filtered", **others)
    return Disk(mass=M, inertia=D, radius=R, gravity=G, mechanisms=[rotor], own_states=own)


def state(own=0.0, phidot=0.0):
    return DiskState(phidot=phidot, theta=[0.0], thetadot=[0.0], own=[own])


class Reads(AbstractSensor):
    """Reads a state of one's own."""

    def reading(self, system, t, movement):
        return movement.state.own[0]


@pytest.mark.thorough
def test_a_filter_is_as_sure_of_them_as_a_least_squares_line():
    """What decays by itself, p₀ at first, and is read K times with a deviation σ: 1/p = 1/p₀ + Σ e^{−2 t/τ}/σ²."""
    sensors = {"charge": Reads(errors=SensorErrors(noise=0.02, seed=3))}
    known = ErrorStateFilter.of(wheel_disk(), sensors, H)
    run = simulate(wheel_disk(), H * np.arange(11), state(0.8))
    decay, read = np.exp(-run.times / TAU), run.measured(sensors)
    estimate = known(read, state(0.5), {"own": 0.3})
    precision = 1 / 0.3**2 + np.cumsum(decay**2) / 0.02**2
    first = (0.5 / 0.3**2 + np.cumsum(decay * read["charge"]) / 0.02**2) / precision
    np.testing.assert_allclose(estimate.deviations["own[0]"], decay / np.sqrt(precision), rtol=1e-7)
    np.testing.assert_allclose(estimate.state.own[:, 0], decay * first, rtol=0, atol=1e-9)
    np.testing.assert_allclose(estimate.smoothed().state.own[:, 0], decay * first[-1], rtol=0, atol=1e-9)
    blind = ErrorStateFilter.of(wheel_disk(), {"gyro": Gyroscope(errors=SensorErrors(noise=0.1))}, H)
    assert "own[0]" in blind.unobservable(state(), samples=5)


def linear(rate=None):
    """Ẋ = A X + B u of (φ, φ̇, z, θ, θ̇, x), over a sample."""
    rate, control = np.zeros((6, 6)), np.zeros((6, 1))
    rate[0, 1], rate[2, 1], rate[3, 4], rate[5, 1], rate[5, 5] = 1.0, -R, 1.0, 1 / TAU, -1 / TAU
    control[1, 0], control[4, 0] = 1 / SHELL, 1 / SHELL + 1 / ROTOR
    both = expm(H * np.block([[rate, control], [np.zeros((1, 7))]]))
    return both[:6, :6], both[:6, 6:]


@pytest.mark.thorough
def test_feedback_of_them_is_that_of_the_linear_system():
    track = tvlqr(simulate(wheel_disk(), [0.0, 1.0], state()), Q={"phidot": 1.0, "own": 5.0}, R=1.0, sample=H)
    A, B = linear()
    np.testing.assert_allclose(track.linear.A[3], A, rtol=0, atol=1e-8)
    np.testing.assert_allclose(track.linear.B[3], B, rtol=0, atol=1e-8)
    start = {"phidot": 0.1, "own[0]": -0.2}
    held = track.closed_loop(start)
    assert abs(float(held.u[0, 0])) > 0.01
    np.testing.assert_allclose(held.xi[1:], held.xi[:-1] @ A.T + held.u @ B.T, rtol=0, atol=1e-8)
    # Where no limit is reached, the plan of the whole rest is the regulator.
    ahead = track.mpc(track.nominal.samples).closed_loop(start)
    np.testing.assert_allclose(ahead.xi, held.xi, rtol=0, atol=1e-6)


@pytest.mark.thorough
def test_an_environment_draws_them_and_their_parameters_and_shows_them():
    drawn = {"starts": {"own": Uniform(0.5, 1.0)}, "parameters": {"own_states.parameters": Uniform(0.2, 0.4)}}
    world = Environment(wheel_disk(), HoldSpeed(0.0), sample=H, samples=5, **drawn)
    for key in jax.random.split(jax.random.key(0), 2):
        episode, seen = world.reset(key)
        own, tau = float(episode.state.own[0]), float(episode.parameters["own_states.parameters"])
        assert 0.5 <= own <= 1.0
        assert 0.2 <= tau <= 0.4
        after = jax.jit(world.step)(episode, jnp.zeros(1))
        assert float(after[0].state.own[0]) == pytest.approx(own * np.exp(-H / tau), rel=1e-8)
        # Of a body at rest nothing else is as large as this.
        assert float(jnp.min(jnp.abs(seen - own))) < 1e-12
    hidden = Environment(wheel_disk(), HoldSpeed(0.0), sample=H, samples=5, observation=ObservedState(own=False))
    assert hidden.reset(jax.random.key(0))[1].shape == (seen.size - 1,)


@pytest.mark.thorough
def test_runs_side_by_side_compiled_or_not_have_the_closed_form():
    def last(tau):
        return simulate(wheel_disk(tau), [0.0, 1.0], state(phidot=1.0)).state.own[-1, 0]

    taus = jnp.array([0.1, 0.3, 1.0])
    for side_by_side in (jax.vmap(last), jax.jit(jax.vmap(last))):
        np.testing.assert_allclose(side_by_side(taus), -np.expm1(-1 / taus), rtol=1e-8)


IN_SINGLE = """
import jax.numpy as jnp, numpy as np
from jaxball import Ball, BallState, simulate
from jaxball.physics import OwnStates, odometer
ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), radius=0.5, own_states=OwnStates(odometer, names=("turned", "rolled")))
run = simulate(ball, [0.0, 10.0], BallState(Omega=(0.0, -3.0, 0.0), own=(0.0, 0.0)), rtol=1e-5, atol=1e-5)
assert run.ok and run.state.own.dtype == "float32"
np.testing.assert_allclose(run.state.own[-1], [-30.0, 30.0], rtol=1e-5)
"""


@pytest.mark.thorough
def test_an_odometer_counts_in_single_precision():
    printed_by("-c", IN_SINGLE, timeout=300)


def with_losses(t, state):
    return jnp.stack([state.phidot, jnp.ones_like(t), t])


def scenario(units=None, states=("length", "A s", "energy")):
    names = ("way", "charge", "heat")[: len(states)]
    own = OwnStates(with_losses, names=names, units=states)
    disk = Disk(mass=M, inertia=D, radius=R, own_states=own)
    return Scenario("", disk, DiskState(own=[0.0] * 3), np.linspace(0.0, 1.0, 3), units=units)


@pytest.mark.parametrize(
    ("units", "expected"),
    [(None, ["length", "A s", "energy"]), (Units("m", "kg", "s"), ["m", "A s", "J"])],
    ids=["dimensions", "units"],
)
def test_files_and_figures_have_their_units(units, expected):

    run = scenario(units).simulate()
    saved = run.to_dataset()
    assert list(saved.own_unit.values) == expected
    assert list(saved.own.own_unit.sel(own_state="heat").values.reshape(-1)) == expected[2:]
    assert saved.own.attrs["units" if units is None else "comment"] == "length or A s or energy"
    labels = [line.get_label() for line in run.plot("own_states").lines[:3]]
    assert labels == (["way", "charge (A s)", "heat"] if units is None else ["way (m)", "charge (A s)", "heat (J)"])


def test_one_unit_of_all_is_that_of_the_variable_and_of_the_axis():

    run = scenario(Units("m", "kg", "s"), ("power", "power", "power")).simulate()
    assert run.to_dataset().own.attrs["units"] == "W"
    assert run.plot("own_states").get_ylabel() == "own states (W)"
    alone = simulate(wheel_disk(units="rad/time"), [0.0, 1.0], state())
    assert alone.to_dataset().own.attrs["units"] == "rad/time"
    assert alone.plot("own_states").get_ylabel() == "filtered (rad)"
    plain = simulate(wheel_disk(), [0.0, 1.0], state()).to_dataset()
    assert plain.own.attrs["units"] == ""
    assert "own_unit" not in plain.coords


IN_FILE = """
format = 1
title = "An odometer"
kind = "ball"
units = { length = "m", mass = "kg", time = "s" }

[body]
mass = 1.0
inertia = [0.4, 0.4, 0.4]
radius = 1.0
gravity = 9.81

[own_states]
names = ["turned", "rolled"]
units = ["rad", ""]
function = "jaxball.physics:odometer"

[time]
start = 0.0
end = 1.0
step = 0.5
"""


def test_a_file_states_them():
    read = read_scenario(IN_FILE)
    assert read.system.own_states.units == ("rad", "")
    assert read_scenario(write_scenario(read)).system.own_states.units == ("rad", "")
    with refuses(ScenarioError, "own_states.units"):
        read_scenario(IN_FILE.replace('["rad", ""]', '["rad"]'))
    with refuses(ValueError, "units"):
        OwnStates(with_losses, names=("a", "b"), units="A")
    with refuses(TypeError, "units"):
        OwnStates(with_losses, names="a", units=3)


@pytest.mark.parametrize(
    ("of_file", "expected"),
    [(IN_FILE, ["m", "A s"]), (IN_FILE.replace("\nunits = {", "\n#"), ["length", "A s"])],
    ids=["units", "dimensions"],
)
def test_a_store_of_a_sweep_and_its_table_have_them(tmp_path, of_file, expected):
    text = of_file.replace('["rad", ""]', '["length", "A s"]')
    axes = '[[axes]]\npath = "body.mass"\nvalues = [1.0, 2.0]\n'
    study(tmp_path, axes, 'find = ["distance"]', text).run(tmp_path / "s.zarr")
    for saved in (open_store(tmp_path / "s.zarr").dataset(), open_store(tmp_path / "s.zarr").grid()):
        assert list(saved.own_unit.values) == expected
        assert saved.own.own_unit.sel(own_state="rolled") == expected[1]
        assert saved.distance.attrs["units"] == expected[0]
    schema = pyarrow.parquet.read_schema(tmp_path / "s.parquet")
    stated = [(schema.field(f"own[{k}]").metadata or {}).get(b"units") for k in range(2)]
    assert stated == ([unit.encode() for unit in expected] if of_file is IN_FILE else [None, None])
