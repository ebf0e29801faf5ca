"""The optimal control of a rolling ball or disk, by accelerations of its masses and forces of its motors."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ....interface.names import leave_to
from ....interface.status import Status
from ....interface.wording import all_of
from ....numerics.arrays import Numbers, to_array
from ....physics.body import System
from ....physics.dynamics.footing import locate_surface
from ....physics.forces.force import AbstractForce
from ....physics.packing import Packing
from ....physics.prescribed.schedules import AbstractSchedule
from ....physics.prescribed.signals import AbstractSignal
from ....physics.state import BallState, DiskState
from ....simulation.equilibrium import Imbalance, imbalance, moves_under
from ..objectives import FollowTrajectory
from ..problem.requirements import (
    AbstractRunningConstraint,
    AbstractRunningObjective,
    require_possible,
    require_reachable,
)
from ..problem.run import Run, locate_centre
from ..problem.space import DesignError
from .collocation import BARRIER, SHARP
from .problem import (
    VIOLATION,
    AbstractControlProblem,
    MotorIndex,
    Path,
    inputs,
    motor_limits,
    with_inputs,
    with_schedules,
)

if TYPE_CHECKING:
    from .solution import Solution


class Rolling(AbstractControlProblem):
    """A ball or a disk that rolls from its initial state to rest, in equilibrium.

    The controls are θ̈ of the masses on rails, of joints with schedules, and of angles of a
    :class:`~jaxball.physics.TiltingPlane` with schedules, and then the force or torque Q of every joint that has a
    :class:`~jaxball.Motor`; the schedules and signals in the given system are not used. Springs and dampers stay,
    joints without a motor move freely, and surfaces move as their ``motion`` or their function says.

    The running cost is the sum of the ``objectives``, and the state is the body's, packed into a vector. The conditions
    at the end are θ̇ = 0, Ω = 0, that the centre of mass is on the vertical through the contact point (on a level
    plane, straight above or below the geometric centre), that no force acts on joints without a motor, and, if given,
    ``place`` and ``depth``. The inequalities are the ``constraints`` and the limits of motors.
    """

    robot: System
    system: System
    motors: tuple[MotorIndex, ...] = eqx.field(static=True)
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
        """Builds the problem for a robot.

        **Arguments:**

        - ``system``: a ball or a disk with masses on rails, joints with schedules, or motors, or on a plate whose
          angles have schedules.
        - ``times``: the start and the end.
        - ``state``: at the start; at rest at the origin if not given. It has θ and θ̇ of free joints only; the others
          follow from the schedules.
        - ``place``: the position of the geometric centre at the end, (z1, z2) for a ball or z for a disk; on a surface
          its position in space, along e1 and e2, or along e1; free if not given.
        - ``depth``: how far the centre of mass is below the geometric centre at the end, along the vertical, in radii;
          free if not given. A negative depth is above, an unstable equilibrium.
        - ``softness``: of the conditions at the end, see :class:`AbstractControlProblem`. Where some of them follow
          from others, as for a ball with rotors, which stop when it stops, 1e-7 makes the problem regular.
        - ``constraints``: those that must hold at all times.

        **Raises:** :class:`DesignError` for a system without controls, for one on a turntable, where nothing can rest,
        or on a surface that moves at the end, for one with joints that stick or exact dry resistance, for an objective
        or a constraint that a disk cannot meet, and for a ``place`` of the wrong size, and ``ValueError`` for a system
        with a feedback law, and for one with free joints but no state.
        """
        start, end = (to_array(t) for t in to_array(times))
        if system.ground is not None and system.ground.carriers:
            carrier = system.ground.moves
            raise DesignError(
                f"Argument `system` must be on a ground on which it can come to rest, but it is on a {carrier}."
            )
        if system.shape is not None:
            raise DesignError(
                "Argument `system` must be a Ball or a Disk, because collocation has their equations alone, but it is "
                f"a {type(system).__name__}."
            )
        if system.is_held:
            raise DesignError(
                "Argument `system` must not have exact dry resistance, because collocation is for smooth motions; "
                "leave `exact` of its `resistance` out."
            )
        if system.sticking:
            raise DesignError(
                "Argument `system` must have no joints that stick, because collocation is for smooth motions, but "
                f"{all_of(system.sticking)} {'has' if len(system.sticking) == 1 else 'have'} a JointFriction or "
                "HardStops; give the former `smoothing`, and EndStops in place of the latter."
            )
        if system.own_states is not None:
            raise DesignError(
                "Argument `system` must have no states of its own, because collocation has unknowns for the motion of "
                f"a body alone, but it has {all_of(system.own_states.names)}; leave its `own_states` out."
            )
        controls = inputs(system, start, state)
        start_state = system.state_type() if state is None else state
        self.robot, self.system, self.motors = system, controls.system, controls.motors
        # θ of everything accelerated is part of the state here, whereas a user's state has that of free joints only.
        self.state = system.state_type(**vars(start_state) | {"theta": controls.theta, "thetadot": controls.thetadot})
        self.start, self.end = start, end
        _require_rest(self.system, end, self.state)
        self.objectives = {name: _in_time(objective, start, end) for name, objective in objectives.items()}
        self.constraints = dict(constraints or {}) | motor_limits(system, controls.motors)
        self.depth = None if depth is None else to_array(depth)
        self.softness = to_array(softness)
        self.place = None if place is None else jnp.atleast_1d(to_array(place))
        if self.place is not None and self.place.shape != (np.size(start_state.z),):
            raise DesignError(
                f"Argument `place` must be {'one number' if system.planar else 'two numbers'}, as that of a "
                f"{system.title} is, but it is {np.asarray(place).tolist()}."
            )
        require_reachable(system, {**self.objectives, **self.constraints})
        require_possible(float(system.radius), {**self.objectives, **self.constraints})

    @property
    def controls(self) -> int:
        """The number of accelerations and of motors."""
        return len(self.system.accelerated) + len(self.motors)

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
        return sum(
            (objective.weight * terms[name] for name, objective in self.objectives.items()), start=jnp.zeros_like(t)
        )

    def terms(self, t: Float[Array, ""], x: Float[Array, " n"], u: Float[Array, " m"]) -> dict[str, Float[Array, ""]]:
        """Computes the objectives at one time, without their weights."""
        run = self._run(t, x, u)
        return {name: objective.integrand(run)[0] for name, objective in self.objectives.items()}

    def inequalities(self, t, x, u):
        run = self._run(t, x, u)
        parts = [jnp.ravel(constraint.margins(run)) for constraint in self.constraints.values()]
        return jnp.concatenate([super().inequalities(t, x, u), *parts])

    def conditions(self, x):
        packing, system, r = self.packing, self.system, self.system.radius
        state, left = packing.unpack(self.end, x), self.imbalance_at_end(x)
        flat = system.planar
        # The centre of mass of a disk can only be beside along e1.
        beside = left.beside[:1] if flat else left.beside
        parts = [state.thetadot, jnp.atleast_1d(getattr(state, state.rotation_rate)), beside / r]
        ground, force = system.ground, system.force
        # On a level plane, gravity and a force at the geometric centre have no moment about the vertical once the
        # conditions above hold. Where they may have one, it must vanish too.
        if not flat and force is not None and (ground is not None or not isinstance(force, AbstractForce)):
            parts.append(left.torque[2:] / (left.M * r * system.gravity))
        parts.append(left.efforts[self._without_motor] / (left.M * r * system.gravity))
        if self.depth is not None:
            parts.append((self.depth - left.below / r)[None])
        if self.place is not None:
            centre = locate_centre(packing.system, self.end, state)
            parts.append((centre[: self.place.size] - self.place) / r)
        return jnp.concatenate(parts)

    def imbalance_at_end(self, x: Float[Array, " n"]) -> Imbalance:
        """Computes what the motors must hold, and what else keeps the body from resting, in its final configuration."""
        return imbalance(self.without_controls, self.end, self.packing.unpack(self.end, x))

    @property
    def without_controls(self) -> System:
        """The prepared system with u = 0."""
        packing = self.packing
        return with_inputs(packing.system, self.motors, jnp.zeros(self.controls, self.start.dtype))

    @property
    def motor_slots(self) -> Int[np.ndarray, " motors"]:
        """The indices in θ of the joints that motors drive."""
        first, joints = len(self.system.driven), self.system.joints
        return np.asarray([first + joints.index((place.mechanism, place.joint)) for place in self.motors], dtype=int)

    @property
    def _without_motor(self) -> Int[np.ndarray, " joints"]:
        """The indices in θ of the free joints that no motor drives."""
        driven = {*self.system.accelerated, *self.motor_slots.tolist()}
        return np.asarray([k for k in range(len(self.system.coordinates)) if k not in driven], dtype=int)

    def with_schedules(
        self, schedules: Sequence[AbstractSchedule] = (), signals: Sequence[AbstractSignal] = ()
    ) -> System:
        """Returns the robot with other schedules of θ, and signals of its motors, in the order of the controls."""
        return with_schedules(self.robot, self.motors, schedules, signals)

    @staticmethod
    def between(ends: tuple["Rolling", "Rolling"], share: Float[Array, ""]) -> "Rolling":
        """Returns a problem between two ``ends``: all numbers are interpolated linearly, and positive weights
        geometrically.

        From the first at ``share`` 0 to the second at 1. Both must be of the same structure.
        """
        first, second = ends
        mixed = jax.tree.map(lambda a, b: a + share * (b - a) if eqx.is_inexact_array(a) else a, first, second)

        def weight(name: str) -> Float[Array, ""]:
            a, b = first.objectives[name].weight, second.objectives[name].weight
            # Where a weight is not positive, the numbers 1 keep the power below, and its gradient, finite.
            positive = (a > 0) & (b > 0)
            a, b = jnp.where(positive, a, 1.0), jnp.where(positive, b, 1.0)
            return jnp.where(positive, a * (b / a) ** share, mixed.objectives[name].weight)

        names = list(first.objectives)
        return eqx.tree_at(
            lambda p: [p.objectives[name].weight for name in names], mixed, [weight(name) for name in names]
        )

    # What can be done with a problem needs modules that are built upon this one.

    def at_rest(self, mesh: Float[np.ndarray, " N_plus_one"], stages: int = 3) -> Path:
        """Returns the path on which nothing moves, with the controls that keep the body as close to rest as possible.

        **Arguments:**

        - ``mesh``: times, the start first and the end last, shape (N + 1,).
        - ``stages``: how many nodes of Gauss an interval has.
        """
        from .guess import driving

        initial, shape = np.asarray(self.initial), (len(mesh) - 1, stages)
        u = driving(self, mesh[:1], initial[None], np.zeros((1, initial.size)))[0]
        states = np.tile(initial, (len(mesh), 1)), np.tile(initial, (*shape, 1))
        return Path(mesh, *states, np.tile(u, (*shape, 1)))

    @leave_to(".guess")
    def rolling_along(self, mesh: Float[np.ndarray, " N_plus_one"], stages: int = 3) -> Path:
        """Makes a guess with the geometric centre on the desired path, and the masses where gravity turns the ball
        accordingly.

        The ball rolls without spin: ω = n × (ċ − w) / r, with n = e3 and w = 0 on a plane. The centre of mass begins in
        its initial position, in space axes. Then the balance of the momentum about the contact point, γ × Λp = d(ΛΠ)/dt
        + (ċ − w) × ΛP − Mr γ × n, with γ = g e3 on a level plane, determines how far it must be from the vertical
        through the centre, while its distance from the centre is kept. Where angles of a plate are controls, it
        determines n instead. θ follows by the smallest changes, and the controls are those that come closest to such a
        motion. The path then fulfils the equations of motion except for spin and for the effect of the masses' own
        motion.

        **Arguments:**

        - ``mesh``: times, the start first and the end last, shape (N + 1,).
        - ``stages``: how many nodes of Gauss an interval has.

        **Raises:** :class:`~jaxball.studies.design.DesignError` where no objective is a
        :class:`~jaxball.studies.design.FollowTrajectory`, where gravity cannot accelerate the ball as desired, and
        where the path leaves the ground.
        """
        raise NotImplementedError

    def solve(
        self,
        mesh: Float[np.ndarray, " N_plus_one"],
        stages: int = 3,
        tolerance: float = 1e-6,
        *,
        guess: Path | None = None,
        barrier: float | None = None,
        free_end_time: tuple[float, float] | None = None,
        time_weight: Numbers = 1.0,
        sharp: float = SHARP,
        violation: float = VIOLATION,
    ) -> "Solution":
        """Solves by Newton's method from a ``guess``.

        From rest it converges to small motions; for others, start from :meth:`rolling_along` the desired path. The
        ``barrier`` keeps the solution away from constraints, until :meth:`Solution.sharpen` lets it approach them.

        With a ``free_end_time`` the end is another unknown, and the solution, which is sharp, that of the problem with
        the end found. What is least then is the mean of the running cost, and ``time_weight`` times the duration over
        that of ``mesh``; without objectives it is the duration alone, which limits of motors or other constraints
        bound. A :class:`~jaxball.studies.design.FollowTrajectory` arrives when the run ends.

        **Arguments:**

        - ``mesh``: times, the start first and the end, or a guess of it, last, shape (N + 1,).
        - ``stages``: how many nodes of Gauss an interval has.
        - ``tolerance``: the largest error of an interval of the mesh.
        - ``guess``: where Newton's method starts, a path on any mesh; :meth:`at_rest` if not given.
        - ``barrier``: µ; if not given 0.01, or 1 with a free end.
        - ``free_end_time``: the shortest and the longest end time; the end is the last of ``mesh`` if not given.
        - ``time_weight``, ``sharp``, ``violation``: with a free end, the weight of the duration, and ``barrier`` and
          ``violation`` of :meth:`Solution.sharpen`.

        **Raises:** :class:`~jaxball.studies.design.DesignError` where it does not converge, before that for an end at
        which the centre of mass cannot be where the robot could rest, and unless the guess of the end lies between
        ``free_end_time``, and these after the start.
        """
        from .solve import BARRIER_OF_TIME, FreeEndTime, fix_end, solve_from_guess

        free = None if free_end_time is None else FreeEndTime(*map(float, (*free_end_time, np.asarray(time_weight))))
        make = Rolling.at_rest if guess is None else lambda *arguments: guess
        first = (BARRIER if free is None else BARRIER_OF_TIME) if barrier is None else barrier
        rough = solve_from_guess(self, mesh, stages, tolerance, make, first, free)
        return rough if free is None else fix_end(rough.sharpen(sharp, tolerance, violation))

    def _run(self, t: Float[Array, ""], x: Float[Array, " n"], u: Float[Array, " m"]) -> Run:
        """Builds a run of one time."""
        packing = self._packing_with(u)
        # A leading axis of one time, as objectives and constraints are functions of runs.
        state = jax.tree.map(lambda leaf: leaf[None], packing.unpack(t, x))
        return Run(packing.system, t[None], state, jnp.asarray(Status.SUCCESS))

    def _packing_with(self, u: Float[Array, " m"]) -> Packing[Any, Any]:
        # Only the law and the signals are replaced: what was prepared is not prepared again for each u.
        packing = self.packing
        return eqx.tree_at(lambda p: p.system, packing, with_inputs(packing.system, self.motors, u))


def _require_rest(system: System, end: Float[Array, ""], state: BallState | DiskState) -> None:
    """Refuses a surface that moves at the end near the place of ``state``, where nothing could rest."""
    surface = locate_surface(system.prepare(), end, eqx.tree_at(lambda s: s.thetadot, state, 0 * state.thetadot))
    if surface is not None and moves_under(surface, end, system.radius, jnp.abs(system.gravity), state.z):
        raise DesignError(
            "Argument `system` must be on a ground that is at rest at the end of `times`, so that it can come to rest "
            f"there, but its {type(system.ground).__name__} moves at t = {float(end):g}; let the ground stop before."
        )


def rolling(problem: AbstractControlProblem) -> Rolling:
    """Returns the problem itself.

    **Raises:** :class:`DesignError` where it belongs to another kind of problem.
    """
    if not isinstance(problem, Rolling):
        raise DesignError(f"The solution must be of a rolling ball or disk, but it is of a {type(problem).__name__}.")
    return problem


def _in_time(objective: AbstractRunningObjective, start, end) -> AbstractRunningObjective:
    """Returns an objective that knows when the run starts and ends, where that matters."""
    if not isinstance(objective, FollowTrajectory):
        return objective
    # Within the problem a run is a single time, whose first and last time do not say when the motion starts and ends.
    times = [start if objective.start is None else objective.start, end if objective.end is None else objective.end]
    return dataclasses.replace(objective, start=times[0], end=times[1])
