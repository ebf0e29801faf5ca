"""What a type checker tells somebody who uses jaxball: the types, and the arguments in their order."""

import inspect
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import equinox as eqx
import pytest

from tests.house.test_documentation import EXAMPLES
from tests.house.test_interface import SOURCE, public

STRANGER = """
from typing import assert_type

import jax.numpy as jnp
from jax import Array

from jaxball import Ball, Circle, Event, OnRail, PointMass, Pulse, SphericalFrame, simulate

rail = Circle(0.9, frame=SphericalFrame(azimuth=0.3, elevation=0.5))
ball = Ball(mass=1.0, inertia=(0.9, 1.0, 1.1), masses=[PointMass(0.5, OnRail(rail, Pulse(0.8, height=2.0)))])
run = simulate(ball, jnp.linspace(0.0, 10.0, 101), events={"east": Event(lambda ball, t, state: state.z[0] - 1.0)})
assert_type(ball.mass, Array)
assert_type(run.ok, bool)
assert_type(run.observables.normal_force, Array)
Ball(mas=1.0)  # the mistake: no such argument
"""
# diffrax declares `root_finder`, and optimistix the tolerances, as fields of the classes that these are made from.
ORDERED_ELSEWHERE = {
    "jaxball.simulation.solvers.FixedPoint",
    "jaxball.simulation.solvers.Gauss",
    "jaxball.simulation.solvers.RadauIIA",
}


def modules():
    """The public classes whose ``__init__`` is made from their fields, as type checkers make it as well."""
    for name, cls in public():
        made = inspect.isclass(cls) and issubclass(cls, eqx.Module) and not cls.__name__.startswith("Abstract")
        if made and name not in ORDERED_ELSEWHERE:
            yield name, cls


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What basedpyright says of programs outside the source tree, without reading code that has no py.typed."""
    folder = tmp_path_factory.mktemp("stranger")
    (folder / "stranger.py").write_text(STRANGER)
    for example in EXAMPLES:
        shutil.copy(example, folder)
    packages = sorted({cls.__module__ for _, cls in modules()})
    lines = [f"import {package}" for package in packages]
    lines += [f"reveal_type({cls.__module__}.{cls.__name__}.__init__)" for _, cls in modules()]
    (folder / "signatures.py").write_text("\n".join(lines))
    (folder / "pyrightconfig.json").write_text('{"typeCheckingMode": "standard", "useLibraryCodeForTypes": false}')
    done = subprocess.run(
        [sys.executable, "-m", "basedpyright", "--outputjson", "--pythonpath", sys.executable, "-p", str(folder)],
        env={**os.environ, "PYTHONPATH": str(SOURCE.parent)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    by_file = {path.name: [] for path in folder.glob("*.py")}
    for one in json.loads(done.stdout)["generalDiagnostics"]:
        by_file[Path(one["file"]).name].append((one["severity"], one["message"]))
    return by_file


@pytest.mark.thorough
def test_a_stranger_sees_the_types(told):
    """With ``py.typed`` missing the types would be unknown, the assertions wrong, and the mistake not seen."""
    sentences = [message for _, message in told["stranger.py"]]
    assert len(sentences) == 2, sentences
    assert 'Arguments missing for parameters "mass", "inertia"' in sentences[0]
    assert 'No parameter named "mas"' in sentences[1]


def test_examples_have_the_types_that_jaxball_asks_for(told):
    assert not {example.name: told[example.name] for example in EXAMPLES if told[example.name]}


def test_type_checkers_see_the_arguments_in_their_order(told):
    classes = dict(modules())
    assert len(told["signatures.py"]) == len(classes)
    for (severity, message), (name, cls) in zip(told["signatures.py"], classes.items(), strict=True):
        assert severity == "information", message
        assert arguments(message) == list(inspect.signature(cls).parameters), name


def arguments(message):
    """The names in ``Type of "..." is "(self: ..., radius: ... = ..., *, ...) -> None"``, in their order."""
    text, depth, names = re.sub(r"^.* is \"\(|\) -> None\"$", "", message, flags=re.DOTALL), 0, [""]
    for letter in text.replace("->", ""):
        depth += (letter in "([{") - (letter in ")]}")
        if letter == "," and depth == 0:
            names.append("")
        else:
            names[-1] += letter
    names = [re.split("[:=]", name)[0].strip() for name in names]
    return [name for name in names if name not in ("self", "*", "/")]
