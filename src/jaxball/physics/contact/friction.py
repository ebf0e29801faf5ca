"""The force of the ground on a body that rolls, slides or flies, and when it switches between these.

Coulomb's law: a ground that presses with N > 0 holds a body that does not slip by any friction |f| ≤ μ N, with the
static coefficient; on one that slips with v_s friction is −μ N σ with σ = v_s/|v_s|, with the sliding coefficient. All
forces and accelerations are in contact axes, of which e3 is the normal, and follow from the ``Response`` of the body.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...numerics.directions import Direction, diverging, growing
from ...numerics.vectors import root
from ..dynamics.dry_friction import Law, Turning, TurningLaw, TurningMode, load, resist
from .released import Response


class Interaction(NamedTuple):
    """What acts at a contact: the ``amounts`` of the response, and what comes with them in ``dry_friction``, ``w``.

    Without a law of contact these are only those of turning. ``pivot`` is the radius ρ of a limit surface, if friction
    has one.

    ``normal`` is the normal force of dry rolling friction. ``solvability`` is the upward acceleration by a unit of
    normal force with its friction, relative to that without friction: where it is not positive, the normal force has no
    solution (Painlevé's paradox), and these numbers mean nothing.
    """

    amounts: Float[Array, " amounts"]
    w: Float[Array, " rows"]
    normal: Float[Array, ""]
    solvability: Float[Array, ""]
    pivot: Float[Array, ""] | None = None

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

    @property
    def grip(self) -> Float[Array, " cone"]:
        """What friction does against the slide, and N: R, and with a limit surface (f1, f2, m₃/ρ, N)."""
        if self.pivot is None:
            return self.R
        return jnp.stack([self.w[0], self.w[1], self.torque[2] / self.pivot, self.w[2]])

    @property
    def slide_acceleration(self) -> Float[Array, " n"]:
        """The rate of the slide: of v_s along the ground, and with a limit surface of ρ ω₃ as well."""
        along = self.slip_acceleration[:2]
        return along if self.pivot is None else jnp.append(along, self.pivot * self.rate[2])


class SolvedContact(NamedTuple):
    """A body whose contact is in a mode, where σ of a slip need not be known: its response, with that mode's law."""

    response: Response
    law: Law
    slides: Bool[Array, ""]

    @classmethod
    def of(cls, response: Response, slides: Bool[Array, ""], flies: Bool[Array, ""]) -> "SolvedContact":
        """Solves for the mode of a body that rolls, ``slides`` or ``flies``."""
        if response.pivot is not None:
            response = response.with_pivoting(held=~(slides | flies))
        return cls(response, _solve(response, slides, flies), slides)

    def with_turning(self, given: TurningLaw) -> "SolvedContact":
        """Returns the contact of a body that turns in another direction, where the same is held."""
        return self._replace(response=self.response.with_turning(given))

    @jax.jit
    def interaction(self, mu: Float[Array, ""], direction: Float[Array, " n"]) -> Interaction:
        """Computes R, which is N (e3 − μσ) where the body slides in the ``direction`` σ with the coefficient ``mu``.

        With a limit surface σ has a third component, by which the torque about the normal is −μ N ρ σ₃.

        What keeps v_s constant has whatever friction it needs. There is no dry rolling friction where N < 0.
        """
        pivot, along = self.response.pivot, jnp.where(self.slides, -mu * direction, 0.0)
        push = self.response.push(jnp.append(along[:2], 0.0))
        if pivot is not None:
            push = push.at[-1].set(pivot * along[2])
        acting = self.law.act(push, self.slides)
        return Interaction(acting.amounts, acting.w, acting.pressing, acting.solvability, pivot)


@jax.jit
def _solve(response: Response, slides: Bool[Array, ""], flies: Bool[Array, ""]) -> Law:
    loose = slides | flies
    law = response.law(jnp.stack([loose, loose, flies]))
    # In flight N is exactly 0, not nearly.
    normal, lift = (jnp.where(flies, 0.0, x) for x in (law.rows.normal, law.rows.lift))
    return law._replace(rows=law.rows._replace(normal=normal, lift=lift))


def resist_rolling(turning: Turning, mode: TurningMode) -> Interaction:
    """Computes what exact dry resistance does to a body that rolls without slipping, whatever friction that needs."""
    acting = resist(turning, mode)
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


def margin(R: Float[Array, " cone"], mu: Float[Array, ""]) -> Float[Array, ""]:
    """Computes μ N − |f|, the friction that is left; negative outside the cone. Its derivative by f is 0
    where f is 0.

    ``R`` is the ``grip`` of an ``Interaction``.
    """
    return mu * R[-1] - root(jnp.sum(R[:-1] ** 2))


def overload(
    R: Float[Array, " cone"], mu: Float[Array, ""], slack: Float[Array, ""], sticks: Bool[Array, ""]
) -> Float[Array, ""]:
    """Returns the load of a contact that sticks although friction cannot hold it; −∞ of another."""
    holds = (margin(R, mu) > -slack) & (-slack < R[-1])
    return jnp.where(sticks & ~holds, load(jnp.sum(R[:-1] ** 2), mu * R[-1]), -jnp.inf)


def slip_direction(slip: Float[Array, " more"], otherwise: Float[Array, " n"]) -> Float[Array, " n"]:
    """Computes σ = s/|s| of a slide, of a slip v_s/|v_s|; ``otherwise`` where the body does not slide, with no
    derivative by s there.
    """
    slide = slip[: otherwise.size]
    square = jnp.sum(slide**2)
    slips = square > 0
    return jnp.where(slips, slide / jnp.sqrt(jnp.where(slips, square, 1.0)), otherwise)


def first_slip(response: Response, mu: Float[Array, ""]) -> Direction:
    """Finds the direction in which a body begins to slip when friction cannot hold it: the tangential v̇_s = κσ with κ
    > 0.

    ``mu`` is the sliding coefficient. Where D is isotropic, σ is opposite to the friction that rolling would need; so
    it is at the brink, |f| = μ N. Where the growth κ is not positive, friction holds the body, or nothing does.
    """

    def pull(
        about: tuple[SolvedContact, Array], sigma: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], Float[Array, ""]]:
        contact, mu = about
        along = contact.interaction(mu, sigma)
        return along.slide_acceleration, along.solvability

    contact = sliding_contact(response)
    if response.pivot is None:
        return diverging(pull, (contact, mu), -rolling(response).R[:2])
    return growing(lambda about, sigma: pull(about, sigma)[0], (contact, mu), jnp.zeros_like(response.free))


def push(mu: Float[Array, ""], direction: Float[Array, "2"]) -> Float[Array, "3"]:
    """Computes e3 − μσ."""
    return jnp.concatenate([-mu * direction, jnp.ones_like(direction[:1])])
