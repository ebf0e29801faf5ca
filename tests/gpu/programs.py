"""Programs of all kinds, each mapped over rows."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from jaxball import (
    Ball,
    Circle,
    Contact,
    Disk,
    DiskState,
    Event,
    OnRail,
    PointMass,
    Pulse,
    SphericalFrame,
    simulate,
)
from jaxball.simulation.ensemble import REDUCTIONS, simulate_ensemble
from jaxball.simulation.solvers import NDF, Adams, Gauss, RadauIIA

ROWS = 19  # more than a block of the CPU's, and no multiple of one
END = 3.0


def ball(radius: Any) -> Ball:
    rail = Circle(radius, frame=SphericalFrame(azimuth=0.3, elevation=0.5))
    return Ball(mass=1.0, inertia=(0.9, 1.0, 1.1), masses=[PointMass(0.5, OnRail(rail, Pulse(0.8, height=2.0)))])


def run(radius: Any, **options: Any) -> Any:
    return simulate(ball(radius), jnp.linspace(0.0, END, 4), **options)


def height(radius: Any, **options: Any) -> Any:
    return jnp.sum(run(radius, **options).state.z[-1])


def disk(**options: Any) -> Callable[[Any], Any]:
    def of(speed: Any) -> Any:
        start = DiskState(phidot=-speed)
        return simulate(Disk(mass=1.0, inertia=0.5), jnp.linspace(0.0, END, 4), start, **options)

    return of


def sliding(friction: Any) -> Any:
    start = DiskState(phidot=-3.0)
    contact = Contact(friction=friction)
    masses = [PointMass(0.5, OnRail(Circle(0.6), Pulse(0.8, height=4.0)))]
    return simulate(Disk(mass=1.0, inertia=0.5, masses=masses), jnp.linspace(0.0, END, 4), start, contact=contact)


def with_reductions(speeds: Any) -> Any:
    """One reduction of each kind: a least value, an integral and the largest change."""
    system, starts = Disk(mass=1.0, inertia=0.5), jax.vmap(lambda speed: DiskState(phidot=-speed))(speeds)
    found = {name: REDUCTIONS[name] for name in ("least_normal_force", "distance", "energy_drift")}
    return simulate_ensemble(system, jnp.linspace(0.0, END, 4), starts, reductions=found, in_axes=(None, 0))


RADII = jnp.linspace(0.5, 0.95, ROWS)
# The last ones take more steps than there may be, and one row is not a number.
TOLERANCES = 10.0 ** -jnp.linspace(5.0, 13.0, ROWS)
SPEEDS = jnp.linspace(-1.0, 2.0, ROWS)


def reaching(level: float) -> Callable[[Any], Any]:
    return disk(events={"there": Event(lambda system, t, state: state.z - level, terminal=True)})


def mapped(function: Callable[..., Any], *rows: Any) -> Callable[[], Any]:
    return lambda: jax.vmap(function)(*rows)


PROGRAMS: dict[str, Callable[[], Any]] = {
    "Dopri8": mapped(lambda r, tol: run(r, rtol=tol, atol=tol, max_steps=12), RADII.at[3].set(jnp.nan), TOLERANCES),
    "Gauss": mapped(lambda r: run(r, solver=Gauss(8)), RADII),
    "Adams": mapped(lambda r: run(r, solver=Adams(), rtol=1e-7, atol=1e-7), RADII),
    "NDF": mapped(lambda r: run(r, solver=NDF(), rtol=1e-5, atol=1e-5), RADII),
    "RadauIIA as a DAE": mapped(lambda r: run(r, solver=RadauIIA(5), dae=True), RADII),
    "a disk": mapped(disk(), SPEEDS),
    "an event": mapped(reaching(3.0), SPEEDS),
    "slip and flight": mapped(sliding, jnp.linspace(0.05, 1.0, ROWS)),
    "jacfwd": mapped(jax.jacfwd(height), RADII),
    "grad": mapped(jax.grad(height), RADII),
    "float32": mapped(lambda r: run(r, rtol=1e-4, atol=1e-4), RADII.astype(jnp.float32)),
    "an ensemble": lambda: with_reductions(SPEEDS),
}
