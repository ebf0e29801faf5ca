"""What a user finds: the names of ``jaxball`` and of its packages, reachable, listed and documented."""

import ast
import enum
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import jaxball
from jaxball.interface.names import imports_of, public_packages
from tests.support.sentences import refuses

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "jaxball"
PACKAGES = list(public_packages(jaxball))


def fresh(program: str) -> str:
    """What a program prints that a new interpreter runs, which has no type checks and has imported nothing."""
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_packages_are_reachable_and_nothing_is_imported_before():
    program = """
import sys, jaxball
shown = dir(jaxball)
assert not [name for name in sys.modules if name.partition(".")[0] in ("jax", "numpy", "diffrax", "matplotlib")]
for name in "analysis control files paper physics plot programs simulation studies".split():
    assert getattr(jaxball, name).__name__ == f"jaxball.{name}"
    assert name in shown
assert jaxball.analysis.chaos.__name__ == "jaxball.analysis.chaos"
assert dir(jaxball) == shown
print(jaxball.__version__)
"""
    assert fresh(program) == importlib.metadata.version("jaxball")


def test_a_simulation_imports_neither_files_nor_figures_nor_what_else_it_does_without():
    program = """
import sys
from jaxball import Ball, DiskState, OnRail, PointMass, Slip, simulate
from jaxball.simulation.extremes import contact_extremes
rooms = {name.split(".")[1] for name in sys.modules if name.startswith("jaxball.")}
assert rooms == {"interface", "programs", "numerics", "physics", "simulation"}, rooms
beside = ("matplotlib", "xarray", "pandas", "h5py", "tomllib", "scipy.optimize")
print(*(name for name in beside if name in sys.modules))
"""
    assert fresh(program) == ""


def test_each_method_that_is_left_to_another_module_has_the_signature_of_its_function():
    """But for defaults that are functions, which are written twice."""
    found = {}
    for path in SOURCE.rglob("*.py"):
        if "@leave_to(" in path.read_text():
            module = importlib.import_module(".".join(("jaxball", *path.relative_to(SOURCE).with_suffix("").parts)))
            for kind in filter(inspect.isclass, vars(module).values()):
                found |= {one.__qualname__: one for one in vars(kind).values() if hasattr(one, "left_to")}
    assert {"TrajectoryMethods.plot", "Study.estimate", "Rolling.rolling_along"} <= set(found)
    for name, method in found.items():
        module, package, attribute = method.left_to
        function = getattr(importlib.import_module(module, package), attribute)
        stated, given = (list(inspect.signature(one).parameters.values())[1:] for one in (method, function))
        assert [(one.name, one.kind) for one in stated] == [(one.name, one.kind) for one in given], name
        for one, other in zip(stated, given, strict=True):
            assert one.default == other.default or callable(one.default), name


def test_dir_shows_the_interface_and_nothing_else():
    for package in PACKAGES:
        beside = set(dir(package)) - set(package.__all__) - {"__version__"}
        assert set(package.__all__) <= set(dir(package))
        inner = {name for name in beside if getattr(package, name) in PACKAGES}
        assert beside == inner or package is jaxball.programs  # whose names jaxball's own functions use
    assert not {"numerics", "interface", "cli"} & set(dir(jaxball))


LAZY = [package for package in PACKAGES if hasattr(package, "__path__") and "__getattr__" in vars(package)]


@pytest.mark.parametrize("package", LAZY, ids=lambda package: package.__name__)
def test_no_name_is_that_of_a_module(package):
    """Importing the module would take the place of what is to be found under its name."""
    assert not {path.stem for path in Path(package.__path__[0]).iterdir()} & set(package.__all__)


@pytest.mark.parametrize("package", LAZY, ids=lambda package: package.__name__)
def test_type_checkers_are_told_the_same(package):
    tree = ast.parse(Path(package.__file__).read_text())
    (guarded,) = [node for node in tree.body if isinstance(node, ast.If)]
    told = {}
    for node in guarded.body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                assert alias.asname == alias.name
                told[alias.name] = "." * node.level + (node.module or "")
    assert told == imports_of(package.__name__)


def test_a_misspelt_name_is_an_attribute_error_with_a_suggestion():
    with refuses(AttributeError, "module 'jaxball'"):
        _ = jaxball.Sphere
    command = [sys.executable, "-c", "import jaxball; jaxball.simulat"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert "Did you mean: 'simulate'?" in done.stderr


def everything():
    """Whatever the interface has, by the name under which a user finds it."""
    for package in PACKAGES:
        for name in package.__all__:
            yield f"{package.__name__}.{name}", getattr(package, name)


def public():
    """Every class and function of it, but errors and enumerations."""
    for name, found in everything():
        error = inspect.isclass(found) and issubclass(found, BaseException | enum.Enum)
        if (inspect.isclass(found) or inspect.isfunction(found)) and not error:
            yield name, found


def test_every_argument_is_documented():
    """Where help() shows a class, it shows what its ``__init__`` says as well.

    What a whole family takes, as objectives their weight, the contract says that they are derived from.
    """
    missing, contracts = (
        {},
        {id(found) for _, found in public() if inspect.isclass(found) and inspect.isabstract(found)},
    )
    for name, found in public():
        own = vars(found).get("__init__") if inspect.isclass(found) else None
        family = [base for base in inspect.getmro(found)[1:] if id(base) in contracts] if inspect.isclass(found) else []
        text = "".join(one.__doc__ or "" for one in (found, *family)) + (getattr(own, "__doc__", None) or "")
        unnamed = [one for one in inspect.signature(found).parameters if f"``{one}``" not in text]
        if unnamed:
            missing[name] = unnamed
    assert not missing


def test_arrays_of_the_mechanics_are_documented_with_their_shapes():
    """What an annotation says, beside the axes of a batch, ``help`` says where it names the argument."""
    missing = []
    for name, cls in public():
        if not inspect.isclass(cls) or name.rpartition(".")[0] not in ("jaxball", "jaxball.physics.classical"):
            continue
        for argument in inspect.signature(cls).parameters:
            annotation = vars(cls).get("__annotations__", {}).get(argument)
            shape = [one for one in getattr(annotation, "dim_str", "").split() if not one.startswith(("*", "."))]
            bullets = re.split(r"\n\s*- ", cls.__doc__ or "")[1:]
            told = [one for one in bullets if f"``{argument}``" in one.partition(":")[0]]
            if shape and not (told and re.search(r"shape \([^)]*,[^)]*\)", told[0])):
                missing.append((name, argument, shape))
    assert not missing


def test_signatures_name_what_they_take():
    assert str(inspect.signature(jaxball.Circle)).startswith("(radius: Numbers, centre: Numbers = (0.0, 0.0, 0.0)")
    for name in ("Ball", "Disk", "simulate", "balance", "PointMass", "BallState", "HarmonicSeries"):
        signature = str(inspect.signature(getattr(jaxball, name)))
        assert "Numbers" in signature
        assert "ndarray" not in signature
