"""The controlled disk: its schedules simulated by another solver, which knows of no controls."""

import os
import re
import tomllib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import cli
from jaxball.files.scenario import Units
from jaxball.studies import design
from jaxball.studies.design import optimal_control
from jaxball.studies.design.files import read_control
from jaxball.studies.design.optimal_control.collocation import multiplier
from jaxball.studies.design.problem.run import Run
from jaxball.studies.design.report import name_paths
from tests.support.sentences import refuses, said

END, PLACE = 8.0, 1.0
DOWN = -np.pi / 2


def disk():
    masses = [jaxball.PointMass(1.0, jaxball.OnRail(jaxball.Circle(r), jaxball.ConstantRate(DOWN))) for r in (0.9, 0.6)]
    return jaxball.Disk(mass=1.0, inertia=1.0, masses=masses)


def problem(weight, **constraints):
    """A rest-to-rest tracking problem, with the tracking cost multiplied by ``weight``."""
    curve = design.Through([[0.0, 0.0], [PLACE, 0.0]])
    tracking = design.FollowTrajectory(curve, rest_to_rest=True, weight=weight)
    effort = design.AccelerationEffort(weight=0.01)
    objectives = {"follow-trajectory": tracking, "acceleration-effort": effort}
    return optimal_control.Rolling(disk(), (0.0, END), objectives, place=PLACE, constraints=constraints)


def test_paths_are_named_by_what_tells_them_apart():
    """A legend that says "first weight" beside "last weight" is of a branch on which a weight changes."""
    limit = design.AccelerationLimit(0.15)
    assert name_paths(problem(1.0), problem(2.0)) == ("first weight", "last weight")
    assert name_paths(problem(1.0, limit=limit), problem(1.0, limit=limit)) == ("far from its constraints", "found")
    assert name_paths(problem(1.0), problem(1.0)) == ("_", "found")


@pytest.fixture(scope="module")
def easy():
    """The solution where the tracking hardly counts."""
    return problem(0.01).solve(np.linspace(0.0, END, 9), tolerance=1e-6)


@pytest.fixture(scope="module")
def run(easy):
    """Its schedules simulated."""
    return easy.scenario(saves=2001).simulate(rtol=1e-11, atol=1e-11, throw=True)


@pytest.mark.long
def test_the_schedules_do_what_the_solution_says(easy, run):
    """By a simulation that knows of schedules and not of controls."""
    assert np.max(easy.errors) <= 1e-6
    found = easy.places(np.asarray(run.times))
    np.testing.assert_allclose(run.state.z, found, atol=1e-5)
    np.testing.assert_allclose(run.state.z[-1], PLACE, atol=1e-6)
    np.testing.assert_allclose(run.state.phidot[-1], 0.0, atol=1e-6)
    theta = [schedule.derivatives(jnp.asarray(END)) for schedule in easy.schedules()]
    np.testing.assert_allclose([rates[1] for rates in theta], 0.0, atol=1e-6)
    # The centre of mass: body angle θ, turned by φ in space.
    angles = np.asarray([rates[0] for rates in theta]) + float(run.state.phi[-1])
    np.testing.assert_allclose(np.sum(np.array([0.9, 0.6]) * np.cos(angles)), 0.0, atol=1e-6)
    assert np.sum(np.array([0.9, 0.6]) * np.sin(angles)) < 0


@pytest.mark.long
def test_the_costs_are_those_of_the_simulation(easy, run):
    times = np.asarray(run.times)
    u = 1 - 2 * times / END
    share = (1 - u) / 2
    wanted = PLACE * share**3 * (10 - 15 * share + 6 * share**2)
    tracking = np.trapezoid((np.asarray(run.state.z) - wanted) ** 2, times) / END
    acceleration = easy.path.inputs(times)
    effort = np.trapezoid(np.sum(acceleration**2, axis=1), times) / END
    found = easy.means()
    np.testing.assert_allclose(found["follow-trajectory"], tracking, rtol=1e-4)
    np.testing.assert_allclose(found["acceleration-effort"], effort, rtol=1e-4)


@pytest.mark.long
def test_newton_comes_to_the_same_optimum_from_rest_and_from_the_wanted_path(easy):
    one, mesh = problem(0.01), np.linspace(0.0, END, 9)
    other = one.solve(mesh, guess=one.rolling_along(mesh))
    times = np.linspace(0.0, END, 41)
    np.testing.assert_allclose(other.path.states(times), easy.path.states(times), atol=1e-5)


@pytest.mark.thorough
def test_a_scenario_file_holds_the_schedules(easy):
    again = jaxball.read_scenario(jaxball.write_scenario(easy.scenario("tracking")))
    assert again.title == "tracking"
    first, second = (jax.tree.leaves(one.system) for one in (easy.scenario(), again))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.slow
def test_the_tracking_error_falls_along_the_branch(easy):
    """To what the same problem has that is solved at once."""
    branch, hard = easy.continue_to(problem(10.0))
    assert branch.ended == "end"
    assert hard.least_curvature() > 0
    assert easy.means()["follow-trajectory"] > 100 * hard.means()["follow-trajectory"]
    one, mesh = problem(10.0), np.linspace(0.0, END, 9)
    at_once = one.solve(mesh, guess=one.rolling_along(mesh))
    for name, value in hard.means().items():
        np.testing.assert_allclose(at_once.means()[name], value, rtol=1e-4)
    seen = hard.resimulate()
    assert max(seen.apart, seen.speed, seen.away, seen.missed) < 1e-5
    assert seen.below > 0
    assert seen.margin > 0


def test_a_problem_half_way_between_two():
    middle = optimal_control.Rolling.between((problem(0.1), problem(10.0)), jnp.asarray(0.5))
    np.testing.assert_allclose(middle.objectives["follow-trajectory"].weight, 1.0, rtol=1e-12)
    np.testing.assert_allclose(middle.objectives["acceleration-effort"].weight, 0.01, rtol=1e-12)


PROBLEM = f"""
format = 1
title = "From rest to rest"

[scenario]
format = 1
kind = "disk"
units = {{ length = "m", mass = "kg", time = "s" }}
body = {{ mass = 1.0, radius = 1.0, inertia = 1.0, gravity = 1.0 }}
initial = {{ phi = 0.0 }}
time = {{ start = 0.0, end = {END}, saves = 41 }}

[[scenario.masses]]
mass = 1.0
rail = {{ kind = "circle", radius = 0.9 }}
schedule = {{ kind = "constant-rate", theta = {DOWN}, rate = 0.0 }}

[[scenario.masses]]
mass = 1.0
rail = {{ kind = "circle", radius = 0.6 }}
schedule = {{ kind = "constant-rate", theta = {DOWN}, rate = 0.0 }}

[[objectives]]
kind = "follow-trajectory"
curve = {{ kind = "through", points = [0.0, {PLACE}] }}
rest_to_rest = true
weight = 0.02

[[objectives]]
kind = "acceleration-effort"
weight = 0.01

[control]
place = {PLACE}
intervals = 8
first_weights = {{ follow-trajectory = 0.01 }}
"""


CONSTRAINT = """
[[constraints]]
kind = "speed-limit"
most = 0.12

[control]
"""


def command(folder, text):
    (folder / "problem.toml").write_text(text)
    return cli.main(["design", str(folder / "problem.toml"), "--out", str(folder / "out")])


def test_a_file_says_what_python_says():
    found = read_control(tomllib.loads(PROBLEM))
    assert found.easy is not None
    for one, other in ((found.problem, problem(0.02)), (found.easy, problem(0.01))):
        for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
            np.testing.assert_array_equal(a, b)
    assert (found.intervals, found.saves, found.tolerance) == (8, 41, 1e-6)
    assert found.units == Units("m", "kg", "s")
    limited = read_control(tomllib.loads(PROBLEM.replace("[control]", CONSTRAINT)))
    assert list(limited.problem.constraints) == ["speed-limit"]
    np.testing.assert_array_equal(limited.problem.constraints["speed-limit"].most, 0.12)


@pytest.mark.slow
def test_the_command_finds_what_python_finds(tmp_path, capsys, easy, monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", ""))
    assert command(tmp_path, PROBLEM) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith("From rest to rest\n")
    assert len(captured.err.splitlines()) > 1
    report = (tmp_path / "out" / "report.md").read_text()
    row = next(line for line in report.splitlines() if line.startswith("| follow-trajectory"))
    *numbers, meant = row.split("|")[2:-1]
    numbers = [float(part) for part in numbers]
    assert meant.strip() == f"root mean square distance {np.sqrt(numbers[3]):.4g} m"
    np.testing.assert_allclose(numbers[:3], [0.01, easy.means()["follow-trajectory"], 0.02], rtol=1e-5)
    assert 0 < numbers[3] < numbers[1]
    for name in ("path", "angles", "accelerations", "branch"):
        assert f"![{name}]({name}.png)" in report
        assert (tmp_path / "out" / f"{name}.png").stat().st_size > 0
    run = jaxball.load_scenario(tmp_path / "out" / "design.toml").simulate()
    np.testing.assert_allclose([run.state.z[-1], run.state.phidot[-1]], [PLACE, 0.0], atol=1e-5)


def interrupted(*arguments, **options):
    raise KeyboardInterrupt


@pytest.mark.long
def test_ctrl_c_leaves_the_last_motion(tmp_path, capsys, easy, monkeypatch):
    """That of ``easy``, whose compiled programs it shares; stopped before it is looked at as a minimum."""
    monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", ""))
    monkeypatch.setattr("jaxball.studies.design.optimal_control.solution.Solution.least_curvature", interrupted)
    text = PROBLEM.replace("weight = 0.02", "weight = 0.01").replace("first_weights", "# first_weights")
    assert command(tmp_path, text) == 130
    captured = capsys.readouterr()
    assert captured.out == ""
    scenario = tmp_path / "out" / "design.toml"
    assert captured.err.endswith(f"jaxball: Stopped; the last motion found is {scenario}.\n")
    found = jaxball.load_scenario(scenario)
    assert found.units == Units("m", "kg", "s")
    run = found.simulate(throw=True)
    np.testing.assert_allclose(run.state.z, easy.places(np.asarray(run.times)), atol=1e-5)


def test_ctrl_c_before_a_motion_is_found(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", ""))
    monkeypatch.setattr("jaxball.studies.design.optimal_control.solve.solve_from_guess", interrupted)
    assert command(tmp_path, PROBLEM) == 130
    told = "compiling, and solving from the guess\njaxball: Stopped; no motion was found yet.\n"
    assert capsys.readouterr().err == told
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        (f"place = {PLACE}", "place = [1.0, 2.0]", "control.place"),
        ("format = 1\ntitle", "constraints = 0\nformat = 1\ntitle", "constraints"),
        ("follow-trajectory = 0.01", "follow = 0.01", "control.first_weights"),
        ("first_weights = {", "first_weights = 3 #", "control.first_weights"),
        ('"acceleration-effort"', '"go-far"', "go-far"),
        ("intervals = 8", "intervals = 1", "control.intervals"),
        ("intervals = 8", 'guess = "reset"', "control.guess"),
        ("[control]", CONSTRAINT.replace("speed-limit", "regular-rails").replace("most", "least"), "regular-rails"),
        ("[control]", CONSTRAINT.replace("0.12", "-1.0"), "constraints[0].most"),
        ("intervals = 8", "violation = 0", "control.violation"),
    ],
)
def test_what_cannot_be_a_problem_of_control(tmp_path, capsys, old, new, named):
    assert command(tmp_path, PROBLEM.replace(old, new)) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    said(captured.err, named)
    assert not (tmp_path / "out").exists()


def test_a_system_without_rails_cannot_be_controlled():
    with refuses(design.DesignError, "system"):
        optimal_control.Rolling(jaxball.Disk(mass=1.0, inertia=1.0), (0.0, 1.0), {})


LIMITS = (0.149, 0.15, 0.151)


@pytest.fixture(scope="module")
def limited():
    """The first motion with accelerations of the masses that are limited to less than it has."""
    solutions = []
    for most in LIMITS:
        one = problem(0.01, limit=design.AccelerationLimit(most))
        solutions.append(one.solve(np.linspace(0.0, END, 9)).sharpen())
    return solutions


def cost(solution):
    return solution.collocation.cost(solution.y, solution.parameter)


@pytest.mark.slow
def test_a_limit_costs_what_its_multipliers_say(limited, easy):
    """The derivative of the least cost by a limit is minus the mean of the multipliers (the envelope theorem)."""
    found = limited[1].collocation
    s = found.parts(limited[1].y).excess
    weights = found.steps[:, None] * found.tableau.b / END
    multipliers = np.asarray(multiplier(jnp.asarray(np.ravel(s)), jnp.asarray(found.barrier))).reshape(s.shape)
    slope = (cost(limited[2]) - cost(limited[0])) / (LIMITS[2] - LIMITS[0])
    np.testing.assert_allclose(slope, -np.sum(weights[..., None] * multipliers), rtol=1e-2)
    assert cost(limited[1]) > cost(easy)


@pytest.mark.slow
def test_a_limit_holds_in_the_simulation(limited):
    """Of the accelerations by the schedules, χ̈ = r (θ̈ along the circle, θ̇² to its centre)."""
    t = jnp.linspace(0.0, END, 4001)
    rates = [jax.vmap(schedule.derivatives)(t) for schedule in limited[1].schedules()]
    found = [r * np.hypot(one[2], one[1] ** 2) for r, one in zip((0.9, 0.6), rates, strict=True)]
    assert LIMITS[1] - 1e-4 < np.max(found) < LIMITS[1] + 1e-4
    seen = limited[1].resimulate()
    np.testing.assert_allclose(seen.violations["limit"], np.max(found) - LIMITS[1], atol=1e-4)
    assert limited[1].least_curvature() > 0


@pytest.mark.slow
def test_the_command_keeps_constraints(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", ""))
    text = PROBLEM.replace("[control]", CONSTRAINT).replace("weight = 0.02", "weight = 0.01")
    text = text.replace("first_weights", "# first_weights")
    assert command(tmp_path, text) == 0
    captured = capsys.readouterr()
    assert "barrier 1e-08" in captured.err
    assert re.search(r"^  speed-limit: holds(, margin| to within) \S+$", captured.out, re.MULTILINE)
    report = (tmp_path / "out" / "report.md").read_text()
    found = re.search(r"^\| speed-limit \| holds(, margin| to within) (\S+) \|$", report, re.MULTILINE)
    assert float(found[2]) < (1e-3 if found[1] == ", margin" else 1e-4)
    assert (tmp_path / "out" / "problem.toml").read_text() == text
    run = jaxball.load_scenario(tmp_path / "out" / "design.toml").simulate(throw=True)
    limits = eqx.filter_jit(design.SpeedLimit(0.12))(Run(run.system, jnp.asarray(run.times), run.state, run.status))
    assert np.max(limits) <= 1e-4


@pytest.mark.slow
def test_constraints_that_leave_no_motion_are_told(tmp_path, capsys, monkeypatch):
    """On the plane, N is M g on average."""
    monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", ""))
    heavy = CONSTRAINT.replace("speed-limit", "normal-force").replace("most = 0.12", "least = 2.0")
    assert command(tmp_path, PROBLEM.replace("[control]", heavy)) == 2
    assert "The constraints must leave a motion" in capsys.readouterr().err
    assert not (tmp_path / "out" / "design.toml").exists()
