"""The contract of optimal control problems, the polynomials that solve them, and the inputs of a robot in one.

These are accelerations of masses and joints, and forces of motors; ``rolling`` has them as its controls.
"""

import abc
from collections.abc import Iterator, Sequence
from typing import NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....control.inputs import GivenAccelerations
from ....numerics.arrays import Numbers
from ....numerics.vectors import room
from ....physics.body import System
from ....physics.mechanisms import AbstractJointForce, Drive, JointForces, Motor
from ....physics.prescribed.schedules import AbstractSchedule
from ....physics.prescribed.signals import AbstractSignal, ConstantSignal
from ....physics.state import BallState, DiskState, State
from ....simulation.solvers.tableau import gauss
from ..problem.requirements import AbstractRunningConstraint
from ..problem.run import Run
from ..problem.space import DesignError

# The violation of an inequality that is allowed between the nodes.
VIOLATION = 1e-4


class AbstractControlProblem(eqx.Module):
    """Minimise the mean over [start, end] of a running cost, from a given state to one that fulfils end conditions.

    min 1/T ∫ cost(t, x, u) dt  with  ẋ = rate(t, x, u),  x(start) = x_a,  conditions(x(end)) = 0,
    inequalities(t, x, u) ≥ 0,  T = end − start.

    The conditions are in fact conditions(x(end)) = ``softness`` · multipliers, with softness 0 in the problem to be
    solved. A positive softness replaces them by the cost |conditions|² / (2 softness), so that a problem is regular
    even where some of them are redundant to first order; from there, continuation brings the softness to 0.
    """

    start: eqx.AbstractVar[Float[Array, ""]]
    end: eqx.AbstractVar[Float[Array, ""]]
    softness: eqx.AbstractVar[Float[Array, ""]]

    @property
    @abc.abstractmethod
    def controls(self) -> int:
        """The number m of controls."""

    @property
    @abc.abstractmethod
    def initial(self) -> Float[Array, " n"]:
        """x_a."""

    @property
    def free_at_start(self) -> tuple[int, ...]:
        """The indices of the entries of x that x_a does not determine at the start; by default none."""
        return ()

    @abc.abstractmethod
    def rate(self, t: Float[Array, ""], x: Float[Array, " n"], u: Float[Array, " m"]) -> Float[Array, " n"]:
        """Computes ẋ."""

    @abc.abstractmethod
    def cost(self, t: Float[Array, ""], x: Float[Array, " n"], u: Float[Array, " m"]) -> Float[Array, ""]:
        """Computes the running cost at one time."""

    @abc.abstractmethod
    def conditions(self, x: Float[Array, " n"]) -> Float[Array, " k"]:
        """Returns the conditions that must vanish at the end."""

    def inequalities(self, t: Float[Array, ""], x: Float[Array, " n"], u: Float[Array, " m"]) -> Float[Array, " i"]:
        """Returns the functions that must not be negative at any time, with second derivatives everywhere; by default
        none.
        """
        return jnp.zeros_like(t, shape=(0,))


class Path(NamedTuple):
    """States of degree s and controls of degree s − 1 on each interval of a mesh.

    - ``mesh``: times, the start first and the end last, shape (N + 1,).
    - ``knots``, ``nodes``: the states at the starts and the ends of intervals, and at the nodes of Gauss.
    - ``controls``: at the nodes.
    """

    mesh: Float[np.ndarray, " N_plus_one"]
    knots: Float[np.ndarray, "N_plus_one n"]
    nodes: Float[np.ndarray, "N s n"]
    controls: Float[np.ndarray, "N s m"]

    @property
    def state_coefficients(self) -> Float[np.ndarray, "N s_plus_one n"]:
        """The coefficients of the powers of (t − t_k) / h_k, the constant first."""
        fractions = np.concatenate([[0.0], gauss(self.nodes.shape[1]).c])
        return _coefficients(fractions, np.concatenate([self.knots[:-1, None], self.nodes], axis=1))

    @property
    def control_coefficients(self) -> Float[np.ndarray, "N s m"]:
        """The coefficients of the powers of (t − t_k) / h_k, the constant first."""
        return _coefficients(gauss(self.nodes.shape[1]).c, self.controls)

    def within(self, count: int) -> Float[np.ndarray, "N count"]:
        """Returns times spaced evenly in each interval, including both ends."""
        return self.mesh[:-1, None] + np.diff(self.mesh)[:, None] * np.linspace(0.0, 1.0, count)

    def states(self, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k n"]:
        """Evaluates x(t)."""
        interval, share = self._places(times)
        return _values(self.state_coefficients[interval], share)

    def rates(self, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k n"]:
        """Evaluates ẋ(t)."""
        interval, share = self._places(times)
        coefficients = self.state_coefficients
        slopes = coefficients[:, 1:] * np.arange(1.0, coefficients.shape[1])[:, None]
        return _values(slopes[interval], share) / np.diff(self.mesh)[interval, None]

    def inputs(self, times: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k m"]:
        """Evaluates u(t)."""
        interval, share = self._places(times)
        return _values(self.control_coefficients[interval], share)

    def _places(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Finds the interval of each time, and how far within it the time is, from 0 to 1."""
        # The last knot belongs to the last interval, not to one after it.
        interval = np.clip(np.searchsorted(self.mesh, times, side="right") - 1, 0, len(self.mesh) - 2)
        return interval, (times - self.mesh[interval]) / np.diff(self.mesh)[interval]


def _coefficients(fractions: Float[np.ndarray, " s"], values: Float[np.ndarray, "N s d"]) -> Float[np.ndarray, "N s d"]:
    return np.einsum("ij,kjd->kid", np.linalg.inv(np.vander(fractions, increasing=True)), values)


def _values(coefficients: Float[np.ndarray, "k s d"], share: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k d"]:
    powers = np.vander(share, coefficients.shape[1], increasing=True)
    return np.einsum("ks,ksd->kd", powers, coefficients)


MOTOR_LIMITS = "motor-limits"


class MotorIndex(NamedTuple):
    """The position of a motor: the indices of its mechanism, of its joint there, and of the term in a sum of forces."""

    mechanism: int
    joint: int
    term: int | None

    def in_drive(self, drive: Drive) -> Motor:
        """Returns the motor, from the drive of its joint."""
        force = drive if self.term is None else drive.terms[self.term]  # pyright: ignore
        assert isinstance(force, Motor)
        return force

    def replace_motor(self, drive: Drive, motor: Motor) -> AbstractJointForce:
        """Returns the drive of its joint, with another motor."""
        if self.term is None:
            return motor
        assert isinstance(drive, JointForces)
        return JointForces((*drive.terms[: self.term], motor, *drive.terms[self.term + 1 :]))


class Inputs(NamedTuple):
    """The controls: θ̈ of everything that has a schedule, and Q of every motor.

    - ``system``: the same robot, with u in place of schedules and signals.
    - ``theta``, ``thetadot``: those of its state at the start.
    - ``motors``: where the motors are; their entries of u follow those of the schedules.
    """

    system: System
    theta: Float[Array, " coordinates"]
    thetadot: Float[Array, " coordinates"]
    motors: tuple[MotorIndex, ...]


class MotorLimits(AbstractRunningConstraint):
    """The force of every motor, within its limit; shape (t, motors).

    It holds at the nodes. Between them the polynomials may exceed it, in the interval in which the torque leaves its
    limit: a motor cuts that off, so that the end moves. Meshes with limits are therefore refined further.
    """

    most: Float[Array, " motors"]
    motors: tuple[MotorIndex, ...] = eqx.field(static=True)

    def __call__(self, run: Run):
        return (jnp.abs(self._forces(run)) - self.most[None]) / self._unit(run)

    def margins(self, run: Run):
        return room(self._forces(run)[..., None], self.most[None]) / self._unit(run)

    def _forces(self, run: Run) -> Float[Array, "t motors"]:
        motors = _motors_of(run.system, self.motors)
        return jnp.stack([jax.vmap(motor.signal)(run.times) for motor in motors], axis=-1)

    def _unit(self, run: Run) -> Float[Array, "1 motors"]:
        first = np.cumsum([0, *(mechanism.n_joints for mechanism in run.system.mechanisms)])
        return run.effort_units[np.asarray([first[place.mechanism] + place.joint for place in self.motors])][None]


def inputs(system: System, start: Numbers, state: State | None) -> Inputs:
    """Returns the inputs of a system whose free joints are in ``state`` at the start.

    **Raises:** :class:`DesignError` where nothing can be controlled, and for a joint with two motors; ``ValueError``
    for a system with a feedback law.
    """
    motors = tuple(_motors(system))
    driven, angles = system.with_integrated_angles(start, state)
    if not driven.accelerated and not motors:
        raise DesignError(
            "Argument `system` must have a mass on a rail, a joint or an angle of a TiltingPlane with a schedule, or a "
            "joint with a Motor to be controlled, but it has none."
        )
    # Constants take the places of all signals, and one law gives θ̈ to everything that had a schedule. Values of u
    # can then be filled in without a change of the system's structure.
    still = _with_motors(driven, motors, [Motor(0.0)] * len(motors))
    if driven.accelerated:
        still = eqx.tree_at(lambda s: s.law, still, GivenAccelerations(angles["theta"][np.asarray(driven.accelerated)]))
    return Inputs(still, **angles, motors=motors)


def motor_limits(system: System, motors: Sequence[MotorIndex]) -> dict[str, MotorLimits]:
    """Returns the limits of motors as a constraint, if there are any."""
    limits = {place: motor.limit for place, motor in zip(motors, _motors_of(system, motors), strict=True)}
    limited = {place: limit for place, limit in limits.items() if limit is not None}
    return {MOTOR_LIMITS: MotorLimits(jnp.stack(list(limited.values())), tuple(limited))} if limited else {}


def with_inputs(prepared: System, motors: Sequence[MotorIndex], u: Float[Array, " m"]) -> System:
    """Returns the prepared system of :class:`Inputs` with given u; traceable."""
    accelerations, forces = jnp.split(u, [len(prepared.accelerated)])
    if prepared.accelerated:
        prepared = eqx.tree_at(lambda s: s.law, prepared, GivenAccelerations(accelerations))
    if not motors:
        return prepared
    # Mechanisms of the same structure are prepared as one group, whose signals are arrays over its members.
    entries = {place: slot for slot, place in enumerate(motors)}
    pairs: list[tuple[int, MotorIndex]] = []
    values = []
    for index, order in enumerate(prepared.mechanism_order):
        for place in [place for place in motors if place.mechanism == order[0]]:
            pairs.append((index, place))
            values.append(forces[np.asarray([entries[place._replace(mechanism=i)] for i in order])])

    def signals(system):
        drives = [(place, system.mechanism_groups[index].drives[place.joint]) for index, place in pairs]
        return [cast(ConstantSignal, place.in_drive(drive).signal).value for place, drive in drives]

    return eqx.tree_at(signals, prepared, values)


def with_schedules(
    system: System,
    motors: Sequence[MotorIndex],
    schedules: Sequence[AbstractSchedule],
    signals: Sequence[AbstractSignal],
) -> System:
    """Returns the original robot with other schedules of θ and signals of its motors, in the order of u."""
    following = iter(schedules)
    masses = [item.follow(next(following)) if item.schedule is not None else item for item in system.point_masses]
    mechanisms = [
        mechanism.with_drives(
            [next(following) if isinstance(drive, AbstractSchedule) else drive for drive in mechanism.drives]
        )
        for mechanism in system.mechanisms
    ]
    ground = None if system.ground is None else system.ground.follow(list(following))
    moved = type(system)(**{**system.arguments, "masses": masses, "mechanisms": mechanisms, "ground": ground})
    # A computed signal replaces the motor's own; its limit stays.
    limits = [motor.limit for motor in _motors_of(system, motors)]
    return _with_motors(moved, motors, [Motor(s, limit) for s, limit in zip(signals, limits, strict=True)])


def with_free_joints(system: System, state: BallState | DiskState) -> BallState | DiskState:
    """Returns the state of a robot with its schedules restored: θ and θ̇ of its free joints only.

    ``system`` is that of :class:`Inputs`, and ``state`` its state.
    """
    free = np.setdiff1d(np.arange(len(system.coordinates)), np.asarray(system.accelerated, dtype=int))
    return eqx.tree_at(lambda s: (s.theta, s.thetadot), state, (state.theta[..., free], state.thetadot[..., free]))


def _motors(system: System) -> Iterator[MotorIndex]:
    for i, mechanism in enumerate(system.mechanisms):
        for a, drive in enumerate(mechanism.drives):
            terms = dict(enumerate(drive.terms)) if isinstance(drive, JointForces) else {None: drive}
            places = [MotorIndex(i, a, term) for term, force in terms.items() if isinstance(force, Motor)]
            if len(places) > 1:
                raise DesignError(
                    "Argument `system` must have one Motor on a joint to be controlled, but "
                    f"mechanisms[{i}].joints[{a}] has {len(places)}; combine them into one."
                )
            yield from places


def _motors_of(system: System, motors: Sequence[MotorIndex]) -> list[Motor]:
    mechanisms = system.mechanisms
    return [place.in_drive(mechanisms[place.mechanism].drives[place.joint]) for place in motors]


def _with_motors(system: System, places: Sequence[MotorIndex], motors: Sequence[Motor]) -> System:
    mechanisms = list(system.mechanisms)
    for place, motor in zip(places, motors, strict=True):
        drives = list(mechanisms[place.mechanism].drives)
        drives[place.joint] = place.replace_motor(drives[place.joint], motor)
        mechanisms[place.mechanism] = mechanisms[place.mechanism].with_drives(drives)
    return type(system)(**{**system.arguments, "mechanisms": mechanisms})
