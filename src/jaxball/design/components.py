"""States as vectors of numbers of order one."""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..physics.body import System
from ..physics.state import BallState, DiskState
from ..scenario.initial import INITIAL
from .scales import default_scale


class Components:
    """The components of states of the kind of ``state``, each over its scale: a versor's four among them."""

    def __init__(self, system: System, state: BallState | DiskState):
        kinds = {name: key.kind for name, key in INITIAL["disk" if isinstance(state, DiskState) else "ball"].items()}
        scales = []
        for field in dataclasses.fields(state):
            dimension = getattr(kinds.get(field.name), "dimension", None)
            size = np.size(getattr(state, field.name))
            scales.append(np.full(size, default_scale(dimension, 1.0, system)))
        self.scale = np.concatenate(scales)
        self._unravel = ravel_pytree(state)[1]

    @property
    def size(self) -> int:
        """How many there are."""
        return self.scale.size

    def pack(self, state: Any) -> Float[Array, " components"]:
        """The components of a state."""
        found = ravel_pytree(state)[0]
        return found / jnp.asarray(self.scale, dtype=found.dtype)

    def unpack(self, components: Float[Array, " components"]) -> Any:
        """The state of the components, its versor normalised."""
        return self._unravel(components * jnp.asarray(self.scale, dtype=components.dtype)).projected()
