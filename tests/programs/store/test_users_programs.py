"""Programs of users' functions are found by what the functions consist of: whatever changes a result, and no less."""

import os

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Disk, FunctionSchedule, OnRail, PointMass, Tube, simulate
from jaxball.programs import computation
from jaxball.programs.identity.fingerprints import digest
from jaxball.programs.identity.names import NoNameError
from jaxball.programs.store import current
from tests.support.precision import enable_x64
from tests.support.scripts import printed_by

from .test_programs import Memory, same_bits

# One of everything of which a function may be made. Each number in capitals is changed in turn.
SOURCE = """
import dataclasses, functools, typing
import equinox as eqx, jax, jax.numpy as jnp, numpy as np

FACTOR = {number}
TABLE = {{"a": [1.0, 2.0], "b": np.array([3.0, {number}])}}

def helper(x, power={default}):
    return FACTOR * x**power

def decorated(function):
    @functools.wraps(function)
    def wrapped(*args):
        return {outer} * function(*args)
    return wrapped

@decorated
def with_decorator(x):
    return helper(x)

@jax.custom_jvp
def ruled(x):
    return jnp.sin(x)

ruled.defjvp(lambda primals, tangents: (ruled(primals[0]), {rule} * tangents[0]))

@functools.partial(jax.jit, static_argnums={static})
def with_static(x, n):
    return x * n

class Spring(eqx.Module):
    stiffness: jax.Array
    power: int = eqx.field(static=True, default={field})

    @property
    def twice(self):
        return {prop} * self.stiffness

    def __call__(self, x):
        return self.twice * x**self.power

class Stiffer(Spring):
    def __call__(self, x):
        return super().__call__(x) + self.offset()

    @staticmethod
    def offset():
        return {method}

@dataclasses.dataclass(frozen=True)
class Settings:
    gain: float
    names: tuple = ("a",)

class Pair(typing.NamedTuple):
    first: float
    second: float = {second}

spring, settings, pair = Stiffer(jnp.asarray({leaf})), Settings({gain}), Pair(1.0)
spring_power = spring.power

def closure():
    held = {held}
    array = np.array([held, 1.0], {dtype})
    def inner(x):
        def innermost(x):
            return jnp.sum(array) * x + held
        return innermost(x)
    return inner

held = closure()

def loss(x):
    y = with_decorator(x) + ruled(x) + with_static(x, 2) + spring(x) + settings.gain * pair.second
    for value in TABLE["b"]:
        y = y + value * x
    if {flag} and len(TABLE["a"]) == {length}:
        y = y {operator} held(x)
    return jax.lax.cond(x > 0, jnp.{branch}, jnp.cos, y)

def gradient(x):
    return jax.grad(loss)(x)
"""
CHANGES = {
    "number": ("2.0", "2.5"),
    "default": ("2", "3"),
    "outer": ("1.5", "1.25"),
    "rule": ("jnp.cos(primals[0])", "2.0"),
    "static": ("(1,)", "()"),
    "field": ("3", "2"),
    "prop": ("2.0", "3.0"),
    "method": ("0.25", "0.75"),
    "second": ("4.0", "5.0"),
    "leaf": ("0.5", "0.6"),
    "gain": ("0.1", "0.2"),
    "held": ("0.7", "0.8"),
    "dtype": ("np.float64", "np.float32"),
    "flag": ("True", "False"),
    "length": ("2", "3"),
    "operator": ("+", "-"),
    "branch": ("sin", "tan"),
}
USUAL = {name: usual for name, (usual, _) in CHANGES.items()}


def functions(before="", **changes):
    """The functions of the source with changes, as another process or another cell of a notebook has them."""
    names = {"__name__": "__main__"}
    exec(before + SOURCE.format(**{**USUAL, **changes}), names)
    return names


@pytest.fixture(scope="module")
def usual():
    return functions()


@pytest.mark.parametrize("transformed", [lambda f: f, jax.grad, jax.hessian, jax.vmap, jax.value_and_grad, jaxball.jit])
def test_equal_functions_are_equal_wherever_they_are_written(transformed, usual):
    lower = functions(before="# A comment.\n__name__ = 'elsewhere'\n")
    assert digest(transformed(usual["loss"])) == digest(transformed(lower["loss"]))


@pytest.mark.thorough
@pytest.mark.parametrize("name", CHANGES)
def test_whatever_changes_a_result_is_seen(name, usual):
    other = functions(**{name: CHANGES[name][1]})
    for of in ("loss", "gradient"):
        assert digest(usual[of]) != digest(other[of])
    for transformed in (jax.grad, jax.hessian, eqx.filter_grad):
        assert digest(transformed(usual["loss"])) != digest(transformed(other["loss"]))


def test_transformations_and_their_arguments_are_seen(usual):
    f = usual["loss"]
    all_of_them = [
        *(f, jax.grad(f), jax.jacfwd(f), jax.jacrev(f), jax.hessian(f), jax.vmap(f), jax.vmap(f, out_axes=1)),
        *(
            jax.grad(f, has_aux=True),
            jax.value_and_grad(f),
            jax.checkpoint(f),
            eqx.filter_grad(f),
            jax.grad(jax.grad(f)),
        ),
        *(eqx.filter_value_and_grad(f), jax.jit(f), jax.jit(f, static_argnums=0)),
    ]
    assert len(set(map(digest, all_of_them))) == len(all_of_them)


@pytest.mark.parametrize(
    "body",
    [
        "np.load(path) * x",
        "x + np.random.normal()",
        "x + random.random()",
        "x * time.time()",
        "x + float(open(path).read())",
        "x + len(os.environ)",
        "x + eval('K')",
        "x + globals()['K']",
        "print(x)",
        "jaxball.load_scenario(path).system.mass * x",
        "jaxball.load_run(path).state.z * x",
        "eqx.tree_deserialise_leaves(path, x)",
        "used(own_module, x)",
        "getattr(own_module, 'f')(x)",
        "__import__('math').pi * x",
        "next(counter) * x",
    ],
)
def test_what_may_depend_on_more_is_refused(body):
    text = (
        "import itertools, os, random, time\nimport equinox as eqx, jaxball, numpy as np\nfrom tests import support\n"
    )
    text += "K, path, own_module, used = 1.0, 'a file', support, lambda module, x: x\ncounter = itertools.count()\n"
    names = {}
    exec(f"{text}def f(x):\n    return {body}\ndef imports(x):\n    import math\n    return x * math.pi\n", names)
    for f in (names["f"], jax.grad(names["f"]), names["imports"]):
        with pytest.raises(NoNameError):
            digest(f)


@pytest.fixture
def in_process(monkeypatch):
    """Calls a function as in a process of its own; returns its result, and how many programs were traced."""
    contents, traced, original = {}, [], computation.Computation._of_arrays
    monkeypatch.setattr(computation.Computation, "_of_arrays", lambda *given: traced.append(1) or original(*given))

    def call(function, *args):
        traced.clear()
        with current.keep_within(Memory(contents)):
            return function(*args), len(traced)

    return call


def test_a_program_is_found_without_a_trace_and_computes_the_same(in_process, usual):
    def both(names):
        return jaxball.jit(jax.value_and_grad(names["loss"]))(0.3)

    first, traced = in_process(both, usual)
    assert traced == 1
    again, traced = in_process(both, functions())
    assert traced == 0
    same_bits(first, again)
    np.testing.assert_allclose(first, jax.jit(jax.value_and_grad(usual["loss"]))(0.3), rtol=1e-13)  # rounded otherwise


def test_arguments_and_settings_are_tell_numbers_apart(in_process):
    def made(x):
        return jaxball.jit(lambda x: jax.tree.map(lambda one: 2 * one, x))(x)

    kinds = [1, 1.0, np.float32(1), np.arange(2), np.arange(3), {"a": 1.0}, {"b": 1.0}, [1.0], (1.0,), jnp.ones(())]
    for k in kinds:
        result, traced = in_process(made, k)
        assert traced == 1
        again, traced = in_process(made, k)
        assert traced == 0
        same_bits(result, again)
    with enable_x64(False):
        assert in_process(made, 1.0)[1] == 1


def test_effects_are_not_lost(in_process):
    """Of a program that calls Python when it runs, and of a function that counts its traces."""
    seen, traces = [], []

    def calling():
        return jaxball.jit(lambda x: (jax.debug.callback(seen.append, x), x)[1])(1.0)

    def counting():
        def f(x):
            traces.append(len(traces))
            return x

        return jaxball.jit(f)(1.0)

    for _ in range(2):
        jax.block_until_ready(in_process(calling)[0])
        in_process(counting)
    jax.effects_barrier()
    assert (len(seen), len(traces)) == (2, 2)


class Plane(eqx.Module):
    """A class of a user, which a result may contain."""

    normal: jax.Array
    shape: object = eqx.field(static=True)


def test_results_may_contain_what_is_the_users_own(in_process):
    def made():
        def shape(x):
            return x

        return jaxball.jit(lambda x: Plane(x, shape))(1.0), shape

    assert in_process(made)[1] == 1
    (found, shape), traced = in_process(made)
    assert traced == 0
    assert isinstance(found, Plane)
    assert found.shape is shape  # that of this process


@pytest.mark.thorough
def test_systems_with_functions_of_users_are_found(in_process):
    """Their programs are those of jaxball."""

    def run(height, factor):
        def theta(t, height):
            return factor * height * jnp.sin(t) ** 2

        motion = OnRail(Tube((1.0, 0.0, 0.0)), FunctionSchedule(theta, height))
        disk = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.1, motion)])
        return simulate(disk, [0.0, 0.5], solver=diffrax.Tsit5(), rtol=1e-3, atol=1e-3).state.z

    first, traced = in_process(run, 0.1, 1.0)
    assert traced >= 1
    again, traced = in_process(run, 0.1, 1.0)
    assert traced == 0
    same_bits(first, again)
    assert in_process(run, 0.2, 1.0)[1] == 0
    assert in_process(run, 0.1, 2.0)[1] >= 1


SCRIPT = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
import jaxball
from jaxball import programs
from jaxball.programs import computation
import model
jaxball.programs.cache.enable(sys.argv[1])
traced, original = [], computation.Computation._of_arrays
computation.Computation._of_arrays = lambda *given: traced.append(1) or original(*given)
results = [jaxball.jit(f)(0.3) for f in (jax.grad(model.loss), lambda x: model.held(x))]
print(len(traced), *(float(x).hex() for x in results))
"""


@pytest.mark.long
def test_processes_find_programs_of_users_modules(tmp_path):
    """The second process traces nothing; the third, whose module has one other line, only what uses that."""
    (tmp_path / "script.py").write_text(SCRIPT)
    folder = tmp_path / "programs"
    folder.mkdir(mode=0o700)

    def run(**changes):
        (tmp_path / "model.py").write_text(SOURCE.format(**{**USUAL, **changes}))
        environment = {**os.environ, "JAXBALL_NO_CACHE": "", "PYTHONHASHSEED": str(len(changes) + 1)}
        traced, *results = printed_by("-B", "script.py", str(folder), cwd=tmp_path, env=environment).split()
        return int(traced), [float.fromhex(result) for result in results]

    (first, results), (second, again), (third, other) = run(), run(), run(number="2.5")
    assert (first, second, third) == (2, 0, 1)
    assert results == again
    assert jaxball.programs.cache.contents(folder).files == 3
    for changes, found in (({}, results), ({"number": "2.5"}, other)):
        names = functions(**changes)
        expected = jax.jit(jax.grad(names["loss"]))(0.3), names["held"](0.3)
        np.testing.assert_allclose(found, expected, rtol=1e-13)  # the compilers round otherwise
