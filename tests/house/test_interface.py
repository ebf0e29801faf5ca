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

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "jaxball"
PACKAGES = [name for name in dir(jaxball) if inspect.ismodule(getattr(jaxball, name))]


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
for name in "plot chaos design paper ensemble stability cpu classical solvers sweep verify scenario results".split():
    assert getattr(jaxball, name).__name__ == f"jaxball.{name}"
    assert name in shown
assert jaxball.physics.__name__ == "jaxball.physics"
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
assert rooms == {"compat", "interface", "methods", "programs", "numerics", "physics", "simulation", "solvers"}, rooms
beside = ("matplotlib", "xarray", "pandas", "h5py", "tomllib", "scipy.optimize")
print(*(name for name in beside if name in sys.modules))
"""
    assert fresh(program) == ""


def test_each_method_that_a_trajectory_only_states_is_provided_with_its_signature():
    program = """
import inspect, re
from jaxball.simulation import trajectory
from jaxball import methods
stated = re.findall(r"@leave_to_above\\n    def (\\w+)", inspect.getsource(trajectory))
assert {"plot", "save"} <= set(stated)
def parameters(function):
    return [(one.name, one.kind, one.default) for one in inspect.signature(function).parameters.values()][1:]
for name in stated:
    method = getattr(trajectory.Trajectory, name)
    assert parameters(method) == parameters(getattr(methods, name)), name
    try:
        method(None, wrong=None)
    except TypeError:  # of the function provided
        print(name, end=" ")
"""
    assert fresh(program) == "error_estimate to_dataset save plot view"


def test_dir_shows_the_interface_and_nothing_else():
    modules = {path.stem for path in SOURCE.iterdir() if path.suffix == ".py" or path.is_dir()}
    hidden = {"physics", "numerics", "interface", "simulation", "cli"}
    assert hidden <= modules
    assert not hidden & set(dir(jaxball))
    assert set(dir(jaxball)) == {*jaxball.__all__, *PACKAGES, "__version__"}
    for name in PACKAGES:
        package = getattr(jaxball, name)
        assert set(package.__all__) <= set(dir(package))
        beside = set(dir(package)) - set(package.__all__)
        assert beside == {"design": {"optimal_control"}, "paper": {"reference", "reproduce"}}.get(name, set())


LAZY = {"jaxball": SOURCE} | {f"jaxball.{name}": SOURCE / name for name in ("scenario", "results", "verify")}


@pytest.mark.parametrize(("name", "folder"), LAZY.items())
def test_no_name_is_that_of_a_module(name, folder):
    """Importing the module would take the place of what is to be found under its name."""
    assert not {path.stem for path in folder.iterdir()} & set(importlib.import_module(name).__all__)


@pytest.mark.parametrize(("name", "folder"), LAZY.items())
def test_type_checkers_are_told_the_same(name, folder):
    tree = ast.parse((folder / "__init__.py").read_text())
    (guarded,) = [node for node in tree.body if isinstance(node, ast.If)]
    told = {}
    for node in guarded.body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                assert alias.asname == alias.name
                told[alias.name] = node.module and "." * (node.level - 1) + node.module
    package = importlib.import_module(name)
    if package is jaxball:
        packages = {one: one if module is None else f"{module}.{one}" for one, module in told.items()}
        assert {one: packages[one] for one in PACKAGES} == jaxball._PACKAGES
        told = {one: module for one, module in told.items() if one not in PACKAGES}
    assert sorted(told) == package.__all__


def test_a_misspelt_name_is_an_attribute_error_with_a_suggestion():
    with pytest.raises(AttributeError, match="module 'jaxball' has no attribute 'Sphere'"):
        _ = jaxball.Sphere
    command = [sys.executable, "-c", "import jaxball; jaxball.simulat"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert "Did you mean: 'simulate'?" in done.stderr


def everything():
    """Whatever the interface has, by the name under which a user finds it."""
    packages = [jaxball, *(getattr(jaxball, name) for name in PACKAGES)]
    for module in [*packages, importlib.import_module("jaxball.design.optimal_control")]:
        for name in module.__all__:
            yield f"{module.__name__}.{name}", getattr(module, name)


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
        if not inspect.isclass(cls) or name.rpartition(".")[0] not in ("jaxball", "jaxball.classical"):
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
    for name in ("Ball", "Disk", "simulate", "balance", "PointMass", "BallState", "HarmonicForce"):
        signature = str(inspect.signature(getattr(jaxball, name)))
        assert "Numbers" in signature
        assert "ndarray" not in signature
