"""Runs that roll, slide, fly and bounce side by side: each is that of simulate, and none does what no body can."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, Contact, Status, simulate
from jaxball.physics import Mode, ReleasedState, SwitchCause
from jaxball.simulation.ensemble import REDUCTIONS, simulate_ensemble

TIMES = np.linspace(0.0, 2.0, 9)
FOUND = {name: REDUCTIONS[name] for name in ("least_normal_force", "friction_needed", "energy_drift")}
# Those of several tests, so that they share a program.
BLOCK = {"lanes": 16, "chunk": 64, "reductions": FOUND, "max_steps": 4000}
G = 9.81


def random_rows(rows, seed):
    """Balls, homogeneous or with an offset, with other friction and restitution; half of them fall or are thrown up."""
    rng = np.random.default_rng(seed)
    offset = 0.1 * rng.normal(size=(rows, 3)) * (rng.random(rows) < 0.5)[:, None]
    mu = rng.uniform(0.02, 0.8, rows)
    q = rng.normal(size=(rows, 4))
    flies = rng.random(rows) < 0.5
    V = rng.normal(size=(rows, 3))
    V[:, 2] *= flies
    law = (mu, mu * rng.choice([1.0, 1.2, 1.5], rows), rng.choice([0.0, 0.3, 0.7, 0.9], rows))
    height = np.where(flies, rng.uniform(0.0, 0.5, rows), 0.0)
    start = (q / np.linalg.norm(q, axis=1)[:, None], 3 * rng.normal(size=(rows, 3)), V, height)
    return offset, law, start


def ball(offset):
    return Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), radius=1.0, gravity=G, offset=offset)


def thrown(q, Omega, V, height):
    return ReleasedState(BallState(q=q, Omega=Omega), V=V, height=height)


def contact(sliding, static, restitution):
    return Contact(friction=sliding, static_friction=static, restitution=restitution, capacity=48)


def built(rows):
    """Systems, states and laws, each array with the rows as leading axis."""
    offset, law, start = jax.tree.map(jnp.asarray, rows)
    return jax.vmap(ball)(offset), jax.vmap(thrown)(*start), jax.vmap(contact)(*law)


def ensemble(rows, **settings):
    system, state, law = built(rows)
    return simulate_ensemble(system, TIMES, state, contact=law, **(BLOCK | settings))


@functools.cache
def random_ensemble():
    rows = random_rows(128, seed=0)
    return rows, ensemble(rows)


def single(rows, k):
    offset, law, start = jax.tree.map(lambda leaf: leaf[k], rows)
    return simulate(ball(offset), TIMES, thrown(*start), contact=contact(*law))


@pytest.mark.long
def test_every_row_is_a_run_of_its_own():
    rows, many = random_ensemble()
    counts = np.asarray(many.trajectory.contact.switches.count)
    met = np.asarray(many.trajectory.contact.mode)
    # One of each kind: that flies to the end, slides to the end, rolls after a slip, bounces until it rolls.
    kinds = (
        np.all(met == Mode.FLIGHT, axis=1) & (counts > 0),
        np.all(met == Mode.SLIDING, axis=1),
        (met[:, 0] == Mode.SLIDING) & (met[:, -1] == Mode.ROLLING),
        (counts > 10) & (met[:, -1] == Mode.ROLLING),
    )
    for kind in kinds:
        k = int(np.argmax(kind))
        assert kind[k]
        one, row = single(rows, k), jax.tree.map(lambda leaf, k=k: leaf[k], many.trajectory)
        assert int(one.status) == int(row.status) == Status.SUCCESS
        # An error that is its tolerance to the last bits may be kept here and rejected there. In flight errors are near
        # rounding: where Ω differs by 1e-12 of itself, the run that flies takes 40 to 43 steps.
        flies = kind is kinds[0]
        assert abs(int(one.steps) - int(row.steps)) <= (4 if flies else 2)
        assert abs(int(one.rejected) - int(row.rejected)) <= 2
        for a, b in zip(jax.tree.leaves(one.state), jax.tree.leaves(row.state), strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=5e-8)
        for name in ("V", "height", "slip", "friction_loss", "impact_loss"):
            np.testing.assert_allclose(getattr(one.contact, name), getattr(row.contact, name), rtol=0, atol=5e-8)
        np.testing.assert_array_equal(one.contact.mode, row.contact.mode)
        ours, theirs = one.contact.switches, row.contact.switches
        assert int(ours.count) == int(theirs.count)
        for name in ("cause", "source", "target"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
        np.testing.assert_allclose(ours.times, theirs.times, rtol=0, atol=5e-8)
        np.testing.assert_allclose(ours.before.V, theirs.before.V, rtol=0, atol=5e-7)
        np.testing.assert_allclose(ours.lost, theirs.lost, rtol=0, atol=5e-7)


@pytest.mark.long
def test_a_row_takes_the_same_steps_wherever_it_is():
    """Whatever the rows beside it do, and whichever lane is its own."""
    rows, many = random_ensemble()
    order = np.random.default_rng(1).permutation(128)
    moved = ensemble(jax.tree.map(lambda leaf: leaf[order], rows)).trajectory
    for name in ("steps", "rejected", "status"):
        np.testing.assert_array_equal(getattr(moved, name), getattr(many.trajectory, name)[order])


@pytest.mark.thorough
def test_bounces_end_in_a_finite_time():
    """A ball that falls from h bounces until √(2h/g) (1 + e)/(1 − e), and is at rest then."""
    h, e = np.array([0.1, 0.2, 0.05, 0.3]), np.array([0.5, 0.3, 0.7, 0.0])
    none, upright = np.zeros((4, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (4, 1))
    law = (np.full(4, 0.3), np.full(4, 0.3), e)
    run = ensemble((none, law, (upright, none, none, h))).trajectory
    ends = np.sqrt(2 * h / G) * (1 + e) / (1 - e)
    assert np.all(ends < TIMES[-1])
    switches = run.contact.switches
    last = np.take_along_axis(np.asarray(switches.times), np.asarray(switches.count)[:, None] - 1, axis=1)[:, 0]
    np.testing.assert_allclose(last, ends, rtol=1e-5)
    np.testing.assert_array_equal(run.contact.mode[:, -1], Mode.ROLLING)
    np.testing.assert_allclose(run.contact.impact_loss[:, -1], G * h, rtol=1e-9)
    lost = (1 - e[0] ** 2) * G * h[0] * e[0] ** (2 * np.arange(3))
    np.testing.assert_allclose(switches.lost[0, :3], lost, rtol=1e-9)


@pytest.mark.thorough
def test_a_slip_ends_when_friction_has_made_it_roll():
    """A sphere that slides with V loses 2/7 of it until 2 V/(7 μ g), whatever the time at which it starts."""
    V = np.array([1.0, 2.0, 3.0])
    mu, zero, upright = np.array([0.2, 0.5, 0.1]), np.zeros((3, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))
    along = V[:, None] * np.array([1.0, 0.0, 0.0])
    system, state, law = built((zero, (mu, mu, 0 * mu), (upright, zero, along, 0 * V)))
    for start in (0.0, -1.0):
        run = simulate_ensemble(system, start + TIMES, state, contact=law, **BLOCK).trajectory
        np.testing.assert_allclose(run.contact.switches.times[:, 0], start + 2 * V / (7 * mu * G), rtol=0, atol=1e-8)
        np.testing.assert_allclose(run.contact.V[:, -1, 0], 5 / 7 * V, rtol=1e-9)
        np.testing.assert_allclose(run.contact.friction_loss[:, -1], V**2 / 7, rtol=1e-9)


@pytest.mark.slow
def test_what_rows_share_may_be_given_once():
    rows, many = random_ensemble()
    system, state, law = jax.tree.map(lambda leaf: leaf[:6], built(rows))
    first = jax.tree.map(lambda leaf: leaf[0], (system, law))
    shared = simulate_ensemble(first[0], TIMES, state, contact=first[1], in_axes=(None, 0), **BLOCK).trajectory
    assert np.all(shared.contact.law.friction == first[1].friction)
    for a, b in zip(jax.tree.leaves(shared.state), jax.tree.leaves(many.trajectory.state), strict=True):
        np.testing.assert_allclose(a[0], b[0], rtol=0, atol=5e-8)


@pytest.mark.thorough
def test_a_row_that_fails_harms_no_other():
    rows, many = random_ensemble()
    offset, law, start = jax.tree.map(np.copy, rows)
    start[3][3], law[0][5], start[2][7] = -1.0, -0.1, np.nan
    found = ensemble((offset, law, start)).trajectory
    assert np.all(found.status[np.array([3, 5, 7])] == Status.IMPOSSIBLE)
    others = np.array([k for k in range(128) if k not in (3, 5, 7)])
    for a, b in zip(
        jax.tree.leaves((found.state, found.contact.switches)),
        jax.tree.leaves((many.trajectory.state, many.trajectory.contact.switches)),
        strict=True,
    ):
        np.testing.assert_array_equal(a[others], b[others])


@pytest.mark.long
def test_derivatives_are_those_of_closed_forms():
    """A sphere with V along e1 that slides until it rolls is at 12 V²/(49 μg) + 5/7 V (t − 2V/(7μg))."""
    zero, upright = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]])

    def place(mu):
        along = jnp.array([[1.0, 0.0, 0.0]])
        system, state, law = built((zero, (mu[None], mu[None], jnp.zeros(1)), (upright, zero, along, np.zeros(1))))
        run = simulate_ensemble(system, TIMES[[0, -1]], state, contact=law, lanes=1, inside=False).trajectory
        return run.state.z[0, -1, 0], run.contact.switches.times[0, 0]

    mu = jnp.asarray(0.2)
    (z, t), slopes = jaxball.jit(lambda mu: jax.jvp(place, (mu,), (jnp.ones(()),)))(mu)
    np.testing.assert_allclose([z, t], [5 / 7 * 2 + 2 / (49 * mu * G), 2 / (7 * mu * G)], rtol=1e-8)
    # Steps are as long as the tolerances of the states allow, and those of derivatives are not looked at.
    np.testing.assert_allclose(slopes, [-2 / (49 * mu**2 * G), -2 / (7 * mu**2 * G)], rtol=2e-6)


def assert_possible(rows, many):
    """No row pulls at the plane, is in it, has more friction than the plane can give, or gains energy; all end."""
    run, offset = many.trajectory, rows[0]
    failed = np.flatnonzero(run.status != Status.SUCCESS)
    assert not failed.size, [
        (int(k), int(run.status[k]), jax.tree.map(lambda leaf, k=k: leaf[k], rows)) for k in failed
    ]
    static = np.asarray(rows[1][1])
    energy = G + np.sum(rows[2][2] ** 2, axis=1) + np.sum(rows[2][1] ** 2, axis=1)
    assert offset.shape[0] == static.size
    assert np.all(many.reductions["least_normal_force"] > -1e-6 * energy)
    assert np.all(np.asarray(run.contact.height) >= -1e-8)
    assert np.all(many.reductions["friction_needed"] <= static * (1 + 1e-6))
    assert np.all(np.abs(many.reductions["energy_drift"]) < 1e-6 * energy)
    rolling = np.asarray(run.contact.mode) == Mode.ROLLING
    assert np.all(np.asarray(run.contact.slip)[rolling] == 0)
    taken = np.diff(np.asarray(run.contact.friction_loss), axis=1), np.diff(np.asarray(run.contact.impact_loss), axis=1)
    assert all(np.all(part > -1e-8) for part in taken)


def swing(t, amplitude):
    """Up and down, three radians a unit of time."""
    return amplitude * jnp.sin(3.0 * t) * jnp.array([0.0, 0.0, 1.0])


def swinging_ball(amplitude):
    return Ball(
        mass=1.0,
        inertia=(0.4, 0.4, 0.4),
        radius=1.0,
        gravity=G,
        masses=[jaxball.PointMass(0.8, jaxball.Free(swing, amplitude))],
    )


@pytest.mark.thorough
@pytest.mark.parametrize(("speed", "needed"), [(0.0, 0.0), (9.0, 0.3)])
def test_a_body_that_lifts_needs_the_friction_that_it_had(speed, needed):
    """None where it was at rest, and μ where it slid, though N is rounding of either sign at the end of the mode."""
    systems = jax.vmap(swinging_ball)(jnp.linspace(2.55, 3.0, 8))
    states = jax.vmap(lambda V: ReleasedState(BallState(), V=V))(jnp.tile(jnp.array([speed, 0.0, 0.0]), (8, 1)))
    law = jax.vmap(lambda mu: Contact(friction=mu, static_friction=1.2 * mu))(jnp.full(8, 0.3))
    many = simulate_ensemble(systems, TIMES[:5], states, contact=law, **(BLOCK | {"lanes": 4, "chunk": 8}))
    assert np.all(many.trajectory.contact.switches.cause[:, 0] == SwitchCause.LIFTS)
    np.testing.assert_allclose(many.reductions["friction_needed"], needed, rtol=1e-12)
    np.testing.assert_allclose(many.reductions["least_normal_force"], 0, atol=1e-8)


@pytest.mark.thorough
def test_no_row_does_what_no_body_can():
    assert_possible(*random_ensemble())


@pytest.mark.slow
def test_no_row_of_many_does_what_no_body_can():
    for seed in range(1, 26):
        rows = random_rows(4000, seed)
        assert_possible(rows, ensemble(rows, lanes=64, chunk=2000))
