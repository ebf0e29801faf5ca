"""The derivative of where a robot ends along the torque that drives it, by jaxball and by engines.

The robot is the ball with a pendulum and a torque, and the derivative that of its place after 5 units of time along a
factor of the torque. MuJoCo's JAX version has derivatives of its steps; of MuJoCo itself they are differences of two
runs. Errors are relative to the derivative of the exact motion.
"""

import dataclasses
import importlib
import json
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxball import programs
from jaxball.files.mjcf import to_mjcf
from jaxball.interface.output import write_text
from jaxball.simulation.simulate import simulate

from ..measure import Echo, machine, power, seconds, versions
from . import MUJOCO
from .contract import CASES, Derivative, pendulum_robot, time_calls

CASE = CASES["pendulum"]
STIFF = next(setting for setting in MUJOCO.settings if setting.name == "RK4, stiff")
TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9)
TIMESTEPS = (0.01, 0.005, 0.002)
DIFFERENCE = 1e-3  # of the factor, to either side
PACKAGES = ("jaxball", "jax", "numpy", "mujoco", "mujoco-mjx")
COLUMNS = ("by", "step", "error", "compiling", "a derivative")
ABOUT = "The derivative of a robot's final place along its torque; processor time in seconds."


@dataclass(frozen=True)
class Row:
    """A derivative: how it was found, the time step or the tolerance, its relative error, and both times."""

    by: str
    step: float
    error: float
    compiling: float
    time: float


def measure(out: Path, echo: Echo = print) -> list[Row]:
    """Measures all derivatives, and writes ``gradients.json`` and ``gradients.md`` to the folder ``out``.

    **Raises:** :class:`~jaxball.files.results.OutputError` when a file cannot be written.
    """
    modes = {"forward": diffrax.ForwardMode(), "reverse": diffrax.RecursiveCheckpointAdjoint()}
    echo("Derivatives by jaxball, which compiles two programs first.")
    # The exact one comes last, so that the first row has the first compilation.
    ours = {name: [(tolerance, own(mode, tolerance)) for tolerance in TOLERANCES] for name, mode in modes.items()}
    exact = own(modes["forward"], 1e-12).value
    rows = []
    for name, found in ours.items():
        rows += _rows(f"jaxball, {name} mode", found, exact, echo)
    try:
        engine: Any = importlib.import_module(".mujoco_", __package__)
    except ImportError:
        echo("Left out: MuJoCo, because it is not installed.")
    else:
        echo("Derivatives of MuJoCo's runs, by differences.")
        models = [model_with_controls(engine, timestep) for timestep in TIMESTEPS]
        by_differences = [difference(engine, *one) for one in models]
        rows += _rows("MuJoCo, differences", zip(TIMESTEPS, by_differences, strict=True), exact, echo)
        try:
            mjx: Any = importlib.import_module(".mjx_", __package__)
        except ImportError:
            echo("Left out: MJX, because mujoco-mjx is not installed.")
        else:
            echo("Derivatives by MJX, which compiles for about a minute first.")
            found = mjx.derivatives(models)
            rows += _rows("MJX, forward mode", zip(TIMESTEPS, found, strict=True), exact, echo)
    out.mkdir(parents=True, exist_ok=True)
    content = {"about": ABOUT, "machine": machine(), "versions": versions(PACKAGES)}
    lines = {**content, "exact": exact.tolist(), "rows": [dataclasses.asdict(row) for row in rows]}
    write_text(out / "gradients.json", json.dumps(lines, indent=1) + "\n")
    write_text(out / "gradients.md", table(rows) + "\n")
    return rows


def table(rows: Sequence[Row]) -> str:
    """The rows as a table in Markdown."""
    lines = ["| " + " | ".join(COLUMNS) + " |", "|:--|--:|--:|--:|--:|"]
    for row in rows:
        compiling = seconds(row.compiling) if row.compiling > 0 else "–"
        lines.append(f"| {row.by} | {row.step:g} | {power(row.error, 2)} | {compiling} | {seconds(row.time)} |")
    return "\n".join(lines)


def _rows(name: str, found: Iterable[tuple[float, Derivative]], exact: Float[np.ndarray, "2"], echo: Echo) -> list[Row]:
    rows = []
    for step, derivative in found:
        error = float(np.linalg.norm(derivative.value - exact) / np.linalg.norm(exact))
        rows.append(Row(name, step, error, derivative.compiling, derivative.seconds))
        echo(f"  {name}, {step:g}: {power(error, 2)}")
    return rows


def own(adjoint: diffrax.AbstractAdjoint, tolerance: float) -> Derivative:
    """The derivative of a run; in reverse mode both places are differentiated, one after the other."""
    scenario = CASE.scenario()

    def place(scale: Float[Array, ""]) -> Float[Array, "2"]:
        times = jnp.asarray(scenario.times[[0, -1]])
        given = {"rtol": tolerance, "atol": tolerance, "adjoint": adjoint}
        return simulate(pendulum_robot(scale), times, scenario.state, **given).state.z[-1]

    forward = isinstance(adjoint, diffrax.ForwardMode)
    program = programs.jit(jax.jacfwd(place) if forward else jax.jacrev(place))
    value, calls = time_calls(lambda: program(jnp.ones(())), 3)
    return Derivative(value, calls[0] - min(calls), min(calls))


def model_with_controls(engine: Any, timestep: float) -> tuple[Any, np.ndarray]:
    """MuJoCo's model with a time step, and the controls of each step, those of its middle."""
    scenario = CASE.scenario()
    exported = to_mjcf(scenario, timestep=timestep)
    model = engine.model_of(CASE, STIFF, exported, timestep)
    steps = round(float(scenario.times[-1] - scenario.times[0]) / timestep)
    return model, exported.controls_at(scenario.times[0] + timestep * (np.arange(steps) + 0.5))


def difference(engine: Any, model: Any, controls: np.ndarray) -> Derivative:
    begin = time.process_time()
    places = [engine.final_place(model, (1 + sign * DIFFERENCE) * controls) for sign in (1, -1)]
    return Derivative((places[0] - places[1]) / (2 * DIFFERENCE), 0.0, time.process_time() - begin)
