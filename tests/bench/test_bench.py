"""``python -m benchmarks`` as a user types it: its files, and that what they say is true."""

import itertools
import json
import math
import os
import re
import subprocess
import sys
from datetime import datetime

import numpy as np
import pytest
from comparison.contenders import ALL
from comparison.run import QUICK_SOLVERS

from jaxball.paper import reference
from tests.support.scripts import BENCHMARKS

COLUMNS = {
    "problem", "solver", "family", "tolerance", "failure", "error", "time", "quartiles", "repeats", "build_time",
    "state", "steps", "rejected", "evaluations", "jacobians", "decompositions",
}  # fmt: skip
# The ball's final state is up to thirty times as large as a change of the initial one, and a solve of a hundred
# steps may add up their errors; multistep codes control the local error far more loosely than one-step ones.
ONE_STEP, MULTISTEP = 300, 3000
MULTISTEP_CODES = ("LSODA", "CVODES", "IDAS", "BDF")
EVALUATIONS_A_STEP = {"diffrax Dopri8": 13, "SciPy DOP853": 11}  # fewer than these stages no tableau has


def command(*arguments, folder):
    environment = {**os.environ, "XLA_FLAGS": ""}
    line = [sys.executable, str(BENCHMARKS), *arguments]
    return subprocess.run(line, cwd=folder, capture_output=True, text=True, check=False, env=environment)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """The folder, the printed lines and the content of ``results.json`` of a quick run."""
    folder = tmp_path_factory.mktemp("bench")
    done = command("--quick", "--out", "new/bench", folder=folder)
    assert done.returncode == 0, done.stderr
    out = folder / "new" / "bench"
    return out, done.stdout, json.loads((out / "results.json").read_text(encoding="utf-8"))


def bound(row):
    factor = MULTISTEP if any(code in row["solver"] for code in MULTISTEP_CODES) else ONE_STEP
    return factor * row["tolerance"]


@pytest.mark.long
def test_every_solve_reaches_its_end_as_exactly_as_its_tolerance_promises(quick):
    _, _, content = quick
    assert {row["tolerance"] for row in content["rows"]} == {1e-5, 1e-8}
    for row in content["rows"]:
        assert row.keys() == COLUMNS
        assert row["failure"] == ""
        assert 0 < row["error"] <= bound(row), row


@pytest.mark.long
def test_every_solver_takes_part_or_is_said_to_be_left_out(quick):
    _, printed, content = quick
    for name, problem in content["problems"].items():
        took_part = {row["solver"] for row in content["rows"] if row["problem"] == name}
        assert "RadauIIA 3" in took_part
        for solver in QUICK_SOLVERS:
            left_out = " ".join([*problem["left_out"], *content["missing"]])
            assert (solver in took_part) != (solver in left_out)
    assert "Left out as explicit on a stiff problem: Gauss, diffrax Dopri8" in printed


@pytest.mark.thorough
def test_errors_of_the_ball_are_those_of_the_reference(quick):
    _, _, content = quick
    exact = reference.ball().values[-1]
    for row in (row for row in content["rows"] if row["problem"] == "ball"):
        assert row["error"] == float(np.max(np.abs(np.array(row["state"]) - exact)[6:]))


@pytest.mark.thorough
def test_concentrations_add_up_to_one(quick):
    """Robertson's reaction keeps a linear sum, and every solver of these keeps such sums to rounding."""
    _, _, content = quick
    rows = [row for row in content["rows"] if row["problem"] == "robertson"]
    assert rows
    for row in rows:
        assert abs(sum(row["state"]) - 1) <= 1e-9, row["solver"]


@pytest.mark.thorough
def test_times_and_counts_belong_to_solves(quick):
    _, _, content = quick
    for row in content["rows"]:
        low, high = row["quartiles"]
        assert 0 < low <= row["time"] <= high
        assert row["repeats"] >= 3
        assert row["build_time"] >= 0
        counts = [row[name] for name in ("steps", "rejected", "evaluations", "jacobians", "decompositions")]
        assert all(count is None or (isinstance(count, int) and count >= 0) for count in counts)
        for solver, stages in EVALUATIONS_A_STEP.items():
            if row["solver"] == solver:
                assert row["evaluations"] >= stages * (row["steps"] + (row["rejected"] or 0))


@pytest.mark.thorough
def test_collocation_evaluates_at_every_stage(quick):
    """Eight stages, and each step's iteration passes at least once through all."""
    _, _, content = quick
    rows = [row for row in content["rows"] if row["solver"] == "Gauss"]
    assert rows
    for row in rows:
        assert row["evaluations"] >= 8 * (row["steps"] + row["rejected"])


@pytest.mark.thorough
def test_a_finer_tolerance_gives_a_smaller_error_at_more_work(quick):
    _, _, content = quick
    rows = content["rows"]
    for coarse, fine in itertools.pairwise(rows):
        if coarse["solver"] == fine["solver"] and coarse["problem"] == fine["problem"]:
            assert (coarse["tolerance"], fine["tolerance"]) == (1e-5, 1e-8)
            assert fine["error"] < coarse["error"]
            assert (fine["evaluations"] or math.inf) > (coarse["evaluations"] or 0)


@pytest.mark.thorough
def test_the_run_is_described(quick):
    _, _, content = quick
    assert datetime.fromisoformat(content["date"]).tzinfo is not None
    assert {"cpu", "vector_units", "cores", "system"} <= content["machine"].keys()
    assert {"python", "jaxball", "jax", "diffrax"} <= content["versions"].keys()
    assert content["settings"] == {"tolerances": [1e-5, 1e-8], "budget": 0.02, "limit": 2.0}
    assert content["problems"]["ball"]["kinks"] == [0.1, 0.2]
    assert content["problems"]["robertson"]["relative_error"]


@pytest.mark.thorough
def test_tables_show_the_cheapest_setting_and_the_ratio_to_the_fastest(quick):
    out, _, content = quick
    text = (out / "table.md").read_text(encoding="utf-8")
    ball = text.split("## The paper's ball")[1].split("\n## ")[0]
    rows = [row for row in content["rows"] if row["problem"] == "ball"]
    sections = re.split(r"### Achieved error at most (\S+)\n", ball)[1:]
    assert sections
    for goal, section in zip(sections[::2], sections[1::2], strict=True):
        cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in section.splitlines() if "|" in line]
        good = [row for row in rows if row["error"] <= float(goal)]
        best = {name: min(row["time"] for row in good if row["solver"] == name) for name in {r["solver"] for r in good}}
        assert [line[0] for line in cells[2:]] == sorted(best, key=best.__getitem__)
        for line in cells[2:]:
            assert line[4] == f"{best[line[0]] / min(best.values()):.2f}"


@pytest.mark.thorough
def test_the_two_kinds_of_figure_are_written(quick):
    out, _, _ = quick
    for problem in ("ball", "robertson"):
        assert (out / f"{problem}.png").read_bytes().startswith(b"\x89PNG")
        assert (out / f"{problem}.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.long
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("bal",), "PROBLEM must contain names .* but it contains 'bal'; the nearest names are ball"),
        (
            ("--solvers", "Raduu"),
            "Argument `--solvers` must contain names .* but it contains 'Raduu'; the nearest names are",
        ),
        (("ball", "--solvers", "qqqqqqqq"), "the names are Adams, "),
        (("ball", "--tolerances", "-1"), "must be a positive number, but it is -1"),
        (("engines", "slop"), "PROBLEM must contain slope, slide"),
        (("--gradients",), "Argument `--gradients` must be left out without the word engines"),
        (("engines", "--gradients", "--quick"), "Argument `--quick` must be left out with `--gradients`"),
        (("engines", "--limit", "2"), "Argument `--limit` must be left out after `engines`"),
        (("--lst",), "there is no --lst here; did you mean --list?"),
    ],
)
def test_wrong_names_are_refused_before_anything_is_written(tmp_path, arguments, said):
    done = command(*arguments, "--out", "out", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert re.search(said, done.stderr), done.stderr
    assert not (tmp_path / "out").exists()


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "out").write_text("precious")
    done = command("ball", "--out", "out", folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr == 'jaxball: Argument `--out` must be a folder, but "out" is a file.\n'
    assert (tmp_path / "out").read_text() == "precious"


@pytest.mark.thorough
def test_list_names_every_problem_and_solver(tmp_path):
    done = command("--list", folder=tmp_path)
    assert done.returncode == 0
    as_documented = [sys.executable, "-m", "benchmarks", "--list"]
    assert subprocess.run(as_documented, cwd=BENCHMARKS.parent, capture_output=True, text=True).stdout == done.stdout
    for name in ("ball", "robertson", "van-der-pol", *ALL):
        assert re.search(rf"^  {re.escape(name)}  ", done.stdout, re.MULTILINE)
    assert not list(tmp_path.iterdir())
