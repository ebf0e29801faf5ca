"""What functions have captured that is traced: it is taken out and put back, and has rows and derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Contact, Disk, DiskState, Event, FunctionForce, programs, simulate
from jaxball.programs.identity.closures import put_captures, take_captures
from jaxball.programs.native.tracing import Lowered
from tests.support.sentences import refuses

X = jnp.asarray(2.0)


class Holder(eqx.Module):
    function: object = eqx.field(static=True)
    number: jax.Array

    def method(self, t):
        return self.number * t


def closure(x):
    return lambda t: x * t


def nested(x):
    inner = closure(x)
    return lambda t: inner(t) + 1.0


def default(x):
    return lambda t, x=x: x * t


def default_by_name(x):
    def function(t, *, x=x):
        return x * t

    return function


def in_parts(x):
    parts = {"a": (x, (2.0, x))}
    return lambda t: (parts["a"][0] + parts["a"][1][1]) * t


def method(x):
    return Holder(None, x).method


def of_module(x):
    module = Holder(closure(x), x)
    return lambda t: module.number * t + module.function(t)


def recursive(x):
    def function(t, n=2):
        return x * t if n == 0 else function(t, n - 1)

    return function


KINDS = [closure, nested, default, default_by_name, in_parts, of_module]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_they_are_taken_out_and_put_back(kind):
    def through(x):
        taken, captures = take_captures(Holder(kind(x), X))
        assert [array is x for array in captures] == [True] * len(captures)
        assert captures
        assert take_captures(taken)[1] == []
        again, _ = take_captures(Holder(kind(x), X))
        # A dictionary and a module are only equal to themselves.
        assert (taken.function == again.function) == (kind not in (in_parts, of_module))
        return put_captures(taken, [3.0 * x for x in captures]).function(5.0)

    np.testing.assert_allclose(jax.grad(through)(X), 3.0 * jax.grad(lambda x: kind(x)(5.0))(X))


def test_what_holds_nothing_traced_stays_the_same():
    held = Holder(root_mean_square, X), [print, jnp.sin], {"a": (1, Holder(None, X).method)}
    tree, captures = take_captures(held)
    assert (tree is held, captures) == (True, [])


def root_mean_square(x):
    return jnp.sqrt(jnp.mean(x**2))


@pytest.mark.thorough
def test_a_function_that_is_written_again_is_not_compiled_again(monkeypatch):
    """Its numbers tell, and an array by being the same one."""
    compiled, natively = [], Lowered.compile_natively
    monkeypatch.setattr(Lowered, "compile_natively", lambda *args: compiled.append(args) or natively(*args))

    def place(slope, table):
        def height(disk, t, state):
            return state.z - slope * jnp.sum(table)

        return simulate(DISK, [0.0, 2.0], START, events={"there": Event(height)}).events["there"].times[0]

    def scaled(slope, table):
        return called(lambda x: slope * jnp.sum(table) * x, X)

    one, other = jnp.array([0.25]), jnp.array([0.5])
    np.testing.assert_allclose([place(1.0, one) for _ in range(3)], 0.25, rtol=1e-12)
    assert len(compiled) == 1
    np.testing.assert_allclose([scaled(1.0, one) for _ in range(3)], 0.5, rtol=1e-12)
    assert len(compiled) == 2
    np.testing.assert_allclose([scaled(2.0, one), scaled(1.0, other), scaled(1.0, one)], [1.0, 1.0, 0.5], rtol=1e-12)
    assert len(compiled) == 4


called = programs.filter_jit(lambda function, x: function(x))
LENGTH = 1.0


class Robot:
    gain = 1.0


def test_what_may_have_changed_is_looked_at_again(monkeypatch):
    """A variable of the module, an attribute, an array of NumPy, a list and a variable around the function."""
    robot, table, row, level = Robot(), np.array([1.0]), [1.0], 1.0
    ways = {
        "module": lambda: float(called(lambda x: x * LENGTH, X)),
        "object": lambda: float(called(lambda x: x * robot.gain, X)),
        "array": lambda: float(called(lambda x: x * table[0], X)),
        "list": lambda: float(called(lambda x: x * row[0], X)),
        "variable": lambda: float(called(lambda x: x * level, X)),
    }
    before = {name: way() for name, way in ways.items()}
    monkeypatch.setitem(globals(), "LENGTH", 0.5)
    robot.gain = table[0] = row[0] = level = 0.5
    after = {name: way() for name, way in ways.items()}
    np.testing.assert_allclose([list(before.values()), list(after.values())], [[2.0] * 5, [1.0] * 5], rtol=1e-12)


def test_a_derivative_that_is_asked_for_later_is_of_what_was_held():
    def line_of(level):
        def line(x):
            return level * x

        def change(other):
            nonlocal level
            level = other

        return line, change

    first, change = line_of(1.0)
    assert float(called(first, X)) == 2.0
    change(0.5)
    slopes = [float(jax.grad(lambda x, line=line: called(line, x))(X)) for line in (line_of(1.0)[0], first)]
    np.testing.assert_allclose(slopes, [1.0, 0.5], rtol=1e-12)


def test_a_function_that_calls_itself_is_left_with_what_it_holds():
    def through(x):
        function, captures = take_captures(Holder(recursive(x), X))
        return put_captures(function, captures).function(5.0)

    assert jax.grad(through)(X) == 5.0


def test_a_list_in_which_a_function_notes_its_arguments_is_left_alone():
    def through(x):
        seen = [x]
        taken, captures = take_captures(Holder(lambda t: seen.append(t) or x * t, X))
        assert (len(captures), put_captures(taken, captures).function(5.0)) == (1, 5.0 * x)
        return x

    jax.grad(through)(X)


def test_functions_that_differ_are_tell_numbers_apart():
    def through(x):
        one, other = (take_captures(Holder(f, X))[0].function for f in (lambda t: x * t, lambda t: x + t))
        assert one != other
        for values in ((1, 1.0, True), (0.0, -0.0), ((1, 2), (1.0, 2), (1, True)), ("1", 1)):
            numbers = [take_captures(Holder(lambda t, n=n: x * n, X))[0].function for n in (*values, values[0])]
            assert [numbers[0] == number for number in numbers] == [True, *[False] * (len(values) - 1), True]
        return x

    jax.grad(through)(X)


DISK, START = Disk(mass=1.0, inertia=0.5), DiskState(phidot=-1.0)


@pytest.mark.long
def test_the_level_of_an_event_in_its_function():
    """z = t, so that t(ℓ) = √ℓ where z² = ℓ: in rows, in both modes, as typed and compiled."""

    def time(level):
        events = {"there": Event(lambda disk, t, state: state.z**2 - level)}
        return simulate(DISK, [0.0, 2.0], START, events=events).events["there"].times[0]

    levels = jnp.array([0.25, 1.0])
    for derivative in (jax.grad, jax.jacfwd):
        for around in (lambda f: f, jax.jit):
            found = around(jax.vmap(derivative(time)))(levels)
            np.testing.assert_allclose(found, 0.5 / jnp.sqrt(levels), rtol=1e-12)


@pytest.mark.long
def test_the_force_on_a_disk_that_slips():
    """m ẍ = F − μ m g up to rolling: a slip from rest under F = 6 μ m g never ends, z = (F/m − μ g) t²/2."""

    def place(force):
        pushed = FunctionForce(lambda t, parameters: force * jnp.array([1.0, 0.0, 0.0]))
        disk = Disk(mass=1.0, inertia=0.5, gravity=1.0, force=pushed)
        return simulate(disk, [0.0, 2.0], DiskState(), contact=Contact(friction=0.1)).state.z[-1]

    np.testing.assert_allclose(jax.jvp(place, (0.6,), (1.0,)), (2.0 * (0.6 - 0.1), 2.0), rtol=1e-8)


class Hidden:
    """An object that is called, which no one can look into."""

    def __init__(self, level):
        self.level = level

    def __call__(self, disk, t, state):
        return state.z - self.level


@pytest.mark.long
def test_what_cannot_be_taken_out_has_rows_but_no_derivatives():
    def time(level):
        return simulate(DISK, [0.0, 2.0], START, events={"there": Event(Hidden(level))}).events["there"].times[0]

    levels = jnp.array([0.25, 1.0])
    np.testing.assert_allclose(jax.vmap(time)(levels), levels, rtol=1e-12)
    for derivative in (jax.grad, jax.jacfwd):
        with refuses(TypeError):
            jax.jit(derivative(time))(X)


@pytest.mark.parametrize("compiler", ["native", "xla"])
def test_both_compilers_take_functions_that_are_written_within_others(compiler):
    """Also where what such a function holds is an argument, so that the program has others than the function."""

    def twice(function, x):
        return function(function(x))

    program = programs.filter_jit(twice)
    with jaxball.compiler(compiler):
        assert float(program(lambda x: 3.0 * x, jnp.asarray(2.0))) == 18.0
        several = jax.vmap(lambda k: program(lambda x: k * x, jnp.asarray(2.0)))(jnp.array([1.0, 3.0]))
    np.testing.assert_allclose(several, [2.0, 18.0])
