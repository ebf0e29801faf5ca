"""The least value of a function along a solve, and that of the normal force."""

from collections.abc import Callable
from typing import Any

import diffrax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..body import System
from ..contact import total_inertial_force
from ..dynamics import driven_angles, vector_field
from ..moments import moments
from ..solvers.wrapping import AbstractWrappingSolver
from ..state import State
from ..vectors import dot

Watch = Callable[[Float[Array, ""], Float[Array, " size"], Any], Float[Array, ""]]


class Watching(AbstractWrappingSolver):
    """``solver``, with the least value of ``of(t, x, args)`` at the ends of its steps in its state."""

    solver: diffrax.AbstractSolver  # pyright: ignore[reportIncompatibleVariableOverride]
    of: Watch

    def init(self, terms, t0, t1, y0, args):
        return self.solver.init(terms, t0, t1, y0, args), self.of(t0, y0[0], args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        inner, least = solver_state
        y1, y_error, dense, inner, result = self.solver.step(terms, t0, t1, y0, args, inner, made_jump)
        return y1, y_error, dense, (inner, jnp.minimum(least, self.of(t1, y1[0], args))), result


def normal_force(system: System, t: Float[Array, ""], state: State) -> Float[Array, ""]:
    """N of a body in any kind of state: Γ · Σ m a + M g − Fe · e3, as in :func:`jaxball.contact.contact_force`."""
    at = moments(system, t, driven_angles(system, t, state))
    Omegadot = vector_field(system, t, state).Omega
    inertial = total_inertial_force(at, system.radius, state.Gamma, state.Omega, Omegadot)
    N = dot(state.Gamma, inertial) + at.M * system.gravity
    return N if system.force is None else N - system.force(t)[2]
