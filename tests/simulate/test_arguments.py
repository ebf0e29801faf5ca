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

pytestmark = pytest.mark.usefixtures("no_type_checks")
BALL = jaxball.Ball(mass=1.0, inertia=(0.5, 0.6, 0.7))


@pytest.mark.parametrize(
    ("times", "sentence"),
    [
        ([0.0], r"`times` must be two or more increasing numbers.*\(1,\)"),
        (1.0, "`times` must be two or more"),
        ([[0.0, 1.0]], r"\(1, 2\)"),
        ([0.0, 1.0, 1.0], "`times` must be increasing"),
        ([1.0, 0.0], r"starts with \[1.0, 0.0\]"),
        ([0.0, np.nan], "`times` must be increasing and finite"),
        ([0.0, np.inf], "`times` must be increasing and finite"),
    ],
)
def test_times(times, sentence):
    for given in (times, np.asarray(times)):
        with pytest.raises(ValueError, match=sentence):
            jaxball.simulate(BALL, given)


def test_plain_times_are_checked_as_arrays_are():
    for times in ((0, 2), [0, 2], (0.0, 2), [0.0, 2.0], np.array([0, 2])):
        found = check_times(times)
        assert found.dtype == np.float64
        np.testing.assert_array_equal(found, [0.0, 2.0])
    np.testing.assert_array_equal(check_times((-1e300, 1e300)), [-1e300, 1e300])
    with pytest.raises(TypeError, match="Argument `times` must be numbers"):
        check_times((0, 10**400))


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("z", "A Trajectory has no attribute `z`; it is `state.z`."),
        ("kinetic_energy", "A Trajectory has no attribute `kinetic_energy`; it is `observables.kinetic_energy`."),
        ("ts", "A Trajectory has no attribute `ts`; it is `times`."),
        ("states", "A Trajectory has no attribute `states`; did you mean `state`?"),
        ("mesage", "A Trajectory has no attribute `mesage`; did you mean `message`?"),
        ("colour", "A Trajectory has no attribute `colour`."),
    ],
)
def test_what_a_run_has_elsewhere(name, sentence):
    run = jaxball.simulate(BALL, [0.0, 1.0])
    with pytest.raises(AttributeError) as refused:
        getattr(run, name)
    assert str(refused.value) == sentence
    assert copy.copy(run).ok  # while a copy is made it has no attributes yet
    assert not hasattr(run, "__jax_array__")


@pytest.mark.parametrize("what", ["ok", "message", "problems", "raise_if_failed"])
def test_how_a_run_ended_is_not_known_while_it_is_traced(what):
    @jax.jit
    def ending(mass):
        run = jaxball.simulate(jaxball.Disk(mass=mass, inertia=0.5), [0.0, 1.0])
        answer = getattr(run, what)
        return answer() if callable(answer) else answer

    with pytest.raises(TypeError, match=rf"`{what}` is for a trajectory whose numbers are known, .* jaxball\.Status"):
        ending(1.0)


def test_a_body_is_not_copied_by_dataclasses():
    """Its fields are not its arguments: masses of one structure are in groups."""
    sentence = r"^A Ball must be changed by equinox\.tree_at, .*equinox\.tree_at\(lambda it: it\.mass, it, 2\.0\)"
    with pytest.raises(TypeError, match=sentence):
        dataclasses.replace(BALL, mass=2.0)
    assert eqx.tree_at(lambda it: it.mass, BALL, jnp.array(2.0)).mass == 2.0


def test_the_state_of_another_body():
    with pytest.raises(
        TypeError, match=r"must be a BallState, RotationState or ReducedState for a Ball, but it is a DiskState"
    ):
        jaxball.simulate(BALL, [0.0, 1.0], jaxball.DiskState())


def test_angles_that_no_mass_has():
    with pytest.raises(ValueError, match=r"must have 0 entries in theta.*but it has 1 and 1"):
        jaxball.simulate(BALL, [0.0, 1.0], jaxball.BallState(theta=[0.0], thetadot=[0.0]))


def test_driven_masses_need_their_angles():
    system, _ = jaxball.with_integrated_angles(
        jaxball.Ball(
            mass=1.0,
            inertia=(0.5, 0.6, 0.7),
            masses=[jaxball.PointMass(0.5, jaxball.OnRail(jaxball.Circle(0.5), jaxball.Pulse(0.0)))],
        )
    )
    with pytest.raises(ValueError, match="`state` must be given"):
        jaxball.simulate(system, [0.0, 1.0])
    with pytest.raises(ValueError, match=r"no feedback law, but one drives masses\[0\]"):
        jaxball.with_integrated_angles(system)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: jaxball.Ball(mass=[1.0, 2.0], inertia=(1.0, 1.0, 1.0)), "`mass` must be a single number"),
        (lambda: jaxball.Ball(mass=1.0, inertia=1.0), r"`inertia` must be 3 numbers, but its shape is \(\)"),
        (lambda: jaxball.Disk(mass=1.0, inertia=(1.0, 1.0, 1.0)), "`inertia` must be a single number"),
        (lambda: jaxball.Ball(mass=1.0, inertia=(1.0,) * 3, offset=(0.0, 0.0)), "`offset` must be 3 numbers"),
        (
            lambda: jaxball.Ball(
                mass=1.0,
                inertia=(1.0,) * 3,
                masses=[jaxball.PointMass(1.0, jaxball.Driven(jaxball.Circle(0.5)))],
            ),
            r"`law` must be a feedback law, because one drives masses\[0\]",
        ),
        (
            lambda: jaxball.Ball(mass=1.0, inertia=(1.0,) * 3, law=jaxball.Servo((), jnp.zeros(0), jnp.zeros(0))),
            "`law` must be None, because it drives nothing",
        ),
    ],
)
def test_bodies(make, sentence):
    with pytest.raises(ValueError, match=sentence):
        make()


def test_a_reduced_ball_knows_no_force_and_no_place():
    forced = jaxball.Ball(mass=1.0, inertia=(0.5, 0.6, 0.7), force=jaxball.HarmonicForce([0.1, 0.0, 0.0]))
    with pytest.raises(ValueError, match="Argument `system` must have no external force in the reduced"):
        jaxball.simulate(forced, [0.0, 1.0], jaxball.ReducedState())
    run = jaxball.simulate(BALL, [0.0, 1.0], jaxball.ReducedState())
    with pytest.raises(ValueError, match="observables need the full state"):
        _ = run.observables


def test_tolerances_beyond_the_floating_point_type():
    with pytest.raises(
        jaxball.PrecisionError, match=r"must not both be below 1\.8e-15 in float64, but they are 1e-16"
    ) as refused:
        jaxball.simulate(BALL, [0.0, 1.0], rtol=1e-16, atol=1e-16)
    assert "jax_enable_x64" not in str(refused.value)


def test_throw_within_a_traced_function():
    with pytest.raises(ValueError, match="Argument `throw` must be False where the solve is traced"):
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
