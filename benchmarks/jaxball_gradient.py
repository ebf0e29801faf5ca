"""Where the paper's ball comes to at t = 20, and the derivatives of that with respect to ten parameters, by jaxball."""

from collections.abc import Callable

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from peers import parameters

import jaxball
from jaxball import Ball, BallState, paper, simulate
from jaxball.paper.systems import PAPER_END, PAPER_START
from jaxball.simulation.ensemble import simulate_ensemble

TIMES = (PAPER_START, PAPER_END)


def plain(tolerances: tuple[float, ...]) -> dict[float, Callable[[], np.ndarray]]:
    """For each tolerance, a function that returns z1(20)."""
    return _calls(jaxball.jit(lambda p, tolerance: place(p, tolerance)[None]), tolerances)


def forward(tolerances: tuple[float, ...]) -> dict[float, Callable[[], np.ndarray]]:
    """For each tolerance, a function that returns z1(20) and its derivatives, by forward mode."""

    def both(p, tolerance):
        def along(direction):
            return jax.jvp(lambda p: place(p, tolerance, diffrax.ForwardMode()), (p,), (direction,))

        return jnp.append(*jax.vmap(along, out_axes=(None, 0))(jnp.eye(p.size)))

    return _calls(jaxball.jit(both), tolerances)


def reverse(tolerances: tuple[float, ...]) -> dict[float, Callable[[], np.ndarray]]:
    """The same by reverse mode."""

    def both(p, tolerance):
        return jnp.append(*jax.value_and_grad(place)(p, tolerance))

    return _calls(jaxball.jit(both), tolerances)


def starts(count: int, tolerance: float) -> dict[str, Callable[[], np.ndarray]]:
    """z1(20) of many balls whose parameters are off by up to 1e-3, and that with its derivatives, in an ensemble."""
    off = 1 + 1e-3 * np.random.default_rng(0).uniform(-1, 1, (count, 10))
    p = jnp.asarray(parameters() * off)
    plain = jaxball.jit(lambda p: places(p, tolerance))
    both = jaxball.jit(lambda p: value_and_derivatives(p, tolerance))
    return {"runs": lambda: np.asarray(plain(p)), "gradients": lambda: np.asarray(jnp.column_stack(both(p)))}


def value_and_derivatives(p: jax.Array, tolerance: float) -> tuple:
    """z1(20) of balls with the parameters in each row of ``p``, and its derivatives with respect to the row's own.

    Each derivative is that of a run of its own, which takes less time than several derivatives of one run.
    """
    runs, count = p.shape
    directions = jnp.tile(jnp.eye(count), (runs, 1))
    ends, slopes = jax.jvp(lambda p: places(p, tolerance), (jnp.repeat(p, count, axis=0),), (directions,))
    return ends[::count], slopes.reshape(runs, count)


def places(p: jax.Array, tolerance: float) -> jax.Array:
    """z1(20) of balls with the parameters in each row of ``p``."""
    ball = paper.ball()
    shared = jax.tree.map(lambda _: None, ball)
    axes = eqx.tree_at(_parameters, shared, (0, 0, 0, 0), is_leaf=lambda axis: axis is None)
    run = simulate_ensemble(
        _changed(ball, p),
        TIMES,
        BallState(),
        rtol=tolerance,
        atol=tolerance,
        max_steps=512,
        in_axes=(axes, None),
    )
    return run.trajectory.state.z[:, -1, 0]


def place(p: jax.Array, tolerance: jax.Array, adjoint: diffrax.AbstractAdjoint | None = None) -> jax.Array:
    """z1(20) of the ball with the parameters ``p``."""
    run = simulate(with_parameters(p), TIMES, rtol=tolerance, atol=tolerance, adjoint=adjoint, max_steps=512)
    return run.state.z[-1, 0]


def with_parameters(p: jax.Array) -> Ball:
    """The paper's ball with other masses, inertia and centre of mass of the shell."""
    return _changed(paper.ball(), p)


def _parameters(ball: Ball) -> tuple:
    """What is varied: the masses of the shell and of the moving masses, the inertia and the centre of mass."""
    return ball.mass, ball.groups[0].mass, ball.inertia, ball.offset


def _changed(ball: Ball, p: jax.Array) -> Ball:
    """A ball, or the balls of an ensemble, with the parameters in the last axis of ``p``."""
    n = ball.groups[0].mass.size
    values = p[..., 0], p[..., 1 : n + 1], p[..., n + 1 : n + 4], p[..., n + 4 :]
    return eqx.tree_at(_parameters, ball, values)


def _calls(solve: Callable[..., jax.Array], tolerances: tuple[float, ...]) -> dict[float, Callable[[], np.ndarray]]:
    p = jnp.asarray(parameters())
    arrays = {tolerance: jnp.asarray(tolerance) for tolerance in tolerances}
    return {name: lambda tolerance=array: np.asarray(solve(p, tolerance)) for name, array in arrays.items()}
