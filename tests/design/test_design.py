"""A whole design whose optimum is known: a uniform ball, z = r t (Ω2, −Ω1), comes as near as it may to a place.

The place is at (2, 0.5), and the ball may not pass e1 = 1.5: it ends at (1.5, 0.5), ½ away.
"""

import dataclasses
import functools
import os
import re
import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tomli_w

import jaxball
from jaxball import cli
from jaxball.studies import design
from jaxball.studies.design.report import write_report
from jaxball.studies.design.search.design import identify_search
from jaxball.studies.design.search.optimise import Optimiser, load_progress
from jaxball.studies.design.search.program import Shooting
from jaxball.studies.design.search.verify import check_gradient
from tests.support.sentences import refuses, said

PROBLEM = """
format = 1
title = "As near as it may"

[scenario]
format = 1
kind = "ball"
body = { mass = 1.0, radius = 1.0, inertia = [0.4, 0.4, 0.4], gravity = 1.0 }
initial = { Omega = [0.1, 0.5, 0.0] }
time = { start = 0.0, end = 2.0, saves = 5 }
solve = { solver = "tsit5", rtol = 1e-9, atol = 1e-9 }

[[variables]]
path = "initial.Omega[0]"
lower = -1.0
upper = 1.0

[[variables]]
path = "initial.Omega[1]"

[[objectives]]
kind = "reach-place"
place = [2.0, 0.5]

[[constraints]]
kind = "within"
lower = [-1.0, -1.0]
upper = [1.5, 5.0]

[search]
starts = 2
steps = 20
rounds = 20
tolerance = 1e-6
stationary = 1e-7
"""


@functools.cache
def problem():
    return design.read_problem(PROBLEM)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where a design, its report and what was said on the way are."""
    path, found, lines = tmp_path_factory.mktemp("design"), problem(), []
    done = found.problem.optimise(found.settings, path, say=lines.append)
    assert done.feasible
    write_report(done, found.title, path)
    (path / "lines.txt").write_text("\n".join(lines))
    return path


@pytest.mark.long
def test_each_stage_is_announced_when_it_begins(folder):
    """Forward mode is not among them: differences agree well enough."""
    rows = ("  step", "adam  ", "polish  ")
    stages = [line for line in (folder / "lines.txt").read_text().splitlines() if not line.startswith(rows)]
    assert stages == [
        "compiling the gradient, and checking it at the start",
        "gradient check",
        "improving 2 starts by Adam, 20 steps each",
        "polishing 2 designs by bfgs, at most 20 rounds of 80 evaluations each",
        "verifying by another solver, between the samples too",
        "evaluating the start, and perturbed balls",
    ]


@pytest.mark.slow
def test_the_command_writes_the_same(folder, tmp_path):
    (tmp_path / "problem.toml").write_text(PROBLEM)
    assert cli.main(["design", str(tmp_path / "problem.toml"), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    assert (tmp_path / "out" / "design.toml").read_text() == (folder / "design.toml").read_text()
    assert (tmp_path / "out" / "problem.toml").read_text() == PROBLEM
    ours, theirs = ((path / "report.md").read_text().split("## How it was made") for path in (tmp_path / "out", folder))
    assert ours[0] == theirs[0]
    assert f"By `jaxball design {tmp_path / 'problem.toml'} --out" in ours[1]


@pytest.mark.long
def test_the_optimum_on_a_constraint(folder):
    found = jaxball.load_scenario(folder / "design.toml")
    np.testing.assert_allclose(found.state.Omega, [-0.25, 0.75, 0.0], atol=1e-5)
    np.testing.assert_allclose(found.simulate().state.z[-1], [1.5, 0.5], atol=1e-5)


@pytest.mark.long
def test_the_report_has_figures_and_numbers(folder):
    text = (folder / "report.md").read_text()
    assert "All constraints hold" in text
    assert re.search("is (nearly )?stationary", text)
    # Half a radius is missed, which is squared.
    assert re.search(r"^\| reach-place \| 1 \| \S+ \| 0\.25 \| 0\.25 \| distance 0\.5 \|", text, re.MULTILINE)
    assert re.search(r"^\| within \| holds, margin \S+ \| holds", text, re.MULTILINE)
    assert re.search(r"^\| `initial.Omega\[1\]` \| .* \| free \|$", text, re.MULTILINE)
    assert not re.search(r"\binf\b", text)
    assert re.search(r"^By jaxball \S+, jax \S+, diffrax \S+, in \d", text, re.MULTILINE)
    for name in ("path", "rails", "contact", "convergence"):
        assert (folder / f"{name}.png").exists()


@pytest.mark.slow
def test_a_search_that_was_stopped_goes_on_where_it_was(folder, tmp_path):
    """Stopped after two reports, it ends where it would have ended."""

    class StoppedError(Exception):
        pass

    lines = []

    def say(line):
        lines.append(line)
        if sum(line.startswith("adam ") for line in lines) == 2:
            raise StoppedError

    found = problem()
    with pytest.raises(StoppedError):
        found.problem.optimise(found.settings, tmp_path, say=say)
    kept = jaxball.load_scenario(tmp_path / "design.toml")
    assert np.all(np.isfinite(kept.state.Omega))
    before = load_progress(tmp_path / "progress.npz", identify_search(found.problem, found.settings)).elapsed
    done = found.problem.optimise(found.settings, tmp_path)
    assert done.progress.elapsed > before > 0
    whole = jaxball.load_scenario(folder / "design.toml")
    np.testing.assert_array_equal(done.numbers, np.asarray(whole.state.Omega)[:2])
    with refuses(design.DesignError):
        found.problem.optimise(dataclasses.replace(found.settings, seed=1), tmp_path)


@pytest.mark.parametrize(
    ("ours", "other"),
    [
        ("mass = 1.0", "mass = 1.5"),
        ("lower = -1.0", "lower = -0.9"),
        ("Omega = [0.1,", "Omega = [0.2,"),
        ("rtol = 1e-9", "rtol = 1e-8"),
        ("stationary = 1e-7", "stationary = 1e-6"),
    ],
)
def test_a_search_of_another_problem_is_another_one(ours, other):
    """From Python, any problem was resumed from the progress of any other."""
    found = [design.read_problem(text) for text in (PROBLEM, PROBLEM, PROBLEM.replace(ours, other))]
    same, again, changed = (identify_search(each.problem, each.settings) for each in found)
    assert same == again != changed


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        (lambda: design.Settings(starts=0), "starts"),
        (lambda: design.Settings(polished=2.5), "polished"),
        (lambda: design.Settings(tolerance=-1.0), "tolerance"),
        (lambda: problem().problem.verify([0.1]), "y"),
        (lambda: problem().problem.run([0.1, 0.2, 0.3]), "y"),
    ],
)
def test_settings_and_unknowns_that_are_none(no_type_checks, wrong, named):
    with refuses((TypeError, ValueError), named):
        wrong()


def test_a_problem_of_optimal_control_is_none_of_a_search():
    with refuses(design.DesignError, "control"):
        design.read_problem(PROBLEM + "[control]\n")


def test_a_search_is_saved_in_a_folder(no_type_checks, tmp_path):
    (tmp_path / "file").write_text("")
    with refuses(jaxball.files.results.OutputError, "folder"):
        problem().problem.optimise(folder=str(tmp_path / "file"))


@jax.custom_jvp
def crooked(x):
    return x


@crooked.defjvp
def _(primals, tangents):
    return primals[0], 1.01 * tangents[0]


class Crooked(design.AbstractObjective):
    """x² of the end, with derivatives that are off by a hundredth."""

    def __call__(self, run):
        return crooked(run.z[-1, 0]) ** 2


class Endless(design.AbstractObjective):
    """√(0 x²) of the end, whose derivative is 0 times infinity."""

    def __call__(self, run):
        return jnp.sqrt(0.0 * run.z[-1, 0] ** 2)


@pytest.mark.long
@pytest.mark.parametrize("wrong", [Crooked(), pytest.param(Endless(), marks=pytest.mark.slow)])
def test_a_wrong_gradient_is_refused(wrong):
    space = problem().problem.space
    with refuses(design.DesignError, "The gradient"):
        design.Problem(space, {"wrong": wrong}, {}).optimise(design.Settings(starts=1))


@pytest.mark.thorough
def test_the_gradient_is_right_to_the_solver():
    found = problem()
    optimiser = Optimiser(Shooting(found.problem), found.settings)
    check = check_gradient(optimiser, found.problem.space.start)
    assert check.between_modes is not None
    assert check.between_modes < 1e-10
    assert check.from_differences < 1e-8
    lines = []
    again = check_gradient(optimiser, found.problem.space.start, enough=1e-8, say=lines.append)
    assert again == check._replace(forward=None)
    assert again.ok
    assert "forward" not in repr(again)
    assert lines == []
    check_gradient(optimiser, found.problem.space.start, enough=0.0, say=lines.append)
    assert len(lines) == 1
    assert "in forward mode" in lines[0]


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (('kind = "within"', 'kind = "withing"'), "constraints[0].kind"),
        (("starts = 2", "starts = 0"), "search.starts"),
        (("lower = -1.0", "lower = 3.0"), "variables[0]"),
        (('path = "initial.Omega[1]"', 'path = "initial.Omega[7]"'), "variables[1].path"),
        (("mass = 1.0", "mass = -1.0"), "body.mass"),
        (("format = 1", "format = 2"), "format"),
        (("place = [2.0, 0.5]", "plaice = [2.0, 0.5]"), "place"),
        (("upper = [1.5, 5.0]", "upper = [1.5, -5.0]"), "lower"),
    ],
)
def test_errors_of_problem_files_name_the_key(change, named):
    with refuses(jaxball.ScenarioError, named):
        design.read_problem(PROBLEM.replace(*change))


@pytest.mark.parametrize("value", ["0", "true", '"friction"', "{}"])
@pytest.mark.parametrize("table", ["constraints", "objectives", "variables"])
def test_what_is_no_list_of_tables_is_told(table, value):
    document = tomllib.loads(PROBLEM) | {table: tomllib.loads(f"x = {value}")["x"]}
    with refuses(jaxball.ScenarioError, table):
        design.read_problem(tomli_w.dumps(document))


def test_files_that_are_none_are_told(tmp_path, capsys):
    assert cli.main(["design", str(tmp_path / "none.toml"), "--out", str(tmp_path)]) == 2
    said(capsys.readouterr().err, "none.toml")


def test_a_problem_may_come_through_a_pipe(tmp_path, capsys):
    """It is read once, and nothing is left of it in a pipe: a wrong key is told, and not that it is empty."""
    read, write = os.pipe()
    os.write(write, PROBLEM.replace("reach-place", "reach-plaice").encode())
    os.close(write)
    assert cli.main(["design", f"/dev/fd/{read}", "--out", str(tmp_path)]) == 2
    os.close(read)
    said(capsys.readouterr().err, "objectives[0].kind")


@pytest.mark.thorough
def test_a_violation_is_seen_by_the_other_solver():
    """By the other solver, e1 = 1.52 at the end is 0.02 too far."""
    found = problem().problem
    at = np.asarray(found.space.bounds.variables(np.array([-0.25, 0.76])))
    seen = found.verify(at)
    np.testing.assert_allclose(seen.violation, 0.02, atol=1e-7)
    assert seen.solver == "gauss16"
    assert seen.apart < 1e-8
