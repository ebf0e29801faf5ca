"""The force of the ground on a body that rolls, slides or flies, and when it switches between these.

Coulomb's law: a ground that presses with N > 0 holds a body that does not slip by any friction |f| ≤ μ N, with the
static coefficient; on one that slips with v_s friction is −μ N σ with σ = v_s/|v_s|, with the sliding coefficient. All
forces and accelerations are in contact axes, of which e3 is the normal, and follow from the ``Response`` of the body.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.directions import Direction, diverging
from ...numerics.vectors import apply, root
from .released import Response


class Interaction(NamedTuple):
    """The reaction R of the ground, and the slip acceleration v̇_s that it leaves.

    ``normal`` is the normal force with which dry rolling friction is computed. ``solvability`` is the upward
    acceleration by a unit of normal force with its friction, relative to that without friction: where it is not
    positive, the normal force has no solution (Painlevé's paradox), and these numbers mean nothing.
    """

    R: Float[Array, "3"]
    slip_acceleration: Float[Array, "3"]
    normal: Float[Array, ""]
    solvability: Float[Array, ""]


def rolling(response: Response) -> Interaction:
    """Computes the reaction that keeps v_s constant, whatever friction it needs; without dry rolling friction where N <
    0.
    """
    R, still = response.rolling.reaction, jnp.zeros_like(response.free)
    if response.rubbing is None:
        return Interaction(R, still, jnp.maximum(R[2], 0.0), jnp.ones_like(R[2]))
    # Where a unit of N would add more than itself to N, there is no solution, and NaN ends the run. The ground does not
    # pull, and dry friction would drive the body if N were negative.
    solvability = 1 - response.rubbing.reaction[2]
    N = jnp.maximum(R[2], 0.0) / jnp.where(solvability > 0, solvability, jnp.nan)
    return Interaction(response.reaction(still, N), still, N, solvability)


@jax.jit
def sliding(response: Response, mu: Float[Array, ""], direction: Float[Array, "2"]) -> Interaction:
    """Computes R = N (e3 − μσ), with N so that the body stays on the ground; ``direction`` is σ and ``mu`` the
    coefficient.

    N = −v̇_free,3 / (D₃₃ − μ D₃·σ − D₃·ρ), where ρ is the reaction that the dry rolling torque of a unit of N has.
    """
    pushed = push(mu, direction)
    net = pushed if response.rubbing is None else pushed - response.rubbing.reaction
    moved, D33 = apply(response.delassus, net), response.delassus[2, 2]
    # Where the divisor is 0 the guard of solvability has fallen to 0, and N only has to be finite.
    N = -response.free[2] / jnp.where(moved[2] == 0, D33, moved[2])
    acceleration = (response.free + N * moved).at[2].set(0.0)  # without what rounding leaves
    return Interaction(N * pushed, acceleration, N, moved[2] / D33)


def flight(response: Response) -> Interaction:
    """Returns the interaction without a reaction; ``response`` is the response of a body that does not touch the
    ground.
    """
    none = jnp.zeros_like(response.free[2])
    return Interaction(jnp.zeros_like(response.free), response.free, none, jnp.ones_like(none))


def margin(R: Float[Array, "3"], mu: Float[Array, ""]) -> Float[Array, ""]:
    """Computes μ N − |f|, the friction that is left; negative outside the cone. Its derivative by f is 0
    where f is 0.
    """
    return mu * R[2] - root(jnp.sum(R[:2] ** 2))


def slip_direction(slip: Float[Array, "3"], otherwise: Float[Array, "2"]) -> Float[Array, "2"]:
    """Computes σ = v_s/|v_s|; ``otherwise`` where the body does not slip, with no derivative by v_s there."""
    square = jnp.sum(slip[:2] ** 2)
    slips = square > 0
    return jnp.where(slips, slip[:2] / jnp.sqrt(jnp.where(slips, square, 1.0)), otherwise)


def first_slip(response: Response, mu: Float[Array, ""]) -> Direction:
    """Finds the direction in which a body begins to slip when friction cannot hold it: the tangential v̇_s = κσ with κ
    > 0.

    ``mu`` is the sliding coefficient. Where D is isotropic, σ is opposite to the friction that rolling would need; so
    it is at the brink, |f| = μ N. Where the growth κ is not positive, friction holds the body, or nothing does.
    """

    def pull(about: tuple[Response, Array], sigma: Float[Array, "2"]) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        along = sliding(*about, sigma)
        return along.slip_acceleration[:2], along.solvability

    return diverging(pull, (response, mu), -rolling(response).R[:2])


def push(mu: Float[Array, ""], direction: Float[Array, "2"]) -> Float[Array, "3"]:
    """Computes e3 − μσ."""
    return jnp.concatenate([-mu * direction, jnp.ones_like(direction[:1])])
