"""A particle with dz/dt = y dx/dt by two principles, as in a figure in the paper's source.

The Lagrange-d'Alembert principle of mechanics constrains the variations; the vakonomic principle of optimal control
makes the action stationary among the curves that satisfy the constraint.
"""

import jax
import jax.numpy as jnp
from matplotlib.figure import Figure

from jaxball import plot, simulate
from jaxball.physics.classical import NonholonomicParticle, ParticleState, VakonomicParticle, VakonomicState

jax.config.update("jax_enable_x64", True)

times = jnp.linspace(0.0, 1.0, 101)
start = {"x": 1.0, "y": 1.0, "xdot": 1.0, "ydot": 1.0}
mechanical = simulate(NonholonomicParticle(), times, ParticleState(**start), throw=True)
vakonomic = simulate(VakonomicParticle(), times, VakonomicState(**start), throw=True)

exact = mechanical.system.solution(times[-1], ParticleState(**start), times[0])
print("                    x(1)          y(1)          p_y(1)")
for name, state in (("Lagrange-d'Alembert", mechanical.state), ("vakonomic", vakonomic.state)):
    print(f"{name:19} {state.x[-1]:.10f}  {state.y[-1]:.10f}  {state.ydot[-1]:.10f}")
print(f"{'closed form':19} {exact.x:.10f}  {exact.y:.10f}  {exact.ydot:.10f}")

figure = Figure(figsize=(9.0, 2.9), layout="constrained")
plot.caption(figure, title="A particle with dz/dt = y dx/dt")
for ax, (name, label) in zip(figure.subplots(1, 3), {"x": "$x$", "y": "$y$", "ydot": "$p_y$"}.items(), strict=True):
    ax.plot(times, getattr(mechanical.state, name), label="Lagrange-d'Alembert")
    ax.plot(times, getattr(vakonomic.state, name), "--", label="vakonomic")
    ax.set(xlabel="$t$", ylabel=label)
    ax.margins(x=0)
figure.legend(handles=figure.axes[0].lines, loc="outside lower center", ncols=2, frameon=False)
figure.savefig("two_principles.png", dpi=150)
print("written: two_principles.png")
