"""Programs of which a GPU's numbers are compared with those of the CPU, to the last bit.

What a program is given was computed by NumPy, and what it returns is what a run returns, so that all arithmetic is that
of runs and of their derivatives. A row of parameters is seven normal deviates.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import jaxball_gradient
import numpy as np
import perturbed
from peers import parameters

import jaxball
from jaxball import BallState, Contact, DiskState, Event, paper, simulate
from jaxball.paper.systems import PAPER_END, PAPER_START
from jaxball.physics import ReleasedState
from jaxball.simulation.solvers import NDF, Adams, Gauss, RadauIIA

TIMES = np.linspace(PAPER_START, PAPER_END, 5)
SHELL: dict[str, Any] = {"mass": 1.0, "inertia": (0.4, 0.5, 0.6)}
BOUNCES = np.linspace(0.0, 8.0, 5)
SEED = 7


class Program(NamedTuple):
    """A function of one row, and what makes the given number of rows, an array for each argument."""

    run: Callable[..., Any]
    rows: Callable[[int], tuple[np.ndarray, ...]]


def numbers(run: jaxball.Trajectory) -> tuple:
    """All that a solve found."""
    return run.state, run.reached, run.status, run.steps, run.rejected, run.events, run.history


def deviates(rows: int) -> np.ndarray:
    """Seven normal deviates in each row; the first rows are the same for any number of them."""
    return np.random.default_rng(SEED).normal(size=(rows, 7))


def turned(rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Versors and angular velocities."""
    return perturbed.initial(rows)


def rolling(**settings: Any) -> Program:
    """The paper's ball with these settings of ``simulate``."""

    def run(q, Omega):
        return numbers(simulate(paper.ball(), TIMES, BallState(q=q, Omega=Omega), **settings))

    return Program(run, turned)


def disk(phi, phidot):
    return numbers(simulate(paper.disk(), TIMES, DiskState(phi=phi, phidot=phidot), rtol=1e-10, atol=1e-10))


def disks(rows: int) -> tuple[np.ndarray, ...]:
    return tuple(0.1 * deviates(rows)[:, :2].T)


def throw(V, Omega, height, times=BOUNCES):
    """Flight, impacts, sliding and rolling."""
    thrown = ReleasedState(BallState(Omega=Omega), V=V, height=height)
    contact = Contact(friction=0.3, static_friction=0.35, restitution=0.6, slowest=0.05)
    return simulate(jaxball.Ball(**SHELL), times, thrown, contact=contact, max_steps=512)


def bouncing(V, Omega, height):
    """All that is known of a throw."""
    return numbers(throw(V, Omega, height))


def throws(rows: int) -> tuple[np.ndarray, ...]:
    x = deviates(rows)
    return (
        np.array([2.0, 0.5, 0.0]) + 0.1 * x[:, :3] * [1, 1, 0],
        np.array([0.0, -8.0, 0.0]) + x[:, 3:6],
        0.5 + abs(x[:, 6]),
    )


def end_derivatives(q, Omega):
    """z(20) by the initial Ω, forwards."""
    return jax.jacfwd(lambda Omega: simulate(paper.ball(), TIMES, BallState(q=q, Omega=Omega)).state.z[-1])(Omega)


def gradient(p):
    """z1(20) and its derivatives with respect to ten parameters, backwards."""
    return jax.value_and_grad(jaxball_gradient.place)(p, 1e-8)


def bodies(rows: int) -> tuple[np.ndarray]:
    factors = np.concatenate([deviates(rows), deviates(rows)[:, :3]], axis=1)
    return (parameters() * (1 + 1e-3 * factors),)


def failing(mass, Omega):
    """Runs that reach their end and runs that do not."""
    ball = jaxball.Ball(mass=mass, inertia=(0.4, 0.5, 0.6), offset=(0.1, 0.0, -0.2))
    return numbers(simulate(ball, TIMES, BallState(Omega=Omega), max_steps=64))


def failures(rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Of five rows, the second has a NaN, the third a negative mass, the fourth turns fast, and the fifth overflows."""
    mass, Omega, kind = np.ones(rows), 0.1 * deviates(rows)[:, :3], np.arange(rows) % 5
    Omega[kind == 1, 0], mass[kind == 2] = np.nan, -1.0
    Omega[kind == 3] += 50.0
    Omega[kind == 4] = 1e100
    return mass, Omega


def push(t, p):
    """A force with every elementary function that equations use, and with angles that need many digits of π."""
    angle = 1e12 * p + t
    return 0.01 * jnp.stack(
        [
            jnp.exp(-t) + jnp.tanh(p) + jnp.cbrt(1.0 + t) + jnp.sin(angle),
            jnp.log1p(t) + jnp.arctan2(p, 1.0 + t) + (1.0 + t) ** p + jnp.cos(angle),
            jnp.sinh(p) - jnp.cosh(p) + jnp.arcsin(p) * jnp.sqrt(1.0 + t),
        ]
    )


def pushed(p):
    ball = jaxball.Ball(**SHELL, force=jaxball.FunctionForce(push, p))
    return numbers(simulate(ball, np.linspace(0.0, 4.0, 5), BallState()))


def pendulum(theta, Omega):
    """A ball with a damped pendulum inside."""
    inside = jaxball.planar_pendulum(0.5, 0.6, drive=jaxball.Spring(0.5) + jaxball.Damper(0.1))
    start = BallState(Omega=Omega, theta=theta, thetadot=np.zeros(1))
    return numbers(simulate(jaxball.Ball(**SHELL, mechanisms=[inside]), TIMES, start))


def quarter_turn(system, t, state):
    return state.q[0]


def arrival(system, t, state):
    return -3.0 - state.z[1]


EVENTS = {"half turn": Event(quarter_turn), "arrival": Event(arrival, direction=1, terminal=True)}
PROGRAMS = {
    "ball, Dopri8, 1e-6": rolling(rtol=1e-6, atol=1e-6),
    "ball, Dopri8, 1e-10": rolling(rtol=1e-10, atol=1e-10),
    "failures": Program(failing, failures),
    "elementary functions": Program(pushed, lambda rows: (np.tanh(deviates(rows)[:, 0]),)),
    "disk": Program(disk, disks),
    "grad": Program(gradient, bodies),
    "slip, flight and impact": Program(bouncing, throws),
    "ball, RadauIIA(5)": rolling(solver=RadauIIA(5), rtol=1e-8, atol=1e-8),
    "jacfwd": Program(end_derivatives, turned),
    "events": rolling(events=EVENTS),
    "ball, Tsit5": rolling(solver=diffrax.Tsit5()),
    "ball as a DAE": rolling(solver=RadauIIA(5), dae=True, rtol=1e-8, atol=1e-8),
    "ball, Adams": rolling(solver=Adams(), rtol=1e-8, atol=1e-8),
    "ball, NDF": rolling(solver=NDF(), rtol=1e-6, atol=1e-6),
    "ball, Gauss": rolling(solver=Gauss(8), rtol=1e-10, atol=1e-10),
    "pendulum": Program(pendulum, lambda rows: (deviates(rows)[:, :1], 0.1 * deviates(rows)[:, 1:4])),
    "ball, Dopri5": rolling(solver=diffrax.Dopri5()),
}


def names() -> list[str]:
    """The programs' names."""
    return list(PROGRAMS)


def outcome(name: str, rows: int) -> tuple[str, list[np.ndarray]]:
    """Who computed the rows, and all numbers of a program."""
    import gpu_timings

    program = PROGRAMS[name]
    lowered = jax.jit(jax.vmap(program.run)).lower(*map(jnp.asarray, program.rows(rows)))
    computed = lowered.compile()(*map(jnp.asarray, program.rows(rows)))
    return gpu_timings.compiler_of(lowered), [np.asarray(leaf) for leaf in jax.tree.leaves(computed)]
