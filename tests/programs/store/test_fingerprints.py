"""Equal values have equal fingerprints, different ones different, and what could hide a difference has none."""

import enum
import functools
import threading

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import Ball, Circle, Disk, Fixed, FunctionSchedule, OnRail, PointMass, Pulse, SphericalFrame, Status
from jaxball.interface.compat import Primitive
from jaxball.numerics import vectors, versor
from jaxball.programs.identity.fingerprints import digest
from jaxball.programs.identity.names import NoNameError
from tests import support

DIFFERENT = [
    None,
    True,
    False,
    0,
    1,
    0.0,
    -0.0,
    1.0,
    float("inf"),
    1j,
    "",
    "1",
    b"1",
    (),
    [],
    {},
    (1, 2),
    [1, 2],
    (12,),
    ("1", "2"),
    ("12",),
    ((1,), 2),
    ((1, 2),),
    {"a": 1},
    {"a": 1.0},
    {"a": {"b": 1}},
    {"a": {}, "b": 1},
    frozenset({1}),
    np.float64(1.0),
    np.float32(1.0),
    np.array(1.0),
    np.array([1.0]),
    np.array([1.0], np.float32),
    np.array([[1.0]]),
    np.array([1]),
    np.dtype("float32"),
    np.dtype("float64"),
    float,
    int,
    Ball,
    Disk,
    Status.SUCCESS,
    Status.MAX_STEPS,
    diffrax.RESULTS.successful,
    diffrax.RESULTS.max_steps_reached,
    diffrax.Dopri8(),
    diffrax.Dopri5(),
    diffrax.RecursiveCheckpointAdjoint(),
    diffrax.RecursiveCheckpointAdjoint(checkpoints=3),
    diffrax.ForwardMode(),
    diffrax.ConstantStepSize().wrap,
    diffrax.StepTo(jnp.arange(3)).wrap,
    vectors.cross,
    vectors.apply,
    functools.partial(vectors.cross, 1),
    functools.partial(vectors.cross, 2),
    functools.partial(vectors.apply, 1),
    jnp.sin,
    jnp.cos,
    np.sin,
    versor.product,
]


def test_different_values_have_different_digests():
    digests = [digest(value) for value in DIFFERENT]
    assert len(set(digests)) == len(DIFFERENT)
    # Nor can a list of values be taken for another one.
    assert digest((1, 2)) != digest(1, 2) != digest(12) != digest((1, 2), ())


def test_equal_values_have_equal_digests():
    def values():
        number = float("0.1")
        return {"a": [number, np.array([number]), diffrax.Dopri8()], "b": (f"{number}x", Ball, {3, 5, 4})}

    assert digest(values()) == digest(values())
    assert digest(np.arange(6.0)[::2]) == digest(np.array([0.0, 2.0, 4.0]))


def structure(value):
    return digest(jax.tree.structure(value))


def test_structures_differ_with_every_static_field():
    rail = Circle(radius=0.9, frame=SphericalFrame(azimuth=0.3, elevation=0.5))
    masses = [
        [],
        [PointMass(0.5, Fixed((0.0, 0.0, 0.5)))],
        [PointMass(0.5, OnRail(rail, Pulse(0.8, height=2.0)))],
        [PointMass(0.5, Fixed((0.0, 0.0, 0.5)))] * 2,
    ]
    systems = [Ball(mass=1.0, inertia=(0.9, 1.0, 1.1), masses=these) for these in masses]
    assert len({structure(value) for value in systems}) == len(masses)
    schedules = [FunctionSchedule(jnp.arctan2, 1.0), FunctionSchedule(jnp.hypot, 1.0)]
    assert len({structure(value) for value in schedules}) == len(schedules)
    # Numbers are in the arrays, and structures are those of other processes.
    heavier = Ball(mass=2.0, inertia=(0.9, 1.0, 1.1), masses=masses[2])
    assert structure(heavier) == structure(systems[2])


class Colour(enum.Enum):
    RED = 1


class Slotted:
    __slots__ = ("x",)


class Stateful(dict):
    """Contains more than its items."""


STATEFUL = Stateful()
STATEFUL.more = 1


@pytest.mark.parametrize(
    "value",
    [
        Colour.RED,
        Slotted(),
        STATEFUL,
        {"a": [Slotted()]},
        support,
        iter([]),
        (x for x in ()),
        threading.Lock(),
        np.random.default_rng(0),
        np.array([object()]),
        Primitive("own"),
        jax.random.key(0),
    ],
    ids=lambda value: getattr(value, "__name__", type(value).__name__),
)
def test_what_could_hide_a_difference_has_no_digest(value):
    with pytest.raises(NoNameError):
        digest(value)


def test_what_contains_itself_has_no_digest():
    value = []
    value.append(value)
    with pytest.raises(NoNameError):
        digest(value)


def test_traced_values_have_no_digest():
    with pytest.raises(NoNameError):
        jax.make_jaxpr(lambda x: digest(x))(1.0)
