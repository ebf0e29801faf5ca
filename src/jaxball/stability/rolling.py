"""Steady rolling in circles: a body of revolution at a constant inclination."""

import jax.numpy as jnp
import numpy as np

from ..interface.arguments import require
from ..numerics.arrays import Numbers, to_array
from ..physics.body import Ball
from ..physics.moments import moments
from ..physics.state import ReducedState
from .steady import SteadyMotion, require_prescribed, stability

ROUND = 1e-9


def steady_rolling(ball: Ball, inclination: float, precession: float, *, t: Numbers = 0.0) -> SteadyMotion:
    """The Routh sphere's steady motion: its axis E3 precesses about the vertical at a constant inclination.

    With Γ = (sin ϑ, 0, cos ϑ) and Ω = P Γ + σ E3, the balance of angular momentum about the centre of mass, where the
    contact force follows from the centre of mass's own circle, gives the spin σ relative to the plane through E3 and
    the vertical:

        P [ C + M r (r + ℓ cos ϑ) ] σ = M ℓ [ g + P² (r + ℓ cos ϑ) ] + P² (A − C) cos ϑ

    with A and C the moments about the centre of mass, across E3 and along it, and ℓ the height of the centre of mass on
    E3. In the body, Ω and Γ turn about E3 at −σ. The geometric centre moves on a circle of radius r |σ sin ϑ / P|.

    **Arguments:**

    - ``ball``: a body of revolution about E3.
    - ``inclination``: ϑ, from E3 to the vertical, in rad.
    - ``precession``: P, the rate of precession of E3 about the vertical, in rad per time; not zero.
    - ``t``: the time at which schedules are read; the masses must be at rest in the ball.

    **Raises:** ``ValueError`` when the ball is not a body of revolution about E3, when masses are driven by a feedback
    law, and for zero precession.

    **Example:**

    >>> from jaxball import Ball
    >>> from jaxball.stability import steady_rolling
    >>> sphere = Ball(mass=1.0, inertia=(0.4, 0.4, 0.5), offset=(0.0, 0.0, -0.2))
    >>> steady_rolling(sphere, inclination=0.5, precession=1.0).message
    'The motion is spectrally stable, a centre: its eigenvalues are all on the imaginary axis.'
    """
    require("ball", ball, Ball, "a Ball")
    require_prescribed(ball)
    if precession == 0:
        raise ValueError(
            "Argument `precession` must not be zero, because the ball would then rest or roll in a straight line."
        )
    nothing = jnp.zeros((0,))
    at = moments(ball.prepare(), to_array(t), (nothing, nothing, nothing))
    p, J, M = np.asarray(at.p), np.asarray(at.J), float(at.M)
    across = np.abs(np.concatenate([p[:2], J[np.triu_indices(3, 1)], [J[0, 0] - J[1, 1]]]))
    if np.max(across) > ROUND * max(float(np.max(np.abs(J))), M * float(ball.radius)):
        raise ValueError(
            "Argument `ball` must be a body of revolution about E3, with equal moments across it and the centre of "
            f"mass on it, but its moments are {J.tolist()} and its centre of mass is at {(p / M).tolist()}."
        )
    r, g, height = float(ball.radius), float(ball.gravity), p[2] / M
    A, C = J[0, 0] - M * height**2, J[2, 2]
    s, c = np.sin(inclination), np.cos(inclination)
    arm = r + height * c
    numerator = M * height * (g + precession**2 * arm) + precession**2 * (A - C) * c
    spin = float(numerator / (precession * (C + M * r * arm)))
    Gamma = np.array([s, 0.0, c])
    Omega = precession * Gamma + np.array([0.0, 0.0, spin])
    return stability(ball, ReducedState(Omega, Gamma), turning=-spin, t=t)
