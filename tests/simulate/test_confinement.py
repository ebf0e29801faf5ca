"""Masses stay in the body: inside the shell, and those of a disk in its plane; what does not is named."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

import jaxball
from jaxball import Ball, BallState, Disk, DiskState, PointMass, Status, problems, simulate
from jaxball.physics.limits.breaches import compute_furthest
from jaxball.physics.limits.confinement import may_swing_out
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.sentences import said

TIMES = np.linspace(0.0, 2.0, 5)
SHELL = {"mass": 1.0, "inertia": (0.9, 1.0, 1.1)}
FLAT = {"mass": 1.0, "inertia": 1.0}
STILL = jaxball.ConstantRate(0.3)


def helix(theta, pitch):
    return jnp.stack([0.3 * jnp.cos(theta), 0.3 * jnp.sin(theta), pitch * theta])


def outward(t, rate):
    return jnp.stack([rate * t, jnp.zeros_like(t), jnp.zeros_like(t)])


def sideways(t, start):
    """In the plane of a disk until ``start``."""
    return jnp.stack([jnp.full_like(t, 0.2), 0.1 * jnp.maximum(t - start, 0.0) ** 3, jnp.zeros_like(t)])


def accelerate(t, state, rate):
    return jnp.broadcast_to(rate, state.theta.shape)


def ball(motion, **others):
    return Ball(**SHELL, masses=[PointMass(0.5, motion)], **others)


def disk(motion):
    return Disk(**FLAT, masses=[PointMass(0.5, motion)])


TURNED = jaxball.SphericalFrame(0.3, 0.4)
NOT_AT_THE_START = {
    "rail": (
        ball(jaxball.OnRail(jaxball.Circle(0.5, centre=(0.0, 0.0, 0.75)), STILL)),
        "masses[0].motion.rail",
    ),
    "position": (ball(jaxball.Fixed((0.0, 0.0, 1.1))), "masses[0].motion.position"),
    "tube": (
        ball(jaxball.OnRail(jaxball.Tube((1.0, 0.0, 0.0)), jaxball.ConstantRate(1.5))),
        "masses[0].motion.schedule",
    ),
    "rail of a disk": (disk(jaxball.OnRail(jaxball.Circle(0.5, frame=TURNED), STILL)), "masses[0].motion.rail"),
    "tube of a disk": (
        disk(jaxball.OnRail(jaxball.Tube((1.0, 0.1, 0.0)), jaxball.ConstantRate(0.0))),
        "masses[0].motion.rail",
    ),
    "free in a disk": (disk(jaxball.Free(sideways, jnp.asarray(1.0))), "masses[0].motion"),
    "offset of a disk": (Disk(**FLAT, offset=(0.0, 0.1, 0.0)), "offset"),
    "force on a disk": (Disk(**FLAT, force=jaxball.physics.HarmonicForce((0.1, 0.2, 0.0))), "force"),
    "force on a disk that leaves its plane": (
        Disk(**FLAT, force=jaxball.physics.HarmonicForce((0.1, 0.0, 0.0), powers=[(0.0, 0.2, 0.0)])),
        "force",
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("body", "named"), NOT_AT_THE_START.values(), ids=NOT_AT_THE_START.keys())
def test_what_no_body_can_have_is_named(body, named):
    said("\n".join(problems(body, t=TIMES)), named)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["position", "tube of a disk"])
def test_what_no_body_can_have_does_not_start(name):
    body, _ = NOT_AT_THE_START[name]
    run = simulate(body, TIMES)
    assert run.status == Status.IMPOSSIBLE
    assert problems(body, t=TIMES)[0] in run.message
    assert "steps" not in str(run)
    assert run.steps == 0


@pytest.mark.long
@pytest.mark.parametrize(
    ("motion", "when", "furthest"),
    [
        (
            jaxball.OnRail(jaxball.FunctionRail(helix, jnp.asarray(0.9)), jaxball.ConstantRate(0.0, 1.0)),
            np.sqrt(1 - 0.3**2) / 0.9,
            np.hypot(0.3, 1.8),
        ),
        (jaxball.Free(outward, jnp.asarray(0.8)), 1.25, 1.6),
    ],
    ids=["helix", "free"],
)
def test_a_mass_that_leaves_the_shell_does_so_at_its_time(motion, when, furthest):
    body = ball(motion)
    run = simulate(body, TIMES)
    assert run.status == Status.LEFT_SHELL
    np.testing.assert_allclose(run.reached, when, rtol=1e-12)
    wanted = f"but the mass leaves it at t = {when:.6g}, and is {furthest:.6g} from the centre at t = 2."
    assert wanted in problems(body, BallState(), TIMES)[0]
    assert wanted in run.message
    assert problems(body, BallState()) == []
    # The equations do not know where the shell is.
    unbounded = simulate(body, TIMES, inside=False)
    assert unbounded.ok
    # Two programs, whose steps differ by rounding.
    np.testing.assert_allclose(unbounded.state.z, run.state.z, rtol=0, atol=1e-13)
    # It is the mass that counts on an open rail, and it is inside for as long as that.
    assert simulate(body, np.linspace(0.0, 0.99 * when, 5)).ok


def near_the_shell(t, parameters):
    """Circles at 0.9 ± 0.08 from the centre, and goes out for a moment: a bell at ``at`` of width w and a height."""
    at, width, height = parameters
    r = 0.9 + 0.08 * jnp.sin(3 * t) + height * jnp.exp(-(((t - at) / width) ** 2))
    return jnp.stack([r * jnp.cos(t), jnp.zeros_like(t), r * jnp.sin(t)])


@pytest.mark.thorough
def test_a_short_excursion_is_found_wherever_it_is():
    """Of 1/1000 of the run, beyond the shell by 0.001, so that hardly a tenth of that is outside."""
    width, times = 1e-2, np.linspace(0.0, 10.0, 3)

    @jax.jit
    def end_of(parameters):
        run = simulate(ball(jaxball.Free(near_the_shell, parameters)), times)
        return run.reached, run.status

    def distance(t, at, height):
        return 0.9 + 0.08 * np.sin(3 * t) + height * np.exp(-(((t - at) / width) ** 2)) - 1

    for at in np.random.default_rng(0).uniform(1.0, 9.0, 40):
        height = 0.101 - 0.08 * np.sin(3 * at)
        reached, status = end_of((at, width, height))
        assert int(status) == Status.LEFT_SHELL, at
        wanted = scipy.optimize.brentq(distance, at - 5 * width, at, args=(at, height), xtol=1e-14)
        np.testing.assert_allclose(reached, wanted, rtol=0, atol=1e-12)
        # As far as 0.001 within the shell is no alarm.
        assert int(end_of((at, width, height - 0.002))[1]) == Status.SUCCESS, at


@pytest.mark.thorough
def test_an_excursion_between_kinks_is_found_however_short_it_is():
    """A tube along which θ = 1/2, but for 4e-4 of the run: there it rises by a s² = 0.6 with θ̈ = a, −a, −a, a.

    With θ̈ = −a from s on, θ = 0.8 + 0.6 v − 0.3 v² at the time s (1 + v), and 1 at v = 1 − 1/√3.
    """
    short, start = 1e-3, 5.0
    acceleration = 0.6 / short**2
    path = jaxball.PiecewiseAcceleration(
        0.5, start + short * np.array([0.0, 1.0, 3.0, 4.0]), [[acceleration], [-acceleration], [acceleration]]
    )
    body = ball(jaxball.OnRail(jaxball.Tube((1.0, 0.0, 0.0)), path))
    times = np.linspace(0.0, 10.0, 3)
    run = simulate(body, times)
    assert run.status == Status.LEFT_SHELL
    np.testing.assert_allclose(run.reached, start + short * (2 - 1 / np.sqrt(3)), rtol=0, atol=1e-12)
    said(run.message, "masses[0].motion", "5.00142")
    assert problems(body, BallState(), times)[0] in run.message


@pytest.mark.thorough
@pytest.mark.parametrize("height", [2e-8, 1e-9])
def test_a_short_way_aside_from_the_plane_of_a_disk_is_seen(height):
    def aside(t, at):
        return jnp.stack([jnp.full_like(t, 0.2), height * jnp.exp(-(((t - at) / 1e-2) ** 2)), jnp.zeros_like(t)])

    # The plane is as thick as the root of a rounding, 1.5e-8.
    wanted = Status.IMPOSSIBLE if height > 1.5e-8 else Status.SUCCESS
    for at in (2.3456, 7.6543):
        assert simulate(disk(jaxball.Free(aside, jnp.asarray(at))), np.linspace(0.0, 10.0, 3)).status == wanted


def bell(t, at, width=1e-2):
    return jnp.exp(-(((t - at) / width) ** 2))


def push_aside(t, parameters):
    """A force (5, h, 0) N, with h a bell of 1/1000 of the run at its highest; without the 5 nothing before it."""
    along, height, at = parameters
    return jnp.stack([along + 0.0 * t, height * bell(t, at), 0.0 * t])


@pytest.mark.thorough
@pytest.mark.parametrize("along", [0.0, 5.0])
def test_a_short_force_aside_from_the_plane_of_a_disk_is_seen(along):
    times = np.linspace(0.0, 10.0, 3)

    def disk(height, at):
        return Disk(**FLAT, force=jaxball.FunctionForce(push_aside, jnp.array([along, height, at])))

    status = jax.jit(lambda height, at: simulate(disk(height, at), times, max_step=0.1).status)
    for at in np.random.default_rng(0).uniform(1.0, 9.0, 20):
        assert int(status(1e-3, at)) == Status.IMPOSSIBLE, at
        assert int(status(0.0, at)) == Status.SUCCESS
        (sentence,) = problems(disk(1e-3, at), DiskState(), times)
        said(sentence, "force")
    # As far aside as rounding may put it: the root of a rounding, 1.5e-8, of the largest entry.
    assert int(status(1e-8 * along, 7.6543)) == Status.SUCCESS
    assert problems(disk(0.0, 7.6543), DiskState(), times) == []


@pytest.mark.thorough
def test_a_force_aside_between_kinks_is_seen_however_short_it_is():
    def kick(t, start):
        return jnp.stack([0.2 + 0.0 * t, jnp.where((t > start) & (t < start + 1e-5), 1e-3, 0.0), 0.0 * t])

    body = Disk(**FLAT, force=jaxball.FunctionForce(kick, jnp.asarray(7.6543)))
    assert simulate(body, np.linspace(0.0, 10.0, 3)).status == Status.IMPOSSIBLE
    assert simulate(body, np.linspace(0.0, 7.0, 3)).ok


@pytest.mark.thorough
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_ground_that_moves_a_disk_aside_for_a_moment_is_seen(axis):
    times = np.linspace(0.0, 10.0, 3)

    def shaken(t, at):
        return 1e-3 * bell(t, at) * jnp.eye(3)[axis]

    def turned(t, at):
        return 1e-3 * bell(t, at)

    at = jnp.asarray(7.6543)
    frame = jaxball.physics.MovingFrame([jaxball.physics.Turn(np.eye(3)[axis], jaxball.FunctionSchedule(turned, at))])
    plane = jaxball.Ground(motion=jaxball.Free(shaken, at))
    for ground, stays in ((plane, axis != 1), (jaxball.Bowl(20.0, motion=frame), axis == 1)):
        body = Disk(**FLAT, ground=ground)
        found = [sentence for sentence in problems(body, DiskState(), times) if "ground.motion" in sentence]
        assert (found == []) == stays
        assert simulate(body, times).status == (Status.SUCCESS if stays else Status.IMPOSSIBLE)


@pytest.mark.thorough
def test_a_force_in_the_plane_has_its_derivatives():
    """z̈ = F/(m + d/r²) = F/2, so that z = F t²/4."""

    def end(force):
        body = Disk(**FLAT, force=jaxball.physics.HarmonicForce(jnp.stack([force, 0.0, 0.0])))
        return simulate(body, [0.0, 2.0], DiskState()).state.z[-1]

    for mode in (jax.grad, jax.jacfwd):
        np.testing.assert_allclose(mode(end)(0.3), 1.0, rtol=1e-9)


@pytest.mark.thorough
def test_a_mechanism_with_a_prescribed_joint_leaves_between_all_times():
    """A slider that moves a mass at 0.9 by 0.15 for 1/1000 of the run: out from the time w √(ln 1.5) before that on."""

    def reach_out(t, at):
        return 0.15 * jnp.exp(-(((t - at) / 1e-2) ** 2))

    for at in (3.3333, 7.0123):
        slider = jaxball.Slider((0.0, 0.0, 1.0), drive=jaxball.FunctionSchedule(reach_out, jnp.asarray(at)))
        arm = jaxball.Mechanism([slider], [jaxball.CarriedMass(0.1, (0.0, 0.0, 0.9))])
        run = simulate(Ball(**SHELL, mechanisms=[arm]), np.linspace(0.0, 10.0, 3))
        assert run.status == Status.LEFT_SHELL
        np.testing.assert_allclose(run.reached, at - 1e-2 * np.sqrt(np.log(1.5)), rtol=0, atol=1e-12)
        said(run.message, "mechanisms[0]")


def swinging(length=0.6, height=0.5, **others):
    """A pendulum about a point above the centre of a disk of radius 1, which goes out where it swings over the top."""
    hinge = jaxball.Hinge((0.0, 1.0, 0.0), point=(0.0, 0.0, height))
    arm = jaxball.Mechanism([hinge], [jaxball.CarriedMass(0.1, (0.0, 0.0, height - length))])
    return Disk(mass=1.0, inertia=0.5, gravity=9.81, mechanisms=[arm], **others)


OVER_THE_TOP = DiskState(theta=[0.2], thetadot=[16.0])


def first_out(run, length, height):
    """Finds when the pendulum of a dense run is first at the distance 1: |χ|² = h² + l² − 2 h l cos θ."""
    angle = np.arccos((height**2 + length**2 - 1) / (2 * height * length))
    return scipy.optimize.brentq(lambda t: float(run.at(t).theta[0]) - angle, 0.0, 0.3, xtol=1e-14)


@pytest.mark.thorough
@pytest.mark.parametrize("contact", [None, jaxball.Contact(friction=50.0)])
def test_a_pendulum_on_a_free_hinge_leaves_between_saved_times(contact):
    body, times = swinging(), np.array([0.0, 0.3])
    dense = simulate(body, times, OVER_THE_TOP, dense=True, inside=False, rtol=1e-12, atol=1e-12)
    run = simulate(body, times, OVER_THE_TOP, contact=contact)
    # At both times it is inside.
    assert all(np.cos(np.asarray(run.state.theta)[:, 0] - np.pi) < 0.6)
    assert run.status == Status.LEFT_SHELL
    # The tolerance of the run, and the root of a rounding, up to which a mass is inside, over the speed.
    np.testing.assert_allclose(run.reached, first_out(dense, 0.6, 0.5), rtol=0, atol=1e-5)
    # Also of a start that is traced, with the body known.
    solve = jax.jit(lambda rate: simulate(body, times, DiskState(theta=[0.2], thetadot=rate[None]), contact=contact))
    assert [int(solve(rate).status) for rate in (16.0, 1.0)] == [Status.LEFT_SHELL, Status.SUCCESS]


@pytest.mark.thorough
def test_pendulums_of_an_ensemble_leave_between_saved_times():
    lengths = np.array([0.4, 0.5, 0.6, 0.7])
    bodies = jax.vmap(swinging)(jnp.asarray(lengths))
    runs = simulate_ensemble(bodies, np.array([0.0, 0.3]), OVER_THE_TOP, in_axes=(0, None))
    for length, reached, status in zip(lengths, runs.reached, runs.status, strict=True):
        alone = simulate(swinging(length), np.array([0.0, 0.3]), OVER_THE_TOP)
        assert int(status) == alone.status == (Status.LEFT_SHELL if length > 0.5 else Status.SUCCESS)
        np.testing.assert_allclose(reached, alone.reached, rtol=1e-9)


def test_only_hinges_that_are_long_enough_are_watched():
    assert may_swing_out(swinging(0.6))
    assert not may_swing_out(swinging(0.5))
    assert may_swing_out(swinging(0.5, radius=0.9))
    links = [jaxball.Hinge((0.0, 1.0, 0.0)), jaxball.Hinge((1.0, 0.0, 0.0), point=(0.0, 0.0, -0.5))]
    for reach, may in ((0.45, False), (0.55, True)):
        masses = [jaxball.CarriedMass(0.1, (0.0, 0.0, -0.3), joint=0), jaxball.CarriedMass(0.1, (0.3, 0.4 - 0.5, -0.5))]
        masses.append(jaxball.CarriedMass(0.1, (0.0, 0.0, -0.5 - reach)))
        body = Ball(**SHELL, mechanisms=[jaxball.Mechanism(links, masses)])
        assert may_swing_out(body) == may
    # Unknown within `jit` of the body, where it is looked at at saved times, as hinges that cannot get out are.
    seen = []
    jax.jit(lambda length: seen.append(may_swing_out(swinging(length))) or length)(0.6)
    assert seen == [False]


@pytest.mark.thorough
def test_a_mass_that_leaves_among_events_of_the_user():
    """θ = 1/2 + t²/4 passes 0.75 at t = 1, and leaves at √2; the events come before and behind that by name."""
    body = ball(jaxball.Driven(jaxball.Tube((0.0, 0.0, 1.0))), law=jaxball.FunctionLaw(accelerate, jnp.asarray(0.5)))
    events = {
        "rises": jaxball.Event("theta[0]", direction=1, level=0.75),
        "(falls)": jaxball.Event(lambda body, t, state: 0.75 - state.theta[0], direction=-1),
    }
    run = simulate(body, TIMES, BallState(theta=[0.5], thetadot=[0.0]), events=events)
    assert int(run.status) == Status.LEFT_SHELL
    np.testing.assert_allclose(run.reached, np.sqrt(2.0), rtol=0, atol=3e-8)
    for name in events:
        assert int(run.events[name].count) == 1
        np.testing.assert_allclose(run.events[name].times[0], 1.0, rtol=0, atol=1e-9)


@pytest.mark.thorough
def test_a_driven_mass_is_looked_at_at_the_start_and_in_every_step():
    law = jaxball.FunctionLaw(accelerate, jnp.asarray(0.5))
    body = ball(jaxball.Driven(jaxball.Tube((0.0, 0.0, 1.0))), law=law)
    run = simulate(body, TIMES, BallState(theta=[0.5], thetadot=[0.0]))
    # θ = 1/2 + t²/4 is 1 + √ε, up to which a mass is inside, at t = √2 + √(2ε); 1.5 is the first saved time after.
    assert int(run.status) == Status.LEFT_SHELL
    np.testing.assert_allclose(run.reached, np.sqrt(2.0), rtol=0, atol=3e-8)
    said(run.message, "law", "1.0625")
    run = simulate(body, TIMES, BallState(theta=[1.5], thetadot=[0.0]))
    assert run.status == Status.IMPOSSIBLE
    said(run.message, "state.theta")


@pytest.mark.parametrize("seed", range(2))
def test_a_rail_on_the_shell_is_inside(seed):
    rng = np.random.default_rng(seed)
    frame = jaxball.physics.VersorFrame(rng.normal(size=4))
    radius = rng.uniform(0.5, 2.0)
    body = ball(jaxball.OnRail(jaxball.Circle(radius, frame=frame), STILL), radius=radius)
    assert problems(body, BallState(), TIMES) == []
    assert problems(eqx.tree_at(lambda b: b.radius, body, body.radius * (1 - 1e-7)))


@pytest.mark.thorough
def test_the_furthest_point_of_a_rail_is_that_of_its_formula():
    frame, centre = jaxball.physics.VersorFrame((0.3, -0.2, 0.7, 0.5)), np.array([0.1, 0.25, -0.3])
    axis = np.asarray(frame.matrix())[:, 1]
    along = centre @ axis
    rails = {
        "circle": (
            jaxball.Circle(0.4, centre, frame),
            np.hypot(along, 0.4 + np.sqrt(centre @ centre - along**2)),
        ),
        "ellipse": (jaxball.Ellipse((0.3, 0.7), frame=frame), 0.7),
        # The largest a²u + 4b²u(1 − u) with u = cos²θ, at u = (a² + 4b²)/8b².
        "eight": (jaxball.physics.GeronoEight((0.3, 0.8), frame=frame), (0.3**2 + 4 * 0.8**2) / (4 * 0.8)),
        # |ζ| = |cos 40θ| + 1/2 at θ = 0.
        "Fourier": (
            jaxball.FourierRail([[0.0, 0.0, 0.0]] * 39 + [[0.5, 0.0, 0.0]], np.zeros((40, 3)), (0.5, 0, 0)),
            1.0,
        ),
    }
    for name, (rail, wanted) in rails.items():
        np.testing.assert_allclose(compute_furthest(rail).distance, wanted, rtol=1e-9, err_msg=name)
    spline = jaxball.SplineRail(np.random.default_rng(0).uniform(-0.6, 0.6, (7, 3)))
    fine = np.linalg.norm(spline.points(jnp.linspace(0.0, 2 * np.pi, 100_001)), axis=1)
    # The nearest of these is half of a spacing δ = 6e-5 away, which makes δ²/8 of the curve's bend.
    np.testing.assert_allclose(compute_furthest(spline).distance, np.max(fine), rtol=1e-8)


@pytest.mark.long
def test_rows_of_a_batch_have_the_statuses_of_single_runs():
    radii = np.array([0.5, 1.0, 1.5])
    rates = np.array([0.9, 0.4, 0.2])

    def body(radius, rate):
        rail, free = jaxball.Circle(radius), jaxball.Free(outward, rate)
        return Ball(**SHELL, masses=[PointMass(0.5, jaxball.OnRail(rail, STILL)), PointMass(0.5, free)])

    stacked = jax.vmap(body)(jnp.asarray(radii), jnp.asarray(rates))
    states = jax.tree.map(lambda leaf: jnp.stack([leaf] * 3), BallState())
    wanted = [Status.LEFT_SHELL, Status.SUCCESS, Status.IMPOSSIBLE]
    by_vmap = jax.vmap(lambda system: simulate(system, TIMES))(stacked)
    by_lanes = simulate_ensemble(stacked, TIMES, states).trajectory
    for found in (by_vmap, by_lanes):
        np.testing.assert_array_equal(found.status, wanted)
        np.testing.assert_allclose(found.reached, [1 / 0.9, 2.0, 0.0], rtol=1e-12)
    row = jax.tree.map(lambda leaf: leaf[2], by_lanes)
    said(row.message, "1.5")


@pytest.mark.slow
def test_derivatives_are_those_of_the_equations():
    def end(radius, inside):
        rail = jaxball.Circle(radius, frame=TURNED)
        masses = [
            PointMass(0.5, jaxball.OnRail(rail, jaxball.Pulse(0.4))),
            PointMass(0.5, jaxball.Free(outward, radius)),
        ]
        return jnp.sum(simulate(Ball(**SHELL, masses=masses), jnp.asarray([0.0, 1.0]), inside=inside).state.z[-1])

    found, wanted = (
        jax.jit(jax.grad(lambda radius, inside=inside: end(radius, inside)))(0.8) for inside in (True, False)
    )
    np.testing.assert_allclose(found, wanted, rtol=1e-13)
    assert abs(wanted) > 1e-3


def test_numbers_too_large_for_the_arithmetic_are_named():
    body = Ball(mass=1e300, inertia=(0.9, 1.0, 1.1))
    run = simulate(body, TIMES)
    assert run.status == Status.IMPOSSIBLE
    said(run.message, "mass", "1e+300")


@pytest.mark.thorough
def test_a_motion_that_gives_no_place_is_named():
    body = ball(jaxball.Free(outward, jnp.asarray(jnp.nan)))
    run = simulate(body, TIMES)
    assert run.status == Status.IMPOSSIBLE
    said(run.message, "masses[0].motion")
