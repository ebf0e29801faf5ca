"""The optimal control of a rolling ball or disk: its masses on rails are accelerated, u = θ̈."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...interface.status import Status
from ...numerics.arrays import Numbers, to_array
from ...numerics.vectors import apply
from ...physics.body import PointMass, System, with_integrated_angles, with_masses
from ...physics.feedback import AbstractLaw
from ...physics.moments import velocity_moments
from ...physics.motion import Driven, OnRail
from ...physics.packing import Packing
from ...physics.schedules import AbstractSchedule
from ...physics.state import BallState, DiskState
from ..constraints import AbstractRunningConstraint
from ..errors import DesignError
from ..objectives import AbstractRunningObjective, FollowTrajectory
from ..plane import require_reach
from ..run import Run
from .problem import AbstractControlProblem


class Given(AbstractLaw):
    """θ̈ = u, given numbers."""

    u: Float[Array, " driven"]

    def __call__(self, t, state):
        return self.u


class Rolling(AbstractControlProblem):
    """A ball or a disk that rolls from its initial state to rest, in equilibrium.

    The running cost is the sum of the ``objectives``, and the state the vector of
    :class:`~jaxball.physics.packing.Packing`, with θ and θ̇ of the masses on rails. The conditions at the end are
    θ̇ = 0, Ω = 0, that the centre of mass is straight above or below the geometric centre, and what ``place`` and
    ``depth`` ask for, if they are given. The inequalities are the ``constraints``.
    """

    system: System
    state: BallState | DiskState
    start: Float[Array, ""]
    end: Float[Array, ""]
    objectives: dict[str, AbstractRunningObjective]
    constraints: dict[str, AbstractRunningConstraint]
    place: Float[Array, " d"] | None
    depth: Float[Array, ""] | None
    softness: Float[Array, ""]

    def __init__(
        self,
        system: System,
        times: Numbers,
        objectives: Mapping[str, AbstractRunningObjective],
        state: BallState | DiskState | None = None,
        place: Numbers | None = None,
        depth: Numbers | None = None,
        softness: Numbers = 0.0,
        constraints: Mapping[str, AbstractRunningConstraint] | None = None,
    ):
        """The problem for a system whose masses on rails have schedules.

        **Arguments:**

        - ``system``: a ball or a disk with masses on rails.
        - ``times``: of the start and of the end.
        - ``state``: at the start; at rest at the origin if not given. θ and θ̇ are those of the schedules.
        - ``place``: of the geometric centre at the end, (z1, z2) of a ball or z of a disk; free if not given.
        - ``depth``: by how much the centre of mass is below the geometric centre at the end, in radii; free if not
          given, and where it comes to be negative it is above, and the equilibrium unstable.
        - ``softness``: of the conditions at the end, see :class:`AbstractControlProblem`.
        - ``constraints``: what holds at all times.

        **Raises:** :class:`DesignError` for a system without masses on rails, for a disk that cannot meet an objective
        or a constraint, and for a place of another size, and ``ValueError`` for a system with a feedback law.
        """
        start, end = (to_array(t) for t in to_array(times))
        driven, angles = with_integrated_angles(system, start)
        if not driven.driven:
            raise DesignError("Argument `system` must have a mass on a rail to be controlled, but it has none.")
        given = system.state_type() if state is None else state
        fields = {field.name: getattr(given, field.name) for field in dataclasses.fields(given)}
        self.system = eqx.tree_at(lambda s: s.law, driven, Given(angles["theta"]))
        self.state = system.state_type(**fields | angles)
        self.start, self.end = start, end
        self.objectives = {name: _in_time(one, start, end) for name, one in objectives.items()}
        self.constraints = dict(constraints or {})
        self.depth = None if depth is None else to_array(depth)
        self.softness = to_array(softness)
        self.place = None if place is None else jnp.atleast_1d(to_array(place))
        if self.place is not None and self.place.shape != (np.size(given.z),):
            raise DesignError(
                f"Argument `place` must be {'one number' if system.planar else 'two numbers'}, as that of a "
                f"{system.title} is, but it is {np.asarray(place).tolist()}."
            )
        require_reach(system, {**self.objectives, **self.constraints})

    @property
    def controls(self) -> int:
        """The number of masses on rails."""
        return len(self.system.driven)

    @property
    def initial(self) -> Float[Array, " n"]:
        return self.packing.pack(self.start, self.state)

    @property
    def packing(self) -> Packing[Any, Any]:
        """How states become vectors."""
        return Packing.of(self.system.prepare(), self.state)

    def rate(self, t, x, u):
        return self._packing_with(u).field(t, x)

    def cost(self, t, x, u):
        terms = self.terms(t, x, u)
        return sum((one.weight * terms[name] for name, one in self.objectives.items()), start=jnp.zeros_like(t))

    def terms(self, t: Float[Array, ""], x: Float[Array, " n"], u: Float[Array, " m"]) -> dict[str, Float[Array, ""]]:
        """The objectives at one time, without their weights."""
        run = self._run(t, x, u)
        return {name: one.integrand(run)[0] for name, one in self.objectives.items()}

    def inequalities(self, t, x, u):
        run = self._run(t, x, u)
        parts = [jnp.ravel(one.margins(run)) for one in self.constraints.values()]
        return jnp.concatenate([super().inequalities(t, x, u), *parts])

    def conditions(self, x):
        packing = self.packing
        state = packing.unpack(self.end, x)
        at = velocity_moments(packing.system, self.end, (state.theta, state.thetadot))
        away = apply(state.Lambda, at.p) / (at.M * self.system.radius)
        flat = isinstance(state, DiskState)
        parts = [state.thetadot, state.phidot[None] if flat else state.Omega, away[:1] if flat else away[:2]]
        if self.depth is not None:
            parts.append((away[2] + self.depth)[None])
        if self.place is not None:
            parts.append((jnp.atleast_1d(state.z) - self.place) / self.system.radius)
        return jnp.concatenate(parts)

    def with_schedules(self, schedules: Sequence[AbstractSchedule]) -> System:
        """The system in which the masses on rails follow ``schedules``, in their order."""
        masses, following = list(self.system.point_masses), iter(schedules)
        for index in self.system.driven:
            motion = masses[index].motion
            assert isinstance(motion, Driven)
            masses[index] = PointMass(masses[index].mass, OnRail(motion.rail, next(following)))
        return with_masses(self.system, masses)

    def _run(self, t: Float[Array, ""], x: Float[Array, " n"], u: Float[Array, " m"]) -> Run:
        """A run of one time."""
        packing = self._packing_with(u)
        state = jax.tree.map(lambda leaf: leaf[None], packing.unpack(t, x))
        return Run(packing.system, t[None], state, jnp.asarray(Status.SUCCESS))

    def _packing_with(self, u: Float[Array, " m"]) -> Packing[Any, Any]:
        packing = self.packing
        return eqx.tree_at(lambda p: p.system.law, packing, Given(u))


def rolling(problem: AbstractControlProblem) -> Rolling:
    """The problem itself.

    **Raises:** :class:`DesignError` where it is that of another system.
    """
    if not isinstance(problem, Rolling):
        raise DesignError(
            f"Argument `solution` must be of a rolling ball or disk, but it is of a {type(problem).__name__}."
        )
    return problem


def between(ends: tuple[Rolling, Rolling], share: Float[Array, ""]) -> Rolling:
    """A problem on the way from one to another: all numbers go straight, and positive weights at a constant ratio.

    From the first at ``share`` 0 to the second at 1. Both must be of the same structure.

    **Arguments:**

    - ``ends``: both problems.
    """
    first, second = ends
    mixed = jax.tree.map(lambda a, b: a + share * (b - a) if eqx.is_inexact_array(a) else a, first, second)

    def weight(name: str) -> Float[Array, ""]:
        a, b = first.objectives[name].weight, second.objectives[name].weight
        positive = (a > 0) & (b > 0)
        a, b = jnp.where(positive, a, 1.0), jnp.where(positive, b, 1.0)
        return jnp.where(positive, a * (b / a) ** share, mixed.objectives[name].weight)

    names = list(first.objectives)
    return eqx.tree_at(lambda p: [p.objectives[name].weight for name in names], mixed, [weight(name) for name in names])


def _in_time(objective: AbstractRunningObjective, start, end) -> AbstractRunningObjective:
    """An objective that is told when the run starts and ends, where that matters."""
    if not isinstance(objective, FollowTrajectory):
        return objective
    times = [start if objective.start is None else objective.start, end if objective.end is None else objective.end]
    return dataclasses.replace(objective, start=times[0], end=times[1])
