"""What sensors read: against differences of positions along a run, Newton's and Euler's laws, and closed forms."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxball
from jaxball import Ball, BallState, Contact, Disk, DiskState, Ground, Turntable
from jaxball.physics import ReleasedState
from jaxball.physics.sensors import Accelerometer, Encoder, Gyroscope, Tachometer
from tests.support import newton_euler, robots
from tests.support.robot_balls import ball_of, state_of
from tests.support.robots import Carried, Pushed, Slides
from tests.support.sentences import refuses

FINE = {"rtol": 1e-13, "atol": 1e-13, "step_to_times": True}
FRAME = Rotation.from_quat([0.2, -0.5, 0.3, 0.7])
AXES = jaxball.MatrixFrame(FRAME.as_matrix())
PLACE = np.array([0.15, -0.1, 0.25])
STEP = 0.008
# Central differences of order 8 over nine points.
FIRST = np.array([3, -32, 168, -672, 0, 672, -168, 32, -3]) / 840
SECOND = np.array([-9, 128, -1008, 8064, -14350, 8064, -1008, 128, -9]) / 5040
# Of the second one, by the rounding of a place over the square of the step.
ROUNDING = 1e-13 / STEP**2


def links(robot):
    """The shell, and every link of a robot: the name in jaxball, the chain and the number of joints that move it."""
    yield None, 0, 0
    for j, chain in enumerate(robot.chains):
        for a in range(len(chain.joints)):
            yield f"mechanisms[{j}].joints[{a}]", j, a + 1


def mounted(robot):
    return {
        f"{kind.__name__} {on}": kind(**({"at": PLACE} if kind is Accelerometer else {}), on=on, frame=AXES)
        for on, *_ in links(robot)
        for kind in (Accelerometer, Gyroscope)
    }


def assert_close(found, expected, bound):
    expected = np.asarray(expected)
    np.testing.assert_allclose(found, expected, rtol=0, atol=bound * max(1.0, np.abs(expected).max()))


def case(seed):
    rng = np.random.default_rng(seed)
    robot = robots.random_robot(rng, chains=2)
    setting, moment = robots.random_setting(rng), robots.random_moment(rng, robot)
    return rng, robot, dataclasses.replace(setting, mu_r=0.0), moment


SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 5))]


@pytest.mark.long
@pytest.mark.parametrize("seed", SEEDS)
def test_readings_are_differences_of_places_in_inertial_space(seed):
    """On a tilted plane that accelerates and carries a turntable, on every link of a robot, along its run."""
    _, robot, setting, moment = case(seed)
    times = STEP * np.arange(9)
    ball = ball_of(robot, setting, moment)
    run = jaxball.simulate(ball, times, state_of(moment), **FINE, inside=False)
    found = run.measured(mounted(robot))
    theta, turns = np.asarray(run.state.theta), Rotation.from_quat(np.roll(run.state.q, -1, axis=1)).as_matrix()
    centres = 0.5 * setting.X2 * times[:, None] ** 2 + np.pad(np.asarray(run.state.z), ((0, 0), (0, 1)))
    sizes = np.cumsum([0, *(len(chain.joints) for chain in robot.chains)])
    for on, j, link in links(robot):
        chain, own = robot.chains[j], theta[:, sizes[j] : sizes[j + 1]]

        def at(place, chain=chain, own=own, link=link):
            return np.array([robots.place(chain, Carried(0.0, place, link), angles) for angles in own])

        on_link = np.stack([at(PLACE + e) - at(PLACE) for e in np.eye(3)], axis=-1)
        paths, axes = centres + np.einsum("tij,tj->ti", turns, at(PLACE)), turns @ on_link @ FRAME.as_matrix()
        acceleration, rate = SECOND @ paths / STEP**2, np.tensordot(FIRST, axes, 1) / STEP @ axes[4].T
        omega = np.array([rate[2, 1], rate[0, 2], rate[1, 0]])
        assert_close(found[f"Accelerometer {on}"][4], axes[4].T @ (acceleration - setting.g_space), 10 * ROUNDING)
        assert_close(found[f"Gyroscope {on}"][4], axes[4].T @ omega, 1e-9)


def modes(rng, robot, setting, moment):
    """The robot as it rolls, slides and flies: the moment, the contact of the oracle, the law and the start."""
    rolls = robots.centre_velocity(robot, setting, moment)
    flying = Pushed(np.zeros(3), touching=False)
    for slip, height, contact in (
        (np.zeros(3), 0.0, None),
        (np.append(rng.normal(size=2), 0.0), 0.0, Slides(0.3)),
        (rng.normal(size=3), 0.3, flying),
    ):
        start = ReleasedState(state_of(moment), rolls + slip, height)
        moved = moment if contact is None else dataclasses.replace(moment, V=rolls + slip)
        yield moved, contact, Contact(0.3, static_friction=0.3 if contact else 1e6), start


@pytest.mark.long
@pytest.mark.parametrize("seed", SEEDS)
def test_readings_are_those_of_newton_and_euler_in_every_mode(seed):
    rng, robot, setting, moment = case(100 + seed)
    setting = dataclasses.replace(setting, X2=setting.X2 + np.array([0.0, 0.0, 8.0]))  # which holds it on the plane
    ball, sensors = ball_of(robot, setting, moment), mounted(robot)
    for moved, contact, law, start in modes(rng, robot, setting, moment):
        answer = newton_euler.solve(robot, setting, moved, contact)
        run = jaxball.simulate(ball, [0.0, 1e-3], start, contact=law, inside=False)
        expected_mode = {type(None): 0, Slides: 1, Pushed: 2}[type(contact)]
        assert int(run.contact.mode[0]) == expected_mode
        found = run.measured(sensors)
        for on, j, link in links(robot):
            a, omega, turn = newton_euler.carried(robot, setting, moved, answer, j, link, PLACE)
            axes = turn @ FRAME.as_matrix()
            assert_close(found[f"Accelerometer {on}"][0], axes.T @ (a - setting.g_space), 1e-11)
            assert_close(found[f"Gyroscope {on}"][0], axes.T @ omega, 1e-12)


def on_a_sphere(theta, radius):
    a, b = theta
    return radius * jnp.stack([jnp.sin(a), jnp.cos(a) * jnp.sin(b), -jnp.cos(a) * jnp.cos(b)])[None]


def drive(t, state, p):
    return -2.0 * state.theta[:1] + state.Omega[:1]


@pytest.mark.slow
def test_masses_carry_sensors_too():
    """On rails by schedule and by law, in a mechanism of joints and in one that is a function: by their places."""
    sensors = {
        "scheduled": (0, "masses[0]"),
        "driven": (1, "masses[1]"),
        "carried": (3, "mechanisms[0].masses[1]"),
        "of a function": (4, "mechanisms[1].masses[0]"),
    }
    on_the_sphere = {"mass": [0.2], "drives": [None, jaxball.ConstantRate(0.2, 0.5)], "parameters": 0.7}
    ball = Ball(
        mass=1.0,
        inertia=(0.5, 0.6, 0.7),
        masses=[
            jaxball.PointMass(0.2, jaxball.OnRail(jaxball.Circle(0.6), jaxball.Sinusoids(0.3, [0.5], [2.0]))),
            jaxball.PointMass(0.3, jaxball.Driven(jaxball.Ellipse((0.5, 0.4), frame=jaxball.SphericalFrame(0.3, 0.2)))),
        ],
        mechanisms=[
            jaxball.physics.double_pendulum((0.2, 0.1), (0.4, 0.3)),
            jaxball.physics.FunctionMechanism(on_a_sphere, **on_the_sphere),
        ],
        law=jaxball.FunctionLaw(drive),
        ground=Ground(0.1, 0.4),
    )
    state = BallState(Omega=(0.3, 1.0, 0.2), theta=[0.4, 0.3, -0.2, 0.5], thetadot=[0.2, 0.1, 0.3, -0.4])
    run = jaxball.simulate(ball, STEP * np.arange(9), state, **FINE)
    seen = run.observables
    up, turn = np.asarray(ball.ground.up()), Rotation.from_quat(np.roll(run.state.q[4], -1))
    found = run.measured({name: Accelerometer(on=on) for name, (_, on) in sensors.items()})
    for name, (row, _) in sensors.items():
        path = np.asarray(seen.geometric_centre + seen.mass_positions_space[:, row])
        felt = turn.inv().apply(SECOND @ path / STEP**2 + up)
        axes = np.eye(3)
        if name == "carried":  # whose axes are those of its link
            axes = Rotation.from_rotvec([0.0, float(run.state.theta[4, 1] + run.state.theta[4, 2]), 0.0]).as_matrix()
        assert_close(found[name][4], axes.T @ felt, 10 * ROUNDING)
    angles = run.measured(
        {
            "scheduled": Encoder("masses[0]"),
            "rate": Tachometer("masses[0]"),
            "driven": Encoder("masses[1]"),
            **{f"joint {k}": Encoder(f"mechanisms[{k // 2}].joints[{k % 2}]") for k in range(4)},
            **{f"rate {k}": Tachometer(f"mechanisms[{k // 2}].joints[{k % 2}]") for k in range(4)},
        }
    )
    t = np.asarray(run.times)
    np.testing.assert_allclose(angles["scheduled"], 0.3 + 0.5 * np.sin(2 * t), rtol=1e-14)
    np.testing.assert_allclose(angles["rate"], np.cos(2 * t), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(angles["driven"], run.state.theta[:, 0])
    for k in range(4):
        np.testing.assert_array_equal(angles[f"joint {k}"], seen.joint_angles[:, k])
        np.testing.assert_array_equal(angles[f"rate {k}"], seen.joint_rates[:, k])


M, D, R, G = 1.3, 0.6, 0.9, 2.0


@pytest.mark.thorough
def test_at_rest_every_sensor_reads_g_upwards_and_no_turning():
    q = np.array([0.6, 0.2, -0.4, 0.3])
    q /= np.linalg.norm(q)
    ball = Ball(mass=M, inertia=(D, D, D), radius=R, gravity=G, offset=(0.0, 0.0, 0.0))
    run = jaxball.simulate(ball, [0.0, 1.0], BallState(q=q))
    found = run.measured({"felt": Accelerometer(at=PLACE, frame=AXES), "turned": Gyroscope(frame=AXES)})
    up = (Rotation.from_quat(np.roll(q, -1)) * FRAME).inv().apply([0.0, 0.0, G])
    assert_close(found["felt"], np.stack([up, up]), 1e-13)
    np.testing.assert_array_equal(found["turned"], 0.0)


@pytest.mark.thorough
def test_a_ball_that_rolls_down_a_slope_feels_less_than_g_along_it():
    """At its centre a − g is −g sin a k/(1 + k) along the slope, with k = d/(m r²), and g cos a across."""
    angle, k = 0.3, D / (M * R**2)
    ball = Ball(mass=M, inertia=(D, D, D), radius=R, gravity=G, ground=Ground(angle))
    times = np.linspace(0.0, 2.0, 5)
    run = jaxball.simulate(ball, times, **FINE)
    found = run.measured(
        {"centre": Accelerometer(), "edge": Accelerometer(at=(0.0, 0.0, 0.5 * R)), "gyro": Gyroscope()}
    )
    turned = G * np.sin(angle) / (1 + k) / R * times
    down = 0.5 * turned * times
    c, s = np.cos(down), np.sin(down)
    along, across = -k * G * np.sin(angle) / (1 + k), G * np.cos(angle)
    in_body = np.stack([c * along - s * across, 0 * c, s * along + c * across], axis=1)
    assert_close(found["centre"], in_body, 1e-11)
    rate = G * np.sin(angle) / (1 + k) / R
    at_edge = in_body + 0.5 * R * np.stack([rate + 0 * c, 0 * c, -(turned**2)], axis=1)
    assert_close(found["edge"], at_edge, 1e-11)
    assert_close(found["gyro"], np.stack([0 * c, turned, 0 * c], axis=1), 1e-11)


@pytest.mark.thorough
def test_a_turntable_that_carries_a_ball_is_felt():
    """A homogeneous ball circles on a steady turntable at W k/(1 + k), k = d/(m r²), at constant speed."""
    W, k = 0.8, D / (M * R**2)
    ball = Ball(
        mass=M, inertia=(D, D, D), radius=R, gravity=G, ground=Ground(turntable=Turntable(jaxball.ConstantRate(0.0, W)))
    )
    start = BallState(z=(1.0, 0.0))  # without rolling, it moves with the table at W × 1
    run = jaxball.simulate(ball, np.linspace(0.0, 3.0, 7), start, **FINE)
    found = np.asarray(run.measured({"centre": Accelerometer()})["centre"])
    sideways = W * 1.0 * W * k / (1 + k)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), np.hypot(G, sideways), rtol=1e-11)


@pytest.mark.thorough
def test_a_plane_that_shakes_is_felt():
    amplitude, rate = 0.3, 4.0
    shaking = jaxball.Oscillating(jaxball.HarmonicSeries((0.0, 0.0, 0.0), [(0.0, 0.0, amplitude)], [rate]))
    disk = Disk(mass=M, inertia=D, radius=R, gravity=G, ground=Ground(motion=shaking))
    run = jaxball.simulate(disk, np.linspace(0.0, 2.0, 9))
    found = run.measured({"centre": Accelerometer()})["centre"]
    expected = G - amplitude * rate**2 * np.sin(rate * np.asarray(run.times))
    np.testing.assert_allclose(found[:, 2], expected, rtol=1e-12)


def test_a_reading_is_of_what_has_acted_until_then():
    """A motor's torque jumps at t = 1, and with it φ̈: before, it is the slope of a polynomial through nine φ̇.

    At the centre of a disk that rolls the specific force is (r φ̈, g), in axes that turn.
    """
    arm = jaxball.planar_pendulum(0.3, 0.4, drive=jaxball.Motor(jaxball.PiecewiseSignal([0.0, 1.0, 2.0], [0.5, -0.7])))
    disk = Disk(mass=M, inertia=D, radius=R, gravity=G, mechanisms=[arm])
    times = np.append(0.0, 1.0 + 0.005 * np.arange(-8.0, 2.0))
    run = jaxball.simulate(disk, times, DiskState(theta=[0.7], thetadot=[0.0]), **FINE)
    felt = np.linalg.norm(run.measured({"centre": Accelerometer()})["centre"], axis=1)
    before = np.polynomial.Polynomial.fit(times[1:10], np.asarray(run.state.phidot)[1:10], 8).deriv()
    np.testing.assert_allclose(felt[9], np.hypot(R * before(1.0), G), rtol=1e-9)
    assert abs(felt[10] - felt[9]) > 1e-3  # it does jump


@pytest.mark.thorough
def test_a_failed_run_has_no_readings_where_it_did_not_come():
    """NaN after the time that the solve reached, also of what a schedule prescribes."""
    arm = jaxball.planar_pendulum(0.3, 0.4, drive=jaxball.ConstantRate(0.0, rate=1.0))
    disk = Disk(mass=M, inertia=D, mechanisms=[arm])
    run = jaxball.simulate(disk, np.linspace(0.0, 50.0, 11), DiskState(phidot=1.0), max_steps=3)
    assert not run.ok
    found = run.measured({"joint": Encoder("mechanisms[0].joints[0]"), "felt": Accelerometer()})
    known = np.isfinite(np.asarray(run.state.phi))
    assert 0 < known.sum() < len(known)
    for values in found.values():
        np.testing.assert_array_equal(np.isfinite(np.asarray(values).reshape(len(known), -1)).all(axis=1), known)


@pytest.mark.slow
def test_readings_have_derivatives():
    @jax.jit  # by the compiler of the derivatives, in the same steps
    def felt(place):
        arm = jaxball.planar_pendulum(0.3, 0.4, drive=jaxball.Spring(2.0))
        ball = Ball(mass=M, inertia=(D, D, D), mechanisms=[arm])
        run = jaxball.simulate(ball, jnp.array([0.0, 1.0]), BallState(theta=[0.7], thetadot=[0.0]))
        sensor = Accelerometer(at=place, on="mechanisms[0].joints[0]")
        return run.measured({"arm": sensor})["arm"][-1]

    place = jnp.asarray(PLACE)
    slope = jax.jit(jax.jacfwd(felt))(place)
    # Specific force on a rigid link is affine in the place.
    np.testing.assert_allclose(felt(place + 0.5) - felt(place), slope @ jnp.full(3, 0.5), rtol=0, atol=1e-12)
    many = jax.vmap(felt)(jnp.stack([place, place + 0.5]))
    np.testing.assert_allclose(many[1] - many[0], slope @ jnp.full(3, 0.5), rtol=0, atol=1e-12)


PENDULUM = Disk(mass=1.0, inertia=0.5, mechanisms=[jaxball.planar_pendulum(0.3, 0.4)])


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("sensors", "error", "named"),
    [
        ({"a": Accelerometer(on="arm")}, ValueError, "sensors['a'].on"),
        ({"a": Gyroscope(on="mechanisms[0].joint[0]")}, ValueError, "mechanisms[0].joints[0]"),
        ({"a": Encoder("masses[0]")}, ValueError, "mechanisms[0].joints[0]"),
        ({"a": Encoder("mechanisms[0].masses[0]")}, ValueError, "sensors['a'].on"),
        ([Accelerometer()], TypeError, "sensors"),
        ({"a": Accelerometer}, TypeError, "sensors['a']"),
    ],
)
def test_what_cannot_be_measured_is_told(sensors, error, named, no_type_checks):
    run = jaxball.simulate(PENDULUM, [0.0, 0.1], DiskState(theta=[0.1], thetadot=[0.0]))
    with refuses(error, named):
        run.measured(sensors)


@pytest.mark.thorough
def test_sensors_need_a_body_whose_place_is_known(no_type_checks):
    ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4))
    reduced = jaxball.simulate(ball, [0.0, 0.1], jaxball.physics.ReducedState())
    with refuses(ValueError):
        reduced.measured({"gyro": Gyroscope()})
    top = jaxball.load_scenario("heavy-top").simulate()
    with refuses(ValueError, "laws"):
        top.measured({"gyro": Gyroscope()})
    with refuses(TypeError, "frame"):
        Gyroscope(frame=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    with refuses(TypeError, "on"):
        Accelerometer(on=0)
