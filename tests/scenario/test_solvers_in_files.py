"""The solvers that a scenario file can name, on the paper's two systems against their 30-digit solutions.

The bounds are 5 to 10 times what was measured.
"""

import diffrax
import numpy as np
import pytest

from jaxball import read_scenario
from jaxball.cli import main
from jaxball.files.scenario.solvers import KNOW_MASS_MATRICES, SOLVERS
from jaxball.files.scenario.sources import builtin_text
from jaxball.simulation.solvers import RadauIIA
from tests.support.paper import reference
from tests.support.sentences import said

pytestmark = pytest.mark.usefixtures("command_line")


EPS = np.finfo(float).eps
DAE = 'solver = "radau9"\ndae = true'


class OwnCollocation(RadauIIA):
    """A solver of a user's own that knows mass matrices."""

    def __init__(self):
        super().__init__(stages=5)


def file(name, solve):
    """The file of a built-in scenario with other times, t = 0, 1, …, 20, and another table [solve]."""
    before, _ = builtin_text(name).split("[solve]")
    return before.replace("step = 0.1", "step = 1.0") + f"[solve]\n{solve}\n"


def run(name, solve, tolerance):
    text = file(name, f"{solve}\nrtol = {tolerance}\natol = {tolerance}\nstep_to_times = true")
    return read_scenario(text).simulate(throw=True).state


def error(name, columns):
    """The largest difference to the reference solution, whose first columns are θ and θ̇."""
    expected, names = reference(f"paper_{name}")
    known = sum(part.startswith("theta") for part in names)
    return np.max(np.abs(np.concatenate(columns, axis=1) - expected[:, known:]))


@pytest.mark.long
def test_ball_in_differential_algebraic_form():
    state = run("ball", DAE, 1e-9)
    assert error("ball", [state.q, state.Omega, state.z]) < 2e-8


@pytest.mark.thorough
def test_ball_in_differential_algebraic_form_by_a_method_of_a_users_own():
    """Up to t = 2, with a tolerance of 1e-6."""
    solver = "tests.scenario.test_solvers_in_files:OwnCollocation"
    text = file("ball", f'solver = "{solver}"\ndae = true\nrtol = 1e-6\natol = 1e-6').replace("end = 20", "end = 2")
    state = read_scenario(text).simulate(throw=True).state
    expected = reference("paper_ball")[0]
    np.testing.assert_allclose(state.q, expected[: len(state.q), 6:10], rtol=0, atol=1e-3)


@pytest.mark.slow
def test_ball_with_projection():
    """Without it, |q| is off by some 1e-11."""
    state = run("ball", 'solver = "radau13"\nproject = true', 1e-9)
    assert np.max(np.abs(np.linalg.norm(state.q, axis=1) - 1)) <= 2 * EPS
    assert error("ball", [state.q, state.Omega, state.z]) < 2e-8


@pytest.mark.parametrize(
    ("solver", "order"),
    [
        ("dopri5", 5),
        ("dopri8", 8),
        ("tsit5", 5),
        ("kvaerno3", 3),
        ("kvaerno5", 5),
        ("adams", 13),
        ("radau5", 5),
        ("radau9", 9),
        ("radau13", 13),
        ("ndf", 5),
        ("gauss16", 16),
        ("trapezoidal", 2),
        ("tr-bdf2", 2),
    ],
)
def test_names_are_of_methods_of_that_order(solver, order):
    assert SOLVERS[solver]().order(diffrax.ODETerm(lambda t, y, args: y)) == order


@pytest.mark.parametrize("solver", [name for name in SOLVERS if name not in KNOW_MASS_MATRICES])
def test_differential_algebraic_form_by_another_solver(tmp_path, capsys, solver):
    """Whether the file names it or the command line does, it is bad input, and nothing is solved."""
    (tmp_path / "file.toml").write_text(file("ball", f'solver = "{solver}"\ndae = true'))
    (tmp_path / "good.toml").write_text(file("ball", DAE))
    bad, good = str(tmp_path / "file.toml"), str(tmp_path / "good.toml")
    for names, arguments in (((bad, "solve.solver"), [bad]), (("--solver",), [good, "--solver", solver])):
        assert main(["simulate", *arguments]) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        said(captured.err, *names)
