"""What a report says of constraints and bounds, and of where it comes from."""

import re
import tomllib

import numpy as np
import pytest

from jaxball.files.results import OutputError
from jaxball.files.scenario.sources import builtin_text
from jaxball.studies.design.report import bounds, violation
from jaxball.studies.design.result import Source, provenance
from jaxball.studies.design.search.optimise import Progress, load_progress, save_progress
from tests.support.sentences import refuses

INFINITE = np.inf


@pytest.mark.parametrize(
    ("by", "words"),
    [
        (-0.25, "holds, margin 2.50e-01"),
        (0.0, "holds, margin 0.00e+00"),
        (5e-5, "holds to within 5.0e-05"),
        (0.02, "violated by 2.00e-02"),
        (INFINITE, "violated by inf"),
        (-INFINITE, "nothing to check"),
        (np.nan, "not known"),
    ],
)
def test_a_constraint_that_holds_has_a_margin(by, words):
    assert violation(by, 1e-4) == words


def test_bounds_that_are_none_are_not_infinite():
    assert bounds(-INFINITE, INFINITE) == "free"
    assert bounds(0.2, INFINITE) == "at least 0.2"
    assert bounds(-INFINITE, 3.0) == "at most 3"
    assert bounds(0.2, 3.0) == "0.2 to 3"


PROBLEM = '# mine\nformat = 1\nscenario = "disk.toml"\n'


@pytest.fixture
def source(tmp_path):
    """A problem file whose scenario is in another file, and a folder for the result."""
    (tmp_path / "disk.toml").write_text(builtin_text("disk"))
    (tmp_path / "mine.toml").write_text(PROBLEM)
    (tmp_path / "out").mkdir()
    return Source("jaxball design mine.toml --out out", tmp_path / "mine.toml", PROBLEM)


def test_the_copy_of_a_problem_needs_no_other_file(source, tmp_path):
    source.copy(tmp_path / "out")
    copied = tomllib.loads((tmp_path / "out" / "problem.toml").read_text())
    assert copied == {"format": 1, "scenario": tomllib.loads(builtin_text("disk"))}
    source.check(tmp_path / "out")


def test_the_copy_of_a_whole_problem_is_its_text(source, tmp_path):
    whole = source._replace(text=f"{PROBLEM.replace('disk.toml', '')}".replace('scenario = ""', "[scenario]"))
    whole.copy(tmp_path / "out")
    assert (tmp_path / "out" / "problem.toml").read_text() == whole.text


def test_no_other_file_is_written_over(source, tmp_path):
    other = tmp_path / "out" / "problem.toml"
    for text in ("format = 2\n", "no document"):
        other.write_text(text)
        with refuses(OutputError, "--out"):
            source.check(tmp_path / "out")


@pytest.mark.parametrize("name", ["report.md", "design.toml"])
def test_a_report_of_ones_own_is_not_written_over(name, tmp_path):
    """Unless an earlier run has left its copy of the problem, or the progress of the search."""
    mine = Source("jaxball design problem.toml --out .", tmp_path / "problem.toml", PROBLEM)
    (tmp_path / "problem.toml").write_text(PROBLEM)
    (tmp_path / "disk.toml").write_text(builtin_text("disk"))
    for folder in (tmp_path, tmp_path / "other"):
        folder.mkdir(exist_ok=True)
        (folder / name).write_text("mine")
        with refuses(OutputError, name):
            mine.check(folder)
    (tmp_path / "progress.npz").touch()
    mine.check(tmp_path)
    mine.copy(tmp_path / "other")
    mine.check(tmp_path / "other")


def test_a_problem_in_its_own_folder_stays_as_it_is(tmp_path):
    (tmp_path / "disk.toml").write_text(builtin_text("disk"))
    (tmp_path / "problem.toml").write_text(PROBLEM)
    mine = Source("jaxball design problem.toml --out .", tmp_path / "problem.toml", PROBLEM)
    mine.check(tmp_path)
    mine.copy(tmp_path)
    assert (tmp_path / "problem.toml").read_text() == PROBLEM


def test_a_report_says_how_it_was_made(source):
    text = "\n".join(line for part in provenance(source, 200.0, resumed=True) for line in part)
    assert re.search(
        r"^By `jaxball design mine.toml --out out`, with jaxball \S+, jax \S+, diffrax \S+, in 3 min, all runs",
        text,
        re.MULTILINE,
    )
    assert "`problem.toml`, a copy" in text
    assert "problem.toml" not in str(provenance(None, 1.0))


def test_the_time_of_a_search_is_kept_with_its_progress(tmp_path):
    progress = Progress("polish", 3, np.zeros((1, 2)), [], np.zeros(2), elapsed=12.5)
    save_progress(progress, tmp_path / "progress.npz", "mine")
    assert load_progress(tmp_path / "progress.npz", "mine").elapsed == 12.5
