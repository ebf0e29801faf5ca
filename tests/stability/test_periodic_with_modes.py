"""Periodic motions of runs whose modes change: against closed forms of bouncing, impact oscillators and stick and slip,
and against differences of runs.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from scipy.linalg import expm

from jaxball import (
    Ball,
    BallState,
    Contact,
    Disk,
    DiskState,
    FunctionSchedule,
    Ground,
    HarmonicSeries,
    JointFriction,
    OnRail,
    Oscillating,
    PointMass,
    Resistance,
    Tube,
    planar_pendulum,
    simulate,
)
from jaxball.analysis.stability import periodic_motion, steady_motion
from jaxball.physics import FunctionJointForce, ReleasedState
from jaxball.physics.classical import DryFriction, LagrangianState, LagrangianSystem
from tests.support.sentences import refuses
from tests.support.struck_oscillator import struck_oscillator

G = 9.81
TABLE, RATE, E = 0.18, 7.0, 0.6  # amplitude and angular frequency of the ground, and the restitution
PERIOD = 2 * np.pi / RATE
TIGHT = {"rtol": 1e-12, "atol": 1e-12}


def oscillating(phase: float) -> Ground:
    """A ground that rises and falls as A sin(ωt + phase)."""
    path = HarmonicSeries(jnp.zeros(3), TABLE * jnp.eye(3)[2:], jnp.array([RATE]), jnp.array([phase]))
    return Ground(motion=Oscillating(path))


def strike_phase() -> float:
    """The ground's speed w where it strikes: g T/2 − w = e (g T/2 + w), because the body comes and leaves at g T/2."""
    return float(np.arccos(G * PERIOD * (1 - E) / (2 * (1 + E)) / (TABLE * RATE)))


def highest(phase: float) -> tuple[float, float]:
    """The height and its rate half a period after the strike, relative to the ground."""
    height = 2 * TABLE * np.sin(phase) + G * PERIOD**2 / 8
    return height, TABLE * RATE * np.cos(phase)


def multipliers_of_bouncing(phase: float) -> np.ndarray:
    """Those of (time, speed) from strike to strike: dt' = dt + T/u dv, dv' = −e (dv − g (dt' − dt)) + (1 + e) a dt',
    with the speed u of approach and the ground's acceleration a; their product is e².
    """
    u, a = G * PERIOD / (1 + E), -TABLE * RATE**2 * np.sin(phase)
    matrix = np.array([[1.0, PERIOD / u], [(1 + E) * a, -E + (E * G + (1 + E) * a) * PERIOD / u]])
    found = np.linalg.eigvals(matrix)
    np.testing.assert_allclose(np.prod(found), E**2)
    return found


def agree(found, expected, **tolerances):
    """Compares multipliers of which the order does not matter."""
    found, expected = (np.sort_complex(np.round(np.asarray(values, complex), 9)) for values in (found, expected))
    np.testing.assert_allclose(found, expected, **({"atol": 1e-7} | tolerances))


@pytest.mark.thorough
@pytest.mark.parametrize("side", [1, -1])
def test_a_disk_that_bounces_on_an_oscillating_ground(side):
    """It bounces in step with the ground, stable where that rises ever more slowly, unstable at the mirrored phase."""
    phase = side * strike_phase()
    height, rise = highest(phase)
    start = ReleasedState(DiskState(), V=(0.0, 0.0, rise + 0.02), height=height + 0.002)
    law = Contact(friction=0.3, restitution=E)
    disk = Disk(mass=1.0, inertia=0.4, gravity=G, ground=oscillating(phase))
    found = periodic_motion(disk, start, PERIOD, t=PERIOD / 2, contact=law)
    assert found.ok
    np.testing.assert_allclose([found.state.height, found.state.V[2]], [height, rise], atol=1e-10)
    # φ and φ̇ are neutral, and friction ends each slip at the next strike.
    agree(found.multipliers, [*multipliers_of_bouncing(phase), 1.0, 1.0, 0.0])
    assert found.stable == (side > 0)
    assert np.isneginf(found.exponents.real[-1])


@pytest.mark.long
def test_a_ball_that_bounces_on_an_oscillating_ground():
    phase = strike_phase()
    height, rise = highest(phase)
    ball = Ball(mass=1.0, inertia=(0.4, 0.5, 0.6), gravity=G, ground=oscillating(phase))
    start = ReleasedState(BallState(), V=(0.0, 0.0, rise), height=height)
    found = periodic_motion(ball, start, PERIOD, t=PERIOD / 2, contact=Contact(friction=0.3, restitution=E))
    assert found.ok
    agree(found.multipliers, [*multipliers_of_bouncing(phase), *[1.0] * 6, 0.0, 0.0])


@pytest.mark.thorough
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_bounce_without_loss_has_a_family_of_periods(friction):
    """All multipliers are 1, but that of a slip, which friction ends at the first strike."""
    start = ReleasedState(DiskState(), V=(0.0, 0.0, 0.3), height=0.5)
    disk = Disk(mass=1.0, inertia=0.4, gravity=G)
    found = periodic_motion(disk, start, 0.65, contact=Contact(friction=friction, restitution=1.0))
    assert found.ok
    top = float(found.state.height + found.state.V[2] ** 2 / (2 * G))
    np.testing.assert_allclose(found.period, 2 * np.sqrt(2 * top / G), rtol=1e-11)
    agree(found.multipliers, [1.0, 1.0, 1.0, float(friction == 0)], atol=1e-6)


@pytest.mark.thorough
def test_a_disk_that_hops_by_a_mass_moved_inside():
    """It leaves the ground with a slip, lands and sticks in each period; differences of runs that roll at both ends."""
    rate = 9.0
    swing = FunctionSchedule(lambda t, _: 0.3 * jnp.sin(rate * t))
    inside = [PointMass(1.0, OnRail(Tube(direction=(0.2, 0.0, 1.0)), swing))]
    disk = Disk(mass=1.0, inertia=0.4, gravity=G, offset=(0.0, 0.0, -0.3), masses=inside)
    law, period = Contact(friction=0.5, restitution=0.0), 2 * np.pi / rate
    found = periodic_motion(disk, DiskState(phi=0.0958, phidot=0.1784), period, contact=law)
    assert found.ok
    run = simulate(disk, [0.0, period], found.state, contact=law)
    assert int(run.contact.switches.count) == 3
    assert run.contact.switches.lost[2] > 0.1

    def after(x):
        end = simulate(disk, [0.0, period], DiskState(phi=x[0], phidot=x[1]), contact=law, **TIGHT).state
        return np.array([end.phi[-1], end.phidot[-1]])

    at = np.array([found.state.body.phi, found.state.body.phidot])
    step = 1e-5 * np.eye(2)
    derivative = np.stack([(after(at + h) - after(at - h)) / 2e-5 for h in step], axis=1)
    agree(found.multipliers, [*np.linalg.eigvals(derivative), 0.0, 0.0, 0.0], atol=1e-6)


@pytest.mark.thorough
def test_a_shaken_disk_that_dry_resistance_stops_and_turns_back():
    rate = 3.0
    path = HarmonicSeries(jnp.zeros(3), 0.5 * jnp.eye(3)[:1], jnp.array([rate]))
    ground, resistance = Ground(motion=Oscillating(path)), Resistance(dry=0.05, exact=True)
    disk = Disk(mass=1.0, inertia=0.4, offset=(0.0, 0.0, -0.2), gravity=G, resistance=resistance, ground=ground)
    found = periodic_motion(disk, DiskState(phi=0.081, phidot=1.405), 2 * np.pi / rate)
    assert found.ok
    assert found.least_normal_force > 0.9 * G

    def after(x):
        end = simulate(disk, [0.0, 2 * np.pi / rate], DiskState(phi=x[0], phidot=x[1]), **TIGHT).state
        return np.array([end.phi[-1], end.phidot[-1]])

    at = np.array([found.state.phi, found.state.phidot])
    derivative = np.stack([(after(at + h) - after(at - h)) / 2e-5 for h in 1e-5 * np.eye(2)], axis=1)
    agree(found.multipliers, np.linalg.eigvals(derivative), atol=1e-6)


def push(t, theta, thetadot, state, torque):
    return torque * jnp.sin(1.7 * t)


@pytest.mark.long
def test_a_wheel_with_a_law_of_contact_dry_resistance_and_a_joint_that_sticks():
    """In a period the joint sticks twice and the wheel turns back twice; it begins with the joint held."""
    arm = planar_pendulum(0.6, 0.7, drive=JointFriction(0.8) + FunctionJointForce(push, 2.2))
    resistance = Resistance(dry=0.03, exact=True)
    wheel = Disk(mass=1.0, inertia=0.5, gravity=G, resistance=resistance, mechanisms=[arm])
    law, period = Contact(0.12), 2 * np.pi / 1.7
    start = DiskState(phi=-0.912, phidot=-0.5026, theta=[-1.0541], thetadot=[0.0])
    found = periodic_motion(wheel, start, period, contact=law)
    assert found.ok
    vector, unravel = ravel_pytree(found.state)
    free = [0, 1, 3, 4, 5]  # φ, φ̇, θ, θ̇ and the velocity, whose slip a deviation gives; z need not return

    def after(x):
        run = simulate(wheel, [0.0, period], unravel(jnp.asarray(x)), contact=law, **TIGHT)
        body = run.state
        return np.array([body.phi[-1], body.phidot[-1], body.theta[-1, 0], body.thetadot[-1, 0], run.contact.V[-1, 0]])

    steps = 1e-6 * np.eye(vector.size)[free]
    derivative = np.stack([(after(vector + h) - after(vector - h)) / 2e-6 for h in steps], axis=1)
    agree(found.multipliers, [*np.linalg.eigvals(derivative), 0.0, 0.0], atol=1e-5)


@pytest.mark.thorough
def test_an_oscillator_that_strikes_a_wall():
    """Its monodromy in closed form: two exponentials and a saltation matrix."""
    damping, rate, e = 0.1, 2.4, 0.8
    system = struck_oscillator(damping, rate, e)
    period = 2 * np.pi / rate
    found = periodic_motion(system, LagrangianState([0.09], [0.78]), period)
    assert found.ok
    run = simulate(system, [0.0, period], found.state, **TIGHT)
    assert int(run.switches.count) == 1
    struck, v = float(run.switches.times[0]), float(run.switches.before.qdot[0, 0])
    before, after = (np.cos(rate * struck) - damping * speed for speed in (v, -e * v))
    flow = np.array([[0.0, 1.0], [-1.0, -damping]])
    saltation = np.array([[-e, 0.0], [(after + e * before) / v, -e]])
    expected = np.linalg.eigvals(expm(flow * (period - struck)) @ saltation @ expm(flow * struck))
    agree(found.multipliers, expected)
    np.testing.assert_allclose(np.prod(expected), e**2 * np.exp(-damping * period))


@pytest.mark.thorough
def test_a_block_on_a_belt():
    """Stick and slip: its period in closed form, and no deviation survives the time for which it sticks."""
    speed, kinetic, static = 0.3, 0.5, 1.0
    system = LagrangianSystem(
        lambda t, q, qdot: 0.5 * qdot[0] ** 2 - 0.5 * q[0] ** 2,
        ("x",),
        dry=DryFriction(lambda t, q, qdot: qdot[0] - speed, level=kinetic, static=static),
    )
    beyond = static - kinetic
    slip, stick = np.pi + 2 * np.arctan(speed / beyond), 2 * beyond / speed
    for start in (LagrangianState([0.3], [speed]), LagrangianState([0.3], [-0.3])):
        found = periodic_motion(system, start, 7.0)
        assert found.ok
        np.testing.assert_allclose(found.period, slip + stick, rtol=1e-9)
        assert found.multipliers.tolist() == [0.0]
        assert found.kind == "sink"


def test_what_needs_a_smooth_system_still():
    with refuses(TypeError, "system"):
        steady_motion(Disk(mass=1.0, inertia=0.4, resistance=Resistance(dry=0.05, exact=True)), DiskState())
