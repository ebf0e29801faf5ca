"""What of jaxball reads files is known by its code: a kept program never stands for the older content of a file."""

import ast
import inspect
import os
import re
import types
from pathlib import Path

import jax
import pytest

import jaxball
from jaxball.interface.names import public_packages
from jaxball.programs.identity import code, purity
from jaxball.programs.identity.fingerprints import digest
from jaxball.programs.identity.names import NoNameError
from tests.support.scripts import printed_by

SOURCE = Path(jaxball.__file__).parent
# Of the interface, by the contracts in pyproject.toml: what imports neither files nor figures, and all that solves.
WITHOUT_FILES = ("physics", "simulation", "numerics", "control.estimation")


@pytest.fixture(scope="module")
def public():
    """Each public function and class, by its name."""
    named = {}
    for package in public_packages(jaxball):
        within = package.__name__.removeprefix("jaxball").strip(".")
        named |= {f"{within}.{name}".strip("."): getattr(package, name) for name in package.__all__}
    return {name: value for name, value in named.items() if isinstance(value, types.FunctionType | type)}


def is_pure(value):
    used = code.Used()
    used.add(value, "jaxball")
    used.names.add("z")
    try:
        purity.require_pure(used)
    except NoNameError:
        return False
    return True


def test_what_takes_a_path_is_refused(public):
    functions = {name: value for name, value in public.items() if isinstance(value, types.FunctionType)}
    readers = {
        name: value for name, value in functions.items() if re.search("PathLike|pathlib", str(inspect.signature(value)))
    }
    assert {"load_run", "load_scenario", "studies.design.load_result", "studies.sweep.open_store"} < set(readers)
    assert [name for name, value in readers.items() if is_pure(value)] == []


def test_what_only_computes_is_not(public):
    packages = tuple(f"jaxball.{package}." for package in WITHOUT_FILES)
    computing = {name: value for name, value in public.items() if value.__module__.startswith(packages)}
    assert {"simulate", "Ball", "simulation.ensemble.simulate_ensemble", "simulation.solvers.RadauIIA"} < set(computing)
    assert [name for name, value in computing.items() if not is_pure(value)] == []


@pytest.mark.parametrize(
    "expression",
    [
        "jaxball.studies.design.load_result(path)",
        "jaxball.studies.design.result.load_result(path)",
        "jaxball.studies.sweep.open_store(path).grid()",
        "getattr(jaxball, 'load_run')(path)",
        "result.before.save(path)",
        "loading(path)",
        "(lambda module: module.load_run(path))(jaxball)",
        "jaxball.programs.cpu.cores()",
        "jaxball.programs.cache.contents().files",
        "jaxball.simulate(ball, times).save(path)",
    ],
)
def test_by_whatever_way_a_function_reads_it_is_refused(expression):
    names = {}
    text = "import functools, jaxball\nimport jaxball.studies.design.result\n"
    text += "loading = functools.partial(jaxball.load_run)\n"
    text += "path, result, ball, times = 'a file', jaxball.Trajectory, None, None\n"
    exec(f"{text}def f(x):\n    return {expression}\n", names)
    for f in (names["f"], jax.grad(names["f"])):
        with pytest.raises(NoNameError):
            digest(f)


def own_module(name, text):
    """A module of jaxball with this text, as a later version may have it."""
    module = types.ModuleType(f"jaxball.{name}")
    module.__package__ = "jaxball"
    exec(text, vars(module))
    return module


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("def f(x):\n    return x", True),
        ("import numpy as np\ndef f(x):\n    return np.load(x)", False),
        ("def g(x):\n    return open(x)\ndef f(x):\n    return g(x)", False),
        ("from time import time\ndef f(x):\n    return x * time()", False),
        ("import os\ndef f(x):\n    return [lambda: os.environ['X']][0]", False),
        ("def f(x):\n    from tomllib import loads\n    return loads(x)", False),
        ("def f(x):\n    from .files.results import to_dataset as load_run\n    return load_run(x)", False),
        ("TABLE = {}\ndef f(x):\n    return TABLE['a'](x)\nTABLE['a'] = lambda x: open(x)", False),
        ("class A:\n    def z(self):\n        return open(self)\ndef f(x):\n    return A()", False),
        ("class A:\n    def other(self):\n        return open(self)\ndef f(x):\n    return A()", True),
        ("class A:\n    def __call__(self):\n        return open(self)\ndef f(x):\n    return A()", False),
        ("class A:\n    @property\n    def z(self):\n        return open(self)\ndef f(x):\n    return A()", False),
        ("import equinox\nclass A(equinox.Module):\n    def __call__(self):\n        return open('x')\nf = A", False),
        ("import functools\nf = functools.partial(lambda x: open(x))", False),
        ("import jax\nf = jax.jit(lambda x: open(x))", False),
        ("import functools\n@functools.cache\ndef f(x):\n    return open(x)", False),
        ("class A:\n    open = 1\ndef f(x):\n    return x.open", True),
    ],
)
def test_reading_is_found_wherever_it_is(text, expected):
    assert is_pure(own_module("later", text).f) is expected


@pytest.mark.thorough
def test_random_numbers_have_seeds():
    """Which is why they are not refused."""
    seeds = [
        len(call.args) + len(call.keywords)
        for path in SOURCE.rglob("*.py")
        for call in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute) and call.func.attr in purity.SEEDED
    ]
    assert seeds
    assert min(seeds) > 0


SCENARIO = """
format = 1
kind = "disk"
initial = {{ phi = 0.0 }}
time = {{ start = 0.0, end = 1.0, saves = 2 }}
body = {{ mass = {mass}, radius = 1.0, inertia = 1.0, gravity = 1.0 }}
"""
PROBLEM = """
format = 1
[scenario]{scenario}
[[variables]]
path = "body.inertia"
lower = 0.5
upper = 1.5
[[objectives]]
kind = "go-far"
"""
SCRIPT = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
import jaxball
from jaxball import programs
from jaxball.programs import computation

jaxball.programs.cache.enable(sys.argv[1])
traced, original = [], computation.Computation._of_arrays
computation.Computation._of_arrays = lambda of, *given: traced.append(of.name) or original(of, *given)

def momentum(speed):
    with jax.ensure_compile_time_eval():
        mass = {mass}
    return mass * speed

print(float(jaxball.jit(momentum)(2.0)), len([name for name in traced if name == "momentum"]))
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("mass_of", "traces"),
    [
        ("jaxball.studies.design.load_result('result').after.system.mass", [1, 1]),
        ("jaxball.Disk(mass=3.0, inertia=1.0).mass", [1, 0]),
    ],
)
def test_a_program_is_never_older_than_the_file_it_read(mass_of, traces, tmp_path):
    """Two processes, with a file that changes between them. Programs that read none are still kept."""
    result, programs = tmp_path / "result", tmp_path / "programs"
    result.mkdir()
    programs.mkdir(mode=0o700)
    (result / "problem.toml").write_text(PROBLEM.format(scenario=SCENARIO.format(mass=1.0)))
    (tmp_path / "script.py").write_text(SCRIPT.format(mass=mass_of))
    outputs = []
    for mass in (3.0, 5.0):
        (result / "design.toml").write_text(SCENARIO.format(mass=mass))
        environment = {**os.environ, "JAXBALL_NO_CACHE": ""}
        outputs.append(printed_by("-B", "script.py", str(programs), cwd=tmp_path, env=environment).split())
    momenta = [6.0, 10.0] if "result" in mass_of else [6.0, 6.0]
    assert [float(momentum) for momentum, _ in outputs] == momenta
    assert [int(traced) for _, traced in outputs] == traces
