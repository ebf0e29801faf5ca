"""Measuring, with solvers whose answers are known: no failure becomes a number, and nothing measured is lost."""

import dataclasses
import itertools
import json
import re
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
from comparison import QUICK, Settings, compare, listing
from comparison.contenders import ALL, FAMILIES, Contender, Family, Outcome, Program, Run, Work
from comparison.measure import measure
from comparison.problem import Piece, Problem

from jaxball.interface.wording import pip_install

E = 2.718281828459045
GROWTH = Problem(
    name="growth",
    title="Growth",
    source="the exponential function",
    pieces=(Piece(0.0, 1.0),),
    initial=(1.0,),
    rates=lambda t, x, p, functions: [x[0]],
    exact=(E,),
    measured=(0,),
    relative=False,
    stiff=False,
    atol_over_rtol=1.0,
)
SETTINGS = Settings((1e-4, 1e-6), budget=1e-3, limit=0.05)
TEST_FAMILY = Family("test", "none")


@dataclasses.dataclass(frozen=True)
class Answer:
    """Runs that end in ``state``, and take at least ``duration`` seconds."""

    build_time: float
    state: tuple[float, ...] = (E + 1e-7,)
    failure: str = ""
    duration: float = 0.0
    calls: list = dataclasses.field(default_factory=list)

    def run(self, tolerance):
        return _Run(self, tolerance)


class _Run(Run):
    def __init__(self, program, tolerance):
        self.program, self.tolerance = program, tolerance

    def solve(self):
        self.program.calls.append(self.tolerance)
        time.sleep(self.program.duration)
        if self.program.failure == "raise":
            raise RuntimeError("outer\nthe real reason.")

    def outcome(self):
        return Outcome(np.array(self.program.state), self.program.failure, Work(steps=7))


@dataclasses.dataclass(frozen=True)
class Known(Contender):
    """A contender that answers by ``answer``, or raises it."""

    answer: object = None

    def program(self, problem):
        if isinstance(self.answer, BaseException):
            raise self.answer
        return Program(self.answer.build_time, self.answer.run)


def known(answer, name="known", **options):
    return Known(name, TEST_FAMILY, name, answer=answer, **options)


def measured(*contenders, problem=GROWTH, settings=SETTINGS):
    lines = []
    return measure(problem, list(contenders), settings, lines.append), lines


def test_the_error_is_that_of_the_state():
    result, _ = measured(known(Answer(0.25)))
    assert [row.tolerance for row in result.rows] == [1e-4, 1e-6]
    for row in result.rows:
        np.testing.assert_allclose(row.error, 1e-7, rtol=1e-8)
        assert (row.failure, row.steps, row.evaluations) == ("", 7, None)
        assert row.build_time >= 0.25
        assert row.repeats >= 3
    assert result.left_out == []


@pytest.mark.parametrize(
    ("answer", "failure"),
    [
        (Answer(0.0, failure="it took 5 steps"), "it took 5 steps"),
        (Answer(0.0, state=(float("nan"),)), "the final state is not finite"),
        (Answer(0.0, failure="raise"), "RuntimeError: the real reason"),
    ],
)
def test_a_failed_solve_has_a_reason_and_no_numbers(answer, failure):
    result, _ = measured(known(answer))
    assert len(result.rows) == 2
    for row in result.rows:
        assert row.failure == failure
        assert (row.error, row.time, row.quartiles, row.state, row.steps) == (None,) * 5


def test_a_problem_that_cannot_be_built_is_left_out_and_the_others_go_on():
    result, lines = measured(known(ImportError("no such library"), "broken"), known(Answer(0.0)))
    assert {row.solver for row in result.rows} == {"known"}
    (sentence,) = result.left_out
    assert sentence == "Left out: broken, because building the problem failed: ImportError: no such library."
    assert any(sentence in line for line in lines)


def test_a_slow_solve_is_left_out_and_no_finer_tolerance_is_tried():
    answer = Answer(0.0, duration=0.06)
    result, _ = measured(known(answer))
    assert result.rows == []
    (sentence,) = result.left_out
    assert sentence.startswith("Left out: known at tolerance 1e-4 and tighter ones, because a solve took 0.")
    assert set(answer.calls) == {1e-4}


@pytest.mark.parametrize(
    ("contender", "problem", "reason"),
    [
        ("diffrax Tsit5", {"stiff": True}, "explicit on a stiff problem"),
        ("Gauss", {"stiff": True}, "explicit on a stiff problem"),
        ("SciPy Radau", {"constraint": lambda x: x[0]}, "unable to solve DAEs"),
        ("SciPy Radau", {"stiff": True}, None),
        ("RadauIIA 3", {"constraint": lambda x: x[0]}, None),
        ("CasADi IDAS", {"constraint": lambda x: x[0], "stiff": True}, None),
    ],
)
def test_who_meets_which_problem(contender, problem, reason):
    assert ALL[contender].refusal(dataclasses.replace(GROWTH, **problem)) == reason


def test_contenders_take_turns():
    """Within the timing, the blocks of two contenders alternate."""
    calls = []
    contenders = [known(Answer(0.0, calls=Log(name, calls)), name) for name in ("first", "second")]
    measured(*contenders, settings=Settings((1e-4,), budget=1e-3, limit=1.0))
    assert set(calls) == {"first", "second"}
    assert min(calls.count(name) for name in set(calls)) >= 3 + 2  # two to build, three and more to time
    # One after the other would be built and timed with three changes between them.
    assert sum(before != after for before, after in itertools.pairwise(calls)) > 3


@dataclasses.dataclass(frozen=True)
class Log:
    """Writes down who was called."""

    name: str
    calls: list

    def append(self, _):
        self.calls.append(self.name)


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


def content(out):
    return json.loads((out / "results.json").read_text(encoding="utf-8"))


@pytest.mark.thorough
def test_an_interruption_keeps_the_problems_that_were_finished(out):
    second = dataclasses.replace(GROWTH, name="second", title="Second")

    @dataclasses.dataclass(frozen=True)
    class Interrupted(Known):
        def program(self, problem):
            if problem.name == "second":
                raise KeyboardInterrupt
            return super().program(problem)

    lines = []
    interrupted = Interrupted("Gauss", ALL["Gauss"].family, "Gauss", answer=Answer(0.0))
    done = compare([GROWTH, second], [interrupted], SETTINGS, out, lines.append)
    assert done.interrupted
    assert [row["problem"] for row in content(out)["rows"]] == ["growth", "growth"]
    assert (out / "growth.png").exists()
    assert "Interrupted while measuring second, whose results are discarded." in lines
    assert not list(out.glob(".jaxball-*"))


@pytest.mark.thorough
def test_peers_that_are_not_installed_are_left_out_with_a_line(out, monkeypatch):
    for package in ("numba", "numbalsoda", "heyoka", "casadi"):
        monkeypatch.setitem(sys.modules, package, None)
    lines = []
    peers = [contender for contender in ALL.values() if contender.family.name not in ("jaxball", "diffrax")]
    own = Known("Gauss", ALL["Gauss"].family, "Gauss", answer=Answer(0.0))
    done = compare([GROWTH], [own, *peers], QUICK, out, lines.append)
    assert {row.solver for row in done.rows} == {"Gauss"}
    missing = content(out)["missing"]
    assert missing == [line for line in lines if line.startswith("Left out: ")]
    assert missing[0] == (
        "Left out: SciPy RK45, SciPy DOP853, SciPy LSODA, SciPy Radau, SciPy BDF, because numba is not installed; "
        f"{pip_install('bench')}."
    )
    assert missing[1] == (
        "Left out: numbalsoda LSODA, numbalsoda DOP853, because numba and numbalsoda are not installed; "
        f"{pip_install('numbalsoda')}."
    )
    assert "numbalsoda, left out because numba and numbalsoda are not installed; pip install" in listing()
    assert len(missing) == 4


def test_every_family_is_installed_by_its_own_extra():
    """And numbalsoda, which has no wheels, by no other: pip installs all of an extra or nothing."""
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    extras = {
        extra: {re.split(r"[<>=!\[; ]", item)[0] for item in items}
        for extra, items in project["optional-dependencies"].items()
    }
    for family in FAMILIES:
        assert set(family.packages) <= extras[family.extra]
    assert [extra for extra, packages in extras.items() if "numbalsoda" in packages] == ["numbalsoda"]


def test_every_contender_has_a_family_that_is_listed():
    assert {contender.family for contender in ALL.values()} == set(FAMILIES)
