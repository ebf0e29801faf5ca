"""Bodies of any smooth convex surface, against golden runs, the ellipsoid's own equations, and a model that slips."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxball
from jaxball import (
    Ball,
    BallState,
    Bowl,
    Circle,
    ConstantRate,
    Contact,
    ConvexBody,
    Free,
    Ground,
    OnRail,
    PointMass,
    Resistance,
    Scenario,
    ScenarioError,
    Status,
    planar_pendulum,
    plot,
    read_scenario,
    simulate,
    write_scenario,
)
from jaxball.analysis.verify import check_laws
from jaxball.physics import Ellipsoid, HarmonicForce, Mode, ReleasedState, SupportFunction
from jaxball.physics.classical import EllipsoidState, RollingEllipsoid
from jaxball.plot.view.rolling import rolling_scene
from tests.support.precision import X64
from tests.support.sentences import refuses

AXES = np.array([1.0, 1.3, 0.7])
INERTIA = (0.5, 0.6, 0.7)
Q = np.array([1.0, 0.1, 0.05, -0.02]) / np.linalg.norm([1.0, 0.1, 0.05, -0.02])
OMEGA = np.array([0.4, -0.8, 0.3])
TIGHT = {"rtol": 1e-11, "atol": 1e-11}


def moving(t):
    return jnp.stack([0.3 * jnp.cos(2 * t), 0.25 * jnp.sin(1.5 * t), -0.1 + 0 * t])


def egg(Gamma):
    return jnp.sqrt(jnp.sum((AXES * Gamma) ** 2)) + 0.1 * Gamma[2] ** 3


# By a model in maximal coordinates that knows the surface by its support function alone: q, Ω, z and R at t = 4.
GOLDEN = {
    "ellipsoid on a slope": (
        Ellipsoid(AXES),
        Ground(angle=0.1),
        [0.8583594671, -0.1161355343, 0.4930276251, 0.0815801682, -0.2821793785, 0.2267021491, -0.0013876622],
        [0.7349910892, 0.3644540947],
        [-2.4800043232, -2.1265215570, 14.8574585248],
    ),
    "egg": (
        SupportFunction(egg),
        None,
        [0.9141862897, 0.0410565488, 0.3260313205, 0.2372369398, -0.5809401350, 0.3394097496, -0.1311207047],
        [0.4454551560, 0.1568686150],
        [-2.5943540331, 1.4715232218, 15.2828956969],
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize("case", GOLDEN)
def test_a_body_with_a_moving_mass_inside(case):
    shape, ground, attitude, z, R = GOLDEN[case]
    mass, offset = PointMass(0.4, Free(moving)), (0.05, -0.03, 0.02)
    body = ConvexBody(shape=shape, mass=1.2, inertia=INERTIA, offset=offset, gravity=9.81, masses=[mass], ground=ground)
    run = simulate(body, [0.0, 4.0], BallState(q=Q, Omega=OMEGA), throw=True, **TIGHT)
    end = run.state
    np.testing.assert_allclose(np.concatenate([end.q[-1], end.Omega[-1]]), attitude, rtol=0, atol=1e-9)
    np.testing.assert_allclose(end.z[-1], z, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.observables.contact_force[-1], R, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.observables.contact_point[:, 2], -body.radius, rtol=0, atol=1e-14)


@pytest.mark.thorough
def test_a_rattleback_is_the_rolling_ellipsoid():
    """The body axes of that are those of its surface, of this those of its inertia."""
    numbers = {"mass": 1.0, "inertia": (0.02, 0.16, 0.17), "gravity": 9.81, "offset": (0.0, 0.0, 0.02)}
    numbers["resistance"] = Resistance(rolling=0.02, dry=0.01, smoothing=0.05)
    cosine, sine = np.cos(0.3), np.sin(0.3)
    turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    by_surface, by_inertia = (
        RollingEllipsoid(semiaxes=(0.2, 1.0, 0.15), turn=0.3, **numbers),
        ConvexBody(shape=Ellipsoid((0.2, 1.0, 0.15), turn=-0.3), **numbers),
    )
    start, Omega, times = np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.05, 0.1, -2.0]), np.linspace(0.0, 6.0, 7)
    half = np.array([np.cos(0.15), 0.0, 0.0, np.sin(0.15)])  # the same attitude of the axes of inertia
    expected = simulate(by_surface, times, EllipsoidState(q=start, Omega=Omega), throw=True, **TIGHT)
    run = simulate(by_inertia, times, BallState(q=half, Omega=turn @ Omega), throw=True, **TIGHT)
    np.testing.assert_allclose(run.state.Omega, expected.state.Omega @ turn.T, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.state.z, expected.state.z, rtol=0, atol=1e-9)


def slips(mu, m=1.2, g=9.81):
    """The rates of (q, Ω, V, z) of an ellipsoid that slips, by Newton's and Euler's laws and the second derivative of
    the height at which its centre is.
    """
    J = np.diag(INERTIA)

    def field(t, y):
        (w, *v), Omega, V = y[:4] / np.linalg.norm(y[:4]), y[4:7], y[7:10]
        v = np.array(v)
        hat = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
        Lambda = np.eye(3) + 2 * w * hat + 2 * hat @ hat
        Gamma = Lambda[2]
        h = np.sqrt(np.sum((AXES * Gamma) ** 2))
        arm = AXES**2 * Gamma / h
        bend = np.diag(AXES**2) / h - np.outer(arm, arm) / h
        slip = V - Lambda @ np.cross(Omega, arm)
        along = np.append(-mu * slip[:2] / np.linalg.norm(slip[:2]), 1.0)
        Gammadot = np.cross(Gamma, Omega)
        free, by_force = (np.linalg.solve(J, T) for T in (np.cross(J @ Omega, Omega), np.cross(-arm, Lambda.T @ along)))
        rise = Gammadot @ bend @ Gammadot + arm @ (np.cross(Gammadot, Omega) + np.cross(Gamma, free))
        N = (g + rise) / (1 / m - arm @ np.cross(Gamma, by_force))
        turned = 0.5 * np.append(-v @ Omega, w * Omega + np.cross(v, Omega))
        return np.concatenate([turned, free + N * by_force, N * along / m - [0.0, 0.0, g], V[:2]])

    return field


def released(slip, height=0.0):
    body = ConvexBody(shape=Ellipsoid(AXES), mass=1.2, inertia=INERTIA, gravity=9.81)
    Lambda = BallState(q=Q).Lambda
    V = Lambda @ np.cross(OMEGA, body.shape.arm(Lambda[2])) + np.asarray(slip)
    return body, ReleasedState(BallState(q=Q, Omega=OMEGA), V=V, height=height)


@pytest.mark.thorough
def test_one_that_slips():
    body, start = released((1.5, 0.4, 0.0))
    run = simulate(body, [0.0, 0.25], start, contact=Contact(friction=0.25), throw=True, rtol=1e-10, atol=1e-10)
    assert np.asarray(run.contact.mode).tolist() == [Mode.SLIDING, Mode.SLIDING]
    y = np.concatenate([Q, OMEGA, start.V, [0.0, 0.0]])
    expected = solve_ivp(slips(0.25), (0.0, 0.25), y, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    end = run.state
    found = np.concatenate([end.q[-1], end.Omega[-1], run.contact.V[-1], end.z[-1]])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


@pytest.mark.long
def test_one_that_falls_bounces_and_slips_keeps_its_energy():
    body, start = released((1.5, 0.4, 1.0), height=0.3)
    contact = Contact(friction=0.25, restitution=0.5)
    run = simulate(body, np.linspace(0.0, 4.0, 9), start, contact=contact, throw=True, rtol=1e-9, atol=1e-9)
    assert int(run.contact.switches.count) > 10
    whole = run.observables.energy + run.contact.friction_loss + run.contact.impact_loss
    np.testing.assert_allclose(whole, whole[0], rtol=0, atol=1e-7)
    assert np.min(run.contact.height) > -1e-9
    assert run.observables.contact_point[-1, 2] == pytest.approx(-float(body.radius), abs=1e-9)


@pytest.mark.thorough
def test_derivatives_by_the_surface():
    """As those of the rolling ellipsoid, whose equations are its own."""
    numbers = {"mass": 1.2, "inertia": INERTIA, "gravity": 9.81}

    def end(size):
        body = ConvexBody(shape=Ellipsoid(size * AXES), **numbers)
        return simulate(body, [0.0, 1.0], BallState(q=Q, Omega=OMEGA), **TIGHT).state.z[-1, 0]

    def expected(size):
        body = RollingEllipsoid(semiaxes=size * AXES, **numbers)
        return simulate(body, [0.0, 1.0], EllipsoidState(q=Q, Omega=OMEGA), **TIGHT).state.z[-1, 0]

    np.testing.assert_allclose(jax.grad(end)(1.0), jax.jacfwd(expected)(1.0), rtol=0, atol=1e-9)


def rocking_rate(rate, T, tolerance):
    """The rate after the time T of an ellipsoid that rocks on its lowest point with a small rate at first."""
    body = ConvexBody(shape=Ellipsoid(AXES), mass=1.2, inertia=INERTIA, gravity=9.81)
    start = BallState(Omega=jnp.stack([0 * rate, rate, 0 * rate]))
    return simulate(body, jnp.array([0.0, T]), start, rtol=tolerance, atol=tolerance).state.Omega[-1, 1]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("jit", "differentiate"), [(jax.jit, jax.jacfwd), (jaxball.jit, jax.grad)], ids=["xla", "native"]
)
def test_derivatives_where_it_stands_still(jit, differentiate):
    """It rocks like a pendulum, by the radius of curvature a²/c under a centre at the height c."""
    a, _, c = AXES
    T, frequency = 10.0, np.sqrt(1.2 * 9.81 * (a**2 / c - c) / (INERTIA[1] + 1.2 * c**2))
    derivative = jit(differentiate(rocking_rate))
    for tolerance in (1e-4, 1e-8, 1e-12):
        for rate in (0.0, 1e-9):
            error = derivative(rate, T, tolerance) - np.cos(frequency * T)
            assert abs(error) < 1000 * tolerance


@pytest.mark.any_precision
def test_one_at_rest_stays_there():
    body = ConvexBody(shape=Ellipsoid(AXES), mass=1.2, inertia=INERTIA, gravity=9.81)
    tolerance = 1e-10 if X64 else 1e-6  # the finest of float32 is 9.5e-7
    for contact in (None, Contact(friction=0.3)):
        run = simulate(body, [0.0, 10.0], contact=contact, rtol=tolerance, atol=tolerance, throw=True)
        assert np.all(np.asarray(run.state.Omega) == 0)
        assert np.all(np.asarray(run.state.z) == 0)
        assert int(run.steps) < 10


@pytest.mark.thorough
def test_with_a_pendulum_it_keeps_its_energy():
    body = ConvexBody(
        shape=Ellipsoid(AXES), mass=1.2, inertia=INERTIA, gravity=9.81, mechanisms=[planar_pendulum(0.4, 0.5)]
    )
    start = BallState(q=Q, Omega=OMEGA, theta=[0.8], thetadot=[0.5])
    energy = simulate(body, np.linspace(0.0, 5.0, 6), start, throw=True, **TIGHT).observables.energy
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-9)


def test_its_runs_are_saved(tmp_path):
    """Without the text of a scenario, which files do not have for it; a recording leaves its surface out."""
    body = ConvexBody(shape=Ellipsoid(AXES), mass=1.2, inertia=INERTIA)
    run = simulate(body, [0.0, 0.5, 1.0], BallState(q=Q, Omega=OMEGA))
    for name in ("run.npz", "run.nc"):
        run.save(tmp_path / name)
        loaded = jaxball.load_run(tmp_path / name, body)
        np.testing.assert_array_equal(loaded.state.Omega, run.state.Omega)
    run.save(tmp_path / "run.mcap")
    assert (tmp_path / "run.mcap").stat().st_size > 0
    scenario = Scenario("an egg", body, BallState(q=Q, Omega=OMEGA), np.array([0.0, 1.0]))
    scenario.simulate().save(tmp_path / "whole.nc")
    assert jaxball.load_run(tmp_path / "whole.nc").system.shape.semiaxes.tolist() == list(AXES)


def support(Gamma, height):
    return height + 0.0 * Gamma[0]


FILE = """
format = 1
kind = "convex-body"
body = { mass = 1.2, inertia = [0.5, 0.6, 0.7], gravity = 9.81, offset = [0.05, -0.03, 0.02], shape = SHAPE }
ground = { angle = 0.1 }
initial = { versor = VERSOR, Omega = [0.4, -0.8, 0.3] }
time = { start = 0.0, end = 1.0, step = 1.0 }
"""


ELLIPSOID = '{ kind = "ellipsoid", semiaxes = [1.0, 1.3, 0.7] }'
TURNTABLE = 'turntable = { turning = { kind = "constant-rate", theta = 0.0, rate = 1.0 } }'


def egg_arm(Gamma):
    return jax.grad(egg)(Gamma)


def function_of(name):
    return f'{{ kind = "function", function = "{__name__}:{name}" }}'


def in_file(shape):
    return FILE.replace("SHAPE", shape).replace("VERSOR", str(Q.tolist()))


def test_it_stands_in_files():
    numbers = {"mass": 1.2, "inertia": INERTIA, "gravity": 9.81, "offset": (0.05, -0.03, 0.02), "ground": Ground(0.1)}
    function = f'{{ kind = "function", function = "{__name__}:support", parameters = 0.8 }}'
    for shape, same in (
        ('{ kind = "ellipsoid", semiaxes = [1.0, 1.3, 0.7], turn = 0.2 }', Ellipsoid(AXES, turn=0.2)),
        (function, SupportFunction(support, 0.8)),
    ):
        scenario = read_scenario(in_file(shape))
        run = simulate(ConvexBody(shape=same, **numbers), scenario.times, BallState(q=Q, Omega=OMEGA))
        np.testing.assert_allclose(scenario.simulate().state.z, run.state.z, rtol=0, atol=1e-12)
        assert write_scenario(read_scenario(write_scenario(scenario))) == write_scenario(scenario)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("1.3", "-1.3", "body.shape.semiaxes"),
        ('"ellipsoid"', '"egg"', "body.shape.kind"),
        ("mass = 1.2", "mass = 1.2, radius = 1.0", "body.radius"),
        (ELLIPSOID, function_of("egg_arm"), "body.shape.function"),
        (ELLIPSOID, function_of("support"), "body.shape.function"),
        ("angle = 0.1", 'kind = "bowl", radius = 5.0', "ground"),
        ("angle = 0.1", TURNTABLE, "ground.turntable"),
    ],
)
def test_what_no_file_may_say_of_it(old, new, named):
    text = in_file(ELLIPSOID)
    assert old in text
    with refuses(ScenarioError, named):
        read_scenario(text.replace(old, new))


@pytest.mark.thorough
@pytest.mark.parametrize("contact", [None, Contact(friction=0.1)], ids=["rolling", "contact"])
def test_verify_finds_it_right(contact):
    mass, force = PointMass(0.4, Free(moving)), HarmonicForce((0.3, 0.2, 0.1))
    numbers = {"mass": 1.2, "inertia": INERTIA, "gravity": 9.81, "offset": (0.05, -0.03, 0.02)}
    body = ConvexBody(shape=SupportFunction(egg), masses=[mass], force=force, ground=Ground(angle=0.1), **numbers)
    scenario = Scenario("an egg", body, BallState(q=Q, Omega=OMEGA), np.linspace(0.0, 2.0, 5), contact=contact)
    balances = ["energy"] if contact else ["energy", "momentum", "rolling"]
    report = check_laws(scenario, laws=[*balances, "contact"])
    assert report["contact"].ok  # N > 0, and friction within its limit
    for name in balances:
        assert report[name].residual < 1e-8


@pytest.mark.thorough
def test_a_spinning_egg_rises():
    """A spheroid spun fast on its side rises by sliding friction until it stands on its end, and jumps as it does.

    Jellett's product of its angular momentum and its arm is then kept to the part by which the spin is not infinitely
    fast (H. K. Moffatt & Y. Shimomura, Spinning eggs, Nature 416 (2002) 385–386); that it jumps is seen in experiments
    (T. Mitsui et al., Can a spinning egg really jump?, Proc. R. Soc. A 462 (2006) 2897–2905).
    """
    half = (np.pi / 2 - 0.02) / 2
    inertia = np.array([0.65, 0.65, 0.4])  # of a uniform one with semi-axes 1, 1, 1.5
    egg = ConvexBody(shape=Ellipsoid((1.0, 1.0, 1.5)), mass=1.0, inertia=inertia)
    start = BallState(
        q=(np.cos(half), 0.0, np.sin(half), 0.0), Omega=8.0 * np.array([-np.sin(2 * half), 0.0, np.cos(2 * half)])
    )
    run = simulate(egg, np.linspace(0.0, 60.0, 61), start, contact=Contact(friction=0.1), rtol=1e-8, atol=1e-8)
    Gamma = np.asarray(run.observables.vertical_body)
    heights, arms = jax.vmap(egg.shape.height)(Gamma), jax.vmap(egg.shape.arm)(Gamma)
    jellett = np.sum(inertia * np.asarray(run.state.Omega) * np.asarray(arms), axis=1)
    assert heights[0] < 1.001
    assert heights[-1] > 1.495
    assert np.all(np.abs(jellett / jellett[0] - 1) < 0.03)  # its spin is only eight times √(g/r)
    assert int(Mode.FLIGHT) in run.history.switches.target


@pytest.mark.thorough
def test_a_sphere_is_a_ball():
    mass = PointMass(0.5, OnRail(Circle(0.5), ConstantRate(0.0, 1.0)))
    body = ConvexBody(shape=SupportFunction(lambda Gamma: 0.8), mass=1.0, inertia=INERTIA, masses=[mass])
    ball = Ball(radius=0.8, mass=1.0, inertia=INERTIA, masses=[mass])
    start = BallState(q=Q, Omega=OMEGA)
    ends = [simulate(system, [0.0, 3.0], start, throw=True, **TIGHT).state for system in (body, ball)]
    for one, other in zip(*map(jax.tree.leaves, ends), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)


def test_what_cannot_be():
    numbers = {"mass": 1.0, "inertia": (1.0, 1.0, 1.0)}
    # Where types are checked at run time, their checker may be the first to say so.
    with pytest.raises(TypeError, match=r"`shape` must be a shape, such as Ellipsoid|parameter 'shape'"):
        ConvexBody(shape=1.0, **numbers)
    with pytest.raises(
        TypeError, match=r"`ground` must be a Ground or None under a body that is no|parameter 'ground'"
    ):
        ConvexBody(shape=Ellipsoid(AXES), ground=Bowl(5.0), **numbers)
    with refuses(TypeError, "function"):
        SupportFunction(lambda Gamma: Gamma)
    with refuses(TypeError, "function"):
        SupportFunction(lambda: 1.0)
    dented = ConvexBody(shape=SupportFunction(lambda Gamma: 1 + 0.9 * Gamma[2] ** 4), **numbers)
    assert "`shape` must be convex" in jaxball.problems(dented, BallState(), [0.0, 1.0])[0]
    run = simulate(dented, [0.0, 1.0])
    assert run.status == Status.IMPOSSIBLE


@pytest.mark.thorough
def test_its_surface_is_drawn():
    body = ConvexBody(shape=Ellipsoid((1.0, 1.0, 1.6)), mass=1.0, inertia=(0.6, 0.6, 0.4))
    lines = plot.configuration(body).lines
    # The silhouette of a spheroid that is seen across its axis reaches from end to end of it.
    assert max(np.nanmax(line.get_data_3d()[2]) for line in lines) == pytest.approx(1.6, abs=1e-3)


def test_it_is_shown_where_it_touches_the_plane():
    """In a view: its lowest point is on the floor, and its surface has the extents of an ellipsoid."""
    body = ConvexBody(shape=Ellipsoid(AXES), mass=1.2, inertia=INERTIA, ground=Ground(angle=0.1))
    run = simulate(body, np.linspace(0.0, 2.0, 9), BallState(q=Q, Omega=OMEGA))
    shown = rolling_scene({"": run}, None)
    numbers, up = shown.numbers[0], np.asarray(shown.stand["axes"])[:, 2]
    lowest = (numbers["centre"].values + numbers["foot"].values) @ up
    np.testing.assert_allclose(lowest, -body.radius, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.max(numbers["surface"].values, axis=0), AXES, rtol=1e-12)
