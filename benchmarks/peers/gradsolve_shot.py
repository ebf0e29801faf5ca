"""A draw shot in GRADSOLVE: equations of its own, with Coulomb's friction smoothed, by the kernel it makes of them."""

import time
from typing import Any

import gradsolve
import jax.numpy as jnp
import numpy as np

SMOOTHED_OVER = (1e-2, 1e-4, 1e-6)  # m/s


class Shot:
    """Place, velocity and rate of a solid ball; stiff once it rolls, where friction holds it at a small slip."""

    name = "draw_shot"
    dim = 3
    is_stiff = True

    def __init__(self, scenario: Any):
        self.t0, self.t1 = (float(t) for t in scenario.times)
        self.radius = float(scenario.system.radius)
        self.deceleration = float(scenario.contact.friction * scenario.system.gravity)

    def f_jax(self, t, y, p):
        slip = y[1] - self.radius * y[2]
        acceleration = -self.deceleration * slip / jnp.sqrt(slip**2 + p[0] ** 2)
        return jnp.stack([y[1], acceleration, -2.5 * acceleration / self.radius])


def shots(scenario: Any, rows: int, speed: float, tolerance: float) -> tuple[float, int, float]:
    """The place at the end, the steps with those rejected, and the seconds of one of ``rows`` shots.

    Friction is smoothed over ``speed``, in m/s.
    """
    state = scenario.state
    y0 = np.tile([0.0, float(state.V[0]), float(state.body.Omega[1])], (rows, 1))
    accurate = {"rtol": tolerance, "atol": 1e-2 * tolerance}
    begin = time.process_time()
    ended = gradsolve.solve(Shot(scenario), y0, np.full((rows, 1), speed), fused=True, **accurate)
    seconds = (time.process_time() - begin) / rows
    return float(ended.y_final[0, 0]), int(ended.accepted_steps[0] + ended.rejected_steps[0]), seconds
