"""The sleigh, the knife edge, the coin, the snakeboard and the roller racer: closed forms, thresholds, invariants."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate

import jaxball
from jaxball.physics.classical import ChaplyginSleigh, KnifeEdge, LagrangianState, RollerRacer, RollingCoin, Snakeboard
from tests.support.sentences import said

TIMES = np.linspace(0.0, 5.0, 51)
TIGHT = {"rtol": 1e-12, "atol": 1e-12, "throw": True}


@pytest.mark.long
def test_the_sleigh_in_closed_form():
    """ω = Ω₀ sech κt, v = V₀ tanh κt, and the force on the blade −m (v ω + a ω̇), to its right."""
    m, inertia, a, Omega = 1.3, 0.4, 0.5, 2.0
    about_blade = inertia + m * a**2
    V = Omega * np.sqrt(about_blade / m)
    kappa = m * a * V / about_blade
    run = jaxball.simulate(
        ChaplyginSleigh(mass=m, inertia=inertia, ahead=a), TIMES, LagrangianState(np.zeros(3), [0, 0, Omega]), **TIGHT
    )
    theta = np.asarray(run.state.q[:, 2])
    v = run.state.qdot[:, 0] * np.cos(theta) + run.state.qdot[:, 1] * np.sin(theta)
    omega = Omega / np.cosh(kappa * TIMES)
    np.testing.assert_allclose(v, V * np.tanh(kappa * TIMES), rtol=0, atol=1e-11)
    np.testing.assert_allclose(run.state.qdot[:, 2], omega, rtol=0, atol=1e-11)
    np.testing.assert_allclose(theta, Omega / kappa * np.arctan(np.sinh(kappa * TIMES)), rtol=0, atol=1e-11)
    omegadot = -kappa * omega * np.tanh(kappa * TIMES)
    force = -m * (V * np.tanh(kappa * TIMES) * omega + a * omegadot)
    np.testing.assert_allclose(run.multipliers[:, 0], force, rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.laws.energy, run.laws.energy[0], rtol=0, atol=1e-11)


@pytest.mark.long
def test_a_knife_edge_on_an_incline_moves_on_a_cycloid_across_it():
    g, slope, omega = 9.81, 0.3, 1.7
    edge = KnifeEdge(mass=2.0, inertia=0.7, slope=slope, gravity=g)
    run = jaxball.simulate(edge, TIMES, LagrangianState(np.zeros(3), [0.0, 0.0, omega]), **TIGHT)
    size, turned = g * np.sin(slope) / (2 * omega**2), omega * TIMES
    expected = np.stack([size * np.sin(turned) ** 2, size * (turned - 0.5 * np.sin(2 * turned)), turned], axis=1)
    np.testing.assert_allclose(run.state.q, expected, rtol=0, atol=1e-10)


@jax.jit
def linearised(coin, omega):
    """The derivatives of the rates of lean, tilt, turn and roll of a coin that rolls upright."""

    def rates(x):
        lean, tilt, turn, roll = x
        q = jnp.stack([0.0, 0.0, 0.0, lean, 0.0])
        qdot = jnp.stack([coin.radius * roll, 0.0, turn, tilt, roll])
        qddot = coin.field(jnp.array(0.0), LagrangianState(q, qdot)).qdot
        return jnp.stack([tilt, qddot[3], qddot[2], qddot[4]])

    return jax.jacfwd(rates)(jnp.stack([0.0, 0.0, 0.0, omega]))


def growth_squared(coin, omega):
    """The square of the growth rate of small leans; the other two rates are 0."""
    squares = (np.linalg.eigvals(linearised(coin, omega)) ** 2).real
    return squares[np.argmax(np.abs(squares))]


@pytest.mark.thorough
def test_a_coin_that_rolls_fast_enough_stays_upright():
    """For a disk (5/4) r λ² = g − 3 r ω², and for a hoop (3/2) r λ² = g − 4 r ω²."""
    g, r, m = 9.81, 0.4, 0.3
    disk = RollingCoin(mass=m, radius=r, gravity=g)
    hoop = RollingCoin(mass=m, radius=r, gravity=g, inertia=(m * r**2, 0.5 * m * r**2))
    for coin, factor, share in ((disk, 3.0, 5 / 4), (hoop, 4.0, 3 / 2)):
        for part in (0.9, 0.999, 1.001, 1.1):
            omega = np.sqrt(part * g / (factor * r))
            expected = g * (1 - part) / (share * r)
            np.testing.assert_allclose(growth_squared(coin, omega), expected, rtol=1e-9, atol=1e-10)


@pytest.mark.long
def test_a_coin_that_rolls_too_slowly_falls_over():
    """From a lean θ₀ = 1e-4, which grows; with 3 r ω² = s g, s > 1, it oscillates about θ₀ s / (s − 1), because the
    coin turns at φ̇ = 2 ω (θ − θ₀). What it keeps is its energy and the constraints.
    """
    runs = {}
    for part in (0.7, 1.3):
        omega = np.sqrt(part / 3)
        start = LagrangianState([0.0, 0.0, 0.0, 1e-4, 0.0], [omega, 0.0, 0.0, 0.0, omega])
        runs[part] = jaxball.simulate(RollingCoin(), np.linspace(0.0, 15.0, 151), start, **TIGHT)
        np.testing.assert_allclose(runs[part].laws.energy, runs[part].laws.energy[0], rtol=0, atol=1e-10)
        np.testing.assert_allclose(runs[part].laws.velocity_constraints, 0.0, rtol=0, atol=1e-10)
    assert np.max(np.abs(runs[0.7].state.q[:, 3])) > 1e-2
    np.testing.assert_allclose(np.max(runs[1.3].state.q[:, 3]), 1e-4 * (2 * 1.3 / 0.3 - 1), rtol=1e-3)


@functools.cache
def time_of_fall(m, r, g, lean):
    """The time from rest at a lean until the coin lies down, by SciPy: its rim stays where it is, and it turns about
    the tangent there, ½ (m r² + m r²/4) θ̇² = m g r (cos θ₀ − cos θ). With θ = θ₀ + u² the integrand is finite.
    """

    def slowness(u):
        # cos θ₀ − cos θ as a product, because the difference loses all digits near θ₀.
        fallen = 2 * np.sin(lean + u**2 / 2) * np.sin(u**2 / 2)
        return 2 * u / np.sqrt(2 * g * fallen / (1.25 * r))

    return integrate.quad(slowness, 0.0, np.sqrt(np.pi / 2 - lean), epsabs=1e-13, epsrel=1e-13)[0]


@pytest.mark.thorough
def test_a_coin_that_falls_over_ends_where_it_lies_down():
    m, r, g = 1.3, 0.7, 9.81
    coin, times = RollingCoin(mass=m, radius=r, gravity=g), np.linspace(0.0, 3.0, 31)

    def fall(lean, tolerance=1e-11):
        start = LagrangianState(jnp.zeros(5).at[3].set(lean))
        return jaxball.simulate(coin, times, start, rtol=tolerance, atol=tolerance)

    expected = time_of_fall(m, r, g, 0.1)
    # From 0.1 an error grows until the end by 15, e^(1.05 √(g/(1.25 r))) / 2.
    for tolerance in (1e-6, 1e-11):
        for lean in (0.1, -0.1):
            run = fall(lean, tolerance)
            assert run.status == jaxball.Status.TOPPLED
            assert run.reached == pytest.approx(expected, abs=30 * tolerance)
            assert np.all(np.isnan(run.state.q[:, 3]) == (times > expected))
    said(fall(0.1).message)
    # A central difference of 2e-4, whose error is its square times the third derivative, of 2 / lean³.
    difference = (time_of_fall(m, r, g, 0.1 + 1e-4) - time_of_fall(m, r, g, 0.1 - 1e-4)) / 2e-4
    assert jax.grad(lambda lean: fall(lean).reached)(0.1) == pytest.approx(difference, abs=2e-5)


@pytest.mark.parametrize("lean", [np.pi / 2, -np.pi / 2, 2.0, 4.0])
def test_a_coin_that_lies_down_is_told_by_its_lean_alone(lean):
    lying = LagrangianState([0.0, 0.0, 0.0, lean, 0.0])
    (sentence,) = jaxball.problems(RollingCoin(), lying)
    said(sentence, "state.q[3]")
    skidding = LagrangianState([0.0, 0.0, 0.0, 0.3, 0.0], [1.0, 0.0, 0.0, 0.0, 0.0])
    (sentence,) = jaxball.problems(RollingCoin(), skidding)
    said(sentence, "state.qdot")


@pytest.mark.long
def test_the_invariants_of_a_snakeboard():
    """No constraint restrains the rotor and the trucks: J₀ (θ̇ + ψ̇) and J₁ (θ̇ + φ̇) are constant."""
    board = Snakeboard()
    turned = LagrangianState([0.0, 0.0, 0.1, 0.0, -0.4, 0.3], [1.0, 0.2, 0.3, 1.5, 0.1, -0.2])
    start = board.consistent(0.0, turned)
    run = jaxball.simulate(board, np.linspace(0.0, 2.0, 21), start, project=True, **TIGHT)
    rates = np.asarray(run.state.qdot)
    momenta = rates[:, 2:3] + rates[:, 3:]
    np.testing.assert_allclose(momenta, momenta[:1].repeat(21, axis=0), rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.laws.energy, run.laws.energy[0], rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.laws.velocity_constraints, 0.0, rtol=0, atol=1e-14)
    assert np.ptp(rates[:, 0]) > 0.1


@pytest.mark.long
def test_the_invariants_of_a_roller_racer():
    racer = RollerRacer()
    start = racer.consistent(0.0, LagrangianState([0.0, 0.0, 0.2, 0.5], [1.0, 0.1, 0.2, 0.6]))
    run = jaxball.simulate(racer, np.linspace(0.0, 2.0, 21), start, **TIGHT)
    np.testing.assert_allclose(run.laws.energy, run.laws.energy[0], rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.laws.velocity_constraints, 0.0, rtol=0, atol=1e-10)
    assert np.ptp(run.state.qdot[:, 0]) > 0.1


def test_impossible_vehicles():
    (problem,) = jaxball.problems(ChaplyginSleigh(mass=-1.0, inertia=1.0, ahead=0.1))
    said(problem, "mass")
    start = LagrangianState(np.zeros(3), [0.0, 1.0, 0.0])
    (sentence,) = jaxball.problems(ChaplyginSleigh(inertia=1.0, ahead=0.1), start)
    said(sentence, "state.qdot")
