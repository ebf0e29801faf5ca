"""The coordinates θ of the masses on rails, whatever moves them: a schedule, or the feedback law.

Sensors, files, figures, designs and controllers read them here, and ask no schedule of their own.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..prescribed.motion import Driven, rail_of, schedule_of
from ..state import Rates
from .parameters import BodyParameters


class AlongRails(NamedTuple):
    """θ, θ̇ and θ̈ of each mass on its rail; zero for masses without one."""

    theta: Float[Array, "*t n"]
    thetadot: Float[Array, "*t n"]
    thetaddot: Float[Array, "*t n"]


def along_rails(system: BodyParameters, t: Float[Array, ""], angles: Rates) -> AlongRails:
    """Returns the coordinates of all masses; ``angles`` are θ, θ̇ and θ̈ of the coordinates in a state's ``theta``."""
    slots = {index: slot for slot, index in enumerate(system.driven)}
    parts = []
    for group, order in zip(system.groups, system.order, strict=True):
        motion = group.motion
        if isinstance(motion, Driven):
            places = np.asarray([slots[index] for index in order])
            parts.append(AlongRails(*(values[places] for values in angles)))
        elif schedule_of(motion) is not None:
            parts.append(AlongRails(*eqx.filter_vmap(lambda motion: motion.schedule.derivatives(t))(motion)))
        else:
            parts.append(AlongRails(*(jnp.zeros_like(group.mass),) * 3))
    if not parts:
        return AlongRails(*(jnp.zeros_like(t, shape=(0,)),) * 3)
    return AlongRails(*(_in_order(system, arrays) for arrays in zip(*parts, strict=True)))


def rail_tangents(system: BodyParameters, theta: Float[Array, " n"]) -> Float[Array, "n 3"]:
    """Returns the unit tangents of the rails at θ, in body axes; zero for masses without one."""
    parts = []
    for group, order in zip(system.groups, system.order, strict=True):
        rail = rail_of(group.motion)
        if rail is None:
            parts.append(jnp.zeros_like(group.mass, shape=(len(order), 3)))
            continue
        tangents = eqx.filter_vmap(lambda rail, theta: rail.derivatives(theta)[1])(rail, theta[np.asarray(order)])
        parts.append(tangents / jnp.sqrt(jnp.sum(tangents**2, axis=-1, keepdims=True)))
    return _in_order(system, parts) if parts else jnp.zeros_like(theta, shape=(0, 3))


def _in_order(system: BodyParameters, parts: Sequence[Array]) -> Array:
    """Joins the arrays of the groups to one in the order of the masses."""
    return jnp.concatenate(parts)[np.argsort(np.concatenate(system.order))]


def rates_of_mass(system: BodyParameters, t: Float[Array, ""], angles: Rates, index: int) -> Rates:
    """Returns θ, θ̇ and θ̈ of one mass on a rail; the arguments are those of :func:`along_rails`."""
    schedule = schedule_of(system.point_masses[index].motion)
    if schedule is not None:
        return schedule.derivatives(t)
    theta, thetadot, thetaddot = angles
    slot = system.driven.index(index)
    return theta[slot], thetadot[slot], thetaddot[slot]
