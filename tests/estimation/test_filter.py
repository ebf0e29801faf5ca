"""The error-state filter: against Kalman's own where the system is linear, and by its statistics where it is not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, Disk, DiskState
from jaxball.control.estimation import ErrorStateFilter, chi2_bounds
from jaxball.physics.sensors import Accelerometer, Encoder, Gyroscope, Position, SensorErrors
from tests.support.differences import slope
from tests.support.sentences import refuses

H = 0.1
SAMPLES = 21
TIMES = H * np.arange(SAMPLES)
SPREAD = {"phi": 0.2, "phidot": 0.5, "z": 0.3}
NOISE = {"gyro": 0.2, "camera": 0.1}


def kalman(y, there, P, process):
    """Kalman's filter of a disk that rolls freely: φ̈ = 0 and ż = −φ̇, read by φ̇ and z; then Rauch's smoother.

    Written out with the covariance and its inverse, without any of jaxball's code.
    """
    A = np.array([[1.0, H, 0.0], [0.0, 1.0, 0.0], [0.0, -H, 1.0]])
    C = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])  # the gyroscope's axis is E2, about which Ω = −φ̇
    R = np.diag([NOISE["gyro"] ** 2, NOISE["camera"] ** 2])
    x, found = np.zeros(3), []
    for k in range(len(y)):
        if k:
            x, P = A @ x, A @ P @ A.T + H * np.diag(process**2)
        ahead = x, P
        own = C[there[k]]
        S = own @ P @ own.T + R[np.ix_(there[k], there[k])]
        K = P @ own.T @ np.linalg.inv(S)
        x, P = x + K @ (y[k, there[k]] - own @ x), P - K @ own @ P
        found.append((x, P, *ahead))
    smooth = [found[-1][:2]]
    for (x, P, *_), (*_, ahead, ahead_P) in zip(found[-2::-1], found[:0:-1], strict=True):
        G = P @ A.T @ np.linalg.inv(ahead_P)
        later, later_P = smooth[0]
        smooth.insert(0, (x + G @ (later - ahead), P + G @ (later_P - ahead_P) @ G.T))
    return found, smooth


@pytest.fixture(scope="module")
def free_disk():
    """A disk that rolls freely, with a gyroscope and a camera that misses some positions."""
    disk = Disk(mass=1.0, inertia=0.5)
    sensors = {
        "gyro": Gyroscope(errors=SensorErrors(noise=NOISE["gyro"])),
        "camera": Position(errors=SensorErrors(noise=NOISE["camera"], missing=0.3)),
    }
    run = jaxball.simulate(disk, TIMES, DiskState(phi=0.1, phidot=-0.7, z=0.2))
    return disk, sensors, run


@pytest.mark.long
@pytest.mark.parametrize("process", [{}, {"phidot": 0.3}, {"phi": 0.1, "phidot": 0.3, "z": 0.2}])
def test_of_a_linear_system_it_is_kalmans_filter_and_rauchs_smoother(free_disk, process):
    """To 1e-9, ten times the tolerance of a sample's solve. The two other axes of the gyroscope read noise alone."""
    disk, sensors, run = free_disk
    readings = {name: np.asarray(values) for name, values in run.measured(sensors).items()}
    known = ErrorStateFilter.of(disk, sensors, sample=H, process=process)
    estimate = known(readings, DiskState(), SPREAD)
    y = np.stack([readings["gyro"][:, 1], readings["camera"][:, 0]], axis=1)
    rates = np.array([process.get(name, 0.0) for name in SPREAD])
    found, smooth = kalman(y, np.isfinite(y), np.diag([s**2 for s in SPREAD.values()]), rates)
    for estimated, expected in ((estimate, found), (estimate.smoothed(), smooth)):
        state = np.stack([estimated.state.phi, estimated.state.phidot, estimated.state.z], axis=1)
        np.testing.assert_allclose(state, [x for x, *_ in expected], rtol=0, atol=1e-9)
        np.testing.assert_allclose(estimated.covariance, [P for _, P, *_ in expected], rtol=0, atol=1e-9)


def robot():
    """A ball with unequal moments and its centre of mass off the centre, so that readings depend on its attitude."""
    return Ball(mass=1.0, inertia=(0.3, 0.4, 0.5), offset=(0.05, 0.1, -0.2))


def sensors_of_robot(**errors):
    return {
        "gyro": Gyroscope(errors=SensorErrors(noise=0.05, **errors)),
        "acceleration": Accelerometer(at=(0.1, 0.0, 0.3), errors=SensorErrors(noise=0.1)),
        "camera": Position(at=(0.0, 0.4, 0.3), errors=SensorErrors(noise=0.05)),
    }


DEVIATIONS = {"attitude": 0.1, "Omega": 0.2, "z": 0.3}
GUESS = BallState(Omega=(0.4, -0.3, 0.2))


@pytest.fixture(scope="module")
def repeated():
    """200 runs of the robot from starts with the filter's own spread, and their estimates."""
    sensors, times = sensors_of_robot(), H * np.arange(11)
    known = ErrorStateFilter.of(robot(), sensors, sample=H, rtol=1e-8, atol=1e-8)
    size = np.repeat([0.1, 0.2, 0.3], [3, 3, 2])
    starts = jax.vmap(GUESS.retract)(np.random.default_rng(0).normal(size=(200, 8)) * size)

    @jaxball.jit
    def once(start, key):
        run = jaxball.simulate(robot(), times, start, rtol=1e-8, atol=1e-8)
        estimate = known(run.measured(sensors, key), GUESS, DEVIATIONS)
        return estimate.nees(run.state), estimate.nis, estimate.smoothed().nees(run.state)

    keys = jax.random.split(jax.random.key(5), 200)
    return [np.stack(part) for part in zip(*(once(start_of(starts, k), keys[k]) for k in range(200)), strict=True)]


def start_of(starts, k):
    return jax.tree.map(lambda leaf: leaf[k], starts)


@pytest.mark.long
def test_errors_are_as_large_as_the_filter_says(repeated):
    """The mean over 200 runs of the normalised squares is within its 95 % interval at 19 of 20 times or more."""
    for values, degrees in zip(repeated, (8, 9, 8), strict=True):
        low, high = chi2_bounds(degrees, runs=200)
        means = values.mean(axis=0)
        assert np.mean((means > low) & (means < high)) >= 0.8, means


@pytest.mark.long
def test_a_bias_is_found():
    """Within three of its standard deviations, which falls tenfold at least."""
    true = (0.05, -0.1, 0.08)
    sensors = sensors_of_robot(bias=true)
    times = H * np.arange(41)
    run = jaxball.simulate(robot(), times, GUESS)
    known = ErrorStateFilter.of(robot(), sensors, sample=H, biases={"gyro": 0.3})
    estimate = known(run.measured(sensors), GUESS, DEVIATIONS)
    for k, value in enumerate(true):
        name = f"gyro[{k}]"
        deviation = np.asarray(estimate.deviations[name])
        assert deviation[-1] < 0.1 * 0.3  # before any reading
        assert abs(float(estimate.bias[name][-1]) - value) < 3 * deviation[-1]


@pytest.mark.long
def test_what_no_sensor_tells_is_named():
    """Of a gyroscope alone: on a level plane, position and heading. A camera sees a marker, and so both."""
    sensors = sensors_of_robot()
    blind = ErrorStateFilter.of(robot(), {"gyro": sensors["gyro"]}, sample=H)
    assert blind.unobservable(GUESS, 11) == ("attitude[2]", "z[0]", "z[1]")  # where the body is upright at the start
    assert ErrorStateFilter.of(robot(), sensors, sample=H).unobservable(GUESS, 11) == ()


@pytest.mark.long
def test_a_delay_only_delays():
    """The estimate with readings that arrive late is the one with the same readings at once, until the last."""
    disk = Disk(mass=1.0, inertia=0.5)
    run = jaxball.simulate(disk, TIMES, DiskState(phidot=-0.7))
    found = {}
    for delay in (0.0, 0.3):
        sensors = {"camera": Position(errors=SensorErrors(noise=0.1, delay=delay))}
        known = ErrorStateFilter.of(disk, sensors, sample=H)
        found[delay] = known(run.measured(sensors), DiskState(), SPREAD)
    count = SAMPLES - 3
    np.testing.assert_array_equal(found[0.0].state.z[:count], found[0.3].state.z[:count])
    np.testing.assert_array_less(found[0.0].deviations["z"][count:], found[0.3].deviations["z"][count:])


@pytest.mark.thorough
def test_without_readings_it_predicts(free_disk):
    disk, sensors, run = free_disk
    readings = {name: np.full_like(values, np.nan) for name, values in run.measured(sensors).items()}
    start = DiskState(phi=0.1, phidot=-0.7, z=0.2)
    estimate = ErrorStateFilter.of(disk, sensors, sample=H)(readings, start, {"phidot": 0.5})
    np.testing.assert_allclose(estimate.state.z, run.state.z, rtol=0, atol=1e-9)  # ten times the tolerance
    np.testing.assert_allclose(estimate.deviations["z"], 0.5 * TIMES, rtol=0, atol=1e-9)
    assert np.all(np.isnan(estimate.nis))


@pytest.mark.long
def test_inputs_are_known_to_the_filter():
    """A disk with a motor on its pendulum, pushed by torques that the filter is told; without noise it is the run."""
    arm = jaxball.planar_pendulum(0.5, 0.6, drive=jaxball.Motor(0.0))
    disk = Disk(mass=1.0, inertia=0.5, mechanisms=[arm])
    joint = "mechanisms[0].joints[0]"
    u = 0.2 * np.sin(TIMES[:-1, None])
    driven = jaxball.PiecewiseSignal(TIMES, u[:, 0])
    torque = jaxball.planar_pendulum(0.5, 0.6, drive=jaxball.Motor(driven))
    start = DiskState(theta=[0.1], thetadot=[0.0])
    run = jaxball.simulate(Disk(mass=1.0, inertia=0.5, mechanisms=[torque]), TIMES, start)
    exact = SensorErrors(noise=1e-6)
    sensors = {"angle": Encoder(joint, errors=exact), "felt": Accelerometer(errors=exact)}
    known = ErrorStateFilter.of(disk, sensors, sample=H, inputs=[joint])
    readings = run.measured({"angle": Encoder(joint), "felt": Accelerometer()})
    estimate = known(readings, start, {"phi": 0.1}, u=u)
    np.testing.assert_allclose(estimate.state.theta, run.state.theta, rtol=0, atol=1e-8)
    np.testing.assert_allclose(estimate.state.phi, run.state.phi, rtol=0, atol=1e-8)


@pytest.mark.slow
def test_the_derivative_of_a_deviation_by_the_noise_of_a_sensor(free_disk):
    """Against central differences, whose error is of the order of the square of their step."""
    disk, _, run = free_disk

    def deviation(noise):
        sensors = {"camera": Position(errors=SensorErrors(noise=noise))}
        known = ErrorStateFilter.of(disk, sensors, sample=H)
        estimate = known(run.measured({"camera": Position()}), DiskState(), SPREAD)
        return estimate.deviations["z"][-1]

    noise = jnp.array(0.1)
    np.testing.assert_allclose(jax.jacfwd(deviation)(noise), slope(deviation, noise, 1e-5, points=2), rtol=1e-7)


GYRO = {"gyro": Gyroscope(errors=SensorErrors(noise=0.1))}


@pytest.mark.parametrize(
    ("change", "error", "named"),
    [
        ({"sensors": {}}, ValueError, "sensors"),
        ({"sensors": {"gyro": Gyroscope()}}, ValueError, "sensors['gyro']"),
        ({"process": {"Omga": 0.1}}, ValueError, "process"),
        ({"biases": {"gyr": 0.1}}, ValueError, "biases"),
        ({"biases": {"gyro": -0.1}}, ValueError, "biases['gyro']"),
        ({"system": None}, TypeError, "system"),
        ({"sample": 0.0}, ValueError, "sample"),
        ({"sample": -0.1}, ValueError, "sample"),
    ],
)
def test_what_makes_no_filter_is_refused(change, error, named, no_type_checks):
    given = {"system": Disk(mass=1.0, inertia=0.5), "sensors": GYRO, "sample": H} | change
    with refuses(error, named):
        ErrorStateFilter.of(**given)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("change", "error", "named"),
    [
        ({"readings": {}}, ValueError, "readings"),
        ({"readings": {"gyro": 1.0}}, TypeError, "readings['gyro']"),
        ({"readings": {"gyro": np.zeros((21, 1))}}, ValueError, "readings"),
        ({"start": BallState()}, TypeError, "DiskState"),
        ({"spread": {"phi": -1.0}}, ValueError, "spread"),
        ({"spread": 0.1}, TypeError, "spread"),
        ({"u": np.ones((3, 1))}, ValueError, "u"),
    ],
)
def test_what_does_not_fit_a_filter_is_refused(free_disk, change, error, named, no_type_checks):
    disk, _, run = free_disk
    known = ErrorStateFilter.of(disk, GYRO, sample=H)
    given = {"readings": run.measured(GYRO), "start": DiskState(), "spread": SPREAD} | change
    with refuses(error, named):
        known(**given)
