"""Which parameters a body can have, and from which states a solve can start."""

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from ..classical import AbstractClassicalState, AbstractClassicalSystem
from ..numerics.arrays import Numbers, default_dtype, to_array, to_numpy
from ..numerics.vectors import cross, dot
from .body import Ball, Disk, System
from .breaches import Breach, breaches
from .conditions import UNIT, Condition, positive, positive_inertia, real_inertia, versor
from .confinement import beside, confined, rounding, time_samples
from .moments import kinematics
from .packing import Packing
from .simulable import SimulableState, SimulableSystem, require_system
from .state import BallState, ReducedState, RotationState, State


class Problem(NamedTuple):
    """A number that cannot be: its name in Python, and what it must do and does, each a clause."""

    name: str
    must: str
    but: str

    @classmethod
    def of(cls, breach: Breach) -> "Problem":
        """The problem that a rail or a mass is not in the body."""
        motion = f"masses[{breach.mass}].motion"
        names = {"theta": "state.theta", "law": "law", "": motion}
        return cls(names.get(breach.part, f"{motion}.{breach.part}"), breach.must, breach.but)

    def sentence(self, kind: str = "Argument", name: str | None = None) -> str:
        """The problem in a sentence, in which the number may have another name."""
        return f"{kind} `{self.name if name is None else name}` must {self.must}, but {self.but}."


def shell_conditions(system: System) -> Iterator[Condition]:
    """Every condition that the parameters of the shell must meet; traceable."""
    yield Condition(positive(system.mass), "mass", system.mass, "a positive number")
    yield Condition(positive(system.radius), "radius", system.radius, "a positive number")
    yield positive_inertia(system.inertia)
    if isinstance(system, Ball):
        yield real_inertia(system.inertia)
    yield Condition(jnp.isfinite(system.gravity), "gravity", system.gravity, "a finite number")
    yield Condition(
        jnp.sum(system.offset**2) <= system.radius**2,
        "offset",
        system.offset,
        "a point inside the shell, nearer to the centre than the radius",
    )
    if isinstance(system, Disk):
        flat = ~beside(system, system.offset)
        yield Condition(flat, "offset", system.offset, "in the plane of a disk, E1 and E3, with second entry 0")


def possible(system: SimulableSystem) -> Bool[Array, ""]:
    """Whether a body with these parameters can exist; traceable."""
    if isinstance(system, AbstractClassicalSystem):
        return _all(system.conditions())
    masses = [positive(group.mass) for group in system.groups]
    return jnp.all(jnp.stack([c.holds for c in shell_conditions(system)] + masses))


def state_conditions(state: SimulableState) -> Iterator[Condition]:
    """Every condition that an initial state must meet; traceable. What is not finite meets none."""
    if isinstance(state, AbstractClassicalState):
        yield from state.conditions()
        return
    if isinstance(state, BallState):
        yield versor(state.q)
    if isinstance(state, RotationState):
        excess = jnp.sum(state.Lambda[:, :, None] * state.Lambda[:, None, :], axis=0) - jnp.eye(3, dtype=state.z.dtype)
        right_handed = dot(cross(state.Lambda[0], state.Lambda[1]), state.Lambda[2]) > 0
        holds = (jnp.max(jnp.abs(excess)) < UNIT) & right_handed
        yield Condition(holds, "state.Lambda", state.Lambda, "a rotation matrix")
    if isinstance(state, ReducedState):
        size = jnp.sum(state.Gamma**2)
        yield Condition(jnp.abs(size - 1) < UNIT, "state.Gamma", state.Gamma, "a unit vector")
    for name, value in zip(_names(state), jax.tree.leaves(state), strict=True):
        yield Condition(jnp.all(jnp.isfinite(value)), f"state.{name}", value, "finite")


def possible_state(state: SimulableState) -> Bool[Array, ""]:
    """Whether a solve can start from this state; traceable."""
    return _all(state_conditions(state))


def possible_start(
    system: SimulableSystem, times: Float[Array, " T"], state: SimulableState, inside: bool = True
) -> Bool[Array, ""]:
    """Whether a solve of ``system`` over ``times`` can start from ``state``; traceable.

    ``inside`` says whether masses and rails must be in the body.
    """
    holds = possible(system) & possible_state(state)
    if isinstance(system, AbstractClassicalSystem):
        return holds & _all(system.start_conditions(times[0], state))
    if inside and not isinstance(state, AbstractClassicalState):
        holds &= confined(system.prepare(), times, state) & _all(_force_in_plane(system, times))
    return holds


def problems(system: SimulableSystem, state: SimulableState | None = None, t: Numbers = 0.0) -> list[str]:
    """One sentence for each number of a body, and of its state, that cannot be; empty when all is well.

    **Arguments:**

    - ``system``: a body, or a system of :mod:`jaxball.classical`.
    - ``state``: the state at the start; not looked at if not given.
    - ``t``: the time of the start, or the times of a run, in which prescribed motions must stay in the body.

    **Example:**

    >>> from jaxball import Ball, problems
    >>> problems(Ball(mass=-1.0, inertia=(1.0, 1.0, 1.0)))
    ['Argument `mass` must be a positive number, but it is -1.0.']
    """
    require_system(system)
    return [problem.sentence() for problem in find_problems(system, state, np.atleast_1d(to_numpy(t, "t")))]


def find_problems(
    system: SimulableSystem,
    state: SimulableState | None,
    times: Float[np.ndarray, " T"],
    theta: Float[np.ndarray, "T driven"] | None = None,
) -> list[Problem]:
    """What :func:`problems` says, before it is said; with ``theta`` of a run, also where it carried its masses."""
    classical = isinstance(system, AbstractClassicalSystem)
    conditions = list(system.conditions() if classical else shell_conditions(system))
    if not classical:
        for index, item in enumerate(system.point_masses):
            conditions.append(Condition(positive(item.mass), f"masses[{index}].mass", item.mass, "a positive number"))
    if state is not None:
        conditions.extend(state_conditions(state))
    if state is not None and classical:
        conditions.extend(system.start_conditions(jnp.asarray(times[0], default_dtype()), state))
    if not classical:
        conditions.extend(_force_in_plane(system, jnp.asarray(times, default_dtype())))
    found = [
        Problem(c.name, f"be {c.must}", f"it is {np.asarray(c.value).tolist()}")
        for c in conditions
        if not bool(c.holds)
    ]
    if not classical:
        if theta is None and state is not None:
            theta = np.asarray(getattr(state, "theta"))[None]  # noqa: B009
        found.extend(map(Problem.of, breaches(system, times, theta)))
    if state is not None and not found:
        found.extend(_beyond_arithmetic(system, state, times[0]))
    return found


def _beyond_arithmetic(system: SimulableSystem, state: SimulableState, t: float) -> Iterator[Problem]:
    """What keeps the vector of the initial state, or its rate of change, from being finite, though each number is."""
    if isinstance(system, AbstractClassicalSystem) or isinstance(state, AbstractClassicalState):
        return
    packed, slope, places, rates = jax.tree.map(np.asarray, _at_start(system, state, t))
    if np.all(np.isfinite(packed) & np.isfinite(slope)):
        return
    wild = np.flatnonzero(~np.all(np.isfinite(places) & np.isfinite(rates), axis=1))
    for index in wild:
        given = f"it gives {places[index].tolist()} and {rates[index].tolist()}"
        yield Problem(f"masses[{index}].motion", f"give a finite place and a finite velocity at t = {t:g}", given)
    if wild.size:
        return
    name, value = max(_numbers(system, state), key=lambda item: abs(np.log(abs(item[1]))))
    if np.all(np.isfinite(packed)) and abs(np.log(abs(value))) < np.log(np.finfo(packed.dtype).max) / 4:
        return  # then it is something else, such as a force, that is not finite
    must = f"be closer to 1, as in other units, because products of such numbers are beyond the range of {packed.dtype}"
    yield Problem(name, must, f"it is {value:g}")


@eqx.filter_jit
def _at_start(system: System, state: State, start: Float[ArrayLike, ""]):
    """The vector that a solve would start from, its rate of change, and places and velocities of the masses."""
    prepared, t = system.prepare(), to_array(start)
    at = kinematics(prepared, t, (state.theta, state.thetadot, jnp.zeros_like(state.theta)))
    packing = Packing.of(prepared, state)
    packed = packing.pack(t, state)
    return packed, packing.field(t, packed), at.chi, at.chidot


def _numbers(system: System, state: State) -> Iterator[tuple[str, float]]:
    """The parameters of the body and the state, entry by entry, but those that are 0."""
    named = [(name, getattr(system, name)) for name in ("mass", "radius", "inertia", "offset", "gravity")]
    named += [(f"masses[{index}].mass", item.mass) for index, item in enumerate(system.point_masses)]
    named += [(f"state.{name}", getattr(state, name)) for name in _names(state)]
    for name, value in named:
        array = np.asarray(value)
        for k in np.argwhere(array != 0):
            yield name + "".join(f"[{i}]" for i in k), float(array[tuple(k)])


def _force_in_plane(system: System, times: Float[Array, " T"]) -> Iterator[Condition]:
    """The condition on the force on a disk, as far as it is seen; traceable."""
    if not isinstance(system, Disk) or system.force is None:
        return
    forces = jax.vmap(system.force)(time_samples(times))
    largest = jnp.max(jnp.abs(forces), axis=0)
    holds = ~(largest[1] > rounding(forces) * jnp.max(largest))
    yield Condition(holds, "force", forces[0], "in the plane of a disk, E1 and E3, at all times")


def _names(state: State) -> list[str]:
    return [field.name for field in dataclasses.fields(state)]


def _all(conditions: Iterator[Condition]) -> Bool[Array, ""]:
    holds = [c.holds for c in conditions]
    return jnp.all(jnp.stack(holds)) if holds else jnp.asarray(True)
