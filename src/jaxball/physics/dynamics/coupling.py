"""The mechanisms of a body at a state, and the dynamic coupling of the body and their free joints.

With c_a = rΓ × p_a + ℓ_a and H_ab = Σ m χ_a·χ_b of the free joints, Ω and θ̇ together have the inertia

    [ B   c ]
    [ cᵀ  H ]

symmetric positive definite, with a block of H for each mechanism. The joints are eliminated: what remains for Ω is
the three by three matrix B − Σ c H⁻¹ cᵀ, so that the cost grows with the number of mechanisms and not faster.
"""

import dataclasses
import functools
from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...numerics.linear import Factors, factor_symmetric
from ...numerics.vectors import apply, cross, inverse
from ..conditions import Condition
from ..mechanisms import AbstractMechanism
from ..mechanisms.mechanism import Places
from ..prescribed.motion import Kinematics
from ..state import Rates, State
from .footing import contact_normal
from .parameters import BodyParameters

RatesOfGroup = tuple[Float[Array, "mechanisms k"], Float[Array, "mechanisms k"], Float[Array, "mechanisms k"]]


@dataclasses.dataclass(frozen=True)
class Linkage:
    """A group of mechanisms at a state. The first axis of arrays is that of the mechanisms.

    Its results are kept, so that each is traced once.
    """

    group: AbstractMechanism
    slots: Int[np.ndarray, "mechanisms free"]  # where the free joints are in a state's theta
    rates: RatesOfGroup  # θ, θ̇ and θ̈ of all joints
    places: Places

    @property
    def m(self) -> Float[Array, "mechanisms n"]:
        """The masses."""
        return self.group.mass

    @property
    def free(self) -> Int[np.ndarray, " free"]:
        """The indices of the free joints."""
        return np.asarray(self.group.free, dtype=int)

    @property
    def chi(self) -> Float[Array, "mechanisms n 3"]:
        """χ."""
        return self.places.chi

    @functools.cached_property
    def partial(self) -> Float[Array, "mechanisms free n 3"]:
        """χ_a of the free joints."""
        return self.places.partial[:, self.free]

    @functools.cached_property
    def weights(self) -> Float[Array, "mechanisms free 3"]:
        """p_a = Σ m χ_a of the free joints."""
        return jnp.sum(self.m[:, None, :, None] * self.partial, axis=2)

    def along(self, v: Float[Array, "mechanisms n 3"]) -> Float[Array, "mechanisms free"]:
        """Computes Σ m v·χ_a for the free joints, from a vector for each mass."""
        return jnp.sum((self.m[..., None] * v)[:, None] * self.partial, axis=(-2, -1))

    @functools.cached_property
    def chidot(self) -> Float[Array, "mechanisms n 3"]:
        """χ̇."""
        return along(self.places.partial, self.rates[1])

    @functools.cached_property
    def slope(self) -> Float[Array, "mechanisms k n 3"]:
        """The rates of χ_a of all joints."""
        return eqx.filter_vmap(lambda group, places, rate: group.slopes(places, rate))(
            self.group, self.places, self.rates[1]
        )

    @functools.cached_property
    def chiddot(self) -> Float[Array, "mechanisms n 3"]:
        """χ̈."""
        return along(self.slope, self.rates[1]) + along(self.places.partial, self.rates[2])

    def own(self, values: Float[Array, " coordinates"]) -> Float[Array, "mechanisms free"]:
        """Returns the entries of the free joints in an array of all coordinates."""
        return values[self.slots]

    def moving(self, thetadot: Float[Array, "mechanisms free"]) -> "Linkage":
        """Returns the linkage in the same place, with other θ̇ of the free joints."""
        columns = [self.rates[1][:, a] for a in range(self.group.n_joints)]
        for slot, a in enumerate(self.group.free):
            columns[a] = thetadot[:, slot]
        return dataclasses.replace(self, rates=(self.rates[0], jnp.stack(columns, axis=1), self.rates[2]))

    def kinematics(self) -> Kinematics:
        """Returns χ, χ̇ and χ̈, of all masses along one axis."""
        return Kinematics(*(jnp.reshape(x, (-1, 3)) for x in (self.chi, self.chidot, self.chiddot)))


def linkages(system: BodyParameters, t: Float[Array, ""], angles: Rates) -> list[Linkage]:
    """Builds the mechanisms of a body at time ``t``, where ``angles`` are θ, θ̇, θ̈ of the state."""
    links = []
    for group, order in zip(system.mechanism_groups, system.mechanism_order, strict=True):
        coordinates = tuple(values[system.slots(order, group.in_state)] for values in angles)
        rates = eqx.filter_vmap(lambda mechanism, coordinates: mechanism.rates(t, coordinates))(group, coordinates)
        places = eqx.filter_vmap(lambda mechanism, theta: mechanism.places(theta))(group, rates[0])
        links.append(Linkage(group, system.slots(order, group.free), rates, places))
    return links


def along(partial: Float[Array, "mechanisms k n 3"], rate: Float[Array, "mechanisms k"]):
    """Computes Σ_a χ_a θ̇_a, or another sum over joints."""
    return jnp.sum(partial * rate[:, :, None, None], axis=1)


SINGULAR = 1e-10  # of a joint's inertia, what those before it must leave to it
MOVES = "a joint that moves some mass in a way that those before it do not, with a positive inertia of its own"

# One array for each group that has free joints, with axes (mechanisms, joints).
Joints = list[Float[Array, "_ _"]]


class Inertia(NamedTuple):
    """The inertia of the body and its free joints about the contact point."""

    B: Float[Array, "3 3"]
    c: list[Float[Array, "_ _ 3"]]
    H: list[Float[Array, "_ _ _"]]

    def times(self, Omega: Float[Array, "3"], thetadot: Joints) -> tuple[Float[Array, "3"], Joints]:
        """Computes the product with Ω and θ̇."""
        torque, efforts = apply(self.B, Omega), []
        for c, H, rate in zip(self.c, self.H, thetadot, strict=True):
            torque = torque + jnp.sum(c * rate[..., None], axis=(0, 1))
            efforts.append(jnp.sum(c * Omega[None, None], axis=-1) + jnp.sum(H * rate[:, None, :], axis=-1))
        return torque, efforts

    def holding(self, held: list[Bool[Array, "_ _"] | None]) -> "Inertia":
        """Returns the inertia where some joints are held, so that their accelerations follow from their
        efforts alone.
        """
        c, H = [], []
        for coupling, block, which in zip(self.c, self.H, held, strict=True):
            if which is not None:
                # A held joint has the row and the column of the identity: with an effort of 0 its acceleration is
                # exactly 0.
                coupling = jnp.where(which[..., None], 0.0, coupling)
                between = which[:, :, None] | which[:, None, :]
                block = jnp.where(between, jnp.eye(which.shape[1], dtype=block.dtype), block)
            c.append(coupling)
            H.append(block)
        return Inertia(self.B, c, H)

    def factorise(self) -> "FactoredInertia":
        """Factorises, to be solved with many right-hand sides."""
        rest, eliminated = self.B, []
        for c, H in zip(self.c, self.H, strict=True):
            factors = jax.vmap(factor_symmetric)(H)
            reduced = jax.vmap(Factors.solve_lower)(factors, c)
            divided = jax.vmap(Factors.divide_by_pivots)(factors, reduced)
            rest = rest - jnp.sum(reduced[..., :, None] * divided[..., None, :], axis=(0, 1))
            eliminated.append((factors, reduced, divided))
        return FactoredInertia(inverse(rest), eliminated)


class FactoredInertia(NamedTuple):
    """The inertia with its joints eliminated."""

    inverse: Float[Array, "3 3"]  # of B − Σ c H⁻¹ cᵀ
    eliminated: list[tuple[Factors, Array, Array]]  # the factors of H, L⁻¹cᵀ and D⁻¹L⁻¹cᵀ

    def solve(self, torque: Float[Array, "3"], efforts: Joints) -> tuple[Float[Array, "3"], Joints]:
        """Solves for Ω̇ and θ̈, or other rates, whose product with the inertia is ``torque`` and ``efforts``."""
        reduced = []
        for (factors, _, divided), effort in zip(self.eliminated, efforts, strict=True):
            y = jax.vmap(Factors.solve_lower)(factors, effort)
            torque = torque - jnp.sum(divided * y[..., None], axis=(0, 1))
            reduced.append(y)
        Omega, rates = apply(self.inverse, torque), []
        for (factors, coupled, _), y in zip(self.eliminated, reduced, strict=True):
            rest = y - jnp.sum(coupled * Omega[None, None], axis=-1)
            rates.append(jax.vmap(lambda f, x: f.solve_upper(f.divide_by_pivots(x)))(factors, rest))
        return Omega, rates


def inertia(B: Float[Array, "3 3"], r: Float[Array, ""], arm: Float[Array, "3"], links: list[Linkage]) -> Inertia:
    """Computes the inertia, with B the inertia of the body about the contact point, all masses in their places.

    ``arm`` is Γ, or what a body that is no sphere has in its place.
    """
    c, H = [], []
    for link in with_free_joints(links):
        weighted = link.m[:, None, :, None] * link.partial
        s = r * arm[None, None] + link.chi
        c.append(jnp.sum(_cross(s[:, None], weighted), axis=2))
        H.append(jnp.sum(weighted[:, :, None] * link.partial[:, None], axis=(-2, -1)))
    return Inertia(B, c, H)


def inertia_rate(
    Bdot: Float[Array, "3 3"],
    r: Float[Array, ""],
    arm: Float[Array, "3"],
    armdot: Float[Array, "3"],
    links: list[Linkage],
) -> Inertia:
    """Computes the rate of the inertia."""
    c, H = [], []
    for link in with_free_joints(links):
        m = link.m[:, None, :, None]
        partial, slope = link.partial, link.slope[:, link.free]
        s = r * arm[None, None] + link.chi
        sdot = r * armdot[None, None] + link.chidot
        c.append(jnp.sum(_cross(sdot[:, None], m * partial) + _cross(s[:, None], m * slope), axis=2))
        mixed = jnp.sum((m * slope)[:, :, None] * partial[:, None], axis=(-2, -1))
        H.append(mixed + jnp.swapaxes(mixed, 1, 2))
    return Inertia(Bdot, c, H)


def joint_forces(t: Float[Array, ""], state: State, links: list[Linkage], impulses: bool = True) -> Joints:
    """Computes Q of the free joints; without ``impulses``, only the part of it that :func:`joint_impulses` does not
    integrate.
    """
    return [
        eqx.filter_vmap(lambda mechanism, rates: mechanism.forces(t, rates, state, impulses))(link.group, link.rates)
        for link in with_free_joints(links)
    ]


def joint_impulses(t: Float[Array, ""], links: list[Linkage]) -> Joints:
    """Computes ∫ Q up to ``t`` of the parts of Q that are known in closed form."""
    return [eqx.filter_vmap(lambda mechanism: mechanism.impulses(t))(link.group) for link in with_free_joints(links)]


def with_free_joints(links: list[Linkage]) -> list[Linkage]:
    """Returns the groups that have free joints, which are the groups of :data:`Joints`."""
    return [link for link in links if link.group.free]


def join_coordinates(coordinates: Float[Array, " coordinates"], links: list[Linkage], values: Joints):
    """Joins an array of all coordinates, with the values of free joints in their places."""
    for link, value in zip(with_free_joints(links), values, strict=True):
        places = np.full(coordinates.shape[0], -1)
        places[link.slots.ravel()] = np.arange(link.slots.size)
        spread = jnp.ravel(value)[np.maximum(places, 0)]
        coordinates = jnp.where(places >= 0, spread, coordinates)
    return coordinates


def mass_conditions(system: BodyParameters, t: Float[Array, ""], state: State) -> Iterator[Condition]:
    """Returns for each free joint the condition that it moves some mass in a way that its carriers do not; traceable.

    The pivots of H say so: that of a joint is the inertia that is left to it when the joints before it give way.
    ``system`` is prepared.
    """
    for link in with_free_joints(linkages(system, t, (state.theta, state.thetadot, state.thetadot))):
        H = inertia(jnp.eye(3, dtype=link.m.dtype), system.radius, contact_normal(system, t, state), [link]).H[0]
        pivots, alone = jax.vmap(factor_symmetric)(H).pivots, jnp.diagonal(H, axis1=1, axis2=2)
        least = SINGULAR**2 * jnp.sum(link.m, axis=1, keepdims=True) * system.radius**2
        names = tuple(system.coordinates[slot] for slot in link.slots.ravel())
        holds = jnp.ravel((pivots > SINGULAR * alone) & (alone > least))
        yield Condition(holds, names, jnp.ravel(pivots), MOVES)


def _cross(a: Float[Array, "*some 3"], b: Float[Array, "*others 3"]) -> Float[Array, "*all 3"]:
    return cross(*jnp.broadcast_arrays(a, b))
