"""``reproduce`` in a short form: what it writes, and that what it says is true."""

import json

import pytest

from jaxball.paper.reproduce import reproduce
from tests.support.sentences import refuses

HEADINGS = "System | Solver | Tolerance | Accepted | Rejected | Evaluations | Error | Error at 20 | Run | Compile"

# The paper's figures of the disk, by its labels.
LABELS = (
    "fig_abs_ui", "fig_disk_masses_rails_bf_gc", "fig_disk_cm_time_bf_gc", "fig_disk_cm_time_spatial_gc",
    "fig_disk_dot_angle", "fig_disk_gc",
)  # fmt: skip


@pytest.fixture(scope="module")
def reproduction(tmp_path_factory):
    out, lines = tmp_path_factory.mktemp("reproduce") / "new" / "out", []
    measured = reproduce(out, solvers=("Dopri5",), systems=("disk",), echo=lines.append)
    return out, lines, measured


@pytest.mark.long
def test_the_disk_is_reproduced_to_eleven_digits(reproduction):
    """At the paper's tolerance of 1e-12, from the first saved time to the last."""
    _, _, (row,) = reproduction
    assert row.tolerance == 1e-12
    assert 0 < row.error_at_end <= row.error <= 1e-11
    assert row.run_time > 0


@pytest.mark.long
def test_evaluations_are_those_of_the_tableau(reproduction):
    """Six for each step of Dopri5, one at the start, and one for each step that begins at a kink."""
    _, _, (row,) = reproduction
    steps = row.accepted + row.rejected
    kinks = 2
    assert 1 + 6 * steps + kinks <= row.evaluations <= 1 + 6 * steps + kinks + row.rejected


@pytest.mark.thorough
def test_markdown_has_a_row_for_each_solver(reproduction):
    out, _, (row,) = reproduction
    lines = (out / "table.md").read_text(encoding="utf-8").splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[:3]]
    assert " | ".join(cells[0]) == HEADINGS
    assert cells[2][:6] == [
        "disk",
        "Dopri5",
        "1e-12",
        str(row.accepted),
        str(row.rejected),
        str(row.evaluations),
    ]
    assert lines[3] == ""


@pytest.mark.thorough
def test_json_has_every_number_and_the_versions(reproduction):
    out, _, (row,) = reproduction
    content = json.loads((out / "table.json").read_text(encoding="utf-8"))
    assert content["measurements"] == [vars(row)]
    assert {"python", "jaxball", "diffrax", "jax"} <= content["versions"].keys()


@pytest.mark.thorough
def test_printed_table_is_aligned(reproduction):
    _, lines, _ = reproduction
    heading, rule = lines[0].splitlines()
    assert len(heading) == len(rule) == len(lines[1])
    assert len(rule) <= 110


@pytest.mark.thorough
def test_last_line_states_the_largest_error(reproduction):
    _, lines, (row,) = reproduction
    assert lines[-1].strip().startswith("Agreement with the paper's runs:")
    assert lines[-1].endswith(f"of Dopri5 is {row.error:.1e} for the disk.")


@pytest.mark.thorough
def test_figures_are_named_by_the_paper_s_labels(reproduction):
    out, _, _ = reproduction
    for label in LABELS:
        assert (out / f"{label}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("choice", [{"solvers": ("RK45",)}, {"systems": ("cube",)}, {"solvers": ()}])
def test_unknown_names_are_refused_before_anything_is_written(tmp_path, choice):
    (argument, names), *_ = choice.items()
    with refuses(ValueError, argument):
        reproduce(tmp_path / "out", **choice)
    assert not (tmp_path / "out").exists(), names
