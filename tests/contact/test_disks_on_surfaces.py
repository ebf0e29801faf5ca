"""A disk that slips over a curve, leaves it and lands on it, against closed forms and its motion along the tangent."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import jaxball
from jaxball import (
    Bowl,
    ConstantRate,
    Contact,
    Disk,
    DiskState,
    FunctionSchedule,
    HeightField,
    simulate,
)
from jaxball.physics import (
    Cylinder,
    MovingFrame,
    Paraboloid,
    ParametricSurface,
    ReleasedState,
    SphereOutside,
    SwitchCause,
    Turn,
    Washboard,
)
from jaxball.plot import animation, report
from tests.support.differences import jacobian
from tests.support.on_surfaces import time_of_landing

G = 9.81
SOLID = {"mass": 1.0, "radius": 0.1, "inertia": 0.005, "gravity": G}
UNEVEN = {"mass": 1.2, "radius": 0.4, "inertia": 0.06, "gravity": G, "offset": (0.04, 0.0, 0.03)}
FINE = {"rtol": 1e-12, "atol": 1e-12}
CLOSE = 1e-9
PHI = 0.3  # from the top of a circle of radius 1, where disks are released from rest


def askew(t, u1, u2, _):
    return jnp.stack([jnp.sinh(u1) + u2**2, u2 * (1 + u1**2), 0.2 * jnp.sin(u1 + 0.4 * t) + 0.1 * u2**2])


@pytest.mark.parametrize(
    "ground",
    [
        Bowl(2.0),
        SphereOutside(2.0),
        Cylinder(2.0, axis=(0.0, 1.0, 0.0)),
        Cylinder(2.0, axis=(0.0, -1.0, 0.0), start=(0.0, 0.0, 1.0), outside=True),
        Cylinder(2.0, axis=(0.8, 0.0, -0.6)),
        Paraboloid((0.3, 50.0)),  # across, more curved than the disk
        ParametricSurface(askew),
        HeightField(
            lambda t, x, y, _: 0.2 * jnp.sin(x), motion=MovingFrame([Turn((0.0, 1.0, 0.0), ConstantRate(0.4))])
        ),
    ],
)
def test_the_nearest_piece_of_a_section_is_under_the_disk(ground):
    """On the normal at z, at any height, the piece that is nearest is the one at z."""
    t, z = jnp.array(0.7), jnp.array(0.6)

    @jax.jit
    def found(height):
        return ground.foot(t, ground.place_of_centre(t, height, z), z + 0.2)

    for height in (0.1, 0.5):
        assert abs(found(height) - z) < 1e-12


def hill(z, **law):
    ground = SphereOutside(1.0)
    run = simulate(
        Disk(**SOLID, ground=ground), np.linspace(0.0, 1.2, 25), DiskState(z=z), contact=Contact(**law), **FINE
    )
    assert run.ok
    return run


@pytest.mark.thorough
def test_a_disk_without_friction_leaves_a_circle_at_two_thirds():
    """N = mg (3 cos φ − 2 cos φ₀); then it flies along the parabola, and turns no more than before."""
    run = hill(2 * np.tan(PHI / 2), friction=0.0)
    switches = run.contact.switches
    assert int(switches.count) == 1
    phi = 2 * np.arctan(float(switches.after.body.z[0]) / 2)
    np.testing.assert_allclose(np.cos(phi), 2 / 3 * np.cos(PHI), atol=1e-11)
    t, V = float(switches.times[0]), np.asarray(switches.after.V[0])
    np.testing.assert_allclose(V @ V, 2 * G * 1.1 * (np.cos(PHI) - np.cos(phi)), rtol=1e-10)
    s = (np.asarray(run.times) - t)[:, None]
    path = 1.1 * np.array([np.sin(phi), 0.0, np.cos(phi)]) - [0.0, 0.0, 1.0] + V * s + 0.5 * s**2 * [0.0, 0.0, -G]
    flies = s[:, 0] > 0
    np.testing.assert_allclose(np.asarray(run.observables.geometric_centre)[flies], path[flies], atol=CLOSE)
    np.testing.assert_allclose(np.asarray(run.contact.height)[flies], np.hypot(path[:, 0], path[:, 2] + 1)[flies] - 1.1)
    np.testing.assert_allclose(run.state.phidot, 0.0, atol=1e-12)
    np.testing.assert_allclose(run.observables.energy, run.observables.energy[0], atol=1e-10)


def wave(x):
    return -0.5 * (x + np.sqrt(x**2 + 0.09))


class AlongHill:
    """The same disk over the curve z = wave(x), in the coordinate x of its foot: the centre is at x + r n.

    With k = I/(m r²) and the centre's speed v, rolling has v² (1 + k)/2 + g c_z constant and the friction
    m g t_z k/(1 + k). N is m (g n_z + v² K), where K is the curvature of the path of the centre.
    """

    r, k = SOLID["radius"], SOLID["inertia"] / SOLID["radius"] ** 2

    def frame(self, x):
        root = np.sqrt(x**2 + 0.09)
        slope, bend = -0.5 * (1 + x / root), -0.045 / root**3
        size = np.hypot(1.0, slope)
        return np.array([1.0, slope]) / size, np.array([-slope, 1.0]) / size, bend / size**3, size

    def centre(self, x):
        return np.array([x, wave(x)]) + self.r * self.frame(x)[1]

    def pressed(self, x, v):
        """N over m."""
        _, n, kappa, _ = self.frame(x)
        return G * n[1] + v**2 * kappa / (1 - self.r * kappa)

    def rolling_speed(self, x, start, speed):
        fallen = self.centre(start)[1] - self.centre(x)[1]
        return np.sqrt(speed**2 + 2 * G * fallen / (1 + self.k))

    def slides(self, x, v, surface_speed, duration, mu):
        """Until N = 0, while the lowest point slips ahead."""

        def rates(t, y):
            tangent, _, kappa, size = self.frame(y[0])
            N = self.pressed(y[0], y[1])
            return [y[1] / (size * (1 - self.r * kappa)), -G * tangent[1] - mu * N, mu * N / self.k]

        def lifts(t, y):
            return self.pressed(y[0], y[1])

        lifts.terminal = True
        return solve_ivp(rates, (0.0, duration), [x, v, surface_speed], "DOP853", events=lifts, rtol=1e-12, atol=1e-13)


@pytest.mark.thorough
def test_a_rolling_disk_slips_on_a_hill_jumps_and_lands():
    mu, e, start, speed = 0.15, 0.3, -1.0, 2.6
    ground = HeightField(lambda t, x, y, _: -0.5 * (x + jnp.sqrt(x**2 + 0.09)))
    disk, own = Disk(**SOLID, ground=ground), AlongHill()
    times = np.linspace(0.0, 1.2, 25)
    run = simulate(disk, times, DiskState(z=start, phidot=-speed / 0.1), contact=Contact(mu, restitution=e), **FINE)
    switches = run.contact.switches
    assert [int(x) for x in switches.cause[:3]] == [SwitchCause.GIVES_WAY, SwitchCause.LIFTS, SwitchCause.LANDS]

    def spare(x):
        v = own.rolling_speed(x, start, speed)
        return mu * own.pressed(x, v) - G * abs(own.frame(x)[0][1]) * own.k / (1 + own.k)

    slips = brentq(spare, -1.0, 0.0, xtol=1e-14)
    np.testing.assert_allclose(switches.before.body.z[0], slips, atol=CLOSE)
    v = own.rolling_speed(slips, start, speed)
    slid = own.slides(slips, v, v, 1.0, mu)
    np.testing.assert_allclose(float(switches.times[1] - switches.times[0]), slid.t[-1], atol=CLOSE)
    x, v, surface_speed = slid.y[:, -1]
    np.testing.assert_allclose(switches.before.body.z[1], x, atol=CLOSE)
    np.testing.assert_allclose(switches.after.body.phidot[1], -surface_speed / 0.1, rtol=CLOSE)
    c, V = own.centre(x), v * own.frame(x)[0]
    np.testing.assert_allclose(np.asarray(switches.after.V[1])[::2], V, atol=CLOSE)
    falls = time_of_landing(wave, np.array([c[0], 0.0, c[1]]), np.array([V[0], 0.0, V[1]]), 0.1, G)
    np.testing.assert_allclose(float(switches.times[2] - switches.times[1]), falls, atol=1e-8)
    # The rebound: −e of the normal velocity, and an impulse along the ground of at most μ times that of the normal.
    foot = float(switches.after.body.z[2])
    tangent, n, *_ = own.frame(foot)
    before = V - np.array([0.0, G * falls])
    slip = before @ tangent - surface_speed
    push = np.clip(-slip / (1 + 1 / own.k), -mu * (1 + e) * abs(before @ n), mu * (1 + e) * abs(before @ n))
    after = (before @ tangent + push) * tangent - e * (before @ n) * n
    np.testing.assert_allclose(np.asarray(switches.after.V[2])[::2], after, atol=1e-7)
    np.testing.assert_allclose(switches.after.body.phidot[2], -(surface_speed - push / own.k) / 0.1, atol=1e-6)
    energy = np.asarray(run.observables.energy + run.contact.friction_loss + run.contact.impact_loss)
    np.testing.assert_allclose(energy, energy[0], atol=1e-9)


@pytest.mark.long
def test_a_disk_is_a_ball_in_a_plane_of_symmetry():
    """On a ground that moves and does not depend on y, a ball with three equal moments jumps as the disk does."""
    frame = MovingFrame(
        [Turn((0.0, 1.0, 0.0), FunctionSchedule(lambda t, _: 0.1 * jnp.sin(3.0 * t)))], pivot=(0.2, 0.0, 0.0)
    )
    ground = HeightField(lambda t, x, y, _: 0.1 * jnp.sin(3 * x + t), motion=frame)
    disk = Disk(**(UNEVEN | {"radius": 0.1, "inertia": 0.006, "offset": (0.02, 0.0, -0.01)}), ground=ground)
    start, V, law = DiskState(phi=0.3, phidot=-20.0, z=0.2), (1.0, 0.0, 0.5), Contact(0.1, restitution=0.4, slowest=0.1)
    times = np.linspace(0.0, 1.0, 11)
    one = simulate(disk, times, ReleasedState(start, V, 0.05), contact=law, max_steps=20_000, **FINE)
    other = simulate(
        disk.embed(), times, ReleasedState(start.in_space(), V, 0.05), contact=law, max_steps=20_000, **FINE
    )
    count = int(one.contact.switches.count)
    assert count == int(other.contact.switches.count) > 2
    np.testing.assert_allclose(one.contact.switches.times[:count], other.contact.switches.times[:count], atol=1e-8)
    for field in ("V", "height", "slip", "friction_loss", "impact_loss"):
        np.testing.assert_allclose(getattr(one.contact, field), getattr(other.contact, field), atol=1e-7, err_msg=field)
    np.testing.assert_allclose(one.observables.power, other.observables.power, atol=1e-5)


WAVES = {"amplitude": 0.1, "wavelength": 2.0, "phase": 0.3}


def over_waves(p):
    """A disk that jumps from wave to wave: its end, and the times of the first switches."""
    amplitude, mu, spin = p
    disk = Disk(**SOLID, ground=Washboard(**(WAVES | {"amplitude": amplitude})))
    run = simulate(disk, [0.0, 1.0], DiskState(z=-1.2, phidot=-spin), contact=Contact(mu, restitution=0.5), **FINE)
    history = run.contact
    last = [run.state.z[-1:], history.V[-1, ::2], run.state.phidot[-1:], history.friction_loss[-1:]]
    return jnp.concatenate([*last, history.switches.times[:3]])


@pytest.mark.long
def test_derivatives_through_jumps():
    """Forward and reverse, against differences over six points of runs that are as exact."""
    p, steps = jnp.array([0.1, 0.3, 40.0]), np.array([1e-4, 1e-4, 1e-3])
    differences = jacobian(jaxball.jit(over_waves), p, steps, points=6)
    scale = np.maximum(np.max(np.abs(differences), axis=1, keepdims=True), 1.0)
    forward = jaxball.jit(jax.jacfwd(over_waves))(p)
    assert np.max(np.abs(forward - differences) / scale) < 1e-8
    np.testing.assert_allclose(jaxball.jit(jax.jacrev(over_waves))(p) / scale, forward / scale, atol=1e-11)


@pytest.mark.thorough
def test_a_run_comes_back_from_a_file_and_is_drawn(tmp_path):
    disk = Disk(**SOLID, ground=Washboard(**WAVES))
    run = simulate(disk, np.linspace(0.0, 1.0, 21), DiskState(z=-1.2, phidot=-40.0), contact=Contact(0.3), **FINE)
    assert int(run.contact.switches.count) > 1
    jaxball.save(run, tmp_path / "run.nc")
    back = jaxball.load_run(tmp_path / "run.nc")
    for field in ("mode", "V", "height", "slip", "sigma"):
        np.testing.assert_array_equal(getattr(back.contact, field), getattr(run.contact, field), err_msg=field)
    np.testing.assert_allclose(back.observables.geometric_centre, run.observables.geometric_centre, atol=1e-12)
    for draw in (report.overview, animation.snapshot):
        assert draw(run).axes
