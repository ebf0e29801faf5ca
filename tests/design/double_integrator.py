"""The problems that several tests solve: a state that is accelerated at will."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxball.studies.design import optimal_control
from jaxball.studies.design.optimal_control.problem import Path


class Timed(optimal_control.AbstractControlProblem):
    """From ``start`` to ``end`` by one control."""

    start: Float[Array, ""]
    end: Float[Array, ""]

    controls = 1

    @property
    def softness(self):
        return jnp.zeros(())


class Double(Timed):
    """ẍ = u from rest at 0 to rest at ``far``, with the least mean of u²: u = far (6 − 12 t), x = far (3t² − 2t³)."""

    far: Float[Array, ""]

    @property
    def initial(self):
        return jnp.zeros(2)

    def rate(self, t, x, u):
        return jnp.stack([x[1], u[0]])

    def cost(self, t, x, u):
        return u[0] ** 2

    def conditions(self, x):
        return x - jnp.stack([self.far, jnp.zeros(())])


def still(collocation):
    """The path that stays at the start."""
    initial = np.asarray(collocation.problem.initial)
    knots, nodes, controls = collocation.shapes[:3]
    return Path(collocation.mesh, np.broadcast_to(initial, knots), np.broadcast_to(initial, nodes), np.zeros(controls))
