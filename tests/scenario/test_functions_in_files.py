"""What a file names as "module:name": functions and classes of forces, objectives and constraints of a design."""

import sys
import tomllib

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, FunctionWrench, Scenario, ScenarioError, read_scenario, write_scenario
from jaxball.studies import design
from jaxball.studies.design.files import read_control
from tests.design.test_rolling_control import PROBLEM as CONTROL
from tests.support.sentences import refuses

ROLLING = """
format = 1
kind = "ball"
body = { mass = 1.3, radius = 0.9, inertia = [0.6, 0.6, 0.6], gravity = 2.0 }
initial = { Omega = [0.0, 1.0, 0.0] }
time = { start = 0.0, end = 3.0, saves = 4 }

[force]
function = "my_forces:drag"
parameters = { c = 0.7 }
"""
MODULE = """
import equinox as eqx
import jax.numpy as jnp
from jaxball.studies import design

def drag(t, motion, parameters):
    return -parameters["c"] * jnp.sqrt(jnp.sum(motion.velocity**2)) * motion.velocity

def lag(t, state, parameters):
    return (1.0 - state.own) / parameters["tau"]

def scalar(t, state, parameters):
    return t

def pushed(t, motion):
    return motion.own[0] * jnp.array([1.0, 0.0, 0.0])

def of_two(t, motion, parameters):
    return motion.velocity[:2]

def far(run, parameters):
    return -run.z[-1, 0] / run.length

def fast(run, parameters):
    return jnp.abs(run.state.Omega[:, 1]) - parameters

def speeds(run, parameters):
    return parameters[0] * run.state.Omega[:, 1] ** 2

class Far(design.AbstractObjective):
    def __call__(self, run):
        return -run.z[-1, 0] / run.length

class Speeds(design.AbstractRunningObjective):
    factors: dict = eqx.field(converter=lambda given: {name: jnp.asarray(x) for name, x in given.items()})
    power: int = eqx.field(static=True, default=2)

    def integrand(self, run):
        return self.factors["of_speed"] * run.state.Omega[:, 1] ** self.power

class Fast(design.AbstractRunningConstraint):
    most: float

    def __check_init__(self):
        if self.most <= 0:
            raise ValueError("Argument `most` must be positive.")

    def __call__(self, run):
        return jnp.abs(run.state.Omega[:, 1]) - self.most

number = 3
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module beside the file, in the current folder, which no path leads to."""
    (tmp_path / "my_forces.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path not in ("", str(tmp_path))])
    monkeypatch.delitem(sys.modules, "my_forces", raising=False)
    yield tmp_path
    sys.modules.pop("my_forces", None)


@pytest.mark.thorough
def test_a_force_of_a_function_of_a_file(module):
    """v = v0 / (1 + c v0 t / (m + d/r²)), as the function has it; the text that is written says the same."""
    scenario = read_scenario(ROLLING)
    again = read_scenario(write_scenario(scenario))
    assert "" not in sys.path
    t = scenario.times
    for run in (scenario.simulate(), again.simulate()):
        expected = 1 / (1 + 0.7 * 0.9 * t / (1.3 + 0.6 / 0.9**2))
        np.testing.assert_allclose(run.state.Omega[:, 1], expected, rtol=0, atol=1e-9)
    saved = jaxball.load_run(scenario.simulate().save(module / "run.npz"))
    assert saved.system.force.function is scenario.system.force.function


COUNTED = """
format = 1
kind = "ball"
body = { mass = 1.3, radius = 0.9, inertia = [0.6, 0.6, 0.6], gravity = 2.0 }
initial = { own = [0.25] }
time = { start = 0.0, end = 3.0, saves = 4 }

[own_states]
names = ["push"]
function = "my_forces:lag"
parameters = { tau = 0.5 }

[force]
function = "my_forces:pushed"
"""


@pytest.mark.thorough
def test_own_states_of_a_function_of_a_file(module):
    """x = 1 + (x0 − 1) exp(−t/τ) is the force; a saved run has its file, and its system."""
    scenario = read_scenario(COUNTED)
    for each in (scenario, read_scenario(write_scenario(scenario))):
        run, t = each.simulate(), each.times
        np.testing.assert_allclose(run.state.own[:, 0], 1 - 0.75 * np.exp(-t / 0.5), rtol=0, atol=1e-9)
        impulse = t - 0.75 * 0.5 * (1 - np.exp(-t / 0.5))
        np.testing.assert_allclose(run.state.Omega[:, 1], 0.9 * impulse / (0.6 + 1.3 * 0.9**2), rtol=0, atol=1e-9)
    again = jaxball.load_run(run.save(module / "run.nc"))
    np.testing.assert_array_equal(again.state.own, run.state.own)
    assert again.system.own_states.function is scenario.system.own_states.function


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("[0.25]", "[0.25, 1.0]", "initial.own"),
        ('["push"]', '["push", "push"]', "own_states.names"),
        ('["push"]', '["push", "pull"]', "initial.own"),
        ("my_forces:lag", "my_forces:number", "own_states.function"),
        ("my_forces:lag", "my_forces:pushed", "own_states.function"),
        ("my_forces:lag", "my_forces:scalar", "own_states.function"),
        ("{ tau = 0.5 }", "{ d = 0.7 }", "own_states.function"),
    ],
)
def test_what_is_wrong_with_own_states_of_a_file_is_named(module, old, new, named):
    with refuses(ScenarioError, named):
        read_scenario(COUNTED.replace(old, new))


def following(t, motion, parameters):
    return motion.velocity


def test_a_script_keeps_its_own_functions():
    ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), force=FunctionWrench(lambda t, motion, p: motion.velocity))
    with refuses(ScenarioError, "force.function"):
        write_scenario(Scenario("", ball, BallState(), np.array([0.0, 1.0])))
    listed = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), force=FunctionWrench(following, [jnp.ones(())]))
    with refuses(ScenarioError, "force.parameters"):
        write_scenario(Scenario("", listed, BallState(), np.array([0.0, 1.0])))


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("my_forces:drag", "no_such_module:drag", "force.function"),
        ("my_forces:drag", "my_forces:pull", "force.function"),
        ("my_forces:drag", "my_forces:number", "force.function"),
        ("my_forces:drag", "my_forces:of_two", "force.function"),
        ("my_forces:drag", "my_forces:far", "force.function"),
        ("{ c = 0.7 }", "{ d = 0.7 }", "force.function"),
        ("{ c = 0.7 }", "{ c = true }", "force.parameters.c"),
        ('"my_forces:drag"', "3", "force.function"),
        ("{ c = 0.7 }", "{ c = 0.7 }\nconstant = [1.0, 0.0, 0.0]", "force.constant"),
    ],
)
def test_what_is_no_such_function_is_named(module, old, new, named):
    with refuses(ScenarioError, named):
        read_scenario(ROLLING.replace(old, new))


PROBLEM = f"""
format = 1

[[variables]]
path = "force.parameters.c"
lower = 0.1
upper = 2.0

[[objectives]]
kind = "function"
function = "my_forces:far"
weight = 2.0

[[objectives]]
kind = "running-function"
function = "my_forces:speeds"
parameters = [3.0]

[[constraints]]
kind = "function"
function = "my_forces:fast"
parameters = 0.5

[scenario]
{ROLLING.replace("[force]", "[scenario.force]").strip()}
"""


CLASSES = (
    PROBLEM.replace('kind = "function"\nfunction = "my_forces:far"', 'kind = "my_forces:Far"')
    .replace('kind = "running-function"\nfunction = "my_forces:speeds"', 'kind = "my_forces:Speeds"')
    .replace("parameters = [3.0]", "factors = { of_speed = 3.0 }")
    .replace('kind = "function"\nfunction = "my_forces:fast"\nparameters', 'kind = "my_forces:Fast"\nmost')
)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("text", "names"),
    [(PROBLEM, ["function", "running-function"]), (CLASSES, ["Far", "Speeds"])],
    ids=["functions", "classes"],
)
def test_objectives_and_constraints_of_a_file_have_their_values(module, text, names):
    """In closed form. Fields of classes are the keys of their tables; a static one, left out here, is an integer."""
    found = design.read_problem(text).problem
    weights = {name: float(one.weight) for name, one in found.objectives.items()}
    assert weights == dict(zip(names, [2.0, 1.0], strict=True))
    evaluation = found.evaluate_run(found.run(jnp.asarray(found.space.start)))
    k, t, v0 = 0.7 / (1.3 + 0.6 / 0.9**2), np.linspace(0.0, 3.0, 4), 0.9
    rate = 1 / (1 + k * v0 * t)
    path = np.log(1 + k * v0 * t) / k
    np.testing.assert_allclose(evaluation.terms[0], -path[-1] / 0.9, rtol=1e-9)
    squares = 3.0 * rate**2
    # The mean of the cubic through four values, by Simpson's rule of three eighths.
    np.testing.assert_allclose(evaluation.terms[1], squares @ np.array([1, 3, 3, 1]) / 8, rtol=1e-9)
    np.testing.assert_allclose(evaluation.violations, rate - 0.5, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("my_forces:far", "my_forces:drag", "objectives[0].function"),
        ("my_forces:fast", "my_forces:slow", "constraints[0].function"),
        ("parameters = 0.5", 'parameters = "fast"', "constraints[0].parameters"),
    ],
)
def test_what_is_no_objective_is_named(module, old, new, named):
    with refuses(ScenarioError, named):
        design.read_problem(PROBLEM.replace(old, new))


def test_a_static_field_of_a_class_is_what_the_file_says(module):
    found = design.read_problem(CLASSES.replace("factors =", "power = 3\nfactors =")).problem
    assert isinstance(found.objectives["Speeds"].power, int)
    assert found.objectives["Speeds"].power == 3


def test_two_objectives_of_one_class_have_names_of_their_own(module):
    second = '[[objectives]]\nkind = "my_forces:Far"\n\n[scenario]'
    assert list(design.read_problem(CLASSES.replace("[scenario]", second, 1)).problem.objectives) == [
        "Far",
        "Speeds",
        "Far 2",
    ]


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("my_forces:Far", "my_forces:Fast", "objectives[0].kind"),
        ("my_forces:Fast", "my_forces:Far", "constraints[0].kind"),
        ("my_forces:Far", "my_forces:far", "objectives[0].kind"),
        ("my_forces:Far", "my_forces:Near", "objectives[0].kind"),
        ("my_forces:Far", "my_goals:Far", "objectives[0].kind"),
        ("most = 0.5", "", "constraints[0].most"),
        ("most = 0.5", "least = 0.5", "constraints[0].least"),
        ("most = 0.5", 'most = "fast"', "constraints[0].most"),
        ("most = 0.5", "most = -0.5", "constraints[0].kind"),
        ("weight = 2.0", "weigth = 2.0", "objectives[0].weigth"),
    ],
)
def test_what_is_no_class_of_an_objective_or_constraint_is_named(module, old, new, named):
    with refuses(ScenarioError, named):
        design.read_problem(CLASSES.replace(old, new))


def test_optimal_control_takes_classes_of_a_single_time(module):
    speeds = {"kind": "my_forces:Speeds", "factors": {"of_speed": 1.0}}
    document = tomllib.loads(CONTROL)
    found = read_control({**document, "objectives": [*document["objectives"], speeds]})
    assert [*found.problem.objectives][-1] == "Speeds"
    limited = read_control({**document, "constraints": [{"kind": "my_forces:Fast", "most": 9.0}]})
    assert [*limited.problem.constraints] == ["Fast"]
    with refuses(ScenarioError, "control"):
        read_control({**document, "objectives": [*document["objectives"], {"kind": "my_forces:Far"}]})
