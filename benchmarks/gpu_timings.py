"""Jobs of ``gpu.py``, each done in a process of its own: what JAX runs on, and how long programs take there."""

import importlib
import shutil
import subprocess
from collections.abc import Callable
from typing import Any, ClassVar

import diffrax
import equinox as eqx
import harness
import jax
import jax.numpy as jnp
import numpy as np
import perturbed
from jaxtyping import Array, Float

from jaxball import AbstractSystem, simulate
from jaxball.paper.systems import PAPER_END, PAPER_START
from jaxball.physics import AbstractState

REPEATS, FEW_REPEATS = 5, 3
ENOUGH = 6.0  # seconds of timed calls
CHECKED = 64  # rows whose errors are measured
QUESTIONS = "name,driver_version,compute_cap,memory.total,clocks.max.sm,power.limit"


class LorenzState(AbstractState):
    """y of Lorenz' equations."""

    y: Float[Array, "3"] = eqx.field(converter=jnp.asarray, default=(1.0, 0.0, 0.0))


class Lorenz(AbstractSystem[LorenzState]):
    """Lorenz' equations with σ = 10 and β = 8/3."""

    rho: Float[Array, ""] = eqx.field(converter=jnp.asarray)

    title: ClassVar[str] = "Lorenz"
    state_type: ClassVar[type[LorenzState]] = LorenzState

    def field(self, t, state):
        x, y, z = state.y
        return LorenzState(jnp.stack([10.0 * (y - x), self.rho * x - y - x * z, x * y - 8.0 / 3.0 * z]))


def device(anything: bool) -> dict:
    """Why there is no GPU, empty where there is one or ``anything`` will do; and else what JAX runs on."""
    try:
        devices = jax.devices()
    except (RuntimeError, AssertionError):  # the latter where JAX_PLATFORMS names what is not installed
        return {"reason": "JAX cannot start a GPU here"}
    if not anything and not {device.platform for device in devices} & {"gpu", "cuda", "rocm"}:
        return {"reason": "JAX finds no GPU here"}
    return {
        "reason": "",
        "device": devices[0].device_kind,
        "platform": devices[0].platform,
        "platform_version": devices[0].client.platform_version,
        "nvidia_smi": _nvidia_smi(),
        **harness.description("gradsolve", "heyoka", "llvmlite"),
    }


def compiler_of(lowered: Any) -> str:
    """Who compiled a lowered program, by the calls in its text: ``jaxball``, or ``XLA``."""
    return "jaxball" if "custom_call @jaxball" in lowered.as_text() else "XLA"


def timings(program: Any, *arguments: Any) -> tuple[dict, Any]:
    """Seconds to compile a jitted function, of its first call after that, and of the best of the next; its result."""
    compile_time, (compiler, call) = harness.timed(lambda: _compiled(program, arguments))
    first, result = harness.timed(lambda: jax.block_until_ready(call(*arguments)))
    return {"compiler": compiler, "compile": compile_time, "first": first, **_best(call, arguments, first)}, result


def batch(place: str, rows: int, tolerances: list[float], cores: int) -> list[dict]:
    """A batch of the paper's balls at each tolerance; ``states`` and ``initial`` are those of the first rows.

    ``place`` is that of a ``turns.Batch``. Where it has a jitted ``program`` for ``given`` arrays, that is compiled
    apart and timed without copies between host and device.
    """
    q, Omega = perturbed.initial(rows)
    module, name = place.split(":")
    solver = getattr(importlib.import_module(module), name)(q, Omega, cores)
    initial = q[:CHECKED], Omega[:CHECKED]
    solve = _timed_program if hasattr(solver, "program") else _timed_batch
    return [{**answer, "rows": rows, "initial": initial} for answer in solve(solver, tolerances)]


def reference(q: np.ndarray, Omega: np.ndarray) -> np.ndarray:
    """(q, Ω, z) at t = 20, to 1e-13."""
    from jaxball_batch import Vmapped

    return Vmapped(q, Omega, 1).final(1e-13)


def lorenz(rows: int, tolerance: float) -> dict:
    """Lorenz' equations for ρ = 0 … 21 by Tsit5, and the median relative error of y(1), as GRADSOLVE measures it."""
    rho = np.linspace(0.0, 21.0, rows)
    found, y = timings(jax.jit(jax.vmap(lambda rho: lorenz_end(rho, tolerance))), jnp.asarray(rho))
    return {**found, "rows": rows, "states": picked(y), "initial": picked(rho)}


def lorenz_gradient(rows: int, tolerance: float) -> dict:
    """The derivatives of |y(1)|² with respect to ρ, each row's own."""

    def loss(rho):
        return jnp.sum(lorenz_end(rho, tolerance) ** 2)

    rho = np.linspace(0.0, 21.0, rows)
    found, slopes = timings(jax.jit(jax.vmap(jax.grad(loss))), jnp.asarray(rho))
    return {**found, "rows": rows, "states": picked(slopes), "initial": picked(rho)}


def lorenz_end(rho, tolerance: float, solver: Any = None):
    """y(1). As in GRADSOLVE's benchmark, the absolute tolerance is a thousandth of the relative one."""
    solver = diffrax.Tsit5() if solver is None else solver
    run = simulate(
        Lorenz(rho), np.array([0.0, 1.0]), solver=solver, rtol=tolerance, atol=1e-3 * tolerance, max_steps=512
    )
    return run.state.y[-1]


def lorenz_reference(rho: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """y(1), and the derivatives of |y(1)|², to 1e-13 by a method of order 8."""

    def end(rho):
        return lorenz_end(rho, 1e-13, diffrax.Dopri8())

    def slope(rho):
        y, tangent = jax.jvp(end, (rho,), (jnp.ones(()),))
        return y, 2 * jnp.sum(y * tangent)

    ends, slopes = jax.jit(jax.vmap(slope))(jnp.asarray(rho))
    return np.asarray(ends), np.asarray(slopes)


def picked(array: Any) -> np.ndarray:
    """Some rows, evenly spaced, from the first to the last."""
    return np.asarray(array[np.linspace(0, len(array) - 1, min(CHECKED, len(array))).round().astype(int)])


def gradient(name: str, rows: int) -> dict:
    """Rows of a program of :data:`DIFFERENTIATED` and their gradients, and the ratio of the two times."""
    run, parameters = DIFFERENTIATED[name](rows)
    plain, _ = timings(jax.jit(jax.vmap(run)), jnp.asarray(parameters))
    both, slopes = timings(jax.jit(jax.vmap(jax.grad(run))), jnp.asarray(parameters))
    unknown = int(np.sum(~np.isfinite(np.asarray(slopes)).reshape(rows, -1).all(axis=1)))
    return {**both, "run": plain, "ratio": both["seconds"] / plain["seconds"], "rows": rows, "unknown": unknown}


def _ball(rows: int) -> tuple[Callable, np.ndarray]:
    import gpu_programs
    import jaxball_gradient

    return lambda p: jaxball_gradient.place(p, jnp.asarray(1e-8)), gpu_programs.bodies(rows)[0]


def _radau(rows: int) -> tuple[Callable, np.ndarray]:
    import gpu_programs
    import jaxball_gradient

    from jaxball.simulation.solvers import RadauIIA

    times = (PAPER_START, PAPER_END)

    def place(p):
        ball = jaxball_gradient.with_parameters(p)
        return simulate(ball, times, solver=RadauIIA(5), rtol=1e-8, atol=1e-8, max_steps=512).state.z[-1, 0]

    return place, gpu_programs.bodies(rows)[0]


def _thrown(rows: int) -> tuple[Callable, np.ndarray]:
    """Where a ball is that is thrown with backspin, by the three components of its angular velocity."""
    import gpu_programs

    V, Omega, height = gpu_programs.throws(rows)

    def place(row):
        return gpu_programs.throw(row[:3], row[3:6], row[6], np.array([0.0, 8.0])).state.z[-1, 0]

    return place, np.column_stack([V, Omega, height])


DIFFERENTIATED = {"ball, Dopri8, 1e-8": _ball, "slip, flight and impact": _thrown, "ball, RadauIIA(5), 1e-8": _radau}


def _compiled(program: Any, arguments: tuple) -> tuple[str, Callable]:
    lowered = program.lower(*arguments)
    return compiler_of(lowered), lowered.compile()


def _best(call: Callable, arguments: tuple, first: float) -> dict:
    """The shortest of some calls; of the first one, if that took long."""
    seconds = [first]
    while len(seconds) <= REPEATS and sum(seconds) < ENOUGH:
        seconds.append(harness.timed(lambda: jax.block_until_ready(call(*arguments)))[0])
    return {"seconds": min(seconds[1:] or seconds), "calls": len(seconds) - 1}


def _timed_program(solver: Any, tolerances: list[float]) -> list[dict]:
    """At all tolerances by one program, which is compiled for the first of them."""
    arguments = [(*solver.given, jnp.asarray(tolerance)) for tolerance in tolerances]
    compile_time, (compiler, call) = harness.timed(lambda: _compiled(solver.program, arguments[0]))
    answers = []
    for tolerance, given in zip(tolerances, arguments, strict=True):
        first, states = harness.timed(lambda given=given: jax.block_until_ready(call(*given)))
        answer = {"compiler": compiler, "compile": compile_time, "first": first, **_best(call, given, first)}
        answers.append({**answer, "tolerance": tolerance, "states": np.asarray(states[:CHECKED, -9:])})
        compile_time = None  # the others need no program of their own
    return answers


def _timed_batch(solver: Any, tolerances: list[float]) -> list[dict]:
    answers = []
    for tolerance in tolerances:
        compile_time = solver.build(tolerance)
        seconds, states = min((solver.solve(tolerance) for _ in range(FEW_REPEATS)), key=lambda solved: solved[0])
        answer = {"compiler": "", "compile": compile_time, "first": None, "seconds": seconds, "calls": FEW_REPEATS}
        answers.append({**answer, "tolerance": tolerance, "states": states[:CHECKED]})
    return answers


def _nvidia_smi() -> dict[str, str]:
    """The card and its driver; empty where there is no such program, or where it fails."""
    if shutil.which("nvidia-smi") is None:
        return {}
    command = ["nvidia-smi", f"--query-gpu={QUESTIONS}", "--format=csv,noheader"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=20)
    except (OSError, subprocess.SubprocessError):
        return {}
    first = done.stdout.splitlines()[0] if done.stdout else ""
    return dict(zip(QUESTIONS.split(","), (part.strip() for part in first.split(",")), strict=False))
