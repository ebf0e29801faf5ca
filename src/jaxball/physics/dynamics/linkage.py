"""The mechanisms of a body at a state, group by group: where they are, and how their joints move them."""

import dataclasses
import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..mechanisms import AbstractMechanism
from ..mechanisms.mechanism import Places
from ..prescribed.motion import Kinematics
from ..state import Rates
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
