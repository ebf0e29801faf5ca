"""The imbalance of a body at rest: a torque about the contact point, and forces on its free joints."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..numerics.vectors import apply
from .coupling import joined, joint_forces, with_free_joints
from .linkage import linkages
from .load import load
from .moments import velocity_moments
from .parameters import BodyParameters
from .state import BallState, DiskState, RotationState


class Imbalance(NamedTuple):
    """What would set a body at rest in motion; all of it is 0 in equilibrium.

    - ``torque``: of the load about the contact point, space axes, mass length²/time².
    - ``efforts``: on each free joint, its force minus that which would hold up its masses; 0 for joints that a law
      drives.
    - ``p``, ``weight``: Λp = Σ m Λχ, and γ, what a unit of mass weighs, upward; space axes.
    - ``M``: the whole mass.
    """

    torque: Float[Array, "3"]
    efforts: Float[Array, " coordinates"]
    p: Float[Array, "3"]
    weight: Float[Array, "3"]
    M: Float[Array, ""]

    @property
    def beside(self) -> Float[Array, "2"]:
        """The horizontal distance of the centre of mass from where it could rest; on a level plane, from the centre."""
        turned = jnp.stack([self.torque[1], -self.torque[0]])
        return turned / (self.M * self.weight[2])

    @property
    def below(self) -> Float[Array, ""]:
        """How far the centre of mass is below the geometric centre, along the vertical, length."""
        size = jnp.sqrt(jnp.sum(self.weight**2))
        return -jnp.sum(self.p * self.weight) / (self.M * size)


def imbalance(system: BodyParameters, t: Float[Array, ""], state: BallState | RotationState | DiskState) -> Imbalance:
    """The imbalance of a body in the configuration of ``state``, with all velocities 0; ``system`` is prepared."""
    still = eqx.tree_at(lambda s: s.thetadot, state, jnp.zeros_like(state.thetadot))
    still = still.with_Omega(jnp.zeros_like(state.Omega))
    angles = (still.theta, still.thetadot, still.thetadot)
    links = linkages(system, t, angles)
    at, acting = velocity_moments(system, t, angles[:2], links), load(system, t, still)
    weight = acting.weight
    efforts = []
    for link, Q in zip(with_free_joints(links), joint_forces(t, still, links), strict=True):
        moments = jnp.sum(link.m[:, None, :, None] * link.partial, axis=2)
        efforts.append(Q - jnp.sum(moments * weight[None, None], axis=-1))
    Lambda = state.Lambda
    return Imbalance(
        torque=apply(Lambda, acting.about_contact(at, system.radius)),
        efforts=joined(still.thetadot, links, efforts),
        p=apply(Lambda, at.p),
        weight=apply(Lambda, weight),
        M=at.M,
    )
