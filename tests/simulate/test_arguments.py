"""Arguments of the wrong kind are refused in one sentence that says what they must be."""

import copy
import dataclasses
import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.simulation.arguments import check_times
from tests.support.sentences import refuses

pytestmark = pytest.mark.usefixtures("no_type_checks")
BALL = jaxball.Ball(mass=1.0, inertia=(0.5, 0.6, 0.7))


@pytest.mark.parametrize(
    ("times", "named"),
    [
        ([0.0], "times"),
        (1.0, "times"),
        ([[0.0, 1.0]], "times"),
        ([0.0, 1.0, 1.0], "times"),
        ([1.0, 0.0], "times"),
        ([0.0, np.nan], "times"),
        ([0.0, np.inf], "times"),
    ],
)
def test_times(times, named):
    for given in (times, np.asarray(times)):
        with refuses(ValueError, named):
            jaxball.simulate(BALL, given)


def test_plain_times_are_checked_as_arrays_are():
    for times in ((0, 2), [0, 2], (0.0, 2), [0.0, 2.0], np.array([0, 2])):
        found = check_times(times)
        assert found.dtype == np.float64
        np.testing.assert_array_equal(found, [0.0, 2.0])
    np.testing.assert_array_equal(check_times((-1e300, 1e300)), [-1e300, 1e300])
    with refuses(TypeError, "times"):
        check_times((0, 10**400))


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("z", "z"),
        ("kinetic_energy", "kinetic_energy"),
        ("ts", "ts"),
        ("states", "states"),
        ("mesage", "mesage"),
        ("colour", "colour"),
    ],
)
def test_what_a_run_has_elsewhere(name, named):
    run = jaxball.simulate(BALL, [0.0, 1.0])
    with refuses(AttributeError, named):
        getattr(run, name)
    assert copy.copy(run).ok  # while a copy is made it has no attributes yet
    assert not hasattr(run, "__jax_array__")


@pytest.mark.parametrize("what", ["ok", "message", "problems", "raise_if_failed"])
def test_how_a_run_ended_is_not_known_while_it_is_traced(what):
    @jax.jit
    def ending(mass):
        run = jaxball.simulate(jaxball.Disk(mass=mass, inertia=0.5), [0.0, 1.0])
        answer = getattr(run, what)
        return answer() if callable(answer) else answer

    with refuses(TypeError, what):
        ending(1.0)


def test_a_body_is_not_copied_by_dataclasses():
    """Its fields are not its arguments: masses of one structure are in groups."""
    named = "groups"
    with refuses(TypeError, named):
        dataclasses.replace(BALL, mass=2.0)
    assert eqx.tree_at(lambda it: it.mass, BALL, jnp.array(2.0)).mass == 2.0


def test_the_state_of_another_body():
    with refuses(TypeError, "state"):
        jaxball.simulate(BALL, [0.0, 1.0], jaxball.DiskState())


def test_angles_that_no_mass_has():
    with refuses(ValueError, "state"):
        jaxball.simulate(BALL, [0.0, 1.0], jaxball.BallState(theta=[0.0], thetadot=[0.0]))


def test_driven_masses_need_their_angles():
    system, _ = jaxball.Ball(
        mass=1.0,
        inertia=(0.5, 0.6, 0.7),
        masses=[jaxball.PointMass(0.5, jaxball.OnRail(jaxball.Circle(0.5), jaxball.Pulse(0.0)))],
    ).with_integrated_angles()
    with refuses(ValueError, "state"):
        jaxball.simulate(system, [0.0, 1.0])
    with refuses(ValueError, "body"):
        system.with_integrated_angles()


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: jaxball.Ball(mass=[1.0, 2.0], inertia=(1.0, 1.0, 1.0)), "mass"),
        (lambda: jaxball.Ball(mass=1.0, inertia=1.0), "inertia"),
        (lambda: jaxball.Disk(mass=1.0, inertia=(1.0, 1.0, 1.0)), "inertia"),
        (lambda: jaxball.Ball(mass=1.0, inertia=(1.0,) * 3, offset=(0.0, 0.0)), "offset"),
        (
            lambda: jaxball.Ball(
                mass=1.0,
                inertia=(1.0,) * 3,
                masses=[jaxball.PointMass(1.0, jaxball.Driven(jaxball.Circle(0.5)))],
            ),
            "law",
        ),
        (lambda: jaxball.Ball(mass=1.0, inertia=(1.0,) * 3, law=jaxball.Servo((), jnp.zeros(0), jnp.zeros(0))), "law"),
    ],
)
def test_bodies(make, named):
    with refuses(ValueError, named):
        make()


def test_a_reduced_ball_knows_no_force_and_no_place():
    forced = jaxball.Ball(mass=1.0, inertia=(0.5, 0.6, 0.7), force=jaxball.physics.HarmonicForce([0.1, 0.0, 0.0]))
    with refuses(ValueError, "system"):
        jaxball.simulate(forced, [0.0, 1.0], jaxball.physics.ReducedState())
    run = jaxball.simulate(BALL, [0.0, 1.0], jaxball.physics.ReducedState())
    with refuses(ValueError, "ReducedState"):
        _ = run.observables


def test_tolerances_beyond_the_floating_point_type():
    with refuses(jaxball.simulation.PrecisionError, "rtol") as refused:
        jaxball.simulate(BALL, [0.0, 1.0], rtol=1e-16, atol=1e-16)
    assert "jax_enable_x64" not in str(refused.value)


def test_throw_within_a_traced_function():
    with refuses(ValueError, "throw"):
        jax.jit(lambda ball: jaxball.simulate(ball, [0.0, 1.0], throw=True).state.z)(BALL)


@pytest.mark.parametrize(
    ("times", "far"),
    [
        (1.7e9 + np.linspace(0.0, 10.0, 101), True),  # seconds since 1970
        ([1.7e9, 1.7e9 + 10.0], True),
        (np.linspace(0.0, 10.0, 101), False),
        (1000.0 + np.linspace(0.0, 1.0, 101), False),  # far, but known finely enough
        (np.linspace(0.0, 1e7, 3), False),
    ],
)
def test_times_far_from_zero_are_to_be_shifted(times, far):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_times(times)
    assert [str(warning.message).endswith("from the start: times - times[0].") for warning in caught] == [True] * far
