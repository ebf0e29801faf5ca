"""How exact dry resistance and the reaction of the plane act together on a body that rolls, slides, or rests.

``resting`` and its transitions compute both by it.

The torque T of dry resistance adds to the motion in proportion, as the reaction does: with v̇_s and T given,

    ω̇ = ω̇₀ + Y v̇_s + G T        R = R₀ + D⁻¹ v̇_s + ρ T

T is N d, with d from the directions of rolling and spinning, and whatever else keeps the held part P of ω̇ at its rate.
It can be eliminated, which leaves a ``Response`` of the same form, in which all formulas of friction hold unchanged:

    T = K (ω̇_held − ω̇₀ − Y v̇_s) + N (d − K G d)        K = P (P G P + 1 − P)⁻¹ P

Or v̇_s and N can be, for a contact that sticks or slips in a known direction, which leaves a ``Turning`` for the
formulas of ``rest``. All vectors are in contact axes, and ω is relative to the ground: on a plane in space axes.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...numerics.vectors import apply, inverse
from ..body import AbstractBody
from ..dynamics.rest import Hold, Needs, Resisted, Turning, drag, needs
from ..forces.resistance import Resistance, TurningMode
from .friction import Interaction, push
from .released import Motion, Response, combine_rows


class DryTorque(NamedTuple):
    """T as a function of v̇_s and N: ``constant`` + Σ v̇_s,k ``by_slip[k]`` + N ``by_normal``."""

    constant: Float[Array, "3"]
    by_slip: Float[Array, "3 3"]
    by_normal: Float[Array, "3"]

    def __call__(self, slip_acceleration: Float[Array, "3"], N: Float[Array, ""]) -> Float[Array, "3"]:
        """Computes T under a slip acceleration and a normal force."""
        return self.constant + combine_rows(slip_acceleration, self.by_slip) + N * self.by_normal


class Resisting(NamedTuple):
    """A body that touches the plane, before its mode of turning is known.

    ``response`` is that without the dry torque. ``axes`` takes vectors from body axes to contact axes: on a plane it is
    Λ. ``axle`` is as in ``Turning``. ``carried`` is the rate of ω relative to the ground while ω is constant, None on a
    plane.
    """

    resistance: Resistance
    response: Response
    axes: Float[Array, "3 3"]
    radius: Float[Array, ""]
    axle: Float[Array, "3"] | None
    carried: Float[Array, "3"] | None = None

    @classmethod
    def of(
        cls,
        body: AbstractBody,
        axes: Float[Array, "3 3"],
        response: Response,
        carried: Float[Array, "3"] | None = None,
    ) -> "Resisting":
        """Describes a body before its mode of turning is known; ``response`` has no dry torque."""
        assert isinstance(body.resistance, Resistance)
        axle = jnp.zeros_like(axes[0]).at[1].set(1.0) if body.planar else None
        return cls(body.resistance, response, axes, body.radius, axle, carried)

    def in_space(self, Omegadot: Float[Array, "rows 3"]) -> Float[Array, "rows 3"]:
        """Returns rows of Ω̇ in contact axes."""
        return jnp.sum(Omegadot[:, None, :] * self.axes[None], axis=-1)

    @property
    def bare(self) -> Turning:
        """How the body turns while v̇_s = 0, whatever N is."""
        rolling, twisting = self.response.rolling, self.response.twisting
        assert twisting is not None
        up = jnp.zeros_like(self.axes[0]).at[2].set(1.0)
        # A torque also presses the body on, or lifts it, where its centre of mass is beside the contact.
        G, lift = self.in_space(twisting.Omegadot).T, twisting.reaction[:, 2]
        rate = apply(self.axes, rolling.Omegadot)
        rate = rate if self.carried is None else rate + self.carried
        return Turning(up, self.axle, rate, G, rolling.reaction[2], lift, self.radius)

    def turning(self, slides: Bool[Array, ""], mu: Float[Array, ""], sigma: Float[Array, "2"]) -> Turning:
        """Computes how the body turns while the contact slides in a direction σ, or does not slip."""
        response, bare = self.response, self.bare
        assert response.twisting is not None
        pushed, rho = push(mu, sigma), response.twisting.reaction
        moved, needed = apply(response.delassus, pushed), -response.free
        yields = jnp.sum(rho[:, None, :] * response.delassus[None], axis=-1)
        # N is such that v̇_s3 = 0, and ``lift`` what a torque adds to it, by the change of v̇_s3 that it would make.
        over = jnp.where(moved[2] == 0, response.delassus[2, 2], moved[2])
        N, lift = needed[2] / over, yields[:, 2] / over
        # The third entry is zero but for rounding, which would lift the body off the plane.
        a = jnp.where(slides, N * moved - needed, 0.0).at[2].set(0.0)
        by_torque = jnp.where(slides, lift[:, None] * moved[None] - yields, 0.0).at[:, 2].set(0.0)
        Y = self.in_space(response.yielding.Omegadot)
        return bare._replace(
            rate=bare.rate + combine_rows(a, Y),
            compliance=bare.compliance + jnp.sum(by_torque[:, :, None] * Y[None], axis=1).T,
            normal=jnp.where(slides, N, bare.normal),
            lift=jnp.where(slides, lift, bare.lift),
        )

    def torque(self, mode: TurningMode) -> DryTorque:
        """Computes T in a mode of turning."""
        bare = self.bare
        hold, d = Hold.of(bare, mode), drag(self.resistance, bare, mode)
        # What is held keeps its rate, so T cancels whatever else would turn it: the motion without it, a slip
        # acceleration, and the torque of N on what moves.
        by_slip = -jax.vmap(hold)(self.in_space(self.response.yielding.Omegadot))
        return DryTorque(hold(mode.braking - bare.rate), by_slip, d - hold(apply(bare.compliance, d)))

    def resist_turning(self, torque: DryTorque) -> Response:
        """Computes the response of the body with the dry torque."""
        response, twisting = self.response, self.response.twisting
        assert twisting is not None

        def twist(torque: Float[Array, "3"]) -> Motion:
            return jax.tree.map(lambda rows: combine_rows(torque, rows), twisting)

        rolling = jax.tree.map(jnp.add, response.rolling, twist(torque.constant))
        yielding = jax.tree.map(jnp.add, response.yielding, jax.vmap(twist)(torque.by_slip))
        return response._replace(
            rolling=rolling,
            yielding=yielding,
            delassus=inverse(yielding.reaction),
            rubbing=twist(torque.by_normal),
        )

    def spare(self, torque: DryTorque, acting: Interaction) -> Needs:
        """Computes what dry resistance has to spare where it holds the body."""
        T = torque(acting.slip_acceleration, acting.normal)
        return needs(self.resistance, self.bare, Resisted(T, T, acting.normal))
