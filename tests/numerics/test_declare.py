"""What a class declares of its numbers in their fields: names, shapes, conversion, conditions and keys follow."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from jaxball.files.scenario.own import module_of
from jaxball.files.scenario.table import REQUIRED
from jaxball.interface.printing import Printed
from jaxball.numerics.declare import (
    FULL_TURN,
    LENGTH,
    NOT_NEGATIVE,
    POSITIVE,
    declarations,
    number,
    number_or_none,
    shapes_of_fields,
)
from jaxball.physics.conditions import all_hold, on_numbers
from tests.support.sentences import refuses


class Torus(Printed):
    radii: Float[Array, "*group 2"] = eqx.field(converter=number(LENGTH, POSITIVE))
    bumps: Float[Array, "*group n 3"] = eqx.field(converter=number(LENGTH), default=((0.0, 0.0, 0.0),))
    turned: Float[Array, "*group"] = eqx.field(converter=number(rule=FULL_TURN), default=0.0)
    wear: Float[Array, ""] | None = eqx.field(converter=number_or_none(rule=NOT_NEGATIVE), default=None)
    scale: Float[Array, "*batch 2"] = eqx.field(converter=number(), default=(1.0, 1.0))


class Dented(Torus):
    depth: Float[Array, ""] = eqx.field(converter=number(LENGTH, POSITIVE), kw_only=True)


SIDE = number(LENGTH, POSITIVE)


class Box(Printed):
    width: Float[Array, ""] = eqx.field(converter=SIDE)
    edges: Float[Array, " 2"] = eqx.field(converter=SIDE)


def test_fields_that_were_given_one_declaration_have_their_own_names_and_shapes():
    own = {name: (declared.name, declared.shape) for name, declared in declarations(Box).items()}
    assert own == {"width": ("width", ()), "edges": ("edges", (2,))}
    assert Box(1.0, (2.0, 3.0)).width.shape == ()
    with refuses(ValueError, "width"):
        Box((1.0, 2.0), (2.0, 3.0))


def test_names_and_shapes_are_those_of_the_fields():
    assert {name: (declared.name, declared.shape) for name, declared in declarations(Dented).items()} == {
        "radii": ("radii", (2,)),
        "bumps": ("bumps", ("n", 3)),
        "turned": ("turned", ()),
        "wear": ("wear", ()),
        "scale": ("scale", (2,)),
        "depth": ("depth", ()),
    }
    assert "scale" not in shapes_of_fields(Torus)  # which may have more axes


def test_arguments_are_converted_and_named_in_errors():
    assert Torus((2, 1)).radii.dtype == jnp.zeros(()).dtype
    assert Torus((2, 1), wear=None).wear is None
    assert Torus((2, 1), scale=np.ones((5, 2))).scale.shape == (5, 2)
    with refuses(ValueError, "radii"):
        Torus((3, 2, 1))
    with refuses(ValueError, "bumps"):
        Torus((2, 1), bumps=np.ones((4, 2)))
    with refuses(TypeError, "depth"):
        Dented((2, 1), depth="deep")


@pytest.mark.parametrize(
    ("torus", "wrong"),
    [
        (Torus((2, 1)), []),
        (Torus((2, -1)), ["radii"]),
        (Torus((2, np.inf)), ["radii"]),
        (Torus((2, 1), wear=0.0), []),
        (Torus((2, 1), wear=-0.1), ["wear"]),
        (Torus((2, 1), turned=100.0), []),  # beyond a full turn, which is refused where somebody writes it
        (Torus((2, 1), turned=np.nan), ["turned"]),
        (Dented((0, 1), depth=-1.0), ["radii", "depth"]),
    ],
)
def test_conditions_are_those_that_are_declared(torus, wrong):
    assert [condition.name for condition in on_numbers(torus, "") if not condition.holds] == wrong
    assert bool(jax.jit(lambda torus: all_hold(on_numbers(torus, "")))(torus)) == (not wrong)


def test_keys_of_files_have_shapes_rules_and_defaults():
    keys = module_of(Dented).keys
    assert keys["radii"].kind.words == "a list of 2 positive numbers"
    assert keys["radii"].default is REQUIRED
    assert keys["bumps"].kind.words == "a list of rows of 3 finite numbers"
    assert keys["bumps"].default == ((0.0, 0.0, 0.0),)
    assert keys["wear"].default is None
    assert keys["depth"].kind.dimension == LENGTH
