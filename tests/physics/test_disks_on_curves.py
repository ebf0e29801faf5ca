"""Disks on curves: Lagrange's equations in minimal coordinates, closed forms, and balls in planes of symmetry."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ellipk

from jaxball import (
    Bowl,
    CarriedMass,
    ConstantRate,
    Detachment,
    Disk,
    DiskState,
    Event,
    Free,
    FunctionSchedule,
    HeightField,
    Hinge,
    Mechanism,
    PointMass,
    Resistance,
    Spring,
    Status,
    observe,
    problems,
    simulate,
)
from jaxball.physics import (
    Cylinder,
    HarmonicForce,
    MovingFrame,
    Paraboloid,
    ParametricSurface,
    SphereOutside,
    TiltingPlane,
    Turn,
    Washboard,
    vector_field,
)
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.differences import slope

G = 9.81
SOLID = {"mass": 1.0, "radius": 0.1, "inertia": 0.005, "gravity": G}
FORCE, SPRING, ROLLING, ARM = jnp.array([0.7, 0.0, -0.4]), 2.0, 0.3, (0.03, 0.0, -0.05)


def path(t, _):
    return jnp.stack([0.05 * jnp.cos(t), 0.0 * t, 0.03 * jnp.sin(2 * t)])


def loaded(ground):
    """A disk with everything: an offset, a mass in prescribed motion, a free hinge with a spring, force, resistance."""
    arm = Mechanism([Hinge((0.0, 1.0, 0.0), drive=Spring(stiffness=SPRING))], [CarriedMass(0.3, ARM)])
    return Disk(
        **SOLID,
        offset=(0.02, 0.0, -0.03),
        masses=[PointMass(0.4, Free(path))],
        mechanisms=[arm],
        ground=ground,
        force=HarmonicForce(FORCE),
        resistance=Resistance(rolling=ROLLING),
    )


class Lagrange:
    """Lagrange's equations for the same disk in s, φ and the angle of the hinge, with one constraint: no slip.

    ``curve(t, s)`` is the ground in the plane of e1 and e3, to the right of which s grows, and above which the disk is.
    """

    def __init__(self, curve):
        self.curve, self.r = curve, SOLID["radius"]

    def tangent(self, s, t):
        along = jax.jvp(lambda s: self.curve(t, s), (s,), (1.0,))[1]
        return along / jnp.sqrt(along @ along)

    def normal(self, s, t):
        return jnp.array([[0.0, -1.0], [1.0, 0.0]]) @ self.tangent(s, t)

    def centre(self, s, t):
        return self.curve(t, s) + self.r * self.normal(s, t)

    def masses(self, y, t):
        """The masses and their places in the plane."""
        s, phi, theta = y
        (x, _, z), (c, n) = ARM, (jnp.cos(theta), jnp.sin(theta))
        turned = jnp.stack([x * c + z * n, z * c - x * n])
        body = jnp.stack([jnp.array([0.02, -0.03]), path(t, None)[::2], turned])
        axes = jnp.array([[jnp.cos(phi), jnp.sin(phi)], [-jnp.sin(phi), jnp.cos(phi)]])
        return jnp.array([1.0, 0.4, 0.3]), self.centre(s, t)[None] + body @ axes

    def velocities(self, y, ydot, t):
        return jax.jvp(lambda y, t: self.masses(y, t)[1], (y, t), (ydot, 1.0))[1]

    def lagrangian(self, y, ydot, t):
        (m, x), v = self.masses(y, t), self.velocities(y, ydot, t)
        kinetic = 0.5 * SOLID["inertia"] * ydot[1] ** 2 + 0.5 * m @ jnp.sum(v**2, axis=1)
        return kinetic - G * m @ x[:, 1] - 0.5 * SPRING * y[2] ** 2

    def matter(self, s, t):
        """The velocity of the ground's matter, and the rate at which it turns from e1 to e3."""
        w, slope = jax.jvp(lambda s: jax.jvp(lambda t: self.curve(t, s), (t,), (1.0,))[1], (s,), (1.0,))
        along = jax.jvp(lambda s: self.curve(t, s), (s,), (1.0,))[1]
        return w, self.normal(s, t) @ slope / jnp.sqrt(along @ along)

    def slip(self, y, ydot, t):
        """A disk that turns at φ̇ from e1 to e3 rolls at −r φ̇ over the ground."""
        s, t_ = y[0], t
        moved = jax.jvp(self.centre, (s, t_), (ydot[0], 1.0))[1] - self.matter(s, t)[0]
        return self.tangent(s, t) @ moved + self.r * ydot[1]

    def forces(self, y, ydot, t):
        def power(rates):
            moved = jax.jvp(lambda s: self.centre(s, t), (y[0],), (rates[0],))[1]
            over = ydot[1] - self.matter(y[0], t)[1]
            return FORCE[::2] @ moved - ROLLING * over * rates[1]

        return jax.grad(power)(ydot)

    def accelerations(self, y, ydot, t):
        at, rates = (y, ydot, t), (ydot, jnp.zeros(3), 1.0)
        momentum = jax.grad(self.lagrangian, 1)
        M, A = jax.jacfwd(momentum, 1)(*at), jax.grad(self.slip, 1)(*at)
        f = jax.grad(self.lagrangian)(*at) + self.forces(*at) - jax.jvp(momentum, at, rates)[1]
        drift = jax.jvp(self.slip, at, rates)[1]
        matrix = jnp.block([[M, -A[:, None]], [A[None], jnp.zeros((1, 1))]])
        return jnp.linalg.solve(matrix, jnp.concatenate([f, -drift[None]]))[:3]

    def reaction(self, y, ydot, t):
        yddot = self.accelerations(y, ydot, t)
        a = jax.jvp(self.velocities, (y, ydot, t), (ydot, yddot, 1.0))[1]
        m = self.masses(y, t)[0]
        return m @ a + jnp.array([0.0, G * jnp.sum(m)]) - FORCE[::2]


def hills(t, x, y, _):
    return 0.2 * jnp.sin(3 * x + 0.3 * t) + 0.05 * x**2 * jnp.cos(t) + 0.1 * y**2


TILT = FunctionSchedule(lambda t, _: 0.2 * jnp.sin(1.3 * t))
SHAKEN = Free(lambda t, _: jnp.stack([0.1 * jnp.sin(t), 0.0 * t, 0.05 * jnp.cos(2 * t)]))


def tilted(t, x, z):
    """A point of the moving frame: turned about e2 about (0.4, 0.2), and displaced."""
    a, shift = 0.2 * jnp.sin(1.3 * t), jnp.stack([0.1 * jnp.sin(t), 0.05 * jnp.cos(2 * t)])
    arm, pivot = jnp.stack([x, z]) - jnp.array([0.4, 0.2]), jnp.array([0.4, 0.2])
    return pivot + jnp.array([[jnp.cos(a), jnp.sin(a)], [-jnp.sin(a), jnp.cos(a)]]) @ arm + shift


FRAME = MovingFrame([Turn((0.0, 1.0, 0.0), TILT)], SHAKEN, pivot=(0.4, 0.7, 0.2))


def around(s, R, out):
    return jnp.stack([R * jnp.sin(s / R), out * R * jnp.cos(s / R)])


def twisted(t, u1, u2, _):
    """Coordinates that are stretched, and askew but for the section."""
    return jnp.stack([jnp.sinh(u1) + u2**2, u2 * (1 + u1**2), 0.2 * jnp.sin(u1 + 0.4 * t) + 0.1 * u2**2])


CURVES = {
    "moving hills": (HeightField(hills, motion=FRAME), lambda t, s: tilted(t, s, hills(t, s, 0.0, None))),
    "tilting plane": (
        TiltingPlane(about_e2=TILT, pivot=(0.4, 0.0, 0.2), displacement=SHAKEN),
        lambda t, s: tilted(t, s, 0.0 * s),
    ),
    "washboard": (
        Washboard(0.1, wavelength=4.0, phase=0.3),
        lambda t, s: jnp.stack([s, 0.1 * jnp.sin(jnp.pi / 2 * s + 0.3)]),
    ),
    "parabola": (Paraboloid((0.8, -7.0)), lambda t, s: jnp.stack([s, 0.4 * s**2])),
    "pipe": (Cylinder(0.5, axis=(0.0, 2.0, 0.0)), lambda t, s: around(s, 0.5, -1.0)),
    "other way round": (Cylinder(0.5, axis=(0.0, -1.0, 0.0)), lambda t, s: around(s, 0.5, -1.0)),
    "over a pipe": (
        Cylinder(0.5, axis=(0.0, 1.0, 0.0), start=(0.0, 0.0, 1.0), outside=True),
        lambda t, s: around(s, 0.5, 1.0),
    ),
    "along a pipe": (
        Cylinder(0.5, axis=(0.8, 0.0, -0.6)),
        lambda t, s: jnp.array([0.8, -0.6]) * s + 0.5 * jnp.array([-0.6, -0.8]),
    ),
    "bowl": (Bowl(0.5), lambda t, s: jnp.stack([s, s**2]) / (1 + s**2)),
    "sphere": (SphereOutside(0.5), lambda t, s: jnp.stack([s, -(s**2)]) / (1 + s**2)),
    "parametric": (ParametricSurface(twisted), lambda t, s: twisted(t, s, 0.0, None)[::2]),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", CURVES)
def test_accelerations_and_forces_are_lagranges(name):
    """At random states: φ̈, the hinge, the rate of the coordinate along the curve, N and the friction."""
    ground, curve = CURVES[name]
    disk, oracle, rng = loaded(ground), Lagrange(curve), np.random.default_rng(3)

    @jax.jit
    def compared(t, state):
        y = jnp.stack([state.z, state.phi, state.theta[0]])
        along = jax.grad(lambda rate: oracle.slip(y, jnp.stack([rate, state.phidot, state.thetadot[0]]), t))(0.0)
        rate = -oracle.slip(y, jnp.stack([0.0, state.phidot, state.thetadot[0]]), t) / along
        ydot = jnp.stack([rate, state.phidot, state.thetadot[0]])
        yddot, R = oracle.accelerations(y, ydot, t), oracle.reaction(y, ydot, t)
        n, tangent = oracle.normal(state.z, t), oracle.tangent(state.z, t)
        found, seen = vector_field(disk, t, state), observe(disk, t, state)
        place = oracle.centre(state.z, t)
        left = (found.z - rate, found.phidot - yddot[1], found.thetadot[0] - yddot[2])
        left += (seen.normal_force - R @ n, seen.friction[0] - R @ tangent, seen.friction[1])
        left += (seen.geometric_centre[0] - place[0], seen.geometric_centre[1], seen.geometric_centre[2] - place[1])
        return jnp.stack(left), jnp.max(jnp.abs(yddot))

    for _ in range(4):
        phi, phidot, z, theta, thetadot = rng.normal(size=5) * (3.0, 2.0, 0.3, 1.0, 2.0)
        state = DiskState(phi=phi, phidot=phidot, z=z, theta=[theta], thetadot=[thetadot])
        assert not problems(disk, state, t=0.7)
        left, size = compared(0.7, state)
        assert jnp.max(jnp.abs(left)) < 1e-10 * jnp.maximum(size, 1.0)


def bottom(system, t, state):
    return state.z


@pytest.mark.thorough
def test_wheel_in_a_half_pipe():
    """φ̈ = −ω² sin φ with ω² = g / ((1 + k)(R − r)), k = ½ for a solid disk: the period is 4 K(sin(φ₀/2)) / ω."""
    disk = Disk(**SOLID, ground=HeightField(lambda t, x, y, R: R - jnp.sqrt(R**2 - x**2), 1.0))
    events, start = {"bottom": Event(bottom)}, DiskState(z=np.sin(1.0))
    run = simulate(disk, np.linspace(0.0, 3.0, 7), start, rtol=1e-11, atol=1e-12, events=events)
    quarter = ellipk(np.sin(0.5) ** 2) / np.sqrt(G / (1.5 * 0.9))
    np.testing.assert_allclose(run.events["bottom"].times[:2], [quarter, 3 * quarter], rtol=1e-9)
    np.testing.assert_allclose(run.observables.energy, run.observables.energy[0], rtol=1e-9)


@pytest.mark.thorough
def test_loop_in_a_pipe():
    """A wheel goes round, because a Cylinder has no end; at the top N = m (v²/(R − r) − g), by its energy."""
    ground = Cylinder(1.0, axis=(0.0, 1.0, 0.0), centre=(0.0, 0.0, 1.0))
    disk, speed = Disk(**SOLID, ground=ground), 8.0
    top = {"top": Event(lambda system, t, state: state.z - np.pi)}
    run = simulate(disk, [0.0, 2.0], DiskState(phidot=-speed / 0.1), rtol=1e-11, atol=1e-12, events=top)
    assert run.ok
    seen = observe(disk, run.events["top"].times[0], jax.tree.map(lambda x: x[0], run.events["top"].state))
    square = speed**2 - 2 * G * 2 * 0.9 / 1.5
    np.testing.assert_allclose(seen.normal_force, square / 0.9 - G, rtol=1e-9)


@pytest.mark.thorough
def test_wheel_leaves_a_sphere():
    """From rest at φ₀, N = 0 where cos φ = 2 cos φ₀/(3 + k): of N = m g cos φ − m v²/(R + r) and the energy."""
    disk, start = Disk(**SOLID, ground=SphereOutside(1.0)), 0.1
    state = DiskState(z=2 * np.tan(start / 2))
    run = simulate(disk, [0.0, 5.0], state, rtol=1e-11, atol=1e-12, events={"off": Detachment()})
    phi = 2 * np.arctan(run.events["off"].state.z[0] / 2)
    np.testing.assert_allclose(np.cos(phi), 2 * np.cos(start) / 3.5, rtol=1e-9)


@pytest.mark.thorough
def test_disk_is_a_ball_in_a_plane_of_symmetry():
    """On a ground that does not depend on y, the ball with three equal moments stays in the plane, and agrees."""
    disk = loaded(HeightField(lambda t, x, y, _: hills(t, x, 0.0, None)))
    start, times = DiskState(phi=0.3, phidot=-2.0, z=0.4, theta=[0.1], thetadot=[0.5]), np.linspace(0.0, 2.0, 5)
    one = simulate(disk, times, start, rtol=1e-11, atol=1e-12)
    other = simulate(disk.embed(), times, start.in_space(), rtol=1e-11, atol=1e-12)
    assert one.ok
    np.testing.assert_allclose(one.state.in_space().z, other.state.z, atol=1e-9)
    for name, value in vars(one.observables).items():
        np.testing.assert_allclose(value, getattr(other.observables, name), atol=1e-7, err_msg=name)


@pytest.mark.thorough
def test_rows_of_an_ensemble_and_derivatives():
    def end(amplitude):
        disk = Disk(**SOLID, offset=(0.02, 0.0, -0.03), ground=Washboard(amplitude, wavelength=1.0))
        return simulate(disk, [0.0, 1.0], DiskState(phidot=-9.0), rtol=1e-11, atol=1e-12)

    sizes = jnp.array([0.01, 0.02, 0.03])
    disks, states = jax.vmap(
        lambda size: (
            Disk(**SOLID, offset=(0.02, 0.0, -0.03), ground=Washboard(size, wavelength=1.0)),
            DiskState(phidot=-9.0 + 0 * size),
        )
    )(sizes)
    rows = simulate_ensemble(disks, [0.0, 1.0], states, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(rows.state.z[:, -1], [end(size).state.z[-1] for size in sizes], atol=1e-9)

    def place(size):
        return end(size).state.z[-1]

    np.testing.assert_allclose(jax.jacrev(place)(0.02), slope(place, 0.02, 1e-5, points=2), rtol=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("ground", "status"),
    [
        (HeightField(lambda t, x, y, R: R - jnp.sqrt(R**2 - x**2), 1.0), Status.LEFT_SURFACE),
        (HeightField(lambda t, x, y, _: 200 * x**4), Status.WEDGED),
    ],
)
def test_ends_of_curves(ground, status):
    run = simulate(Disk(**SOLID, ground=ground), [0.0, 3.0], DiskState(phidot=-60.0))
    assert run.status == status


@pytest.mark.parametrize(
    ("ground", "name"),
    [
        (HeightField(lambda t, x, y, _: x * y), "ground"),
        (Washboard(0.1, wavelength=4.0, heading=0.3), "ground"),
        (Cylinder(1.0, axis=(0.3, 1.0, 0.0)), "ground"),
        (TiltingPlane(about_e1=FunctionSchedule(lambda t, _: 0.1 * t**4)), "ground.motion"),
        (Bowl(1.0, motion=MovingFrame([Turn((0.1, 1.0, 0.0), ConstantRate(0.0, rate=1.0))])), "ground.motion"),
    ],
)
def test_grounds_off_the_plane_of_a_disk(ground, name):
    disk = Disk(**SOLID, ground=ground)
    assert any(f"`{name}` must be" in sentence for sentence in problems(disk, DiskState(), t=[0.0, 1.0]))
    assert simulate(disk, [0.0, 1.0]).status == Status.IMPOSSIBLE


def test_across_the_plane_a_ground_may_be_curved_as_it_likes():
    """A valley across, more curved than the disk, which touches its bottom alone."""
    assert not problems(Disk(**SOLID, ground=Paraboloid((0.0, 50.0))), DiskState(), t=[0.0, 1.0])
