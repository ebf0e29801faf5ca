"""Where the paper's ball comes to at t = 20, and the derivatives of that with respect to ten parameters, by jaxball."""

from collections.abc import Callable

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from peers.paper_numbers import parameters

from jaxball import Ball, paper, simulate

TIMES = (paper.START, paper.END)


def plain(tolerances: tuple[float, ...]) -> dict[float, Callable[[], np.ndarray]]:
    """For each tolerance, a function that returns z1(20)."""
    return _calls(jax.jit(lambda p, tolerance: place(p, tolerance)[None]), tolerances)


def forward(tolerances: tuple[float, ...]) -> dict[float, Callable[[], np.ndarray]]:
    """For each tolerance, a function that returns z1(20) and its derivatives, by forward mode."""

    def both(p, tolerance):
        value, change = jax.linearize(lambda p: place(p, tolerance, diffrax.ForwardMode()), p)
        return jnp.append(value, jax.vmap(change)(jnp.eye(p.size)))

    return _calls(jax.jit(both), tolerances)


def reverse(tolerances: tuple[float, ...]) -> dict[float, Callable[[], np.ndarray]]:
    """The same by reverse mode."""

    def both(p, tolerance):
        return jnp.append(*jax.value_and_grad(place)(p, tolerance))

    return _calls(jax.jit(both), tolerances)


def place(p: jax.Array, tolerance: jax.Array, adjoint: diffrax.AbstractAdjoint | None = None) -> jax.Array:
    """z1(20) of the ball with the parameters ``p``."""
    run = simulate(with_parameters(p), TIMES, rtol=tolerance, atol=tolerance, adjoint=adjoint, max_steps=512)
    return run.state.z[-1, 0]


def with_parameters(p: jax.Array) -> Ball:
    """The paper's ball with other masses, inertia and centre of mass of the shell."""
    ball = paper.ball()
    n = ball.n_masses
    (group,) = ball.groups
    assert group.mass.shape == (n,)
    return eqx.tree_at(
        lambda b: (b.mass, b.groups[0].mass, b.inertia, b.offset),
        ball,
        (p[0], p[1 : n + 1], p[n + 1 : n + 4], p[n + 4 :]),
    )


def _calls(solve: Callable[..., jax.Array], tolerances: tuple[float, ...]) -> dict[float, Callable[[], np.ndarray]]:
    p = jnp.asarray(parameters())
    arrays = {tolerance: jnp.asarray(tolerance) for tolerance in tolerances}
    return {name: lambda tolerance=array: np.asarray(solve(p, tolerance)) for name, array in arrays.items()}
