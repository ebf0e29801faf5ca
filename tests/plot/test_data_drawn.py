"""Each figure draws the quantity that it names, against states, formulas and numbers of the paper's runs."""

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

import jaxball
from jaxball import load_scenario, plot
from jaxball.plot import space as in_space, time_series
from jaxball.plot.palette import mass_colour
from tests.plot.lines import drawn
from tests.support.paper import DISK_RADII, paper_ball, paper_disk
from tests.support.sentences import refuses


def space():
    return Figure().add_subplot(projection="3d")


def plane():
    return Figure().add_subplot()


def pulse(t):
    """|u(t)| of ``eq_prescribed_u_ball`` and ``eq_prescribed_u_disk``."""
    return np.where(t <= 0.1, 1.0, np.where(t <= 0.2, 2.0 - 10.0 * t, 0.0))


def travelled(t):
    """The pulse integrated twice by hand; 0.15 is the rate after it."""
    held, falling = t**2 / 2, 0.005 + 0.1 * (t - 0.1) + (t - 0.1) ** 2 / 2 - 5 * (t - 0.1) ** 3 / 3
    after = 0.005 + 0.01 + 0.005 - 5 * 0.1**3 / 3 + 0.15 * (t - 0.2)
    return np.where(t <= 0.1, held, np.where(t <= 0.2, falling, after))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("draw", "body", "kind"),
    [
        (plot.acceleration, "ball", plane),
        (plot.configuration, "ball", space),
        (plot.configuration, "disk", plane),
        (in_space.body_paths, "ball", space),
        (in_space.body_paths, "disk", space),
        (in_space.body_paths, "disk", plane),
        (in_space.space_paths, "ball", space),
        (in_space.space_paths, "disk", plane),
        (time_series.angular_velocity, "ball", plane),
        (time_series.angular_velocity, "disk", plane),
        (in_space.centre_path, "ball", plane),
        (in_space.centre_path, "disk", plane),
        (time_series.energies, "ball", plane),
        (time_series.power, "ball", plane),
        (time_series.contact_force, "ball", plane),
        (time_series.friction_ratio, "ball", plane),
    ],
)
def test_every_function_draws_into_the_axes_that_it_is_given(draw, body, kind, request):
    trajectory, ax = request.getfixturevalue(f"{body}_trajectory"), kind()
    assert draw(trajectory, ax) is ax
    assert ax.lines
    assert ax.get_xlabel()
    assert ax.get_ylabel()


def test_masses_that_are_pushed_alike_share_a_line(disk_trajectory):
    ax = disk_trajectory.plot("acceleration")
    t, size = drawn(ax, r"$i = 1, \ldots, 4$").T
    np.testing.assert_allclose(size, pulse(t), atol=1e-12)
    assert {0.1, 0.2} <= set(t)
    assert 0.2 < ax.get_xlim()[1] < 1.0


def test_a_jump_of_acceleration_is_drawn_upright():
    push = jaxball.PiecewiseAcceleration(0.0, (1.0, 2.0), ((3.0,),))
    ball = jaxball.Ball(
        mass=1.0,
        inertia=(1, 1, 1),
        masses=[jaxball.PointMass(1.0, jaxball.OnRail(jaxball.Circle(0.5), push))],
    )
    t, size = drawn(plot.acceleration(ball, times=(0.0, 4.0)), "$i = 1$").T
    np.testing.assert_array_equal(size, np.where((t >= 1.0) & (t < 2.0), 3.0, 0.0))
    assert np.min(np.diff(t)) < 1e-15


def test_groups_of_masses_that_are_pushed_unlike_have_lines_of_their_own():
    ax = plot.acceleration(load_scenario("six-tubes").system, times=(0.0, 1.0))
    assert [line.get_label() for line in ax.lines] == ["$i = 1, 2$", "$i = 3, 4$", "$i = 5, 6$"]
    assert len({line.get_color() for line in ax.lines}) == 3


def test_the_colours_of_masses_on_one_rail_are_all_seen():
    lines = plot.configuration(load_scenario("six-tubes").system).lines
    rails = [line for line in lines if len(line.get_data_3d()[0]) == 2]
    one, other = (line for line in rails if line.get_color() in (mass_colour(1), mass_colour(2)))
    np.testing.assert_array_equal(one.get_data_3d(), other.get_data_3d())
    assert (one.get_linestyle(), other.get_linestyle()) == ("-", "--")


@pytest.mark.thorough
def test_a_driven_mass_is_drawn_as_the_law_drives_it():
    mass = jaxball.PointMass(1.0, jaxball.OnRail(jaxball.Circle(0.5), jaxball.Pulse(0.3)))
    ball, angles = jaxball.Ball(mass=1.0, inertia=(1, 1, 1), masses=[mass]).with_integrated_angles()
    times = np.array([0.0, 0.05, 0.15, 0.18, 0.3])
    run = jaxball.simulate(ball, times, jaxball.BallState(**angles), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(drawn(run.plot("acceleration"), "$i = 1$")[:, 1], pulse(times), atol=1e-12)


def test_the_disk_starts_with_its_masses_below_the_centre():
    ax = plot.configuration(paper_disk())
    marks = [line for line in ax.lines if line.get_marker() == "o"]
    np.testing.assert_allclose([line.get_ydata()[0] for line in marks], np.negative(DISK_RADII), atol=1e-15)
    np.testing.assert_allclose(drawn(ax, "CM"), [[0.0, -np.sum(DISK_RADII) / 5]], atol=1e-15)
    np.testing.assert_allclose(drawn(ax, "GC"), [[0.0, 0.0]])
    np.testing.assert_allclose(drawn(ax, "$m_0$"), [[0.0, 0.0]])
    assert [text.get_text() for text in ax.texts] == ["$m_{1}$", "$m_{2}$", "$m_{3}$", "$m_{4}$"]
    assert ax.get_aspect() == 1.0


def test_the_ball_starts_with_its_centre_of_mass_above_the_geometric_centre():
    ax = plot.configuration(paper_ball())
    # Σ m χ of section 5's rounded angles, from an evaluation outside of this library; M = 4.
    np.testing.assert_allclose(4 * drawn(ax, "CM")[0], [2.6e-5, -7.9e-6, 0.683213], atol=5e-7)


def test_a_system_is_drawn_at_any_time_and_with_any_driven_angle():
    mass = jaxball.PointMass(1.0, jaxball.Driven(jaxball.Circle(0.5)))
    law = jaxball.FunctionLaw(lambda t, state, _: jnp.zeros(1))
    ball = jaxball.Ball(mass=1.0, inertia=(1, 1, 1), masses=[mass], law=law)
    np.testing.assert_allclose(drawn(plot.configuration(ball, theta=[np.pi / 2]), "CM"), [[0, 0, 0.25]], atol=1e-15)
    later = drawn(plot.configuration(paper_disk(), t=5.0), "CM")
    angles = -np.pi / 2 + np.array([-1, 1, -1, 1]) * travelled(5.0)
    np.testing.assert_allclose(later[0, 0], np.sum(DISK_RADII * np.cos(angles)) / 5, atol=1e-14)
    with refuses(ValueError, "theta"):
        plot.configuration(ball)


def test_the_disk_in_its_own_frame_over_time(disk_trajectory):
    ax = disk_trajectory.plot("body_paths")
    for i, radius in enumerate(DISK_RADII, start=1):
        t, x, z = drawn(ax, f"$m_{{{i}}}$").T
        theta = -np.pi / 2 + (-1) ** i * travelled(t)
        np.testing.assert_allclose(x, radius * np.cos(theta), atol=1e-13)
        np.testing.assert_allclose(z, radius * np.sin(theta), atol=1e-13)


def test_the_disk_in_space_is_with_turning_phi(disk_trajectory):
    inside = disk_trajectory.plot("body_paths", plane())
    outside = disk_trajectory.plot("space_paths", plane())
    phi = np.asarray(disk_trajectory.state.phi)
    for label in ("$m_{1}$", "$m_{2}$", "CM"):
        x, z = drawn(inside, label).T
        turned = [np.cos(phi) * x - np.sin(phi) * z, np.sin(phi) * x + np.cos(phi) * z]
        np.testing.assert_allclose(drawn(outside, label).T, turned, atol=1e-12)


def test_the_centre_of_mass_is_the_mean_of_shell_and_masses(ball_trajectory):
    ax = ball_trajectory.plot("body_paths")
    masses = [drawn(ax, f"$m_{{{i}}}$") for i in (1, 2, 3)]
    np.testing.assert_allclose(drawn(ax, "CM"), np.add(np.sum(masses, axis=0), [0.0, 0.0, -0.05]) / 4, atol=1e-14)


def test_rotation_to_space_keeps_lengths_and_the_start(ball_trajectory):
    inside, outside = ball_trajectory.plot("body_paths"), ball_trajectory.plot("space_paths")
    for label in ("$m_{1}$", "$m_{3}$", "CM"):
        a, b = drawn(inside, label), drawn(outside, label)
        np.testing.assert_allclose(np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1), rtol=1e-9)
        np.testing.assert_allclose(a[0], b[0], atol=1e-14)


def test_rates_and_paths_are_those_of_the_state(ball_trajectory, disk_trajectory):
    times, state = ball_trajectory.times, ball_trajectory.state
    ax = ball_trajectory.plot("angular_velocity")
    for j in range(3):
        np.testing.assert_array_equal(drawn(ax, rf"$\Omega_{j + 1}$"), np.column_stack([times, state.Omega[:, j]]))
    np.testing.assert_array_equal(ball_trajectory.plot("centre_path").lines[0].get_xydata(), state.z)
    disk = disk_trajectory.state
    np.testing.assert_array_equal(disk_trajectory.plot("angular_velocity").lines[0].get_ydata(), disk.phidot)
    np.testing.assert_array_equal(disk_trajectory.plot("centre_path").lines[0].get_ydata(), disk.z)


def test_energies_are_those_of_the_reference(ball_trajectory):
    ax = ball_trajectory.plot("energies")
    T, V, E = (drawn(ax, label)[:, 1] for label in ("$T$", "$V$", "$E = T + V$"))
    np.testing.assert_allclose(T + V, E, atol=1e-14)
    # From the 30-digit reference states, given to 8 decimals.
    np.testing.assert_allclose(E[[0, 20]], [0.68321332, 0.25880087], atol=1e-7)
    assert T[0] == 0.0


def test_power_and_forces_are_the_observables(ball_trajectory):
    observables = ball_trajectory.observables
    np.testing.assert_array_equal(ball_trajectory.plot("power").lines[0].get_ydata(), observables.power)
    forces = ball_trajectory.plot("contact_force")
    np.testing.assert_array_equal(drawn(forces, "$N$")[:, 1], observables.normal_force)
    friction = drawn(forces, r"$|\,\mathbf{f}\,|$")[:, 1]
    np.testing.assert_allclose(friction, np.hypot(*np.asarray(observables.friction).T), rtol=1e-12)
    ratio = ball_trajectory.plot("friction_ratio")
    np.testing.assert_allclose(ratio.lines[0].get_ydata(), friction / observables.normal_force, rtol=1e-12)


def test_the_largest_friction_ratio_is_marked(ball_trajectory):
    mark = ball_trajectory.plot("friction_ratio").lines[-1]
    np.testing.assert_allclose(mark.get_ydata(), [ball_trajectory.friction_needed], rtol=1e-12)
    assert rf"$\mu_{{\min}} = {mark.get_ydata()[0]:.4g}$" in mark.get_label()


@pytest.mark.thorough
def test_a_ball_that_would_leave_the_plane_has_no_ratio_there(bare_trajectory):
    ax = bare_trajectory.plot("friction_ratio")
    lifted = np.asarray(bare_trajectory.observables.normal_force) <= 0
    assert 0 < lifted.sum() < lifted.size
    np.testing.assert_array_equal(np.isnan(ax.lines[0].get_ydata()), lifted)
    first = np.asarray(bare_trajectory.times)[lifted][0]
    assert [text.get_text() for text in ax.texts] == [rf"not drawn where $N \leq 0$, first at $t = {first:.4g}$"]


def test_a_mass_has_one_colour_in_every_figure(disk_trajectory):
    for i in range(1, 5):
        label = f"$m_{{{i}}}$"
        colours = {
            line.get_color()
            for draw in (in_space.body_paths, in_space.space_paths)
            for line in draw(disk_trajectory).lines
            if line.get_label() == label
        }
        colours |= {
            text.get_color() for text in disk_trajectory.plot("configuration").texts if text.get_text() == label
        }
        assert len(colours) == 1


@pytest.mark.thorough
@pytest.mark.parametrize("heading", [0.0, 2.0, -1.0])
def test_downhill_is_where_a_ball_at_rest_begins_to_roll(heading):
    slope = jaxball.Ground(angle=0.2, heading=heading)
    ball = jaxball.Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=slope)
    run = jaxball.simulate(ball, [0.0, 0.5, 1.0], rtol=1e-6, atol=1e-6)
    ax = run.plot("centre_path")
    (arrow,) = (one for one in ax.collections if hasattr(one, "U"))
    moved = np.asarray(run.state.z[-1])
    np.testing.assert_allclose([arrow.U[0], arrow.V[0]], moved / np.linalg.norm(moved), atol=1e-6)
    assert "downhill" in [text.get_text() for text in ax.texts]


@pytest.mark.thorough
def test_the_velocity_of_the_centre_is_the_rate_of_its_place():
    """By central differences, of a ball on a turntable, which carries it along."""
    table = load_scenario("turntable")
    times = np.linspace(0.0, 2.0, 401)
    run = jaxball.simulate(table.system, times, table.state, rtol=1e-10, atol=1e-10)
    ax = run.plot("centre_velocity")
    for j in (0, 1):
        rate = np.gradient(np.asarray(run.state.z)[:, j], times)
        np.testing.assert_allclose(drawn(ax, f"$V_{j + 1}$")[1:-1, 1], rate[1:-1], atol=1e-4)
