"""Predictive control with active limits, against SciPy's solutions of the same quadratic program, written out."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import LinearConstraint, minimize

import jaxball
from jaxball.control import tvlqr
from jaxball.control.quadratic_program import solve_stages
from jaxball.physics.observables import observe
from tests.control import robots
from tests.support.differences import jacobian
from tests.support.sentences import refuses

pytestmark = pytest.mark.thorough  # all share programs that take seconds to compile

H, HORIZON = 0.1, 8


@pytest.fixture(scope="module")
def track():
    """A ball that its pendulum drives along a bend."""
    times = np.linspace(0.0, 1.5, 5)
    drives = (jaxball.Waypoints(times, [0.0, 0.3, -0.2, 0.1, 0.0]), jaxball.Waypoints(times, [0.0, 0.1, 0.2, 0.1, 0.0]))
    start = jaxball.BallState(Omega=(0.0, 0.5, 0.0))
    run = jaxball.simulate(robots.ball_with_pendulum(drives), [0.0, 1.0], start)
    return tvlqr(run, Q={"z": 2.0, "Omega": 0.2, "theta": 1.0}, R=0.05, sample=H)


def written_out(control, xi):
    """The program in the inputs alone: a quadratic form, a gradient, a constant, and rows and bounds of limits."""
    A, B, c, _, _, M, end, G, L, d, _ = (np.asarray(part) for part in control.stages(jnp.asarray(0)))
    n, m = B.shape[1:]
    size = HORIZON * m + 1  # (inputs, 1)
    state, form = np.zeros((n, size)), np.zeros((size, size))
    state[:, -1] = xi
    rows, bounds = [], []
    for j in range(HORIZON):
        z = np.concatenate([state, np.eye(size)[j * m : (j + 1) * m]])
        form += z.T @ M @ z
        rows.append(L @ G[j] @ z)
        bounds.append(d[j])
        state = A[j] @ state + B[j] @ z[n:]
        state[:, -1] += c[j]
    last = np.concatenate([state, np.eye(size)[-1:]])
    form += last.T @ end @ last
    rows = np.concatenate(rows)
    return form, rows[:, :-1], np.concatenate(bounds) - rows[:, -1]


def by_scipy(form, rows, bounds, slacks=0, penalty=0.0):
    """The least of the form within the bounds, which slacks may relax at a penalty."""
    n = rows.shape[1]
    Q, q = form[:n, :n], form[:n, n]

    def cost(x):
        return x[:n] @ Q @ x[:n] + 2 * q @ x[:n] + penalty * x[n:].sum()

    def slope(x):
        return np.concatenate([2 * Q @ x[:n] + 2 * q, np.full(slacks, penalty)])

    own = np.block([[rows, -np.eye(len(rows))[:, :slacks]], [np.zeros((slacks, n)), -np.eye(slacks)]])
    most = np.append(bounds, np.zeros(slacks))
    start = np.append(np.zeros(n), np.maximum(-bounds, 0.0)[:slacks] + 1.0 if slacks else [])
    within = LinearConstraint(own, ub=most)
    hessian = np.zeros((n + slacks, n + slacks))
    hessian[:n, :n] = 2 * Q
    options = {"gtol": 1e-10, "xtol": 1e-12, "barrier_tol": 1e-11, "maxiter": 3000}
    derivatives = {"jac": slope, "hess": lambda x: hessian}
    found = minimize(cost, start, method="trust-constr", constraints=within, options=options, **derivatives)
    return found.x[:n], found.fun + form[n, n]


XI = np.zeros(12)
XI[[3, 6]] = 0.3


ALONE = [(0.5, None), (10.0, 0.03)]


@pytest.mark.long
@pytest.mark.parametrize(("limit", "friction"), [*ALONE, (0.6, 0.04)], ids=str)
def test_the_plan_is_the_solution_of_the_program_with_active_limits(track, limit, friction):
    """SciPy's barrier method stops where its cost is up to 1e-4 above the least, at inputs that are off by 1e-3."""
    control = track.mpc(HORIZON, limits=limit, friction=friction)
    plan = control.plan(0, track.nominal.state(0).retract(jnp.asarray(XI)))
    assert bool(plan.closed)
    assert int(plan.iterations) > 0
    assert not control.exceeded(plan)
    form, rows, bounds = written_out(control, XI)
    inputs, least = by_scipy(form, rows, bounds)
    ours = np.append(np.asarray(plan.z[:, 12:]).ravel(), 1.0)
    assert np.min(bounds - rows @ ours[:-1]) < 1e-6
    assert ours @ form @ ours == pytest.approx(least, rel=1e-4)
    assert ours @ form @ ours < least * (1 + 1e-8)
    np.testing.assert_allclose(ours[:-1], inputs, rtol=0, atol=2e-3)


@pytest.mark.long
def test_the_optimality_conditions_hold(track):
    """Karush, Kuhn and Tucker's: the gradient is that of the limits, multipliers are positive, and 0 inside them.

    The gap between the program and its dual is closed to 1e-9 of the cost, which leaves 1e-6 of the gradient.
    """
    control = track.mpc(HORIZON, limits=0.6, friction=0.04)
    plan = control.plan(0, track.nominal.state(0).retract(jnp.asarray(XI)))
    form, rows, bounds = written_out(control, XI)
    u, multipliers = np.asarray(plan.z[:, 12:]).ravel(), np.asarray(plan.multipliers).ravel()
    n = len(u)
    gradient = 2 * form[:n, :n] @ u + 2 * form[:n, n]
    np.testing.assert_allclose(gradient, -rows.T @ multipliers, rtol=0, atol=1e-6 * np.max(np.abs(gradient)))
    assert np.all(multipliers >= 0)
    whole = np.append(u, 1.0)
    assert multipliers @ (bounds - rows @ u) <= 1e-9 * (whole @ form @ whole)


def test_without_active_limits_it_is_the_regulator(track):
    control = track.mpc(HORIZON, limits=50.0, friction=2.0)
    state = track.nominal.state(0).retract(jnp.asarray(0.1 * XI))
    plan = control.plan(0, state)
    assert int(plan.iterations) == 0
    expected, _ = track(jnp.asarray(0), state, ())
    np.testing.assert_allclose(plan.z[0, 12:], expected, rtol=0, atol=1e-12)


def test_the_rows_are_derivatives_of_the_reaction(track):
    """f and N over the weight, by central differences of observables, with steps of 1e-5 of numbers of size 1."""
    control = track.mpc(HORIZON, friction=0.3)
    k = 2
    state, u, t = track.nominal.state(k), track.nominal.input(k), track.times[k]
    weight = float(track.sampled.system.total_mass * track.sampled.system.gravity)

    def reaction(v):
        seen = observe(track.sampled.hold(u + v[12:]), t, state.retract(v[:12]))
        return jnp.append(seen.friction, seen.normal_force) / weight

    expected = jacobian(jax.jit(reaction), jnp.zeros(14), 1e-5, points=2)
    np.testing.assert_allclose(control.limits.G[k], expected, rtol=0, atol=1e-8)


def test_limits_that_cannot_be_kept_are_exceeded_least_and_named(track):
    """A pendulum that is let go at 0.5 pushes the ball with some per cent of its weight, whatever weak motors do."""
    control = track.mpc(2, limits=0.01, friction=0.01)
    swung = np.zeros(12)
    swung[8] = 0.5
    plan = control.plan(0, track.nominal.state(0).retract(swung))
    assert bool(plan.closed)
    sentences = control.exceeded(plan)
    assert any(sentence.startswith("friction[") and "cannot be kept" in sentence for sentence in sentences)
    # At the least of the elastic program each multiplier of what is exceeded is the penalty.
    exceeded = np.asarray(plan.exceeded) > 0
    penalty = float(control.penalty * track.sampled.sample)
    np.testing.assert_allclose(np.asarray(plan.multipliers)[exceeded], penalty, rtol=1e-5)


@pytest.mark.slow
def test_a_closed_loop_keeps_limits_that_the_regulator_would_exceed(track):
    """The linear prediction of friction is that of the motion; deviations of 0.1 change it by some per cent."""
    start = 0.3 * XI
    free = track.closed_loop(start)
    ratio = float(free.run.observables.friction_ratio.max())
    control = track.mpc(HORIZON, friction=0.8 * ratio)
    held = control.closed_loop(start)
    assert float(held.run.observables.friction_ratio.max()) < 0.85 * ratio
    assert float(jnp.max(held.memory.worst)) == 0


@pytest.mark.slow
def test_gradients_of_the_cost_go_through_active_limits():
    """By the mass of the robot, the limit of the motor, the weight of the input, and the start.

    Each plan's inputs are known to some 1e-7, so that central differences with steps of 1e-3 of numbers of size 1 are
    known to 1e-3 of the derivatives' size.
    """

    run = jaxball.simulate(robots.with_pendulum(), [0.0, 1.0])

    def cost(by):
        planned = tvlqr(run, Q={"phi": 1.0, "theta": 1.0}, R=0.1 * (1 + by[2]), Qf=1.0, sample=H)
        control = planned.mpc(5, limits=0.3 * (1 + by[1]))
        start = jnp.array([0.0, 0.0, 0.0, 0.4, 0.0]) * (1 + by[3])
        robot = robots.with_pendulum(mass=robots.MASS + by[0])
        loop = control.closed_loop(start, system=robot, limits=0.3 * (1 + by[1]))
        return jnp.sum(loop.xi**2), jnp.sum(jnp.abs(loop.u) > 0.2999)

    zero = jnp.zeros(4)
    forward = jaxball.jit(jax.jacfwd(lambda by: cost(by)[0]))(zero)
    reverse = jaxball.jit(jax.grad(lambda by: cost(by)[0]))(zero)
    value = jaxball.jit(cost)
    assert 2 <= int(value(zero)[1]) < 10, "some inputs are at the limit, and some are not"
    expected = [(float(value(e)[0]) - float(value(-e)[0])) / 2e-3 for e in 1e-3 * jnp.eye(4)]
    np.testing.assert_allclose(reverse, forward, rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(forward, expected, rtol=2e-3, atol=1e-5)


def test_a_motor_without_a_limit_may_be_traced(track):
    """Whether a limit is infinite is then not known, and the plan must be the one without limits."""
    deviated = track.nominal.state(0).retract(jnp.asarray(XI))
    limits = jnp.full(len(track.inputs), jnp.inf)
    plan = jax.jit(lambda limits: track.mpc(HORIZON, limits=limits).plan(0, deviated).z)(limits)
    np.testing.assert_allclose(plan, track.mpc(HORIZON, limits=limits).plan(0, deviated).z, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"horizon": 0}, "horizon"),
        ({"horizon": 5, "friction": 0.0}, "friction"),
        ({"horizon": 5, "penalty": -1.0}, "penalty"),
        ({"horizon": 5, "limits": -1.0}, "limits"),
    ],
)
def test_bad_input_gets_a_sentence(track, options, named):
    with refuses(ValueError, named):
        track.mpc(**options)


@pytest.mark.long
def test_derivatives_of_a_plan_are_those_of_its_conditions(track):
    """By the deviation, a limit, the penalty and the weights, at active limits; in both modes, and by differences.

    The program is solved to 1e-9 of its cost, so that inputs are off by some 1e-6: central differences with steps of
    1e-3 by 1e-3 of derivatives of size 1, where no limit becomes active or inactive.
    """
    control = track.mpc(HORIZON, limits=0.5, friction=0.04)
    rng = np.random.default_rng(1)
    along = rng.normal(size=12)
    of_cost = rng.normal(size=(HORIZON, 14))

    def result(by):
        M = control.track.W * (1 + by[2])
        changed = eqx.tree_at(lambda c: (c.limits.d, c.track.W), control, (control.limits.d * (1 + by[1]), M))
        plan = solve_stages(changed.stages(jnp.asarray(0)), jnp.asarray(XI) + by[0] * along)
        return jnp.sum(plan.z * of_cost)

    zero = jnp.zeros(3)
    forward, reverse = jax.jit(jax.jacfwd(result))(zero), jax.jit(jax.grad(result))(zero)
    np.testing.assert_allclose(reverse, forward, rtol=1e-4)  # slacks of active limits are some 1e-10 of others
    compiled = jax.jit(result)
    expected = [(compiled(e) - compiled(-e)) / 2e-3 for e in 1e-3 * jnp.eye(3)]
    assert int(control.plan(0, track.nominal.state(0).retract(jnp.asarray(XI))).iterations) > 0
    np.testing.assert_allclose(reverse, expected, rtol=0, atol=2e-3 * float(np.max(np.abs(expected))))
