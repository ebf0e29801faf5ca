"""Two hundred random balls, of every combination of the laws that hold or slide, against a time-stepping scheme.

Contact with friction, exact dry resistance to rolling and spinning, and dry friction in a joint: each there or not. The
scheme is of first order, so half its step halves its distance from the exact motion, which is then about the distance
between the two of its runs. Bodies that fly are left out here: they strike by Routh's law, and the scheme by Moreau's.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxball
from jaxball import BallState, Contact, Ground, JointFriction, Resistance, Status, simulate
from jaxball.physics import FunctionJointForce, ReleasedState
from tests.support import cone_stepping as oracle

HOLDS = 1e6  # a coefficient of friction that never gives way
SYSTEMS, MOST_LEFT_OUT = 25, 6
END, STEPS = 2.0, 2000


def random_ball(seed: int, contact: bool, rest: bool, joint: bool) -> tuple[oracle.Ball, oracle.Motion]:
    rng = np.random.default_rng(seed)
    slope, level = rng.uniform(0.0, 0.12), rng.uniform(0.1, 0.6)
    ball = oracle.Ball(
        mass=1.0,
        inertia=rng.uniform(0.3, 0.5, 3),
        offset=rng.uniform(-0.1, 0.1, 3),
        pendulum=rng.uniform(0.2, 0.6),
        length=rng.uniform(0.3, 0.7),
        axes=Rotation.random(random_state=rng).as_matrix(),
        gravity=9.81 * np.array([np.sin(slope), 0.0, -np.cos(slope)]),
        torque=level * rng.uniform(0.5, 4.0 if joint else 1.5),
        frequency=rng.uniform(1.0, 3.0),
        friction=rng.uniform(0.05, 0.5) if contact else HOLDS,
        rolling=rng.uniform(0.01, 0.08) if rest else 0.0,
        spinning=rng.uniform(0.01, 0.08) if rest else 0.0,
        joint=level if joint else 0.0,
    )
    omega, slip = rng.uniform(-1.5, 1.5, 3), rng.uniform(-1.0, 1.0, 2) if contact else np.zeros(2)
    rates = [omega[1] + slip[0], -omega[0] + slip[1], 0.0, *omega, rng.uniform(-2.0, 2.0)]
    turn = Rotation.random(random_state=rng).as_matrix()
    return ball, oracle.Motion(np.array([0.0, 0.0, 1.0]), turn, rng.uniform(-2.0, 2.0), np.array(rates))


def push(t, theta, thetadot, state, torque):
    return torque[0] * jnp.sin(torque[1] * t)


def simulated(of: oracle.Ball, start: oracle.Motion, q, contact: bool, rest: bool, joint: bool):
    """Where a ball and its pendulum are at the end, whether it flew or was pulled at, and its status."""
    drive = FunctionJointForce(push, jnp.stack([of.torque, of.frequency]))
    pendulum = jaxball.planar_pendulum(
        of.pendulum,
        of.length,
        axis=of.axes[0],
        direction=of.axes[1],
        drive=JointFriction(of.joint) + drive if joint else drive,
    )
    ball = jaxball.Ball(
        mass=of.mass,
        inertia=of.inertia,
        offset=of.offset,
        gravity=9.81,
        ground=Ground(angle=jnp.arctan2(of.gravity[0], -of.gravity[2])),
        mechanisms=[pendulum],
        resistance=Resistance(dry=of.rolling, dry_spinning=of.spinning, exact=True) if rest else None,
    )
    Omega = jnp.sum(start.turn * start.rates[3:6, None], axis=0)
    state = BallState(q=q, Omega=Omega, theta=start.theta[None], thetadot=start.rates[6:])
    how = {"rtol": 1e-9, "atol": 1e-9}
    if contact:
        how["contact"] = Contact(of.friction)
        state = ReleasedState(state, V=start.rates[:3])
    run = simulate(ball, jnp.linspace(0.0, END, 101), state, **how)
    ends = jnp.concatenate([run.state.z[-1], run.state.theta[-1]])
    return ends, jnp.min(run.observables.normal_force) > 0, run.status


@pytest.mark.long
@pytest.mark.parametrize(
    ("contact", "rest", "joint"),
    list(itertools.product([False, True], repeat=3)),
    ids=lambda there: "yes" if there else "no",
)
def test_a_combination_agrees_to_first_order(contact, rest, joint):
    laws = contact, rest, joint
    number = 4 * contact + 2 * rest + joint
    cases = [random_ball(SYSTEMS * number + k, *laws) for k in range(SYSTEMS)]
    balls, starts = jax.tree.map(lambda *each: jnp.stack([jnp.asarray(x, float) for x in each]), *cases)
    x, y, z, w = np.moveaxis(np.stack([Rotation.from_matrix(start.turn).as_quat() for _, start in cases]), 1, 0)
    q = jnp.stack([w, x, y, z], axis=1)
    ends, stays, status = jax.vmap(lambda *case: simulated(*case, *laws))(balls, starts, q)
    assert np.all(status == int(Status.SUCCESS))
    stays = np.asarray(stays)
    assert np.sum(~stays) <= MOST_LEFT_OUT

    def stepped(steps):
        reached = jax.jit(jax.vmap(lambda ball, start: oracle.run(ball, start, END, steps)))(balls, starts)
        return np.concatenate([reached.place[:, :2], reached.theta[:, None]], axis=1)

    coarse, fine = (np.max(np.abs(found - ends), axis=1)[stays] for found in map(stepped, (STEPS, 2 * STEPS)))
    # The distance halves, so what is left is as large as what has gone; an event in the scheme may be a step late.
    assert np.all(fine <= 2 * np.abs(coarse - fine) + 2e-3)
    assert np.median(fine / coarse) == pytest.approx(0.5, abs=0.05)
    assert np.median(fine) < 1e-2
