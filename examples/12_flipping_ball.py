"""An oblate ball that loses energy to friction falls from rolling like a wheel into flipping over and over.

What decides is its moment of inertia about its axle against that across. Of two balls of the same shape, with the same
start and the same friction, that with the smaller moment about its axle ends by flipping, and the other rolls on.
"""

import tomllib

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxball.files.scenario import read_document
from jaxball.files.scenario.sources import builtin_text

jax.config.update("jax_enable_x64", True)

MOMENTS = {"least about the axle": [1.04, 0.64074, 1.04], "largest about the axle": [0.64074, 1.04, 0.64074]}


def rolled(inertia):
    """The run of the scenario with these moments."""
    document = tomllib.loads(builtin_text("oblate-ball"))
    document["body"]["inertia"] = inertia
    return read_document(document).simulate(throw=True)


def angle(run):
    """Between the axle, E2, and the angular velocity, in degrees."""
    Omega = np.asarray(run.state.Omega)
    return np.rad2deg(np.arccos(np.minimum(np.abs(Omega[:, 1]) / np.linalg.norm(Omega, axis=1), 1.0)))


def lost(run):
    """The energy that friction has taken so far."""
    power = np.asarray(jax.vmap(run.system.dissipation)(jnp.asarray(run.times), run.state))
    return np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(run.times))])


figure = Figure(figsize=(9.0, 3.2), layout="constrained")
left, middle, right = figure.subplots(1, 3)
for name, inertia in MOMENTS.items():
    run = rolled(inertia)
    times, energy, taken = run.times, np.asarray(run.laws.energy), lost(run)
    print(f"{name}: ω at {angle(run)[-1]:.0f} degrees from the axle, {energy[0] - energy[-1]:.2f} J lost, ", end="")
    print(f"{taken[-1]:.2f} J taken by friction")
    (line,) = left.plot(times, angle(run), label=name)
    middle.plot(times, run.state.Lambda[:, 2, 1], linewidth=0.8)
    right.plot(times, energy)
    right.plot(times[::180], (energy[0] - taken)[::180], ".", color=line.get_color(), markersize=6)
left.set(xlabel="$t$ in s", ylabel="from the axle to ω, in degrees", yticks=[0, 30, 60, 90])
middle.set(xlabel="$t$ in s", ylabel="sine of the axle's elevation", ylim=(-1.05, 1.05))
right.set(xlabel="$t$ in s", ylabel="energy in J", ylim=(0, None))
for ax in (left, middle, right):
    ax.margins(x=0)
figure.legend(handles=left.lines, title="moment of inertia", loc="outside lower center", ncols=2, frameon=False)
figure.savefig("flipping-ball.png", dpi=150)
print("written: flipping-ball.png")
