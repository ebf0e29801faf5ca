"""Joints that strike hard stops, rest against them and leave, against closed forms and an independent model.

The model has the energy of a disk with a pendulum in the velocities (ẋ, ẏ, φ̇, θ̇) of a body that may slip and fly,
with places from NumPy alone; impulses are Lagrange multipliers. Its Jacobian is a central difference, good to 1e-10.
"""

import diffrax
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import jaxball
from jaxball import CarriedMass, Contact, Disk, DiskState, HardStops, Hinge, JointFriction, Mechanism, Resistance
from jaxball.analysis.verify import check_laws
from jaxball.physics import ReleasedState, SwitchCause
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.differences import jacobian
from tests.support.sentences import refuses, said

HEAVY = 1e10  # a shell so heavy is a stand
G, MASS, ARM = 9.81, 0.6, 0.6
STRIKES, LEAVES = int(SwitchCause.JOINT_STRIKES), int(SwitchCause.JOINT_LEAVES_STOP)


def pendulum(drive, shell=1.0, **body):
    """A pendulum with a shifted hinge, in a disk that rolls."""
    hinge = Hinge((0.0, 1.0, 0.0), (0.0, 0.0, 0.1), drive)
    mechanism = Mechanism([hinge], [CarriedMass(MASS, (0.0, 0.0, 0.1 - ARM))])
    return Disk(mass=shell, inertia=0.5 * shell, gravity=G, mechanisms=[mechanism], **body)


def swinging(theta, thetadot=0.0, **state):
    return DiskState(theta=[theta], thetadot=[thetadot], **state)


# Closed forms.


def time_of_swing(start, end, speed=0.0):
    """The time from ``start`` to ``end`` of a pendulum that has a speed at the start."""
    with mpmath.workdps(30):
        rate = lambda x: mpmath.sqrt(speed**2 + 2 * G / ARM * (mpmath.cos(x) - mpmath.cos(start)))  # noqa: E731
        return float(abs(mpmath.quad(lambda x: 1 / rate(x), [start, 0, end] if start * end < 0 else [start, end])))


@pytest.mark.long
def test_a_pendulum_in_a_stand_strikes_as_energy_and_restitution_say():
    e, first, stop = 0.7, 1.0, -0.3
    system = pendulum(HardStops(stop, np.inf, e), HEAVY)
    run = jaxball.simulate(system, (0.0, 4.0), swinging(first), throw=True)
    switches = run.switches
    speed = np.sqrt(2 * G / ARM * (np.cos(stop) - np.cos(first)))
    time = time_of_swing(first, stop)
    for k in range(3):
        np.testing.assert_allclose(switches.times[k], time, atol=1e-8)
        np.testing.assert_array_equal(switches.after.theta[k, 0], stop)
        np.testing.assert_allclose(switches.before.thetadot[k, 0], -speed, atol=1e-8)
        np.testing.assert_allclose(switches.after.thetadot[k, 0], e * speed, atol=1e-8)
        speed *= e
        turn = np.arccos(np.cos(stop) - ARM / (2 * G) * speed**2)
        time += time_of_swing(stop, 0.0, speed) + 2 * time_of_swing(turn, 0.0) + time_of_swing(stop, 0.0, speed)
    assert (np.asarray(switches.cause[:3]) == STRIKES).all()
    assert switches.lines[0].endswith("mechanisms[0].joints[0] strikes its lower stop")


def block(drive, angle=np.pi / 4):
    """A block in a tilted tube of a stand."""
    axis = (np.cos(angle), 0.0, np.sin(angle))
    tube = jaxball.physics.mass_in_tube(MASS, axis, drive=drive)
    return Disk(mass=HEAVY, inertia=HEAVY, gravity=G, mechanisms=[tube])


def ramp(t, theta, thetadot, state, rate):
    return rate * t


@pytest.mark.long
def test_a_block_in_a_tube_bounces_to_its_rest_and_is_pulled_off():
    e, drop, rate = 0.5, 0.4, 0.9
    pull = jaxball.physics.FunctionJointForce(ramp, rate)
    weight = MASS * G * np.sin(np.pi / 4)
    run = jaxball.simulate(block(HardStops(-drop, 1.0, e) + pull), (0.0, 6.0), swinging(0.0), throw=True)
    # ẍ = −a + b t, and from a stop the next strike is where v t − a t²/2 + b t³/6 is 0, with a at the time of leaving.
    b, t, v = rate / MASS, 0.0, 0.0
    seen = run.switches
    for k in range(5):
        a = weight / MASS - b * t
        way = drop if k == 0 else 0.0
        flight = min(x.real for x in np.roots([b / 6, -a / 2, v, way]) if x.imag == 0 and x.real > 1e-9)
        t, v = t + flight, -e * (v - a * flight + b * flight**2 / 2)
        np.testing.assert_allclose(seen.times[k], t, atol=1e-9)
        np.testing.assert_allclose(seen.after.thetadot[k, 0], v, atol=1e-8)
    count = int(seen.count)
    causes, stops = np.asarray(seen.cause[:count]), np.asarray(run.history.switches.stops_after[:count, 0])
    assert (causes[:-1] == STRIKES).all()
    assert causes[-1] == LEAVES
    np.testing.assert_array_equal(stops, [0.0] * (count - 2) + [-1.0, 0.0])
    leaves = weight / rate
    np.testing.assert_allclose(seen.times[count - 1], leaves, atol=1e-9)
    np.testing.assert_array_equal(run.switches.after.theta[count - 1, 0], -drop)  # it has not moved at its stop
    np.testing.assert_allclose(run.state.theta[-1, 0], -drop + b * (6.0 - leaves) ** 3 / 6, atol=1e-8)


@pytest.mark.long
@pytest.mark.parametrize("gravity", [True, False])
def test_bounces_end_as_their_sum_says(gravity):
    """All bounces after the first strike at v take 2 v e / (a (1 − e)); without gravity a is that of a motor."""
    e, drop, a = 0.6, 0.4, 2.0
    drive = HardStops(-drop, np.inf, e) + jaxball.Motor(0.0 if gravity else -MASS * a)
    tube = jaxball.physics.mass_in_tube(MASS, (0.0, 0.0, 1.0), drive=drive)
    system = Disk(mass=HEAVY, inertia=HEAVY, gravity=a if gravity else 0.0, mechanisms=[tube])
    run = jaxball.simulate(system, (0.0, 20.0), swinging(0.0), throw=True)
    first = np.sqrt(2 * drop / a)
    last = first * (1 + 2 * e / (1 - e))
    count = int(run.switches.count)
    assert 20 < count < 40
    np.testing.assert_allclose(run.switches.times[count - 1], last, rtol=1e-5)
    assert run.history.stops[-1, 0] == -1
    assert run.state.thetadot[-1, 0] == 0
    np.testing.assert_allclose(run.history.stop_loss[-1], MASS * a * drop, rtol=1e-8)


# An independent model.

CONTACT = np.array([[1.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0]])  # (ẋ, ẏ, φ̇, θ̇) to slip and rise


def place(q):
    def turned(angle, v):
        c, s = np.cos(angle), np.sin(angle)
        return np.array([c * v[0] + s * v[1], -s * v[0] + c * v[1]])

    return q[:2] + turned(-q[2], np.array([0.0, 0.1]) + turned(q[3], np.array([0.0, -ARM])))


def mass_matrix(phi, theta):
    q, step = np.array([0.0, 0.0, phi, theta]), 1e-5 * np.eye(4)
    J = np.stack([(place(q + h) - place(q - h)) / 2e-5 for h in step], axis=1)
    return MASS * J.T @ J + np.diag([1.0, 1.0, 0.5, 0.0])


def strike_at_start(e, phi, phidot, theta, thetadot, slip=0.0, friction=None):
    """The velocities after a strike, the energy lost, and the mode."""
    start = swinging(theta, thetadot, phi=phi, phidot=phidot)
    contact = None if friction is None else Contact(friction)
    if contact is not None:
        start = ReleasedState(start, V=(-phidot + slip, 0.0, 0.0))
    run = jaxball.simulate(pendulum(HardStops(-3.0, theta, e)), (0.0, 1e-6), start, contact=contact)
    after = jax.tree.map(lambda x: x[0], run.switches.after)
    if contact is None:
        velocities = jnp.stack([-after.phidot, 0.0, after.phidot, after.thetadot[0]])
        return velocities, run.history.stop_loss[-1], 0
    body = after.body
    velocities = jnp.stack([after.V[0], after.V[2], body.phidot, body.thetadot[0]])
    return velocities, run.history.stop_loss[-1], run.switches.target[0]


@pytest.mark.long
def test_a_rolling_disk_is_struck_as_multipliers_say():
    struck = jaxball.jit(strike_at_start)
    for e, phi, phidot, theta, thetadot in [(0.0, 0.7, -1.1, 0.4, 2.0), (0.6, 2.9, 0.4, -1.0, 0.7), (1.0, -2, 3, 2, 1)]:
        A = mass_matrix(phi, theta)
        rolling = np.array([[-1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]).T
        B, before = rolling.T @ A @ rolling, np.array([phidot, thetadot])
        push = -(1 + e) * thetadot / np.linalg.inv(B)[1, 1]
        after = before + np.linalg.solve(B, [0.0, push])
        found, lost, _ = struck(e, phi, phidot, theta, thetadot)
        np.testing.assert_allclose(found[2:], after, atol=1e-9)
        np.testing.assert_allclose(found[3], -e * thetadot, rtol=1e-14)
        np.testing.assert_allclose((B @ found[2:])[0], (B @ before)[0], atol=1e-9)  # the momentum of rolling
        np.testing.assert_allclose(lost, 0.5 * before @ B @ before - 0.5 * after @ B @ after, atol=1e-9)


@pytest.mark.slow
def test_a_disk_on_its_ground_is_struck_by_impulses_within_the_law_of_friction():
    """Whatever follows: the momenta change by an impulse at the joint and one of the ground, which is in the cone."""
    struck, random, modes = jaxball.jit(strike_at_start), np.random.default_rng(0), set()
    for k in range(40):
        phi, phidot, thetadot = random.uniform(0, 6.3), random.normal(), random.uniform(0.5, 3.0)
        e, mu = random.choice([0.0, 0.5, 1.0]), random.choice([0.1, 0.5, 5.0])
        slip = random.normal() if k % 2 else 0.0
        A, before = mass_matrix(phi, 0.4), np.array([-phidot + slip, 0.0, phidot, thetadot])
        after, lost, mode = struck(e, phi, phidot, 0.4, thetadot, slip, mu)
        rows = np.vstack([[0.0, 0.0, 0.0, 1.0], CONTACT])
        impulses, _, _, _ = np.linalg.lstsq(rows.T, A @ (after - before), rcond=None)
        np.testing.assert_allclose(rows.T @ impulses, A @ (after - before), atol=2e-9)
        push, along, normal = impulses
        v, rise = CONTACT @ after
        assert push < 0
        assert normal > -1e-9
        assert abs(along) <= mu * normal + 1e-8
        np.testing.assert_allclose(lost, 0.5 * before @ A @ before - 0.5 * after @ A @ after, atol=2e-9)
        assert lost > -1e-12
        # Only where friction holds at the end what slid before may restitution be less than e.
        held = slip != 0 and mode == 0
        assert -after[3] <= e * thetadot + 1e-12 if held else abs(after[3] + e * thetadot) < 1e-12
        assert (rise > 0 and abs(normal) < 1e-9) if mode == 2 else abs(rise) < 1e-12
        if mode == 0:
            assert abs(v) < 1e-12
        if mode == 1 and v * slip > 0:
            np.testing.assert_allclose(along, -np.sign(v) * mu * normal, atol=1e-8)
        modes.add(int(mode))
    assert modes == {0, 1, 2}


# Runs.


@pytest.mark.long
def test_elastic_stops_keep_the_energy_and_plastic_ones_take_what_they_lose():
    times = np.linspace(0.0, 5.0, 6)
    run = jaxball.simulate(pendulum(HardStops(-0.6, 0.5, 1.0)), times, swinging(0.0, 4.0, phidot=0.5), throw=True)
    assert int(run.switches.count) > 5
    energy = np.asarray(run.observables.energy)
    np.testing.assert_allclose(energy, energy[0], rtol=3e-9)
    np.testing.assert_allclose(run.history.stop_loss, 0.0, atol=1e-12)
    run = jaxball.simulate(pendulum(HardStops(-0.6, 0.5, 0.3)), times, swinging(0.0, 4.0, phidot=0.5), throw=True)
    energy = np.asarray(run.observables.energy) + np.asarray(run.history.stop_loss)
    np.testing.assert_allclose(energy, energy[0], rtol=3e-9)
    assert run.history.stop_loss[-1] > 1.0
    assert "strikes on stops dissipated the energy" in repr(run)


@pytest.mark.slow
def test_enough_friction_of_the_ground_is_as_none_that_gives_way():
    """The pendulum falls on its stop, so that each strike presses the disk on its ground."""
    system, start = pendulum(HardStops(-2.5, -0.8, 0.4), 3.0), swinging(-1.6)
    rolls = jaxball.simulate(system, (0.0, 2.0), start, throw=True)
    stays = jaxball.simulate(system, (0.0, 2.0), start, contact=Contact(5.0), throw=True)
    count = int(rolls.switches.count)
    assert count == int(stays.switches.count) > 3
    np.testing.assert_allclose(stays.switches.times[:count], rolls.switches.times[:count], atol=1e-9)
    for name in ("phi", "phidot", "z", "theta", "thetadot"):
        np.testing.assert_allclose(getattr(stays.state, name), getattr(rolls.state, name), atol=1e-8)


def last(e, stop, adjoint=None):
    """The end of a run with two strikes, and rest between them if ``e`` is 0."""
    run = jaxball.simulate(pendulum(HardStops(-0.5, stop, e)), (0.0, 1.2), swinging(0.2, 2.0), adjoint=adjoint)
    return jnp.concatenate([jnp.stack([run.state.phi[-1], run.state.phidot[-1]]), run.state.theta[-1]])


@pytest.mark.slow
@pytest.mark.parametrize("adjoint", [None, diffrax.ForwardMode()], ids=["reverse", "forward"])
def test_derivatives_by_restitution_and_stop_are_those_of_differences(adjoint):
    transform = jax.jacrev if adjoint is None else jax.jacfwd
    at = jnp.array([0.6, 0.5])
    found = jaxball.jit(transform(lambda p: last(*p, adjoint)))(at)
    np.testing.assert_allclose(found, jacobian(jaxball.jit(lambda p: last(*p)), at, 1e-4), rtol=2e-6, atol=2e-6)


@pytest.mark.slow
def test_derivatives_with_a_law_of_contact_are_those_of_differences():
    """Of a run with a strike that lifts the disk, a landing, slips, bounces of the joint, and its rest."""

    def end(p):
        e, stop, mu = p
        system, start = pendulum(HardStops(-0.4, stop, e)), swinging(0.1, 2.0)
        state = jaxball.simulate(system, (0.0, 2.0), start, contact=Contact(mu)).state
        return jnp.stack([state.phi[-1], state.phidot[-1], state.theta[-1, 0]])

    at = jnp.array([0.5, 0.5, 0.4])
    found = jaxball.jit(jax.jacrev(end))(at)
    np.testing.assert_allclose(found, jacobian(jaxball.jit(end), at, 1e-5), rtol=1e-6, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [None, 0.3])
def test_stops_friction_of_joints_and_exact_resistance_in_one_body(friction):
    drive = HardStops(-0.3, 0.4, 0.5) + JointFriction(0.2, 0.3)
    system = pendulum(drive, resistance=Resistance(dry=0.02, exact=True))
    contact = None if friction is None else Contact(friction)
    start = swinging(0.0, 5.0, phidot=-1.5)
    run = jaxball.simulate(system, np.linspace(0.0, 12.0, 7), start, contact=contact, dense=True, throw=True)
    causes = set(np.asarray(run.switches.cause).tolist())
    assert STRIKES in causes
    assert int(SwitchCause.JOINT_STOPS) in causes
    assert run.history.rests[-1]
    assert run.history.sticks[-1, 0]
    lost = run.energy_losses()
    np.testing.assert_allclose(run.observables.energy + lost.total, run.observables.energy[0], atol=2e-8)
    assert float(lost.stops[-1]) > 0.5


@pytest.mark.long
@pytest.mark.parametrize("contact", [None, Contact(0.01)], ids=["rolling", "slipping"])
def test_a_joint_that_rests_against_a_stop_is_held_there_as_another_strikes(contact):
    """A block strikes the front of its tube. One that rests on the back of another tube is taken along, one at the
    front stays behind; a rolling disk has the mass m + I/r². With a law of contact it is m, because the impulse has no
    part along the normal, so that friction gives none: the disk slips.
    """
    e, striking, resting = 0.4, 0.5, 0.3
    for side in (1.0, -1.0):
        stop = HardStops(-1.0, 0.0) if side > 0 else HardStops(0.0, 1.0)
        tubes = [
            jaxball.physics.mass_in_tube(resting, (1.0, 0.0, 0.0), drive=stop + jaxball.Motor(side)),
            jaxball.physics.mass_in_tube(striking, (1.0, 0.0, 0.0), drive=HardStops(-1.0, 0.0, e)),
        ]
        system = Disk(mass=100.0, inertia=50.0, mechanisms=tubes)
        start = DiskState(theta=[0.0, 0.0], thetadot=[0.0, 1.0])
        run = jaxball.simulate(system, (0.0, 1e-3), start, contact=contact, throw=True)
        mass = (150.0 if contact is None else 100.0) + (resting if side < 0 else 0.0)
        velocity = striking * (1 + e) / (mass + striking)
        after = run.switches.after
        if contact is not None:
            np.testing.assert_allclose(after.V[0], [velocity, 0.0, 0.0], rtol=1e-12, atol=1e-15)
            after = after.body
        np.testing.assert_allclose(after.phidot[0], -velocity if contact is None else 0.0, rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(after.thetadot[0], [-velocity if side > 0 else 0.0, -e], rtol=1e-12)
        np.testing.assert_array_equal(run.switches.stops_after[0], [0.0 if side > 0 else -1.0, 0.0])


@pytest.mark.long
def test_a_block_at_its_stop_strikes_it_as_its_disk_lands():
    """An impact holds no joint, so that the block goes on as fast as it fell, 1, and strikes its stop at once."""
    tube = jaxball.physics.mass_in_tube(0.5, (0.0, 0.0, 1.0), drive=HardStops(-0.5, 0.5, 0.3))
    system = Disk(mass=1.0, inertia=0.5, mechanisms=[tube])
    start = ReleasedState(DiskState(theta=[-0.5], thetadot=[0.0]), height=0.5)
    run = jaxball.simulate(system, (0.0, 4.0), start, contact=Contact(0.3, restitution=0.5), throw=True)
    np.testing.assert_array_equal(run.switches.cause[:3], [int(SwitchCause.LANDS), STRIKES, int(SwitchCause.LANDS)])
    np.testing.assert_allclose(run.switches.times[:3], 1.0, atol=1e-9)
    # Up at 0.5 with the block at −1; the strike turns −1.5 into 0.45 and keeps the momentum, 0; then down at 0.15.
    np.testing.assert_allclose(run.switches.after.V[:3, 2], [0.5, -0.15, 0.075], atol=1e-9)
    np.testing.assert_allclose(run.switches.after.body.thetadot[:3, 0], [-1.5, 0.45, 0.225], atol=1e-9)
    np.testing.assert_allclose(run.switches.lost[:3], [0.375, 0.5 / 3 * (1 - 0.09) * 1.5**2, 0.00843750], atol=1e-9)
    assert run.history.stops[-1, 0] == -1


@pytest.mark.long
@pytest.mark.parametrize(
    ("tube", "torque", "contact", "e"),
    [
        (False, 2.3, Contact(0.05), 0.5),
        (False, 5.9, Contact(0.5, 0.6), 0.0),
        pytest.param(True, 8.0, Contact(0.76), 0.0, marks=pytest.mark.slow),
        pytest.param(True, -5.9, Contact(0.16, 0.19), 0.0, marks=pytest.mark.slow),
    ],
)
def test_a_motor_that_presses_on_a_stop_brings_its_joint_to_rest_there(tube, torque, contact, e):
    """A strike lifts the disk, and its landing takes the joint off again: both end together, in finitely many.

    The energy grows by the work of the torque, τ Δθ, less what is lost.
    """
    drive = HardStops(-0.3, 0.3, e) + jaxball.Motor(torque)
    mechanism = jaxball.physics.mass_in_tube(MASS, (1.0, 0.0, 0.0), drive=drive)
    system = Disk(mass=1.0, inertia=0.5, gravity=G, mechanisms=[mechanism]) if tube else pendulum(drive)
    run = jaxball.simulate(
        system, np.linspace(0.0, 3.0, 16), swinging(0.0), contact=contact, dense=True, max_steps=2000, throw=True
    )
    causes = np.asarray(run.switches.cause)
    assert (causes == int(SwitchCause.LANDS)).any()
    np.testing.assert_array_equal(run.history.stops[-1, 0], np.sign(torque))
    np.testing.assert_array_equal(run.state.theta[-1, 0], 0.3 * np.sign(torque))
    lost, work = run.energy_losses(), torque * run.state.theta[:, 0]
    np.testing.assert_allclose(run.observables.energy + lost.total - work, run.observables.energy[0], atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("contact", [None, Contact(0.4)], ids=["rolling", "with a law of contact"])
def test_a_ball_with_all_that_holds_keeps_its_balance_of_energy(contact):
    joints = [
        Hinge((0.0, 1.0, 0.0), drive=HardStops(-0.4, 0.5, 0.5)),
        Hinge((1.0, 0.0, 0.0), drive=HardStops(-0.3, 0.3, 0.6) + JointFriction(0.05)),
    ]
    bobs = [CarriedMass(0.5, (0.0, 0.0, -0.6)), CarriedMass(0.1, (0.1, 0.2, -0.5))]
    ball = jaxball.Ball(
        mass=1.0,
        inertia=(0.4, 0.45, 0.5),
        gravity=G,
        mechanisms=[Mechanism(joints, bobs)],
        resistance=Resistance(dry=0.01, dry_spinning=0.005, exact=True),
    )
    start = jaxball.BallState(Omega=(0.2, 0.5, 1.0), theta=[0.1, 0.05], thetadot=[2.0, 1.0])
    run = jaxball.simulate(ball, np.linspace(0.0, 3.0, 7), start, contact=contact, dense=True, throw=True)
    assert (np.asarray(run.switches.cause) == STRIKES).sum() > 1
    lost = run.energy_losses()
    # The end of a ball's slip is followed to 1e-8.
    bound = 1e-10 if contact is None else 3e-8
    np.testing.assert_allclose(run.observables.energy + lost.total, run.observables.energy[0], rtol=0, atol=bound)


@pytest.mark.slow
@pytest.mark.parametrize("contact", [None, Contact(0.4)], ids=["rolling", "with a law of contact"])
def test_the_laws_of_a_body_hold_across_strikes(contact):
    system, times = pendulum(HardStops(-0.4, 0.5, 0.5)), np.linspace(0.0, 2.0, 21)
    laws = ["energy", "momentum"] if contact is None else ["energy"]
    report = check_laws(system, times, swinging(0.1, 2.0), contact=contact, laws=laws)
    assert report.ok, str(report)
    assert all(report[law].applies for law in laws)
    assert report["energy"].residual < 1e-9


@pytest.mark.slow
def test_ensembles_and_float32_have_stops():
    stops = jnp.array([0.3, 0.4, 0.5])
    systems = jax.vmap(lambda stop: pendulum(HardStops(-0.5, stop, 0.5)))(stops)
    runs = simulate_ensemble(systems, (0.0, 1.5), swinging(0.0, 2.0), in_axes=(0, None))
    for k, stop in enumerate(stops):
        run = jaxball.simulate(pendulum(HardStops(-0.5, float(stop), 0.5)), (0.0, 1.5), swinging(0.0, 2.0))
        np.testing.assert_allclose(runs.state.theta[k], run.state.theta, atol=1e-9)
        assert int(runs[k].switches.count) == int(run.switches.count) > 0
    with jax.enable_x64(False):
        small = jaxball.simulate(
            pendulum(HardStops(-0.5, 0.5, 0.5)), (0.0, 1.5), swinging(0.0, 2.0), rtol=1e-5, atol=1e-6
        )
        assert small.state.theta.dtype == jnp.float32
    np.testing.assert_allclose(small.state.theta, runs.state.theta[2], atol=1e-3)


# Sentences.


def test_states_and_numbers_that_are_impossible_are_refused():
    (problem,) = jaxball.problems(pendulum(HardStops(-0.5, 0.5)), swinging(0.6))
    said(problem, "state.theta[0]")
    for stops, name in [
        (HardStops(0.5, 0.5), "lower"),
        (HardStops(0.0, 0.5, 1.5), "restitution"),
        (HardStops(0.0, 0.5, slowest=-1.0), "slowest"),
    ]:
        (problem,) = jaxball.problems(pendulum(stops))
        said(problem, f"mechanisms[0].joints[0].drive.{name}")
    with refuses(ValueError, "HardStops"):
        HardStops(0.0, 1.0) + HardStops(0.0, 2.0)


def test_a_stop_without_the_other_end():
    stops = HardStops(upper=0.5)
    assert stops.lower == -np.inf
    assert all(condition.holds for condition in stops.conditions("drive"))
