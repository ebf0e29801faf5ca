"""Balls with manufacturing errors in masses and centre of mass."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..physics.body import Disk, System
from .errors import DesignError


class Errors(NamedTuple):
    """Relative errors of the shell's mass and of the point masses, group by group, and of the offset in radii."""

    shell: Float[Array, "*balls"]
    offset: Float[Array, "*balls 3"]
    masses: tuple[Float[Array, "*balls n"], ...]


@dataclasses.dataclass(frozen=True)
class Perturbations:
    """A set of perturbations of a given ball, uniformly distributed.

    - ``count``: how many.
    - ``masses``: the largest relative error of each mass, including the shell's.
    - ``offset``: the largest error of each coordinate of the shell's centre of mass, in radii; for a disk, of those in
      its plane.
    - ``seed``: of the random numbers.

    **Raises:** :class:`DesignError` for a count below 1, and for errors that are negative or so large that a mass may
    vanish.
    """

    count: int = 64
    masses: float = 0.02
    offset: float = 0.01
    seed: int = 0

    def __post_init__(self):
        if self.count < 1:
            raise DesignError(f"Argument `count` must be 1 or more, but it is {self.count}.")
        for name in ("masses", "offset"):
            if not 0 <= getattr(self, name) < 1:
                raise DesignError(f"Argument `{name}` must be at least 0 and below 1, but it is {getattr(self, name)}.")

    def errors(self, system: System) -> Errors:
        """The errors of all balls, on a leading axis."""
        random, count = np.random.default_rng(self.seed), self.count
        groups = [random.uniform(-1, 1, (count, *group.mass.shape)) for group in system.groups]
        shell, offset = random.uniform(-1, 1, count), random.uniform(-1, 1, (count, 3))
        if isinstance(system, Disk):
            offset[:, 1] = 0.0
        return Errors(
            jnp.asarray(self.masses * shell),
            jnp.asarray(self.offset * offset),
            tuple(jnp.asarray(self.masses * group) for group in groups),
        )


def perturbed_system(system: System, errors: Errors) -> System:
    """One system with its errors; traceable."""
    shell = (system.mass * (1 + errors.shell), system.offset + system.radius * errors.offset)
    masses = [group.mass * (1 + error) for group, error in zip(system.groups, errors.masses, strict=True)]
    system = eqx.tree_at(lambda s: (s.mass, s.offset), system, shell)
    return eqx.tree_at(lambda s: [group.mass for group in s.groups], system, masses) if masses else system
