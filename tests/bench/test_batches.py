"""The benchmarks of batches: what they compute with known contenders."""

import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison.problems import ALL

from tests.support.scripts import run_script

KNOWN = """
import numpy as np


class Known:
    def __init__(self, q, Omega, cores):
        self.state, self.times = np.concatenate([q, Omega, np.zeros((len(q), 2))], axis=1), iter(self.TIMES)

    def build(self, tolerance):
        return 0.5

    def solve(self, tolerance):
        return next(self.times), self.state + self.OFF * tolerance


class Coarse(Known):
    OFF, TIMES = 3.0, [4.0, 2.0, 3.0]


class Fine(Known):
    OFF, TIMES = 1e-3, [9.0, 5.0, 6.0, 7.0]


class Lost(Known):
    OFF, TIMES = np.nan, [1.0, 1.0, 1.0]


class Broken(Known):
    OFF, TIMES = 0.0, []

    def solve(self, tolerance):
        raise ValueError("nothing fits")
"""


@pytest.mark.thorough
def test_known_contenders_are_measured(benchmarks, monkeypatch, tmp_path, capsys):
    """The best time of the rounds; errors against the other engine's reference; who fails leaves with a sentence."""
    from contest import agreement_sentence, measure
    from turns import Contender

    (tmp_path / "known_batches.py").write_text(KNOWN)
    (tmp_path / "absent_package.py").write_text("import a_package_that_nobody_has\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    contenders = [
        Contender("coarse", "known_batches:Coarse", 3, cpu_settings=False),
        Contender("fine", "known_batches:Fine", 5, cpu_settings=False),
        Contender("lost", "known_batches:Lost", 2, cpu_settings=False),
        Contender("broken", "known_batches:Broken", 5, cpu_settings=False),
        Contender("absent", "absent_package:Batch", 5, cpu_settings=False),
    ]
    found = measure(contenders, 5, [1e-4], 3, 1, {"fine": 1e-9})
    rows = {row["solver"]: row for row in found["rows"]}
    assert rows.keys() == {"coarse", "fine", "lost"}
    assert (rows["coarse"]["time"], rows["coarse"]["rate"], rows["coarse"]["build_time"]) == (2.0, 1.5, 0.5)
    assert (rows["fine"]["time"], rows["fine"]["failed"]) == (5.0, 0)  # the first, of 9 s, was the reference
    np.testing.assert_allclose(rows["coarse"]["error_median"], 3e-4, rtol=1e-6)
    assert (rows["lost"]["failed"], np.isnan(rows["lost"]["error_median"])) == (2, True)
    assert "one reference only" in agreement_sentence(found["agreement"])
    said = capsys.readouterr().out
    assert "Left out: broken, because it raised ValueError: nothing fits" in said
    assert "Left out: absent, because a_package_that_nobody_has is not installed" in said


def test_references_of_two_engines_judge_each_other(benchmarks, monkeypatch, tmp_path):
    from contest import measure
    from turns import Contender

    (tmp_path / "known_batches.py").write_text(KNOWN)
    monkeypatch.syspath_prepend(str(tmp_path))
    contenders = [Contender(name, f"known_batches:{name}", 4, cpu_settings=False) for name in ("Fine", "Coarse")]
    found = measure(contenders, 4, [1e-2], 1, 1, {"Fine": 1e-3, "Coarse": 1e-6})
    fine, coarse = found["rows"]
    np.testing.assert_allclose(found["agreement"]["max"], 3e-6 - 1e-6, rtol=1e-6)
    np.testing.assert_allclose(fine["error_max"], 1e-5 - 3e-6, rtol=1e-6)
    np.testing.assert_allclose(coarse["error_max"], 3e-2 - 1e-6, rtol=1e-6)


def rows_of(solver, factor, exponents):
    """A solver whose rate is ``factor`` times the eighth root of its error."""
    return [
        {"solver": solver, "error_median": 10.0**-k, "rate": factor * 10.0 ** (-k / 8), "rows": 1} for k in exponents
    ]


def test_powers_are_interpolated_exactly(benchmarks):
    from work_precision import at_equal_error, rate_at

    ours, theirs, coarse = (
        rows_of("ours", 300.0, (4, 7, 11)),
        rows_of("theirs", 100.0, (12, 5)),
        rows_of("no", 1.0, (3,)),
    )
    np.testing.assert_allclose(rate_at(ours, 1e-6), 300 * 10 ** (-6 / 8), rtol=1e-12)
    assert rate_at(ours, 1e-12) is None
    assert rate_at(ours, 1e-3) is None
    found = at_equal_error([*ours, *theirs, *coarse], "ours", [1e-6, 1e-12])
    np.testing.assert_allclose(found["1e-06"]["theirs"]["ratio"], 3.0, rtol=1e-12)
    assert found["1e-06"]["no"] == {"rate": None, "ratio": None}
    assert found["1e-12"]["theirs"]["ratio"] is None


def test_the_diagram_holds_the_rows(benchmarks):
    from work_precision import diagram

    rows = rows_of("ours", 300.0, (4, 7, 11)) + rows_of("theirs", 100.0, (5, 12))
    (ax,) = diagram(rows, "ours").axes
    lines = {line.get_label(): line for line in ax.lines}
    assert lines.keys() == {"ours", "theirs"}
    np.testing.assert_array_equal(lines["ours"].get_ydata(), [row["rate"] for row in rows[:3]])
    assert lines["ours"].get_linewidth() > lines["theirs"].get_linewidth()


def test_perturbed_states_are_possible_and_always_the_same(benchmarks):
    import perturbed

    q, Omega = perturbed.initial(50)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, rtol=1e-15)
    assert 0.5 * perturbed.SIZE < np.std(Omega) < 2 * perturbed.SIZE
    np.testing.assert_array_equal(perturbed.initial(50)[0], q)
    x = perturbed.states(q, Omega)
    np.testing.assert_array_equal(x[:, 6:13], np.concatenate([q, Omega], axis=1))
    np.testing.assert_array_equal(perturbed.errors(x, x[:7] + 1.0), np.abs((x + 1.0) - x).max(axis=1)[:7])


def test_the_plain_right_hand_side_is_the_papers(benchmarks):
    """Against the scalar statement of the same equations, on each leg between kinks."""
    from peers.diffrax_batch import NUMBERS, right_hand_side

    problem, random = ALL["ball"], np.random.default_rng(3)
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        compiled = jax.jit(lambda t, x: right_hand_side(t, x, NUMBERS))
        for piece in problem.pieces:
            t, x = (piece.start + piece.end) / 2, random.normal(size=15)
            expected = problem.rates(t, list(x), list(piece.parameters), math)
            np.testing.assert_allclose(compiled(jnp.asarray(t), jnp.asarray(x)), expected, rtol=0.0, atol=1e-11)


@pytest.mark.slow
def test_all_contenders_solve_the_same_problem(tmp_path):
    """Few runs, errors only: plain diffrax steps over the kinks, so its bound is far coarser."""
    out = tmp_path / "batch.json"
    settings = ["--rows", "32", "--subset", "8", "--tolerances", "1e-8", "--rounds", "1"]
    done = run_script("batch.py", *settings, "--json", str(out), "--figure", str(tmp_path / "batch.png"))
    assert done.returncode == 0, done.stderr
    content = json.loads(out.read_text())
    assert {"machine", "versions", "rows", "agreement", "at_equal_error"} <= content.keys()
    for row in content["rows"]:
        assert row["failed"] == 0
        assert row["error_max"] <= (1e-3 if row["solver"].startswith("diffrax") else 1e-5), row
    if content["agreement"]:
        assert content["agreement"]["max"] <= 1e-11
    assert (tmp_path / "batch.png").read_bytes().startswith(b"\x89PNG")
