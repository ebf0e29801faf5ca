"""Contacts with one side and dry friction of systems from a Lagrangian, compared with closed forms and other models."""

import itertools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.special

import jaxball
from jaxball import Status
from jaxball.analysis.verify import check_laws
from jaxball.physics.classical import DryFriction, LagrangianState, LagrangianSystem, UnilateralContact
from jaxball.physics.classical.rows import Limits, amounts, choose
from jaxball.physics.dynamics.dry_friction import Rows
from tests.support.sentences import refuses, said

TIGHT = {"rtol": 1e-12, "atol": 1e-12}
G = 2.0


def falling(t, q, qdot):
    return 0.5 * qdot[0] ** 2 - G * q[0]


def height(t, q):
    return q[0]


def drop(x, e, end=4.0, **settings):
    """A point that is dropped on a floor from x."""
    point = LagrangianSystem(falling, ("x",), unilateral=UnilateralContact(height, restitution=e))
    return jaxball.simulate(point, jnp.linspace(0.0, end, 9), LagrangianState(jnp.stack([x])), **settings)


def bounces(x, e, count):
    """t_n = √(2 x/g) (1 + 2 Σ eᵏ)."""
    return jnp.sqrt(2 * x / G) * (1 + jnp.concatenate([jnp.zeros(1), 2 * jnp.cumsum(e ** jnp.arange(1.0, count))]))


def test_a_point_bounces_ever_less_and_then_lies():
    run = drop(1.0, 0.5, throw=True)
    # Rebounds of 0.5ⁿ of the first approach are followed down to a part of 1e-6 of it.
    np.testing.assert_allclose(run.switches.times[:20], bounces(1.0, 0.5, 20), rtol=0, atol=1e-13)
    np.testing.assert_allclose(-run.switches.before.qdot[:20, 0], 2.0 * 0.5 ** np.arange(20), rtol=1e-9)
    assert int(run.switches.count) == 20
    assert run.switches.mode_after[:20, 0].tolist() == [1.0] * 19 + [0.0]
    assert run.history.held[:, 0].tolist() == [False] * 6 + [True] * 3
    np.testing.assert_array_equal(run.state.q[-1], 0.0)
    np.testing.assert_array_equal(run.state.qdot[-1], 0.0)
    np.testing.assert_allclose(run.history.impact_loss[-1], G, rtol=0, atol=1e-11)
    weight = run.system.row_forces(jnp.array(4.0), jax.tree.map(lambda leaf: leaf[-1], run.state))
    np.testing.assert_allclose(weight, [G], rtol=1e-15)
    assert "t = 1: unilateral[0] is struck" in repr(run)


@pytest.mark.long
@pytest.mark.parametrize(
    ("differentiate", "adjoint"), [(jax.jacfwd, diffrax.ForwardMode()), (jax.jacrev, None)], ids=["forward", "reverse"]
)
def test_derivatives_go_through_strikes(differentiate, adjoint):
    """Of times of strikes, and of the state after four of them."""

    def found(x, e):
        run = drop(x, e, end=2.8, adjoint=adjoint, **TIGHT)
        return jnp.concatenate([run.switches.times[:4], run.state.q[-1], run.state.qdot[-1]])

    def expected(x, e):
        times, speed = bounces(x, e, 4), e**4 * jnp.sqrt(2 * G * x)
        since = 2.8 - times[-1]
        return jnp.append(times, jnp.stack([speed * since - G * since**2 / 2, speed - G * since]))

    numbers = jnp.array(1.0), jnp.array(0.5)
    np.testing.assert_allclose(jax.jit(found)(*numbers), expected(*numbers), rtol=0, atol=1e-12)
    both = jax.jit(differentiate(found, argnums=(0, 1)))(*numbers), jax.jacfwd(expected, argnums=(0, 1))(*numbers)
    np.testing.assert_allclose(*both, rtol=0, atol=1e-10)


def swinging(t, q, qdot):
    return 0.5 * qdot[0] ** 2 + 9.81 * jnp.cos(q[0])


def strikes(amplitude, e, count):
    """When a pendulum strikes a wall at its lowest point: sin(amplitude / 2) is eⁿ of the first after n strikes."""
    k = np.sin(amplitude / 2) * e ** np.arange(count)
    quarters = scipy.special.ellipk(k**2) / np.sqrt(9.81)
    return quarters[0] + np.concatenate([[0.0], np.cumsum(2 * quarters[1:])])


@pytest.mark.thorough
def test_a_pendulum_strikes_a_wall_at_its_lowest_point():
    wall = UnilateralContact(height, restitution=0.8)
    pendulum = LagrangianSystem(swinging, ("angle",), unilateral=wall)
    run = jaxball.simulate(pendulum, [0.0, 5.5], LagrangianState([2.0]), **TIGHT, throw=True)
    count = int(run.switches.count)
    speeds = 2 * np.sqrt(9.81) * np.sin(1.0) * 0.8 ** np.arange(count)
    assert count == 5
    np.testing.assert_allclose(run.switches.times[:count], strikes(2.0, 0.8, count), rtol=0, atol=1e-10)
    np.testing.assert_allclose(-run.switches.before.qdot[:count, 0], speeds, rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.switches.after.qdot[:count, 0], 0.8 * speeds, rtol=0, atol=1e-10)


@pytest.mark.long
def test_a_rod_in_the_plane_strikes_like_its_angle():
    """The same pendulum by the place of its mass, with the rod as a constraint: q̇ after a strike is on it, too."""

    def of_mass(t, q, qdot):
        return 0.5 * jnp.sum(qdot**2) - 9.81 * q[1]

    def rod(t, q):
        return 0.5 * (jnp.sum(q**2) - 1.0)

    pendulum = LagrangianSystem(
        of_mass, ("x", "y"), holonomic=rod, unilateral=[UnilateralContact(height, restitution=0.8)]
    )
    start = LagrangianState([np.sin(2.0), -np.cos(2.0)])
    run = jaxball.simulate(pendulum, np.linspace(0.0, 5.5, 56), start, **TIGHT, throw=True)
    np.testing.assert_allclose(run.switches.times[:5], strikes(2.0, 0.8, 5), rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.laws.position_constraints, 0.0, rtol=0, atol=1e-14)
    np.testing.assert_allclose(run.laws.velocity_constraints, 0.0, rtol=0, atol=1e-13)
    np.testing.assert_allclose(run.laws.energy + run.history.impact_loss, run.laws.energy[0], rtol=0, atol=1e-9)


@pytest.mark.thorough
def test_a_mass_that_is_pressed_against_a_stop_leaves_as_the_force_changes_its_sign():
    """With ẍ = −cos ωt it is held until ωt = π/2, and then x = (cos ωt + ωt − π/2) / ω²."""
    pressed = LagrangianSystem(
        lambda t, q, qdot, omega: 0.5 * qdot[0] ** 2 - q[0] * jnp.cos(omega * t),
        ("x",),
        unilateral=height,
        parameters=1.3,
    )
    times = np.linspace(0.0, 3.0, 13)
    run = jaxball.simulate(pressed, times, LagrangianState([0.0]), **TIGHT, throw=True)
    leaves, phase = np.pi / 2 / 1.3, 1.3 * times
    assert int(run.switches.count) == 1
    np.testing.assert_allclose(run.switches.times[0], leaves, rtol=0, atol=1e-12)
    expected = np.where(times > leaves, np.cos(phase) + phase - np.pi / 2, 0.0) / 1.3**2
    np.testing.assert_allclose(run.state.q[:, 0], expected, rtol=0, atol=1e-11)
    assert "unilateral[0] opens" in repr(run)
    # Before, the stop pushes as much as the force does.
    reactions = jax.vmap(pressed.row_forces)(jnp.asarray(times), run.state)[:, 0]
    np.testing.assert_allclose(reactions, np.where(times < leaves, np.cos(phase), 0.0), rtol=0, atol=1e-12)


# Dry friction.


def on_spring(t, q, qdot):
    return 0.5 * qdot[0] ** 2 - 0.5 * q[0] ** 2


def over_belt(t, q, qdot, speed):
    return qdot[0] - speed


def on_belt(level, static, speed):
    """A block of unit mass on a spring of unit stiffness and a belt, which carries it along."""
    friction = DryFriction(over_belt, level, static)
    return LagrangianSystem(on_spring, ("x",), dry=friction, parameters=speed)


def changes_on_belt(level, static, speed, count):
    """It sticks until x = static, slips for a time τ with tan τ/2 = −(static − level)/speed, and sticks again until
    the belt has carried it from 2 level − static to static.
    """
    slips, sticks = 2 * jnp.pi - 2 * jnp.arctan((static - level) / speed), 2 * (static - level) / speed
    turns = jnp.stack([slips, sticks] * count)[: count - 1]
    return static / speed + jnp.concatenate([jnp.zeros(1), jnp.cumsum(turns)])


@pytest.mark.thorough
def test_a_block_sticks_and_slips_on_a_belt():
    numbers = 1.0, 1.5, 0.4
    run = jaxball.simulate(on_belt(*numbers), np.linspace(0.0, 20.0, 81), LagrangianState([0.0], [0.4]), **TIGHT)
    expected = changes_on_belt(*numbers, 5)
    assert run.ok
    assert int(run.switches.count) == 5
    np.testing.assert_allclose(run.switches.times[:5], expected, rtol=0, atol=1e-10)
    assert run.switches.mode_after[:5, 0].tolist() == [-1.0, 0.0, -1.0, 0.0, -1.0]
    held = run.history.held[:, 0]
    np.testing.assert_allclose(run.state.qdot[held, 0], 0.4, rtol=0, atol=1e-16)
    np.testing.assert_allclose(run.switches.before.q[1, 0], 0.5, rtol=0, atol=1e-10)
    # While it sticks, friction is what the spring needs; while it slips, it is the level.
    forces = jax.vmap(run.system.row_forces)(run.times, run.state)[:, 0]
    np.testing.assert_allclose(forces, np.where(held, run.state.q[:, 0], 1.0), rtol=0, atol=1e-12)


@pytest.mark.long
def test_derivatives_go_through_sticking_and_slipping():
    def found(numbers):
        run = jaxball.simulate(on_belt(*numbers), [0.0, 20.0], LagrangianState(jnp.zeros(1), numbers[2:]), **TIGHT)
        return run.switches.times[:5]

    numbers = jnp.array([1.0, 1.5, 0.4])
    expected = jax.jacfwd(lambda numbers: changes_on_belt(*numbers, 5))(numbers)
    np.testing.assert_allclose(jax.jit(jax.jacrev(found))(numbers), expected, rtol=0, atol=1e-8)


M, INERTIA, AHEAD = 1.0, 0.39, 0.5


def sleigh_energy(t, q, qdot):
    across = AHEAD * qdot[2]
    square = (qdot[0] - across * jnp.sin(q[2])) ** 2 + (qdot[1] + across * jnp.cos(q[2])) ** 2
    return 0.5 * M * square + 0.5 * INERTIA * qdot[2] ** 2


def sideways(t, q, qdot):
    return qdot[1] * jnp.cos(q[2]) - qdot[0] * jnp.sin(q[2])


def slipping_sleigh(t, x, level, sign):
    """(x, y, θ, v, w, ω) of a sleigh whose blade slips sideways at w: Newton and Euler in its own axes, from
    m (v̇ − ω w − a ω²) = 0, m (ẇ + ω v + a ω̇) = f and I ω̇ = −a f, as f acts at the blade.
    """
    _, _, theta, v, w, omega = x
    f = -sign * level
    spin = -AHEAD * f / INERTIA
    along, across = omega * w + AHEAD * omega**2, f / M - omega * v - AHEAD * spin
    c, s = np.cos(theta), np.sin(theta)
    return [v * c - w * s, v * s + w * c, omega, along, across, spin]


@pytest.mark.thorough
def test_the_blade_of_a_sleigh_slips_sideways_above_a_force():
    """Until it slips, ω = 1/cosh κt and v = V tanh κt: the blade bears m I/(I + m a²) v ω. Then as of an own model."""
    level = 0.15
    sleigh = LagrangianSystem(sleigh_energy, ("x", "y", "theta"), dry=DryFriction(sideways, level))
    total = INERTIA + M * AHEAD**2
    V, kappa = np.sqrt(total / M), M * AHEAD / np.sqrt(total * M)
    # tanh/cosh is s at sinh = (1 ± √(1 − 4 s²)) / (2 s).
    share = level * total / (M * INERTIA * V)
    slips = np.arcsinh((1 - np.sqrt(1 - 4 * share**2)) / (2 * share)) / kappa
    run = jaxball.simulate(sleigh, [0.0, slips / 2, 2.0], LagrangianState([0.0] * 3, [0.0, 0.0, 1.0]), **TIGHT)
    assert run.ok
    np.testing.assert_allclose(run.switches.times[0], slips, rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.state.qdot[1, 2], 1 / np.cosh(kappa * slips / 2), rtol=0, atol=1e-11)
    q, qdot = np.asarray(run.switches.after.q[0]), np.asarray(run.switches.after.qdot[0])
    v, omega = V * np.tanh(kappa * slips), 1 / np.cosh(kappa * slips)
    np.testing.assert_allclose(np.hypot(*qdot[:2]), v, rtol=0, atol=1e-10)
    sign = float(run.switches.mode_after[0, 0])
    expected = scipy.integrate.solve_ivp(
        slipping_sleigh, (slips, 2.0), [*q, v, 0.0, omega], args=(level, sign), rtol=1e-12, atol=1e-12
    ).y[:, -1]
    assert abs(expected[4]) > 0.01
    assert np.sign(expected[4]) == sign
    np.testing.assert_allclose(run.state.q[-1], expected[:3], rtol=0, atol=1e-9)
    w = sideways(0.0, run.state.q[-1], run.state.qdot[-1])
    np.testing.assert_allclose([w, run.state.qdot[-1, 2]], expected[4:], rtol=0, atol=1e-9)


# Runs like any other.


@pytest.mark.long
def test_the_energy_of_runs_and_what_took_it_are_verified():
    """On a belt that drives it, and with strikes of a wall that moves; a rate of the wall's own motion counts, too."""
    report = check_laws(on_belt(1.0, 1.5, 0.4), np.linspace(0.0, 10.0, 21), LagrangianState([0.0], [0.4]), quick=True)
    assert report.ok, report
    assert report["energy"].residual < 1e-8

    def wall(t, q):
        return q[0] - 0.2 * jnp.sin(3 * t)

    shaken = LagrangianSystem(falling, ("x",), unilateral=UnilateralContact(wall, restitution=0.3))
    report = check_laws(shaken, np.linspace(0.0, 6.0, 21), LagrangianState([0.5]), quick=True)
    assert report.ok, report
    assert report["energy"].residual < 1e-8


@pytest.mark.long
def test_many_at_once():
    """Restitutions from parameters of their own, in one program: each has its own number of bounces."""

    def ended(e):
        run = drop(1.0, e)
        return run.switches.count, run.switches.times[:3], run.status

    e = jnp.array([0.2, 0.5, 0.7])
    counts, times, statuses = jax.jit(jax.vmap(ended))(e)
    # Until eⁿ is below 1e-6, or the time is over.
    assert counts.tolist() == [9, 20, 3]
    np.testing.assert_allclose(times, jax.vmap(lambda e: bounces(1.0, e, 3))(e), rtol=0, atol=1e-12)
    assert (statuses == Status.SUCCESS).all()


@pytest.mark.thorough
def test_the_rates_of_a_state_alone_are_those_of_what_is_held_there():
    """A block between two walls and on a rough floor, of which each law is seen by itself."""

    def pushed(force):
        return LagrangianSystem(
            lambda t, q, qdot, force: 0.5 * qdot[0] ** 2 + force * q[0],
            ("x",),
            unilateral=[lambda t, q: q[0], lambda t, q: 1.0 - q[0]],
            dry=DryFriction(lambda t, q, qdot: qdot[0], 0.5),
            parameters=force,
        )

    def acts(force, x, v):
        system, state = pushed(force), LagrangianState(x[None], v[None])
        forces = system.row_forces(jnp.array(0.0), state)
        return jnp.append(forces, jaxball.physics.vector_field(system, jnp.array(0.0), state).qdot)

    for given, expected in {
        (0.4, 0.5, 0.0): [0.0, 0.0, -0.4, 0.0],  # it sticks
        (0.8, 0.5, 0.0): [0.0, 0.0, -0.5, 0.3],
        (0.8, 0.5, -1.0): [0.0, 0.0, 0.5, 1.3],
        (-0.8, 0.0, 1.0): [0.0, 0.0, -0.5, -1.3],  # it leaves a wall
    }.items():
        np.testing.assert_allclose(jax.jit(acts)(*map(jnp.array, given)), expected, rtol=0, atol=1e-15)


def test_a_start_beyond_a_contact_is_impossible():
    point = LagrangianSystem(falling, ("x",), unilateral=height)
    start = LagrangianState([-0.1])
    assert jaxball.simulate(point, [0.0, 1.0], start).status == Status.IMPOSSIBLE
    (sentence,) = jaxball.problems(point, start)
    said(sentence, "state.q")
    assert jaxball.problems(point, LagrangianState([0.0])) == []


@pytest.mark.parametrize(
    ("rows", "error", "named"),
    [
        ({"unilateral": [3.0]}, TypeError, "unilateral"),
        ({"unilateral": [height, 0.5]}, TypeError, "unilateral"),
        ({"unilateral": lambda t: t}, TypeError, "unilateral[0].gap"),
        ({"dry": [over_belt]}, TypeError, "dry"),
        ({"dry": DryFriction(lambda q: q, 1.0)}, TypeError, "dry[0].velocity"),
    ],
    ids=["number", "list", "arguments of a gap", "no level", "arguments of a velocity"],
)
def test_what_is_no_row_is_refused(rows, error, named):
    with refuses(error, named):
        LagrangianSystem(falling, ("x",), **rows)


@pytest.mark.thorough
def test_rows_that_depend_on_each_other_are_named_or_end_a_run():
    def along(t, q, qdot):
        return qdot[0]

    twice = LagrangianSystem(falling, ("x",), dry=[DryFriction(along, 0.5), DryFriction(along, 0.4)])
    said(jaxball.problems(twice, LagrangianState([1.0]))[0], "dry[1]")
    floors = LagrangianSystem(falling, ("x",), unilateral=[height, height])
    assert jaxball.problems(floors, LagrangianState([1.0])) == []
    (sentence,) = jaxball.problems(floors, LagrangianState([0.0]))
    said(sentence, "state")
    assert jaxball.simulate(floors, [0.0, 4.0], LagrangianState([1.0])).status == Status.NOT_FINITE


def test_impossible_numbers_of_rows_are_named():
    wrong = LagrangianSystem(
        falling,
        ("x",),
        unilateral=UnilateralContact(height, restitution=1.5, slowest=0.0),
        dry=DryFriction(lambda t, q, qdot: qdot[0], level=2.0, static=1.0),
    )
    assert [line.partition(" must")[0] for line in jaxball.problems(wrong)] == [
        "Argument `unilateral[0].restitution`",
        "Argument `unilateral[0].slowest`",
        "Argument `dry[0].static`",
    ]


# What is held.


@pytest.mark.parametrize("contacts", [4, 2, 0])
def test_what_is_held_is_the_one_set_that_fits(contacts):
    """Found among all sets, of random rows with a positive definite Q."""
    rng, rows = np.random.default_rng(7 + contacts), 4
    is_contact = np.arange(rows) < contacts
    level = np.where(is_contact, 0.0, 0.7)
    low, high = -level, np.where(is_contact, np.inf, level)
    limits = Limits(*map(jnp.asarray, (low, high, level)))
    kinds = [(0.0, 1.0) if contact else (0.0, 1.0, -1.0) for contact in is_contact]
    decide = jax.jit(lambda rest, matrix: choose(law_of(rest, matrix), limits, zero, zero == 0, zero))
    zero = jnp.zeros(rows)
    for _ in range(50):
        root, rest = rng.normal(size=(rows, rows)), rng.normal(size=rows)
        law = law_of(jnp.asarray(rest), jnp.asarray(root @ root.T + 0.01 * np.eye(rows)))
        found = np.asarray(decide(law.rest, law.matrix))
        modes = np.array(list(itertools.product(*kinds)))
        z = np.asarray(jax.vmap(lambda mode, law=law: amounts(law, mode, limits.level))(jnp.asarray(modes)))
        w = rest + z @ np.asarray(law.matrix)
        held = modes == 0
        fits = np.where(held, (z >= low) & (z <= high), modes * w >= 0).all(axis=1)
        assert fits.sum() == 1
        np.testing.assert_array_equal(found, modes[fits][0])


def law_of(rest, matrix):
    return Rows(rest, matrix, jnp.zeros(()), jnp.zeros_like(rest))
