"""Programs on elements compute what the functions of arrays do."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import BallState, paper
from jaxball.numerics.expressions import in_order, is_node
from jaxball.numerics.lanes import LaneProgram, elements_of
from jaxball.numerics.pieces import pieces, separately
from jaxball.physics.packing import Packing

LANES = 8


def _products(p, x):
    return p["A"] @ x, jnp.einsum("ij,jk->ik", p["A"], p["A"].T) @ x


def _moves(p, x):
    stacked = jnp.stack([x, 2 * x[::-1], jnp.roll(x, 1)])
    replaced = x.at[1].set(p["b"]), x.at[jnp.array([2, 0])].set(x[:2]), jnp.zeros(3).at[2].set(x[0]), x.at[2].set(0.0)
    return *replaced, stacked.T[1], jnp.concatenate([x[1:], x[:1]]), stacked.reshape(-1)[::2], x[jnp.array([2, 0])]


def _reductions(p, x):
    return (
        jnp.sum(p["A"] * x[None], axis=1),
        jnp.max(x),
        jnp.min(p["A"], axis=0),
        jnp.prod(x),
        jnp.where(jnp.all(x > 0), 1.0, 0.0),
    )


def _selections(p, x):
    return jnp.where(x > 0, p["b"], x), jnp.clip(x, -0.5, 0.5), jnp.sign(x), x // 0.3


def _loops(p, x):
    powers = jax.lax.scan(lambda c, a: (c * x[0] + a, c), jnp.zeros(()), p["A"][0], reverse=True)
    return *powers, jnp.polyval(p["A"][1], x[1]), jax.lax.fori_loop(0, 3, lambda i, y: y * x, x)


def _whole_arrays(p, x):
    return jnp.linalg.solve(p["A"] + 4 * jnp.eye(3), x), jnp.sort(x), jnp.cumsum(x)


def _branches(p, x):
    of_two = jax.lax.cond(x[0] > 0, lambda x: (x[1] * p["b"], x, 1.0), lambda x: (-x[1], x[::-1] ** 2, 2.0), x)
    of_three = jax.lax.switch(jnp.floor(2 * x[1]).astype(int), [jnp.sin, jnp.cos, lambda y: 3 * y], x)
    known = jax.lax.cond(jnp.asarray(True), lambda: x, lambda: -x)
    slope = jax.jvp(lambda y: jax.lax.cond(y[0] > 0, jnp.sin, jnp.cos, y), (x,), (p["A"][0],))
    return *of_two, of_three, known, *slope


def _known(p, x):
    return jnp.eye(3) @ x, jnp.arange(3.0), p["b"] * 2, jnp.zeros(3) * x


def _tangents(p, x):
    return jax.jvp(lambda x: jnp.sin(x) * x[0] ** 3, (x,), (p["A"][0],))


@jax.custom_jvp
def _floor(x):
    return jnp.floor(x)


@_floor.defjvp
def _floor_jvp(primals, tangents):
    return _floor(*primals), 2 * tangents[0]


@jax.custom_vjp
def _clipped(x):
    return jnp.clip(x, -0.1, 0.1)


_clipped.defvjp(lambda x: (_clipped(x), None), lambda _, cotangent: (3 * cotangent,))


def _own_rules(p, x):
    return _floor(10 * x), p["b"] * jax.nn.relu(x[:2] * x[1]), _clipped(x[0])


def _nothing(p, x):
    return jnp.sum(x[:0]), jnp.concatenate([x[:0], p["b"][None]]), x[None, :0].sum(axis=1) + x[0], jnp.sort(x[:0])


FUNCTIONS = [
    _products,
    _moves,
    _reductions,
    _selections,
    _loops,
    _whole_arrays,
    _branches,
    _known,
    _tangents,
    _own_rules,
    _nothing,
]


@pytest.mark.thorough
@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.__name__[1:])
def test_elements_give_what_arrays_give(function):
    rng = np.random.default_rng(0)
    p = {"A": jnp.asarray(rng.normal(size=(LANES, 3, 3))), "b": jnp.asarray(rng.normal(size=LANES))}
    x = jnp.asarray(rng.normal(size=(LANES, 3)))
    program = LaneProgram(function, jax.tree.map(lambda leaf: leaf[0], p), x[0])
    lanes = elements_of(*(leaf.reshape(LANES, -1).T for leaf in jax.tree.leaves(p)))
    found = program(program.prepare(lanes), elements_of(x.T))
    wanted = [jnp.asarray(leaf, float).reshape(LANES, -1) for leaf in jax.tree.leaves(jax.vmap(function)(p, x))]
    np.testing.assert_allclose(np.asarray(found, float), np.concatenate(wanted, axis=1).T, rtol=1e-12, atol=1e-13)


def _held(x):
    return jax.lax.stop_gradient(x) * x, jax.nn.relu(x - x), _floor(x) ** 2


def test_derivatives_are_those_of_the_function():
    x = jnp.linspace(-1.0, 1.5, LANES)
    program = LaneProgram(lambda p, x: _held(x), (), x[0])
    found = jax.jvp(lambda x: program([], [x]), (x,), (jnp.ones_like(x),))[1]
    wanted = jax.vmap(lambda x: jnp.stack(jax.jvp(_held, (x,), (jnp.ones(()),))[1]))(x)
    np.testing.assert_allclose(found, wanted.T, rtol=1e-15)
    np.testing.assert_allclose(found[0], x)


def test_derivatives_backwards_keep_their_own_rules():
    program = LaneProgram(lambda p, x: _clipped(x), (), jnp.zeros(()))
    np.testing.assert_array_equal(jax.grad(lambda x: jnp.sum(program([], [x])))(jnp.ones(LANES)), np.full(LANES, 3.0))


def test_what_all_lanes_share_is_computed_once():
    program = LaneProgram(lambda p, x: x * jnp.exp(p[0]) + p[1], jnp.zeros(2), jnp.zeros(()))
    prepared = program.prepare([jnp.asarray(1.0), jnp.arange(4.0)])
    assert sorted(item.ndim for item in prepared) == [0, 1]
    np.testing.assert_allclose(program(prepared, [jnp.ones(4)])[0], np.e + np.arange(4.0), rtol=1e-15)


def test_the_same_operation_is_done_once():
    def function(p, x):
        return x[0] * x[1] + x[1] * x[0] + jnp.zeros(())

    program = LaneProgram(function, jnp.zeros(()), jnp.zeros(2))
    jaxpr = jax.make_jaxpr(lambda x: program([], [x, x + 1]))(jnp.zeros(LANES))
    assert sum(equation.primitive.name == "mul" for equation in jaxpr.jaxpr.eqns) == 1


def _operations_of_loops(program, separate):
    """How many operations the loops for results and what is computed separately have together."""
    known = frozenset(separate).union(program._prepared, program._changing)
    loops = {item for item in program._outputs if is_node(item)} | separate
    return sum(len(list(in_order([node], known - {node}))) for node in loops)


def test_equations_of_motion_are_computed_once():
    """An operation for each node, and a few again; without pieces the loops of the results share nothing."""
    ball, state = paper.ball(), BallState()
    program = LaneProgram(
        lambda ball, t, x: Packing.of(ball.prepare(), state).field(t, x), ball, jnp.zeros(()), jnp.zeros(9)
    )
    inputs = [*program._prepared, *program._changing]
    nodes = len(list(in_order(program._outputs, frozenset(inputs))))
    assert _operations_of_loops(program, pieces(program._outputs, inputs)) < 1.5 * nodes
    assert _operations_of_loops(program, frozenset()) > 4 * nodes


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan, 0.0, -1.5])
def test_what_is_computed_separately_keeps_its_value_and_derivative(value):
    x, tangent = jnp.array([value, value / 2]), jnp.array([1.0, -2.0])
    found, derivative = jax.jvp(separately, (x,), (tangent,))
    np.testing.assert_array_equal(found, x)
    np.testing.assert_array_equal(derivative, tangent)
