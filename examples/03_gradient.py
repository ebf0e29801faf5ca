"""How far a ball rolls, and how this depends on its rail: derivatives through the solve."""

import diffrax
import jax
import jax.numpy as jnp

from jaxball import Ball, Ellipse, OnRail, PointMass, Pulse, SphericalFrame, simulate

jax.config.update("jax_enable_x64", True)

times = jnp.array([0.0, 4.0])


def distance(semi_axes, adjoint=None):
    """The distance of the ball from its starting point at t = 4."""
    rail = Ellipse(semi_axes, frame=SphericalFrame(azimuth=0.4, elevation=0.2))
    mass = PointMass(0.5, OnRail(rail, Pulse(theta=0.8, height=3.0)))
    ball = Ball(mass=1.0, inertia=(0.6, 0.6, 0.7), masses=[mass])
    z = simulate(ball, times, adjoint=adjoint).state.z[-1]
    return jnp.sqrt(jnp.sum(z**2))


semi_axes = jnp.array([0.8, 0.5])
value, reverse = jax.jit(jax.value_and_grad(distance))(semi_axes)
forward = jax.jit(jax.jacfwd(lambda a: distance(a, diffrax.ForwardMode())))(semi_axes)
print(f"distance               {value:.10f}")
print(f"gradient, reverse mode {reverse}")
print(f"gradient, forward mode {forward}")
assert jnp.allclose(reverse, forward, rtol=1e-6)
