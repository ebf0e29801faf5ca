"""Figures of a body that slides and flies, against closed forms; until t = 1 it falls, with no force but its weight."""

import dataclasses

import equinox as eqx
import jax
import matplotlib.colors
import numpy as np
import pytest
from mpl_toolkits.mplot3d import proj3d
from scipy.spatial.transform import Rotation

from jaxball import Contact
from jaxball.physics import Mode
from jaxball.plot import time_series
from jaxball.plot.over_time import BANDS, PATHS, modes_of, track_of
from jaxball.plot.palette import TRAIL
from jaxball.plot.record import record
from jaxball.plot.scene import SHADOW, scene
from jaxball.plot.view.page import view_document
from tests.plot.geometry import overlaps
from tests.plot.lines import drawn
from tests.support.pages import arrays_of
from tests.support.sentences import refuses

OVER_TIME = (
    time_series.angular_velocity,
    time_series.energies,
    time_series.power,
    time_series.contact_force,
    time_series.friction_ratio,
    time_series.height,
    time_series.slip_speed,
)


def line_of(ax, k=0):
    return np.column_stack(ax.lines[k].get_data())


def bands(ax):
    """Start, end and colour of each."""
    edges = [band.get_x() for band in ax.patches], [band.get_x() + band.get_width() for band in ax.patches]
    colours = [matplotlib.colors.to_hex(band.get_facecolor()).upper() for band in ax.patches]
    return list(zip(*edges, colours, strict=True))


@pytest.fixture(scope="module")
def history(thrown_trajectory):
    return thrown_trajectory.contact


@pytest.fixture(scope="module")
def landed(history):
    """When the last flight ends, and when the slip does."""
    slides, rolls = (np.flatnonzero(history.switches.target == mode)[0] for mode in (Mode.SLIDING, Mode.ROLLING))
    return float(history.switches.times[slides]), float(history.switches.times[rolls])


@pytest.mark.long
def test_the_run_has_every_mode(history, landed):
    assert set(np.asarray(history.mode)) == {*Mode} - {Mode.REST}
    assert 1.0 < landed[0] < landed[1] < 11.0


@pytest.mark.long
@pytest.mark.parametrize("draw", OVER_TIME)
def test_bands_and_lines_are_where_the_modes_are(draw, thrown_trajectory, history, landed):
    ax = draw(thrown_trajectory)
    assert bands(ax) == [(0.0, landed[0], BANDS[Mode.FLIGHT]), (*landed, BANDS[Mode.SLIDING])]
    count = int(history.switches.count)
    upright = [float(line.get_xdata()[0]) for line in ax.lines if list(line.get_ydata()) == [0, 1]]
    assert upright == np.asarray(history.switches.times)[:count].tolist()
    assert {"flight", "sliding"} <= {text.get_text() for text in ax.get_legend().get_texts()}
    assert ax.get_xlim() == (0.0, 11.0)
    assert overlaps(ax.figure) == []


@pytest.mark.thorough
def test_height_is_that_of_a_fall(thrown_trajectory):
    t, h = line_of(thrown_trajectory.plot("height")).T
    falls = t < 1
    np.testing.assert_allclose(h[falls], 0.5 - t[falls] ** 2 / 2, atol=1e-12)
    assert h[-1] == 0.0


@pytest.mark.thorough
def test_impacts_are_upright_and_reach_the_plane(thrown_trajectory, history):
    """At t = 1 it falls at the speed 1 and rebounds at 0.6; friction turns it, and h is 0 on both sides."""
    t, h = line_of(thrown_trajectory.plot("height")).T
    count = int(history.switches.count)
    for when in np.asarray(history.switches.times)[:count]:
        assert h[t == when].tolist() == [0.0, 0.0]
    V = drawn(thrown_trajectory.plot("centre_velocity"), "$V_3$")
    np.testing.assert_allclose(V[V[:, 0] == float(history.switches.times[0])][:, 1], [-1.0, 0.6], atol=1e-9)
    E = drawn(thrown_trajectory.plot("energies"), "$E = T + V$")
    before, after = E[E[:, 0] == float(history.switches.times[0])][:, 1]
    np.testing.assert_allclose(before - after, history.switches.lost[0], rtol=1e-6)


@pytest.mark.thorough
def test_slip_speed_is_that_of_the_throw(thrown_trajectory, landed):
    """v_s = V − r ω × e3 = (2 + 8, ½) while nothing touches the ball, and 0 at the end."""
    t, speed = line_of(thrown_trajectory.plot("slip_speed")).T
    np.testing.assert_allclose(speed[t < 1], np.hypot(10.0, 0.5), rtol=1e-12)
    assert np.all(speed[t > landed[1]] == 0.0)


def test_what_friction_and_impacts_took_is_what_is_missing(thrown_trajectory):
    """½ m V² + ½ 0.4 ω² + m g h at the start."""
    ax = thrown_trajectory.plot("energies")
    E, friction_loss, impact_loss = (drawn(ax, name)[:, 1] for name in ("$E = T + V$", "to friction", "to impacts"))
    np.testing.assert_allclose(E + friction_loss + impact_loss, (4.25 + 0.4 * 64) / 2 + 0.5, rtol=1e-6)
    assert friction_loss[-1] > 1
    assert impact_loss[-1] > 1


@pytest.mark.thorough
def test_friction_is_that_of_the_law(thrown_trajectory, landed):
    """|f| = μ N where the ball slides, none where it rolls on a level, and nothing is drawn of flight."""
    ax = thrown_trajectory.plot("friction_ratio")
    for label, value in ((r"$\mu_s = 0.35$", 0.35), (r"$\mu = 0.3$", 0.3)):
        assert drawn(ax, label)[:, 1].tolist() == [value, value]
    t, ratio = line_of(ax, 2).T
    assert np.isnan(ratio[t < landed[0]]).all()
    np.testing.assert_allclose(ratio[(t > landed[0]) & (t < landed[1])], 0.3, rtol=1e-12)
    np.testing.assert_allclose(ratio[t > landed[1]], 0.0, atol=1e-6)
    for change, before, after in ((landed[0], np.nan, 0.3), (landed[1], 0.3, 0.0)):
        np.testing.assert_allclose(ratio[t == change], [before, np.nan, after], atol=1e-6)  # both sides, and a gap
    force = thrown_trajectory.plot("contact_force")
    np.testing.assert_array_equal(drawn(force, r"$\mu_s N$")[:, 1], 0.35 * drawn(force, "$N$")[:, 1])
    t, N = drawn(force, "$N$").T
    np.testing.assert_allclose(N[(t < landed[0]) | (t > landed[0])][[0, -1]], [0.0, 1.0], atol=1e-9)


def test_one_coefficient_is_one_line(thrown_trajectory):
    law = Contact(0.3)
    alike = eqx.tree_at(lambda run: run.contact.law, thrown_trajectory, dataclasses.replace(law, restitution=0.6))
    assert drawn(alike.plot("friction_ratio"), r"$\mu_s = \mu = 0.3$")[0, 1] == 0.3


@pytest.mark.thorough
def test_the_path_has_a_line_for_each_mode_and_marks_at_switches(thrown_trajectory, history):
    ax = thrown_trajectory.plot("centre_path")
    count = int(history.switches.count)
    np.testing.assert_allclose(drawn(ax, "switch"), history.switches.after.body.z[:count], atol=1e-9)
    pieces = [drawn(ax, mode.name.lower()) for mode in PATHS]
    seen = {tuple(point) for piece in pieces for point in piece}
    assert {tuple(z) for z in np.asarray(thrown_trajectory.state.z)} < seen
    flight = pieces[Mode.FLIGHT]
    straight = flight[flight[:, 0] <= 2.0]  # until the first impact, at t = 1
    np.testing.assert_allclose(straight[:, 1], straight[:, 0] / 4, atol=1e-12)
    styles = {line.get_label(): str(line._dash_pattern) for line in ax.lines}  # the linestyle is "--" of all dashes
    assert len({styles[mode.name.lower()] for mode in PATHS}) == len(PATHS)
    assert overlaps(ax.figure) == []


def test_a_piece_has_a_break_where_another_mode_is_between(thrown_trajectory):
    track = track_of(thrown_trajectory)
    alternating = track._replace(modes=[Mode.SLIDING, Mode.FLIGHT, Mode.SLIDING], times=np.arange(4.0))
    times, points = alternating._replace(points=np.outer(np.arange(4.0), [1.0, 0.0, 0.0])).pieces(Mode.SLIDING)
    np.testing.assert_array_equal(points[:, 0], [0.0, 1.0, np.nan, 2.0, 3.0, np.nan])
    np.testing.assert_array_equal(times, [0.0, 1.0, 1.0, 2.0, 3.0, 3.0])


@pytest.mark.thorough
def test_modes_after_the_last_switch_that_is_kept_are_those_of_the_saved_times(thrown_trajectory, landed):
    few = Contact(0.3, 0.35, 0.6, 0.05, capacity=2)
    switches = jax.tree.map(lambda leaf: leaf[:2] if leaf.ndim else leaf, thrown_trajectory.contact.switches)
    short = dataclasses.replace(thrown_trajectory.contact, law=few, switches=switches)
    modes = modes_of(dataclasses.replace(thrown_trajectory, history=short))
    assert [spell.mode for spell in modes.spells] == [Mode.FLIGHT, Mode.SLIDING, Mode.ROLLING]
    step = 0.1
    np.testing.assert_array_less(modes.changes - landed, step)
    np.testing.assert_array_less(0.0, modes.changes - landed)


@pytest.mark.long
def test_the_page_has_a_row_for_the_contact_and_names_its_bands_once(thrown_trajectory, ball_trajectory, tmp_path):
    page = thrown_trajectory.plot()
    assert len(page.axes) == 8
    (legend,) = page.legends
    assert [text.get_text() for text in legend.get_texts()] == ["sliding", "flight"]
    assert overlaps(page) == []
    names = {path.stem for path in thrown_trajectory.save_figures(tmp_path)}
    assert {"ball_height", "ball_slip_speed"} < names
    rolling = ball_trajectory.plot()
    assert (len(rolling.axes), len(rolling.legends), sum(len(ax.patches) for ax in rolling.axes[3:])) == (6, 0, 0)


def test_a_run_without_a_law_has_no_slip_to_draw(ball_trajectory):
    for draw in (time_series.height, time_series.slip_speed):
        with refuses(ValueError, "trajectory"):
            draw(ball_trajectory)


@pytest.mark.thorough
@pytest.mark.parametrize(("k", "word"), [(5, "flight"), (60, "sliding"), (110, "rolling")])
def test_a_scene_shows_the_ball_over_its_shadow(thrown_trajectory, history, k, word):
    """At t = ½ the ball is at (1, ¼), and ½ − ⅛ high."""
    figure, show = scene(thrown_trajectory, record(thrown_trajectory))
    show(k)
    ax = figure.axes[0]
    star = next(line for line in ax.lines if line.get_label() == "CM")
    place = np.array([*np.asarray(thrown_trajectory.state.z)[k], history.height[k]])
    if word == "flight":
        np.testing.assert_allclose(place, [1.0, 0.25, 0.375], atol=1e-12)
    np.testing.assert_allclose(np.ravel(star.get_data_3d()), place, atol=1e-12)
    shadow = next(one for one in ax.collections if np.allclose(one.get_facecolor()[0, :3], float(SHADOW)))
    shadow.do_3d_projection()
    corners = shadow.get_paths()[0].vertices
    below = proj3d.proj_transform(*place[:2], -1.0, ax.get_proj())[:2]
    np.testing.assert_allclose((corners.min(axis=0) + corners.max(axis=0)) / 2, below, atol=1e-6)
    trails = [np.column_stack(line.get_data_3d()) for line in ax.lines if line.get_color() == TRAIL]
    ends = np.concatenate([trail[np.isfinite(trail[:, 0])][-1:] for trail in trails])
    assert np.any(np.all(np.abs(ends - (place - [0.0, 0.0, 1.0])) < 1e-12, axis=1))
    assert f"{k / 10:.2f}  {word}" in [text.get_text() for text in ax.texts]


@pytest.fixture(scope="module")
def document(thrown_trajectory):
    return view_document(thrown_trajectory)


@pytest.mark.thorough
def test_a_view_has_the_modes_and_the_coefficients(document, history, landed):
    (body,) = document["bodies"]
    assert body["spells"] == [["flight", 0.0, landed[0]], ["sliding", *landed], ["rolling", landed[1], 11.0]]
    assert body["switches"] == np.asarray(history.switches.times)[: int(history.switches.count)].tolist()
    graphs = {graph["title"]: graph for graph in document["plots"]}
    assert list(graphs) == ["Energies", "Angular velocity", "Normal force", "Friction", "Height", "Slip speed"]
    assert graphs["Friction"]["levels"] == [{"name": "μₛ", "value": 0.35}, {"name": "μ", "value": 0.3}]
    assert document["cone"] == 0.35
    assert [one["name"] for one in graphs["Energies"]["series"]] == ["T", "V", "E", "to friction", "to impacts"]


@pytest.mark.thorough
def test_a_view_has_the_height_and_the_momentum_of_what_slips(thrown_trajectory, document, history):
    """Π of a homogeneous ball on a level is that of the throw, 0.4 ω + e3 × V: no force has a torque about the point.

    To 1e-4, because the orientation is interpolated between the steps.
    """
    arrays = arrays_of(document)
    saved = np.isin(arrays["time"], np.asarray(thrown_trajectory.times))
    heights = np.interp(arrays["time"][saved], np.asarray(thrown_trajectory.times), np.asarray(history.height))
    np.testing.assert_allclose(arrays["centre"][saved, 2], heights, atol=1e-6)
    momentum = Rotation.from_quat(arrays["quaternion"]).apply(arrays["angular_momentum"])
    np.testing.assert_allclose(momentum, np.broadcast_to([-0.5, -8 * 0.4 + 2.0, 0.0], momentum.shape), atol=1e-4)
    np.testing.assert_allclose(arrays["taken"][-1], [history.friction_loss[-1], history.impact_loss[-1]], rtol=1e-6)


def test_runs_with_laws_and_without_are_shown_together(thrown_trajectory, ball_trajectory):
    both = view_document({"rolls": ball_trajectory, "flies": thrown_trajectory})
    assert "cone" not in both
    titles = [graph["title"] for graph in both["plots"]]
    assert titles[3:6] == ["Friction needed", "Height", "Slip speed"]
