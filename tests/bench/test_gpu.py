"""The benchmark of GPUs, tried on a CPU: what it compares and computes, and that what fails costs itself alone."""

import json
import time

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.support.scripts import run_script

JOBS = """
import os
import time


def add(a, b):
    return a + b


def fail():
    raise ValueError("nothing fits")


def absent():
    import a_package_that_nobody_has


def crash():
    os._exit(3)


def hang():
    time.sleep(600)


def variable(name):
    return os.environ.get(name)
"""


@pytest.mark.thorough
@pytest.mark.parametrize("platforms", ["cpu", "cuda,nonexistent"])
def test_without_a_gpu_one_sentence_says_so(platforms):
    done = run_script("gpu.py", JAX_PLATFORMS=platforms)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("No GPU was measured, because JAX ")
    assert done.stdout.count("\n") == 1


@pytest.fixture
def worker(benchmarks, monkeypatch, tmp_path):
    """A worker that knows the jobs above."""
    from workers import Worker

    (tmp_path / "known_jobs.py").write_text(JOBS)
    monkeypatch.syspath_prepend(str(tmp_path))
    with Worker("cpu", "xla") as worker:
        yield worker


@pytest.mark.thorough
def test_a_job_that_fails_costs_itself_alone(worker):
    from workers import LostError

    reasons = {
        "fail": "ValueError: nothing fits",
        "absent": "a_package_that_nobody_has is not installed",
        "crash": "its process ended with exit code 3",
        "misspelt": "AttributeError: module 'known_jobs' has no attribute 'misspelt'",
    }
    for name, reason in reasons.items():
        with pytest.raises(LostError, match=reason):
            worker.ask(30.0, f"known_jobs:{name}")
        assert worker.ask(30.0, "known_jobs:add", 2, 3) == 5
    assert worker.ask(30.0, "known_jobs:variable", "JAXBALL_COMPILER") == "xla"
    start = time.monotonic()
    with pytest.raises(LostError, match="it did not end within 1 s"):
        worker.ask(1.0, "known_jobs:hang")
    assert time.monotonic() - start < 30.0  # and not the ten minutes that the job sleeps
    assert worker.ask(30.0, "known_jobs:add", 2, 3) == 5


def test_time_that_a_section_leaves_is_shared_by_those_after_it(benchmarks, monkeypatch):
    import workers

    now = 100.0
    monkeypatch.setattr(workers.time, "monotonic", lambda: now)
    budget = workers.Budget(80.0)
    budget.begin_section(1.0, [2.0, 1.0])
    assert (budget.left(), budget.left(at_most=7.0)) == (20.0, 7.0)
    now = 105.0
    budget.begin_section(2.0, [1.0])
    assert (budget.left(), budget.total_left(), budget.spent()) == (50.0, 75.0, 5.0)


def test_numbers_are_compared_to_the_last_bit(benchmarks):
    from gpu_sections import compare, ulps

    a = np.array([1.0, -2.0, np.nan, 0.0, 3.0, np.inf])
    assert compare([a, np.arange(4)], [a.copy(), np.arange(4)]) == {
        "numbers": 10, "equal": 10, "ulp": 0.0, "relative": 0.0, "unlike": 0,
    }  # fmt: skip
    b = a.copy()
    b[1] = np.nextafter(np.nextafter(b[1], 0.0), 0.0)
    b[2], b[5] = 1.0, -np.inf
    found = compare([a, np.arange(4)], [b, np.array([0, 1, 2, 9])])
    assert (found["numbers"], found["equal"], found["unlike"], found["ulp"]) == (10, 6, 3, 2.0)
    np.testing.assert_allclose(found["relative"], 2 * 2.0**-52 / 3.0, rtol=1e-12)
    smallest = np.nextafter(0.0, 1.0)
    np.testing.assert_array_equal(ulps(np.array([smallest, -0.0]), np.array([-smallest, 0.0])), [2.0, 0.0])


class StubWorker:
    """Solves a thousand rows in a tenth of a second, off by the tolerance; diffrax fails, and GRADSOLVE is missing."""

    platform = "gpu"

    def __init__(self, platform, compiler=""):
        self.job = ()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def begin(self, *job):
        self.job = job

    def result(self, seconds):
        from workers import LostError

        place, *arguments = self.job
        if "diffrax" in str(self.job):
            raise LostError("RuntimeError: out of memory")
        if "gradsolve" in place:
            raise LostError("gradsolve is not installed")
        return getattr(self, place.removeprefix("gpu_timings:"))(*arguments)

    def solved(self, rows, **others):
        return {
            "rows": rows,
            "compiler": "jaxball",
            "compile": 2.0,
            "first": 1.0,
            "calls": 5,
            "seconds": 1e-4 * rows,
            **others,
        }

    def batch(self, place, rows, tolerances, cores):
        states = np.ones((64, 9))
        states[3] = np.nan
        return [self.solved(rows, tolerance=e, states=e * states, initial=(0, 0)) for e in tolerances]

    def reference(self, q, Omega):
        return np.zeros((64, 9))

    def lorenz(self, rows, tolerance):
        return self.solved(rows, states=2.0 + tolerance * np.ones((64, 3)), initial=0)

    def lorenz_gradient(self, rows, tolerance):
        return self.solved(rows, states=4.0 + tolerance * np.ones(64), initial=0)

    def lorenz_reference(self, rho):
        return 2.0 * np.ones((64, 3)), 4.0 * np.ones(64)

    def gradient(self, name, rows):
        return self.solved(rows, ratio=5.0, unknown=2)


@pytest.fixture
def session(benchmarks, monkeypatch):
    """Stubs for all workers, and 300 s."""
    import gpu_sections
    from workers import Budget

    monkeypatch.setattr(gpu_sections, "Worker", StubWorker)
    return gpu_sections.Session(Budget(300.0), StubWorker("gpu"), StubWorker("cpu"), 10**7)


def test_batches_grow_as_long_as_there_is_time(session, capsys):
    """A million rows take 100 s in each of six calls at two tolerances, for which there is no time."""
    import gpu_sections

    rows = gpu_sections.ball(session)["rows"]
    ours = [row for row in rows if row["solver"] == "jaxball"]
    assert [row["rows"] for row in ours] == [10**3, 10**3, 10**4, 10**4, 10**5, 10**5]
    np.testing.assert_allclose([row["rate"] for row in rows], 1e4, rtol=1e-12)
    np.testing.assert_array_equal([row["error_median"] for row in ours], 3 * [1e-6, 1e-10])
    assert {row["failed"] for row in rows} == {1}
    assert [loss["what"] for loss in session.losses] == ["jaxball, 1000000 rows", "diffrax, jax.vmap, 1000 rows"]
    said = capsys.readouterr().out
    assert "diffrax, jax.vmap, 1000 rows: none, because RuntimeError: out of memory" in said
    assert said.count("10,000/s") == len(rows)


def test_the_table_of_lorenz_has_relative_errors_and_published_times(session, capsys):
    import gpu_sections

    found = gpu_sections.lorenz(session)
    assert [(row["rows"], row["tolerance"]) for row in found["runs"]] == [(524_288, 1e-6), (524_288, 1e-8)]
    np.testing.assert_allclose([row["error_median"] for row in found["runs"]], [5e-7, 5e-9], rtol=1e-6)
    (slope,) = found["gradients"]
    np.testing.assert_allclose((slope["error_median"], slope["rate"]), (2.5e-9, 1e4), rtol=1e-6)
    assert len(session.losses) == 4  # a run and a gradient of each of the others
    assert "DiffEqGPU.jl, kernel         1e-08       4.240 ms" in capsys.readouterr().out


def test_gradients_are_counted_in_runs(session, capsys):
    import gpu_sections

    session.rows = 10**4
    rows = gpu_sections.gradients(session)["rows"]
    assert [row["rows"] for row in rows] == 3 * [10**4]
    np.testing.assert_allclose([row["rate"] for row in rows], 1e4, rtol=1e-12)
    assert capsys.readouterr().out.count("5.0 runs  compiled in 2.0 s by jaxball; 2 not known") == 3


def test_the_figure_holds_the_rows(benchmarks):
    from gpu_figure import diagram

    rows = [
        {"solver": solver, "rows": count, "tolerance": tolerance, "rate": factor * count}
        for solver, factor in (("jaxball", 3.0), ("heyoka, on the CPU", 1.0))
        for count in (10, 100)
        for tolerance in (1e-6, 1e-10)
    ]
    coarse, fine = diagram(rows, "a card").axes
    for ax in (coarse, fine):
        lines = {line.get_label(): line for line in ax.lines}
        np.testing.assert_array_equal(lines["jaxball"].get_ydata(), [30.0, 300.0])
        assert lines["jaxball"].get_linewidth() > lines["heyoka, on the CPU"].get_linewidth()


def lorenz(rho):
    """y(1) by SciPy."""

    def rates(t, y):
        return [10 * (y[1] - y[0]), rho * y[0] - y[1] - y[0] * y[2], y[0] * y[1] - 8 / 3 * y[2]]

    return solve_ivp(rates, (0.0, 1.0), [1.0, 0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]


@pytest.mark.long
def test_lorenz_and_its_gradient_are_those_of_another_engine(benchmarks):
    """The gradient against central differences, whose error with steps of 1e-4 is some 1e-8."""
    import gpu_timings

    rho, step = np.array([5.0, 21.0]), 1e-4
    ends, slopes = gpu_timings.lorenz_reference(rho)
    np.testing.assert_allclose(ends, [lorenz(value) for value in rho], rtol=0.0, atol=1e-10)
    squares = [[np.sum(lorenz(value + sign * step) ** 2) for value in rho] for sign in (1, -1)]
    np.testing.assert_allclose(slopes, (np.array(squares[0]) - squares[1]) / (2 * step), rtol=1e-6)
    coarse = gpu_timings.lorenz(2, 1e-8)  # rho = 0 and 21
    np.testing.assert_allclose(coarse["states"][1], lorenz(21.0), rtol=1e-6)
    np.testing.assert_allclose(gpu_timings.lorenz_gradient(2, 1e-8)["states"][1], slopes[1], rtol=1e-6)


@pytest.mark.long
def test_failures_are_of_all_kinds(benchmarks):
    """Of five rows one ends well, two are impossible, one takes too long, and one overflows."""
    import gpu_programs
    import jax

    from jaxball import Status

    program = gpu_programs.PROGRAMS["failures"]
    status = jax.jit(jax.vmap(program.run))(*map(jnp.asarray, program.rows(5)))[2]
    expected = [Status.SUCCESS, Status.IMPOSSIBLE, Status.IMPOSSIBLE, Status.MAX_STEPS, Status.NOT_FINITE]
    assert status.tolist() == expected


@pytest.mark.long
def test_the_script_compares_programs(tmp_path):
    """On a CPU instead of a GPU, where both are the same program; what is not a number is equal to itself."""
    out = tmp_path / "gpu.json"
    arguments = ["--platform", "cpu", "--rows", "5", "--budget", "300", "--json", str(out)]
    done = run_script("gpu.py", *arguments, "--sections", "equality", "--programs", "failures", "nothing")
    assert done.returncode == 0, done.stderr
    content = json.loads(out.read_text())
    assert {"machine", "versions", "device", "nvidia_smi", "losses"} <= content.keys()
    programs = {program["program"]: program for program in content["sections"]["equality"]["programs"]}
    assert programs.keys() == {"failures"}
    assert all(program["equal"] == program["numbers"] > 0 for program in programs.values())
    assert "nothing: none, because KeyError: 'nothing'" in done.stdout


@pytest.mark.slow
def test_the_whole_script(tmp_path):
    out = tmp_path / "gpu.json"
    arguments = ["--platform", "cpu", "--rows", "4", "--budget", "1500", "--json", str(out)]
    done = run_script("gpu.py", *arguments, "--figure", str(tmp_path / "gpu.png"))
    assert done.returncode == 0, done.stderr
    sections = json.loads(out.read_text())["sections"]
    assert all(program["equal"] == program["numbers"] for program in sections["equality"]["programs"])
    assert {"jaxball", "jaxball, on the CPU", "the same by XLA"} <= {row["solver"] for row in sections["ball"]["rows"]}
    assert all(row["error_max"] < 1e-4 for row in sections["ball"]["rows"] if row["solver"] != "diffrax, jax.vmap")
    assert all(row["unknown"] == 0 for row in sections["gradients"]["rows"])
    assert (tmp_path / "gpu.png").read_bytes().startswith(b"\x89PNG")
