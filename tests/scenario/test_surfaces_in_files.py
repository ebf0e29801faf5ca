"""Surfaces in scenario files: read, written and read again, and refused by the names of keys."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from jaxball import (
    Accelerated,
    Ball,
    BallState,
    ConstantRate,
    Disk,
    HeightField,
    LinearLaw,
    Scenario,
    ScenarioError,
    Servo,
    Sinusoids,
    load_run,
    read_scenario,
    write_scenario,
)
from jaxball.physics import AbstractSurface, MovingFrame, TiltingPlane
from tests.support.sentences import refuses
from tests.support.surface_files import ON_SURFACE, ON_SURFACES

from .test_round_trip import same_objects


def valley(t, x, y, depth):
    return depth * x**2


@pytest.mark.parametrize("name", ON_SURFACES)
def test_round_trip(name):
    """A file is the fixed point of reading and writing, and its numbers are those of the ground."""
    scenario = read_scenario(ON_SURFACES[name])
    text = write_scenario(scenario)
    assert write_scenario(read_scenario(text)) == text
    assert same_objects(scenario, read_scenario(text))


TILTED = (Sinusoids(0.0, amplitude=[0.1], frequency=[2.0]), ConstantRate(0.1))
GAINS = {"theta": -24.0 * np.eye(2), "thetadot": -8.0 * np.eye(2)}
LAWS = {
    "on a plate that a law tilts": LinearLaw(**GAINS, z=[[0, 2.0], [-2.0, 0]], omega=-0.5 * np.eye(2, 3)),
    "on a plate that follows": Servo(TILTED, [20.0, 10.0], [6.0, 3.0]),
}


@pytest.mark.parametrize("name", LAWS)
def test_a_law_that_tilts_a_plate(name):
    """Its angles are in the state, where their schedules are at the start, or 0."""
    scenario = read_scenario(ON_SURFACES[name])
    assert eqx.tree_equal(scenario.system.ground, TiltingPlane(Accelerated(), Accelerated()))
    assert eqx.tree_equal(scenario.system.law, LAWS[name])
    follows = isinstance(scenario.system.law, Servo)
    np.testing.assert_array_equal(scenario.state.theta, [0.0, 0.1] if follows else [0.0, 0.0])
    np.testing.assert_array_equal(scenario.state.thetadot, [0.2, 0.0] if follows else [0.0, 0.0])


def test_a_plate_of_which_a_law_tilts_one_angle():
    text = ON_SURFACES["on a plate that follows"].replace('"about_e1", ', "")
    scenario = read_scenario(text.replace("[20.0, 10.0]", "[20.0]").replace("[6.0, 3.0]", "[6.0]"))
    assert scenario.system.coordinates == ("ground.about_e2",)
    assert eqx.tree_equal(scenario.system.ground.about_e1, TILTED[0])
    assert same_objects(scenario, read_scenario(write_scenario(scenario)))


@pytest.mark.thorough
def test_a_run_keeps_the_angles_of_a_plate(tmp_path):
    run = read_scenario(ON_SURFACES["on a plate that a law tilts"]).simulate()
    again = load_run(run.save(tmp_path / "run.nc"))
    assert again.system.coordinates == ("ground.about_e1", "ground.about_e2")
    np.testing.assert_array_equal(again.state.theta, run.state.theta)
    assert np.max(np.abs(again.state.theta)) > 1e-2
    np.testing.assert_allclose(again.observables.contact_force, run.observables.contact_force, rtol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('["about_e1", "about_e2"]', '["about_e2", "about_e1"]', "ground.accelerated"),
        ('["about_e1", "about_e2"]', "true", "ground.accelerated"),
        ('form = "servo"\nstiffness = [20.0, 10.0]\ndamping = [6.0, 3.0]', 'form = "prescribed"', "actuation.form"),
        ('about_e2 = { kind = "constant-rate", theta = 0.1 }', "", "ground.about_e2"),
        ("[6.0, 3.0]", "[6.0]", "actuation.damping"),
        (
            '"servo"\nstiffness = [20.0, 10.0]\ndamping = [6.0, 3.0]',
            '"linear"\nz = [[1.0, 0.0], [0.0, 1.0]]',
            "ground.about_e1",
        ),
        ("initial = {", "initial = { theta = [0.1],", "initial.theta"),
    ],
)
def test_wrong_plates(old, new, named):
    text = ON_SURFACES["on a plate that follows"]
    assert old in text
    with refuses(ScenarioError, named):
        read_scenario(text.replace(old, new))


def test_function_in_a_file():
    ground = f'kind = "height-field"\nfunction = "{__name__}:valley"\nparameters = 0.2\n'
    scenario = read_scenario(ON_SURFACE + ground)
    assert isinstance(scenario.system.ground, HeightField)
    height = scenario.system.ground.place(*map(jnp.asarray, (0.0, 2.0, 0.0)))[2]
    assert float(height) == pytest.approx(0.8)
    assert f'function = "{__name__}:valley"' in write_scenario(scenario)


@pytest.mark.parametrize(
    ("ground", "named"),
    [
        ('kind = "bowl"', "ground.radius"),
        ('kind = "bowl"\nradius = -1.0', "ground.radius"),
        ('kind = "bowel"\nradius = 1.0', "ground.kind"),
        (
            'kind = "signed-distance"\nfunction = "tests.support.signed_distances:inside_sphere"\nparameters = 1.0\n'
            "centre = [0.0, 0.0, 1.0]",
            "ground.guess",
        ),
        (
            'kind = "signed-distance"\nfunction = "tests.support.signed_distances:outside_sphere"\nparameters = 0.1',
            "ground.function",
        ),
        ('kind = "bowl"\nradius = 1.0\nangle = 0.1', "ground.angle"),
        ('kind = "cylinder"\nradius = 1.0\naxis = [0.0, 0.0, 1.0]', "ground.start"),
        (
            'kind = "bowl"\nradius = 1.0\n[[ground.motion.turns]]\naxis = [0.0, 0.0, 0.0]\n'
            'angle = { kind = "constant-rate", theta = 0.0 }',
            "ground.motion.turns[0].axis",
        ),
    ],
)
def test_wrong_keys(ground, named):
    with refuses(ScenarioError, named):
        read_scenario(ON_SURFACE + ground)


def test_ball_that_does_not_fit_its_ground():
    """Reading a file says so, before anything is solved."""
    with refuses(ScenarioError, "ground"):
        read_scenario(ON_SURFACE + 'kind = "bowl"\nradius = 0.05\n')


def test_disk_on_a_surface():
    """It is read, written and solved; a ground that is off the plane of a disk is refused where it is."""
    text = ON_SURFACES["on a sphere"].replace('"ball"', '"disk"').replace("[0.004, 0.004, 0.004]", "0.004")
    text = text.replace("z = [0.2, 0.1]", "z = 0.2")
    scenario = read_scenario(text)
    assert isinstance(scenario.system, Disk)
    again = read_scenario(write_scenario(scenario))
    assert write_scenario(again) == write_scenario(scenario)
    run = again.simulate(throw=True)
    assert np.all(run.observables.contact_point[:, 1] == 0)
    with refuses(ScenarioError, "ground.motion"):
        read_scenario(text.replace("[[0.2, 0.0, 0.0]]", "[[0.2, 0.1, 0.0]]"))
    with refuses(ScenarioError, "ground"):
        read_scenario(
            text[: text.index("[ground]")] + '[ground]\nkind = "washboard"\namplitude = 0.1\n'
            "wavelength = 4.0\nheading = 0.2\n"
        )


class Slide(AbstractSurface):
    slope: Float[Array, ""]
    motion: MovingFrame | None = None

    def point(self, t, u1, u2):
        return jnp.stack([u1, u2, -self.slope * u1])


def test_class_in_a_file():
    scenario = read_scenario(ON_SURFACE + f'kind = "{__name__}:Slide"\nslope = 0.1\n')
    assert isinstance(scenario.system.ground, Slide)
    text = write_scenario(scenario)
    assert f'kind = "{__name__}:Slide"' in text
    assert write_scenario(read_scenario(text)) == text


def test_function_that_cannot_be_imported():
    ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=HeightField(lambda t, x, y, _: 0.1 * x**2))
    with refuses(ScenarioError, "ground.function"):
        write_scenario(Scenario("a title", ball, BallState(), np.array([0.0, 1.0])))
