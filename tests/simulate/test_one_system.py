"""A system whose numbers have axes of many is refused: their entries would count as the components of vectors."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, Bowl, Circle, Disk, DiskState, OnRail, PointMass, Pulse, Resistance, Slip, simulate
from tests.support.sentences import refuses

pytestmark = pytest.mark.usefixtures("no_type_checks")

TIMES = np.linspace(0.0, 1.0, 3)
MASS = PointMass(0.5, OnRail(Circle(0.5), Pulse(0.0)))
ARM = jaxball.planar_pendulum(0.4, 0.2, drive=jaxball.Damper(0.1))
BALL = Ball(
    mass=1.0,
    inertia=(0.4, 0.4, 0.4),
    masses=[MASS],
    mechanisms=[ARM],
    ground=Bowl(5.0),
    resistance=Resistance(rolling=0.1),
)
DISK = Disk(mass=1.0, inertia=0.5)
THREE = np.array([1.0, 2.0, 3.0])


def put(where, shape, system=BALL):
    return eqx.tree_at(where, system, jnp.ones(shape))


@pytest.mark.parametrize(
    ("system", "named"),
    [
        (put(lambda ball: ball.mass, 3), r"`mass` of shape \(\), but its shape is \(3,\)"),
        (put(lambda ball: ball.gravity, 1), r"`gravity` of shape \(\), but its shape is \(1,\)"),
        (put(lambda ball: ball.inertia, 1), r"`inertia` of shape \(3,\), but its shape is \(1,\)"),
        (put(lambda ball: ball.offset, (2, 3)), r"`offset` of shape \(3,\), but its shape is \(2, 3\)"),
        (put(lambda disk: disk.inertia, 3, DISK), r"`inertia` of shape \(\), but its shape is \(3,\)"),
        (put(lambda ball: ball.groups[0].mass, (1, 3)), r"`masses\[0\].mass` of shape \(\)"),
        (put(lambda ball: ball.groups[0].motion.rail.radius, (1, 3)), r"`masses\[0\].motion.rail.radius` of"),
        (put(lambda ball: ball.ground.radius, 3), r"`ground.radius` of shape \(\)"),
        (put(lambda ball: ball.resistance.rolling, 3), r"`resistance.rolling` of shape \(\)"),
        (
            put(lambda ball: ball.mechanism_groups[0].joints[0].drive.coefficient, (1, 3)),
            r"`mechanisms\[0\].joints\[0\]",
        ),
    ],
)
def test_an_array_in_place_of_a_number_is_refused_by_its_path(system, named):
    """Of three entries it would have been one for each component of a vector, and the run a wrong one."""
    with refuses(ValueError, "system"):
        simulate(system, TIMES)


def test_systems_made_by_vmap_are_refused_without_it_and_taken_with_it():
    disks = jax.vmap(lambda mass: Disk(mass=mass, inertia=0.5))(jnp.asarray(THREE))
    start = DiskState(phidot=-1.0)
    with refuses(ValueError, "mass"):
        simulate(disks, TIMES, start)
    z = jax.vmap(lambda disk: simulate(disk, TIMES, start).state.z)(disks)
    np.testing.assert_allclose(z, np.tile(TIMES, (3, 1)), atol=1e-9)  # it rolls at the speed 1, whatever its mass


def test_masses_made_by_vmap_are_not_one_mass():
    masses = jax.vmap(lambda mass: PointMass(mass, MASS.motion))(jnp.asarray(THREE))
    with refuses(ValueError, "masses[0].mass"):
        simulate(Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), masses=[masses]), TIMES)


def test_events_made_by_vmap_are_refused():
    slips = jax.vmap(Slip)(jnp.array([0.1, 0.2]))
    with refuses(ValueError, "events"):
        simulate(DISK, TIMES, events={"low": slips})


def test_every_scenario_that_comes_with_jaxball_has_the_shapes_of_its_arguments():
    from jaxball.files.scenario import builtin_scenarios
    from jaxball.simulation.arguments import require_single_numbers

    for name in builtin_scenarios():
        require_single_numbers(jaxball.load_scenario(name).system, {})
