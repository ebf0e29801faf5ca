"""The paper's ball as an ODE and as a DAE by several solvers at the paper's tolerance: do they agree?"""

import diffrax
import jax
import numpy as np

import jaxball.programs.cpu

jaxball.programs.cpu.prepare()  # before the first array is created: faster solves and faster compilation
jax.config.update("jax_enable_x64", True)

from jaxball import paper, simulate  # noqa: E402
from jaxball.paper import reference  # noqa: E402
from jaxball.simulation.solvers import Gauss, RadauIIA, Trapezoidal  # noqa: E402

RUNS = [
    ("Dopri8", diffrax.Dopri8(), "ODE"),
    ("Gauss, 8 stages", Gauss(stages=8), "ODE"),
    ("Radau IIA, 3 stages", RadauIIA(stages=3), "ODE"),
    ("Radau IIA, 7 stages", RadauIIA(stages=7), "DAE"),
    ("trapezoidal rule", Trapezoidal(), "ODE"),
]

solution = reference.ball()
exact = np.concatenate([solution.columns(symbol) for symbol in ("q", "Omega", "z")], axis=1)
ball, tolerance = paper.ball(), paper.BALL_TOLERANCE

print(f"{'solver':20} form  steps  rejected  difference  |q| - 1")
for name, solver, form in RUNS:
    trajectory = simulate(
        ball,
        solution.times,
        solver=solver,
        rtol=tolerance,
        atol=tolerance,
        dae=form == "DAE",
        step_to_times=True,
        throw=True,
    )
    state = trajectory.state
    computed = np.concatenate([state.q, state.Omega, state.z], axis=1)
    difference = np.max(np.abs(computed - exact))
    norm = np.max(np.abs(np.linalg.norm(state.q, axis=1) - 1))
    counts = f"{int(trajectory.steps):5}  {int(trajectory.rejected):8}"
    print(f"{name:20} {form}  {counts}  {difference:10.1e}  {norm:7.0e}")
