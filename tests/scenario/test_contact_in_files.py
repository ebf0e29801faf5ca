"""The law of contact in a file, and a body that starts off the rolling, are what the same words make in Python."""

import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import BallState, Contact, DiskState, Scenario, ScenarioError, read_scenario, write_scenario
from jaxball.physics import LimitSurface, ReleasedState, SmoothedCoulomb
from jaxball.physics.contact.body_on_plane import BodyOnPlane
from tests.support.sentences import refuses
from tests.support.structure import Structure

from .documents import BALL, DISK
from .test_round_trip import same_objects

SHELL, TIMES = BALL[: BALL.index("[[masses]]")], BALL[BALL.index("[time]") :]
LAW = "contact = { friction = 0.2 }"
WHOLE_LAW = "contact = { friction = 0.2, static_friction = 0.3, restitution = 0.5, slowest = 1e-5, capacity = 8 }"
SOLID_BALL = jaxball.Ball(mass=1.0, radius=1.0, inertia=(0.9, 1.0, 1.1), gravity=1.0)


def with_contact(*lines, text=SHELL + TIMES):
    """A document with other lines at its top level."""
    return "\n".join([*lines, text])


STARTS = {
    "rolling": ([LAW, "initial = { z = [1.0, 2.0] }"], Contact(0.2), BallState(z=(1.0, 2.0))),
    "sliding": (
        [WHOLE_LAW, "initial = { Omega = [0.0, 1.0, 0.0], velocity = [0.5, 0.0, 0.0] }"],
        Contact(0.2, 0.3, 0.5, 1e-5, capacity=8),
        ReleasedState(BallState(Omega=(0.0, 1.0, 0.0)), V=(0.5, 0.0, 0.0)),
    ),
    "dropped": ([LAW, "initial = { height = 0.5 }"], Contact(0.2), ReleasedState(BallState(), height=0.5)),
    "slipping always": (
        ['contact = { friction = { kind = "smoothed-coulomb", kinetic = 0.2, smoothing = 0.01 } }'],
        Contact(SmoothedCoulomb(0.2, 0.01)),
        BallState(),
    ),
    "spinning": (
        ['contact = { friction = { kind = "limit-surface", friction = 0.2, radius = 0.1 }, static_friction = 0.3 }'],
        Contact(LimitSurface(0.2, 0.1), 0.3),
        BallState(),
    ),
    "thrown": (
        [LAW, "initial = { velocity = [1.0, 0.5, 2.0], height = 0.0 }"],
        Contact(0.2),
        ReleasedState(BallState(), V=(1.0, 0.5, 2.0)),
    ),
}


@pytest.mark.parametrize(("lines", "law", "state"), STARTS.values(), ids=STARTS.keys())
def test_a_start_is_read_and_written(lines, law, state):
    """Bit for bit; and one that does not slip and touches the plane stays one that is released."""
    scenario = read_scenario(with_contact(*lines))
    assert same_objects(scenario, Scenario("", SOLID_BALL, state, np.linspace(0.0, 2.0, 5), contact=law))
    assert same_objects(scenario, read_scenario(write_scenario(scenario)))


def test_a_scenario_says_which_system_is_solved():
    rolling, sliding = read_scenario(with_contact()), read_scenario(with_contact(LAW))
    assert rolling.system_to_solve is rolling.system
    assert isinstance(sliding.system_to_solve, BodyOnPlane)
    assert (rolling.may_slip, sliding.may_slip) == (False, True)
    assert (rolling.friction_or(0.7), sliding.friction_or(0.7)) == (0.7, 0.2)


def test_a_disk_moves_in_its_plane():
    text = with_contact(LAW, "initial = { phidot = -1.0, velocity = [0.5, 0.0, 0.2] }", text=DISK)
    state = read_scenario(text).state
    expected = ReleasedState(DiskState(phidot=-1.0), V=(0.5, 0.0, 0.2))
    assert jax.tree.all(jax.tree.map(np.array_equal, state, expected))
    assert same_objects(read_scenario(text), read_scenario(write_scenario(read_scenario(text))))


SENTENCES = {
    "a velocity without a law": (["initial = { velocity = [1.0, 0.0, 0.0] }"], "initial.velocity"),
    "a height without a law": (["initial = { height = 1.0 }"], "initial.height"),
    "negative friction": (["contact = { friction = -0.1 }"], "contact.friction"),
    "negative friction of a law": (
        ['contact = { friction = { kind = "smoothed-coulomb", kinetic = -0.2, smoothing = 0.01 } }'],
        "contact.friction.kinetic",
    ),
    "a law that is not smoothed": (
        ['contact = { friction = { kind = "smoothed-coulomb", kinetic = 0.2, smoothing = 0.0 } }'],
        "contact.friction.smoothing",
    ),
    "a law that there is not": (
        ['contact = { friction = { kind = "smooth-coulomb", kinetic = 0.2, smoothing = 0.1 } }'],
        "contact.friction.kind",
    ),
    "static below sliding": (["contact = { friction = 0.3, static_friction = 0.2 }"], "contact.static_friction"),
    "impacts that create energy": (["contact = { friction = 0.3, restitution = 1.1 }"], "contact.restitution"),
    "bounces that never end": (["contact = { friction = 0.3, slowest = 0.0 }"], "contact.slowest"),
    "no capacity": (["contact = { friction = 0.3, capacity = 0 }"], "contact.capacity"),
    "no friction": (["contact = { restitution = 0.5 }"], "contact.friction"),
    "a start below the plane": ([LAW, "initial = { height = -0.5 }"], "initial.height"),
    "differential-algebraic": ([LAW, 'solve = { dae = true, solver = "radau5" }'], "solve.dae"),
}


@pytest.mark.parametrize(("lines", "named"), SENTENCES.values(), ids=SENTENCES.keys())
def test_what_cannot_be_is_told(lines, named):
    with refuses(ScenarioError, named):
        read_scenario(with_contact(*lines))


def test_a_disk_does_not_leave_its_plane():
    with refuses(ScenarioError, "initial.velocity"):
        read_scenario(with_contact(LAW, "initial = { velocity = [0.0, 0.1, 0.0] }", text=DISK))


def test_a_classical_system_has_no_contact():
    with refuses(ScenarioError, "contact"):
        read_scenario(f'format = 1\nkind = "nonholonomic-particle"\n{LAW}\n{TIMES}')


def test_joints_that_stick_and_exact_resistance_have_a_law_of_contact_beside_them():
    text = """
        [[mechanisms]]
        masses = [{ mass = 0.2, place = [0.0, 0.0, -0.5], joint = 0 }]
        [[mechanisms.joints]]
        kind = "hinge"
        axis = [0.0, 1.0, 0.0]
        force = { kind = "joint-friction", kinetic = 0.2 }
    """
    exact = "[resistance]\ndry = 0.01\nexact = true\n"
    scenario = read_scenario(with_contact(LAW) + exact + text)
    assert scenario.system.sticking == ("mechanisms[0].joints[0]",)
    assert scenario.system.is_held


def test_traced_numbers_make_the_law_and_the_start():
    """The static coefficient that is left out follows that of sliding, and their rules become conditions."""
    document = tomllib.loads(with_contact(LAW, "initial = { velocity = [1.0, 0.0, 0.0], height = 0.5 }"))
    structure = Structure(document, ("contact.friction", "initial.velocity[0]", "initial.height"))
    parts = structure.build(jnp.array([0.3, 2.0, 0.1]))
    assert [float(x) for x in (parts.contact.friction, parts.contact.static_friction)] == [0.3, 0.3]
    assert [*parts.state.V.tolist(), float(parts.state.height)] == [2.0, 0.0, 0.0, 0.1]
    hold = jax.jit(structure.conditions)(jnp.array([-0.1, 2.0, -0.1]))
    assert {path for path, holds in hold.items() if not holds} == {"contact.friction", "initial.height"}
