"""Classes of users that files name as "module:Class": each example of the page on extending jaxball, in a file.

What the classes do is compared with closed forms and with potentials.
"""

import dataclasses
import re
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import BallState, ScenarioError, read_scenario, write_scenario
from jaxball.physics import ReleasedState
from jaxball.physics.contact.released import energy_of_released
from jaxball.studies.design import read_problem
from jaxball.studies.sweep import read_study
from tests.support.documents import modules_of
from tests.support.sentences import refuses

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "extending.md"
MODULES = modules_of(PAGE)
FINE = {"rtol": 1e-12, "atol": 1e-12}
BALL = """
format = 1
kind = "ball"
body = { mass = 1.3, radius = 0.9, inertia = [0.6, 0.6, 0.6], gravity = 2.0 }
time = { start = 0.0, end = 3.0, saves = 7 }
solve = { rtol = 1e-12, atol = 1e-12 }
"""
PARTS = {
    "racetrack": ("Racetrack", '[[masses]]\nmass = 0.1\nrail = { kind = "racetrack:Racetrack", radius = 0.5 }\n'
        'schedule = { kind = "constant-rate", theta = 0.0, rate = 1.0 }'),
    "chirp": ("Chirp", '[[masses]]\nmass = 0.1\nrail = { kind = "circle", radius = 0.5 }\n'
        'schedule = { kind = "chirp:Chirp", start = -1.5, rate = 0.1 }'),
    "hardening": ("Hardening", '[[mechanisms]]\nmasses = [{ mass = 0.2, place = [0.0, 0.0, -0.5], joint = 0 }]\n'
        '[[mechanisms.joints]]\nkind = "hinge"\naxis = [0.0, 1.0, 0.0]\n'
        'force = { kind = "hardening:Hardening", stiffness = 2.0 }'),
    "cable": ("Cable", '[force]\nkind = "cable:Cable"\nstiffness = 1.4\nlength = 0.2\nanchor = [1.0, 0.0, 0.0]\n'
        "point = [0.0, 0.1, 0.2]"),
    "grass": ("Grass", 'initial = { Omega = [0.0, 1.0, 0.0] }\n[resistance]\nkind = "grass:Grass"\nrolling = 0.14'),
    "mud": ("Mud", 'initial = { Omega = [0.0, 1.0, 0.0] }\n[resistance]\nkind = "mud:Mud"\nlevel = 0.2\nslope = 0.4'),
    "stribeck": ("Stribeck", 'initial = { velocity = [1.0, 0.0, 0.0] }\n[contact]\n'
        'friction = { kind = "stribeck:Stribeck", kinetic = 0.1, static = 0.2, scale = 0.3 }'),
    "scales": ("Scales", '[sensors.scales]\nkind = "scales:Scales"'),
    "shaken": ("ShakenPendulum", None),
    "bouncing": ("Bouncing", None),
    "heun": ("Heun3", None),
}  # fmt: skip


@pytest.fixture(autouse=True)
def modules(tmp_path, monkeypatch):
    """The files of the page in the current folder, in which modules of files are found."""
    monkeypatch.chdir(tmp_path)
    for name, text in MODULES.items():
        monkeypatch.delitem(sys.modules, name, raising=False)
        (tmp_path / f"{name}.py").write_text(text)
    yield
    for name in MODULES:
        sys.modules.pop(name, None)


def text_of(name):
    if name == "shaken":
        return 'format = 1\nkind = "shaken:ShakenPendulum"\nbody = { length = 2.0 }\ninitial = { theta = 0.2 }\n' + (
            "time = { start = 0.0, end = 3.0, saves = 7 }"
        )
    if name == "bouncing":
        return 'format = 1\nkind = "bouncing:Bouncing"\nbody = { gravity = 2.0, restitution = 0.8 }\n' + (
            "time = { start = 0.0, end = 4.0, saves = 41 }"
        )
    if name == "heun":
        return BALL.replace("{ rtol = 1e-12, atol = 1e-12 }", '{ solver = "heun:Heun3", rtol = 1e-6, atol = 1e-6 }')
    return BALL + PARTS[name][1]


def test_the_page_has_a_file_for_each_contract_of_twenty_to_forty_lines():
    assert {*PARTS, "width", "level", "slow"} == set(MODULES)
    assert all(text.count("\n") <= 40 for text in MODULES.values())


@pytest.mark.parametrize("name", PARTS)
def test_a_file_with_the_class_is_read_and_written_as_it_was(name):
    """Reading what is written gives the same text, in which the class has its name."""
    scenario = read_scenario(text_of(name))
    written = write_scenario(scenario)
    assert f'"{name}:{PARTS[name][0]}"' in written
    assert write_scenario(read_scenario(written)) == written


@pytest.mark.thorough
def test_a_resistance_of_a_file_slows_a_ball():
    """(d + m r²) ω̇ = −c ω², so that ω = 1 / (1 + c t / (d + m r²))."""
    scenario = read_scenario(text_of("grass"))
    expected = 1 / (1 + 0.14 * scenario.times / (0.6 + 1.3 * 0.9**2))
    np.testing.assert_allclose(scenario.simulate().state.Omega[:, 1], expected, rtol=0, atol=1e-11)


@pytest.mark.thorough
def test_a_resistance_of_a_file_holds_a_ball():
    """(d + m r²) ω̇ = −m g r (0.2 + 0.4 ω), from ω = 1."""
    run = read_scenario(text_of("mud")).simulate(throw=True)
    k = 1.3 * 2.0 * 0.9 / (0.6 + 1.3 * 0.9**2)
    np.testing.assert_allclose(run.switches.times[0], np.log(3.0) / (0.4 * k), rtol=1e-9)


@pytest.mark.thorough
def test_a_system_and_a_solver_of_a_file():
    """The pendulum by Heun's method against Dormand and Prince's; 1e-5 is a hundred times the tolerance."""
    scenario = read_scenario(text_of("shaken"))
    by_heun = scenario.simulate(solver="heun:Heun3", rtol=1e-7, atol=1e-7, throw=True)
    np.testing.assert_allclose(by_heun.state.theta, scenario.simulate().state.theta, rtol=0, atol=1e-5)


@pytest.mark.thorough
def test_a_reduction_of_a_study_and_numbers_of_own_classes_swept():
    """On a spring of no length, z = 1 − cos ω t with ω² = k / (m + d/r²): its width is that up to the end, or 2."""
    scenario = BALL + '[force]\nkind = "cable:Cable"\nstiffness = 1.0\nlength = 0.0\nanchor = [1.0, 0.0, 0.0]'
    Path("scenario.toml").write_text(scenario)
    study = read_study(
        'format = 1\nscenario = "scenario.toml"\nfind = [{ name = "width", reduction = "width:Width" }]\n'
        '[[axes]]\npath = "force.stiffness"\nvalues = [1.0, 4.0]'
    )
    (find,) = study.finds
    systems = [study.scenario(row).system for row in range(2)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *systems)
    many = jaxball.simulation.ensemble.simulate_ensemble(
        stacked, (0.0, 3.0), BallState(), reductions={"width": find.reduction()}, in_axes=(0, None), **FINE
    )
    omega = np.sqrt(np.array([1.0, 4.0]) / (1.3 + 0.6 / 0.9**2))
    expected = np.where(omega * 3.0 < np.pi, 1 - np.cos(omega * 3.0), 2.0)
    np.testing.assert_allclose(many.reductions["width"], expected, rtol=0, atol=1e-10)


def test_an_objective_and_a_constraint_of_a_problem_file():
    """Those of the files, with their keys as fields."""
    found = read_problem(
        'format = 1\nscenario = "disk"\nvariables = [{ path = "body.mass", lower = 0.5, upper = 2.0 }]\n'
        'objectives = [{ kind = "go-far" }, { kind = "level:Level", height = -0.2, weight = 10.0 }]\n'
        'constraints = [{ kind = "slow:Slow", most = 1.5 }]'
    )
    level, slow = found.problem.objectives["Level"], found.problem.constraints["Slow"]
    assert (type(level).__module__, type(slow).__module__) == ("level", "slow")
    assert (float(level.height), float(level.weight), float(slow.most)) == (-0.2, 10.0, 1.5)


@pytest.mark.long
def test_a_cable_exchanges_energy_with_the_body_as_its_potential_and_friction_of_a_saved_run_is_read_back(tmp_path):
    """E + ½ k max(|d| − L, 0)² + what friction takes is constant, while the body flies, bounces, slides and rolls."""
    k, L, anchor, point = 2.0, 0.3, np.array([0.5, 0.4, 1.5]), np.array([0.1, 0.2, 0.3])
    text = BALL.replace("saves = 7", "saves = 13").replace(
        "[0.6, 0.6, 0.6]", "[0.5, 0.6, 0.7], offset = [0.1, 0.0, -0.2]"
    )
    text += f"""
initial = {{ Omega = [0.3, -1.0, 0.2], velocity = [1.4, 0.5, 0.0], height = 0.1 }}
[force]
kind = "cable:Cable"
stiffness = {k}
length = {L}
anchor = {anchor.tolist()}
point = {point.tolist()}
[contact]
restitution = 0.4
friction = {{ kind = "stribeck:Stribeck", kinetic = 0.2, static = 0.3, scale = 0.3 }}
"""
    scenario = read_scenario(text)
    ball, times = scenario.system, scenario.times
    run = scenario.simulate(throw=True)
    released = ReleasedState(run.state, run.contact.V, run.contact.height)
    energy = jax.vmap(lambda t, state: energy_of_released(ball, t, state))(jnp.asarray(times), released)
    centre = np.column_stack([run.state.z, run.contact.height])
    distance = np.linalg.norm(anchor - centre - np.asarray(run.state.Lambda) @ point, axis=1)
    stretched = np.maximum(distance - L, 0.0)
    total = np.asarray(energy) + 0.5 * k * stretched**2 + run.contact.friction_loss + run.contact.impact_loss
    assert int(run.contact.switches.count) >= 2
    assert np.ptp(0.5 * k * stretched**2) > 0.1
    np.testing.assert_allclose(total, total[0], rtol=0, atol=1e-9)
    again = jaxball.load_run(run.save(tmp_path / "run.npz"))
    assert repr(again.contact.law) == repr(run.contact.law)
    assert "Stribeck" in repr(run.contact.law)


WRONG = {
    "a misspelt key": ("racetrack", "radius = 0.5", "radios = 0.5", "masses[0].rail.radios"),
    "a missing key": ("racetrack", ", radius = 0.5", "", "masses[0].rail.radius"),
    "another shape": ("cable", "[1.0, 0.0, 0.0]", "[1.0, 0.0]", "force.anchor"),
    "another contract": ("racetrack", "racetrack:Racetrack", "chirp:Chirp", "masses[0].rail.kind"),
    "no class": ("grass", "grass:Grass", "grass:jnp", "resistance.kind"),
    "no module": ("scales", "scales:Scales", "scale:Scales", "sensors.scales.kind"),
    "a contract": ("racetrack", "racetrack:Racetrack", "jaxball:AbstractRail", "masses[0].rail.kind"),
    "no solver": ("heun", "heun:Heun3", "chirp:Chirp", "solve.solver"),
    "an impossible number": ("shaken", "length = 2.0", "length = -2.0", "body.length"),
    "another state": ("shaken", "theta = 0.2", "phi = 0.2", "initial.phi"),
}  # fmt: skip


@pytest.mark.parametrize(("name", "old", "new", "named"), WRONG.values(), ids=WRONG.keys())
def test_what_is_wrong_is_said_with_the_path_of_the_key(name, old, new, named):
    text = text_of(name)
    assert old in text
    with refuses(ScenarioError, named):
        read_scenario(text.replace(old, new))


def test_what_a_class_raises_is_said_with_the_path_of_the_key():
    Path("square.py").write_text(re.sub(r"return self.radius.*", "raise ValueError('no side')", MODULES["racetrack"]))
    text = text_of("racetrack").replace("racetrack:Racetrack", "square:Racetrack")
    with refuses(ScenarioError, "masses[0].rail.kind"):
        read_scenario(text)


def test_only_modules_that_are_allowed_are_imported(monkeypatch):
    monkeypatch.setenv("JAXBALL_FILES_IMPORT", "chirp, grass")
    read_scenario(text_of("grass"))
    with refuses(ScenarioError, "force.kind"):
        read_scenario(text_of("cable"))
    monkeypatch.setenv("JAXBALL_FILES_IMPORT", "")
    with refuses(ScenarioError, "resistance.kind"):
        read_scenario(text_of("grass"))
    assert "cable" not in sys.modules


def test_a_class_of_a_script_is_not_written():
    scenario = read_scenario(text_of("scales"))

    class Local(type(scenario.sensors["scales"])):
        pass

    with refuses(ScenarioError, "sensors.scales.kind"):
        write_scenario(dataclasses.replace(scenario, sensors={"scales": Local()}))


WITH_PARTS = """
import jax.numpy as jnp
from jaxball import AbstractRail, AbstractSchedule
from jaxball.physics import AbstractFrame, AbstractJointForce, AbstractSignal

class Turned(AbstractRail):
    frame: AbstractFrame

    def __call__(self, theta):
        return 0.5 * self.frame.matrix() @ jnp.stack([jnp.cos(theta), jnp.zeros_like(theta), jnp.sin(theta)])

    @property
    def period(self):
        return 2 * jnp.pi

class Pulled(AbstractJointForce):
    towards: AbstractSchedule
    by: AbstractSignal | AbstractSchedule

    def __call__(self, t, theta, thetadot, state):
        return self.by(t) * (self.towards(t) - theta)
"""


def test_classes_of_users_have_parts_as_those_of_jaxball(tmp_path):
    """A frame of a rail, and a schedule and a signal of a force on a joint, in tables of their own."""
    (tmp_path / "parts.py").write_text(WITH_PARTS)
    text = (
        f"{BALL}[[masses]]\nmass = 0.1\n"
        'rail = { kind = "parts:Turned", frame = { azimuth = 0.5, elevation = 0.0 } }\n'
        'schedule = { kind = "constant-rate", theta = 0.0 }\n[[mechanisms]]\n'
        'masses = [{ mass = 0.2, place = [0.0, 0.0, -0.5] }]\n[[mechanisms.joints]]\nkind = "hinge"\n'
        'axis = [0.0, 1.0, 0.0]\nforce = { kind = "parts:Pulled", towards = { kind = "constant-rate", theta = 0.3 }, '
        "by = 2.0 }"
    )
    scenario = read_scenario(text)
    place = scenario.system.point_masses[0].motion.rail(jnp.array(0.0))
    np.testing.assert_allclose(place, [0.5 * np.cos(0.5), 0.5 * np.sin(0.5), 0.0], rtol=0, atol=1e-15)
    force = scenario.system.mechanisms[0].joints[0].drive
    assert float(force(jnp.array(0.0), jnp.array(0.1), jnp.array(0.0), None)) == pytest.approx(2.0 * (0.3 - 0.1))
    written = write_scenario(scenario)
    assert write_scenario(read_scenario(written)) == written
    sys.modules.pop("parts")
