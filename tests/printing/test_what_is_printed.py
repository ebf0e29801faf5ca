"""What an interactive session shows: numbers of parameters, findings of results; shapes where there are no numbers."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, Circle, OnRail, PointMass, Pulse, SphericalFrame
from jaxball.analysis.chaos.poincare import PoincareMap
from jaxball.analysis.chaos.result import LyapunovSpectrum
from jaxball.analysis.stability.steady import SteadyMotion
from jaxball.simulation.ensemble.simulate import Ensemble


def ball(radius=0.5):
    masses = [PointMass(0.25, OnRail(Circle(radius), Pulse(0.5))), PointMass(0.125, jaxball.Fixed([0.0, 0.0, 0.25]))]
    return Ball(mass=1.0, inertia=(0.5, 0.625, 0.75), masses=masses)


def seen_in(transformation, make, *arguments):
    """What an object prints while it is traced."""
    printed = []

    def traced(*values):
        made = make(*values)
        printed.extend([repr(made), str(made)])
        return jnp.zeros(())

    transformation(traced)(*arguments)
    return printed


def test_a_body_prints_its_numbers_and_masses():
    assert str(ball()).splitlines() == [
        "Ball(mass=1.0, inertia=(0.5, 0.625, 0.75), radius=1.0, offset=(0.0, 0.0, 0.0), gravity=1.0)",
        "  masses[0]: PointMass(mass=0.25, motion=OnRail(rail=Circle(radius=0.5), schedule=Pulse(theta=0.5)))",
        "  masses[1]: PointMass(mass=0.125, motion=Fixed(position=(0.0, 0.0, 0.25)))",
    ]
    assert repr(ball()) == str(ball())


def test_masses_are_printed_in_their_order_and_no_more_than_a_screen_shows():
    system = ball().with_masses([*ball().point_masses] * 10)
    lines = str(system).splitlines()
    assert lines[2].startswith("  masses[1]: PointMass(mass=0.125")
    assert lines[-1] == "  and 8 masses more"
    assert len(lines) == 14


def test_what_is_printed_makes_the_same_object():
    rail = Circle(0.9, frame=SphericalFrame(azimuth=0.1, elevation=0.7))
    mass = PointMass(0.3, OnRail(rail, Pulse(2.0, height=-1.0)))
    names = {name: getattr(jaxball, name) for name in jaxball.__all__}
    for made in (mass, rail, BallState(Omega=[0.1, 0.2, 1 / 3]), jaxball.Tube([1.0, 0.0, 0.0])):
        again = eval(repr(made), names)
        assert jax.tree.structure(again) == jax.tree.structure(made)
        jax.tree.map(np.testing.assert_array_equal, again, made)


def test_a_batch_and_a_tracer_print_their_shapes():
    many = jax.vmap(ball)(jnp.linspace(0.4, 0.6, 20))
    assert "mass=float64[20], inertia=float64[20,3]" in str(many)
    assert "masses[1]: PointMass(mass=float64[20], motion=Fixed(position=float64[20,3]))" in str(many)
    for transformation, argument in ((jax.jit, 0.5), (jax.grad, 0.5), (jax.vmap, jnp.ones(3))):
        for text in seen_in(transformation, ball, argument):
            assert "rail=Circle(radius=float64[]" in text
    assert "mass=float64[]" in repr(jax.eval_shape(ball, 0.5))


@pytest.mark.parametrize("leaf", [None, True, object(), 0])
def test_a_body_of_whatever_leaves_prints(leaf):
    assert repr(jax.tree.map(lambda _: leaf, ball())).startswith("Ball(")


def test_a_body_that_is_not_made_yet_prints():
    assert repr(object.__new__(Ball)) == "Ball()"


def test_a_run_prints_how_it_ended(ball_trajectory):
    assert repr(ball_trajectory).splitlines()[0] == "Trajectory of a ball with 3 point masses"
    assert "The solve reached t = 20." in str(ball_trajectory)
    many = jax.tree.map(lambda leaf: np.stack([leaf] * 3), ball_trajectory)
    many = eqx.tree_at(lambda run: run.status, many, np.array([0, 0, 1]))
    assert "a batch of shape (3,)" in repr(many)
    assert "2 SUCCESS, 1 MAX_STEPS" in str(many)
    assert "traced, with 21 times" in seen_in(jax.jit, lambda run: run, ball_trajectory)[0]
    ensemble = Ensemble(many, {"distance": np.array([1.0, 2.5, np.nan])}, np.array(60))
    assert "distance from 1 to 2.5" in repr(ensemble)
    assert "distance float64[3]" in seen_in(jax.jit, lambda runs: runs, ensemble)[1]


def test_observables_print_their_ranges(ball_trajectory):
    observables = ball_trajectory.observables
    force = observables.normal_force
    assert f"normal_force: float64[21], from {force.min():.6g} to {force.max():.6g}" in repr(observables)
    assert "normal_force: float64[21]" in seen_in(jax.jit, lambda x: x, observables)[0]


def test_other_results_print_what_they_found():
    """Made by hand, so that nothing is solved for it."""
    top = SteadyMotion(
        BallState(), 0.0, 0.0, True, np.array([0.5 + 0j, -0.5 + 0j]), "saddle", "The motion is unstable."
    )
    crossings = PoincareMap(np.array([1.25, 7.5]), BallState(), 2, 0, 10.0, 10.0)
    angles = jnp.array([[0.5], [2.5]])
    sought = jaxball.simulation.equilibrium.Balance(
        True, angles[0], True, 0.0, angles, jnp.array([True, False]), "With the angles (0.5) ..."
    )
    one, none = jnp.ones(1), jnp.zeros((1, 1))
    spectrum = LyapunovSpectrum(
        one, one / 8, one, none, none, one, none, *(jnp.array(x) for x in (0, 9.0, 5, 0.0, 0.0))
    )
    force = jaxball.simulation.extremes.ContactExtremes(
        *(jnp.asarray(float(x)) for x in (0.5, 1, 0.25, 2, 0.125, 3, 1))
    )
    assert repr(top).splitlines()[1:] == ["  The motion is unstable.", "  eigenvalues 0.5+0j, -0.5+0j"]
    assert repr(crossings).startswith("Poincaré map of 2 crossings, the first at t = 1.25, the last at t = 7.5")
    assert repr(sought) == "Balance: With the angles (0.5) ...\n  and one other solution, in `solutions`"
    assert "λ1 =  1.000000 ± 0.125000" in repr(spectrum)
    assert repr(force).startswith("least normal force 0.5 at t = 1, 0.5 of the weight")
    for result in (spectrum, force):
        many = jax.tree.map(lambda leaf: np.stack([leaf] * 3), result)
        for text in (repr(many), *seen_in(jax.jit, lambda x: x, result)):
            assert text.startswith(f"{type(result).__name__}(")


def test_a_scenario_prints_its_system_and_times():
    lines = repr(jaxball.load_scenario("ball")).splitlines()
    assert "201 times from 0 to 20, dopri8 at rtol 1e-10" in lines[0]
    assert lines[1].startswith("  Ball(mass=1.0")
