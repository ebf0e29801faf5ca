"""A ball with one mass driven round a circle: build it, simulate it and look at the motion."""

import jax
import jax.numpy as jnp

from jaxball import Ball, Circle, ConstantRate, OnRail, PointMass, simulate

jax.config.update("jax_enable_x64", True)

driver = PointMass(mass=0.3, motion=OnRail(Circle(radius=0.6), ConstantRate(theta=-jnp.pi / 2, rate=0.5)))
ball = Ball(mass=1.0, inertia=(0.6, 0.6, 0.6), masses=[driver])

trajectory = simulate(ball, jnp.linspace(0.0, 10.0, 201))
print(trajectory)

observables = trajectory.observables
print(f"least normal force     {observables.normal_force.min():.6f}")
print(f"friction needed, mu    {trajectory.friction_needed:.6f}")
print(f"energy supplied        {observables.energy[-1] - observables.energy[0]:.6f}")

trajectory.snapshot().savefig("first_ball.png", dpi=150)
trajectory.view("first_ball.html", title="A first ball")
print("written: first_ball.png, first_ball.html")
