"""Arguments of the wrong kind, each refused in a sentence that names it, what it got, and the way out."""

import math

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import BallState, Circle, ConstantRate, Driven, FunctionRail, OnRail, PointMass, Pulse
from jaxball.chaos import chart, lyapunov_spectrum, lyapunov_spectrum_of, poincare_map
from jaxball.classical import FreeRigidBody, FunctionAxis, ParticleState, RigidBodyState, VakonomicState
from jaxball.ensemble import simulate_ensemble
from jaxball.stability import permanent_rotations, steady_rolling

pytestmark = pytest.mark.usefixtures("no_type_checks")

SHELL = {"mass": 1.0, "inertia": (0.5, 0.6, 0.7)}
BALL = jaxball.Ball(**SHELL)
RAIL, PULSE = Circle(0.5), Pulse(0.0)
TIMES = [0.0, 1.0]
ZEROS = jnp.zeros(3)


def on_rail(rail=RAIL):
    return PointMass(0.5, OnRail(rail, PULSE))


def driven(law):
    return jaxball.Ball(**SHELL, masses=[PointMass(0.5, Driven(RAIL)), PointMass(0.5, Driven(RAIL))], law=law)


def run(**changed):
    return jaxball.simulate(**{"system": BALL, "times": TIMES} | changed)


def run_driven(law):
    return run(system=driven(law), state=BallState(theta=[0.0, 0.0], thetadot=[0.0, 0.0]))


def scenario():
    return jaxball.Scenario("a title", BALL, BallState(), np.asarray(TIMES))


GROUNDS = [
    (lambda: jaxball.Ball(**SHELL, ground="bowl"), "`ground` must be a Ground, a surface.*but it is 'bowl'"),
    (lambda: jaxball.Bowl(3.0, motion="up"), "`motion` must be a MovingFrame or None, but it is 'up'"),
    (lambda: jaxball.Turn((0.0, 0.0, 1.0), 2.0), "`angle` must be a schedule.*but it is 2.0"),
    (lambda: jaxball.MovingFrame([PULSE]), r"`turns\[0\]` must be a Turn, but it is a Pulse"),
    (lambda: jaxball.MovingFrame(displacement=RAIL), "`displacement` must be a motion.*but it is a Circle"),
    (lambda: jaxball.TiltingPlane(0.1), "`about_e1` must be a schedule.*but it is 0.1"),
    (lambda: jaxball.Cylinder(1.0, outside=1), "`outside` must be True or False, but it is 1"),
]
MOTIONS = [
    (lambda: OnRail(RAIL, 0.3), "`schedule` must be a schedule.*but it is 0.3; .*ConstantRate"),
    (lambda: OnRail(RAIL, jaxball.RecordedSignal([0.0, 1.0], [0.0, 1.0])), "must be a schedule.*is a RecordedSignal"),
    (lambda: OnRail(PULSE, RAIL), r"`rail` must be a rail.*but it is a Pulse; the rail comes first"),
    (lambda: OnRail(Circle, PULSE), r"`rail` must be a rail.*the class Circle; make one with Circle\(\.\.\.\)"),
    (lambda: Driven(0.5), "`rail` must be a rail.*but it is 0.5"),
    (lambda: PointMass(1.0, RAIL), r"`motion` must be a motion.*but it is a Circle; OnRail\(rail, schedule\) is one"),
    (lambda: PointMass("heavy", OnRail(RAIL, PULSE)), "`mass` must be numbers, but it is 'heavy'"),
    (lambda: PointMass([1.0, 2.0], OnRail(RAIL, PULSE)), r"`mass` must be a single number, but its shape is \(2,\)"),
    (lambda: jaxball.Oscillating([0.1, 0.0, 0.0]), "`path` must be a HarmonicSeries"),
    (lambda: jaxball.Oscillating(jaxball.HarmonicSeries(0.1)), r"`path.constant` must be 3 numbers.*\(\)"),
    (lambda: jaxball.Fixed(0.3), r"`position` must be 3 numbers, but its shape is \(\)"),
    (lambda: Circle([0.5, 0.6]), r"`radius` must be a single number, but its shape is \(2,\)"),
    (lambda: Circle(0.5, centre=0.1), r"`centre` must be 3 numbers"),
    (lambda: Circle(0.5j), "`radius` must be numbers, but it is 0.5j"),
    (lambda: Circle("0.5"), "`radius` must be numbers, but it is '0.5'"),
    (lambda: Circle(None), "`radius` must be numbers, but it is None"),
    (
        lambda: Circle(0.5, frame=(0.3, 0.5)),
        r"`frame` must be a frame, such as SphericalFrame\(...\), but it is the tup",
    ),
    (lambda: jaxball.Ellipse(0.5), r"`semi_axes` must be 2 numbers, but its shape is \(\)"),
    (lambda: jaxball.GeronoEight([0.5, 0.2, 0.1]), "`half_extents` must be 2 numbers"),
    (lambda: jaxball.BernoulliEight([0.5]), "`half_width` must be a single number"),
    (lambda: jaxball.Tube([0.5, 0.2]), "`direction` must be 3 numbers"),
    (lambda: jaxball.SplineRail([0.5, 0.2]), r"`points_on_rail` must be an array of shape \(n, 3\)"),
    (lambda: jaxball.SphericalFrame([0.5, 0.2], 0.1), "`azimuth` must be a single number"),
    (lambda: jaxball.MatrixFrame([1.0, 0.0, 0.0]), r"`B` must be an array of shape \(3, 3\)"),
    (lambda: jaxball.VersorFrame([1.0, 0.0, 0.0]), "`q` must be 4 numbers"),
    (lambda: Pulse([0.0, 1.0]), "`theta` must be a single number"),
    (lambda: ConstantRate(RAIL), "`theta` must be numbers, but it is a Circle"),
    (lambda: jaxball.Waypoints([0.0, [1.0]], [0.0, 1.0]), "`times` must be numbers, but it is the list"),
    (lambda: jaxball.Servo(PULSE, [1.0], [1.0]), "`targets` must be a list, each item a schedule.*but it is a Pulse"),
    (lambda: jaxball.Servo([PULSE, RAIL], [1.0] * 2, [1.0] * 2), r"`targets\[1\]` must be a schedule.*a Circle"),
    (lambda: jaxball.Servo((PULSE,), [1.0, 2.0], [1.0]), "`stiffness` must be a list of one number"),
    (lambda: jaxball.FollowSchedules((0.3,)), r"`schedules\[0\]` must be a schedule"),
]
BODIES = [
    (lambda: jaxball.Ball(**SHELL, masses=[RAIL]), r"`masses\[0\]` must be a PointMass, but it is a Circle"),
    (
        lambda: jaxball.Ball(**SHELL, masses=on_rail()),
        "`masses` must be a list, each item a PointMass.*is a PointMass",
    ),
    (
        lambda: jaxball.Ball(**SHELL, masses=[PointMass]),
        r"`masses\[0\]` must be a PointMass, but it is the class PointM",
    ),
    (
        lambda: jaxball.Ball(**SHELL, force=[0.1, 0.0, 0.0]),
        r"`force` must be a force or None.*HarmonicForce\(constant\)",
    ),
    (lambda: jaxball.Ball(**SHELL, law=math.sin), r"`law` must be a feedback law or None.*FunctionLaw\(function\)"),
    (lambda: jaxball.Ball(mass=None, inertia=(0.5, 0.6, 0.7)), "`mass` must be numbers, but it is None"),
    (lambda: jaxball.Disk(mass=1.0, inertia="d2"), "`inertia` must be numbers, but it is 'd2'"),
    (lambda: jaxball.HarmonicForce(0.3), "`constant` must be 3 numbers"),
    (lambda: FreeRigidBody(inertia="thin"), "`inertia` must be numbers, but it is 'thin'"),
    (lambda: jaxball.Slip([0.3, 0.4]), "`friction` must be a single number"),
    (lambda: driven(jaxball.Servo((PULSE,), [1.0], [1.0])), "`targets` of the law must have 2 entries, one for each"),
    (lambda: driven(jaxball.FollowSchedules((PULSE,))), "`schedules` of the law must have 2 entries, one for each"),
]
FUNCTIONS = [
    (
        lambda: FunctionRail(lambda: ZEROS),
        r"`function` must be a function of \(theta\) or \(theta, parameters\), but the lambda",
    ),
    (lambda: FunctionRail(0.5), r"`function` must be a function of \(theta\) or \(theta, parameters\), but it is 0.5"),
    (
        lambda: FunctionRail(lambda theta, p: (theta, theta, theta)),
        "must give an array of shape.*a tuple of length 3; j",
    ),
    (lambda: FunctionRail(lambda theta, p: jnp.stack([theta, theta])), r"array of shape \(3,\), but it gives .*\(2,\)"),
    (lambda: FunctionRail(lambda theta, p: jnp.array([1, 2, 3])), r"of shape \(3,\) and type int"),
    (lambda: FunctionRail(lambda theta, p: jnp.array([math.cos(theta), 0, 0])), "that JAX can trace"),
    (lambda: jaxball.FunctionSchedule(lambda t, p: jnp.stack([t])), r"must give a single number, .* shape \(1,\)"),
    (lambda: jaxball.FunctionSchedule(lambda t, p: None), "must give a single number, but it gives None"),
    (lambda: jaxball.FunctionForce(lambda t, p: t), r"must give an array of shape \(3,\), but it gives .*shape \(\)"),
    (
        lambda: jaxball.FunctionForce(lambda t: ZEROS, 2.0),
        r"a function of \(t, parameters\), but the lambda given takes \(t\)",
    ),
    (lambda: jaxball.Free(lambda t, p: jnp.zeros(2)), r"must give an array of shape \(3,\)"),
    (lambda: FunctionAxis(lambda t, p: t), r"must give an array of shape \(3,\)"),
    (lambda: jaxball.FunctionLaw(lambda t: ZEROS), r"a function of \(t, state\) or \(t, state, parameters\)"),
    (
        lambda: jaxball.Event(lambda t: t),
        r"`of` must be a function of \(system, t, state\), but the lambda given takes",
    ),
    (lambda: run_driven(jaxball.FunctionLaw(lambda t, state, p: ZEROS)), r"`law` must give an array of shape \(2,\)"),
]
STATES = [
    (lambda: BallState(Omega=[1.0, 2.0]), r"`Omega` must be 3 numbers, but its shape is \(2,\)"),
    (lambda: BallState(q=[1.0, 0.0, 0.0]), "`q` must be 4 numbers"),
    (lambda: BallState(z=0.0), "`z` must be 2 numbers"),
    (lambda: BallState(theta=0.0), "`theta` must be a list of numbers"),
    (lambda: jaxball.RotationState(Lambda=[1.0, 0.0, 0.0]), r"`Lambda` must be an array of shape \(3, 3\)"),
    (lambda: jaxball.ReducedState(Gamma=[0.0, 1.0]), "`Gamma` must be 3 numbers"),
    (lambda: jaxball.DiskState(phi="upright"), "`phi` must be numbers, but it is 'upright'"),
    (lambda: RigidBodyState(Omega=[1.0, 2.0]), "`Omega` must be 3 numbers"),
    (lambda: ParticleState(xdot=BALL), "`xdot` must be numbers, but it is a Ball"),
    (lambda: VakonomicState(multiplier="λ"), "`multiplier` must be numbers"),
    (
        lambda: run(state=BallState(Omega=jnp.ones((4, 3)))),
        r"must be one state, with `Omega` of shape \(3,\), .*\(4, 3\)",
    ),
    (
        lambda: run(state=BallState),
        "`state` must be a BallState, RotationState or ReducedState for a Ball, but it is the class BallState",
    ),
    (
        lambda: run(state=[0.0, 1.0]),
        "`state` must be a BallState, RotationState or ReducedState for a Ball, but it is the list",
    ),
    (
        lambda: run(system=FreeRigidBody(inertia=(1.0, 1.0, 1.0)), state=BALL),
        "`state` must be a RigidBodyState for a Fr",
    ),
]
CALLS = [
    (
        lambda: run(solver="dopri8"),
        r"`solver` must be an adaptive solver, such as diffrax.Dopri8\(\), but it is 'dopri8'",
    ),
    (lambda: run(solver=diffrax.Dopri8), r"`solver` .*the class Dopri8; make one with Dopri8\(...\)"),
    (lambda: run(solver=diffrax.Euler()), "`solver` .*it is an Euler; it has no error estimate.*HalfSolver"),
    (lambda: run(times="0 1"), "`times` must be numbers, but it is '0 1'"),
    (lambda: run(times=["0", "1"]), "`times` must be numbers, but it is the list"),
    (lambda: run(times=None), "`times` must be numbers, but it is None"),
    (lambda: run(rtol="tight"), "`rtol` must be numbers, but it is 'tight'"),
    (lambda: run(atol=[[1e-8], [1e-8, 1.0]]), "`atol` must be numbers"),
    (lambda: run(events=[jaxball.Detachment()]), "`events` must be a dictionary of events by name.*it is the list"),
    (
        lambda: run(events={"lift": jaxball.Detachment}),
        r"`events\['lift'\]` must be an event.*the class Detachment; make",
    ),
    (
        lambda: run(adjoint="forward"),
        r"`adjoint` must be an adjoint, such as diffrax.ForwardMode\(\), but it is 'forward'",
    ),
    (lambda: run(adjoint=diffrax.ForwardMode), r"`adjoint` .*make one with ForwardMode\(...\)"),
    (lambda: run(progress=True), "`progress` must be a progress meter.*but it is True"),
    (lambda: run(max_steps=1e4), "`max_steps` must be a whole number, but it is 10000.0"),
    (lambda: run(max_steps=10**30), "`max_steps` must be at most 1,000,000,000, but it is 1,000,000,000,000,"),
    (lambda: run(max_steps=0), "`max_steps` must be 1 or more, but it is 0"),
    (lambda: run(max_step="long"), "`max_step` must be None or a single number, the longest step, but it is 'long'"),
    (lambda: run(max_step=[0.1, 0.2]), "`max_step` must be None or a single number"),
    (lambda: run(max_step=True), "`max_step` must be None or a single number, the longest step, but it is True"),
    (lambda: run(max_step=0.0), "`max_step` must be positive and finite, but it is 0.0; for no limit, give None"),
    (lambda: run(max_step=float("inf")), "`max_step` must be positive and finite, but it is inf"),
    (lambda: jax.jit(lambda h: run(max_step=h))(0.1), "`max_step` must be a number that is known.*but it is traced"),
    (
        lambda: run(system=jaxball.Ball),
        "`system` must be a Ball, a Disk, one of jaxball.classical or another AbstractSystem.*the class Ball; make",
    ),
    (lambda: run(system=scenario()), "`system` must be a Ball.*but it is a Scenario; its `system` is a Ball"),
    (lambda: jaxball.problems(scenario()), "`system` must be a Ball.*but it is a Scenario"),
    (lambda: scenario().simulate(solver=diffrax.Dopri8()), "`solver` must be a name, one of .*but it is a Dopri8"),
    (lambda: run(dense=True).at("end"), "`t` must be numbers, but it is 'end'"),
    (lambda: jaxball.contact_extremes(BALL), "what jaxball.simulate returns, or `run` of a closed loop, but it is"),
    (lambda: jaxball.balance(scenario(), [0]), "`system` must be a Ball or a Disk, but it is a Scenario"),
    (lambda: jaxball.balance(BALL, 0), "`free` must be a list of indices of masses, but it is 0"),
    (lambda: lyapunov_spectrum(scenario(), TIMES), "`system` must be a Ball.*but it is a Scenario"),
    (lambda: lyapunov_spectrum(BALL, TIMES, solver="dopri8"), "`solver` must be an adaptive solver"),
    (lambda: lyapunov_spectrum(BALL, "long"), "`times` must be numbers"),
    (
        lambda: lyapunov_spectrum(BALL, TIMES, exponents=1.0),
        "`exponents` must be a whole number or None, but it is 1.0",
    ),
    (lambda: lyapunov_spectrum_of(lambda t, x: x, TIMES, [1.0]), r"`field` must be a function of \(t, x, args\)"),
    (lambda: poincare_map(BALL, lambda state: 0.0, TIMES), r"`of` must be a function of \(system, t, state\)"),
    (lambda: chart(lambda a: BALL, {"a": [1.0], "b": [1.0]}, TIMES), r"`make` must be a function of \(first, second\)"),
    (lambda: simulate_ensemble(scenario(), TIMES, BallState()), "`system` must be a Ball.*but it is a Scenario"),
    (lambda: simulate_ensemble(BALL, "0 1", BallState()), "`times` must be numbers, but it is '0 1'"),
    (lambda: simulate_ensemble(BALL, TIMES, BallState(), solver="dopri8"), "`solver` must be an adaptive.*'dopri8'"),
    (lambda: simulate_ensemble(BALL, TIMES, BallState(), reductions=["distance"]), "`reductions` must be a dictionary"),
    (lambda: permanent_rotations(scenario()), "`ball` must be a Ball, but it is a Scenario"),
    (lambda: steady_rolling(jaxball.Disk(mass=1.0, inertia=0.5), 0.1, 1.0), "`ball` must be a Ball, but it is a Disk"),
    (
        lambda: jaxball.design.identify(scenario(), np.zeros((2, 2))),
        "`space` must be a DesignSpace, but it is a Scenario",
    ),
]


@pytest.mark.thorough
@pytest.mark.parametrize(("make", "sentence"), GROUNDS + MOTIONS + BODIES + FUNCTIONS + STATES + CALLS)
def test_refused_in_a_sentence(make, sentence):
    with pytest.raises((TypeError, ValueError), match=sentence) as refused:
        make()
    assert str(refused.value).startswith("Argument `")
    assert str(refused.value).endswith(".")


def test_an_error_inside_a_function_of_the_user_is_left_as_it_is():
    def missing(theta, parameters):
        return parameters["radius"] * jnp.stack([theta, theta, theta])

    with pytest.raises(KeyError, match="radius") as raised:
        FunctionRail(missing, {"raduis": 1.0})
    assert "This came from argument `function`, when it was traced to find the shape of its value." in (
        raised.value.__notes__
    )


def test_checks_leave_transformations_alone():
    def end(radius, start):
        rail = FunctionRail(lambda theta, r: r * jnp.stack([jnp.cos(theta), 0 * theta, jnp.sin(theta)]), radius)
        ball = jaxball.Ball(**SHELL, masses=[PointMass(0.5, OnRail(rail, ConstantRate(start)))])
        return ball.point_masses[0].motion(jnp.asarray(0.0)).sum()

    slopes = jax.vmap(jax.grad(end))(jnp.array([0.4, 0.5]), jnp.array([0.0, math.pi / 2]))
    np.testing.assert_allclose(slopes, [1.0, 1.0], rtol=1e-12)


def converters():
    """Every converter of a field to an array, with the name and the annotation of the field."""
    for kind in subclasses(eqx.Module):
        for name, field in getattr(kind, "__dataclass_fields__", {}).items():
            ours = kind.__module__.startswith("jaxball") and "converter" in field.metadata
            if ours and getattr(field.type, "__name__", "").startswith("Float"):
                yield name, field.metadata["converter"], field.type.dim_str.split()


def test_converters_name_their_own_fields_and_keep_their_shapes():
    """The name and the shape stand in the annotation of a field, and again in its converter."""
    found = list(converters())
    assert len(found) > 60
    for name, convert, dimensions in found:
        with pytest.raises(TypeError, match=f"Argument `{name}` must be numbers"):
            convert(object())
        own = [int(d) if d.isdigit() else 2 for d in dimensions if not d.startswith("*")]
        assert convert(np.zeros(own)).shape == tuple(own)
        if "*batch" not in dimensions or dimensions[-1].isdigit():
            with pytest.raises(ValueError, match=f"Argument `{name}` must be"):
                convert(np.zeros([*own, 7]))


def subclasses(kind):
    for one in kind.__subclasses__():
        yield one
        yield from subclasses(one)
