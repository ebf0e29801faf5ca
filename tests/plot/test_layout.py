"""Every figure says what it shows, and none of its texts lies on another, on a curve or beyond the page."""

import tomllib
from typing import get_args

import matplotlib.ticker
import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxball import (
    Ball,
    BallState,
    Circle,
    ConstantRate,
    OnRail,
    PointMass,
    Scenario,
    Tube,
    load_scenario,
    plot,
    simulate,
)
from jaxball.files.scenario import Units, builtin_scenarios
from jaxball.files.scenario.sources import builtin_text
from jaxball.physics import ReleasedState
from jaxball.physics.sensors import Gyroscope
from jaxball.plot import report, space, time_series
from jaxball.plot.report import PANELS, STANDARD, standard_figures
from jaxball.plot.style import DASH, caption, plane_axes, up_to_ticks
from jaxball.simulation.trajectory_methods import Panel
from tests.plot.geometry import boxes, overlaps
from tests.support.sentences import refuses

SCENARIOS = builtin_scenarios()
# By their texts: to make all systems takes each process of the tests seconds.
ROLLING = [name for name in SCENARIOS if tomllib.loads(builtin_text(name))["kind"] in ("ball", "disk")]
T = np.linspace(0.0, 6.0, 61)
WAVES = np.sin(T[:, None] + np.arange(7))
SEARCH = np.exp(-np.arange(20.0) / 3)
DRAWN = {
    "convergence": lambda: plot.convergence(9 * SEARCH, np.where(SEARCH > 0.1, SEARCH, 0.0), SEARCH**2, polish=12),
    "branch": lambda: plot.branch(T + 1, {"root mean square error": T + 1, "effort": 1 / (T + 1)}, "weight of the end"),
    "path": lambda: plot.designed_path(WAVES[:, :2], WAVES[:, 1:3], WAVES[:, 2:4], [(np.zeros(2), 0.3)]),
    "place": lambda: plot.place_in_time({"before": (T, T), "after": (T, -T)}, (T, T / 2)),
    "angles": lambda: plot.rail_angles(T, WAVES),
    "accelerations": lambda: plot.rail_accelerations(T, WAVES[:, :3]),
}


def figure_of(drawn):
    return drawn if isinstance(drawn, Figure) else drawn.figure


@pytest.mark.long
@pytest.mark.parametrize("name", ROLLING)
def test_names_of_masses_hide_nothing(name):
    scenario = load_scenario(name)
    state = scenario.state.body if isinstance(scenario.state, ReleasedState) else scenario.state
    figure = figure_of(plot.configuration(scenario.system, theta=state.theta))
    assert overlaps(figure) == []
    caption(figure, scenario.system, scenario.title)
    assert overlaps(figure) == []


def crossing(offset):
    """Six masses at the middle of six tubes, two along each axis, which are this far from the centre."""
    tubes = [Tube(axis, side * np.roll(axis, 1)) for axis in np.eye(3) for side in (offset, -offset)]
    return [OnRail(tube, ConstantRate(0.0)) for tube in tubes]


CROWDED = {
    "six tubes": crossing(0.3),
    "six tubes side by side": crossing(0.05),
    "six tubes through one point": crossing(0.0),
    "nine concentric rails": [OnRail(Circle(0.1 * k), ConstantRate(-np.pi / 2)) for k in range(1, 10)],
}


@pytest.mark.long
@pytest.mark.parametrize("motions", CROWDED.values(), ids=CROWDED.keys())
def test_names_of_crowded_masses_are_apart(motions):
    ball = Ball(mass=1.0, inertia=(0.6, 0.6, 0.6), masses=[PointMass(0.1, motion) for motion in motions])
    figure = figure_of(plot.configuration(ball))
    names = [f"$m_{{{i}}}$" for i in range(1, len(motions) + 1)]
    assert [box.text for box in boxes(figure) if box.text in names] == names
    assert not [pair for pair in overlaps(figure) if pair[0] in names and (pair[1] in names or "page" in pair[1])]


@pytest.mark.long
@pytest.mark.parametrize("radius", [0.1085, 1.0, 12.75])
def test_numbers_at_the_corner_of_a_cube_are_apart(radius):
    ball = Ball(mass=1.0, inertia=(0.4 * radius**2,) * 3, radius=radius, offset=(0.0, 0.0, -0.1 * radius))
    run = simulate(ball, np.linspace(0.0, 1.0, 11), BallState(Omega=(0.5, 0.0, 0.0)))
    figure = run.plot()
    assert overlaps(figure) == []
    assert [label.get_text() for label in figure.axes[0].get_zticklabels()] == [
        f"\N{MINUS SIGN}{radius:g}",
        "0",
        f"{radius:g}",
    ]


@pytest.mark.thorough
def test_the_page_of_an_empty_body_has_no_panel_without_a_motion():
    """A homogeneous shell has its centre of mass in the middle at all times."""
    run = simulate(Ball(mass=1.0, inertia=(0.4,) * 3), np.linspace(0.0, 1.0, 11), BallState(Omega=(0.5, 0.0, 0.0)))
    figure = run.plot()
    labels = ["$z_2$", "$V_i$", r"$\Omega_i$", "energy"]
    assert [ax.get_ylabel() for ax in figure.axes[:4]] == labels
    assert overlaps(figure) == []


def test_masses_in_one_place_all_show():
    masses = [PointMass(0.1, motion) for motion in crossing(0.0)]
    ax = plot.configuration(Ball(mass=1.0, inertia=(0.6, 0.6, 0.6), masses=masses))
    sizes = [line.get_markersize() for line in ax.lines if line.get_marker() == "o"]
    assert len(sizes) == 6
    assert np.all(np.diff(sizes) < 0)


@pytest.mark.long
def test_joints_that_move_alike_all_show():
    """Where four curves are one, each has dashes in the gaps of the others."""
    scenario = load_scenario("spokes")
    run = scenario.simulate()
    drawn = run.plot("joint_angles").lines
    patterns = [line._unscaled_dash_pattern for line in drawn]
    assert [pattern[0] / DASH for pattern in patterns] == [0, 1, 2, 3]
    assert all(on == DASH and off == 3 * DASH for _, (on, off) in patterns[1:])


def test_masses_that_move_alike_all_show(disk_trajectory):
    """The paper's disk has two pairs, whose own dashes have gaps too narrow to see the other line through."""
    first, second, third, fourth = disk_trajectory.plot("mass_angles").lines[:4]
    assert [line.is_dashed() for line in (first, second, third, fourth)] == [False, False, True, True]
    assert {line._unscaled_dash_pattern[1] for line in (third, fourth)} == {(DASH, DASH)}


@pytest.mark.parametrize("value", [0.1204, 0.2, 0.35, 1.0, 17.3])
def test_a_constant_lies_between_two_numbers(value):
    ax = plane_axes(None)
    ax.plot([0.0, 1.0], [value, value])
    up_to_ticks(ax, low=0.0)
    low, high = ax.get_ylim()
    assert low <= value <= high * 1.005
    ticks = [tick for tick in ax.get_yticks() if low <= tick <= high]
    assert (ticks[0], ticks[-1]) == (low, high)


def test_a_run_draws_each_panel_that_its_plot_names(ball_trajectory):
    assert get_args(Panel) == tuple(PANELS)
    with refuses(ValueError, "panel"):
        ball_trajectory.plot("energy")


@pytest.mark.long
@pytest.mark.parametrize("draw", [*STANDARD, report.overview])
@pytest.mark.parametrize("body", ["ball", "disk"])
def test_texts_of_the_paper_s_runs_are_apart(body, draw, request):
    trajectory = request.getfixturevalue(f"{body}_trajectory")
    figure = figure_of(draw(trajectory))
    assert figure.get_suptitle() == (
        f"{body.title()} with {3 if body == 'ball' else 4} point masses; dimensionless,\N{NO-BREAK SPACE}$m_0=r=g=1$"
    )
    assert overlaps(figure) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENARIOS)
def test_texts_of_every_scenario_are_apart(name):
    scenario = load_scenario(name)
    rolling = name in ROLLING
    trajectory = scenario.simulate(dense=rolling, throw=True)
    for draw in (*standard_figures(trajectory), *([report.overview] if rolling else ())):
        figure = figure_of(draw(trajectory))
        caption(figure, scenario.system, scenario.title)
        assert overlaps(figure) == [], draw


@pytest.mark.thorough
@pytest.mark.parametrize("name", DRAWN)
def test_texts_of_designs_are_apart(name):
    ax = DRAWN[name]()
    caption(
        ax.figure, title="A ball that follows a curve of which a long title tells, with a mass to spare in its shell"
    )
    assert overlaps(ax.figure) == []
    assert ax.get_xlabel()
    assert ax.get_ylabel()


def test_reports_without_a_violation_are_marked():
    violation = np.array([1.0, 0.1, 0.0, 1e-6, 0.0])
    ax = plot.convergence(violation + 1, violation, violation + 1)
    (line,) = (line for line in ax.lines if line.get_label() == "violation")
    (held,) = (line for line in ax.lines if line.get_label() == "none violated")
    np.testing.assert_array_equal(line.get_ydata()[[0, 1, 3]], violation[[0, 1, 3]])
    np.testing.assert_array_equal(held.get_xdata(), [2, 4])
    ax.figure.draw_without_rendering()
    height = ax.transAxes.inverted().transform(held.get_transform().transform(held.get_xydata()))[:, 1]
    np.testing.assert_allclose(height, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    "draw", [time_series.friction_ratio, time_series.energies, time_series.angular_velocity, time_series.contact_force]
)
@pytest.mark.parametrize("body", ["ball", "disk"])
def test_all_that_is_drawn_lies_between_two_numbers(body, draw, request):
    ax = draw(request.getfixturevalue(f"{body}_trajectory"))
    low, high = ax.get_ylim()
    ticks = [tick for tick in ax.get_yticks() if low - 1e-9 <= tick <= high + 1e-9]
    values = np.concatenate([line.get_ydata() for line in ax.lines])
    hair = 0.006 * (high - low)  # a line is wider
    assert ticks[0] <= np.nanmin(values) + hair
    assert ticks[-1] >= np.nanmax(values) - hair
    assert 3 <= len(ticks) <= 8
    assert isinstance(ax.yaxis.get_major_locator(), matplotlib.ticker.MaxNLocator)


@pytest.mark.parametrize("draw", [space.body_paths, space.space_paths, space.centre_path])
def test_starts_and_ends_of_curves_are_in_the_legend(draw, ball_trajectory):
    ax = draw(ball_trajectory)
    assert {"start", "end"} <= {text.get_text() for text in ax.get_legend().get_texts()}
    coordinates = [
        np.column_stack(line.get_data_3d() if hasattr(line, "get_data_3d") else line.get_data()) for line in ax.lines
    ]
    rings = [points[0] for points, line in zip(coordinates, ax.lines, strict=True) if line.get_marker() == "o"]
    squares = [points[0] for points, line in zip(coordinates, ax.lines, strict=True) if line.get_marker() == "s"]
    for points in (points for points in coordinates if len(points) == len(ball_trajectory.times)):
        assert any(np.array_equal(points[0], ring) for ring in rings)
        assert any(np.array_equal(points[-1], square) for square in squares)


def test_a_title_is_shown_as_it_is_written(ball_trajectory):
    ax = ball_trajectory.plot("energies")
    caption(ax.figure, ball_trajectory.system, "Costs $5, or $6")
    assert ax.figure.get_suptitle().startswith(r"Costs \$5, or \$6; dimensionless")
    ax.figure.draw_without_rendering()


def test_units_are_those_of_the_parameters_where_they_are_not_one():
    ball = Ball(mass=2.0, inertia=(1.0, 1.0, 1.0))
    figure = figure_of(plot.configuration(ball))
    assert figure.get_suptitle() == "Ball with no point masses; in the units of its parameters"
    caption(figure, ball, "A shell")
    assert figure.get_suptitle() == "A shell; in the units of the scenario"


def test_figures_of_one_panel_have_the_caption_of_those_with_several():
    ball, start = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), radius=0.5, gravity=9.81), BallState(Omega=(0.0, 1.0, 0.2))
    scenario = Scenario("A shell", ball, start, np.array([0.0, 1.0]), units=Units("m", "kg", "s"))
    run, told = scenario.simulate(), "A shell; in m, kg, s"
    assert run.plot().get_suptitle() == told
    for draw in (
        time_series.angular_velocity,
        time_series.energies,
        time_series.friction_ratio,
        space.centre_path,
        space.space_paths,
    ):
        assert draw(run).figure.get_suptitle() == told
    assert run.plot("configuration").figure.get_suptitle() == told
    assert plot.configuration(ball).figure.get_suptitle() == "Ball with no point masses; in the units of its parameters"
    sensors = {"gyro": Gyroscope()}
    assert plot.measurements(run, sensors).get_suptitle() == told


CAPTIONED = {
    "convergence": lambda shown: plot.convergence(SEARCH, SEARCH, SEARCH, system=shown),
    "branch": lambda shown: plot.branch(T + 1, {"effort": 1 / (T + 1)}, system=shown),
    "path": lambda shown: plot.designed_path(WAVES[:, :2], WAVES[:, 1:3], system=shown),
    "place": lambda shown: plot.place_in_time({"before": (T, T)}, system=shown),
    "angles": lambda shown: plot.rail_angles(T, WAVES, system=shown),
    "accelerations": lambda shown: plot.rail_accelerations(T, WAVES, system=shown),
    "residuals": lambda shown: plot.law_residuals(T, {"energy": T}, system=shown),
}


@pytest.mark.parametrize("draw", CAPTIONED.values(), ids=CAPTIONED)
def test_figures_of_numbers_name_the_system_that_they_are_given(draw):
    ball = Ball(mass=2.0, inertia=(1.0, 1.0, 1.0))
    assert draw(ball).figure.get_suptitle() == "Ball with no point masses; in the units of its parameters"
    assert draw(None).figure.get_suptitle() == ""
