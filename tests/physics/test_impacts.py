"""Impacts: closed forms, another integration of Routh's process, Newton's and Euler's laws, inequalities."""

import collections
import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.physics.contact.impact import collision, impact
from jaxball.physics.contact.released import ReleasedState, energy_of_released, response, slip_velocity
from tests.support import newton_euler, robots, routh
from tests.support.differences import slope
from tests.support.precision import differences_need_float64
from tests.support.robot_balls import ball_of, state_of
from tests.support.robots import Pushed
from tests.support.systems import disk_state, moving_disk, stacked

E3 = np.array([0.0, 0.0, 1.0])
D, M, R = 0.6, 1.3, 0.9
K = D / (M * R**2)
collided = jax.jit(collision)
collisions = jax.jit(jax.vmap(collision))
jacobian = jax.jit(jax.jacfwd(lambda *x: collision(*x).slip, argnums=(0, 1, 2, 3)))


def contact(rng):
    """The contact matrix of a homogeneous ball, and what bodies inside it may add."""
    A = rng.uniform(0, 1) * rng.normal(size=(3, 3))
    return np.diag(1 + np.array([1, 1, 0]) / rng.uniform(0.1, 2)) + A @ A.T


def steep(rng):
    """A contact at which friction drives the body up or down."""
    s = np.array([rng.normal(), rng.normal(), rng.uniform(0.3, 1.0)])
    return np.eye(3) + 20 * np.outer(s, s) / (s @ s)


def flat(rng):
    """A contact of a disk, at which a slip may end and begin again the other way."""
    s = np.array([rng.normal(), 0.0, 0.5])
    return np.eye(3) + 5 * np.outer(s, s)


def approach(rng):
    return rng.normal(size=3) * np.array([1, 1, 0]) * 10 ** rng.uniform(-2, 1) - abs(rng.normal()) * E3


def several(make, count, seed):
    rng = np.random.default_rng(seed)
    cases = [(make(rng), approach(rng), rng.uniform(0.0, 1.0), rng.uniform(0.0, 1.0)) for _ in range(count)]
    D, slip, mu, restitution = (np.stack(column) for column in zip(*cases, strict=True))
    return D, slip * (np.array([1.0, 0.0, 1.0]) if make is flat else 1.0), mu, restitution


@pytest.mark.long
@pytest.mark.parametrize("make", [contact, steep, flat])
def test_the_process_is_that_of_another_integration(make):
    """Errors relative to the velocity before: of SciPy's integration 1e-12, and of where it ends a slip 1e-10."""
    cases = several(make, 120, 5)
    found = collisions(*map(jnp.asarray, cases))
    kinds = collections.Counter()
    for k, case in enumerate(zip(*cases, strict=True)):
        expected, kind = routh.collision(*case)
        kinds[kind] += 1
        np.testing.assert_allclose(found.slip[k], expected, rtol=0, atol=1e-9 * np.linalg.norm(case[1]), err_msg=kind)
        assert found.sticks[k] == kind.startswith("sticks")
        assert found.limited[k] == kind.endswith("limited")
    assert min(kinds["slides"], kinds["sticks"]) > 5
    assert kinds["slides, limited"] > 3 or make is not steep
    assert kinds["slides again"] > 3 or make is not flat  # a slip that is not in a plane turns round and does not end


@pytest.mark.thorough
@pytest.mark.parametrize("make", [contact, steep, flat])
def test_no_impact_pulls_or_creates_energy(make):
    """I₃ ≥ 0, |I_h| ≤ μ I₃, the normal velocity is Newton's or less, and ½ I·(v⁺ + v⁻) ≤ 0."""
    cases = several(make, 300, 6)
    _, before, mu, restitution = cases
    found = collisions(*map(jnp.asarray, cases))
    impulse, after = np.asarray(found.impulse), np.asarray(found.slip)
    scale = np.sum(before**2, axis=1)
    assert np.all(impulse[:, 2] > 0)
    assert np.all(np.hypot(impulse[:, 0], impulse[:, 1]) <= mu * impulse[:, 2] * (1 + 1e-9))
    assert np.all(np.sum(impulse * (before + after), axis=1) <= 1e-9 * scale)
    rebound, limited = -restitution * before[:, 2], np.asarray(found.limited)
    np.testing.assert_allclose(after[~limited, 2], rebound[~limited], rtol=1e-9)
    assert np.all((after[:, 2] >= 0) & (after[:, 2] <= rebound * (1 + 1e-12)))
    assert np.all(after[np.asarray(found.sticks), :2] == 0)


@pytest.mark.thorough
def test_limited_rebound_gives_back_the_work_of_compression():
    """Where friction drives the body up, Newton's e may ask for more; without friction it never does."""
    D, before, mu, restitution = several(steep, 300, 7)
    found = collisions(*map(jnp.asarray, (D, before, mu, np.ones_like(mu))))
    assert np.any(found.limited)
    frictionless = collisions(*map(jnp.asarray, (D, before, 0 * mu, restitution)))
    assert not np.any(frictionless.limited)
    np.testing.assert_allclose(frictionless.impulse[:, :2], 0.0, atol=1e-12)
    np.testing.assert_allclose(frictionless.impulse[:, 2], -(1 + restitution) * before[:, 2] / D[:, 2, 2], rtol=1e-10)


ISOTROPIC = np.diag([1 + 1 / K, 1 + 1 / K, 1.0]) / M


@pytest.mark.parametrize("share", [0.3, 1 - 1e-9, 1 + 1e-9, 3.0])
def test_homogeneous_ball_sticks_if_friction_can_stop_it(share):
    """It does where μ (1 + e) |v₃| ≥ |v_s| k/(1 + k); else I = I₃ (e3 − μσ) with I₃ = (1 + e) M |v₃|."""
    before, e = np.array([0.6, -0.8, -0.7]), 0.4
    mu = share * K / (1 + K) / ((1 + e) * 0.7)
    found = collided(jnp.asarray(ISOTROPIC), jnp.asarray(before), jnp.asarray(mu), jnp.asarray(e))
    sigma = np.array([0.6, -0.8, 0.0])
    normal = (1 + e) * M * 0.7
    stopping = M * K / (1 + K)
    assert found.sticks == (share > 1)
    np.testing.assert_allclose(found.impulse, normal * E3 - min(mu * normal, stopping) * sigma, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(found.slip, [*(max(1 - share, 0.0) * sigma[:2]), e * 0.7], atol=1e-14)


@pytest.mark.parametrize("mu", [0.1, 0.9])
def test_a_contact_that_is_hardly_coupled_is_hardly_another(mu):
    """Sliding and sticking: at each strength of a coupling, from none that is felt on."""
    before = np.array([0.6, -0.8, -0.7])
    exact, *others = (
        collided(
            *map(jnp.asarray, (ISOTROPIC + coupling * np.array([[0, 1, 1], [1, 0, -1], [1, -1, 0]]), before, mu, 0.4))
        )
        for coupling in (0.0, *10.0 ** np.arange(-17, -3))
    )
    for coupling, found in zip(10.0 ** np.arange(-17, -3), others, strict=True):
        np.testing.assert_allclose(found.slip, exact.slip, rtol=0, atol=5 * coupling + 1e-14)
        assert found.sticks == (mu > 0.5)


def test_nothing_happens_to_what_does_not_come_down():
    for normal in (0.0, 0.7):
        before = jnp.asarray([0.6, -0.8, normal])
        found = collided(jnp.asarray(ISOTROPIC), before, jnp.asarray(0.3), jnp.asarray(0.5))
        np.testing.assert_array_equal(found.slip, before)
        np.testing.assert_array_equal(found.impulse, 0.0)
        assert not found.sticks
        assert not found.limited


def test_what_comes_straight_down_sticks_or_slips_as_the_contact_does():
    """Without slip before: the impulse of no slip, D⁻¹ (0, 0, −(1 + e) v₃), if it is in the cone."""
    rng = np.random.default_rng(9)
    for _ in range(10):
        D, mu, e = contact(rng), rng.uniform(0.05, 0.5), 0.3
        found = collided(jnp.asarray(D), jnp.asarray([0.0, 0.0, -1.0]), jnp.asarray(mu), jnp.asarray(e))
        held = np.linalg.solve(D, (1 + e) * E3)
        assert found.sticks == (np.hypot(held[0], held[1]) <= mu * held[2])
        if found.sticks:
            np.testing.assert_allclose(found.impulse, held, rtol=1e-13)


def differences(function):
    return slope(function, 0.0, 1e-4)


@pytest.mark.thorough
@differences_need_float64
@pytest.mark.parametrize("make", [contact, steep, lambda rng: ISOTROPIC])
def test_derivatives(make):
    """Reverse mode against differences over four points of 1e-4, which err by 1e-7 where values do by 1e-11."""
    rng, kinds = np.random.default_rng(10), set()
    for _ in range(6):
        case = [jnp.asarray(x) for x in (make(rng), approach(rng), rng.uniform(0.1, 0.9), rng.uniform(0.1, 0.9))]
        by_D, by_slip, by_mu, by_e = jacobian(*case)

        def moved(argument, step, case=case):
            changed = list(case)
            changed[argument] = case[argument] + step
            return collided(*changed)

        states = [moved(argument, step) for argument in (1, 2, 3) for step in (-2e-4, 2e-4)]
        if len({(bool(x.sticks), bool(x.limited)) for x in states}) > 1:
            continue  # the kind of impact changes here
        kinds.add((bool(states[0].sticks), bool(states[0].limited)))
        slopes = [(by_mu, differences(lambda h: moved(2, h).slip)), (by_e, differences(lambda h: moved(3, h).slip))]
        slopes += [(by_slip[:, k], differences(lambda h, k=k: moved(1, h * jnp.eye(3)[k]).slip)) for k in range(3)]
        for i, j in ((0, 1), (0, 2), (2, 2)):
            unit = jnp.zeros((3, 3)).at[i, j].add(0.5).at[j, i].add(0.5)
            by_unit = differences(lambda h, unit=unit: moved(0, h * unit).slip)
            slopes.append(((by_D[:, i, j] + by_D[:, j, i]) / 2, by_unit))
        for found, expected in slopes:
            np.testing.assert_allclose(found, expected, atol=3e-7 * max(1.0, np.max(np.abs(expected))))
    assert len(kinds) > 1 or make is contact


@pytest.mark.thorough
def test_derivatives_are_numbers_where_nothing_slips_before():
    for slip in ((0.0, 0.0, -1.0), (0.3, 0.2, 0.0), (0.0, 0.0, 0.0)):
        found = jacobian(jnp.asarray(ISOTROPIC), jnp.asarray(slip), jnp.asarray(0.3), jnp.asarray(0.5))
        assert all(np.all(np.isfinite(x)) for x in found)


@jax.jit
def impact_loss(ball, t, state, mu, restitution):
    """The impact, and the kinetic energy before and after."""
    found = response(ball, t, state)
    done = impact(ball, t, state, found, mu, restitution)
    return (
        done,
        slip_velocity(ball, t, done.state),
        energy_of_released(ball, t, state),
        energy_of_released(ball, t, done.state),
    )


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_impulses_change_velocities_by_newton_and_eulers_laws(seed):
    """Accelerations are affine in the force of the plane, and velocities change by an impulse as they do by a force."""
    rng = np.random.default_rng(seed)
    robot = robots.random_robot(rng)
    for _ in range(3):
        setting, moment = dataclasses.replace(robots.random_setting(rng), mu_r=0.0), robots.random_moment(rng, robot)
        slip = np.append(rng.normal(size=2), -rng.uniform(0.5, 2))
        moment = dataclasses.replace(moment, V=robots.centre_velocity(robot, setting, moment) + slip)
        state = ReleasedState(state_of(moment), jnp.asarray(moment.V), jnp.zeros(()))
        ball = ball_of(robot, setting, moment).prepare()
        done, after, *_ = impact_loss(ball, jnp.zeros(()), state, jnp.asarray(0.4), jnp.asarray(0.6))
        I = np.asarray(done.collision.impulse)
        pushed, free = (newton_euler.solve(robot, setting, moment, Pushed(F)) for F in (I, 0 * I))
        changed = jax.tree.map(lambda x, y: np.asarray(x - y), done.state, state)
        for found, expected in (
            (changed.body.Omega, pushed.Omegadot - free.Omegadot),
            (changed.V, np.append(pushed.zddot - free.zddot, pushed.rise - free.rise)),
            (changed.body.thetadot, np.concatenate(pushed.thetaddot) - np.concatenate(free.thetaddot)),
        ):
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * max(1.0, np.max(np.abs(expected))))
        np.testing.assert_allclose(after, done.collision.slip, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(changed.body.q, 0.0)
        if not done.collision.limited:
            np.testing.assert_allclose(after[2], -0.6 * slip[2], rtol=1e-9)


@pytest.mark.thorough
def test_the_energy_that_an_impact_takes():
    """ΔT = ½ I·(v_s⁺ + v_s⁻) of a ball with a free pendulum; nothing is prescribed, and the plane is at rest."""
    rng = np.random.default_rng(11)
    ball = jaxball.Ball(
        mass=M, inertia=(0.5, 0.6, 0.7), offset=(0.1, -0.2, 0.1), mechanisms=[jaxball.spherical_pendulum(0.4, 0.5)]
    ).prepare()
    for _ in range(5):
        q = rng.normal(size=4)
        body = jaxball.BallState(q / np.linalg.norm(q), rng.normal(size=3), (0.3, 0.2), [0.3, -0.4], rng.normal(size=2))
        V = jnp.asarray(np.append(rng.normal(size=2), -1.0))
        case = (ReleasedState(body, V, jnp.zeros(())), jnp.asarray(0.3), jnp.asarray(0.8))
        done, _, before, after = impact_loss(ball, jnp.zeros(()), *case)
        assert done.work < 0
        np.testing.assert_allclose(after - before, done.work, atol=1e-13)


@jax.jit
@jax.vmap
def struck_disks(disk, state, mu, restitution):
    in_space = ReleasedState(state.body.in_space(), state.V, state.height)
    t = jnp.zeros(())
    return [
        impact(system, t, start, response(system, t, start), mu, restitution)
        for system, start in ((disk, state), (disk.embed(), in_space))
    ]


@pytest.mark.thorough
def test_a_disk_strikes_the_plane_as_the_ball_that_it_is_in():
    count, rng = 20, np.random.default_rng(12)
    V = jnp.asarray(rng.normal(size=(count, 3)) * np.array([1, 0, 0]) - E3)
    state = ReleasedState(stacked(disk_state, count, 13), V, jnp.zeros(count))
    flat, spatial = struck_disks(
        stacked(moving_disk, count, 14), state, jnp.linspace(0.05, 0.6, count), jnp.linspace(0, 1, count)
    )
    np.testing.assert_allclose(flat.collision.impulse, spatial.collision.impulse, rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(-flat.state.body.phidot, spatial.state.body.Omega[:, 1], rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(flat.state.V, spatial.state.V, rtol=1e-10, atol=1e-11)
    np.testing.assert_array_equal(flat.collision.sticks, spatial.collision.sticks)
    assert 0 < np.sum(flat.collision.sticks) < count
