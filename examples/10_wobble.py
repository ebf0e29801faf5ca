"""Where a pendulum-driven robot wobbles: Floquet multipliers over speed and resistance, and runs that confirm them.

The robot is that of the built-in scenario `roboball`, but with three unequal moments of inertia, of which the one about
the hinge is the smallest. At each speed, the voltage is chosen such that motor and resistance to rolling balance. The
numbers are our own. With `--fine` the charts have the resolution of the documentation's figure and take some minutes.
"""

import sys

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from matplotlib.figure import Figure

from jaxball import Ball, BallState, Resistance, planar_pendulum, plot
from jaxball.analysis.stability import floquet_chart
from jaxball.physics import SpeedLimitedMotor
from jaxball.programs import cpu
from jaxball.simulation.ensemble import simulate_ensemble

cpu.prepare()
jax.config.update("jax_enable_x64", True)

MOMENTS = (0.7, 0.3, 0.5)  # about the axes of the body; the second is the hinge's
WEIGHT, LENGTH, GRAVITY, STALL, FREE_SPEED = 0.8, 0.5, 10.0, 3.0, 4.0
SPEEDS = np.linspace(0.5, 4.0, 71 if "--fine" in sys.argv else 15)
ROLLING = np.linspace(0.0, 0.7, 36 if "--fine" in sys.argv else 8)
SPINNING = np.linspace(0.0, 0.35, 36 if "--fine" in sys.argv else 8)
TURNS = 24  # in a run
SLIGHT = 0.1  # the resistance to rolling where the resistance to spinning is varied


def robot(speed, rolling, spinning: ArrayLike = 0.0):
    """A robot that can roll at this angular velocity, and the state in which it does, the pendulum at rest."""
    torque = rolling * speed
    motor = SpeedLimitedMotor(-(speed / FREE_SPEED + torque / STALL), STALL, FREE_SPEED)
    ahead = jnp.arcsin(torque / (WEIGHT * GRAVITY * LENGTH))
    ball = Ball(
        mass=1.0,
        inertia=MOMENTS,
        gravity=GRAVITY,
        mechanisms=[planar_pendulum(WEIGHT, LENGTH, drive=motor)],
        resistance=Resistance(rolling=rolling, spinning=spinning),
    )
    return ball, BallState(Omega=speed * jnp.eye(3)[1], theta=-ahead[None], thetadot=-speed[None])


def over_rolling(rolling, speed):
    return *robot(speed, rolling), 2 * jnp.pi / speed


def over_spinning(spinning, speed):
    return *robot(speed, jnp.full_like(speed, SLIGHT), spinning), 2 * jnp.pi / speed


def growth(times, deviations):
    """The largest growth rate of three multipliers fitted to the deviations at multiples of a period.

    A sum of three geometric sequences obeys d[k + 3] = a d[k + 2] + b d[k + 1] + c d[k] (Prony's method). The fit
    omits the start, where more multipliers contribute, and deviations beyond the linear range or near rounding.
    """
    size = np.linalg.norm(deviations, axis=1)
    end = np.flatnonzero((size > 1e-9) & (np.maximum.accumulate(size) < 3e-3))[-1] + 1
    start = min(6, end - 8)
    shifted = np.stack([deviations[start + k : end - 3 + k] / size[start : end - 3, None] for k in range(4)])
    coefficients = np.linalg.lstsq(shifted[:3].reshape(3, -1).T, shifted[3].ravel(), rcond=1e-3)[0]
    multipliers = np.roots([1.0, *-coefficients[::-1]])
    return np.log(np.max(np.abs(multipliers))) / (times[1] - times[0])


def simulated(speeds, rolling, spinning):
    """The growth rates observed in runs of the full state, each from a state near steady rolling.

    Deviations are measured in quantities that, in steady rolling, are the same at all multiples of the period, whatever
    the phase.
    """
    robots, states = jax.vmap(robot)(*map(jnp.asarray, (speeds, rolling, spinning)))
    tilted = jnp.zeros_like(states.q).at[:, :2].set(jnp.array([1.0, 5e-6]))
    states = BallState(tilted, states.Omega * (1 + 1e-5), states.z, states.theta, states.thetadot)
    times = 2 * np.pi / speeds[:, None] * np.arange(TURNS + 1)
    run = simulate_ensemble(robots, times, states, rtol=1e-13, atol=1e-13).trajectory
    assert np.all(run.status == 0)
    q, Omega, thetadot = map(np.asarray, (run.state.q, run.state.Omega, run.state.thetadot[..., 0]))
    height = 2 * (q[..., 2] * q[..., 3] + q[..., 0] * q[..., 1])  # of the hinge's end, over r
    along = [Omega[..., 1] - speeds[:, None], thetadot + speeds[:, None]]
    deviations = np.stack([height, Omega[..., 0], Omega[..., 2], *along], axis=-1)
    return np.array([growth(*row) for row in zip(times, deviations, strict=True)])


MARKS = {"run grew": {"marker": "^", "mfc": "black"}, "run decayed": {"marker": "o", "mfc": "none"}}
STUDIES = {
    "rolling": (over_rolling, ROLLING, lambda values: (values, np.zeros_like(values))),
    "spinning": (over_spinning, SPINNING, lambda values: (np.full_like(values, SLIGHT), values)),
}
figure = Figure(figsize=(9.0, 3.8), layout="constrained")
for ax, (name, (make, values, resistances)) in zip(figure.subplots(1, 2), STUDIES.items(), strict=True):
    chart = floquet_chart(make, {name: values, "speed": SPEEDS})
    assert chart["closed"].all()
    assert (chart["least_normal_force"] > 0).all()
    told = chart["growth"].values
    down, across = len(values) // 4, len(SPEEDS) // 10
    some = chart.isel({name: slice(down // 2, None, down), "speed": slice(across // 2, None, across)})
    of_some, speeds = (grid.ravel() for grid in np.meshgrid(some[name], some["speed"], indexing="ij"))
    expected, seen = some["growth"].values.ravel(), simulated(speeds, *resistances(of_some))
    clear = np.abs(expected) > 0.01
    apart = np.abs(seen / expected - 1)[clear]
    print(
        f"resistance to {name}: of {told.size} cells {np.sum(told > 1e-6)} are unstable, by up to {np.max(told):.4f};"
    )
    same = np.sum((seen * expected > 0)[clear])
    print(f"  {np.sum(clear)} runs at rates above 0.01 in magnitude: {same} have the same sign,")
    print(f"  half agree to {np.median(apart):.1e}, nine in ten to {np.quantile(apart, 0.9):.1e}", flush=True)
    assert np.all((seen * expected > 0)[clear])
    assert np.median(apart) < 1e-2

    plot.chart(chart, ax, largest=0.2)
    for label, grew in zip(MARKS, (seen > 0, seen <= 0), strict=True):
        ax.plot(speeds[grew], of_some[grew], color="black", ms=3.5, mew=0.7, ls="none", label=label, **MARKS[label])
    ax.set(xlabel="angular velocity of rolling", ylabel=f"resistance to {name}")
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False, prop={"family": "STIXGeneral"})
figure.savefig("roboball_wobble.png", dpi=200)
