"""What jaxball takes from JAX beside its documented interface is as it must be, in the version that is installed."""

import ast
import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxball
from jaxball import BallState
from jaxball.interface import compat
from tests.support.precision import enable_x64

SOURCE = Path(jaxball.__file__).parent
# fmt: off
UNDOCUMENTED = (
    "jax.api_util", "jax.config.values", "jax.core", "jax.extend", "jax.interpreters", "jax.linear_util", "jaxlib",
    "equinox.internal",
)
# fmt: on
LIBRARIES = {"jax": "jax", "eqx": "equinox", "lax": "jax.lax", "jnp": "jax.numpy", "diffrax": "diffrax"} | {
    name: name for name in ("equinox", "jaxlib", "lineax", "optimistix", "optax")
}

# Where JAX has no such settings, tracing and lowering take longer, and results are the same.
since_jax_0_7 = pytest.mark.skipif(jax.__version_info__ < (0, 7), reason="JAX 0.6 traces and lowers otherwise")


def undocumented(path):
    """Every name of a library that its documentation leaves out, as far as a file writes it out."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Attribute) and ast.unparse(node).replace(".", "_").isidentifier():
            library, _, rest = ast.unparse(node).partition(".")
            names = [f"{LIBRARIES.get(library, '')}.{rest}"]
        else:
            continue
        for name in names:
            parts = name.split(".")
            hidden = any(part.startswith("_") and not part.startswith("__") for part in parts[1:])
            hidden |= any(f"{name}.".startswith(f"{module}.") for module in UNDOCUMENTED)
            if parts[0] in LIBRARIES.values() and hidden:
                yield f"{path.relative_to(SOURCE)}:{node.lineno}: {name}"


@pytest.mark.thorough
def test_nothing_else_imports_what_is_not_documented():
    paths = sorted(set(SOURCE.rglob("*.py")) - {SOURCE / "interface" / "compat.py"})
    assert len(paths) > 300
    assert [use for path in paths for use in undocumented(path)] == []
    assert len(list(undocumented(SOURCE / "interface" / "compat.py"))) >= 7  # the negative control


def test_what_a_function_captures_is_told():
    assert not compat.is_within_trace()
    seen = []

    def around(x, n):
        assert compat.is_within_trace()
        traced = jax.jit(lambda y: y * x + n).trace(jnp.ones(3))
        seen.extend([compat.captures(traced), compat.captures(jax.jit(lambda y: y + 1.0).trace(jnp.ones(3)))])
        assert [id(array) for array in seen[0]] == [id(x), id(n)]
        return compat.evaluate(traced.jaxpr, traced.jaxpr.consts, [x, n, jnp.ones(3)])[0]

    np.testing.assert_array_equal(jax.vmap(around)(jnp.array([2.0]), jnp.array([3.0])), [[5.0] * 3])
    assert seen[1] == []


def test_a_trace_is_told_from_others():
    seen = []

    def around(x):
        seen.extend([compat.current_trace(), compat.current_trace()])
        return jax.vmap(lambda y: seen.append(compat.current_trace()) or y)(x)

    jax.make_jaxpr(around)(jnp.ones(2))
    outside = compat.current_trace()
    assert seen[0] == seen[1]
    assert seen[0] != seen[2]
    assert outside == compat.current_trace()
    assert outside not in seen


def the_equation(function, *given):
    (equation,) = jax.make_jaxpr(function)(*given).jaxpr.eqns
    return equation


def test_traced_numbers_are_told_from_known_ones():
    seen = []

    def watch(x):
        seen.append(compat.is_traced(x))
        return x * 1.0

    for transformation in (lambda f: f, jax.jit, jax.vmap, jax.jacrev, jax.jacfwd):
        transformation(watch)(jnp.ones(2))
    assert seen == [False, True, True, True, True]
    assert not any(map(compat.is_traced, (1.0, np.ones(2), None, "x", jax.ShapeDtypeStruct((), float))))


CONTEXTS = [lambda: enable_x64(False), lambda: jax.default_matmul_precision("float32")]


@pytest.mark.parametrize("told", [compat.trace_context, compat.settings], ids=["trace context", "settings"])
@pytest.mark.parametrize("context", CONTEXTS, ids=["precision of numbers", "precision of products"])
def test_settings_are_those_of_their_place(told, context):
    before = told()
    with context():
        assert told() != before
        assert told() == told()
    assert told() == before


def test_settings_go_by_the_names_under_which_they_are_set():
    assert compat.settings()["jax_enable_x64"] is jax.config.jax_enable_x64
    with enable_x64(False):
        assert jnp.zeros(()).dtype == jnp.float32
    with enable_x64(True):
        assert jnp.zeros(()).dtype == jnp.float64
    assert "jax_disable_most_optimizations" in compat.settings()


def test_structures_show_what_is_at_their_root():
    kind, fields = compat.node_of(jax.tree.structure({"b": 1, "a": (2, None)}))
    assert (kind, list(fields)) == (dict, ["a", "b"])
    assert compat.node_of(jax.tree.structure(1.0)) is None
    assert compat.node_of(jax.tree.structure(None))[0] is type(None)
    assert compat.node_of(jax.tree.structure(BallState()))[0] is BallState


@functools.cache
def doubled():
    """x ↦ 2x, with 5 for its derivative, and x ↦ 3x, linear, with 7 backwards."""
    own = compat.primitive("doubled", lambda x: 2 * x)
    compat.differentiate_by(own, lambda primals, tangents: (own.bind(*primals), 5 * tangents[0]))
    linear = compat.primitive("tripled", lambda x, **_: 3 * x)
    compat.declare_linear(linear, lambda cotangent, x, **_: [7 * cotangent])
    return own.bind, linear.bind


@pytest.mark.parametrize("compiled", [lambda f: f, jax.jit], ids=["at once", "compiled"])
def test_an_operation_of_its_own(compiled):
    double, triple = map(compiled, doubled())
    x = jnp.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(double(x), 2 * x)
    np.testing.assert_array_equal(jax.vmap(double, in_axes=1)(x), 2 * x.T)
    np.testing.assert_array_equal(jax.vmap(double, in_axes=1, out_axes=1)(x), 2 * x)
    np.testing.assert_array_equal(jax.jvp(double, (x,), (x,))[1], 5 * x)
    np.testing.assert_array_equal(jax.grad(lambda x: double(x).sum())(x), np.full((2, 3), 5.0))
    np.testing.assert_array_equal(jax.jvp(triple, (x,), (x,))[1], 3 * x)
    np.testing.assert_array_equal(jax.grad(lambda x: triple(x).sum())(x), np.full((2, 3), 7.0))


def test_an_operation_of_its_own_with_parameters_and_several_results():
    both = compat.primitive("both", lambda x, power: (x, x**power), results=2)
    function = functools.partial(both.bind, power=3)
    x = jnp.arange(6.0).reshape(2, 3)
    for found in (function(x), jax.jit(function)(x), jax.vmap(function)(x), jax.eval_shape(function, x)):
        assert [leaf.shape for leaf in found] == [(2, 3), (2, 3)]
    np.testing.assert_array_equal(jax.vmap(jax.jit(function), in_axes=1, out_axes=1)(x)[1], x**3)
    assert the_equation(function, x).primitive is both


@since_jax_0_7
def test_a_function_is_traced_once_where_a_rule_of_derivatives_calls_it_again():
    traced = []

    @jax.jit
    def sine(x):
        traced.append(x)
        return jnp.sin(x)

    ruled = jax.custom_vjp(sine)
    ruled.defvjp(lambda x: (sine(x), x), lambda x, cotangent: (cotangent * sine(x + jnp.pi / 2),))
    with compat.same_mesh():
        gradient = jax.jit(jax.grad(ruled)).trace(1.0)
    assert len(traced) == 1
    np.testing.assert_allclose(gradient.lower().compile()(1.0), np.cos(1.0), rtol=1e-15)


def test_a_setting_of_traces_is_that_of_its_place():
    setting, seen = compat.setting_of_traces("outside"), []

    @jax.jit
    def traced(x):
        seen.append(setting.value)
        return x

    traced(1.0)
    with setting("inside"):
        traced(1.0)
        assert setting.value == "inside"
    assert setting.value == "outside"
    # Releases of JAX without such settings do not trace again.
    assert seen == ["outside", "inside"] if hasattr(jax, "make_user_context") else ["outside"]


def _sum(carry, x):
    return carry + x, carry


A, B = jnp.arange(3.0), jnp.ones((3, 3))
# A program, and of its loop: constants, what is carried, sequences, results of each step, the length, backwards.
LOOPS = {
    "sum": (lambda: lax.scan(_sum, 0.0, A), (0, 1, 1, 1, 3, False)),
    "backwards": (lambda: lax.scan(_sum, 0.0, A, reverse=True), (0, 1, 1, 1, 3, True)),
    "constants": (lambda x: lax.scan(lambda c, a: (c * x[0] + a, c), 0.0, A), (1, 1, 1, 1, 3, False)),
    "of rows": (lambda x: lax.scan(lambda c, row: (c + row @ x, 2 * row), x, B), (1, 1, 1, 1, 3, False)),
    "no sequence": (lambda x: lax.scan(lambda c, _: (c * x, None), x, None, length=4), (1, 1, 0, 0, 4, False)),
    "nothing carried": (lambda x: lax.map(lambda a: a * x, B), (1, 0, 1, 1, 3, False)),
    "two of each": (
        lambda x: lax.scan(lambda c, s: ((c[0] + s[0] * x, c[1] + s[1]), (s[0] + 1, s[1] + 2)), (x, x[0]), (A, A)),
        (1, 2, 2, 2, 3, False),
    ),
    "counted": (lambda x: lax.fori_loop(0, 5, lambda i, y: y * x, x), (1, 2, 0, 0, 5, False)),
}


@pytest.mark.parametrize("name", LOOPS)
def test_loops_are_read(name):
    function, (constants, carried, sequences, results, length, backwards) = LOOPS[name]
    given = [A] * function.__code__.co_argcount
    (equation,) = [e for e in jax.make_jaxpr(function)(*given).jaxpr.eqns if e.primitive.name == "scan"]
    loop = compat.loop(equation)
    assert (loop.constants, loop.carried, loop.length, loop.backwards) == (constants, carried, length, backwards)
    assert len(loop.body.in_avals) == constants + carried + sequences
    assert len(loop.body.out_avals) == carried + results


def test_branches_are_in_the_order_of_their_numbers():
    functions = [jnp.sin, jnp.cos, jnp.tan]
    equations = jax.make_jaxpr(lambda k, x: lax.switch(k, functions, x))(jnp.asarray(1), 1.0).jaxpr.eqns
    names = [[e.primitive.name for e in b.jaxpr.eqns] for b in compat.branches(equations[-1])]
    assert names == [["sin"], ["cos"], ["tan"]]
    equations = jax.make_jaxpr(lambda yes, x: lax.cond(yes, jnp.sin, jnp.cos, x))(jnp.asarray(True), 1.0).jaxpr.eqns
    names = [[e.primitive.name for e in b.jaxpr.eqns] for b in compat.branches(equations[-1])]
    assert names == [["cos"], ["sin"]]


@jax.custom_jvp
def _own_jvp(x):
    return 2 * x


_own_jvp.defjvp(lambda primals, tangents: (_own_jvp(*primals), 5 * tangents[0]))


@jax.custom_vjp
def _own_vjp(x):
    return 2 * x


_own_vjp.defvjp(lambda x: (_own_vjp(x), None), lambda _, cotangent: (7 * cotangent,))


def test_programs_within_are_found_where_their_operations_say_all():
    inner = compat.inner_program(the_equation(jax.jit(jnp.sin), 1.0))
    assert [e.primitive.name for e in inner.jaxpr.eqns] == ["sin"]
    for function in (_own_jvp, _own_vjp, jnp.sin, lambda x: lax.scan(_sum, x, A)):
        assert compat.inner_program(the_equation(function, 1.0)) is None


@pytest.mark.parametrize("function", [jax.jit(jnp.sin), _own_jvp, _own_vjp, jax.checkpoint(jnp.sin)])
def test_programs_within_are_found_even_with_rules_for_derivatives(function):
    inner = compat.program_within(the_equation(function, jnp.asarray(0.5)))
    assert inner is not None
    assert compat.evaluate(inner, inner.consts, [jnp.asarray(0.5)])[0] == function(jnp.asarray(0.5))


def test_loops_and_choices_are_no_programs_within():
    for function in (
        lambda x: lax.cond(x > 0, jnp.sin, jnp.cos, x),
        lambda x: lax.while_loop(lambda x: x < 1, lambda x: x + 1, x),
        lambda x: lax.fori_loop(0, 3, lambda _, x: x + 1, x),
    ):
        jaxpr = jax.make_jaxpr(function)(0.5).jaxpr
        assert compat.program_within(jaxpr.eqns[-1]) is None


@pytest.mark.parametrize("function", [jnp.sin, _own_jvp, _own_vjp, jax.jit(_own_jvp), jax.jit(_own_vjp)])
def test_an_equation_is_a_function_with_its_own_derivatives(function):
    equation = the_equation(function, 1.0)
    (again,) = jax.tree.leaves(compat.function_of(equation)(jnp.asarray(1.3)))
    np.testing.assert_allclose(again, function(1.3), rtol=1e-15)

    def number(x):
        return jnp.sum(jax.tree.leaves(compat.function_of(equation)(x))[0])

    np.testing.assert_allclose(jax.vmap(jax.grad(number))(A), jax.vmap(jax.grad(function))(A), rtol=1e-15)


T = jnp.arange(24.0).reshape(2, 3, 4)
PRODUCT = (((2,), (2,)), ((0,), (0,)))
# Functions of JAX, and what they were given by name.
ARGUMENTS = [
    (lambda x: lax.slice(x, (0, 1, 0), (1, 3, 4), (1, 1, 2)), {"start_indices": (0, 1, 0), "limit_indices": (1, 3, 4)}),
    (lambda x: lax.slice(x, (0, 1, 0), (1, 3, 4), (1, 1, 2)), {"strides": (1, 1, 2)}),
    (lambda x: lax.slice(x, (0, 1, 0), (1, 3, 4)), {"strides": None}),
    (lambda x: lax.rev(x, (2, 0)), {"dimensions": (2, 0)}),
    (lambda x: lax.transpose(x, (2, 0, 1)), {"permutation": (2, 0, 1)}),
    (lambda x: lax.broadcast_in_dim(x, (2, 5, 3, 4), (0, 2, 3)), {"broadcast_dimensions": (0, 2, 3)}),
    (lambda x: lax.concatenate([x, x], 1), {"dimension": 1}),
    (lambda x: lax.split(x, (1, 2), axis=1), {"sizes": (1, 2), "axis": 1}),
    (lambda x: jnp.sum(x, (0, 2)), {"axes": (0, 2)}),
    (lambda x: jnp.max(x, (0, 2)), {"axes": (0, 2)}),
    (lambda x: jnp.all(x > 0, (0, 2)), {"axes": (0, 2)}),
    (lambda x: lax.dot_general(x, x, PRODUCT), {"dimension_numbers": PRODUCT}),
    (lambda x: lax.integer_pow(x, 3), {"y": 3}),
]


@pytest.mark.parametrize(("function", "named"), ARGUMENTS)
def test_arguments_are_kept_under_their_names(function, named):
    equation = jax.make_jaxpr(function)(T).jaxpr.eqns[-1]
    for name, value in named.items():
        assert compat.argument(equation, name) == value


def test_an_argument_that_is_kept_under_another_name_is_said_to_be_missing():
    with pytest.raises(RuntimeError, match=rf"^JAX {jax.__version__} records the operation `rev` without `axes`"):
        compat.argument(the_equation(lambda x: lax.rev(x, (0,)), T), "axes")


def test_a_program_is_evaluated_with_other_constants():
    program = jax.make_jaxpr(lambda x: [x * T, x])(2.0)
    (constant,) = program.consts
    twice, same = compat.evaluate(program, [2 * constant], [3.0])
    np.testing.assert_array_equal(twice, 6 * T)
    assert same == 3.0


def test_what_a_loop_reads_and_carries_is_counted():
    def grow(x, y):
        return lax.while_loop(lambda at: at[0] < x, lambda at: (at[0] + y, 2.0 * at[1]), (x, T))

    equation = the_equation(grow, 1.0, 2.0)
    assert [compat.argument(equation, name) for name in ("cond_nconsts", "body_nconsts")] == [1, 1]
    assert len(compat.argument(equation, "body_jaxpr").jaxpr.outvars) == 2


def test_what_is_compiled_tells_what_it_was_made_of():
    def f(x, n):
        return x * n

    assert compat.unwrap_jit(jax.jit(f, static_argnums=1)) == (f, (1,), ("n",))
    assert compat.unwrap_jit(jax.jit(f)) == (f, (), ())
    assert compat.unwrap_jit(f) is None


def test_classes_tell_how_their_objects_are_taken_apart():
    class Pair:
        pass

    assert compat.node_functions(Pair) == ()
    apart, together = (lambda pair: ((), None)), (lambda _, parts: Pair())
    jax.tree_util.register_pytree_node(Pair, apart, together)
    assert compat.node_functions(Pair) == (apart, together)


@since_jax_0_7
def test_operations_are_lowered_without_the_lines_that_they_are_from():
    def text():
        return jax.jit(lambda x: jnp.sin(x) + 1).lower(0.5).as_text(debug_info=True)

    before = jax.config.values["jax_traceback_in_locations_limit"]
    jax.config.update("jax_traceback_in_locations_limit", 10)
    try:
        assert __file__ in text()
        with compat.without_locations():
            assert __file__ not in text()
    finally:
        jax.config.update("jax_traceback_in_locations_limit", before)


def test_only_arrays_of_known_numbers_have_their_type():
    traced = []
    jax.jit(lambda x: traced.append(type(x)))(1.0)
    assert compat.is_array_type(type(jnp.ones(2)))
    assert not any(map(compat.is_array_type, (type(jax.random.key(0)), np.ndarray, float, *traced)))
