"""Joints with dry friction that stick and slip, against closed forms.

A block on a spring, m ẍ = −k x − F sign ẋ, turns back every π √(m/k), closer to the middle by 2F/k each time, and stays
where k|x| is at most the static friction. Whatever else moves, dry friction takes F |Δθ| from the energy. Where a bound
has no reason of its own, 1e-9 is ten times the tolerance, as errors of a few steps add up.
"""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import BallState, CarriedMass, Disk, DiskState, Hinge, JointFriction, Mechanism, Slider, Spring
from jaxball.analysis.stability import steady_motion
from jaxball.analysis.verify import check_laws
from jaxball.cli import main
from jaxball.physics.dynamics.equations import accelerations
from jaxball.simulation.ensemble import simulate_ensemble
from jaxball.studies.design import DesignError
from jaxball.studies.design.optimal_control.rolling import Rolling
from tests.support.differences import jacobian
from tests.support.sentences import refuses, said

MASS, STIFFNESS, KINETIC, STATIC, START = 0.5, 8.0, 0.3, 0.45, 0.62
TIMES = np.linspace(0.0, 4.0, 9)
UP = (0.0, 0.0, 1.0)
NOW = jnp.array(0.0)


def block(kinetic=KINETIC, stiffness=STIFFNESS):
    """A block on a spring, above the contact point, so that the disk does not feel it."""
    drive = Spring(stiffness) + JointFriction(kinetic, STATIC)
    return Disk(mass=1.0, inertia=0.5, gravity=0.0, mechanisms=[jaxball.physics.mass_in_tube(MASS, UP, drive=drive)])


def moved(x):
    return DiskState(theta=[x], thetadot=[0.0])


def turns(count, kinetic=KINETIC, stiffness=STIFFNESS):
    """Where and when the block turns back for the first ``count`` times."""
    n = np.arange(1, count + 1)
    return (-1.0) ** n * (START - 2 * n * kinetic / stiffness), n * np.pi * np.sqrt(MASS / stiffness)


@pytest.mark.long
def test_a_block_on_a_spring_loses_the_same_amplitude_in_each_half_swing():
    run = jaxball.simulate(block(), TIMES, moved(START), throw=True)
    places, times = turns(5)
    np.testing.assert_allclose(run.switches.times[:5], times, atol=1e-9)
    np.testing.assert_allclose(run.switches.after.theta[:5, 0], places, atol=1e-9)
    np.testing.assert_array_equal(run.switches.after.thetadot[:5], 0.0)
    passed = np.searchsorted(times, TIMES)  # no saved time is that of a turn
    np.testing.assert_array_equal(run.history.directions[:, 0], np.where(passed % 2 == 0, -1.0, 1.0))
    within = jaxball.simulate(block(), TIMES, moved(0.9 * STATIC / STIFFNESS), throw=True)
    assert int(within.switches.count) == 0
    np.testing.assert_array_equal(within.state.theta, 0.9 * STATIC / STIFFNESS)  # not a rounding away
    assert within.history.sticks.all()


@pytest.mark.slow
def test_the_block_sticks_where_static_friction_holds_the_spring():
    kinetic = jnp.array([0.3, 0.2, 0.1])
    blocks = jax.vmap(lambda kinetic: block(kinetic, STIFFNESS))(kinetic)
    run = simulate_ensemble(blocks, (0.0, 20.0), moved(START), in_axes=(0, None))
    for row in range(3):
        places, times = turns(100, float(kinetic[row]))
        last = int(np.argmax(np.abs(places) * STIFFNESS <= STATIC))
        switches = run[row].switches
        assert int(switches.count) == last + 1
        np.testing.assert_allclose(switches.times[last], times[last], atol=1e-8)
        np.testing.assert_allclose(run.state.theta[row, -1, 0], places[last], atol=1e-8)
        assert switches.lines[-1].endswith("mechanisms[0].joints[0] sticks")


def end(kinetic, stiffness, adjoint=None):
    return jaxball.simulate(block(kinetic, stiffness), (0.0, 8.0), moved(START), adjoint=adjoint).state.theta[-1, 0]


END = (-16.0 / STIFFNESS, 16 * KINETIC / STIFFNESS**2)  # the derivatives: it sticks at the eighth stop


@pytest.mark.long
def test_derivatives_of_where_the_block_sticks():
    reverse = jaxball.jit(jax.grad(end, argnums=(0, 1)))(KINETIC, STIFFNESS)
    np.testing.assert_allclose(reverse, END, atol=1e-8)


@pytest.mark.slow
def test_derivatives_of_where_the_block_sticks_in_forward_mode():
    def along(kinetic, stiffness):
        return jax.jvp(lambda k, s: end(k, s, diffrax.ForwardMode()), (kinetic, stiffness), (1.0, 10.0))[1]

    np.testing.assert_allclose(jaxball.jit(along)(KINETIC, STIFFNESS), END[0] + 10 * END[1], atol=1e-8)


def ramp(t, theta, thetadot, state, rate):
    return rate * t


@pytest.mark.long
@pytest.mark.parametrize("static", [0.3, 0.5])
def test_a_block_under_a_growing_force_breaks_loose(static):
    """Without a drop of friction its velocity begins as t², and is 0 with its rate where the joint breaks loose."""
    kinetic, rate = 0.3, 0.4
    drive = jaxball.physics.FunctionJointForce(ramp, rate) + JointFriction(kinetic, static)
    disk = Disk(mass=1.0, inertia=0.5, gravity=0.0, mechanisms=[jaxball.physics.mass_in_tube(MASS, UP, drive=drive)])
    run = jaxball.simulate(disk, (0.0, 2.0), moved(0.0), throw=True)
    loose = static / rate
    t = 2.0 - loose
    np.testing.assert_allclose(run.switches.times[0], loose, rtol=1e-12)
    assert int(run.switches.count) == 1
    np.testing.assert_allclose(
        run.state.theta[-1, 0], ((static - kinetic) * t**2 / 2 + rate * t**3 / 6) / MASS, rtol=1e-9
    )


def robot(kinetic, static, shell=1.0, stribeck=1e9, viscous=0.0):
    """A pendulum with friction in a disk that rolls; a heavy shell is a stand."""
    friction = JointFriction(kinetic, static, viscous, stribeck)
    bob = jaxball.rigid_body_masses(1.2, (0.015, 0.03, 0.015), centre=(0.0, 0.0, -0.3))
    pendulum = Mechanism([Hinge((0.0, 1.0, 0.0), (0.0, 0.0, 0.1), friction)], bob)
    return Disk(mass=shell, inertia=0.5 * shell, gravity=9.81, mechanisms=[pendulum])


@pytest.mark.long
@pytest.mark.parametrize(("shell", "bound"), [(1.0, 1e-8), (1e10, 1e-8)], ids=["rolling", "in a stand"])
def test_friction_takes_its_work_from_the_energy(shell, bound):
    """In a stand the pendulum stops where its weight is within friction, off its lowest point."""
    system = robot(0.3, 0.45, shell, stribeck=1e-9)
    run = jaxball.simulate(system, np.linspace(0.0, 6.0, 7), DiskState(theta=[1.0], thetadot=[0.0]), throw=True)
    count = int(run.switches.count)
    states = jax.tree.map(lambda x: x[:count], run.switches.after)
    seen = jax.jit(jax.vmap(lambda t, x: jaxball.observe(system, t, x)))(run.switches.times[:count], states)
    theta = np.append(1.0, states.theta[:, 0])
    # The energy of a stand's rest is beyond the digits of its pendulum's, so take that of the pendulum at rest there.
    energy = seen.kinetic_energy + seen.potential_energy if shell == 1.0 else -1.2 * 9.81 * 0.4 * np.cos(theta[1:])
    first = -1.2 * 9.81 * (0.4 * np.cos(1.0) - 0.1) if shell == 1.0 else -1.2 * 9.81 * 0.4 * np.cos(1.0)
    np.testing.assert_allclose(energy, first - 0.3 * np.cumsum(np.abs(np.diff(theta))), atol=bound)
    if shell > 1:
        weight = 1.2 * 9.81 * 0.4 * np.sin(theta[-1])
        assert 0.1 < abs(weight) < 0.45
        assert run.history.sticks[-1, 0]
        np.testing.assert_allclose(run.observables.joint_efforts[-1, 0], -weight * np.sign(1.0) * -1.0, atol=1e-6)


@pytest.mark.long
def test_a_body_whose_joint_sticks_moves_as_a_rigid_one():
    held = robot(30.0, 30.0)
    run = jaxball.simulate(held, np.linspace(0.0, 6.0, 7), DiskState(theta=[1.0], thetadot=[0.0]), throw=True)
    places = held.mechanisms[0].places(jnp.array([1.0])).chi
    masses = [jaxball.PointMass(0.2, jaxball.Fixed(place)) for place in places]
    rigid = jaxball.simulate(Disk(mass=1.0, inertia=0.5, gravity=9.81, masses=masses), run.times, throw=True)
    np.testing.assert_allclose(run.state.phi, rigid.state.phi, atol=1e-8)
    np.testing.assert_array_equal(run.state.theta, 1.0)


@pytest.mark.slow
def test_derivatives_of_a_robot_that_sticks_and_breaks_loose():
    """Against differences over four points, whose errors are some 1e-8 of the derivative."""

    def end(x, tolerance=1e-10):
        kinetic, static, stribeck, viscous, theta = x
        start = DiskState(theta=theta[None], thetadot=[0.0])
        system = robot(kinetic, static, stribeck=stribeck, viscous=viscous)
        return jaxball.simulate(system, (0.0, 4.2), start, rtol=tolerance, atol=tolerance).state.phi[-1]

    x = jnp.array([0.3, 0.45, 0.1, 0.02, 1.0])
    expected = jacobian(jaxball.jit(lambda x: end(x, 1e-13)), x, 1e-4)
    np.testing.assert_allclose(jaxball.jit(jax.grad(end))(x), expected, rtol=1e-6, atol=1e-6)


def stacked(push, first, second):
    """A block that is pulled along a guide, and one that lies on it, each with friction."""
    joints = [Slider(UP, jaxball.Motor(push) + JointFriction(first)), Slider(UP, JointFriction(second))]
    masses = [CarriedMass(1.0, joint=0), CarriedMass(0.5, joint=1)]
    return Disk(mass=1.0, inertia=0.5, gravity=0.0, mechanisms=[Mechanism(joints, masses)])


@pytest.mark.slow
def test_a_block_on_a_block_slips_sticks_and_stops_with_it():
    """The upper one slips back at first; then both move as one; when the pull ends they come to rest together."""
    push = jaxball.PiecewiseSignal((0.0, 3.0, 9.0), ((2.0,), (0.0,)))
    start = DiskState(theta=[0.0, 0.0], thetadot=[0.0, -1.0])
    run = jaxball.simulate(stacked(push, 0.3, 0.8), np.linspace(0.0, 9.0, 10), start, inside=False, throw=True)
    lower, upper = (2.0 - 0.3 - 0.8) / 1.0, 0.8 / 0.5
    met = 1.0 / (upper - lower)
    together, braking = (2.0 - 0.3) / 1.5, 0.3 / 1.5
    speed = lower * met + together * (3.0 - met)
    rest = 3.0 + speed / braking
    assert rest > 9.0  # so the run ends before
    np.testing.assert_allclose(run.switches.times[0], met, atol=1e-9)
    assert int(run.switches.count) == 1
    np.testing.assert_allclose(run.state.thetadot[-1, 0], speed - braking * 6.0, atol=1e-9)
    np.testing.assert_array_equal(run.state.thetadot[2:, 1], 0.0)
    np.testing.assert_array_equal(run.state.theta[2:, 1], run.state.theta[2, 1])


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("push", "first", "second", "expected"),
    [
        (0.2, 0.3, 0.8, (0.0, 0.0)),  # held
        (2.0, 0.3, 0.8, (1.7 / 1.5, 0.0)),  # together
        (2.0, 0.3, 0.4, (1.3, 0.4 / 0.5 - 1.3)),  # the upper one is left behind
        (-2.0, 0.3, 0.4, (-1.3, 1.3 - 0.4 / 0.5)),
    ],
)
def test_accelerations_at_rest_follow_from_the_state(push, first, second, expected):
    """Without a solve that knows the modes, as observables need them."""
    state = DiskState(theta=[0.0, 0.0], thetadot=[0.0, 0.0])
    found = jax.jit(accelerations)(stacked(push, first, second), NOW, state)
    np.testing.assert_allclose(found.angles[2], expected, atol=1e-15)


def test_laws_of_friction():
    def at(friction, rate):
        return float(friction(NOW, NOW, jnp.array(rate), BallState()))

    stribeck = JointFriction(0.5, 0.8, 0.1, stribeck=0.2, exponent=1)
    np.testing.assert_allclose(at(stribeck, -0.4), 0.5 + 0.3 * np.exp(-2.0) + 0.04, rtol=1e-15)
    smooth = JointFriction(0.5, smoothing=0.3)
    np.testing.assert_allclose(at(smooth, 0.4), -0.5 * 0.4 / 0.5, rtol=1e-15)
    assert at(smooth, 0.0) == 0.0
    law = jaxball.physics.MajdSimaanFriction(0.1, 0.5, 0.3, 0.2, 5.0)
    assert at(law, 0.0) == 0.0
    np.testing.assert_allclose(at(law, -0.4), 0.04 + 0.5 + 0.3 * np.exp(-2.0) - 0.8 * np.exp(-10.0), rtol=1e-15)


def test_what_joints_that_stick_are_not_combined_with(no_type_checks):
    disk, start = block(), moved(START)
    with refuses(TypeError, "system"):
        steady_motion(disk, start)
    with refuses(TypeError, "dae"):
        jaxball.simulate(disk, TIMES, start, dae=True)
    with refuses(ValueError, "terms"):
        JointFriction(0.1) + Spring(1.0) + JointFriction(0.2)
    with refuses(ValueError, "exponent"):
        JointFriction(0.1, exponent=0)
    with refuses(TypeError, "exponent"):
        JointFriction(0.1, exponent=1.5)
    drive = jaxball.Motor(0.0) + JointFriction(0.1)
    pulled = Disk(mass=1.0, inertia=0.5, mechanisms=[jaxball.planar_pendulum(0.5, 0.5, drive=drive)])
    with refuses(DesignError, "system"):
        Rolling(pulled, (0.0, 1.0), {}, moved(0.0))
    (problem,) = jaxball.problems(block(0.5))
    said(problem, "mechanisms[0].joints[0].drive.terms[1].static")


@pytest.mark.slow
def test_a_run_with_sticking_obeys_the_laws_of_mechanics():
    report = check_laws(
        robot(0.3, 0.45, stribeck=0.1), np.linspace(0.0, 6.0, 61), DiskState(theta=[1.0], thetadot=[0.0])
    )
    assert report.ok
    assert {row.law for row in report.rows if row.applies} >= {"energy", "momentum", "rolling", "error", "solvers"}


@pytest.mark.long
def test_the_command_line_and_figures_show_a_run_with_sticking(tmp_path, capsys):
    """There is nothing to find between the saved times, where forces jump."""
    (tmp_path / "stuck.toml").write_text("""
        format = 1
        kind = "ball"
        body = { mass = 1.0, radius = 1.0, gravity = 1.0, inertia = [0.4, 0.4, 0.4] }
        time = { start = 0.0, end = 1.0, saves = 6 }
        initial = { Omega = [0.0, 1.0, 0.0] }
        [[mechanisms]]
        masses = [{ mass = 0.2, place = [0.0, 0.0, -0.5], joint = 0 }]
        [[mechanisms.joints]]
        kind = "hinge"
        axis = [0.0, 1.0, 0.0]
        force = { kind = "joint-friction", kinetic = 0.05, static = 0.06 }
    """)
    assert main(["simulate", f"{tmp_path / 'stuck.toml'}", "--out", f"{tmp_path / 'run.npz'}", "--no-cache"]) == 0
    assert "t = 0.6190884338: mechanisms[0].joints[0] breaks loose" in capsys.readouterr().out
    run = jaxball.load_scenario(tmp_path / "stuck.toml").simulate(dense=True)
    assert run.plot("contact_force").get_ylabel() == "contact force"
    assert run.plot("friction_ratio").lines
