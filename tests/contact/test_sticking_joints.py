"""A body with a law of contact whose joints dry friction may hold, against a model of its own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, Contact, Disk, DiskState, JointFriction
from jaxball.analysis.verify import check_laws
from jaxball.physics import Mode, ReleasedState, SwitchCause
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.differences import jacobian

from .sticking_model import FLY, ROLL, Robot

G, M, R, BOB, L = 9.81, 2.0, 0.3, 0.7, 0.2
SOLID, SLOWEST, END = 0.4 * M * R**2, 0.2, 0.9


def robot(kind=Disk, joint=0.1):
    pendulum = jaxball.planar_pendulum(BOB, L, drive=JointFriction(joint))
    return kind(mass=M, inertia=SOLID if kind is Disk else (SOLID,) * 3, radius=R, gravity=G, mechanisms=[pendulum])


def start(x, kind=Disk):
    """The state of the model, x, y, φ and ψ with their rates, as one of jaxball; φ is 0."""
    joint = {"theta": -x[3:4], "thetadot": -x[7:] - x[6]}
    if kind is Disk:
        body = DiskState(z=x[0], phidot=-x[6], **joint)
    else:
        zero = jnp.zeros_like(x[0])
        body = BallState(z=jnp.stack([x[0], zero]), Omega=jnp.stack([zero, x[6], zero]), **joint)
    return ReleasedState(body, V=jnp.stack([x[4], 0 * x[5], x[5]]), height=x[1])


def random_rows(rows, seed):
    """States that slip, roll or are above the plane, with joints that slip or stick, and coefficients of friction."""
    rng = np.random.default_rng(seed)
    x = np.zeros((rows, 8))
    x[:, 1] = 0.1 * (rng.random(rows) < 0.3)
    x[:, 3], x[:, 4] = rng.uniform(-1.5, 1.5, rows), rng.uniform(-2.0, 2.0, rows)
    rolls, x[:, 6] = rng.random(rows) < 0.4, rng.uniform(-5.0, 5.0, rows)
    x[rolls, 4] = R * x[rolls, 6]
    x[:, 7] = np.where(rng.random(rows) < 0.5, -x[:, 6], rng.uniform(-12.0, 12.0, rows))
    return x, rng.uniform(0.02, 0.5, rows), rng.uniform(0.05, 0.6, rows), rng.choice([0.0, 0.5], rows)


def mode_of(contact):
    return Mode.ROLLING if contact == ROLL else Mode.FLIGHT if contact == FLY else Mode.SLIDING


@pytest.mark.thorough
@pytest.mark.parametrize(("kind", "rows"), [(Disk, 64), pytest.param(Ball, 24, marks=pytest.mark.long)])
def test_modes_are_those_of_the_model(kind, rows):
    x, mu, joint, restitution = random_rows(rows, seed=3)
    bodies = jax.vmap(lambda joint: robot(kind, joint))(jnp.asarray(joint))
    states = jax.vmap(lambda x: start(x, kind))(jnp.asarray(x))
    law = jax.vmap(lambda mu, e: Contact(mu, restitution=e, slowest=SLOWEST))(jnp.asarray(mu), jnp.asarray(restitution))
    settings = {"rtol": 1e-11, "atol": 1e-11, "lanes": 16, "chunk": 64}
    many = simulate_ensemble(bodies, (0.0, END), states, contact=law, **settings).trajectory
    assert np.all(many.status == 0)
    contact, state = jax.tree.map(np.asarray, (many.contact, many.state))
    switches, met = contact.switches, set()
    for k in range(rows):
        expected, last = Robot(M, SOLID, R, BOB, L, G, mu[k], joint[k], restitution[k], SLOWEST).run(x[k], END)
        count, modes = len(expected), [mode for _, mode in expected]
        assert switches.count[k] == count, k
        np.testing.assert_allclose(switches.times[k, :count], [t for t, _ in expected], rtol=0, atol=1e-8)
        np.testing.assert_array_equal(switches.target[k, :count], [mode_of(mode[0]) for mode in modes])
        np.testing.assert_array_equal(switches.directions_after[k, :count, 0], [mode[1] for mode in modes])
        z = np.ravel(state.z[k, -1])[0]
        np.testing.assert_allclose([z, contact.height[k, -1]], last[:2], atol=1e-8)
        np.testing.assert_allclose(contact.V[k, -1, [0, 2]], last[4:6], atol=1e-7)
        np.testing.assert_allclose(state.thetadot[k, -1, 0], -last[7] - last[6], atol=1e-6)
        met |= set(modes)
    assert len(met) > (10 if kind is Disk else 6)  # of twelve


TIMES = np.linspace(0.0, 1.2, 7)
FINE = {"rtol": 1e-11, "atol": 1e-11}


def two_joints(kind=Ball, joint=0.1, static=None):
    """A body with a spherical pendulum on two hinges, of which both may stick."""
    drives = [JointFriction(joint, static, viscous=0.01) for _ in range(2)]
    hinges = [
        jaxball.Hinge(axis=(0.0, 1.0, 0.0), drive=drives[0]),
        jaxball.Hinge(axis=(1.0, 0.0, 0.0), drive=drives[1]),
    ]
    masses = [jaxball.CarriedMass(BOB, (0.05, 0.0, -L), joint=1), jaxball.CarriedMass(0.1, (0.1, 0.05, 0.0), joint=0)]
    mechanism = jaxball.Mechanism(hinges, masses)
    inertia = SOLID if kind is Disk else (SOLID, 0.9 * SOLID, 1.1 * SOLID)
    return kind(mass=M, inertia=inertia, radius=R, gravity=G, mechanisms=[mechanism])


def assert_equal(one, other, atol):
    for name in ("z", "q", "Omega"):
        np.testing.assert_allclose(getattr(one.state, name), getattr(other.state, name), rtol=0, atol=atol)


@pytest.mark.thorough
def test_friction_that_always_holds_is_no_law_at_all():
    body, state = two_joints(static=0.14), BallState(Omega=(2.0, 5.0, 1.0), theta=[0.4, -0.3], thetadot=[0.0, 3.0])
    alone = jaxball.simulate(body, TIMES, state, **FINE)
    ruled = jaxball.simulate(body, TIMES, state, contact=Contact(100.0), **FINE)
    count = int(alone.switches.count)
    assert int(ruled.contact.switches.count) == count >= 5
    np.testing.assert_allclose(ruled.contact.switches.times[:count], alone.switches.times[:count], rtol=0, atol=1e-8)
    assert_equal(ruled, alone, 1e-9)
    np.testing.assert_array_equal(ruled.contact.directions, alone.history.directions)
    np.testing.assert_array_equal(ruled.contact.mode, Mode.ROLLING)
    assert ruled.contact.switches.lines[0].endswith("joints[1] turns back")
    assert "rolling" not in ruled.contact.switches.lines[0]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("V", "Omega", "height", "modes"),
    [
        ((1.5, 0.7, 0.0), (1.0, -2.0, 3.0), 0.0, {Mode.SLIDING, Mode.ROLLING}),
        ((1.5, 0.7, 6.0), (1.0, -2.0, 3.0), 0.1, {Mode.FLIGHT}),
        ((0.0, 0.0, 0.0), (0.0, 25.0, 0.0), 0.0, {Mode.SLIDING, Mode.FLIGHT}),
    ],
)
def test_a_joint_that_never_lets_go_is_a_rigid_body(V, Omega, height, modes):
    """The masses are then at rest in the body, at their places with all angles 0."""
    places = [(BOB, (0.05, 0.0, -L)), (0.1, (0.1, 0.05, 0.0))]
    masses = [jaxball.PointMass(mass, jaxball.Fixed(place)) for mass, place in places]
    rigid = Ball(mass=M, inertia=(SOLID, 0.9 * SOLID, 1.1 * SOLID), radius=R, gravity=G, masses=masses)
    # Until it lands, because in an impact nothing holds a joint.
    settings = {"contact": Contact(0.15), **FINE}
    of_rigid = jaxball.simulate(rigid, TIMES, ReleasedState(BallState(Omega=Omega), V=V, height=height), **settings)
    causes = of_rigid.contact.switches.cause
    lands = float(of_rigid.contact.switches.times[int(np.argmax(causes == 4))]) if 4 in causes else np.inf
    times = TIMES if lands > TIMES[-1] else np.linspace(0.0, 0.99 * lands, 7)
    sticking = BallState(Omega=Omega, theta=[0.0, 0.0], thetadot=[0.0, 0.0])
    one = jaxball.simulate(rigid, times, ReleasedState(BallState(Omega=Omega), V=V, height=height), **settings)
    other = jaxball.simulate(two_joints(joint=1e4), times, ReleasedState(sticking, V=V, height=height), **settings)
    assert set(np.unique(other.contact.mode)) == modes
    assert_equal(one, other, 1e-9)
    for name in ("V", "height", "slip", "friction_loss"):
        np.testing.assert_allclose(getattr(one.contact, name), getattr(other.contact, name), rtol=0, atol=1e-9)
    assert np.all(other.contact.sticks)
    np.testing.assert_array_equal(other.state.theta, 0.0)


@pytest.mark.thorough
def test_friction_that_always_holds_in_a_bowl_is_no_law_at_all():
    pendulum = jaxball.planar_pendulum(BOB, L, drive=JointFriction(0.1, 0.15))
    ball = Ball(mass=M, inertia=(SOLID,) * 3, radius=R, gravity=G, ground=jaxball.Bowl(2.0), mechanisms=[pendulum])
    state = BallState(z=(0.3, 0.2), Omega=(2.0, 5.0, 1.0), theta=[0.4], thetadot=[3.0])
    alone = jaxball.simulate(ball, TIMES, state, **FINE)
    ruled = jaxball.simulate(ball, TIMES, state, contact=Contact(100.0), **FINE)
    assert int(ruled.contact.switches.count) == int(alone.switches.count) > 1
    assert_equal(ruled, alone, 1e-9)


@pytest.mark.thorough
def test_the_energy_is_accounted_for():
    """By friction of joints, which is in the power, and by that of the ground and impacts, which is in the loss."""
    state = ReleasedState(
        BallState(Omega=(2.0, 9.0, 1.0), theta=[0.4, -0.3], thetadot=[0.0, 3.0]), V=(3.0, -1.5, 0.0), height=0.1
    )
    run = jaxball.simulate(two_joints(), np.linspace(0.0, 1.5, 31), state, contact=Contact(0.1), **FINE)
    switches = run.contact.switches
    causes = {int(cause) for cause in switches.cause[: int(switches.count)]}
    assert causes >= {SwitchCause.LANDS, SwitchCause.STOPS, SwitchCause.JOINT_STOPS}
    before, after = (switches.before, switches.after)
    np.testing.assert_array_equal(before.body.theta, after.body.theta)
    report = check_laws(two_joints(), np.linspace(0.0, 1.5, 31), state, contact=Contact(0.1), laws=["energy"], **FINE)
    assert report["energy"].ok


@pytest.mark.long
def test_derivatives_are_those_of_the_model():
    """By all coefficients and the speed: of the times of a slip's end and of the joint's stops, and of the end."""
    x = np.array([0.0, 0.0, 0.0, 0.4, 1.5, 0.0, -2.0, 2.0])

    def found(p):
        mu, joint, speed = p
        state = start(jnp.asarray(x).at[4].set(speed))
        run = jaxball.simulate(robot(joint=joint), (0.0, END), state, contact=Contact(mu), max_steps=512, **FINE)
        return jnp.concatenate([run.contact.switches.times[:2], run.state.z[-1:], run.state.thetadot[-1]])

    def expected(p):
        mu, joint, speed = p
        state = x.copy()
        state[4] = speed
        switches, last = Robot(M, SOLID, R, BOB, L, G, mu, joint).run(state, END)
        return np.array([*(t for t, _ in switches[:2]), last[0], -last[7] - last[6]])

    p = np.array([0.2, 0.15, 1.5])
    slopes = jacobian(expected, p, 1e-4 * p)
    np.testing.assert_allclose(found(p), expected(p), atol=1e-8)
    np.testing.assert_allclose(jaxball.jit(jax.jacrev(found))(jnp.asarray(p)), slopes, rtol=1e-5, atol=1e-6)
