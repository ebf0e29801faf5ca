"""Failed, reduced and batched trajectories, and Axes of the wrong kind."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

import jaxball
from jaxball import plot
from jaxball.classical import FreeRigidBody, RigidBodyState
from tests.plot.lines import drawn

FIGURES = [
    plot.body_paths,
    plot.space_paths,
    plot.angular_velocity,
    plot.centre_path,
    plot.energies,
    plot.power,
    plot.contact_force,
    plot.friction_ratio,
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
    assert drawn(plot.energies(failed_trajectory), "$T$")[-1, 0] == 6.0


@pytest.mark.thorough
@pytest.mark.parametrize("draw", [*FIGURES, plot.overview])
def test_a_reduced_trajectory_is_refused_in_a_sentence(draw, reduced_trajectory):
    with pytest.raises(ValueError, match=r"need the full state, .* simulate with a BallState\.$"):
        draw(reduced_trajectory)


@pytest.mark.thorough
def test_a_refused_trajectory_leaves_no_file(reduced_trajectory, tmp_path):
    with pytest.raises(ValueError, match="need the full state"):
        plot.figures(reduced_trajectory, tmp_path / "figures")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("draw", [*FIGURES, plot.configuration, plot.acceleration])
def test_a_batch_is_refused_in_a_sentence(draw, ball_trajectory):
    batch = eqx.tree_at(lambda run: run.status, ball_trajectory, jnp.zeros((2,), dtype=int))
    with pytest.raises(ValueError, match=r"is for one trajectory, but this is a batch of shape \(2,\); take one"):
        draw(batch)
    with pytest.raises(ValueError, match=r"is for one trajectory, but this is a batch of shape \(2,\); take one"):
        batch.plot()


@pytest.mark.parametrize(
    "draw",
    [
        plot.overview,
        plot.configuration,
        plot.acceleration,
        plot.centre_velocity,
        plot.joint_angles,
        plot.joint_efforts,
    ],
)
def test_what_is_no_ball_or_disk_is_refused_in_a_sentence(draw):
    run = jaxball.simulate(FreeRigidBody(inertia=(1.0, 2.0, 3.0)), [0.0, 1.0], RigidBodyState(Omega=(0.1, 1.0, 0.0)))
    with pytest.raises(ValueError, match=r"must be of a ball or a disk, but it is of a FreeRigidBody; its method plot"):
        draw(run)


@pytest.mark.parametrize("draw", [plot.body_paths, plot.space_paths, plot.configuration])
def test_a_ball_needs_axes_in_space(draw, ball_trajectory):
    with pytest.raises(ValueError, match=r"^Argument `ax` must be a three-dimensional Axes, .* but it is a Axes;"):
        draw(ball_trajectory, Figure().add_subplot())


@pytest.mark.parametrize("draw", [plot.energies, plot.centre_path, plot.acceleration])
def test_a_graph_needs_plane_axes(draw, ball_trajectory):
    with pytest.raises(ValueError, match=r"^Argument `ax` must be a plane Axes, but it is a Axes3D;"):
        draw(ball_trajectory, Figure().add_subplot(projection="3d"))


@pytest.mark.thorough
def test_no_mass_with_an_angle_means_no_acceleration(bare_trajectory):
    with pytest.raises(ValueError, match=r"^Argument `source` must have a mass with a schedule, .* neither;"):
        plot.acceleration(bare_trajectory)
    with pytest.raises(ValueError, match=r"^Argument `times` must be given with a system"):
        plot.acceleration(bare_trajectory.system)
