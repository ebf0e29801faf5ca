"""The force of the ground on a body that rolls, slides or flies, and when it switches between these.

Coulomb's law: a ground that presses with N > 0 holds a body that does not slip by any friction |f| ≤ μ N, with the
static coefficient; on one that slips with v_s friction is −μ N σ with σ = v_s/|v_s|, with the sliding coefficient. All
forces and accelerations are in contact axes, of which e3 is the normal, and follow from the ``Response`` of the body.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...numerics.directions import Direction, diverging
from ...numerics.vectors import root
from ..dynamics.law import Law, load
from ..dynamics.rest import Turning, TurningLaw, TurningMode, resist
from ..forces.resistance import Resistance
from .released import Response


class Interaction(NamedTuple):
    """What acts at a contact: the ``amounts`` of the response, and what comes with them in ``law``, ``w``.

    Without a law of contact these are only those of turning.

    ``normal`` is the normal force of dry rolling friction. ``solvability`` is the upward acceleration by a unit of
    normal force with its friction, relative to that without friction: where it is not positive, the normal force has no
    solution (Painlevé's paradox), and these numbers mean nothing.
    """

    amounts: Float[Array, " amounts"]
    w: Float[Array, " rows"]
    normal: Float[Array, ""]
    solvability: Float[Array, ""]

    @property
    def R(self) -> Float[Array, "*batch 3"]:
        """The reaction of the ground, contact axes."""
        return self.w[..., :3]

    @property
    def slip_acceleration(self) -> Float[Array, "*batch 3"]:
        """v̇_s, contact axes."""
        return self.amounts[..., :3]

    @property
    def torque(self) -> Float[Array, "*batch 3"]:
        """The torque of exact dry resistance, contact axes."""
        return self.amounts[..., -3:]

    @property
    def rate(self) -> Float[Array, "*batch 3"]:
        """The rate of ω relative to the ground under exact dry resistance, contact axes."""
        return self.w[..., -3:]


class SolvedContact(NamedTuple):
    """A body whose contact is in a mode, where σ of a slip need not be known: its response, with that mode's law."""

    response: Response
    law: Law
    slides: Bool[Array, ""]

    @classmethod
    def of(cls, response: Response, slides: Bool[Array, ""], flies: Bool[Array, ""]) -> "SolvedContact":
        """Solves for the mode of a body that rolls, ``slides`` or ``flies``."""
        return cls(response, _solve(response, slides, flies), slides)

    def with_turning(self, given: TurningLaw) -> "SolvedContact":
        """Returns the contact of a body that turns in another direction, where the same is held."""
        return self._replace(response=self.response.with_turning(given))

    @jax.jit
    def interaction(self, mu: Float[Array, ""], direction: Float[Array, "2"]) -> Interaction:
        """Computes R, which is N (e3 − μσ) where the body slides in the ``direction`` σ with the coefficient ``mu``.

        What keeps v_s constant has whatever friction it needs. There is no dry rolling friction where N < 0.
        """
        along = jnp.where(self.slides, -mu * direction, 0.0)
        acting = self.law.act(self.response.push(jnp.append(along, 0.0)), self.slides)
        return Interaction(acting.amounts, acting.w, acting.pressing, acting.solvability)


@jax.jit
def _solve(response: Response, slides: Bool[Array, ""], flies: Bool[Array, ""]) -> Law:
    loose = slides | flies
    law = response.law(jnp.stack([loose, loose, flies]))
    # In flight N is exactly 0, not nearly.
    normal, lift = (jnp.where(flies, 0.0, x) for x in (law.rows.normal, law.rows.lift))
    return law._replace(rows=law.rows._replace(normal=normal, lift=lift))


def resist_rolling(resistance: Resistance, turning: Turning, mode: TurningMode) -> Interaction:
    """Computes what exact dry resistance does to a body that rolls without slipping, whatever friction that needs."""
    acting = resist(resistance, turning, mode)
    return Interaction(acting.amounts, acting.w, acting.normal, acting.solvability)


def sliding_contact(response: Response) -> SolvedContact:
    """Solves for the mode of a body that slides."""
    return SolvedContact.of(response, jnp.asarray(True), jnp.asarray(False))


def rolling(response: Response) -> Interaction:
    """Computes the reaction that keeps v_s constant."""
    no, none = jnp.asarray(False), jnp.zeros_like(response.rolling.reaction)
    return SolvedContact.of(response, no, no).interaction(none[2], none[:2])


@jax.jit
def sliding(response: Response, mu: Float[Array, ""], direction: Float[Array, "2"]) -> Interaction:
    """Computes R = N (e3 − μσ), with N so that the body stays on the ground; ``direction`` is σ and ``mu`` the
    coefficient.
    """
    return sliding_contact(response).interaction(mu, direction)


def flight(response: Response) -> Interaction:
    """Returns the interaction without a reaction; ``response`` is the response of a body that does not touch the
    ground.
    """
    no, none = jnp.asarray(False), jnp.zeros_like(response.rolling.reaction)
    return SolvedContact.of(response, no, ~no).interaction(none[2], none[:2])


def margin(R: Float[Array, "3"], mu: Float[Array, ""]) -> Float[Array, ""]:
    """Computes μ N − |f|, the friction that is left; negative outside the cone. Its derivative by f is 0
    where f is 0.
    """
    return mu * R[2] - root(jnp.sum(R[:2] ** 2))


def overload(
    R: Float[Array, "3"], mu: Float[Array, ""], slack: Float[Array, ""], sticks: Bool[Array, ""]
) -> Float[Array, ""]:
    """Returns the load of a contact that sticks although friction cannot hold it; −∞ of another."""
    holds = (margin(R, mu) > -slack) & (-slack < R[2])
    return jnp.where(sticks & ~holds, load(jnp.sum(R[:2] ** 2), mu * R[2]), -jnp.inf)


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

    def pull(
        about: tuple[SolvedContact, Array], sigma: Float[Array, "2"]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        contact, mu = about
        along = contact.interaction(mu, sigma)
        return along.slip_acceleration[:2], along.solvability

    return diverging(pull, (sliding_contact(response), mu), -rolling(response).R[:2])


def push(mu: Float[Array, ""], direction: Float[Array, "2"]) -> Float[Array, "3"]:
    """Computes e3 − μσ."""
    return jnp.concatenate([-mu * direction, jnp.ones_like(direction[:1])])
