"""Events in scenario files: when they happen, against closed forms, and what is wrong with them, in a sentence."""

import dataclasses
import math
import sys
import tomllib

import jax
import numpy as np
import pytest
import tomli_w

from jaxball import Event, Scenario, ScenarioError, Slip, Status, load_run, read_scenario, write_scenario
from jaxball.files.results import saved_scenario
from jaxball.files.scenario.body import rolling_state
from jaxball.files.scenario.errors import all_problems
from tests.support.corpus import EVERY_EVENT
from tests.support.sentences import refuses
from tests.support.under_feedback import FEEDFORWARD
from tests.sweep.test_detachment import WHEEL, detachment

SPEED = 1.5  # of the disk without resistance, whose centre is at z = 1.5 t
ROLLING = f"""
format = 1
kind = "disk"
body = {{ mass = 1.0, radius = 1.0, inertia = 0.5, gravity = 1.0 }}
initial = {{ phidot = -{SPEED} }}
time = {{ start = 0.0, end = 2.0, saves = 5 }}
"""
THROWN = """
format = 1
kind = "ball"
body = { mass = 1.0, radius = 1.0, inertia = [0.4, 0.4, 0.4], gravity = 1.0 }
initial = { velocity = [0.3, 0.0, 2.0], height = 0.5 }
contact = { friction = 0.3 }
time = { start = 0.0, end = 4.0, saves = 5 }
"""
PARTICLE = """
format = 1
kind = "nonholonomic-particle"
initial = { xdot = 0.5 }
time = { start = 0.0, end = 4.0, saves = 5 }
"""
OWN = """
import equinox as eqx
import jaxball
from jaxball import Status

def turned(system, t, state):
    return state.phi + 2.0

def energetic(system, t, state, observables):
    return observables.kinetic_energy - 0.1

def of_two(system, t):
    return t

def several(system, t, state):
    return state.theta

def wrong(system, t, state):
    return state.nowhere

class Beyond(jaxball.simulation.AbstractEvent):
    place: float
    direction: int = eqx.field(static=True, default=1)
    terminal: bool = eqx.field(static=True, default=False)
    capacity: int = eqx.field(static=True, default=4)
    from_start = False
    status = Status.EVENT

    def value(self, system, t, state):
        return state.z - self.place

class Broken(Beyond):
    def value(self, system, t, state):
        return state.nowhere
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A module of the user in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own_events.py").write_text(OWN)
    yield
    sys.modules.pop("own_events", None)


def simulated(text, events):
    return read_scenario(text + events).simulate(rtol=1e-12, atol=1e-12, throw=True)


@pytest.mark.thorough
def test_a_rolling_disk_passes_each_level_when_it_gets_there_in_the_direction_of_the_number():
    events = [f'[events.{way}]\nof = "z"\nlevel = 0.75\ndirection = "{way}"\n' for way in ("rising", "falling", "both")]
    run = simulated(
        ROLLING,
        '[events.near]\nof = "z"\nlevel = 0.75\n[events.far]\nof = "z"\nlevel = 2.4\nterminal = true\n'
        + "".join(events),
    )
    assert run.status == Status.EVENT
    np.testing.assert_allclose(run.reached, 2.4 / SPEED, rtol=1e-12)
    for name in ("near", "rising", "both"):
        np.testing.assert_allclose(run.events[name].times[0], 0.75 / SPEED, rtol=1e-12)
    counts = {"near": 1, "far": 1, "rising": 1, "falling": 0, "both": 1}
    assert {name: int(seen.count) for name, seen in run.events.items()} == counts
    np.testing.assert_array_equal(np.isnan(run.state.z), run.times > 2.4 / SPEED)


@pytest.mark.long
def test_a_thrown_ball_passes_a_height_twice_and_slips_when_it_comes_down():
    """1/2 + t − t²/2 is 3/4 at 1 ∓ √½ and 0 at 1 + √2; the flight, from the start, counts as having left the plane."""
    text = THROWN.replace("[0.3, 0.0, 2.0]", "[3.0, 0.0, 1.0]")
    up, down = (
        f'[events.{name}]\nof = "height"\nlevel = 0.75\ndirection = "{name}"\n' for name in ("rising", "falling")
    )
    lift = '[events.lift]\nkind = "detachment"\nterminal = false\n'
    slide = '[events.slide]\nkind = "slip"\nfriction = 0.3\nterminal = false\n'
    aside = '[events.aside]\nof = "z[1]"\nlevel = 0.25\n'
    run = simulated(text, up + down + lift + slide + aside)
    np.testing.assert_allclose(run.events["rising"].times[0], 1 - math.sqrt(0.5), rtol=1e-10)
    np.testing.assert_allclose(run.events["falling"].times[0], 1 + math.sqrt(0.5), rtol=1e-10)
    assert run.events["rising"].count == run.events["falling"].count == 1
    np.testing.assert_allclose(run.events["slide"].times[0], 1 + math.sqrt(2), rtol=1e-10)
    assert run.events["lift"].times[0] == 0.0
    assert run.events["aside"].count == 0  # thrown along e1


@pytest.mark.thorough
def test_a_classical_system_has_events_of_its_coordinates():
    run = simulated(PARTICLE, '[events.post]\nof = "x"\nlevel = 1.0')
    np.testing.assert_allclose(run.events["post"].times[0], 2.0, rtol=1e-10)  # straight along x, where y is 0


@pytest.mark.long
def test_kinds_end_a_run_where_rolling_does():
    wheel = WHEEL.replace("phidot = 1.0", "phidot = 4.0")
    slide = '[events.slide]\nkind = "slip"\nfriction = 0.01\nterminal = false\n'
    run = read_scenario(wheel + slide + '[events.lift]\nkind = "detachment"').simulate()
    assert run.status == Status.DETACHED
    np.testing.assert_allclose(run.reached, detachment(4.0), rtol=1e-8)
    assert run.events["slide"].count > 0


@pytest.mark.thorough
def test_functions_and_classes_of_ones_own_are_named(own):
    run = simulated(
        ROLLING,
        '[events.turned]\nof = "own_events:turned"\n[events.slow]\nof = "own_events:energetic"\ndirection = "falling"\n'
        '[events.beyond]\nkind = "own_events:Beyond"\nplace = 2.4',
    )
    np.testing.assert_allclose(run.events["turned"].times[0], 2.0 / SPEED, rtol=1e-12)
    np.testing.assert_allclose(run.events["beyond"].times[0], 2.4 / SPEED, rtol=1e-12)
    assert run.events["slow"].count == 0  # its kinetic energy is constant
    np.testing.assert_allclose(run.events["slow"].least, 0.5 * 1.5 * SPEED**2 - 0.1, rtol=1e-10)
    assert run.scenario is not None
    again = tomllib.loads(write_scenario(run.scenario))["events"]
    assert again["turned"] == {"of": "own_events:turned"}
    assert again["beyond"] == {
        "kind": "own_events:Beyond",
        "place": 2.4,
        "capacity": 4,
        "direction": 1,
    }


def test_what_is_written_is_what_was_read():
    document = tomllib.loads(EVERY_EVENT)
    scenario = read_scenario(EVERY_EVENT)
    text = write_scenario(scenario)
    assert tomllib.loads(text)["events"] == document["events"]
    again = read_scenario(text)
    assert list(again.events) == list(document["events"])
    for name, event in scenario.events.items():
        leaves, tree = jax.tree.flatten(event)
        others, same = jax.tree.flatten(again.events[name])
        assert tree == same
        assert [float(leaf) for leaf in leaves] == [float(leaf) for leaf in others]
    assert "post: Event(of='z', direction=1, terminal=True, capacity=1, level=1.5)" in repr(scenario)


def test_defaults_are_left_out_and_none_is_no_table():
    text = write_scenario(
        read_scenario(ROLLING + '[events.origin]\nof = "z"\nlevel = 0\ncapacity = 64\ndirection = "both"')
    )
    assert tomllib.loads(text)["events"] == {"origin": {"of": "z"}}
    assert "events" not in tomllib.loads(write_scenario(read_scenario(ROLLING + "[events]")))


@pytest.mark.thorough
@pytest.mark.parametrize("suffix", [".nc", ".npz"])
def test_a_saved_run_has_the_events_of_its_scenario_and_their_times(tmp_path, suffix):
    events = '[events.near]\nof = "z"\nlevel = 0.75\n[events.never]\nof = "z"\nlevel = -1.0'
    path = read_scenario(ROLLING + events).simulate().save(tmp_path / f"run{suffix}")
    loaded = load_run(path).scenario
    assert loaded is not None
    assert list(loaded.events) == ["near", "never"]
    again = saved_scenario(path).simulate()
    np.testing.assert_allclose(again.events["near"].times[0], 0.75 / SPEED, rtol=1e-9)
    if suffix == ".npz":
        saved = dict(np.load(path))
        counts = {name: saved[f"event_{name}_count"] for name in ("near", "never")}
    else:
        import xarray

        saved = xarray.load_dataset(path)
        counts = {name: saved.attrs[f"event_{name}_count"] for name in ("near", "never")}
        assert saved["event_near_times"].attrs["units"] == "time"
    assert counts == {"near": 1, "never": 0}
    np.testing.assert_array_equal(saved["event_near_times"], again.events["near"].times[:1])
    assert "event_never_times" not in saved


@pytest.mark.thorough
def test_events_of_a_run_are_besides_those_of_its_scenario():
    scenario = read_scenario(ROLLING + '[events.near]\nof = "z"\nlevel = 0.75')
    run = scenario.simulate(events={"slide": Slip(0.1)})
    assert {*run.events} == {"near", "slide"}
    with refuses(ScenarioError, "events"):
        scenario.simulate(events={"near": Slip(0.1)})


def test_a_file_cannot_hold_a_function_without_a_name():
    scenario = read_scenario(ROLLING)
    events = {"bend": Event(lambda system, t, state: state.z)}
    whole = Scenario("", scenario.system, scenario.state, scenario.times, events=events)
    with refuses(ScenarioError, "events.bend.of"):
        write_scenario(whole)


POST = '[events.post]\nof = "z"\n'
ERRORS = {
    "a name of nothing": (ROLLING + '[events.post]\nof = "zz"', "events.post.of"),
    "a name near that of an observable": (ROLLING + '[events.post]\nof = "normal_forces"', "events.post.of"),
    "no single number": (
        ROLLING.replace("disk", "ball").replace("0.5", "[0.5, 0.5, 0.5]").replace("phidot = -1.5", "") + POST,
        "events.post.of",
    ),
    "a height without a law of contact": (ROLLING + '[events.post]\nof = "height"', "events.post.of"),
    "a number": (ROLLING + "[events.post]\nof = 1", "events.post.of"),
    "neither a name nor a kind": (ROLLING + "[events.post]\nlevel = 1.0", "events.post.of"),
    "no module": (ROLLING + '[events.post]\nof = "no_such_module:f"', "events.post.of"),
    "a function of other arguments": (ROLLING + '[events.post]\nof = "own_events:of_two"', "events.post.of"),
    "a function of several numbers": (ROLLING + '[events.post]\nof = "own_events:several"', "events.post.of"),
    "a function that raises": (ROLLING + '[events.post]\nof = "own_events:wrong"', "events.post.of"),
    "a class that raises": (ROLLING + '[events.post]\nkind = "own_events:Broken"\nplace = 1.0', "events.post.kind"),
    "a misspelt key": (ROLLING + POST + "levle = 1.0", "events.post.levle"),
    "a level of text": (ROLLING + POST + 'level = "high"', "events.post.level"),
    "a misspelt direction": (ROLLING + POST + 'direction = "risng"', "events.post.direction"),
    "a direction as in Python": (ROLLING + POST + "direction = -1", "events.post.direction"),
    "no capacity": (ROLLING + POST + "capacity = 0", "events.post.capacity"),
    "a misspelt kind": (ROLLING + '[events.post]\nkind = "slipp"', "events.post.kind"),
    "a slip without friction": (ROLLING + '[events.slide]\nkind = "slip"', "events.slide.friction"),
    "a kind of a number": (ROLLING + '[events.lift]\nkind = "detachment"\nof = "z"', "events.lift.of"),
    "a name with a dash": (ROLLING + '[events.the-post]\nof = "z"', "events"),
    "no tables": (ROLLING + "[[events]]", "events"),
    "a slip of what does not roll": (PARTICLE + '[events.slide]\nkind = "slip"\nfriction = 0.1', "events"),
    "events with feedback": (ROLLING + '[feedback]\nkind = "feedforward"\n' + POST, "events"),
}


@pytest.mark.parametrize("name", ERRORS)
def test_what_is_wrong_is_one_sentence_that_names_the_key(own, name):
    text, named = ERRORS[name]
    with refuses(ScenarioError, named):
        read_scenario(text)


def test_all_that_is_wrong_is_found_at_once():
    document = tomllib.loads(ROLLING + '[events.a]\nof = "zz"\n[events.b]\nof = "phy"\n[events.c]\nof = "z"')
    with all_problems() as problems:
        read_scenario(tomli_w.dumps(document))
    assert [str(problem).partition(" must")[0] for problem in problems] == ["Key `events.a.of`", "Key `events.b.of`"]


def test_python_refuses_events_with_feedback_too():
    held = dataclasses.replace(read_scenario(FEEDFORWARD), events={"post": Event("z")})
    with refuses(ScenarioError, "feedback"):
        held.simulate()


def test_what_needs_whole_runs_refuses_one_that_an_event_may_end():
    looking = read_scenario(ROLLING + POST)
    assert rolling_state(looking, "a design is") is looking.state
    with refuses(ScenarioError, "events.post.terminal"):
        rolling_state(read_scenario(ROLLING + POST + "terminal = true"), "a design is")
