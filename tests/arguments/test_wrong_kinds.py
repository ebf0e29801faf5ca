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
from jaxball.analysis.chaos import chart, lyapunov_spectrum, lyapunov_spectrum_of, poincare_map
from jaxball.analysis.stability import permanent_rotations, steady_rolling
from jaxball.control import tvlqr
from jaxball.control.environments import Environment, ReachPoint
from jaxball.physics.classical import FreeRigidBody, FunctionAxis, ParticleState, RigidBodyState, VakonomicState
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.sentences import refuses

pytestmark = pytest.mark.usefixtures("no_type_checks")

SHELL = {"mass": 1.0, "inertia": (0.5, 0.6, 0.7)}
BALL = jaxball.Ball(**SHELL)
RAIL, PULSE = Circle(0.5), Pulse(0.0)
TIMES = [0.0, 1.0]
ZEROS = jnp.zeros(3)
ROBOT = jaxball.Disk(mass=1.0, inertia=0.5, mechanisms=[jaxball.planar_pendulum(0.5, 0.6, drive=jaxball.Motor(0.0))])


def on_rail(rail=RAIL):
    return PointMass(0.5, OnRail(rail, PULSE))


def driven(law):
    return jaxball.Ball(**SHELL, masses=[PointMass(0.5, Driven(RAIL)), PointMass(0.5, Driven(RAIL))], law=law)


def run(**changed):
    return jaxball.simulate(**{"system": BALL, "times": TIMES} | changed)


def run_driven(law):
    return run(system=driven(law), state=BallState(theta=[0.0, 0.0], thetadot=[0.0, 0.0]))


def held():
    return tvlqr(jaxball.simulate(ROBOT, TIMES), 1.0, 1.0, sample=0.5)


def scenario():
    return jaxball.Scenario("a title", BALL, BallState(), np.asarray(TIMES))


GROUNDS = [
    (lambda: jaxball.Ball(**SHELL, ground="bowl"), "ground"),
    (lambda: jaxball.Bowl(3.0, motion="up"), "motion"),
    (lambda: jaxball.physics.Turn((0.0, 0.0, 1.0), 2.0), "angle"),
    (lambda: jaxball.physics.MovingFrame([PULSE]), "turns[0]"),
    (lambda: jaxball.physics.MovingFrame(displacement=RAIL), "displacement"),
    (lambda: jaxball.physics.TiltingPlane(0.1), "about_e1"),
    (lambda: jaxball.physics.Cylinder(1.0, outside=1), "outside"),
]
MOTIONS = [
    (lambda: OnRail(RAIL, 0.3), "schedule"),
    (lambda: OnRail(RAIL, jaxball.RecordedSignal([0.0, 1.0], [0.0, 1.0])), "schedule"),
    (lambda: OnRail(PULSE, RAIL), "rail"),
    (lambda: OnRail(Circle, PULSE), "rail"),
    (lambda: Driven(0.5), "rail"),
    (lambda: PointMass(1.0, RAIL), "motion"),
    (lambda: PointMass("heavy", OnRail(RAIL, PULSE)), "mass"),
    (lambda: PointMass([1.0, 2.0], OnRail(RAIL, PULSE)), "mass"),
    (lambda: jaxball.Oscillating([0.1, 0.0, 0.0]), "path"),
    (lambda: jaxball.Oscillating(jaxball.HarmonicSeries(0.1)), "path.constant"),
    (lambda: jaxball.Fixed(0.3), "position"),
    (lambda: Circle([0.5, 0.6]), "radius"),
    (lambda: Circle(0.5, centre=0.1), "centre"),
    (lambda: Circle(0.5j), "radius"),
    (lambda: Circle("0.5"), "radius"),
    (lambda: Circle(None), "radius"),
    (lambda: Circle(0.5, frame=(0.3, 0.5)), "frame"),
    (lambda: jaxball.Ellipse(0.5), "semi_axes"),
    (lambda: jaxball.physics.GeronoEight([0.5, 0.2, 0.1]), "half_extents"),
    (lambda: jaxball.physics.BernoulliEight([0.5]), "half_width"),
    (lambda: jaxball.Tube([0.5, 0.2]), "direction"),
    (lambda: jaxball.SplineRail([0.5, 0.2]), "points_on_rail"),
    (lambda: jaxball.SphericalFrame([0.5, 0.2], 0.1), "azimuth"),
    (lambda: jaxball.MatrixFrame([1.0, 0.0, 0.0]), "B"),
    (lambda: jaxball.physics.VersorFrame([1.0, 0.0, 0.0]), "q"),
    (lambda: Pulse([0.0, 1.0]), "theta"),
    (lambda: ConstantRate(RAIL), "theta"),
    (lambda: jaxball.Waypoints([0.0, [1.0]], [0.0, 1.0]), "times"),
    (lambda: jaxball.Servo(PULSE, [1.0], [1.0]), "targets"),
    (lambda: jaxball.Servo([PULSE, RAIL], [1.0] * 2, [1.0] * 2), "targets[1]"),
    (lambda: jaxball.Servo((PULSE,), [1.0, 2.0], [1.0]), "stiffness"),
    (lambda: jaxball.FollowSchedules((0.3,)), "schedules[0]"),
]
BODIES = [
    (lambda: jaxball.Ball(**SHELL, masses=[RAIL]), "masses[0]"),
    (lambda: jaxball.Ball(**SHELL, masses=on_rail()), "masses"),
    (lambda: jaxball.Ball(**SHELL, masses=[PointMass]), "masses[0]"),
    (lambda: jaxball.Ball(**SHELL, force=[0.1, 0.0, 0.0]), "force"),
    (lambda: jaxball.Ball(**SHELL, law=math.sin), "law"),
    (lambda: jaxball.Ball(mass=None, inertia=(0.5, 0.6, 0.7)), "mass"),
    (lambda: jaxball.Disk(mass=1.0, inertia="d2"), "inertia"),
    (lambda: jaxball.physics.HarmonicForce(0.3), "constant"),
    (lambda: FreeRigidBody(inertia="thin"), "inertia"),
    (lambda: jaxball.Slip([0.3, 0.4]), "friction"),
    (lambda: driven(jaxball.Servo((PULSE,), [1.0], [1.0])), "targets"),
    (lambda: driven(jaxball.FollowSchedules((PULSE,))), "schedules"),
]
FUNCTIONS = [
    (lambda: FunctionRail(lambda: ZEROS), "function"),
    (lambda: FunctionRail(0.5), "function"),
    (lambda: FunctionRail(lambda theta, p: (theta, theta, theta)), "function"),
    (lambda: FunctionRail(lambda theta, p: jnp.stack([theta, theta])), "function"),
    (lambda: FunctionRail(lambda theta, p: jnp.array([1, 2, 3])), "function"),
    (lambda: FunctionRail(lambda theta, p: jnp.array([math.cos(theta), 0, 0])), "function"),
    (lambda: jaxball.FunctionSchedule(lambda t, p: jnp.stack([t])), "function"),
    (lambda: jaxball.FunctionSchedule(lambda t, p: None), "function"),
    (lambda: jaxball.FunctionForce(lambda t, p: t), "function"),
    (lambda: jaxball.FunctionForce(lambda t: ZEROS, 2.0), "function"),
    (lambda: jaxball.Free(lambda t, p: jnp.zeros(2)), "function"),
    (lambda: FunctionAxis(lambda t, p: t), "function"),
    (lambda: jaxball.FunctionLaw(lambda t: ZEROS), "function"),
    (lambda: jaxball.Event(lambda t: t), "of"),
    (lambda: run_driven(jaxball.FunctionLaw(lambda t, state, p: ZEROS)), "law"),
]
STATES = [
    (lambda: BallState(Omega=[1.0, 2.0]), "Omega"),
    (lambda: BallState(q=[1.0, 0.0, 0.0]), "q"),
    (lambda: BallState(z=0.0), "z"),
    (lambda: BallState(theta=0.0), "theta"),
    (lambda: jaxball.physics.RotationState(Lambda=[1.0, 0.0, 0.0]), "Lambda"),
    (lambda: jaxball.physics.ReducedState(Gamma=[0.0, 1.0]), "Gamma"),
    (lambda: jaxball.DiskState(phi="upright"), "phi"),
    (lambda: RigidBodyState(Omega=[1.0, 2.0]), "Omega"),
    (lambda: ParticleState(xdot=BALL), "xdot"),
    (lambda: VakonomicState(multiplier="λ"), "multiplier"),
    (lambda: run(state=BallState(Omega=jnp.ones((4, 3)))), "Omega"),
    (lambda: run(state=BallState), "state"),
    (lambda: run(state=[0.0, 1.0]), "state"),
    (lambda: run(system=FreeRigidBody(inertia=(1.0, 1.0, 1.0)), state=BALL), "state"),
]
CALLS = [
    (lambda: run(solver="dopri8"), "solver"),
    (lambda: run(solver=diffrax.Dopri8), "solver"),
    (lambda: run(solver=diffrax.Euler()), "solver"),
    (lambda: run(times="0 1"), "times"),
    (lambda: run(times=["0", "1"]), "times"),
    (lambda: run(times=None), "times"),
    (lambda: run(rtol="tight"), "rtol"),
    (lambda: run(atol=[[1e-8], [1e-8, 1.0]]), "atol"),
    (lambda: run(events=[jaxball.Detachment()]), "events"),
    (lambda: run(events={"lift": jaxball.Detachment}), "events['lift']"),
    (lambda: run(adjoint="forward"), "adjoint"),
    (lambda: run(adjoint=diffrax.ForwardMode), "adjoint"),
    (lambda: run(progress=True), "progress"),
    (lambda: run(max_steps=1e4), "max_steps"),
    (lambda: run(max_steps=10**30), "max_steps"),
    (lambda: run(max_steps=0), "max_steps"),
    (lambda: run(max_step="long"), "max_step"),
    (lambda: run(max_step=[0.1, 0.2]), "max_step"),
    (lambda: run(max_step=True), "max_step"),
    (lambda: run(max_step=0.0), "max_step"),
    (lambda: run(max_step=float("inf")), "max_step"),
    (lambda: jax.jit(lambda h: run(max_step=h))(0.1), "max_step"),
    (lambda: run(system=jaxball.Ball), "system"),
    (lambda: run(system=scenario()), "system"),
    (lambda: jaxball.problems(scenario()), "system"),
    (lambda: scenario().simulate(solver=diffrax.Dopri8()), "solver"),
    (lambda: run(dense=True).at("end"), "t"),
    (lambda: jaxball.contact_extremes(BALL), "run"),
    (lambda: jaxball.balance(scenario(), [0]), "system"),
    (lambda: jaxball.balance(BALL, 0), "free"),
    (lambda: lyapunov_spectrum(scenario(), TIMES), "system"),
    (lambda: lyapunov_spectrum(BALL, TIMES, solver="dopri8"), "solver"),
    (lambda: lyapunov_spectrum(BALL, "long"), "times"),
    (lambda: lyapunov_spectrum(BALL, TIMES, exponents=1.0), "exponents"),
    (lambda: lyapunov_spectrum_of(lambda t, x: x, TIMES, [1.0]), "field"),
    (lambda: poincare_map(BALL, lambda state: 0.0, TIMES), "of"),
    (lambda: chart(lambda a: BALL, {"a": [1.0], "b": [1.0]}, TIMES), "make"),
    (lambda: simulate_ensemble(scenario(), TIMES, BallState()), "system"),
    (lambda: simulate_ensemble(BALL, "0 1", BallState()), "times"),
    (lambda: simulate_ensemble(BALL, TIMES, BallState(), solver="dopri8"), "solver"),
    (lambda: simulate_ensemble(BALL, TIMES, BallState(), reductions=["distance"]), "reductions"),
    (lambda: permanent_rotations(scenario()), "ball"),
    (lambda: steady_rolling(jaxball.Disk(mass=1.0, inertia=0.5), 0.1, 1.0), "ball"),
    (lambda: jaxball.read_scenario({"kind": "ball"}), "text"),
    (lambda: jaxball.write_scenario(run()), "scenario"),
    (lambda: run(events={3: jaxball.Detachment()}), "events"),
    (lambda: run(events=dict.fromkeys(["a/b", "a_b"], jaxball.Detachment())), "events"),
    (lambda: run().plot(3), "panel"),
    (lambda: run().plot("energies", title="mine"), "title"),
    (lambda: run().save_figures("figures", formats="png"), "formats"),
    (lambda: ReachPoint(1.0, within=-1.0), "within"),
    (lambda: Environment(ROBOT, ReachPoint(1.0), sample=0.1, limits=1.0, friction=-1.0), "friction"),
    (
        lambda: tvlqr(jaxball.simulate(ROBOT, TIMES), 1.0, 1.0, sample=0.5).basin(np.zeros((1, 5)), within=-1.0),
        "within",
    ),
]


@pytest.mark.thorough
@pytest.mark.parametrize(("make", "named"), GROUNDS + MOTIONS + BODIES + FUNCTIONS + STATES + CALLS)
def test_refused_in_a_sentence(make, named):
    with refuses((TypeError, ValueError), named):
        make()


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
        with pytest.raises(TypeError, match=f"`{name}`"):
            convert(object())
        own = [int(d) if d.isdigit() else 2 for d in dimensions if not d.startswith("*")]
        assert convert(np.zeros(own)).shape == tuple(own)
        if "*batch" not in dimensions or dimensions[-1].isdigit():
            with pytest.raises(ValueError, match=f"`{name}`"):
                convert(np.zeros([*own, 7]))


def subclasses(kind):
    for one in kind.__subclasses__():
        yield one
        yield from subclasses(one)
