"""A plane that is tilted as a surface is the tilted plane: the same switches, places, velocities, losses and forces.

A run with a ``Ground`` is put into space by its angle a about e2; x on the plane is x cos a of a parametric surface.
"""

import functools
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import (
    Ball,
    BallState,
    ConstantRate,
    Contact,
    Disk,
    DiskState,
    Fixed,
    Ground,
    PointMass,
    Resistance,
    simulate,
)
from jaxball.physics import LimitSurface, Mode, ParametricSurface, ReleasedState, TiltingPlane

FINE = {"rtol": 1e-12, "atol": 1e-12}
CLOSE = 1e-9  # a thousand tolerances: errors grow over some ten switches
FORCES = 1e-8  # observables of those states, with sizes of about 10
UNEVEN = {"mass": 1.2, "radius": 0.4, "gravity": 9.81}
SOLID = {"mass": 2.0, "radius": 0.3, "gravity": 9.81}
ALL_BUT_REST = {*Mode} - {Mode.REST}


def mass(*place):
    return [PointMass(0.3, Fixed(place))]


def uneven_ball(ground):
    moments = {"inertia": (0.05, 0.06, 0.07), "offset": (0.04, -0.02, 0.03)}
    return Ball(**UNEVEN, **moments, masses=mass(0.1, 0.1, 0.0), ground=ground)


def uneven_disk(ground):
    return Disk(**UNEVEN, inertia=0.06, offset=(0.04, 0.0, 0.03), masses=mass(0.1, 0.0, 0.05), ground=ground)


def stopped_ball(ground):
    resistance = Resistance(dry=0.2, dry_spinning=0.01, exact=True)
    return Ball(**SOLID, inertia=(0.072,) * 3, resistance=resistance, ground=ground)


class Case(NamedTuple):
    """A body, how it is thrown, the law and angle of its plane, when it is looked at, and the modes that it meets."""

    body: Any
    state: Any
    V: tuple[float, float, float]
    law: Contact
    angle: float
    times: np.ndarray
    modes: set[Mode]


BOUNCES, RESTS = Contact(0.15, 0.2, 0.5, slowest=0.05), Contact(0.25, restitution=0.3, slowest=0.1)
SHORT, LONG = np.linspace(0.0, 2.0, 13), np.linspace(0.0, 6.0, 25)
SPUN, ROLLED = {"z": (0.3, 0.1), "Omega": (1.0, 2.0, 3.0)}, {"phi": 0.2, "phidot": 3.0}
THROWN = {"Omega": (-1.0, 3.0, 2.0)}
CASES = {
    "ball": Case(uneven_ball, SPUN, (1.2, 0.5, 1.0), BOUNCES, 0.3, SHORT, ALL_BUT_REST),
    "disk": Case(uneven_disk, ROLLED | {"z": 0.3}, (1.2, 0.0, 1.0), BOUNCES, 0.3, SHORT, ALL_BUT_REST),
    "ball that rests": Case(stopped_ball, THROWN, (2.0, 0.7, 0.8), RESTS, 0.1, LONG, {*Mode}),
    "limit surface": Case(
        uneven_ball,
        {"Omega": (1.0, 3.0, 5.0)},
        (-1.5, 0.7, 0.5),
        Contact(LimitSurface(0.25, 0.1), restitution=0.3, slowest=0.1),
        0.1,
        SHORT,
        {Mode.SLIDING, Mode.ROLLING},
    ),
}
# Each with the length of a unit of x over that along the plane.
SURFACES = {
    "tilting plane": lambda a: (TiltingPlane(about_e2=ConstantRate(a)), 1.0),
    "parametric surface": lambda a: (
        ParametricSurface(lambda t, u, v, slope: jnp.stack([u, v, -slope * u]), np.tan(a)),
        np.cos(a),
    ),
}


def turn(a):
    """The rotation of the axes of a plane into space."""
    return np.array([[np.cos(a), 0.0, np.sin(a)], [0.0, 1.0, 0.0], [-np.sin(a), 0.0, np.cos(a)]])


def run(name, ground, scale, angle):
    """``angle`` is that by which the axes of space are turned out of those of the plane."""
    case, of_disk = CASES[name], "disk" in name
    start = case.state | {
        "z": np.multiply(case.state.get("z", 0.0 if of_disk else (0.0, 0.0)), scale_of(of_disk, scale))
    }
    if of_disk:
        state = DiskState(**start | {"phi": case.state["phi"] - angle})
    else:
        state = BallState(**start, q=(np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0))
    thrown = ReleasedState(state, V=turn(angle) @ np.array(case.V))
    return simulate(case.body(ground), case.times, thrown, contact=case.law, throw=True, **FINE)


def scale_of(of_disk, scale):
    return scale if of_disk else (scale, 1.0)


@functools.cache
def on_plane(name):
    return run(name, Ground(angle=CASES[name].angle), 1.0, 0.0)


@pytest.mark.parametrize(
    ("name", "surface"),
    [
        pytest.param("ball", "tilting plane", marks=pytest.mark.long),
        pytest.param("ball", "parametric surface", marks=pytest.mark.long),
        pytest.param("disk", "tilting plane", marks=pytest.mark.thorough),
        pytest.param("ball that rests", "tilting plane", marks=pytest.mark.long),
        pytest.param("limit surface", "tilting plane", marks=pytest.mark.long),
    ],
)
def test_a_plane_that_is_a_surface_is_a_plane(name, surface):
    case = CASES[name]
    ground, scale = SURFACES[surface](case.angle)
    one, other = on_plane(name), run(name, ground, scale, case.angle)
    of_disk = "disk" in name

    def alike(found, expected, fields, atol):
        for field in fields:
            np.testing.assert_allclose(getattr(found, field), getattr(expected, field), atol=atol, err_msg=field)

    expected = np.asarray(one.state.z) * scale_of(of_disk, scale)
    np.testing.assert_allclose(other.state.z, expected, atol=CLOSE)
    if of_disk:
        np.testing.assert_allclose(other.state.phi, one.state.phi - case.angle, atol=CLOSE)
    alike(other.state, one.state, ["phidot" if of_disk else "Omega"], CLOSE)
    alike(other.observables, one.observables, ("normal_force", "friction", "kinetic_energy", "dissipation"), FORCES)
    alike(other.observables, one.observables, () if of_disk else ("angular_acceleration_body",), FORCES)
    count = int(one.switches.count)
    assert count == int(other.switches.count) >= (2 if name == "limit surface" else 5)
    np.testing.assert_allclose(other.switches.times[:count], one.switches.times[:count], atol=CLOSE)
    assert other.switches.lines == one.switches.lines
    assert case.modes <= {int(mode) for mode in one.contact.switches.target[:count]}
    np.testing.assert_array_equal(other.contact.mode, one.contact.mode)
    np.testing.assert_allclose(other.contact.V, np.asarray(one.contact.V) @ turn(case.angle).T, atol=CLOSE)
    alike(other.contact, one.contact, ("height", "slip", "friction_loss", "impact_loss"), CLOSE)
    if "rests" in name:
        alike(other.history, one.history, ("rests", "spin"), 0.0)
        assert other.history.rests[-1]
        np.testing.assert_array_equal(other.state.z[-1], other.state.z[-2])
