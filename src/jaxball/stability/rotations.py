"""Permanent rotations: a ball that rests, or spins in place about the vertical."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Float

from ..interface.arguments import require
from ..numerics import programs
from ..numerics.arrays import Numbers, to_array, to_numpy
from ..physics.body import Ball
from ..physics.state import ReducedState
from ..physics.system import vector_field
from .steady import SteadyMotion, require_prescribed, stability

STARTS = 128
SAME = 1e-6


def permanent_rotations(
    ball: Ball, rate: float = 0.0, *, guess: Numbers | None = None, t: Numbers = 0.0
) -> tuple[SteadyMotion, ...]:
    """The directions Γ about which ``ball`` can rotate forever at ``rate`` with its contact point at rest.

    For these, Ω = ω Γ, so that Γ̇ = 0, and Ω̇ = 0 is solved for Γ by Newton's method from many points of the sphere at
    once. With ``rate`` zero these are the equilibria, where the centre of mass is above or below the geometric centre.
    Where the directions are not isolated, as on a cone about the axis of a body of revolution, many of them are found.

    **Arguments:**

    - ``rate``: ω, in rad per time.
    - ``guess``: directions from which to search instead, shape (n, 3).
    - ``t``: the time at which schedules are read; the masses must be at rest in the ball.

    **Returns:** the motions found, each once, the most stable first.

    **Raises:** ``ValueError`` where a force acts, masses are driven by a feedback law, or ``guess`` has another shape.

    **Example:**

    >>> from jaxball import Ball
    >>> from jaxball.stability import permanent_rotations
    >>> ball = Ball(mass=1.0, inertia=(0.4, 0.5, 0.6), offset=(0.0, 0.0, -0.2))
    >>> [(motion.kind, round(float(motion.state.Gamma[2]), 6)) for motion in permanent_rotations(ball)]
    [('centre', 1.0), ('saddle', -1.0)]
    """
    require("ball", ball, Ball, "a Ball")
    require_prescribed(ball)
    starts = _sphere(STARTS) if guess is None else np.atleast_2d(to_numpy(guess, "guess"))
    if starts.shape[1:] != (3,):
        raise ValueError(f"Argument `guess` must be directions of shape (n, 3), but its shape is {starts.shape}.")
    ends = np.asarray(_search(ball, to_array(rate), to_array(t), to_array(starts)))
    distinct: list[np.ndarray] = []
    for Gamma in ends[np.all(np.isfinite(ends), axis=1)]:
        if all(np.max(np.abs(Gamma - other)) > SAME for other in distinct):
            distinct.append(Gamma)
    motions = [stability(ball, ReducedState(rate * Gamma, Gamma), t=t) for Gamma in distinct]
    return tuple(sorted((motion for motion in motions if motion.steady), key=lambda motion: motion.growth))


@programs.filter_jit
def _search(ball: Ball, rate, t, starts) -> Float[Array, "n 3"]:
    prepared = ball.prepare()

    def residual(Gamma, _: Any):
        rates = vector_field(prepared, t, ReducedState(rate * Gamma, Gamma))
        # Γ·BΩ̇ = 0 for every Γ, so that the sum is zero only where both terms are.
        return rates.Omega + Gamma * (jnp.sum(Gamma**2) - 1)

    def one(start):
        newton = optimistix.Newton(rtol=1e-13, atol=1e-13)
        Gamma = optimistix.root_find(residual, newton, start, max_steps=60, throw=False).value
        return Gamma / jnp.sqrt(jnp.sum(Gamma**2))

    return jax.vmap(one)(starts / jnp.sqrt(jnp.sum(starts**2, axis=1))[:, None])


def _sphere(count: int) -> np.ndarray:
    """Points that cover the sphere evenly, on a golden spiral."""
    height = 1 - (2 * np.arange(count) + 1) / count
    azimuth = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=1)
