"""Your own rail and feedback law: a mass moves along a trefoil knot, and the law damps its motion."""

import jax
import jax.numpy as jnp

from jaxball import Ball, BallState, Driven, FunctionLaw, FunctionRail, PointMass, simulate

jax.config.update("jax_enable_x64", True)


def trefoil(theta, size):
    """A closed knot inside the shell."""
    return size * jnp.stack(
        [
            jnp.sin(theta) + 2 * jnp.sin(2 * theta),
            jnp.cos(theta) - 2 * jnp.cos(2 * theta),
            -jnp.sin(3 * theta),
        ]
    )


def brake(t, state, gain):
    """The second derivative of theta, which damps the mass's motion along its rail."""
    return -gain * state.thetadot


ball = Ball(
    mass=1.0,
    inertia=(0.5, 0.6, 0.7),
    masses=[PointMass(0.4, Driven(FunctionRail(trefoil, jnp.array(0.25), closed_after=2 * jnp.pi)))],
    law=FunctionLaw(brake, jnp.array(0.8)),
)
start = BallState(theta=[0.3], thetadot=[2.0])
trajectory = simulate(ball, jnp.linspace(0.0, 8.0, 161), start)
print(trajectory)
print(f"theta at the end       {trajectory.state.theta[-1, 0]:.8f}")
print(f"limit 0.3 + 2.0 / 0.8  {0.3 + 2.0 / 0.8 * (1 - jnp.exp(-0.8 * 8.0)):.8f}")

trajectory.snapshot().savefig("trefoil.png", dpi=150)
trajectory.view("trefoil.html", title="A mass on a trefoil knot")
print("written: trefoil.png, trefoil.html")
