"""Pictures of studies draw each row where it is, and those that failed too."""

import re

import matplotlib.image
import numpy as np
import pytest
import xarray
from matplotlib.collections import LineCollection, PathCollection, QuadMesh
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, StepPatch

from jaxball import plot
from jaxball.cli import main
from jaxball.files.scenario.initial import INITIAL
from jaxball.plot.sweeps import figures
from jaxball.plot.sweeps.rows import (
    NUMBERS,
    in_plain_text,
    label_of,
    number_label,
    plain,
    rows_of,
    sample,
    standard_results,
    sweep_scale,
)
from jaxball.studies.sweep.outputs import layout_of
from tests.plot.geometry import overlaps
from tests.plot.lines import drawn
from tests.plot.studies import DESIGN, GRID, HEAVY, MASSES, balls, disks, g, heavy_ones_fail, m, store
from tests.support.sentences import refuses, said
from tests.sweep.studies import GRAVITIES, pretend, study

OVER_MASS, TIMES = "body.mass", 'save = "times"'


def texts(ax):
    """The title and the entries of the legend."""
    legend = ax.get_legend()
    return [ax.get_title() if legend is None else legend.get_title().get_text()] + (
        [] if legend is None else [text.get_text() for text in legend.get_texts()]
    )


def only(ax, kind):
    """The one artist of a kind."""
    (match,) = (item for item in ax.get_children() if isinstance(item, kind))
    return match


def kept(values):
    """The values of rows that succeeded, NaN for others."""
    return np.where(values > HEAVY, np.nan, values)


@pytest.mark.thorough
def test_a_slice_is_at_the_middle_of_other_axes():
    ax = plot.sweep_slice(disks(), "phi", OVER_MASS)
    np.testing.assert_allclose(ax.lines[0].get_xydata(), np.column_stack([m, kept(m)]), rtol=1e-15)
    np.testing.assert_allclose(drawn(ax, "MAX_STEPS (1)")[:, 0], m[m > HEAVY])
    assert texts(ax) == ["$g$ = 1", "MAX_STEPS (1)"]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("$m_0$ (mass)", r"$\phi$ at the end (rad)")
    assert ax.get_xscale() == "log"


def test_a_slice_is_at_the_numbers_that_are_given():
    ax = plot.sweep_slice(disks(), "z", "body.gravity", at={OVER_MASS: 0.8})
    np.testing.assert_allclose(ax.lines[0].get_xydata(), np.column_stack([g, -m[1] * g]), rtol=1e-15)
    assert texts(ax) == ["$m_0$ = 0.7071"]
    assert ax.get_xscale() == "linear"


def test_failed_rows_stand_below_all_that_is_drawn():
    ax = plot.sweep_slice(disks(), "phi", OVER_MASS, by="body.gravity")
    ax.figure.draw_without_rendering()
    (marks,) = (line for line in ax.lines if line.get_label() == "MAX_STEPS (4)")
    height = (kept(m[:, None] * g) - ax.get_ylim()[0]) / np.ptp(ax.get_ylim())
    assert 0 < np.max(marks.get_ydata()) < np.nanmin(height)


def test_a_curve_for_each_point_of_another_axis():
    ax = plot.sweep_slice(disks(), "phi", OVER_MASS, by="body.gravity")
    for gravity in g:
        np.testing.assert_allclose(drawn(ax, f"$g$ = {gravity:.4g}")[:, 1], kept(m * gravity), rtol=1e-15)
    assert texts(ax)[1:] == ["$g$ = 0.5", "$g$ = 1", "$g$ = 2", "MAX_STEPS (4)"]


@pytest.mark.thorough
def test_no_line_joins_the_points_of_a_design():
    ax = plot.sweep_slice(disks(DESIGN), "steps", OVER_MASS)
    assert ax.lines[0].get_linestyle() == "None"
    assert np.count_nonzero(np.isfinite(ax.lines[0].get_ydata())) == np.sum(disks(DESIGN)["status"].values == 0)


def test_cells_of_a_map_are_around_their_numbers():
    ax = plot.sweep_map(disks(), "phi", OVER_MASS, "body.gravity")
    mesh = only(ax, QuadMesh)
    np.testing.assert_allclose(np.ma.filled(mesh.get_array(), np.nan), kept(m * g[:, None]), rtol=1e-15)
    x, y = np.moveaxis(mesh.get_coordinates(), -1, 0)
    np.testing.assert_allclose(np.sqrt(x[0, 1:] * x[0, :-1]), m, rtol=1e-14)
    np.testing.assert_allclose(y[1:-1, 0], [0.75, 1.5])
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "linear")


def test_failed_cells_are_hatched():
    ax = plot.sweep_map(disks(), "phi", OVER_MASS, "body.gravity")
    patch = only(ax, PathPatch)
    corners = patch.get_path().vertices.reshape(-1, 5, 2)[:, :4]
    centres = {(round(float(np.sqrt(x[0] * x[1])), 9), y[0] < 2.0 < y[2]) for x, y in np.moveaxis(corners, 2, 1)}
    # Each mass with its heaviest gravity is above HEAVY from m = 1 on, and the heaviest one with g = 1 too.
    assert centres == {(1.0, True), (1.414213562, True), (2.0, True), (2.0, False)}
    assert patch.get_hatch()
    assert texts(ax) == ["", "MAX_STEPS (4)"]


def test_cells_of_rows_that_are_to_come_are_empty(tmp_path):
    path = store(tmp_path, GRID, "chunk = 6", engine=pretend, shard=(1, 2))
    with xarray.open_zarr(path) as data:
        mesh = only(plot.sweep_map(data, "phi", OVER_MASS, "body.gravity"), QuadMesh)
    expected = m[:, None] * g
    expected.reshape(-1)[6:12] = np.nan  # the second of three chunks
    np.testing.assert_allclose(np.ma.filled(mesh.get_array(), np.nan), expected.T, rtol=1e-15)
    x = mesh.get_coordinates()[0, :, 0]
    np.testing.assert_allclose(np.sqrt(x[1:] * x[:-1]), m, rtol=1e-14)


def test_points_of_a_design_are_dots():
    ax, data = plot.sweep_map(disks(DESIGN), "phi", OVER_MASS, "body.gravity"), disks(DESIGN)
    both = np.column_stack([data[OVER_MASS], data["body.gravity"]])
    good = np.prod(both, axis=1) <= HEAVY
    dots = only(ax, PathCollection)
    np.testing.assert_array_equal(dots.get_offsets(), both[good])
    np.testing.assert_array_equal(dots.get_array(), np.prod(both[good], axis=1))
    np.testing.assert_array_equal(drawn(ax, f"MAX_STEPS ({np.sum(~good)})"), both[~good])
    assert ax.get_xscale() == "log"


def test_a_fan_of_disks_is_coloured_by_the_number():
    ax = plot.sweep_fan(disks(GRID, TIMES), OVER_MASS, at={"body.gravity": 2.0})
    curves, t = only(ax, LineCollection), np.linspace(0.0, 2.0, 5)
    good, heavy = m[2 * m <= HEAVY], m[2 * m > HEAVY]
    for mass, points in zip([*good, *heavy], curves.get_segments(), strict=True):
        np.testing.assert_allclose(points, np.column_stack([t, -2 * mass + 0 * t])[: 5 if mass in good else 3])
    bar = ax.figure.axes[1]
    assert bar.get_ylabel() == "$m_0$ (mass)"
    np.testing.assert_allclose(bar.get_ylim(), [0.5, 2.0])
    shown = LogNorm(0.5, 2.0)(good)
    np.testing.assert_allclose(curves.get_colors()[: len(good)], matplotlib.colormaps["viridis"](shown))
    np.testing.assert_allclose(drawn(ax, "MAX_STEPS (3)"), np.column_stack([0 * heavy + 1.0, -2 * heavy]))
    assert texts(ax) == ["$g$ = 2", "MAX_STEPS (3)"]


def test_a_fan_of_balls_is_in_the_plane():
    ax = plot.sweep_fan(balls([0, 0, 3]), "initial.speed")
    segments = only(ax, LineCollection).get_segments()
    np.testing.assert_allclose(segments[1], np.column_stack([np.arange(5.0), np.arange(5.0)]))
    np.testing.assert_allclose(drawn(ax, "IMPOSSIBLE (1)"), [[4.0, 2.0]])
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_aspect()) == ("$z_{1}$ (length)", "$z_{2}$ (length)", 1.0)
    over_time = plot.sweep_fan(balls([0, 0]), "initial.speed", result="z[0]")
    np.testing.assert_allclose(only(over_time, LineCollection).get_segments()[1][:, 1], np.arange(5.0))


def test_a_matrix_has_every_pair_once():
    data = disks(DESIGN)
    figure = plot.sweep_matrix(data, ["phi", "steps"])
    mass, gravity = (data[path].values for path in (OVER_MASS, "body.gravity"))
    good = mass * gravity <= HEAVY
    panels = [ax for ax in figure.axes if ax.lines]
    assert (len(panels), len(figure.axes)) == (6, 10)
    np.testing.assert_array_equal(panels[0].lines[0].get_xydata(), np.column_stack([mass, gravity])[good])
    np.testing.assert_array_equal(panels[0].lines[1].get_xydata(), np.column_stack([mass, gravity])[~good])
    np.testing.assert_array_equal(panels[1].lines[0].get_xydata(), np.column_stack([mass, mass * gravity])[good])
    np.testing.assert_array_equal(panels[1].lines[1].get_xdata(), mass[~good])
    assert counted(figure.axes[0]) == [good.sum(), (~good).sum()]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [f"MAX_STEPS ({np.sum(~good)})"]


def test_the_key_of_a_matrix_is_below_a_caption_of_several_lines():
    figure = plot.sweep_matrix(disks(DESIGN).assign_attrs(title="Disks of many masses, " * 24), ["phi", "steps"])
    figure.canvas.draw()
    (key,) = figure.legends
    (caption,) = (text for text in figure.texts if text.get_text() == figure.get_suptitle())
    assert caption.get_text().count("\n") > 1
    assert key.get_window_extent().y1 <= caption.get_window_extent().y0


def counted(ax):
    """How many rows each stack of a histogram has in all."""
    stacks = [patch.get_data() for patch in ax.patches if isinstance(patch, StepPatch)]
    return [np.sum(stack.values - stack.baseline) for stack in stacks]


@pytest.mark.thorough
@pytest.mark.parametrize("count", [7, 41, 100])
def test_a_grid_has_a_bar_for_each_of_its_points(count):
    """Bars over a part of the points would have now one of them, now two: a comb. They count the rows that failed,
    because as many rows as at each other point would be a square.
    """
    axes = f'[[axes]]\npath = "body.mass"\nlinear = {{ from = 0.1, to = 1.0, count = {count} }}\n' + GRAVITIES
    data = disks(axes)
    (bars,) = (patch.get_data() for patch in plot.sweep_matrix(data, ["phi"], [OVER_MASS]).axes[0].patches[:1])
    np.testing.assert_allclose((bars.edges[1:] + bars.edges[:-1]) / 2, np.linspace(0.1, 1.0, count), rtol=1e-12)
    np.testing.assert_array_equal(bars.values, np.sum(data["status"].values.reshape(count, 3) != 0, axis=1))


def test_the_histogram_of_a_grid_without_failures_is_empty():
    data = balls([0] * 5)
    data.attrs["axis_scattered"] = [0]
    first = plot.sweep_matrix(data, ["z[0]"]).axes[0]
    assert counted(first) == []
    low, high = first.get_xlim()
    assert low < 0 < 4 < high  # the numbers from 0 to 4


def test_results_below_the_tolerance_are_zero_in_a_matrix():
    """1e-16 of a length is an error of the solve, whose tolerance is 1e-8, as the file of the scenario says."""
    data = balls([0] * 5)
    data.z.values[..., 1] = 1e-16 * np.arange(5)[:, None]
    data.attrs["scenario"] = "[solve]\natol = 1e-8\n"
    panel = plot.sweep_matrix(data, ["z[1]"]).axes[1]
    assert panel.get_ylabel() == "$z_{2}$ at the end (length)\n0 to within $10^{-8}$"
    np.testing.assert_array_equal(panel.lines[0].get_ydata(), 0.0)


def test_powers_of_ten_are_in_the_labels_of_a_matrix():
    """In the corner of a panel, where matplotlib writes them, they would lie on its label."""
    data = balls([0] * 5)
    data.z.values[..., 1] = 1e-5 * (1 + np.arange(5)[:, None])
    panel = plot.sweep_matrix(data, ["z[1]"]).axes[1]
    assert panel.get_ylabel() == "$z_{2}$ at the end (length)\nin $10^{-5}$"
    np.testing.assert_allclose(panel.lines[0].get_ydata(), np.arange(1.0, 6.0))


@pytest.mark.parametrize(("first", "last", "bars", "each"), [(7, 36, 15, 2), (0, 99, 20, 5), (3, 12, 10, 1)])
def test_each_bar_has_as_many_whole_numbers(first, last, bars, each):
    steps = np.arange(first, last + 1)
    data = balls([0] * len(steps)).assign(steps=("row", steps))
    stack = plot.sweep_matrix(data, ["steps"]).axes[-1].patches[0].get_data()
    np.testing.assert_array_equal(stack.values, np.full(bars, each))
    np.testing.assert_allclose(stack.edges[:2], [first - 0.5, first - 0.5 + each])


def test_what_the_study_finds_is_drawn_first():
    data = store_of_finds()
    assert standard_results(data) == ["largest_speed", "distance", "z", "steps"]
    drawn = [ax.get_ylabel() for ax in plot.sweep_matrix(data).axes if ax.get_ylabel()]
    assert drawn[1:3] == ["largest speed (length)", "distance (length)"]
    assert standard_results(disks())[:2] == ["z", "phi"]


def store_of_finds():
    """A study of disks that was to find the largest speed and the distance, in this order."""
    data = disks()
    more = {"distance": data["z"], "largest_speed": data["z"], "largest_speed_time": data["z"]}
    return data.assign(more).assign_attrs(finds=["largest_speed", "distance"])


def test_a_store_says_what_its_study_finds(tmp_path):
    data = study(tmp_path, MASSES, 'find = ["largest_angular_speed", "distance"]')
    assert layout_of(data)["finds"] == ["largest_angular_speed", "distance"]
    assert "finds" not in layout_of(study(tmp_path, MASSES, ""))


@pytest.mark.long
@pytest.mark.parametrize(
    "draw",
    [
        lambda data: plot.sweep_slice(data, "phi", OVER_MASS).figure,
        lambda data: plot.sweep_map(data, "phi", OVER_MASS, "body.gravity").figure,
        lambda data: plot.sweep_matrix(data),
    ],
)
def test_a_picture_says_which_study_it_shows(draw):
    data = disks()
    figure = draw(data.assign_attrs(title="Heavy disks"))
    assert figure.get_suptitle() == "Heavy disks; in the units of the scenario"
    assert overlaps(figure) == []
    assert figure.get_suptitle() != draw(data.assign_attrs(title="")).get_suptitle()
    stated = 'units = { length = "m", mass = "kg", time = "s" }\n' + data.attrs["scenario"]
    assert draw(data.assign_attrs(title="Heavy disks", scenario=stated)).get_suptitle() == "Heavy disks; in m, kg, s"


def test_results_that_are_infinite_are_tell_numbers_apart():
    data = disks().copy()
    data["phi"] = data["phi"].where(data["phi"] < 1.2, np.inf)
    ax = plot.sweep_slice(data, "phi", OVER_MASS)
    assert texts(ax)[1:] == ["not finite (1)", "MAX_STEPS (1)"]
    np.testing.assert_allclose(drawn(ax, "not finite (1)")[0, 0], np.sqrt(2.0))


def test_a_sample_is_always_the_same_and_has_some_that_failed():
    rows = rows_of(balls([0] * 500 + [1] + [0] * 500))
    chosen, sentences = sample(rows, 100)
    assert sentences == ["100 of 1,001 rows drawn"]
    assert len(np.unique(chosen)) == 100
    assert 500 in chosen
    np.testing.assert_array_equal(chosen, sample(rows, 100)[0])
    everything, sentences = sample(rows, 1001)
    assert (len(everything), sentences) == (1001, [])


def test_too_many_rows_are_drawn_in_part_and_the_title_says_so(monkeypatch):
    for name, most in (("MOST_DRAWN", 3), ("MOST_CELLS", 2), ("MOST_PATHS", 2)):
        monkeypatch.setattr(figures, name, most)
    assert texts(plot.sweep_slice(disks(), "phi", OVER_MASS))[0] == "$g$ = 1; 3 of 5 rows drawn"
    ax = plot.sweep_map(disks(), "phi", OVER_MASS, "body.gravity")
    assert texts(ax) == ["4 of 15 rows drawn", "MAX_STEPS (4)"]
    np.testing.assert_allclose(
        np.ma.filled(only(ax, QuadMesh).get_array(), np.nan), kept(m[[0, 3]] * g[[0, 2]][:, None])
    )
    assert len(only(plot.sweep_fan(balls([0] * 9), "initial.speed"), LineCollection).get_segments()) == 2


def test_functions_draw_into_the_axes_that_they_are_given():
    for draw in (
        lambda ax: plot.sweep_slice(disks(), "phi", OVER_MASS, ax),
        lambda ax: plot.sweep_map(disks(), "phi", OVER_MASS, "body.gravity", ax),
        lambda ax: plot.sweep_fan(disks(GRID, TIMES), OVER_MASS, ax),
    ):
        ax = Figure().add_subplot()
        assert draw(ax) is ax
        with refuses(ValueError, "ax"):
            draw(Figure().add_subplot(projection="3d"))


def altered(**status):
    return disks().assign(status=("row", np.full(15, status["status"], dtype=np.int8)))


@pytest.mark.parametrize(
    ("draw", "named"),
    [
        (lambda: plot.sweep_slice(disks(), "ph", OVER_MASS), "ph"),
        (lambda: plot.sweep_slice(disks(), "q", OVER_MASS), "q"),
        (lambda: plot.sweep_slice(balls([0]), "z", "initial.speed"), "z"),
        (lambda: plot.sweep_slice(disks(), "phi", "mass"), "mass"),
        (lambda: plot.sweep_slice(disks(DESIGN), "phi", OVER_MASS, by="body.gravity"), "by"),
        (lambda: plot.sweep_slice(disks(), "phi", OVER_MASS, at={OVER_MASS: 1.0}), "at"),
        (lambda: plot.sweep_map(disks(), "phi", OVER_MASS, OVER_MASS), "up"),
        (lambda: plot.sweep_fan(disks(), OVER_MASS), "z"),
        (lambda: plot.sweep_matrix(disks(), ["phi"] * 7), "results"),
        (lambda: plot.sweep_slice(disks()[["phi"]].assign_attrs(shape=[]), "phi", OVER_MASS), "data"),
        (lambda: plot.sweep_slice(xarray.Dataset(), "phi", OVER_MASS), "data"),
        (lambda: plot.sweep_slice(altered(status=3), "phi", OVER_MASS), "data"),
    ],
)
def test_what_cannot_be_drawn_is_a_sentence(draw, named):
    with refuses(plot.PictureError, named):
        draw()


@pytest.fixture
def command(command_folder):
    return lambda *arguments: main(["sweep", "plot", *arguments])


@pytest.mark.thorough
def test_the_command_draws_what_fits_the_study(command, tmp_path, capsys):
    store(tmp_path, settings=TIMES)
    assert command("s.zarr", "--out", "new/figures", "--result", "phi") == 0
    names = [
        "slice_phi_body.mass.png",
        "slice_phi_body.gravity.png",
        "map_phi_body.mass_body.gravity.png",
        "fan_body.mass.png",
        "fan_body.gravity.png",
        "matrix.png",
    ]
    assert capsys.readouterr().out.splitlines() == [
        "6 figures of s.zarr",
        *(f"  written: new/figures/{name}" for name in names),
    ]
    for name in names:
        picture = matplotlib.image.imread(tmp_path / "new" / "figures" / name)
        assert 0.005 < np.mean(np.any(picture[..., :3] < 0.98, axis=-1)) < 0.9, name


def test_labels_and_formats_are_those_that_are_given(command, tmp_path, capsys):
    store(tmp_path, MASSES, engine=pretend)
    label = ["--label", "body.mass=M (kg)", "phi=turned (rad)"]
    chosen = ["s.zarr", "--out", "figures", "--result", "phi", "z", "--format", "svg", "--svg-text", *label]
    assert command(*chosen) == 0
    assert sorted(path.name for path in (tmp_path / "figures").iterdir()) == [
        "slice_phi_body.mass.svg",
        "slice_z_body.mass.svg",
    ]
    text = (tmp_path / "figures" / "slice_phi_body.mass.svg").read_text()
    assert ">M (kg)<" in text
    assert ">turned (rad)<" in text
    assert command(*chosen[:-3], "--label", "mass=M") == 2
    said(capsys.readouterr().err, "mass")
    assert command(*chosen[:-3], "--force", "--label", "body.mass=for 5 $") == 0
    assert command(*chosen[:-3], "--force", "--label", r"body.mass=$\frac$") == 2
    said(capsys.readouterr().err, "body.mass")


def test_names_of_files_have_no_brackets():
    assert [plain(path) for path in ("z[0]", "masses[1].rail.radius", "R[1][0]")] == [
        "z0",
        "masses1.rail.radius",
        "R1-0",
    ]


def test_symbols_count_from_one_and_have_units():
    labels = [number_label(path) for path in ("masses[1].mass", "ground.angle", "contact.friction", "own.number")]
    assert labels == ["$m_{2}$ (mass)", "$a$ (rad)", r"$\mu$", "own.number"]
    keys = {key for table in INITIAL.values() for key in table}
    assert {re.split(r"[.[]", path)[1] for path in NUMBERS if path.startswith("initial.")} <= keys


def test_the_scale_of_a_view_has_symbols_and_units_in_plain_text():
    data = disks()
    assert [sweep_scale(data, [0, 1, 2], by).name for by in (None, "body.gravity", "phi")] == [
        "g (length/time²)",
        "g (length/time²)",
        "φ at the end (rad)",
    ]
    told = {
        r"$\dot{\theta}_{12}(t_0)$ (rad/time)": "θ\N{COMBINING DOT ABOVE}₁₂(t₀) (rad/time)",
        r"$\ddot{\theta}_{1}$ (rad/time²)": "θ\N{COMBINING DIAERESIS}₁ (rad/time²)",
        r"$\mu_s$": "μₛ",
        r"$\mu_{\min}$": "μ_min",
        r"$p_{xz}$": "p_xz",
        "own.number": "own.number",
    }
    assert {label: in_plain_text(label) for label in told} == told


def test_what_a_study_finds_by_itself_has_a_unit():
    data = xarray.Dataset({name: ("row", np.zeros(2)) for name in ("distance", "largest_angular_speed", "mine")})
    assert [label_of(data, name) for name in data] == ["distance (length)", "largest angular speed (rad/time)", "mine"]


@pytest.mark.thorough
def test_the_command_draws_standard_results_of_one_number(command, tmp_path, capsys):
    store(tmp_path, MASSES, engine=pretend)
    assert command("s.zarr", "--out", "figures", "--against", OVER_MASS) == 0
    written = sorted(path.name for path in (tmp_path / "figures").iterdir())
    assert written == [f"slice_{name}_body.mass.png" for name in ("phi", "phidot", "steps", "z")]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["none.zarr"], "none.zarr"),
        (["."], '"."'),
        (["s.zarr", "--result", "steps", "psi"], "psi"),
        (["s.zarr", "--against", "body.masses"], "body.masses"),
        (["begun.zarr"], "STORE"),
    ],
)
def test_bad_input_of_the_command(command, tmp_path, capsys, arguments, named):
    (tmp_path / "other").mkdir()
    store(tmp_path, MASSES, "chunk = 4", shard=(1, 2)).rename("s.zarr")
    store(tmp_path / "other", MASSES, shard=(2, 2)).rename("begun.zarr")
    assert command(*arguments, "--out", "figures") == 2
    said(capsys.readouterr().err, named)
    assert not (tmp_path / "figures").exists()


def test_the_command_needs_a_folder(command, tmp_path, capsys):
    store(tmp_path, MASSES, engine=heavy_ones_fail)
    (tmp_path / "file").write_text("")
    assert command("s.zarr", "--out", "file") == 2
    said(capsys.readouterr().err, "--out")
