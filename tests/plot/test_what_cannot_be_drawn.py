"""Failed, reduced and batched trajectories, and Axes of the wrong kind."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

import jaxball
from jaxball import plot
from jaxball.physics.classical import FreeRigidBody, RigidBodyState
from jaxball.plot import coordinates, report, space, time_series
from tests.plot.lines import drawn
from tests.support.sentences import refuses

FIGURES = [
    space.body_paths,
    space.space_paths,
    time_series.angular_velocity,
    space.centre_path,
    time_series.energies,
    time_series.power,
    time_series.contact_force,
    time_series.friction_ratio,
]


@pytest.mark.thorough
@pytest.mark.parametrize("draw", FIGURES)
def test_rows_that_are_not_finite_are_not_drawn(draw, failed_trajectory, ball_trajectory):
    some, whole = draw(failed_trajectory), draw(ball_trajectory)
    compared = 0
    for line, other in zip(some.lines, whole.lines, strict=False):
        a, b = np.asarray(line.get_xdata()), np.asarray(other.get_xdata())
        if len(b) == 21:
            assert len(a) == 7
            compared += 1
    assert compared


@pytest.mark.thorough
@pytest.mark.parametrize("draw", [*FIGURES, plot.configuration, plot.acceleration])
def test_a_trajectory_without_a_finite_state_gives_empty_figures(draw, hopeless_trajectory):
    draw(hopeless_trajectory).figure.draw_without_rendering()


def test_a_run_that_failed_early_is_drawn_as_far_as_it_came(failed_trajectory):
    assert drawn(failed_trajectory.plot("energies"), "$T$")[-1, 0] == 6.0


@pytest.mark.thorough
@pytest.mark.parametrize("draw", [*FIGURES, report.overview])
def test_a_reduced_trajectory_is_refused_in_a_sentence(draw, reduced_trajectory):
    with refuses(ValueError, "BallState"):
        draw(reduced_trajectory)


@pytest.mark.thorough
def test_a_refused_trajectory_leaves_no_file(reduced_trajectory, tmp_path):
    with refuses(ValueError):
        reduced_trajectory.save_figures(tmp_path / "figures")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("draw", [*FIGURES, plot.configuration, plot.acceleration])
def test_a_batch_is_refused_in_a_sentence(draw, ball_trajectory):
    batch = eqx.tree_at(lambda run: run.status, ball_trajectory, jnp.zeros((2,), dtype=int))
    with refuses(ValueError, "A picture"):
        draw(batch)
    with refuses(ValueError, "A picture"):
        batch.plot()


@pytest.mark.parametrize(
    "draw",
    [
        report.overview,
        plot.configuration,
        plot.acceleration,
        time_series.centre_velocity,
        coordinates.joint_angles,
        coordinates.joint_efforts,
    ],
)
def test_what_is_no_ball_or_disk_is_refused_in_a_sentence(draw):
    run = jaxball.simulate(FreeRigidBody(inertia=(1.0, 2.0, 3.0)), [0.0, 1.0], RigidBodyState(Omega=(0.1, 1.0, 0.0)))
    with refuses(ValueError, "trajectory"):
        draw(run)


@pytest.mark.parametrize("draw", [space.body_paths, space.space_paths, plot.configuration])
def test_a_ball_needs_axes_in_space(draw, ball_trajectory):
    with refuses(ValueError, "ax"):
        draw(ball_trajectory, Figure().add_subplot())


@pytest.mark.parametrize("draw", [time_series.energies, space.centre_path, plot.acceleration])
def test_a_graph_needs_plane_axes(draw, ball_trajectory):
    with refuses(ValueError, "ax"):
        draw(ball_trajectory, Figure().add_subplot(projection="3d"))


@pytest.mark.thorough
def test_no_mass_with_an_angle_means_no_acceleration(bare_trajectory):
    with refuses(ValueError, "source"):
        bare_trajectory.plot("acceleration")
    with refuses(ValueError, "times"):
        plot.acceleration(bare_trajectory.system)
