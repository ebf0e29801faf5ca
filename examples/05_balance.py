"""Initial configurations of the paper's ball: the centre of mass exactly above or below the centre."""

import jax
import jax.numpy as jnp

from jaxball import balance, simulate
from jaxball.paper.systems import ball as paper_ball
from jaxball.simulation import with_angles

jax.config.update("jax_enable_x64", True)

ball = paper_ball()
balanced = balance(ball, free=[1, 2])
print(balanced.message)
for theta, above in zip(balanced.solutions, balanced.solutions_above, strict=True):
    print(f"  theta[1] = {theta[0]:.12f}, theta[2] = {theta[1]:.12f}: {'above' if above else 'below'}")

rounded = simulate(ball, jnp.array([0.0, 20.0]))
exact = simulate(with_angles(ball, [1, 2], balanced.theta), jnp.array([0.0, 20.0]))
moved = jnp.linalg.norm(exact.state.z[-1] - rounded.state.z[-1])
print(f"rounding theta to four digits moves the final position by {moved:.1e}")

exact.snapshot(0.0).savefig("balanced.png", dpi=150)
print("written: balanced.png")
