"""A thousand balls at once: vmap over the mass and the radius of a rail."""

import jax
import jax.numpy as jnp
from matplotlib.figure import Figure

from jaxball import Ball, Circle, ConstantRate, OnRail, PointMass, Status, simulate

jax.config.update("jax_enable_x64", True)

times = jnp.linspace(0.0, 5.0, 26)


@jax.jit
@jax.vmap
def sweep(mass, radius):
    """The final position of each ball, the friction it needs, and the status of its solve."""
    driver = PointMass(mass, OnRail(Circle(radius), ConstantRate(-jnp.pi / 2, 0.7)))
    trajectory = simulate(Ball(mass=1.0, inertia=(0.5, 0.5, 0.5), masses=[driver]), times, rtol=1e-8, atol=1e-8)
    return trajectory.state.z[-1], trajectory.friction_needed, trajectory.status


mass, radius = (x.ravel() for x in jnp.meshgrid(jnp.linspace(0.1, 1.0, 40), jnp.linspace(0.2, 0.9, 25)))
z, friction, status = sweep(mass, radius)
print(f"{int(jnp.sum(status == Status.SUCCESS))} of {status.size} solves reached the end")
best = int(jnp.argmax(jnp.abs(z[:, 0])))
print(f"the farthest rolls {z[best, 0]:.4f} with m = {mass[best]:.3f} at {radius[best]:.3f}, mu = {friction[best]:.3f}")

figure = Figure(figsize=(5.0, 3.6), layout="constrained")
ax = figure.subplots()
shape = (25, 40)
filled = ax.contourf(mass.reshape(shape), radius.reshape(shape), jnp.abs(z[:, 0]).reshape(shape), levels=20)
figure.colorbar(filled, label="distance at $t = 5$")
ax.set(xlabel="mass", ylabel="radius of the rail")
figure.savefig("distances.png", dpi=150)
print("written: distances.png")
