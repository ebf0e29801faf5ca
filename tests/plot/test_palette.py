"""Colours and dashes of figures and views, as readers see them who see fewer colours, or none."""

import numpy as np
import pytest

from jaxball.plot import time_series
from jaxball.plot.over_time import BANDS
from jaxball.plot.palette import COMPONENTS, INK, TAKEN, mass_look
from jaxball.plot.view.page import view_document
from tests.support.colour_vision import contrast, distance, nearest

APART = 12.0  # in CIELAB: far more than is just seen, for thin lines that are not side by side


def looks(ax):
    """The colour and the dashes of each line over time that is not a mark or a background."""
    lines = [line for line in ax.lines if line.get_label()[:1] != "_" and line.get_linestyle() != "None"]
    return [(line.get_color(), str(line._unscaled_dash_pattern)) for line in lines]


def test_the_simulation_takes_red_and_green_for_one_where_readers_do():
    """The V and the "to friction" of former figures were nearly one to a deuteranope."""
    red, green = "#BB5566", "#009E73"
    assert distance(red, green) > 60
    assert distance(red, green, "deuteranopia") < APART
    assert distance("#ffffff", "#000000", "grey") == pytest.approx(100.0, abs=0.1)
    assert contrast("#ffffff", "#000000") == pytest.approx(21.0)


def test_masses_and_components_are_told_apart():
    masses = [mass_look(i) for i in range(1, 13)]
    assert len(set(masses)) == 12
    assert nearest(masses[:6])[0] > APART
    assert nearest([(colour, "") for colour in (*COMPONENTS, INK)])[0] > APART
    assert all(distance(*BANDS.values(), sight) > 4 for sight in ("normal", "protanopia", "deuteranopia", "grey"))
    assert not {look.colour for look in TAKEN.values()} & {look.colour for look in masses}


@pytest.mark.long
@pytest.mark.parametrize(
    "draw",
    [
        time_series.energies,
        time_series.contact_force,
        time_series.angular_velocity,
        time_series.attitude,
        time_series.centre_velocity,
        time_series.friction_ratio,
    ],
)
def test_lines_of_one_panel_are_told_apart(draw, thrown_trajectory, ball_trajectory):
    for run in (thrown_trajectory, ball_trajectory):
        assert nearest(looks(draw(run)))[0] > APART


@pytest.mark.thorough
def test_lines_of_one_graph_of_a_view_are_told_apart(thrown_trajectory, ball_trajectory):
    for run in (thrown_trajectory, ball_trajectory):
        for graph in view_document(run)["plots"]:
            lines = [(INK if one["colour"] == "ink" else one["colour"], tuple(one["dash"])) for one in graph["series"]]
            assert nearest(lines)[0] > APART, graph["title"]


@pytest.mark.thorough
def test_a_view_has_the_looks_of_the_figures(thrown_trajectory):
    energies = {one["name"]: one["colour"] for one in view_document(thrown_trajectory)["plots"][0]["series"]}
    figure = {line.get_label(): line.get_color() for line in thrown_trajectory.plot("energies").lines}
    assert [energies[name] for name in TAKEN] == [figure[name] for name in TAKEN]
    assert (energies["T"], energies["V"]) == (figure["$T$"], figure["$V$"])


def test_lines_that_coincide_on_paper_have_interleaved_dashes(thrown_trajectory):
    """0 and 1e-10 beside a line up to 1: one of both would hide the other."""
    from jaxball.plot.over_time import Series, over_time

    t = np.linspace(0.0, 1.0, 50)
    series = [Series(0 * t, "a", "C0"), Series(0 * t + 1e-10, "b", "C1"), Series(t, "c", "C2")]
    a, b, c = over_time(thrown_trajectory.system, t, series, "", None, size=1.0).lines[:3]
    assert [line.is_dashed() for line in (a, b, c)] == [False, True, False]
    assert b.get_zorder() > a.get_zorder()


@pytest.mark.thorough
def test_rounding_is_drawn_as_zero(ball_trajectory):
    from jaxball.plot.over_time import Series, over_time

    t = np.linspace(0.0, 1.0, 50)
    (line, *_) = over_time(ball_trajectory.system, t, [Series(1e-15 * np.sin(t), "", "C0")], "", None, size=1.0).lines
    assert np.all(line.get_ydata() == 0)
