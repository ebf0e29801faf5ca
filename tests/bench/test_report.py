"""Tables, figures and names, from rows that are made by hand."""

import dataclasses
import itertools

import numpy as np
import pytest
from comparison import SelectionError, select_contenders, select_problems
from comparison.contenders import ALL, Work
from comparison.figures import GAP, apart, diagram
from comparison.measure import Measured, Row, power, seconds
from comparison.problems import ALL as PROBLEMS
from comparison.report import cheapest, markdown, select_rows, spread
from hypothesis import given, strategies as st
from matplotlib.text import Text

from tests.support.sentences import refuses

ROBERTSON = PROBLEMS["robertson"]


def row(solver, tolerance, error, time, state=(1.0, 1.0, 1.0)):
    return Row(
        problem="robertson",
        solver=solver,
        family=ALL[solver].family.name,
        tolerance=tolerance,
        failure="" if error is not None else "it failed",
        error=error,
        time=time,
        quartiles=None,
        repeats=3,
        build_time=0.1,
        state=state if error is not None else None,
        **vars(Work()),
    )


ROWS = [
    row("Gauss", 1e-6, 1e-9, 3e-4),
    row("Gauss", 1e-8, 1e-11, 4e-4),
    row("heyoka Taylor", 1e-8, 1e-9, 2e-4),
    row("heyoka Taylor", 1e-10, 1e-7, 1e-4),
    row("SciPy Radau", 1e-8, None, None),
]


def test_the_cheapest_is_chosen_by_the_achieved_error_and_not_by_the_tolerance():
    assert cheapest(ROWS, 1e-8) == [ROWS[2], ROWS[0]]
    assert cheapest(ROWS, 1e-6) == [ROWS[3], ROWS[0]]
    assert cheapest(ROWS, 1e-10) == [ROWS[1]]
    assert cheapest(ROWS, 1e-12) == []


def test_what_was_asked_for_is_chosen_by_the_tolerance():
    assert {(r.solver, r.tolerance) for r in select_rows(ROWS, 1e-8)} == {("Gauss", 1e-8), ("heyoka Taylor", 1e-8)}
    assert {(r.solver, r.tolerance) for r in select_rows(ROWS, 1e-9)} == {("heyoka Taylor", 1e-10)}


def test_the_spread_is_the_largest_relative_difference_of_two_states():
    exact = np.array(ROBERTSON.exact)
    states = {"Gauss": exact, "heyoka Taylor": exact * [1, 1 + 3e-9, 1], "SciPy Radau": exact * [1, 1 - 4e-9, 1 + 1e-9]}
    found = spread(ROBERTSON, [row(name, 1e-8, 1e-9, 1.0, tuple(state)) for name, state in states.items()])
    assert found is not None
    assert set(found.solvers) == {"heyoka Taylor", "SciPy Radau"}
    np.testing.assert_allclose(found.difference, 7e-9, rtol=1e-6)
    assert spread(ROBERTSON, ROWS[:1]) is None


@pytest.mark.parametrize(("time", "text"), [(2.5, "2.5 s"), (0.0123, "12.3 ms"), (2.34567e-4, "235 μs")])
def test_times_have_a_unit_that_suits_them(time, text):
    assert seconds(time) == text


@pytest.mark.parametrize(("x", "digits", "text"), [(1e-8, 1, "1e-8"), (2.345e-10, 2, "2.3e-10"), (20.0, 1, "2e1")])
def test_exponents_have_no_leading_zeros(x, digits, text):
    assert power(x, digits) == text


def test_the_diagram_holds_the_numbers_of_the_rows():
    (ax,) = diagram(ROBERTSON, ROWS).axes
    lines = {line.get_label(): line for line in ax.lines}
    assert lines.keys() == {"Gauss", "heyoka Taylor"}  # what failed is not drawn
    for solver, line in lines.items():
        mine = [row for row in ROWS if row.solver == solver]
        np.testing.assert_array_equal(line.get_xdata(), [row.error for row in mine])
        np.testing.assert_array_equal(line.get_ydata(), [row.time for row in mine])
    assert ax.get_xscale() == ax.get_yscale() == "log"
    assert ax.get_xlim()[0] > ax.get_xlim()[1]
    assert "relative error" in ax.get_xlabel()


def test_families_differ_in_their_lines():
    (ax,) = diagram(ROBERTSON, [row(name, 1e-6, 1e-7, 1e-3) for name in ALL]).axes
    styles = {line.get_label(): (line.get_linestyle(), line.get_linewidth()) for line in ax.lines}
    families = {name: contender.family.name for name, contender in ALL.items()}
    looks = {wanted: {styles[name] for name in ALL if families[name] == wanted} for wanted in ("jaxball", "diffrax")}
    peers = {styles[name] for name in ALL if families[name] not in looks}
    assert all(len(found) == 1 for found in (*looks.values(), peers))
    assert {found[0] for found in looks["jaxball"]} == {"-"}
    assert {found[0] for found in looks["diffrax"]} == {"--"}
    assert max(width for _, width in peers) < min(width for _, width in looks["jaxball"])
    pairs = {(line.get_color(), line.get_marker()) for line in ax.lines}
    assert len(pairs) == len(ALL)


def test_names_at_the_margin_overlap_nothing():
    """All solvers, ending in three places: every name is there, and none covers another or leaves the figure."""
    rows = [row(name, 1e-6, 1e-7, 1e-3 * 10 ** (i % 3)) for i, name in enumerate(ALL)]
    figure = diagram(ROBERTSON, rows)
    figure.draw_without_rendering()
    (ax,) = figure.axes
    boxes = {text.get_text(): Text.get_window_extent(text) for text in ax.texts}
    assert boxes.keys() == ALL.keys()
    for a, b in itertools.combinations(boxes.values(), 2):
        assert not a.overlaps(b)
    for box in boxes.values():
        assert box.x0 > ax.get_window_extent().x1
        assert box.x1 <= figure.bbox.x1
        assert box.y0 >= 0
        assert box.y1 <= figure.bbox.y1


@given(st.lists(st.floats(0, 1), max_size=30))
def test_heights_are_moved_apart_in_order(heights):
    placed = apart(sorted(heights), GAP)
    assert len(placed) == len(heights)
    assert all(b - a >= GAP - 1e-12 for a, b in itertools.pairwise(placed))


def test_heights_that_are_apart_stay():
    assert apart([0.1, 0.5, 0.9], 0.1) == [0.1, 0.5, 0.9]


def names(*wanted):
    return [contender.name for contender in select_contenders(wanted)]


def test_solvers_by_name_by_words_and_by_package():
    assert names("gauss") == ["Gauss"]
    assert names("RadauIIA") == ["RadauIIA 3", "RadauIIA 5", "RadauIIA 7", "RadauIIA 7 fixed-point"]
    assert names("RadauIIA 7") == ["RadauIIA 7"]
    assert names("LSODA") == ["SciPy LSODA", "numbalsoda LSODA"]
    assert names("Dopri8", "SciPy Radau") == ["diffrax Dopri8", "SciPy Radau"]
    assert names("casadi") == ["CasADi CVODES Adams", "CasADi CVODES BDF", "CasADi IDAS"]
    assert names() == list(ALL)


def test_problems_by_name():
    assert [problem.name for problem in select_problems(PROBLEMS, ["robertson", "BALL"])] == ["ball", "robertson"]
    assert [problem.name for problem in select_problems(PROBLEMS, [])] == list(PROBLEMS)


@pytest.mark.parametrize(
    ("name", "nearest"), [("Trapezodial", "Trapezoidal"), ("DOPRI", "Dopri"), ("SciPy Rado", "SciPy")]
)
def test_unknown_names_come_with_the_nearest_ones(name, nearest):
    with refuses(SelectionError, "solvers"):
        select_contenders([name])


@pytest.mark.thorough
def test_every_problem_states_what_a_figure_needs():
    for problem in PROBLEMS.values():
        (ax,) = diagram(problem, [dataclasses.replace(ROWS[0], problem=problem.name)]).axes
        assert ax.get_title(loc="left") == problem.title.replace("₀", "$_0$")
        ax.figure.draw_without_rendering()  # a glyph that the font lacks would be a warning


def test_failures_alike_are_one_sentence():
    rows = [row("SciPy Radau", tolerance, None, None) for tolerance in (1e-4, 1e-6)]
    text = markdown([ROBERTSON], {"robertson": Measured([*ROWS[:2], *rows], ["Left out: x, because y."])})
    assert text.count("Failed: ") == 1
    assert "- Failed: SciPy Radau at 1e-4, 1e-6, because it failed.\n" in text
    assert "- Left out: x, because y.\n" in text
    assert "| Robertson | Gauss, 300 μs | Gauss, 300 μs | Gauss, 400 μs | – |" in text
