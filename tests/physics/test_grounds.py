"""Balls on curved and moving grounds: balances of momenta, closed forms, and a model written apart."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ellipk

import jaxball
from jaxball import (
    Ball,
    BallState,
    Bowl,
    CarriedMass,
    Detachment,
    Event,
    Free,
    FunctionSchedule,
    Ground,
    HeightField,
    Hinge,
    Mechanism,
    PointMass,
    Pulse,
    Resistance,
    Spring,
    Turntable,
    contact_extremes,
    programs,
    simulate,
)
from jaxball.physics import (
    Cylinder,
    HarmonicForce,
    MovingFrame,
    Paraboloid,
    ParametricSurface,
    SignedDistance,
    SphereOutside,
    TiltingPlane,
    Turn,
    Washboard,
)
from jaxball.simulation.ensemble import simulate_ensemble
from jaxball.simulation.solvers import RadauIIA
from tests.support.differences import slope
from tests.support.on_surfaces import residuals

G = 9.81
SOLID = {"mass": 1.0, "radius": 0.1, "inertia": (0.004, 0.004, 0.004), "gravity": G}
HOMOGENEOUS = {"mass": 1.0, "inertia": (0.4, 0.4, 0.4), "gravity": G}


def path(t, _):
    return jnp.stack([0.5 * jnp.cos(t), 0.4 * jnp.sin(1.1 * t), 0.3 + 0.0 * t])


def hills(t, x, y, _):
    return 0.15 * jnp.sin(0.8 * x) * jnp.cos(0.6 * y) + 0.02 * x**2


def loaded(ground, **others):
    """The ball of the model that was written apart."""
    shell = {"mass": 1.2, "inertia": (0.5, 0.6, 0.7), "offset": (0.1, -0.05, 0.08), "gravity": G}
    return Ball(**shell, masses=[PointMass(0.4, Free(path))], ground=ground, **others)


START = BallState(z=(0.3, -0.2), Omega=(0.4, -0.8, 0.3))
TILT = (
    FunctionSchedule(lambda t, _: 0.2 * jnp.sin(1.3 * t)),
    FunctionSchedule(lambda t, _: 0.15 * jnp.sin(0.9 * t + 0.4)),
)
SHAKEN = Free(lambda t, _: jnp.stack([0.1 * jnp.sin(t), 0.0 * t, 0.05 * jnp.cos(2 * t)]))

# A model written apart, in NumPy, solved by SciPy's DOP853 at 1e-13; its Radau agrees to 1e-10.
GOLDEN = {
    "hills": (
        HeightField(hills),
        {
            "z": (-2.71206791670, -2.27544583722),
            "q": (-0.12265978094, 0.29065948151, -0.91503719928, -0.25135347201),
            "Omega": (-1.83815503385, 0.69529065773, 0.43778446589),
        },
        (-2.59099978237, -2.20339806666, 1.11184681939),
        (2.21860243249, 0.55459006656, 16.39539125511),
        (15.4307803181, 16.5404238580),
    ),
    "tilting plane": (
        TiltingPlane(*TILT, displacement=SHAKEN),
        {
            "z": (7.90551652688, -8.10496462303),
            "q": (0.62465811997, -0.52346732780, -0.29346030643, 0.49966512629),
            "Omega": (2.27228225413, -0.82721345327, -0.48922278894),
        },
        (7.66567554324, -7.64672795248, 3.27702175835),
        (-0.87039381191, 0.94454107016, 8.36326312113),
        (14.9948682499, 8.4436125060),
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", GOLDEN)
def test_runs_agree_with_a_model_written_apart(name):
    ground, state, centre, force, normal = GOLDEN[name]
    run = simulate(loaded(ground), [0.0, 4.0], START, rtol=1e-12, atol=1e-13)
    assert run.ok
    for field, expected in state.items():
        np.testing.assert_allclose(getattr(run.state, field)[-1], expected, atol=1e-9)
    seen = run.observables
    np.testing.assert_allclose(seen.geometric_centre[-1], centre, atol=1e-9)
    np.testing.assert_allclose(seen.contact_force[-1], force, atol=1e-9)
    np.testing.assert_allclose(seen.normal_force, normal, atol=1e-9)


# Residuals are sums of some ten terms of the order of 100.
ROUNDING = 2e-11


def swelling(t, x, y, size):
    return size * jnp.sin(0.8 * x + 0.3 * t) * jnp.cos(0.6 * y) + 0.02 * x**2 * jnp.cos(t)


def moving_frame():
    axes = ((1.0, 0.3, 0.0), (0.0, 1.0, -0.5))
    return MovingFrame([Turn(x, a) for x, a in zip(axes, TILT, strict=True)], SHAKEN, pivot=(0.4, -0.3, 0.2))


def moved(t, x):
    """The same motion, written out by Rodrigues' formula."""
    arm = x - jnp.array([0.4, -0.3, 0.2])
    for axis, angle in (((0.0, 1.0, -0.5), 0.15 * jnp.sin(0.9 * t + 0.4)), ((1.0, 0.3, 0.0), 0.2 * jnp.sin(1.3 * t))):
        n = jnp.array(axis) / np.linalg.norm(axis)
        turned = jnp.cross(n, arm)
        arm = arm * jnp.cos(angle) + turned * jnp.sin(angle) + n * (n @ arm) * (1 - jnp.cos(angle))
    return arm + jnp.array([0.4, -0.3, 0.2]) + jnp.stack([0.1 * jnp.sin(t), 0.0 * t, 0.05 * jnp.cos(2 * t)])


def states(count, seed=1):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        q = rng.normal(size=4)
        yield BallState(q=q / np.linalg.norm(q), Omega=2 * rng.normal(size=3), z=0.5 * rng.normal(size=2))


def require_balances(ball, place, states, torque=None):
    laws = programs.filter_jit(lambda t, state: residuals(ball, t, state, place, torque))
    for t, state in zip((0.3, 1.7), states, strict=True):
        for name, left in laws(jnp.asarray(t), state)._asdict().items():
            assert np.max(np.abs(left)) < ROUNDING, name


def sphere(up):
    def place(t, u1, u2):
        rho = jnp.sqrt(u1**2 + u2**2)
        phi = 2 * jnp.arctan(rho / 6.0)  # R = 3
        across = 3.0 * jnp.sin(phi) / rho
        return jnp.stack([u1 * across, u2 * across, up * 3.0 * (1 - jnp.cos(phi))])

    return place


def around(t, u1, u2):
    """A cylinder of radius 2 about the axis through (1, 2, 3) along (0, 3, 4), where the arc begins at (1, 0, 0)."""
    a, b, c = jnp.array([0.0, 0.6, 0.8]), jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 0.8, -0.6])
    return jnp.array([1.0, 2.0, 3.0]) + u1 * a + 2.0 * (b * jnp.cos(u2 / 2.0) + c * jnp.sin(u2 / 2.0))


def twisted(t, u1, u2, _):
    return jnp.stack([u1 + 0.1 * u2**2, u2 * jnp.cos(0.2 * u1), u2 * jnp.sin(0.2 * u1) + 0.05 * jnp.sin(u2 + t)])


EGG = np.array([3.0, 2.5, 4.0])  # the half axes of an ellipsoid whose third one changes


def breathing(t, x, y, z, axes):
    """Positive inside the ellipsoid about (0.2, −0.1, 4), and no distance."""
    c = jnp.stack([x - 0.2, y + 0.1, z - 4.0]) / (axes * (1.0 + jnp.array([0.0, 0.0, 0.1]) * jnp.sin(t)))
    return 1.0 - c @ c


def along_rays(outside):
    """The same ellipsoid, or the one with sin t = 0 seen from outside, by the length of each ray from its middle."""

    def place(t, u1, u2):
        rho = jnp.sqrt(u1**2 + u2**2)
        phi, up = 2 * jnp.arctan(rho / 6.0), 1.0 if outside else -1.0  # the scale of the coordinates is 3
        e = jnp.stack([u1 / rho * jnp.sin(phi), u2 / rho * jnp.sin(phi), up * jnp.cos(phi)])
        axes = EGG * (1.0 + jnp.array([0.0, 0.0, 0.0 if outside else 0.1]) * jnp.sin(t))
        return jnp.array([0.2, -0.1, 4.0]) + e / jnp.linalg.norm(e / axes)

    return place


def above_hills(t, x, y, z, _):
    return jnp.sinh(z - hills(t, x, y, None)) * (2.0 + jnp.cos(x + 2.0 * z + t))


TUBE = {"axis": (0.0, 3.0, 4.0), "start": (5.0, 0.6, 0.8), "centre": (1.0, 2.0, 3.0)}
SHAPES = {
    "bowl": (Bowl(3.0), sphere(1.0)),
    "sphere": (SphereOutside(3.0), sphere(-1.0)),
    "inside a cylinder": (Cylinder(2.0, **TUBE), around),
    "outside a cylinder": (Cylinder(2.0, outside=True, **TUBE), lambda t, u1, u2: around(t, u1, -u2)),
    "paraboloid": (Paraboloid((0.2, -0.3)), lambda t, x, y: jnp.stack([x, y, 0.1 * x**2 - 0.15 * y**2])),
    "washboard": (
        Washboard(0.1, wavelength=4.0, phase=0.3, heading=0.5),
        lambda t, x, y: jnp.stack([x, y, 0.1 * jnp.sin(jnp.pi / 2 * (x * jnp.cos(0.5) + y * jnp.sin(0.5)) + 0.3)]),
    ),
    "inside an ellipsoid": (
        SignedDistance(breathing, EGG, centre=(0.2, -0.1, 4.0), guess=3.0),
        along_rays(outside=False),
    ),
    "outside an ellipsoid": (
        SignedDistance(lambda t, *c: -breathing(0.0 * t, *c), EGG, centre=(0.2, -0.1, 4.0), guess=3.0),
        along_rays(outside=True),
    ),
    "signed distance": (SignedDistance(above_hills), lambda t, x, y: jnp.stack([x, y, hills(t, x, y, None)])),
    "parametric": (ParametricSurface(twisted), lambda t, u1, u2: twisted(t, u1, u2, None)),
    "tilting plane": (
        TiltingPlane(*TILT, pivot=(0.0, 0.0, 0.0), displacement=SHAKEN),
        lambda t, x, y: jnp.stack([x, y, 0.0 * x]) @ tilt(t).T + SHAKEN(t),
    ),
}


def tilt(t):
    a, b = 0.2 * jnp.sin(1.3 * t), 0.15 * jnp.sin(0.9 * t + 0.4)
    (sa, ca), (sb, cb) = (jnp.sin(a), jnp.cos(a)), (jnp.sin(b), jnp.cos(b))
    first = jnp.array([[1.0, 0.0, 0.0], [0.0, ca, -sa], [0.0, sa, ca]])
    return first @ jnp.array([[cb, 0.0, sb], [0.0, 1.0, 0.0], [-sb, 0.0, cb]])


@pytest.mark.thorough
@pytest.mark.parametrize("name", SHAPES)
def test_momenta_balance_on_each_surface(name):
    ground, place = SHAPES[name]
    require_balances(loaded(ground), place, states(2))


@pytest.mark.long
def test_momenta_balance_with_friction_that_turns_with_the_ground():
    """Viscous and dry rolling friction resist the turning relative to the ground's matter; the torque is written out.

    The surface turns as a rigid body, so its angular velocity is that of its frame.
    """
    resistance = Resistance(rolling=0.3, spinning=0.2, dry=0.05, smoothing=0.1)
    ball = loaded(Bowl(3.0, motion=moving_frame()), resistance=resistance)

    def place(t, u1, u2):
        return moved(t, sphere(1.0)(t, u1, u2))

    def turning_of_frame(t):
        columns = [lambda t, e=e: moved(t, e) - moved(t, jnp.zeros(3)) for e in jnp.eye(3)]
        R, rates = (jnp.stack(x, axis=1) for x in zip(*(jax.jvp(c, (t,), (1.0,)) for c in columns), strict=True))
        W = rates @ R.T
        return jnp.stack([W[2, 1], W[0, 2], W[1, 0]])

    def torque(t, state, N):
        u = state.z
        along = [jax.jvp(lambda x, k=k: place(t, *u.at[k].set(x)), (u[k],), (1.0,))[1] for k in (0, 1)]
        n = jnp.cross(*along)
        n = n / jnp.linalg.norm(n)
        over = state.Lambda @ state.Omega - turning_of_frame(t)
        rolls = over - (over @ n) * n
        return -0.3 * rolls - 0.2 * (over @ n) * n - 0.05 * N * rolls / jnp.sqrt(rolls @ rolls + 0.1**2)

    require_balances(ball, place, states(2), torque)


@pytest.mark.long
def test_momenta_balance_with_a_free_joint_on_a_ground_that_moves_and_deforms():
    """The energy of the spring is not in that of masses, so the power of the joint is left."""
    arm = Mechanism([Hinge((0.0, 1.0, 0.0), drive=Spring(stiffness=2.0))], [CarriedMass(0.3, (0.1, 0.0, -0.5))])
    pull = HarmonicForce((0.3, -0.2, 0.1), amplitude=[(0.5, 0.4, 0.3)], frequency=[1.3])
    ball = loaded(HeightField(swelling, 0.15, motion=moving_frame()), mechanisms=[arm], force=pull)

    def place(t, u1, u2):
        return moved(t, jnp.stack([u1, u2, swelling(t, u1, u2, 0.15)]))

    with_joints = (BallState(state.q, state.Omega, state.z, theta=[0.4], thetadot=[-0.7]) for state in states(2))
    require_balances(ball, place, with_joints)


def bottom(system, t, state):
    return state.z[0]


@pytest.mark.thorough
def test_period_in_a_bowl():
    """The angle φ obeys φ̈ = −ω² sin φ with ω² = 5g / (7 (R − r)): a pendulum, whose period is 4 K(sin(φ₀/2)) / ω."""
    ball, state = Ball(**SOLID, ground=Bowl(1.0)), BallState(z=(2 * np.tan(0.5), 0.0))
    run = simulate(ball, [0.0, 3.0], state, rtol=1e-11, atol=1e-12, events={"bottom": Event(bottom)})
    quarter = ellipk(np.sin(0.5) ** 2) / np.sqrt(5 * G / (7 * 0.9))
    np.testing.assert_allclose(run.events["bottom"].times[:2], [quarter, 3 * quarter], rtol=1e-9)
    energy = run.observables.energy
    np.testing.assert_allclose(energy[-1], energy[0], rtol=1e-9)


@pytest.mark.thorough
def test_ball_leaves_a_sphere():
    """From rest at φ₀, N = 0 where cos φ = (10/17) cos φ₀."""
    ball = Ball(**SOLID, ground=SphereOutside(1.0))
    state = BallState(z=(2 * np.tan(0.05), 0.0))
    run = simulate(ball, [0.0, 5.0], state, rtol=1e-11, atol=1e-12, events={"off": Detachment()})
    assert run.events["off"].count == 1
    phi = 2 * np.arctan(np.linalg.norm(run.events["off"].state.z[0]) / 2)
    np.testing.assert_allclose(np.cos(phi), 10 / 17 * np.cos(0.1), rtol=1e-9)
    times = [0.0, float(run.events["off"].times[0])]
    extremes = contact_extremes(simulate(ball, times, state, rtol=1e-11, atol=1e-12, dense=True))
    np.testing.assert_allclose(extremes.least_normal_force, 0.0, atol=1e-7 * G)
    np.testing.assert_allclose(extremes.least_normal_force_time, times[-1], rtol=1e-12)


@pytest.mark.thorough
def test_golfers_dilemma():
    """In a vertical cylinder, φ̇ is constant and the height oscillates at √(2/7) φ̇.

    Without spin about the normal at the start, z̈ = −5g/7 there, so it does about a height that is 5g/(2φ̇²) lower.
    """
    R, r, rate = 2.0, SOLID["radius"], 4.0
    well = Cylinder(R, axis=(0.0, 0.0, 1.0), start=(1.0, 0.0, 0.0))
    turning = -rate * (R - r) / r  # rolls around on the inside, without spin about the normal
    times = np.linspace(0.0, 5.0, 21)
    ball = Ball(**SOLID, ground=well)
    run = simulate(ball, times, BallState(Omega=(0.0, 0.0, turning)), rtol=1e-11, atol=1e-12)
    w = np.sqrt(2 / 7) * rate
    np.testing.assert_allclose(run.state.z[:, 1], R * rate * times, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(run.state.z[:, 0], -5 * G / 7 / w**2 * (1 - np.cos(w * times)), atol=1e-8)


@pytest.mark.long
def test_turntable_is_a_plane_that_turns():
    """On a plane that turns as a surface, everything is as on a Ground with a turntable."""
    spin = Pulse(0.3, height=2.0, rate=0.5)
    centre = (0.5, -0.2)
    times = np.linspace(0.0, 4.0, 5)
    start = BallState(z=(0.3, -0.2), Omega=(0.4, -0.8, 0.3))
    table = simulate(loaded(Ground(turntable=Turntable(spin, centre))), times, start, rtol=1e-11, atol=1e-12)
    frame = MovingFrame([Turn((0.0, 0.0, 1.0), Pulse(0.0, height=2.0, rate=0.5))], pivot=(*centre, 0.0))
    plane = simulate(loaded(Paraboloid((0.0, 0.0), motion=frame)), times, start, rtol=1e-11, atol=1e-12)
    one, other = table.observables, plane.observables
    lifted = other.geometric_centre - jnp.array([[0.0, 0.0, 1.0]])
    for name, value in (("geometric_centre", lifted), ("contact_force", other.contact_force)):
        np.testing.assert_allclose(getattr(one, name), value, atol=1e-8, err_msg=name)
    for name in ("angular_velocity_body", "kinetic_energy", "power", "contact_momentum", "normal_force"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-8, err_msg=name)


@pytest.mark.long
def test_derivatives_by_parameters_of_a_surface():
    """Reverse derivatives of the end of a run agree with differences."""

    def end(size):
        ground = HeightField(swelling, size, motion=moving_frame())
        return simulate(loaded(ground), [0.0, 1.5], START, rtol=1e-11, atol=1e-12).state.z[-1]

    size = jnp.array(0.15)
    np.testing.assert_allclose(jaxball.jit(jax.jacrev(end))(size), slope(end, size, 1e-4, points=2), rtol=1e-6)


@pytest.mark.thorough
def test_rows_of_an_ensemble_are_runs():
    """Many bowls side by side."""
    radii = jnp.array([0.8, 1.0, 1.5, 3.0])
    state = BallState(z=(0.3, 0.1), Omega=(0.5, -2.0, 1.0))

    def end(R):
        return simulate(Ball(**SOLID, ground=Bowl(R)), [0.0, 1.0], state).state.z[-1]

    balls, starts = jax.vmap(lambda R: (Ball(**SOLID, ground=Bowl(R)), state))(radii)
    ensemble = simulate_ensemble(balls, [0.0, 1.0], starts)
    np.testing.assert_allclose(ensemble.state.z[:, -1], [end(R) for R in radii], atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("form", ["dae", "project"])
def test_every_form_of_a_solve(form):
    """In the differential-algebraic form, by an implicit solver, and with projection the run is the same."""
    options = {"dae": {"solver": RadauIIA(stages=5), "dae": True}, "project": {"project": True}}[form]
    ball, times = loaded(HeightField(swelling, 0.15, motion=moving_frame())), [0.0, 2.0]
    expected = simulate(ball, times, START, rtol=1e-11, atol=1e-12).state
    run = simulate(ball, times, START, rtol=1e-10, atol=1e-11, **options)
    assert run.ok
    np.testing.assert_allclose(run.state.z, expected.z, atol=1e-7)
    np.testing.assert_allclose(run.state.Omega, expected.Omega, atol=1e-7)
