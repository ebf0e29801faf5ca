"""Fits of logs, against the covariance of Cramér and Rao by differences, and against the truth over several logs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2

import jaxball
from jaxball import Disk, DiskState
from jaxball.control.estimation import Log
from jaxball.physics.sensors import Encoder, Gyroscope, Position, SensorErrors
from tests.control import robots
from tests.support.sentences import refuses

TIMES = np.linspace(0.0, 3.0, 61)
JOINT = "mechanisms[0].joints[0]"
TRUTH = DiskState(phi=0.1, phidot=-0.3, z=0.05, theta=[0.4], thetadot=[0.0])
GUESS = DiskState(theta=[0.0], thetadot=[0.0])
SPREAD = {"phi": 0.5, "phidot": np.inf, "z": 0.5, "theta": np.inf}
TORQUE = jaxball.Sinusoids(0.0, amplitude=[0.3], frequency=[2.0])
SENSORS = {
    "camera": Position(errors=SensorErrors(noise=0.01, rate=10.0, delay=0.05, missing=0.2)),
    "gyro": Gyroscope(errors=SensorErrors(noise=0.03, bias=(0.0, 0.05, 0.0))),
    "joint": Encoder(JOINT, errors=SensorErrors(noise=0.01)),
}
UNKNOWNS = ("length", "weight", "phi", "phidot", "z", "theta[0]", "gyro[0]", "gyro[1]", "gyro[2]")


def robot(values):
    pendulum = jaxball.planar_pendulum(values["weight"], values["length"], drive=jaxball.Motor(TORQUE))
    return Disk(mass=robots.MASS, inertia=robots.INERTIA, gravity=robots.GRAVITY, mechanisms=[pendulum])


def simulated(length=0.6, weight=0.5, start=TRUTH):
    return jaxball.simulate(robot({"weight": jnp.asarray(weight), "length": jnp.asarray(length)}), TIMES, start)


@pytest.fixture(scope="module")
def fits():
    """Of ten logs of one motion."""
    run, found = simulated(), []
    for seed in range(10):
        log = Log(TIMES, run.measured(SENSORS, jax.random.key(seed)))
        guesses = {"length": 0.5, "weight": 0.6}
        found.append(log.fit(robot, guesses, GUESS, SENSORS, spread=SPREAD, biases={"gyro": np.inf}))
    return found


@pytest.mark.long
def test_the_truth_is_as_far_as_the_covariance_says(fits):
    """The sum of squares of errors over ten logs is χ² with ten times as many degrees, and so are the residuals."""
    squares, sums = 0.0, 0.0
    for one in fits:
        assert one.names == UNKNOWNS
        assert one.ok
        of_state = -np.asarray(one.state.difference(TRUTH))[:4]  # θ̇ is known
        of_parameters = [one.parameters["length"] - 0.6, one.parameters["weight"] - 0.5]
        errors = np.array([*of_parameters, *of_state, *one.biases.values()])
        errors[7] -= 0.05
        squares += errors @ np.linalg.solve(one.covariance, errors)
        sums += one.chi2 / one.degrees / len(fits)
    low, high = chi2.ppf([0.001, 0.999], 10 * len(UNKNOWNS))
    assert low < squares < high
    degrees = sum(one.degrees for one in fits)
    assert abs(sums - 1) < 4 * np.sqrt(2 / degrees)


@pytest.mark.long
def test_the_covariance_is_that_of_cramer_and_rao_by_differences(fits):
    """Central differences of runs with steps of 1e-4 are good to 1e-7 of derivatives; the inverse loses some digits."""
    one = fits[0]
    values, state, there = one.parameters, one.state, {name: np.isfinite(r) for name, r in one.residuals.items()}

    def readings(x):
        fields = {"phi": x[2], "phidot": x[3], "z": x[4], "theta": [x[5]], "thetadot": [0.0]}
        exact = simulated(x[0], x[1], DiskState(**fields)).measured(
            {"camera": Position(), "gyro": Gyroscope(), "joint": Encoder(JOINT)}
        )
        late = np.roll(np.asarray(exact["camera"]), 1, axis=0)  # a delay of one time
        rows = [(late / 0.01)[there["camera"]], ((np.asarray(exact["gyro"]) + x[None, 6:9]) / 0.03)[there["gyro"]]]
        return np.concatenate([*rows, (np.asarray(exact["joint"]) / 0.01)[there["joint"]]])

    at = [values["length"], values["weight"], state.phi, state.phidot, state.z, state.theta[0], *one.biases.values()]
    at = np.asarray(at, dtype=float)
    steps = 1e-4 * np.eye(len(at))
    H = np.stack([(readings(at + d) - readings(at - d)) / 2e-4 for d in steps], axis=1)
    known = np.diag([0.0, 0.0, 4.0, 0.0, 4.0, 0.0, 0.0, 0.0, 0.0])  # 1/0.5²
    bound = np.linalg.inv(H.T @ H + known)
    size = np.sqrt(np.diag(bound))
    np.testing.assert_allclose(one.covariance / np.outer(size, size), bound / np.outer(size, size), rtol=0, atol=1e-4)


def rolling(values):
    return Disk(mass=values["mass"], inertia=0.5)


@pytest.mark.thorough
def test_what_a_log_does_not_tell_is_named_and_the_rest_is_in_closed_form():
    """A disk on a level plane rolls at a constant rate, whatever its mass: σ²/K is the variance of K readings of it.

    The search ends where a step gains 1e-9 of the sum of squares, 74: within 3e-4 deviations, 6e-6, of the mean.
    """
    gyro = {"gyro": Gyroscope(errors=SensorErrors(noise=0.1))}
    times = np.linspace(0.0, 1.0, 26)
    run = jaxball.simulate(Disk(mass=1.0, inertia=0.5), times, DiskState(phidot=-1.0))
    readings = np.array(run.measured(gyro)["gyro"])
    readings[3] = np.nan
    spread = {"phidot": np.inf, "z": np.inf}
    found = Log(times, {"gyro": readings}).fit(rolling, {"mass": 2.0}, DiskState(), gyro, spread=spread)
    assert found.unidentifiable == ("mass", "z")
    assert found.deviations == {"mass": np.inf, "phidot": pytest.approx(0.1 / 5), "z": np.inf}
    assert float(found.state.phidot) == pytest.approx(-np.nanmean(readings[:, 1]), abs=6e-6)
    assert np.isnan(found.residuals["gyro"][3]).all()
    assert (found.degrees, found.parameters["mass"]) == (3 * 25 - 1, 2.0)
    assert "the log does not tell mass" in str(found)


def test_a_start_that_is_known_needs_no_spread():
    """The speed of a disk that falls down a slope tells its inertia, and nothing else is unknown."""
    gyro = {"gyro": Gyroscope(errors=SensorErrors(noise=0.01))}
    times = np.linspace(0.0, 1.0, 26)

    def sloped(values):
        return Disk(mass=1.0, inertia=values["inertia"], ground=jaxball.Ground(angle=0.3))

    run = jaxball.simulate(sloped({"inertia": 0.5}), times, DiskState())
    log = Log(times, {"gyro": run.measured({"gyro": Gyroscope()})["gyro"]})
    found = log.fit(sloped, {"inertia": 0.7}, DiskState(), gyro)
    assert tuple(found.deviations) == ("inertia",)
    # Exact readings: what is left is where the search ends, a thousandth of a deviation.
    assert found.parameters["inertia"] == pytest.approx(0.5, abs=1e-3 * found.deviations["inertia"])


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"log": Log([0.0], {})}, "log.times"),
        ({"log": Log([0.0, 1.0, 1.0], {})}, "log.times"),
        ({"log": Log([0.0, 1.0], {})}, "log.readings"),
        ({"log": Log([0.0, 1.0], {"gyro": np.zeros((3, 3))})}, "log.readings['gyro']"),
        ({"log": Log([0.0, 1.0], {"gyro": np.zeros((2, 1))})}, "log.readings['gyro']"),
        ({"robot": Disk(mass=1.0, inertia=0.5)}, "robot"),
        ({"parameters": [1.0]}, "parameters"),
        ({"spread": 0.5}, "spread"),
        ({"spread": {"x": 1.0}}, "spread"),
        ({"spread": {}, "parameters": {}}, "parameters"),
        ({"biases": {"gyr": 1.0}}, "biases"),
        ({"prior": {"mas": 1.0}}, "prior"),
        ({"sensors": {"gyro": Gyroscope()}}, "sensors['gyro']"),
        (
            {"sensors": {"gyro": Gyroscope(errors=SensorErrors(noise=0.1, random_walk=0.1))}},
            "sensors['gyro'].errors.random_walk",
        ),
    ],
)
def test_bad_input_gets_a_sentence(change, named, no_type_checks):
    asked = {
        "log": Log([0.0, 1.0], {"gyro": np.zeros((2, 3))}),
        "robot": lambda values: Disk(mass=1.0, inertia=0.5),
        "parameters": {"mass": 1.0},
        "start": DiskState(),
        "sensors": {"gyro": Gyroscope(errors=SensorErrors(noise=0.1))},
        "spread": {"phidot": 1.0},
    } | change
    with refuses((ValueError, TypeError), named):
        asked.pop("log").fit(**asked)
