"""The controlled disk: its schedules simulated by another solver, which knows of no controls."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import design
from jaxball.design import control

END, PLACE = 8.0, 1.0
DOWN = -np.pi / 2


def disk():
    masses = [jaxball.PointMass(1.0, jaxball.OnRail(jaxball.Circle(r), jaxball.ConstantRate(DOWN))) for r in (0.9, 0.6)]
    return jaxball.Disk(mass=1.0, inertia=1.0, masses=masses)


def problem(weight):
    """A rest-to-rest tracking problem, with the tracking cost multiplied by ``weight``."""
    curve = design.Through([[0.0, 0.0], [PLACE, 0.0]])
    tracking = design.FollowTrajectory(curve, rest_to_rest=True, weight=weight)
    effort = design.AccelerationEffort(weight=0.01)
    return control.Rolling(disk(), (0.0, END), {"tracking": tracking, "effort": effort}, place=PLACE)


@pytest.fixture(scope="module")
def easy():
    """The solution where the tracking hardly counts."""
    return control.started(problem(0.01), np.linspace(0.0, END, 9), tolerance=1e-6)


@pytest.fixture(scope="module")
def run(easy):
    """Its schedules simulated."""
    return control.scenario_of(easy, saves=2001).simulate(rtol=1e-11, atol=1e-11, throw=True)


def test_the_schedules_do_what_the_solution_says(easy, run):
    """By a simulation that knows of schedules and not of controls."""
    assert np.max(easy.errors) <= 1e-6
    found = control.places(easy, np.asarray(run.times))
    np.testing.assert_allclose(run.state.z, found, atol=1e-5)
    np.testing.assert_allclose(run.state.z[-1], PLACE, atol=1e-6)
    np.testing.assert_allclose(run.state.phidot[-1], 0.0, atol=1e-6)
    theta = [schedule.derivatives(jnp.asarray(END)) for schedule in control.schedules_of(easy)]
    np.testing.assert_allclose([rates[1] for rates in theta], 0.0, atol=1e-6)
    # The centre of mass: body angle θ, turned by φ in space.
    angles = np.asarray([rates[0] for rates in theta]) + float(run.state.phi[-1])
    np.testing.assert_allclose(np.sum(np.array([0.9, 0.6]) * np.cos(angles)), 0.0, atol=1e-6)
    assert np.sum(np.array([0.9, 0.6]) * np.sin(angles)) < 0


def test_the_costs_are_those_of_the_simulation(easy, run):
    times = np.asarray(run.times)
    u = 1 - 2 * times / END
    share = (1 - u) / 2
    wanted = PLACE * share**3 * (10 - 15 * share + 6 * share**2)
    tracking = np.trapezoid((np.asarray(run.state.z) - wanted) ** 2, times) / END
    acceleration = easy.path.inputs(times)
    effort = np.trapezoid(np.sum(acceleration**2, axis=1), times) / END
    found = control.means(easy)
    np.testing.assert_allclose([found["tracking"], found["effort"]], [tracking, effort], rtol=1e-4)


def test_a_scenario_file_holds_the_schedules(easy):
    again = jaxball.read_scenario(jaxball.write_scenario(control.scenario_of(easy, "tracking")))
    assert again.title == "tracking"
    first, second = (jax.tree.leaves(one.system) for one in (control.scenario_of(easy), again))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.slow
def test_the_tracking_error_falls_along_the_branch(easy):
    """To what the same problem has that is solved at once."""
    branch, hard = control.continued(easy, problem(10.0))
    assert branch.ended == "end"
    assert control.least_curvature(hard) > 0
    assert control.means(easy)["tracking"] > 100 * control.means(hard)["tracking"]
    seen = control.resimulated(hard)
    assert max(seen.apart, seen.speed, seen.away, seen.missed) < 1e-5
    assert seen.below > 0
    assert seen.margin > 0


def test_a_problem_half_way_between_two():
    middle = control.between((problem(0.1), problem(10.0)), jnp.asarray(0.5))
    np.testing.assert_allclose(middle.objectives["tracking"].weight, 1.0, rtol=1e-12)
    np.testing.assert_allclose(middle.objectives["effort"].weight, 0.01, rtol=1e-12)


def test_a_system_without_rails_cannot_be_controlled():
    with pytest.raises(design.DesignError, match="mass on a rail"):
        control.Rolling(jaxball.Disk(mass=1.0, inertia=1.0), (0.0, 1.0), {})
