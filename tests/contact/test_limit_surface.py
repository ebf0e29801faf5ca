"""Coupled friction of slip and spin, against what a homogeneous ball does by the laws of its motion alone.

Its friction f and the torque m₃ change v_s by 7/2 f/m and ω₃ by 5/2 m₃/(m r²) in a unit of time. So in τ with dt = s dτ
and s² = v_s² + (ρ ω₃)², v_s and ω₃ are exponentials, and the time is a quadrature.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

import jaxball
from jaxball import (
    Ball,
    BallState,
    Contact,
    Disk,
    DiskState,
    FunctionWrench,
    Ground,
    Resistance,
    Wrench,
    load_run,
    simulate,
)
from jaxball.physics import LimitSurface, Mode, ReleasedState
from jaxball.simulation.one_sided import with_one_sided_limits
from tests.support.differences import jacobian
from tests.support.precision import enable_x64
from tests.support.sentences import refuses

G, M, R, MU = 9.81, 1.3, 0.5, 0.3
SOLID = 0.4 * M * R**2
FINE = {"rtol": 1e-12, "atol": 1e-12}
CLOSE = 1e-10
SPIN = 4.0
THROWN = ReleasedState(BallState(Omega=(0.3, -1.0, SPIN)), V=(1.4, 0.5, 0.0))
SLIP = np.array([1.4 + R * 1.0, 0.5 + R * 0.3])  # of THROWN


def solid(**others):
    return Ball(mass=M, inertia=(SOLID,) * 3, radius=R, gravity=G, **others)


def uneven(**others):
    return Ball(
        mass=M, inertia=(0.9 * SOLID, SOLID, 1.1 * SOLID), radius=R, gravity=G, offset=(0.02, 0.01, -0.05), **others
    )


NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)  # exact to rounding over one e-fold
COUNT = 12  # of times, so that all runs of one law share a program, on a slope or not


def run_of(start, law, times, angle=0.0):
    """A run of a solid ball, with more times before the second of ``times``, so that there are ``COUNT``."""
    early = np.linspace(times[0], times[1], COUNT + 2 - len(times))[:-1]
    ball = solid(ground=Ground(angle=angle))
    return simulate(ball, np.concatenate([early, times[1:]]), start, contact=Contact(law), throw=True, **FINE)


def omega_of(run):
    return np.einsum("tij,tj->ti", run.state.Lambda, run.state.Omega)


def slide_of(run, rho):
    """(v_s, ρ ω₃) of a ball at the saved times, from the state alone."""
    omega = omega_of(run)
    slip = np.asarray(run.contact.V)[:, :2] - R * np.stack([omega[:, 1], -omega[:, 0]], axis=1)
    return np.concatenate([slip, rho * omega[:, 2:]], axis=1)


class Decay:
    """The slide of a solid ball on a level plane that nothing pushes."""

    def __init__(self, rho, slip=SLIP, spin=SPIN):
        self.rates = MU * G * np.array([3.5, 3.5, 2.5 * (rho / R) ** 2])
        self.first = np.array([*slip, rho * spin])
        self.last = 40 / self.rates[2]  # when nothing is left that a float64 would tell

    def at(self, tau):
        return self.first * np.exp(-self.rates * tau)

    def integral(self, values, until):
        """Over τ, by Gauss's rule from one e-fold of the quickest part to the next."""
        steps = np.append(np.arange(0.0, until, 1 / self.rates[0]), until)
        middles, halves = (steps[1:] + steps[:-1])[:, None] / 2, np.diff(steps)[:, None] / 2
        return np.sum(halves * WEIGHTS * values(middles + halves * NODES))

    def size(self, tau):
        return np.linalg.norm(self.at(tau[..., None]), axis=-1)

    def time(self, until):
        return self.integral(self.size, until)

    @property
    def end(self):
        return self.time(self.last)

    def after(self, t):
        if t >= self.end:
            return np.zeros(3)
        return self.at(brentq(lambda tau: self.time(tau) - t, 0.0, self.last, xtol=1e-15, rtol=1e-14))


@pytest.mark.parametrize("rho", [0.3, 0.1])
def test_a_slip_and_a_spin_end_together(rho):
    """Until then v_s is to the power (5/7) (ρ/r)² as ω₃."""
    decay = Decay(rho)
    times = np.linspace(0.0, 1.1 * decay.end, COUNT)
    run = run_of(THROWN, LimitSurface(MU, rho), times)
    np.testing.assert_allclose(slide_of(run, rho), [decay.after(t) for t in times], rtol=0, atol=CLOSE)
    assert int(run.switches.count) == 1
    np.testing.assert_allclose(run.switches.times[0], decay.end, rtol=0, atol=CLOSE)
    assert [int(mode) for mode in run.contact.mode[:: COUNT - 1]] == [Mode.SLIDING, Mode.ROLLING]
    early = np.asarray(slide_of(run, rho))[1:5]
    share = np.linalg.norm(early[:, :2], axis=1) / np.linalg.norm(SLIP)
    np.testing.assert_allclose(share ** (5 / 7 * (rho / R) ** 2), early[:, 2] / (rho * SPIN), rtol=1e-7)
    energy = run.observables.energy + run.contact.friction_loss
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-11)
    both = with_one_sided_limits(run).contact.sigma
    np.testing.assert_allclose(np.linalg.norm(both, axis=-1)[np.asarray(both).any(axis=-1)], 1.0, rtol=1e-9)


def test_a_ball_that_spins_slides_further():
    """By the way that V = V₀ − 2/7 (v₀ − v) takes in τ; one that only pivots stays where it is."""
    rho = 0.2
    slow = run_of(ReleasedState(BallState(), V=(2.0, 0.0, 0.0)), MU, [0.0, 4.0])
    ways = []
    for spin in (8.0, 16.0):
        decay = Decay(rho, slip=(2.0, 0.0), spin=spin)
        start = ReleasedState(BallState(Omega=(0.0, 0.0, spin)), V=(2.0, 0.0, 0.0))
        run = run_of(start, LimitSurface(MU, rho), [0.0, decay.end, 4.0])

        def way(tau, decay=decay):
            return decay.size(tau) * (2.0 - 2 / 7 * (2.0 - decay.at(tau[..., None])[..., 0]))

        np.testing.assert_allclose(run.state.z[-2, 0], decay.integral(way, decay.last), rtol=0, atol=1e-9)
        ways.append(float(run.state.z[-1, 0]))
    assert float(slow.state.z[-1, 0]) + 0.02 < ways[0] < ways[1] - 0.02
    pivots = run_of(ReleasedState(BallState(Omega=(0.0, 0.0, 4.0))), LimitSurface(MU, rho), [0.0, 1.0])
    np.testing.assert_array_equal(pivots.state.z, 0.0)
    np.testing.assert_allclose(pivots.switches.times[0], rho * 4.0 / Decay(rho).rates[2], rtol=1e-12)


def test_a_ball_that_spins_across_a_slope_goes_further_on_and_down():
    """As friction against its slip is weaker: along the path that an own model has."""
    rho, angle = 0.2, 0.2
    ends = []
    for spin in (3.0, 30.0):
        start = ReleasedState(BallState(Omega=(0.0, 0.0, spin)), V=(0.0, 2.0, 0.0))
        run = run_of(start, LimitSurface(MU, rho), [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6], angle)
        pressed = G * np.cos(angle)

        def motion(_, y, pressed=pressed):
            slide = np.append(y[:2], rho * y[2])
            push = -MU * pressed * slide / np.linalg.norm(slide)
            down = np.array([G * np.sin(angle), 0.0])
            return np.concatenate([down + 3.5 * push[:2], [2.5 * rho * push[2] / R**2], down + push[:2], y[3:5]])

        first = [0.0, 2.0, spin, 0.0, 2.0, 0.0, 0.0]
        model = solve_ivp(motion, (0.0, 0.6), first, method="DOP853", rtol=1e-13, atol=1e-14, t_eval=run.times)
        moving = np.asarray(run.contact.mode) == Mode.SLIDING
        assert moving.sum() >= 3
        np.testing.assert_allclose(run.state.z[moving], model.y[5:, moving].T, rtol=0, atol=CLOSE)
        np.testing.assert_allclose(omega_of(run)[moving, 2], model.y[2, moving], rtol=0, atol=CLOSE)
        ends.append(run.state.z[-4])  # at 0.3
    assert np.all(ends[1] > ends[0] + 0.002)


def test_a_small_radius_is_coulombs_law():
    """The difference falls as the square of the radius; and without spin there is none."""
    laws = MU, LimitSurface(MU, 0.02), LimitSurface(MU, 0.01)
    coulomb, wide, narrow = (run_of(THROWN, law, [0.0, 0.3]) for law in laws)
    differences = [np.linalg.norm(run.state.z[-1] - coulomb.state.z[-1]) for run in (wide, narrow)]
    assert 3.0 < differences[0] / differences[1] < 4.5
    assert differences[1] < 1e-3
    straight = ReleasedState(BallState(Omega=(0.3, -1.0, 0.0)), V=(1.4, 0.5, 0.0))
    one, other = (run_of(straight, law, [0.0, 1.0]) for law in (MU, LimitSurface(MU, 0.2)))
    np.testing.assert_allclose(one.state.z, other.state.z, rtol=0, atol=1e-12)
    np.testing.assert_allclose(one.switches.times[0], other.switches.times[0], rtol=0, atol=1e-12)


PUSH, TWIST = np.array([6.0, 2.0]), 3.0


def grows(t, motion, parameters):
    push, twist = parameters
    return Wrench(jnp.append(push * t, 0.0), jnp.stack([0.0 * t, 0.0 * t, twist * t]))


@pytest.mark.parametrize("ratio", [1.0, pytest.param(1.2, marks=pytest.mark.thorough)])
def test_friction_holds_slip_and_spin_as_long_as_both_can_be_held(ratio):
    """A force a t needs the friction 2/7 a t, a torque b t itself; then the slide grows, as an own model has it."""
    rho = 0.3
    needed = np.append(2 / 7 * PUSH, TWIST)  # and TWIST ρ t is the torque
    breaks = MU * ratio * M * G / np.linalg.norm(needed)
    ball = solid(force=FunctionWrench(grows, (jnp.array(PUSH), jnp.array(TWIST * rho))))
    times = np.concatenate([[0.0], breaks + np.linspace(-0.1, 1.0, 12)])
    law = Contact(LimitSurface(MU, rho), static_friction=MU * ratio)
    run = simulate(ball, times, BallState(), contact=law, rtol=1e-11, atol=1e-11, throw=True)
    np.testing.assert_allclose(run.switches.times[:1], breaks, rtol=1e-11)
    held, late = times < breaks, times > breaks
    np.testing.assert_allclose(slide_of(run, rho)[held], 0.0, rtol=0, atol=1e-15)
    gains = np.array([3.5 / M, 3.5 / M, 2.5 * rho**2 / (M * R**2)])

    def motion(t, s):
        return gains * (needed * t - MU * M * G * s / np.linalg.norm(s))

    def first(x):
        return np.append(motion(breaks, x[:3]) - x[3] * x[:3], x[:3] @ x[:3] - 1)

    sigma = fsolve(first, np.append(needed / np.linalg.norm(needed), 0.1), xtol=1e-12)[:3] if ratio > 1 else needed
    start = 1e-13 * sigma / np.linalg.norm(sigma)
    model = solve_ivp(motion, (breaks, times[-1]), start, "Radau", times[late], rtol=1e-11, atol=1e-15)
    np.testing.assert_allclose(slide_of(run, rho)[late], model.y.T, rtol=0, atol=1e-9)


@pytest.mark.thorough
def test_it_balances_the_energy_with_all_else_that_dissipates():
    """A ball whose mass is uneven is thrown, bounces, slides, and rolls without a spin over the ground."""
    resisted = Resistance(dry=0.01, rolling=0.001, exact=True)
    start = ReleasedState(BallState(Omega=(1.0, 3.0, 6.0)), V=(1.5, 0.7, 0.2), height=0.1)
    law = Contact(LimitSurface(0.25, 0.1), restitution=0.3, slowest=0.1)
    ball = uneven(resistance=resisted)
    run = simulate(ball, np.linspace(0.0, 3.0, 7), start, contact=law, dense=True, throw=True, **FINE)
    assert {int(mode) for mode in run.switches.target[: int(run.switches.count)]} >= {Mode.SLIDING, Mode.ROLLING}
    energy = run.observables.energy + run.energy_losses().total
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-8)
    assert run.contact.mode[-1] == Mode.ROLLING
    np.testing.assert_allclose(omega_of(run)[-1, 2], 0.0, atol=1e-14)


@pytest.mark.thorough
def test_dry_rolling_resistance_acts_besides():
    """Slip, spin and rolling begin at once, under a force that turns and a torque: against an own model."""
    mu, rho, c, force, rate, twist = 0.2, 0.15, 0.03, 14.0, 2.0, 1.2

    def turns(t, motion):
        push = jnp.stack([force * jnp.cos(rate * t), force * jnp.sin(rate * t), 0.0 * t])
        return Wrench(push, jnp.array([0.0, 0.0, twist]))

    def motion(t, y):
        V, omega, N = y[:2], y[2:], M * G
        slide = np.append(V - R * np.array([omega[1], -omega[0]]), rho * omega[2])
        friction = -mu * N * slide / np.linalg.norm(slide)
        rolling = -N * c * R * omega[:2] / np.linalg.norm(omega[:2])
        push = force * np.array([np.cos(rate * t), np.sin(rate * t)])
        turned = np.array([R * friction[1] + rolling[0], -R * friction[0] + rolling[1], rho * friction[2] + twist])
        return np.concatenate([(friction[:2] + push) / M, turned / SOLID])

    times = np.linspace(0.0, 1.0, 11)
    ball = solid(force=FunctionWrench(turns), resistance=Resistance(dry=c, exact=True))
    run = simulate(ball, times, BallState(), contact=Contact(LimitSurface(mu, rho)), rtol=1e-11, atol=1e-11)
    first = fsolve(
        lambda y: y / 1e-7 - motion(0.0, y) / np.linalg.norm(motion(0.0, y)), 1e-7 * np.array([0.8, 0.1, 0.1, 0.5, 0.5])
    )
    model = solve_ivp(motion, (0.0, 1.0), 1e-5 * first, "Radau", times, rtol=1e-11, atol=1e-13)
    found = np.concatenate([np.asarray(run.contact.V)[:, :2], omega_of(run)], axis=1)
    np.testing.assert_allclose(found, model.y.T, rtol=0, atol=1e-9)


@pytest.mark.long
def test_derivatives_by_friction_and_radius_are_exact_beyond_the_end_of_a_slip():
    def place(p):
        law = Contact(LimitSurface(p[0], p[1]))
        run = simulate(uneven(), [0.0, 1.3], THROWN, contact=law, **FINE)
        return jnp.append(run.state.z[-1], run.switches.times[0])

    p = jnp.array([0.3, 0.2])
    np.testing.assert_allclose(jaxball.jit(jax.jacrev(place))(p), jacobian(place, p, 1e-4), rtol=0, atol=1e-8)


@pytest.mark.thorough
def test_a_saved_run_has_its_directions(tmp_path):
    run = run_of(THROWN, LimitSurface(MU, 0.3), [0.0, 1.0])
    loaded = load_run(run.save(tmp_path / "run.npz"))
    np.testing.assert_array_equal(loaded.contact.sigma, run.contact.sigma)
    assert loaded.contact.law.friction_or_law.radius == 0.3
    np.testing.assert_allclose(loaded.observables.dissipation, run.observables.dissipation, rtol=1e-12, atol=1e-15)
    speed = np.linalg.norm(slide_of(run, 0.3), axis=1)
    np.testing.assert_allclose(run.observables.dissipation, MU * M * G * speed, rtol=0, atol=1e-12)


@pytest.mark.thorough
def test_runs_in_a_batch_are_the_same():
    def place(rho):
        return simulate(solid(), [0.0, 1.0], THROWN, contact=Contact(LimitSurface(MU, rho)), **FINE).state.z[-1]

    radii = jnp.array([0.05, 0.1, 0.3])
    np.testing.assert_allclose(jax.vmap(place)(radii), [place(rho) for rho in radii], rtol=0, atol=1e-12)


@pytest.mark.thorough
def test_it_runs_in_float32():
    with enable_x64(False):
        start = ReleasedState(BallState(Omega=(0.3, -1.0, SPIN)), V=(1.4, 0.5, 0.0))
        run = simulate(solid(), [0.0, 0.3, 1.0], start, contact=Contact(LimitSurface(MU, 0.3)), rtol=1e-5, atol=1e-5)
        assert run.ok
        assert run.state.z.dtype == np.float32
        np.testing.assert_allclose(run.switches.times[0], Decay(0.3).end, rtol=1e-4)
        np.testing.assert_allclose(slide_of(run, 0.3)[1], Decay(0.3).after(0.3), atol=1e-4)


@pytest.mark.thorough
def test_a_disk_which_does_not_spin_has_coulombs_law():
    disk, start = Disk(mass=M, inertia=SOLID, radius=R, gravity=G), ReleasedState(DiskState(phidot=2.0), V=(1.0, 0, 0))
    laws = Contact(MU), Contact(LimitSurface(MU, 0.2))
    one, other = (simulate(disk, [0.0, 0.1, 1.0], start, contact=law) for law in laws)
    np.testing.assert_array_equal(one.state.z, other.state.z)


REFUSED = {
    "two frictions against the spin": {"resistance": Resistance(dry_spinning=0.1, exact=True)},
    "hard stops": {"mechanisms": [jaxball.planar_pendulum(0.1, 0.1, drive=jaxball.HardStops(-1.0, 1.0))]},
    "smoothed resistance": {"resistance": Resistance(dry=0.1)},
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_it_cannot_be_solved_with_is_refused(name):
    with refuses(ValueError, "contact"):
        simulate(solid(**REFUSED[name]), [0.0, 1.0], BallState(), contact=Contact(LimitSurface(MU, 0.1)))


@pytest.mark.parametrize(("numbers", "name"), [((0.0, 0.1), "friction"), ((0.3, 0.0), "radius")])
def test_its_numbers_are_positive(numbers, name):
    with refuses(ValueError, f"friction.{name}"):
        Contact(LimitSurface(*numbers))
