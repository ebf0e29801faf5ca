"""Ellipsoids that spin and roll, to first order in their tilt: closed forms, and what friction makes of them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import cumulative_simpson, solve_ivp

import jaxball
from jaxball import Resistance
from jaxball.analysis.verify import check_laws
from jaxball.physics.classical import EllipsoidState, RollingEllipsoid

NOW = jnp.array(0.0)
# The shell of RoboBall II, whose moment about its axle, E2, is the smallest.
M, A, C, R = 16.53649, 1.04, 0.64074, 0.3175


def rattleback_polynomial(body, n):
    """The characteristic polynomial about the spin n, upright on the end of the third semi-axis.

    By Newton's and Euler's laws to first order in the tilt γ, with the contact at −ρ γ from below the centre of mass.
    H. Bondi, Proceedings of the Royal Society A 405 (1986), 265, studies its roots.
    """
    m, g, h = float(body.mass), float(body.gravity), float(body.semiaxes[2] + body.offset[2])
    r1, r2 = np.asarray(body.semiaxes[:2] ** 2 / body.semiaxes[2])
    J = np.asarray(body.J)
    a, b, d, c = J[0, 0] + m * h**2, J[1, 1] + m * h**2, J[0, 1], J[2, 2]
    weight1, weight2 = m * g * (r2 - h), m * g * (r1 - h)
    spin1, spin2 = c - b + m * h * r2, c - a + m * h * r1
    odd = -d * m * h * n * (r1 - r2)
    second = a * weight2 + b * weight1 + n**2 * (spin1 * spin2 + a * b - 2 * d**2)
    last = (weight1 + n**2 * spin1) * (weight2 + n**2 * spin2) - d**2 * n**4
    return [a * b - d**2, odd, second, odd * n**2, last]


@jaxball.jit
def tilt_rates(body, n):
    """The rates of (γ1, γ2, Ω1, Ω2) about the spin n, differentiated at none of them."""

    def rates(x):
        q = jnp.stack([jnp.ones(()), x[1] / 2, -x[0] / 2, jnp.zeros(())])  # Γ = (γ1, γ2, 1) to first order
        state = EllipsoidState(q, jnp.stack([x[2], x[3], n]))
        Gammadot, Omegadot = jnp.cross(state.Gamma, state.Omega), body.field(NOW, state).Omega
        return jnp.concatenate([Gammadot[:2], Omegadot[:2]])

    return jax.jacfwd(rates)(jnp.zeros(4))


@pytest.mark.thorough
@pytest.mark.parametrize("n", [2.0, -2.0, 12.0])
def test_a_rattlebacks_growth_rates_are_those_of_its_characteristic_polynomial(n):
    """Rounding is magnified by the inverse of the smallest inertia, of 1e-4, and by roots that lie close together.

    Spun in one sense one of its two oscillations grows, spun in the other the other one.
    """
    body = jaxball.load_scenario("rattleback").system
    expected = rattleback_polynomial(body, n)
    roots, found = (
        np.sort_complex(np.roots(expected)),
        np.sort_complex(np.linalg.eigvals(tilt_rates(body, jnp.array(n)))),
    )
    np.testing.assert_allclose(found, roots, atol=1e-9 * np.max(np.abs(roots)))
    assert np.sign(np.sum(found.real)) == -np.sign(expected[1])
    assert (np.sum(found.real) > 0) == (n < 0)  # it prefers positive spins
    assert np.max(found.real) > 1e-2


def test_the_numbers_of_the_rattleback_are_kanes_and_levinsons():
    """A = 2e-4, B = 16e-4, C = 17e-4 and D = 0.2e-4 kg m²."""
    J = [[2e-4, -2e-5, 0.0], [-2e-5, 16e-4, 0.0], [0.0, 0.0, 17e-4]]
    np.testing.assert_allclose(jaxball.load_scenario("rattleback").system.J, J, atol=1e-18)


@pytest.mark.thorough
def test_a_spheroid_that_rolls_on_its_rim_leans_as_gyroscopic_and_gravity_torques_make_it():
    """δ̈ = −[C D ν² / A − m g (a − ρ)] δ / B, with the radius of curvature ρ = b²/a across the rim, D = C + m a² and B =
    A + m a²: the disk's for b = 0, and the sphere's for b = a. The angular momentum about the vertical is 0.
    """
    m, g, a, nu, moment, axial = 1.3, 9.8, 1.1, 2.7, 0.4, 0.5

    def acceleration(delta, b):
        semiaxes = jnp.stack([jnp.array(a), b, jnp.array(a)])
        body = RollingEllipsoid(mass=m, semiaxes=semiaxes, inertia=(moment, axial, moment), gravity=g)
        q = jnp.stack([jnp.cos(delta / 2), jnp.sin(delta / 2), jnp.zeros(()), jnp.zeros(())])
        turning = jnp.stack([jnp.zeros(()), jnp.array(nu), nu * delta * (1 - axial / moment)])  # in space axes
        state = EllipsoidState(q)
        Omega = state.Lambda.T @ turning
        Omegadot = body.field(NOW, EllipsoidState(q, Omega)).Omega
        Gammadot = jnp.cross(state.Gamma, Omega)
        return (jnp.cross(Gammadot, Omega) + jnp.cross(state.Gamma, Omegadot))[1]  # of the axle's third component

    slope, gyroscopic = jaxball.jit(jax.grad(acceleration)), axial * (axial + m * a**2) * nu**2 / moment
    for b in (0.0001, 0.6, 1.0, 1.3):
        expected = -(gyroscopic - m * g * (a - b**2 / a)) / (moment + m * a**2)
        np.testing.assert_allclose(slope(jnp.array(0.0), jnp.array(b)), expected, rtol=1e-11)


@pytest.fixture(scope="module")
def oblate():
    return jaxball.load_scenario("oblate-ball").simulate(throw=True)


def axle_from_rotation(run):
    """The angle between the axle, E2, and ω, in degrees."""
    Omega = np.asarray(run.state.Omega)
    return np.rad2deg(np.arccos(np.minimum(np.abs(Omega[:, 1]) / np.linalg.norm(Omega, axis=1), 1.0)))


def test_an_oblate_ball_falls_from_rolling_into_flipping(oblate):
    """At first it rotates about its axle, and in the end about an axis across it, without leaving its plane."""
    angle, axle = axle_from_rotation(oblate), np.asarray(oblate.state.Lambda)[:, :, 1]
    assert np.max(angle[oblate.times < 20.0]) < 1.0
    assert np.min(angle[oblate.times > 85.0]) > 75.0
    late = axle[oblate.times > 80.0]
    assert np.min(late[:, 2]) < -0.8  # the axle swings through the vertical
    assert np.max(late[:, 2]) > 0.8
    reaction = np.asarray(jaxball.jit(jax.vmap(lambda s: oblate.system.reaction(NOW, s)))(oblate.state))
    assert np.min(reaction[:, 2]) > 0.8 * M * 9.81
    assert np.max(np.hypot(reaction[:, 0], reaction[:, 1]) / reaction[:, 2]) < 0.2


def test_it_loses_the_energy_that_resistance_takes(oblate):
    """Simpson's rule over steps of 0.05, at some 10 rad/s, is good to 1e-6 of what is lost.

    The power is c_r |ω_h|² + c_s ω₃², from the state alone; the versor's length is off by up to 4e-10.
    """
    omega = np.einsum("tij,tj->ti", oblate.state.Lambda, oblate.state.Omega)
    power = 0.02 * np.sum(omega[:, :2] ** 2, axis=1) + 0.3 * omega[:, 2] ** 2
    lost = cumulative_simpson(power, x=oblate.times, initial=0.0)
    energy = np.asarray(oblate.laws.energy)
    np.testing.assert_allclose(energy[0] - energy, lost, atol=1e-6 * lost[-1])
    np.testing.assert_allclose(
        jaxball.jit(jax.vmap(lambda s: oblate.system.dissipation(NOW, s)))(oblate.state), power, rtol=1e-8
    )


C_R, C_S = 0.02, 0.3


def wobbling(t, y):
    """(δx, δz, δ̇z, the momentum about the vertical) of the axle (δx, 1, δz) of a sphere, by Euler's law about the
    contact, with ν = ν₀ exp(−c_r t / D): D ν δ̇x + B δ̈z = −c_r δ̇z, L₃ = C ν δz − A δ̇x and L̇₃ = −c_s (ν δz − δ̇x).
    """
    B, D = A + M * R**2, C + M * R**2
    nu = 10.0 * np.exp(-C_R / D * t)
    _, z, w, L = y
    xdot = (C * nu * z - L) / A
    return [xdot, w, -(D * nu * xdot + C_R * w) / B, -C_S * (nu * z - xdot)]


@pytest.mark.thorough
def test_a_wobble_grows_where_the_moment_about_the_axle_is_the_smaller():
    """Against the equations to first order in a tilt of 1e-4, of whose square a thousand times is left at the end.

    The wobble grows as exp σt, σ = ½ [c_s (1/C − 1/A) + c_r (1/D − 1/B)], up to the ratio of a rate of decay to ν.
    """
    body = RollingEllipsoid(
        mass=M,
        semiaxes=(R, R, R),
        inertia=(A, C, A),
        gravity=9.81,
        resistance=Resistance(rolling=C_R, spinning=C_S),
    )
    tilt, times = 1e-4, np.linspace(0.0, 30.0, 301)
    start = EllipsoidState((np.cos(tilt / 2), np.sin(tilt / 2), 0.0, 0.0), (0.0, 10.0, 0.0))
    run = jaxball.simulate(body, times, start, throw=True)
    axle = np.asarray(run.state.Lambda)[:, :, 1]
    # At the start ω = 10 k turns about the axle alone: δ̇x = 0, as k̇ = 0.
    known = solve_ivp(wobbling, (0, 30), [0.0, tilt, 0.0, C * 10.0 * tilt], t_eval=times, rtol=1e-11, atol=1e-16).y
    np.testing.assert_allclose(axle[:, 2], known[1], atol=1e-5 * tilt)
    B, D = A + M * R**2, C + M * R**2
    sigma = (C_S * (1 / C - 1 / A) + C_R * (1 / D - 1 / B)) / 2
    angle = axle_from_rotation(run)
    growth = np.log(np.max(angle[(times > 25) & (times < 30)]) / np.max(angle[(times > 5) & (times < 10)])) / 20
    assert abs(growth / sigma - 1) < 0.05


@pytest.mark.thorough
def test_the_balance_of_energy_is_verified():
    """As for the laws of other systems, whose rates are 0."""
    body = RollingEllipsoid(
        semiaxes=(1.0, 0.8, 1.0), inertia=(0.3, 0.4, 0.3), resistance=Resistance(rolling=0.1, dry=0.02)
    )
    start = EllipsoidState((0.8, 0.6, 0.0, 0.0), (0.3, 1.0, 0.2))
    report = check_laws(body, np.linspace(0.0, 1.0, 3), start, laws=["energy"], quick=True)
    assert report.ok
    assert report["energy"].residual < 1e-8
