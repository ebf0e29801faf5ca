"""A ball that slips over a surface, leaves it and lands on it, against closed forms and the same motion on a plane."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import jaxball
from jaxball import (
    Ball,
    BallState,
    Bowl,
    Contact,
    Ground,
    HarmonicSeries,
    HeightField,
    Oscillating,
    Pulse,
    Turntable,
    simulate,
)
from jaxball.physics import (
    Cylinder,
    Mode,
    MovingFrame,
    Paraboloid,
    ReleasedState,
    SphereOutside,
    SwitchCause,
    TiltingPlane,
    Turn,
    Washboard,
)
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.differences import jacobian
from tests.support.on_surfaces import time_of_landing

G = 9.81
SOLID = {"mass": 1.0, "radius": 0.1, "inertia": (0.004, 0.004, 0.004), "gravity": G}
UNEVEN = {"mass": 1.2, "radius": 0.4, "inertia": (0.05, 0.06, 0.07), "gravity": G, "offset": (0.04, -0.02, 0.03)}
FINE = {"rtol": 1e-12, "atol": 1e-12}
CLOSE = 1e-9
PHI = 0.3  # from the top of a sphere of radius 1, where balls are released from rest
REACH = 1.0 + SOLID["radius"]


def released(z, V, height=0.0, Omega=(0.0, 0.0, 0.0), q=(1.0, 0.0, 0.0, 0.0)):
    return ReleasedState(BallState(q=q, z=z, Omega=Omega), V=V, height=height)


def off_sphere(**law):
    start = BallState(z=(2 * np.tan(PHI / 2), 0.0))
    run = simulate(
        Ball(**SOLID, ground=SphereOutside(1.0)), np.linspace(0.0, 1.2, 25), start, contact=Contact(**law), **FINE
    )
    assert run.ok
    return run


def angles(run):
    """The angles from the top of the sphere at the switches."""
    z = np.asarray(run.contact.switches.before.body.z)[: int(run.contact.switches.count)]
    return 2 * np.arctan(np.linalg.norm(z, axis=1) / 2)


def require_parabola(run):
    """From the last switch on, the centre flies as every point mass, and the body turns as it did."""
    switches, last = run.contact.switches, int(run.contact.switches.count) - 1
    assert switches.target[last] == Mode.FLIGHT
    t, V = float(switches.times[last]), np.asarray(switches.after.V)[last]
    u = np.asarray(switches.after.body.z)[last]
    phi = 2 * np.arctan(u[0] / 2)
    place = np.array([REACH * np.sin(phi), 0.0, REACH * np.cos(phi) - 1.0])
    later = (np.asarray(run.times) > t)[:, None]
    s = np.asarray(run.times)[:, None] - t
    path = place + V * s + 0.5 * s**2 * np.array([0.0, 0.0, -G])
    np.testing.assert_allclose(np.where(later, run.observables.geometric_centre, path), path, atol=CLOSE)
    Omega = np.asarray(switches.after.body.Omega)[last]
    np.testing.assert_allclose(np.where(later, run.state.Omega, Omega), np.tile(Omega, (s.size, 1)), atol=CLOSE)
    height = np.hypot(path[:, 0], path[:, 2] + 1.0) - REACH
    np.testing.assert_allclose(run.contact.height, np.where(later[:, 0], height, 0.0), atol=CLOSE)


@pytest.mark.thorough
@pytest.mark.parametrize("mu", [0.1, 0.5, 3.0])
def test_a_ball_slips_before_it_leaves_a_sphere(mu):
    """It rolls with N = mg (17 cos φ − 10 cos φ₀)/7 and f = 2/7 mg sin φ until f = μN, and then slides.

    With y = φ̇² along φ, L = R + r and N = m (g cos φ − L y), sliding is y′ = 2 (g sin φ − μN/m)/L, which is linear.
    """
    run = off_sphere(friction=mu)
    assert [int(x) for x in run.contact.switches.cause[:2]] == [SwitchCause.GIVES_WAY, SwitchCause.LIFTS]
    assert int(run.contact.switches.count) == 2
    slips = brentq(lambda x: 2 * np.sin(x) - mu * (17 * np.cos(x) - 10 * np.cos(PHI)), PHI, 1.5)
    # y = A exp(2μφ) + B cos φ + C sin φ
    B, C = np.linalg.solve([[-2 * mu, 1.0], [-1.0, -2 * mu]], [-2 * mu * G / REACH, 2 * G / REACH])
    y = 10 / 7 * G / REACH * (np.cos(PHI) - np.cos(slips))
    A = (y - B * np.cos(slips) - C * np.sin(slips)) * np.exp(-2 * mu * slips)

    def pressed(x):
        return G * np.cos(x) - REACH * (A * np.exp(2 * mu * x) + B * np.cos(x) + C * np.sin(x))

    np.testing.assert_allclose(angles(run), [slips, brentq(pressed, slips, 1.5)], atol=CLOSE)
    require_parabola(run)
    energy = np.asarray(run.observables.energy)
    np.testing.assert_allclose(energy + np.asarray(run.contact.friction_loss), energy[0], atol=1e-10)


@pytest.mark.thorough
def test_a_ball_without_friction_leaves_a_sphere_at_two_thirds():
    run = off_sphere(friction=0.0)
    assert int(run.contact.switches.count) == 1
    np.testing.assert_allclose(np.cos(angles(run)), 2 / 3 * np.cos(PHI), atol=CLOSE)
    require_parabola(run)


@pytest.mark.thorough
def test_a_ball_with_great_friction_rolls_off_a_sphere():
    """In the limit, at cos φ = (10/17) cos φ₀."""
    run = off_sphere(friction=1.0, static_friction=1e9)
    np.testing.assert_allclose(np.cos(angles(run)), 10 / 17 * np.cos(PHI), atol=1e-7)
    require_parabola(run)


@pytest.mark.long
def test_a_plane_that_turns_is_a_turntable():
    """A ball that is dropped on it, bounces, slips and is carried along."""
    spin, centre = Pulse(0.3, height=2.0, rate=0.5), (0.5, -0.2)
    frame = MovingFrame([Turn((0.0, 0.0, 1.0), Pulse(0.0, height=2.0, rate=0.5))], pivot=(*centre, 0.0))
    thrown, law = released((0.3, 0.1), (1.2, 0.5, 1.0), 0.2, (1.0, 2.0, 3.0)), Contact(0.15, 0.2, 0.5, slowest=0.05)
    times = np.linspace(0.0, 2.0, 9)
    # The coordinates on the plane turn with it, by nothing at the start.
    one, other = (
        simulate(Ball(**UNEVEN, ground=ground), times, thrown, contact=law, **FINE)
        for ground in (Ground(turntable=Turntable(spin, centre)), Paraboloid((0.0, 0.0), motion=frame))
    )
    count = int(one.contact.switches.count)
    assert count > 3
    np.testing.assert_allclose(one.contact.switches.times[:count], other.contact.switches.times[:count], atol=CLOSE)
    lifted = np.asarray(other.observables.geometric_centre) - [0.0, 0.0, UNEVEN["radius"]]
    np.testing.assert_allclose(one.observables.geometric_centre, lifted, atol=CLOSE)
    np.testing.assert_allclose(one.contact.V, other.contact.V, atol=CLOSE)
    for field in ("contact_force", "power", "kinetic_energy"):
        np.testing.assert_allclose(
            getattr(one.observables, field), getattr(other.observables, field), atol=1e-8, err_msg=field
        )


def ramp(t, x, y, _):
    """Level, then a hill that ends in a long way down at a slope of 0.5."""
    return -0.25 * (x + jnp.sqrt(x**2 + 0.3)) + 0.4 * jnp.exp(-(x**2) * 2.0)


@pytest.mark.long
def test_a_ball_jumps_from_a_ramp_and_lands_on_a_slope():
    ball = Ball(**SOLID, ground=HeightField(ramp))
    start = BallState(z=(-1.5, 0.0), Omega=(0.0, 45.0, 0.0))
    run = simulate(ball, np.linspace(0.0, 1.5, 31), start, contact=Contact(5.0, restitution=0.4), **FINE)
    switches = run.contact.switches
    sources, targets = (np.asarray(x)[:3].tolist() for x in (switches.source, switches.target))
    lifts = targets.index(Mode.FLIGHT)
    assert sources[lifts + 1] == Mode.FLIGHT
    t, V, u = (np.asarray(x)[lifts] for x in (switches.times, switches.after.V, switches.after.body.z))
    slope = jax.grad(lambda x: ramp(0.0, x, 0.0, None))(u[0])
    n = np.array([-slope, 0.0, 1.0]) / np.hypot(slope, 1.0)
    c = np.array([u[0], 0.0, ramp(0.0, u[0], 0.0, None)]) + 0.1 * n
    assert abs(V @ n) < 1e-12
    # N = 0 where gravity alone bends the path of the centre as the hill does.
    bend = jax.grad(jax.grad(lambda x: ramp(0.0, x, 0.0, None)))(u[0]) / np.hypot(slope, 1.0) ** 3
    np.testing.assert_allclose(V @ V * bend / (1 - 0.1 * bend), -G * n[2], rtol=1e-7)
    np.testing.assert_allclose(
        switches.times[lifts + 1] - t,
        time_of_landing(lambda x: float(ramp(0.0, x, 0.0, None)), c, V, 0.1, G),
        atol=1e-8,
    )
    later = np.asarray(run.times)
    flies = (later > t) & (later < float(switches.times[lifts + 1]))
    s = (later - t)[flies][:, None]
    assert s.size > 3
    path = c + V * s + 0.5 * s**2 * np.array([0.0, 0.0, -G])
    np.testing.assert_allclose(np.asarray(run.observables.geometric_centre)[flies], path, atol=CLOSE)
    energy = np.asarray(run.observables.energy + run.contact.friction_loss + run.contact.impact_loss)
    np.testing.assert_allclose(energy, energy[0], atol=1e-9)


@pytest.mark.thorough
def test_elastic_bounces_in_a_bowl():
    """A smooth bowl keeps the energy, the angular momentum of the centre about its axis, and Ω of the ball."""
    ball, times = Ball(**SOLID, ground=Bowl(1.0)), np.linspace(0.0, 4.0, 41)
    thrown = released((0.3, 0.1), (0.2, 0.5, 0.0), 0.3, (1.0, 2.0, 3.0))
    run = simulate(ball, times, thrown, contact=Contact(0.0, restitution=1.0), max_steps=20_000, **FINE)
    assert int(run.contact.switches.count) > 5
    assert np.all(np.asarray(run.contact.mode) == Mode.FLIGHT)
    c, V = np.asarray(run.observables.geometric_centre), np.asarray(run.contact.V)
    about_axis = c[:, 0] * V[:, 1] - c[:, 1] * V[:, 0]
    np.testing.assert_allclose(about_axis, about_axis[0], atol=1e-10)
    np.testing.assert_allclose(run.observables.energy, run.observables.energy[0], atol=1e-10)
    np.testing.assert_allclose(run.contact.height, 0.9 - np.linalg.norm(c - [0.0, 0.0, 1.0], axis=1), atol=1e-12)
    np.testing.assert_allclose(run.state.Omega, np.tile([1.0, 2.0, 3.0], (41, 1)), atol=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize("outside", [True, False])
def test_a_bounce_in_a_half_pipe_and_on_a_pipe(outside):
    """It falls beside the lowest or highest line, and rebounds with e, and with the impulse that stops its slip.

    That changes the tangential velocity to 5/7 of itself and −2/7 r ω × n more, of a solid ball.
    """
    R, r, e = 1.0, SOLID["radius"], 0.5
    up = 1.0 if outside else -1.0
    reach = R + up * r
    start = (0.0, 0.0, 1.0) if outside else (0.0, 0.0, -1.0)
    ball = Ball(**SOLID, ground=Cylinder(R, start=start, outside=outside))
    phi, drop, V1, spin = 0.4, 0.35, 0.7, np.array([3.0, -2.0, 1.0])
    aside, low = reach * np.sin(phi), up * reach * np.cos(phi)
    c = np.array([0.2, aside, low + drop])
    over = np.array([0.0, c[1], c[2]]) / np.hypot(c[1], c[2])  # from the axis to the foot, or away from it
    arc = R * np.arctan2(over[1], up * over[2])
    height = up * (np.hypot(c[1], c[2]) - reach)
    thrown = released((c[0], arc), (V1, 0.0, 0.0), height, spin)
    falls = np.sqrt(2 * drop / G)
    times = np.array([0.0, falls / 2, falls + 0.01])
    run = simulate(ball, times, thrown, contact=Contact(10.0, restitution=e), **FINE)
    np.testing.assert_allclose(run.observables.geometric_centre[0], c, atol=1e-12)
    np.testing.assert_allclose(run.contact.switches.times[0], falls, atol=CLOSE)
    n = np.array([0.0, np.sin(phi), up * np.cos(phi)]) * up
    V = np.array([V1, 0.0, -G * falls])
    along = V - (V @ n) * n
    after = 5 / 7 * along + 2 / 7 * r * np.cross(spin, n) - e * (V @ n) * n
    np.testing.assert_allclose(run.contact.switches.after.V[0], after, atol=CLOSE)
    at = np.array([0.2 + V1 * falls, aside, low]) + 0.01 * after + 0.5 * 0.01**2 * np.array([0.0, 0.0, -G])
    np.testing.assert_allclose(run.observables.geometric_centre[-1], at, atol=CLOSE)


@pytest.mark.thorough
def test_a_plate_that_goes_down_too_fast_throws_a_ball_up():
    """X₃ = a cos wt, aw² > g: N = 0 at cos wt = g/(aw²), then free flight until it meets the plate again."""
    a, w = 0.2, 10.0
    plate = TiltingPlane(
        displacement=Oscillating(
            HarmonicSeries((0.0, 0.0, 0.0), amplitude=[(0.0, 0.0, a)], frequency=[w], phase=[np.pi / 2])
        )
    )
    ball = Ball(**SOLID, ground=plate)
    # From the lowest place on, where w t = π.
    lifts = (2 * np.pi - np.arccos(G / (a * w**2))) / w
    run = simulate(ball, np.array([np.pi / w, lifts + 0.05, 1.2]), BallState(), contact=Contact(0.3), **FINE)
    switches = run.contact.switches
    np.testing.assert_allclose(switches.times[0], lifts, atol=CLOSE)
    z, v = a * np.cos(w * lifts), -a * w * np.sin(w * lifts)

    def gap(s):
        return z + v * s - 0.5 * G * s**2 - a * np.cos(w * (lifts + s))

    lands = next(s for s in np.linspace(0.05, 1.0, 200) if gap(s) < 0)
    np.testing.assert_allclose(switches.times[1] - lifts, brentq(gap, lands - 0.005, lands, xtol=1e-13), atol=CLOSE)
    assert [int(x) for x in switches.cause[:2]] == [SwitchCause.LIFTS, SwitchCause.LANDS]
    np.testing.assert_allclose(run.contact.height[1], gap(0.05), atol=CLOSE)


WAVES = {"amplitude": 0.1, "wavelength": 2.0, "phase": 0.3}


def over_waves(p, **options):
    """A ball that jumps from wave to wave: its end, and the times of the first switches."""
    amplitude, mu, spin = p
    ball = Ball(**SOLID, ground=Washboard(**(WAVES | {"amplitude": amplitude})))
    start = BallState(z=(-1.2, 0.0), Omega=jnp.stack([0.0 * spin, spin, 0.0 * spin + 1.0]))
    run = simulate(ball, [0.0, 1.0], start, contact=Contact(mu, restitution=0.5), **(FINE | options))
    history = run.contact
    last = [run.state.z[-1], history.V[-1], run.state.Omega[-1], history.friction_loss[-1:]]
    return jnp.concatenate([*last, history.switches.times[:4]])


@pytest.mark.slow
def test_derivatives_through_jumps():
    """Forward and reverse, against differences over six points of runs that are as exact."""
    p, steps = jnp.array([0.1, 0.3, 45.0]), np.array([1e-4, 1e-4, 1e-3])
    differences = jacobian(jaxball.jit(over_waves), p, steps, points=6)
    scale = np.maximum(np.max(np.abs(differences), axis=1, keepdims=True), 1.0)
    forward = jaxball.jit(jax.jacfwd(over_waves))(p)
    assert np.max(np.abs(forward - differences) / scale) < 1e-8
    np.testing.assert_allclose(jaxball.jit(jax.jacrev(over_waves))(p) / scale, forward / scale, atol=1e-11)


AT = np.linspace(0.0, 1.0, 21)  # of runs which share a program


@pytest.mark.long
def test_members_of_an_ensemble_jump_as_they_do_alone():
    start = BallState(z=(-1.2, 0.0), Omega=(0.0, 45.0, 1.0))

    def ball(amplitude):
        return Ball(**SOLID, ground=Washboard(**(WAVES | {"amplitude": amplitude})))

    amplitudes, law = jnp.array([0.08, 0.1, 0.12]), Contact(0.3, restitution=0.5)
    balls, starts = jax.vmap(lambda a: (ball(a), start))(amplitudes)
    many = simulate_ensemble(balls, AT, starts, contact=law)
    for k, amplitude in enumerate(amplitudes):
        run = simulate(ball(amplitude), AT, start, contact=law)
        assert int(run.contact.switches.count) == int(many.contact.switches.count[k]) > 2
        np.testing.assert_allclose(run.state.z[-1], many.state.z[k, -1], atol=1e-10)


@pytest.mark.thorough
def test_a_run_comes_back_from_a_file(tmp_path):
    ball, start = Ball(**SOLID, ground=Washboard(**WAVES)), BallState(z=(-1.2, 0.0), Omega=(0.0, 45.0, 1.0))
    run = simulate(ball, AT, start, contact=Contact(0.3, restitution=0.5))
    jaxball.save(run, tmp_path / "run.nc")
    back = jaxball.load_run(tmp_path / "run.nc")
    for field in ("mode", "V", "height", "slip", "sigma"):
        np.testing.assert_array_equal(getattr(back.contact, field), getattr(run.contact, field), err_msg=field)
    for field in ("contact_force", "geometric_centre", "contact_point", "power", "energy"):
        np.testing.assert_allclose(
            getattr(back.observables, field), getattr(run.observables, field), atol=1e-12, err_msg=field
        )


@pytest.mark.thorough
def test_accelerometer_of_a_ball_that_flies_over_hills():
    """It reads nothing at the centre of a ball in flight, and the reaction over the mass where that touches."""
    ball, start = Ball(**SOLID, ground=Washboard(**WAVES)), BallState(z=(-1.2, 0.0), Omega=(0.0, 45.0, 1.0))
    run = simulate(ball, AT, start, contact=Contact(0.3, restitution=0.5))
    read = run.measured({"a": jaxball.physics.sensors.Accelerometer()})["a"]
    seen, flies = run.observables, np.asarray(run.contact.mode) == Mode.FLIGHT
    assert 3 < flies.sum() < 18
    np.testing.assert_allclose(np.asarray(read)[flies], 0.0, atol=1e-12)
    force = np.linalg.norm(np.asarray(seen.contact_force), axis=1)
    np.testing.assert_allclose(np.linalg.norm(read, axis=1), force, atol=1e-12)
