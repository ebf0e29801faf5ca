"""Classical systems in scenario files: what is read, written again, and refused in one sentence."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import Scenario, ScenarioError, read_scenario, write_scenario
from jaxball.files.scenario.sources import builtin_text
from jaxball.physics import classical
from tests.support.sentences import refuses
from tests.support.vehicle_files import VEHICLES, in_python

TOP = """\
format = 1
kind = "heavy-top"
body = { mass = 0.5, inertia = [1.3, 1.1, 0.8], chi = [0.0, 0.1, 0.7], gravity = 3.0 }
initial = { axis = [0.0, 0.0, 2.0], angle = 1.0, Omega = [0.1, 0.2, 0.3] }
time = { start = 0.0, end = 1.0, saves = 3 }
"""
SUSLOV = """\
format = 1
kind = "suslov"
time = { start = 0.0, end = 1.0, saves = 3 }
initial = { Omega = [0.0, 0.0, 1.0] }

[body]
inertia = [1.0, 1.6, 2.1]
xi = { constant = [1.0, 0.0, 0.0], amplitude = [[0.0, 0.3, 0.0]], frequency = [2.0] }
"""
PARTICLE = builtin_text("vakonomic-particle")
ELLIPSOID = """\
format = 1
kind = "rolling-ellipsoid"
body = { mass = 2.0, semiaxes = [1.0, 0.8, 0.6], inertia = [0.3, 0.4, 0.5], turn = 0.1, gravity = 9.8 }
resistance = { rolling = 0.1, dry = 0.02 }
initial = { axis = [1.0, 0.0, 0.0], angle = 0.2, Omega = [0.1, 0.2, 0.3], z = [1.0, 2.0] }
time = { start = 0.0, end = 1.0, saves = 3 }
"""
SLEIGH, RACER = VEHICLES["chaplygin-sleigh"], VEHICLES["roller-racer"]


@pytest.mark.parametrize("kind", VEHICLES)
def test_vehicles_are_those_of_python(kind):
    system, state = in_python()[kind]
    scenario = read_scenario(VEHICLES[kind])
    again = read_scenario(write_scenario(scenario))
    for read in (scenario, again):
        assert type(read.system) is type(system)
        assert jax.tree.structure((read.system, read.state)) == jax.tree.structure((system, state))
        jax.tree.map(np.testing.assert_array_equal, (read.system, read.state), (system, state))


def test_a_top():
    scenario = read_scenario(TOP)
    top, state = scenario.system, scenario.state
    assert isinstance(top, classical.HeavyTop)
    np.testing.assert_array_equal(top.chi, [0.0, 0.1, 0.7])
    np.testing.assert_allclose(state.q, [np.cos(0.5), 0.0, 0.0, np.sin(0.5)], rtol=1e-15)
    np.testing.assert_array_equal(state.Omega, [0.1, 0.2, 0.3])


def test_the_particle_of_a_file_has_the_papers_multiplier():
    state = read_scenario(PARTICLE).state
    assert state.multiplier == -state.y * state.xdot
    assert read_scenario(PARTICLE.replace("x = 1.0", "multiplier = 0.5\nx = 1.0", 1)).state.multiplier == 0.5


@pytest.mark.parametrize("text", [TOP, SUSLOV, PARTICLE, ELLIPSOID], ids=["top", "suslov", "particle", "ellipsoid"])
def test_what_is_written_reads_the_same(text):
    scenario = read_scenario(text)
    again = read_scenario(write_scenario(scenario))
    assert jax.tree.structure(again.system) == jax.tree.structure(scenario.system)
    for pair in ((scenario.system, again.system), (scenario.state, again.state)):
        jax.tree.map(np.testing.assert_array_equal, *pair)
    np.testing.assert_array_equal(again.times, scenario.times)


@pytest.mark.parametrize(
    ("text", "old", "new", "named"),
    [
        (TOP, "heavy-top", "heavy-tap", "kind"),
        (TOP, '"heavy-top"', '["heavy-top"]', "kind"),
        (TOP, "chi = [0.0, 0.1, 0.7], ", "", "body.chi"),
        (TOP, "0.7]", "1.7]", "body.chi"),
        (TOP, "0.8]", "2.8]", "body.inertia"),
        (TOP, "gravity", "gravty", "body.gravty"),
        (TOP, "format = 1", "format = 1\nmasses = []", "masses"),
        (TOP, "axis = [0.0, 0.0, 2.0], angle = 1.0", "versor = [1.0, 1.0, 0.0, 0.0]", "initial.versor"),
        (SUSLOV, "[0.0, 0.0, 1.0]", "[0.1, 0.0, 1.0]", "initial.Omega"),
        (SUSLOV, "[1.0, 0.0, 0.0]", "[0.0, 0.0, 0.0]", "body.xi"),
        (SUSLOV, "frequency = [2.0]", "frequency = []", "body.xi.frequency"),
        (ELLIPSOID, "[1.0, 0.8", "[1.0, 0.0", "body.semiaxes"),
        (ELLIPSOID, "turn", "offset = [0.0, 0.0, 0.7], turn", "body.offset"),
        (ELLIPSOID, "rolling = 0.1", "rolling = -0.1", "resistance.rolling"),
        (TOP, "time", "resistance = { rolling = 0.1 }\ntime", "resistance"),
        (PARTICLE, "xdot", "xdor", "initial.xdor"),
        (SLEIGH, ", ahead = 0.5", "", "body.ahead"),
        (SLEIGH, "inertia = 0.39", "inertia = 0", "body.inertia"),
        (SLEIGH, "[1.0, 2.0, 0.0]", "[1.0, 2.0]", "initial.q"),
        (SLEIGH, "[0.5, 0.0, 1.0]", "[0.5, 0.1, 1.0]", "initial.qdot"),
        (
            VEHICLES["rolling-coin"],
            "q = [0.0, 0.0, 0.0, 0.1, 0.0], qdot = [1.0",
            "q = [0.0, 0.0, -1e300, 0.1, 0.0], qdot = [1e300",
            "initial",
        ),
        (RACER, "[1.0, 0.0, 0.0, 0.0]", "[1.0, 0.0, 0.0]", "initial.qdot"),
        (SLEIGH, "time", "solve = { solver = 'radau5', dae = true }\ntime", "solve.dae"),
        (PARTICLE, "[time]", "[solve]\nsolver = 'radau5'\ndae = true\n[time]", "solve.dae"),
        (PARTICLE, "[time]", "[solve]\nproject = true\n[time]", "solve.project"),
    ],
)
def test_what_is_refused(text, old, new, named):
    assert old in text
    with refuses(ScenarioError, named):
        read_scenario(text.replace(old, new, 1))


def fixed(t, parameters):
    return jnp.array([1.0, 0.0, 0.0])


def test_a_function_of_time_cannot_be_written():
    problem = classical.SuslovProblem(inertia=(1.0, 1.6, 2.1), xi=classical.FunctionAxis(fixed))
    scenario = Scenario("", problem, classical.RigidBodyState(), np.array([0.0, 1.0]))
    with refuses(ScenarioError, "body.xi"):
        write_scenario(scenario)
