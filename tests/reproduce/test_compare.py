"""``compare_solvers`` in a short form, and the paper's words on solvers; in full in a test that is slow."""

import json

import pytest
from diffrax import ODETerm

from jaxball import BallState, paper
from jaxball.paper.reproduce import compare_solvers
from jaxball.paper.reproduce.run import DAE, ODE, TIMES
from jaxball.simulation.arguments import require_dae
from tests.support.sentences import refuses

HEADINGS = (
    "System | Paper's solver | Counterpart | Form | Accepted | Rejected | Evaluations | Error | Time | Compile | "
    "Authors' time"
)
# The largest order of each method, by the documentation of MATLAB and of radau5.
ORDERS = {"ode45": 5, "ode113": 13, "ode15s": 5, "ode23t": 2, "ode23tb": 2, "radau5": 5}


def test_the_solvers_are_those_of_the_paper():
    """Section 4 names six, and section 5 the same, of which three solve the DAE."""
    assert list(ODE) == list(ORDERS)
    assert list(DAE) == ["ode15s", "ode23t", "radau5"]


def test_ode113_was_the_fastest():
    """As sections 4 and 5 say."""
    for system in ("disk", "ball"):
        assert TIMES[system].keys() == ODE.keys()
        assert min(ODE, key=TIMES[system].__getitem__) == "ode113"


@pytest.mark.parametrize("name", ODE)
def test_counterparts_have_the_order_of_the_method(name):
    assert ODE[name].solver.order(ODETerm(lambda t, y, args: -y)) == ORDERS[name]


@pytest.mark.parametrize("name", DAE)
def test_counterparts_for_the_dae_solve_it(name):
    require_dae(paper.ball(), BallState(), DAE[name].solver)
    order = DAE[name].solver.order(ODETerm(lambda t, y, args: -y))
    assert order == ORDERS[name]
    assert DAE[name] == ODE[name]


@pytest.fixture(scope="module")
def comparison(tmp_path_factory):
    out, lines = tmp_path_factory.mktemp("compare") / "new" / "out", []
    compared = compare_solvers(out, solvers=("ode45",), systems=("disk",), echo=lines.append)
    return out, lines, compared


@pytest.mark.long
def test_the_counterpart_of_ode45_solves_the_disk(comparison):
    _, _, (row,) = comparison
    assert (row.paper_solver, row.form, row.authors_time) == ("ode45", "ODE", 0.23)
    assert (row.measurement.system, row.measurement.solver) == ("disk", "Dopri5()")
    assert row.measurement.tolerance == paper.DISK_TOLERANCE
    assert 0 < row.measurement.error <= 1e-11


@pytest.mark.thorough
def test_printed_table_is_aligned(comparison):
    _, lines, _ = comparison
    assert lines[0].startswith("Measuring 1 row, ")
    heading, rule = lines[1].splitlines()
    assert len(heading) == len(rule) == len(lines[2]) <= 120
    assert all(len(line) <= 120 for line in lines[3].splitlines())


@pytest.mark.thorough
def test_last_line_states_the_largest_error(comparison):
    _, lines, (row,) = comparison
    assert lines[-1].endswith(f"the largest error of all counterparts is {row.measurement.error:.1e} for the disk.")


@pytest.mark.thorough
def test_it_says_what_the_authors_did_not_publish_and_where_their_times_are_from(comparison):
    out, lines, _ = comparison
    for text in (lines[3], (out / "solvers.md").read_text(encoding="utf-8")):
        words = " ".join(text.split())
        assert "The authors published no steps, evaluations or errors" in words
        assert "on a machine that is not named. So it cannot be compared directly with the times here" in words


@pytest.mark.thorough
def test_markdown_has_the_same_row(comparison):
    out, lines, _ = comparison
    table = (out / "solvers.md").read_text(encoding="utf-8").splitlines()[:4]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in table]
    assert " | ".join(cells[0]) == HEADINGS
    assert " ".join(cells[2]).split() == lines[2].split()
    assert table[3] == ""


@pytest.mark.thorough
def test_json_has_every_number_and_where_the_times_are_from(comparison):
    out, _, (row,) = comparison
    content = json.loads((out / "solvers.json").read_text(encoding="utf-8"))
    assert content["measurements"] == [vars(row) | {"measurement": vars(row.measurement)}]
    assert "LaTeX source" in content["source_of_authors_time"]
    assert {"python", "jaxball", "diffrax", "jax"} <= content["versions"].keys()


@pytest.mark.slow
def test_every_solver_of_the_paper(tmp_path):
    """All agree, as the paper says, to the errors of all their steps."""
    rows = compare_solvers(tmp_path, echo=lambda text: None)
    assert [(row.measurement.system, row.form, row.paper_solver) for row in rows] == [
        *(("disk", "ODE", name) for name in ODE),
        *(("ball", "ODE", name) for name in ODE),
        *(("ball", "DAE", name) for name in DAE),
    ]
    for row in rows:
        measured, tolerance = row.measurement, row.measurement.tolerance
        assert (row.authors_time is None) == (row.form == "DAE")
        # The error of each step is held to the tolerance, and has grown by t = 20, some tens of times on the ball.
        assert measured.error < 50 * measured.accepted * tolerance
        assert measured.evaluations > measured.accepted
    for system in ("disk", "ball"):
        evaluations = {
            row.paper_solver: row.measurement.evaluations for row in rows if row.measurement.system == system
        }
        assert min(evaluations, key=evaluations.__getitem__) == "ode113"


@pytest.mark.parametrize("choice", [{"solvers": ("ode15i",)}, {"systems": ("cube",)}, {"systems": ()}])
def test_unknown_names_are_refused_before_anything_is_written(tmp_path, choice):
    (argument, _), *_ = choice.items()
    with refuses(ValueError, argument):
        compare_solvers(tmp_path / "out", **choice)
    assert not (tmp_path / "out").exists()
