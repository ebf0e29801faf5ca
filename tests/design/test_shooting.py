"""Runs in pieces, beside runs in one, and beside the closed form of a uniform ball that turns about a level axis."""

import dataclasses
import functools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import cli
from jaxball.studies import design
from jaxball.studies.design.search.optimise import Merit, Optimiser, load_progress, save_progress
from jaxball.studies.design.search.program import CONTINUITY, Shooting
from tests.design.documents import builtin
from tests.design.test_design import PROBLEM
from tests.design.test_robust import problem as robust
from tests.support.sentences import refuses

PIECES, T = 4, 2.0


@functools.cache
def problem():
    return design.read_problem(PROBLEM.replace("saves = 5", "saves = 9"))


@functools.cache
def program():
    return Shooting(problem().problem, PIECES)


def optimiser(method="gauss-newton", rounds=40):
    settings = dataclasses.replace(problem().settings, starts=1, steps=5, method=method, rounds=rounds, evaluations=200)
    return Optimiser(program(), settings)


def defects(looked):
    found = program().layout.by_constraint(looked.at.violations[0])[CONTINUITY]
    return found.reshape(PIECES - 1, program().pytree.components.size)


def turning(angle, rate, place):
    """q, Ω and z of a ball that has turned by ``angle`` about Ω = ``rate``, with its centre at ``place``."""
    axis = rate / np.linalg.norm(rate)
    return np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis, rate, place])


@pytest.mark.long
def test_defects_in_closed_form():
    """Nothing where the pieces join; and where one starts 1 % too fast, what that comes to by its end."""
    at, y = optimiser(), program().append_joints(problem().problem.space.start[None])[0]
    np.testing.assert_allclose(defects(at.evaluate(y[None], at.first_multipliers(1))), 0.0, atol=1e-8)
    Omega, t = np.array([0.1, 0.5, 0.0]), T / PIECES
    faster, speed = 1.01 * Omega, np.array([0.5, -0.1])
    size = np.linalg.norm(Omega)
    joints = [turning(size * k * t, Omega, k * t * speed) for k in range(1, PIECES)]
    changed = y.reshape(-1).copy()
    start = turning(size * t, faster, t * speed)
    changed[2 : 2 + start.size] = start
    end = turning(size * (t + 1.01 * t), faster, t * speed + 1.01 * t * speed)
    expected = np.stack([joints[0] - start, end - joints[1], np.zeros(start.size)])
    np.testing.assert_allclose(defects(at.evaluate(changed[None], at.first_multipliers(1))), expected, atol=1e-8)


@pytest.mark.slow
def test_the_gradient_is_right_where_pieces_do_not_join():
    """In reverse mode, as BFGS has it, beside forward mode, as Gauss and Newton have it, and differences."""
    at, random = optimiser(), np.random.default_rng(2)
    y = program().append_joints(problem().problem.space.start[None])[0]
    y, direction = y + 0.1 * random.normal(size=y.shape), random.normal(size=y.shape)
    looked = at.evaluate(y[None], at.first_multipliers(1))
    reverse = optimiser("bfgs").evaluate(y[None], at.first_multipliers(1)).gradient
    np.testing.assert_allclose(reverse, looked.gradient, atol=1e-9 * np.max(np.abs(reverse)))
    ahead, behind = (at.evaluate((y + h * direction)[None], at.first_multipliers(1)).value[0] for h in (1e-4, -1e-4))
    np.testing.assert_allclose((ahead - behind) / 2e-4, looked.gradient[0] @ direction, rtol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("method", [pytest.param("bfgs", marks=pytest.mark.slow), "gauss-newton"])
def test_optimum_on_a_constraint(method):
    at = optimiser(method)
    found = at.run(at.begin(), lambda progress: None)
    np.testing.assert_allclose(program().numbers(jnp.asarray(found.best))[:2], [-0.25, 0.75], atol=1e-5)
    assert found.merit.violation < 1e-6


@pytest.mark.thorough
def test_a_search_that_is_stopped_after_every_step_ends_where_it_would_have_ended(tmp_path):
    at, path = optimiser(rounds=3), tmp_path / "progress.npz"
    progress = at.begin()
    while progress.phase != "done":
        save_progress(progress, path, "one")
        progress = at.advance(load_progress(path, "one"))
    whole = at.run(at.begin(), lambda progress: None)
    np.testing.assert_array_equal(progress.best, whole.best)
    np.testing.assert_array_equal(progress.history, whole.history)


@pytest.mark.parametrize("kind", ["empty", "cut", "other"])
def test_a_file_that_is_no_progress_gets_a_sentence(tmp_path, kind):
    path = tmp_path / "progress.npz"
    np.savez(path, other=np.zeros(3))
    content = path.read_bytes()
    path.write_bytes({"empty": b"", "cut": content[:-40], "other": content}[kind])
    with refuses(design.DesignError, "progress.npz"):
        load_progress(path, "one")


@pytest.mark.parametrize(("best", "other", "ends"), [(-2.0, -1.0, True), (-2.0, -1.95, False), (2.0, 2.05, False)])
def test_a_start_that_may_still_win_is_finished(best, other, ends, no_type_checks):
    """Also where the objective is negative: by a twentieth of its size."""
    search = optimiser()
    progress = search.begin()
    progress.merit = Merit(best, 0.0, 0.0, 0.0)
    merits = [progress.merit, Merit(other, 0.0, 1.0, 0.0)]
    search._merits = lambda lagrangians: merits
    assert search._is_solved(None, progress) is ends


def the_papers_ball():
    space = design.DesignSpace(builtin("ball", start=0.0, end=2.0, saves=21), [design.Variable(("masses[0].mass",))])
    return design.Problem(space, {"far": design.GoFar()}, {"normal": design.NormalForce(0.5)})


@pytest.mark.slow
@pytest.mark.parametrize("given", [the_papers_ball, lambda: robust().problem], ids=["the paper's ball", "many balls"])
def test_a_run_in_pieces_that_join_is_worth_what_it_is_in_one(given):
    given = given()
    whole, cut = Shooting(given), Shooting(given, 2)
    z = given.space.start[None]
    found = [jax.jit(one.evaluate)(jnp.asarray(one.append_joints(z)[0])) for one in (whole, cut)]
    np.testing.assert_allclose(found[1].terms, found[0].terms, atol=1e-7)
    parts = cut.layout.by_constraint(np.asarray(found[1].violations))
    assert parts[CONTINUITY].size == given.balls * cut.pytree.components.size
    np.testing.assert_allclose(parts.pop(CONTINUITY), 0.0, atol=1e-7)
    for name, expected in whole.layout.by_constraint(np.asarray(found[0].violations)).items():
        np.testing.assert_allclose(parts.get(name, ()), expected, atol=1e-7)


def test_intervals_that_do_not_divide_the_steps_are_told():
    with refuses(design.DesignError, "search.intervals"):
        Shooting(problem().problem, 3)


@pytest.mark.slow
def test_the_command_designs_in_pieces(tmp_path, capsys):
    text = PROBLEM + 'intervals = 2\nmethod = "gauss-newton"\n'
    (tmp_path / "problem.toml").write_text(text)
    assert cli.main(["design", str(tmp_path / "problem.toml"), "--out", str(tmp_path / "out")]) == 0
    assert CONTINUITY in capsys.readouterr().err
    report = (tmp_path / "out" / "report.md").read_text()
    assert "All constraints hold" in report
    assert re.search("is (nearly )?stationary", report)
