"""The contract of feedback, the nominal motion that it holds, and feedforward alone.

``track``, ``prediction`` and :mod:`jaxball.control.estimation` implement the contract; ``loop`` simulates a robot under
it.
"""

import abc
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .. import programs
from ..interface.arguments import require
from ..interface.compat import is_traced
from ..interface.names import leave_to
from ..interface.printing import Printed
from ..interface.status import BACK_WITHIN
from ..numerics.arrays import Numbers, default_dtype
from ..physics.body import Ball, Disk, System
from ..physics.contact.law import Contact
from ..physics.forces.force import AbstractWrench
from ..physics.observables import Observables
from ..physics.prescribed.schedules import AbstractSchedule
from ..physics.state import BallState, DiskState, PlacedState, RotationState
from ..simulation.simulate import simulate
from ..simulation.trajectory import Trajectory
from .inputs import Place, drive_without_motors
from .sampled import SampledSystem
from .weights import Weights

if TYPE_CHECKING:
    from .basins import Basin
    from .loop import ClosedLoop

GAUSS = (0.5 - 0.5 / 3**0.5, 0.5 + 0.5 / 3**0.5)  # of a sample
MISSING = 1e-9  # of a sample, by which a run may be shorter than a whole number of them


class NominalMotion(Printed):
    """A motion of a sampled system. After its end, the last state and the last input are held.

    - ``times``: of the samples, and the end, shape (N + 1,).
    - ``states``: those at ``times``.
    - ``u``: the inputs held over each sample, shape (N, m).
    """

    times: Float[Array, " samples_and_end"]
    states: PlacedState
    u: Float[Array, "samples m"]

    @property
    def samples(self) -> int:
        """The number N of samples."""
        return self.u.shape[0]

    def state(self, k: Int[Array, ""] | int) -> PlacedState:
        """Returns the state at sample ``k``."""
        return jax.tree.map(lambda leaf: leaf[jnp.minimum(k, self.samples)], self.states)

    def input(self, k: Int[Array, ""] | int) -> Float[Array, " m"]:
        """Returns the inputs of sample ``k``."""
        return self.u[jnp.minimum(k, self.samples - 1)]


def require_motion(run: Any) -> None:
    """Refuses anything but one finished run of a body that rolls, from a full state.

    **Raises:** ``TypeError`` for anything else, ``ValueError`` for several runs and one of a reduced state or with a
    law of contact, and :class:`~jaxball.SolveError` for one that failed.
    """
    require("run", run, Trajectory, "a trajectory, as simulate(...) returns")
    require("run.system", run.system, (Ball, Disk), "a Ball or a Disk")
    if not isinstance(run.state, BallState | RotationState | DiskState):
        raise ValueError(
            f"Argument `run` must have full states, but it is a run of a {type(run.state).__name__}, which does not "
            "contain the position of the ball; simulate with a BallState."
        )
    if run.history.coefficients:
        raise ValueError(
            "Argument `run` must be one of a body that rolls, but it has a law of contact; simulate without `contact`."
        )
    if not is_traced(run.status):
        run.raise_if_failed()


def samples_in(times: Float[Array | np.ndarray, " T"], sample: float) -> int:
    """Counts the whole samples in a run with these times.

    **Raises:** ``ValueError`` for a sample that is not positive or longer than the run.
    """
    length = float(times[-1] - times[0])
    if not sample > 0:
        raise ValueError(f"Argument `sample` must be a positive time, but it is {sample:g}.")
    count = int(np.floor(length / sample + MISSING))
    if count < 1:
        raise ValueError(
            f"Argument `sample` must be no longer than the motion, which takes {length:g}, but it is {sample:g}; "
            "simulate a longer motion, or sample faster."
        )
    return count


def nominal_of(run: Trajectory[Any, Any], sampled: SampledSystem, samples: int) -> NominalMotion:
    """Computes the states of a run at each sample, and the inputs that give its motion.

    Each input is the mean over its sample, by Gauss's rule of two points, of the effort or acceleration in the run; so
    the motion misses its next state by what is of third order in the sample. The run is solved again for this.
    """
    start = jax.tree.map(lambda leaf: leaf[0], run.state)
    return nominal_from(run.system, run.times[0], start, sampled, samples)


def nominal_from(system: System, t0: Numbers, start: Any, sampled: SampledSystem, samples: int) -> NominalMotion:
    """Computes the states at each sample and the inputs of the run of a body from a start at ``t0``; traceable."""
    t0 = jnp.asarray(t0, default_dtype())
    shares = np.append(np.arange(samples)[:, None] + np.array([[0.0, *GAUSS]]), samples)
    times = t0 + sampled.sample * jnp.asarray(shares, default_dtype())
    again = simulate(system, times, start, inside=False, rtol=sampled.rtol, atol=sampled.atol)
    # Within a trace nothing can be raised; NaN in the states shows a run that failed.
    if not is_traced(again.status):
        again.raise_if_failed()
    states, inputs = _moving(system, sampled.system, sampled.places, times, again.state, again.observables)
    every = len(GAUSS) + 1
    u = 0.5 * (inputs[1::every] + inputs[2::every])
    return NominalMotion(times[::every], jax.tree.map(lambda leaf: leaf[::every], states), u)


@programs.filter_jit
def _moving(
    system: System, controlled: System, places: tuple[Place, ...], times: Array, states: Any, seen: Observables
) -> tuple[Any, Float[Array, "T m"]]:
    """Returns the states of the controlled system, and its inputs, at all times of a run."""
    coordinates = _Coordinates(system, times, states, seen)
    theta, thetadot, _ = zip(*(coordinates.of(name) for name in controlled.coordinates), strict=True)
    # A motion with schedules has no θ in its state, whereas the controlled system has θ of every input there.
    whole = type(states)(**{**vars(states), "theta": jnp.stack(theta, -1), "thetadot": jnp.stack(thetadot, -1)})
    return whole, jnp.stack([coordinates.input(place) for place in places], axis=-1)


class _Coordinates:
    """θ, θ̇ and θ̈ of masses and joints along a run, by name, and what moves them."""

    def __init__(self, system: System, times: Float[Array, " T"], states: Any, seen: Observables):
        self._system, self._times, self._states, self._seen = system, times, states, seen
        self._masses, self._mechanisms = system.point_masses, system.mechanisms
        names = [(i, a) for i, mechanism in enumerate(self._mechanisms) for a in range(mechanism.n_joints)]
        self._joints = {f"mechanisms[{i}].joints[{a}]": (k, i, a) for k, (i, a) in enumerate(names)}
        driven = [system.coordinates[slot] for slot in system.accelerated]
        if system.law is not None:
            law = system.law.prepare()
            accelerations = jax.vmap(lambda t, state: law.among(system.accelerated, t, state))(times, states)
            self._by_law = {name: accelerations[:, k] for k, name in enumerate(driven)}

    def of(self, name: str) -> tuple[Array, Array, Array | None]:
        """Returns θ, θ̇ and, where it is known, θ̈."""
        if name in self._joints:
            k = self._joints[name][0]
            return self._seen.joint_angles[:, k], self._seen.joint_rates[:, k], None
        if name.startswith("ground."):
            angle = getattr(self._system.ground, name.removeprefix("ground."))
            # An angle of a plate has a schedule or is driven by the law, like a mass.
            return _along(angle, self._times) if isinstance(angle, AbstractSchedule) else self._drive(name)
        schedule = self._masses[int(name.removeprefix("masses[").removesuffix("]"))].schedule
        return self._drive(name) if schedule is None else _along(schedule, self._times)

    def _drive(self, name: str) -> tuple[Array, Array, Array]:
        """Returns θ, θ̇ and θ̈ where the law drives them."""
        slot = self._system.coordinates.index(name)
        return self._states.theta[:, slot], self._states.thetadot[:, slot], self._by_law[name]

    def input(self, place: Place) -> Float[Array, " T"]:
        """Computes the input at a place: an effort, less the effort of the forces that stay, or an acceleration."""
        if not place.is_effort:
            acceleration = self.of(place.name)[2]
            return self._by_law[place.name] if acceleration is None else acceleration
        k, i, a = self._joints[place.name]
        effort, theta, thetadot = (
            values[:, k] for values in (self._seen.joint_efforts, self._seen.joint_angles, self._seen.joint_rates)
        )
        drive = self._mechanisms[i].drives[a]
        # A schedule prescribes the joint, so that there are no passive forces; its effort in the run is all of the
        # input.
        passive_drive = None if isinstance(drive, AbstractSchedule) else drive_without_motors(drive)
        return (
            effort
            if passive_drive is None
            else effort - jax.vmap(passive_drive)(self._times, theta, thetadot, self._states)
        )


def _along(schedule: AbstractSchedule, times: Float[Array, " T"]) -> tuple[Array, Array, Array]:
    theta, thetadot, thetaddot = jax.vmap(schedule.prepare().derivatives)(times)
    return theta, thetadot, thetaddot


class AbstractFeedback(Printed):
    """What adds to the inputs of a nominal motion, at each sample, by the state measured there.

    A kind of feedback implements ``__call__``, and ``begin`` if it remembers something from sample to sample, and
    ``remember_inputs`` if that depends on the inputs which act in the end. All are traced, for one state.

    - ``sampled``: the robot that it is designed for.
    - ``nominal``: the motion that it holds.
    """

    sampled: SampledSystem
    nominal: NominalMotion

    def begin(self) -> Any:
        """Returns what the feedback remembers before the first sample: a PyTree of arrays."""
        return ()

    @abc.abstractmethod
    def __call__(self, k: Int[Array, ""], state: PlacedState, memory: Any) -> tuple[Float[Array, " m"], Any]:
        """Returns δu of sample ``k`` at ``state``, before limits, and what the feedback remembers of this sample."""

    def act(self, k: Int[Array, ""], plant: SampledSystem, moving: Any, memory: Any) -> tuple[Float[Array, " m"], Any]:
        """Returns the same for what the robot that is simulated advances: with a law of contact, its mode too."""
        return self(k, plant.body_state(moving), memory)

    def remember_inputs(self, k: Int[Array, ""], u: Float[Array, " m"], memory: Any) -> Any:
        """Remembers of sample ``k`` which inputs act, once they are known, after delay and limits."""
        return memory

    def estimates(self, times: Float[Array, " T"], memory: Any) -> Any:
        """Returns what it has estimated at the samples of a run and its end, by what it remembered; None if nothing."""
        return None

    def feedforward(self) -> "Feedforward":
        """Returns no feedback, but the inputs of the same motion alone, to compare with it."""
        return Feedforward(self.sampled, self.nominal)

    def deviation(self, k: Int[Array, ""], state: PlacedState) -> Float[Array, " n"]:
        """Computes ξ: the deviation of ``state`` from the state of the motion at sample ``k``, as in
        :class:`SampledSystem`.
        """
        return self.sampled.deviation(self.nominal.state(k), state)

    @leave_to(".loop")
    def closed_loop(
        self,
        start: PlacedState | Mapping[str, Numbers] | Numbers | None = None,
        *,
        system: System | None = None,
        limits: Numbers | Mapping[str, Numbers] | None = None,
        delay: int = 0,
        push: AbstractWrench | None = None,
        samples: int | None = None,
        contact: Contact | None = None,
        adjoint: diffrax.AbstractAdjoint | None = None,
    ) -> "ClosedLoop":
        """Simulates a robot under the feedback, sampled.

        At each sample the state is measured, and the feedback's inputs are added to those of the motion; the sum is
        limited, and held until the next sample. It can be traced and differentiated, by every number in the feedback,
        in ``start`` and ``system``.

        **Arguments:**

        - ``start``: a state with θ and θ̇ of every input, or its deviation from the start of the motion in local
          coordinates: numbers by name, as in ``{"z": 0.1, "Omega[2]": 0.3}``, or all of them, shape (n,). By default
          none.
        - ``system``: the robot that is simulated; by default that of the design. One with other parameters shows how
          much the feedback depends on knowing them.
        - ``limits``: the largest magnitude of each input: a number for all, a row, or numbers by name; by default those
          of the motors.
        - ``delay``: how many samples pass before what feedback adds takes effect.
        - ``push``: a further force on the robot, such as a :class:`Push`.
        - ``samples``: how many; by default those of the motion. Later ones hold its last state.
        - ``contact``: a :class:`~jaxball.Contact`, with which the robot may slip and fly; the motion and the feedback
          are those of one that rolls.
        - ``adjoint``: as for :func:`jaxball.simulate`.

        **Raises:** ``TypeError`` and ``ValueError`` for a start, limits or a robot that do not fit the motion.

        **Example:**

        >>> import jax
        >>> jax.config.update("jax_enable_x64", True)
        >>> from jaxball import Disk, Motor, planar_pendulum, simulate
        >>> from jaxball.control import tvlqr
        >>> robot = Disk(mass=1.0, inertia=0.5, mechanisms=[planar_pendulum(0.5, 0.6, drive=Motor(0.0))])
        >>> track = tvlqr(simulate(robot, [0.0, 10.0]), Q={"phi": 1.0, "theta": 1.0}, R=1.0)
        >>> held = track.closed_loop({"phi": 0.2}, limits=0.08)
        >>> bool(abs(held.xi[-1, 0]) < 0.05), float(abs(held.u).max())
        (True, 0.08)
        """
        raise NotImplementedError

    @leave_to(".basins")
    def basin(
        self,
        starts: Mapping[str, Numbers] | Numbers,
        *,
        Q: Weights = 1.0,
        within: float = BACK_WITHIN,
        friction: float | None = None,
        system: System | None = None,
        limits: Numbers | Mapping[str, Numbers] | None = None,
        delay: int = 0,
        push: AbstractWrench | None = None,
        samples: int | None = None,
        contact: Contact | None = None,
        threads: int | None = None,
    ) -> "Basin":
        """Simulates many disturbed starts under the feedback, and says which come back to the motion.

        The contact force is that at the samples. Between them it may be larger: :func:`~jaxball.contact_extremes` finds
        it for one closed loop, which it solves again.

        **Arguments:**

        - ``starts``: deviations from the start of the motion in local coordinates, shape (runs, n), or a dictionary of
          two directions, each with a row of values, as in ``{"z[0]": [...], "Omega[1]": [...]}``, for every pair of
          them.
        - ``Q``: the weights by which a deviation at the end is measured, as for :func:`tvlqr`; all 1 by default.
        - ``within``: how small √(ξ·Q ξ / tr Q) must be at the end.
        - ``friction``: a coefficient μ; if given, a start whose run needs |f| > μ N at a sample does not come back.
        - ``system``, ``limits``, ``delay``, ``push``, ``samples``, ``contact``: as for :meth:`closed_loop`. With a law
          of contact, in place of ``friction``, the robot may slip and fly, and come back all the same.
        - ``threads``: how many blocks of starts are computed at a time; by default the number of this process's cores.

        **Raises:** ``ValueError`` for starts or directions that do not fit the motion, and for ``friction`` with
        ``contact``; else as :meth:`closed_loop`.

        **Example:**

        >>> import jax
        >>> jax.config.update("jax_enable_x64", True)
        >>> import numpy as np
        >>> from jaxball import Disk, Motor, planar_pendulum, simulate
        >>> from jaxball.control import tvlqr
        >>> robot = Disk(mass=1.0, inertia=0.5, mechanisms=[planar_pendulum(0.5, 0.6, drive=Motor(0.0, limit=0.05))])
        >>> track = tvlqr(simulate(robot, [0.0, 10.0]), Q={"phi": 1.0, "theta": 1.0}, R=1.0)
        >>> weak = track.basin({"phi": np.linspace(-2.0, 2.0, 9), "phidot": np.linspace(-1.0, 1.0, 5)}, Q={"phi": 1.0})
        >>> weak.returned.shape, 0.0 < weak.share < 1.0
        ((45,), True)
        """
        raise NotImplementedError


class Feedforward(AbstractFeedback):
    """No feedback: the inputs of the motion alone, whatever happens."""

    def __call__(self, k, state, memory):
        # 0 with the shape and the type of inputs.
        return self.nominal.input(k) * 0.0, memory
