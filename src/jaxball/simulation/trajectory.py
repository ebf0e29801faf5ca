"""``Trajectory``, the result of a simulation."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Generic, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from typing_extensions import TypeVar

from .. import programs
from ..interface.arguments import require_known, require_one_run
from ..interface.compat import is_traced
from ..interface.printing import Printed, as_html, sketch_of
from ..interface.status import SUCCESSES, SolveError, Status
from ..interface.wording import no_attribute, number_of
from ..numerics.arrays import Numbers, to_array
from ..numerics.kinks import CLOSE_KINKS, just_before
from ..physics.body import AbstractBody, System
from ..physics.conditions import Problem
from ..physics.contact.body_on_plane import BodyOnPlane
from ..physics.contact.history import ContactHistory, HeldHistory
from ..physics.hybrid import NO_HISTORY, AbstractHistory, Switches
from ..physics.observables import Observables, compute_observables, movement
from ..physics.packing import Packing
from ..physics.rolling import AbstractRollingSystem, Reaction
from ..physics.state import BallState, DiskState, ReducedState, State
from ..physics.system import AbstractState, AbstractSystem
from ..physics.validity import find_problems, not_numbers
from ..programs.batches import map_rows
from ..programs.derivatives.differentiation import differentiate_where, with_unknown_derivatives
from .events import Occurrences
from .trajectory_methods import TrajectoryMethods

if TYPE_CHECKING:
    import diffrax

    from ..files.scenario.scenario import Scenario
    from ..physics.sensors import AbstractSensor

    # A trajectory is of a ball or a disk unless it is said to be of something else.
    AnySystem = TypeVar("AnySystem", bound=AbstractSystem, default=System)
    AnyState = TypeVar("AnyState", bound=AbstractState, default=State)
else:  # from Python 3.13 on, beartype takes a default for all that a value may be
    AnySystem = TypeVar("AnySystem", bound=AbstractSystem)
    AnyState = TypeVar("AnyState", bound=AbstractState)

# What other libraries call the attributes of a solution.
OTHER_NAMES = {"t": "times", "ts": "times", "y": "state", "ys": "state", "result": "status", "stats": "steps"}


class Interpolant(eqx.Module, Generic[AnyState]):
    """The states between the saved times, by the solver's dense output."""

    solution: "diffrax.Solution"
    packing: Packing[Any, AnyState]
    projects: bool = eqx.field(static=True, default=False)

    @classmethod
    def of(
        cls, solution: "diffrax.Solution", solver: Any, packing: Packing[Any, Any], *, projects: bool, pauses: bool
    ) -> "Interpolant[Any]":
        """Makes the interpolant of a solution by :class:`SolveLoop`, from the dense output of its ``solver``.

        - ``projects``: whether the states are those on the constraints that are nearest to it.
        - ``pauses``: whether there may be a pause before a step.
        """
        # Imported here, because a run is read from a file and drawn without solvers.
        from .solvers.dense.continuous import DenseOutput
        from .solvers.dense.steps import AfterPauses

        interpolation = DenseOutput.of(solver).interpolation
        if pauses:
            interpolation = AfterPauses(interpolation)
        steps = dataclasses.replace(cast(Any, solution.interpolation), interpolation_cls=interpolation)
        return cls(dataclasses.replace(solution, interpolation=steps), packing, projects)

    def vector(self, t: Float[Array, ""]) -> Float[Array, " size"]:
        """Returns the vector that a solve advances, at a time."""
        x = self.solution.evaluate(t)
        return self.packing.projected(t, x) if self.projects else x


class Trajectory(Printed, TrajectoryMethods, Generic[AnySystem, AnyState]):
    """States of a system at saved times, and how the solve ended.

    - ``system``: what was simulated.
    - ``interpolant``: what ``at`` evaluates; None without dense output.
    - ``times``: the saved times, shape (T,).
    - ``state``: the states there; each of its arrays has T as leading axis. NaN at times that the solve did not reach,
      and throughout where it could not start.
    - ``status``: a :class:`~jaxball.Status`; ``ok`` and ``message`` read it.
    - ``reached``: the time that the solve reached.
    - ``steps``, ``rejected``: how many steps were taken in all, and how many of them were rejected.
    - ``events``: the :class:`~jaxball.simulation.events.Occurrences` of each event, by name.
    - ``start``: the initial state that was given, even where no solve can start from it.
    - ``history``: of a hybrid system, its switches from mode to mode; ``switches`` and ``contact`` read it.
    - ``scenario``: the :class:`~jaxball.Scenario`, with the settings of the solve, where one was simulated or the
      trajectory was read from a file of its run; else None. It is not part of the pytree, and is lost in
      transformations.

    **Example:**

    >>> from jaxball import Disk, DiskState, simulate
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    >>> run
    Trajectory of a disk with no point masses
      3 times from 0 to 2
      4 steps, 0 of them rejected
      The solve reached t = 2.
      z at the end: 2
    >>> print(run.observables.kinetic_energy)
    [0.75 0.75 0.75]
    """

    system: AnySystem
    times: Float[Array | np.ndarray, "*batch T"]
    state: AnyState
    reached: Float[Array, "*batch"]
    status: Int[Array, "*batch"]
    steps: Int[Array, "*batch"]
    rejected: Int[Array, "*batch"]
    interpolant: Interpolant[AnyState] | None = None
    events: dict[str, Occurrences] = eqx.field(default_factory=dict)
    start: Any = None
    history: AbstractHistory = eqx.field(default_factory=lambda: NO_HISTORY)
    # No field and so no part of the pytree: what a transformation returns need not be of the scenario.
    scenario: ClassVar["Scenario | None"] = None

    def set_scenario(self, scenario: "Scenario") -> "Trajectory[AnySystem, AnyState]":
        """Records this trajectory as the run of ``scenario``."""
        object.__setattr__(self, "scenario", scenario)
        return self

    @classmethod
    def of(cls, *fields: Any) -> "Trajectory[Any, Any]":
        """Makes one of all its fields in their order, without checks, which would take a tenth of a short run."""
        return jax.tree.unflatten(_outline(), fields)

    @property
    def switches(self) -> Switches:
        """The switches of a hybrid system from mode to mode: when, and the states before and after."""
        return self.history.switches

    @property
    def contact(self) -> ContactHistory | None:
        """The history of a run with a law of contact, with its modes and switches; None without such a law."""
        return modes if isinstance(modes := self.history.of_body, ContactHistory) else None

    def _as_solved(self, system: Any) -> tuple[Any, Any]:
        """Returns the system that was solved, and its states: with a law of contact, this shows a part of them."""
        held = self.history.of_body
        if not isinstance(held, HeldHistory):
            return system, self.state
        law = held.law if isinstance(held, ContactHistory) else None
        return BodyOnPlane(system, law), held.states_of(system, self.state)

    @property
    def ok(self) -> bool:
        """Whether the solve reached its end, or a terminal event. For one trajectory, not for a batch."""
        require_known(self.status, "Property `ok`")
        return int(self.status) in SUCCESSES

    @property
    def message(self) -> str:
        """A sentence that says how the solve ended. For one trajectory, not for a batch."""
        require_known(self.status, "Property `message`")
        return self.message_of([problem.sentence() for problem in self.problems])

    @property
    def problems(self) -> list[Problem]:
        """What is impossible about the body, or which mass left the shell, where that ended this one solve."""
        require_known(self.status, "Property `problems`")
        times, status = np.asarray(self.times), int(self.status)
        if status == Status.NOT_FINITE and float(self.reached) > times[0]:
            return list(not_numbers(self.system))
        if status not in (Status.IMPOSSIBLE, Status.LEFT_SHELL, Status.NOT_FINITE):
            return []
        system, states = self._as_solved(self.system)
        start = system.start(to_array(times[0]), self.start)
        return find_problems(system, start, times, states if status == Status.LEFT_SHELL else None)

    def message_of(self, problems: Sequence[str]) -> str:
        """Returns the same sentence as :attr:`message` with other words for the ``problems``."""
        sentence = Status(int(self.status)).sentence(float(self.reached), float(self.times[-1]))
        advice = self.history.advice if int(self.status) == Status.MAX_STEPS else ""
        return " ".join(filter(None, [sentence, *problems, advice]))

    def raise_if_failed(self) -> "Trajectory[AnySystem, AnyState]":
        """Returns the trajectory itself, or raises a :class:`~jaxball.SolveError` with the message.

        **Raises:** ``ValueError`` for a batch.
        """
        require_known(self.status, "Method `raise_if_failed`")
        if not self.ok:
            raise SolveError(self.message)
        return self

    def at(self, t: Numbers) -> AnyState:
        """Returns the state at any time ``t`` of the run, a number or an array of any shape, from dense output.

        NaN before the start and after the time that the solve reached.

        **Raises:** ``ValueError`` when the trajectory was made without ``dense=True``, and for a batch.
        """
        if self.interpolant is None:
            raise ValueError("Method `at` needs dense output; call simulate(..., dense=True).")
        require_one_run(self.status, "Method `at`", "call it within jax.vmap")
        parameters = self.system, self.start
        return _evaluate(self.interpolant, to_array(t, "t"), self.times[0], self.reached, self.status, parameters)

    @property
    def observables(self) -> Observables:
        """Positions, energies and forces at every saved time; in a batch, those of each run.

        Where the actuation jumps at a saved time, the values are those just after the jump; at the end of the run, and
        where the jump ends a mode, those just before it, as the mode is.

        **Raises:** ``ValueError`` for a reduced trajectory, which does not contain the position of the ball, and for
        one of another system, which may have ``laws``.
        """
        body = self._body("The observables")
        return self._evaluate(_observe_all, *self._as_solved(body))

    def measured(self, sensors: "Mapping[str, AbstractSensor]", key: Any = None) -> dict[str, Array]:
        """Computes the readings of sensors at every saved time, by name; NaN at times that the solve did not reach.

        A reading at a saved time is of what has acted until then: where the actuation jumps at that time, it is of just
        before the jump. At the start it is of just after.

        **Arguments:**

        - ``sensors``: such as an :class:`~jaxball.physics.sensors.Accelerometer`, by names of your choice. Those with
          :class:`~jaxball.physics.sensors.SensorErrors` read what has arrived at each time, and NaN where nothing has.
        - ``key``: of the random numbers of errors, ``jax.random.key(k)``; each key is another repetition of the
          measurement, the same one without.

        **Returns:** for each sensor an array with T as leading axis.

        **Raises:** ``ValueError`` where the body lacks the part that a sensor is on, and where a reading with errors
        would fall between the saved times; and as ``observables``.
        """
        from ..physics.sensors.base import (
            require_sensors,  # here, because a simulation does without
            with_errors,
        )

        body = self._body("The sensors")
        require_sensors(sensors, body)
        system, states = self._as_solved(body)
        readings = self._evaluate(functools.partial(_measure_all, dict(sensors)), system, states)
        exact = {name: readings[name] for name in sensors}  # in their order, which JAX does not keep
        errors = {name: sensor.errors for name, sensor in sensors.items()}
        return with_errors(errors, jnp.asarray(self.times), exact, key)

    @property
    def plane_reaction(self) -> Reaction:
        """N and |f| of the plane on which the system rolls, at every saved time; in a batch, those of each run.

        **Raises:** ``ValueError`` for a system that does not roll on a plane, and for a run with modes, whose forces
        are in ``observables``.
        """
        if not always_rolls(self):
            which = "has modes" if isinstance(self.system, AbstractRollingSystem) else "does not roll on a plane"
            raise ValueError(
                "The reaction of the plane is that of a system that always rolls on it, but this trajectory is of a "
                f"{type(self.system).__name__}, which {which}."
            )
        return self._evaluate(functools.partial(_call_at_all, "plane_reaction"), self.system, self.state)

    @property
    def laws(self) -> Any:
        """The laws of the system at every saved time: a named tuple, each entry with T as leading axis.

        In a batch, those of each run.

        **Raises:** ``ValueError`` for a ball or a disk, whose integrals are functions of a state
        (``jaxball.physics.dynamics.locked``).
        """
        if isinstance(self.system, AbstractBody):
            raise ValueError(
                f"Only other systems have `laws`, but this trajectory is of a {type(self.system).__name__}; "
                "the module `momentum` of jaxball.physics.dynamics has its integrals."
            )
        return self._evaluate(functools.partial(_call_at_all, "laws"), self.system, self.state)

    @property
    def multipliers(self) -> Float[Array, "*batch T m"]:
        """The forces of constraints, λ, of a system with a Lagrangian at every saved time; in a batch, of each run.

        **Raises:** ``ValueError`` for a system that has no multipliers.
        """
        if not hasattr(self.system, "multipliers"):
            raise ValueError(
                "The multipliers are those of a LagrangianSystem of jaxball.physics.classical, but this trajectory is "
                f"of a {type(self.system).__name__}."
            )
        return self._evaluate(functools.partial(_call_at_all, "multipliers"), self.system, self.state)

    def _evaluate(self, function: Callable[..., Any], system: Any, states: Any) -> Any:
        """Evaluates ``function`` of a system, the times, its states and its ends, for each run of a batch."""
        arguments = system, jnp.asarray(self.times), states, self.ends
        for _ in range(np.ndim(self.status)):
            function = eqx.filter_vmap(function)
        return function(*arguments)

    @property
    def ends(self) -> Float[Array, "*batch ends"]:
        """When each mode that was kept ended, NaN for none, and the run: what jumps there is told from before."""
        reached, switches = jnp.asarray(self.reached), jnp.asarray(self.history.switches.times)
        each = jnp.broadcast_to(switches, (*reached.shape, switches.shape[-1]))
        return jnp.concatenate([each.astype(reached.dtype), reached[..., None]], axis=-1)

    def _body(self, what: str) -> AbstractBody:
        """Returns the system, which must be a body whose position is known: ``what`` needs both."""
        if not isinstance(self.system, AbstractBody):
            raise ValueError(
                f"{what} are those of a ball or a disk, but this trajectory is of a {type(self.system).__name__}; its "
                "`laws` say what is conserved."
            )
        if isinstance(self.state, ReducedState):
            raise ValueError(
                f"{what} need the full state, but this trajectory is of a ReducedState; simulate with a BallState."
            )
        return self.system

    @property
    def friction_needed(self) -> Float[Array, "*batch"]:
        """The largest |f| / N at the saved times; :func:`~jaxball.contact_extremes` finds μ_min of the whole run.

        The latter is what files and the stores of sweeps call ``friction_needed``.
        """
        by_contract = always_rolls(self) and not isinstance(self.system, AbstractBody)
        ratio = self.plane_reaction.ratio if by_contract else self.observables.friction_ratio
        return jnp.max(ratio, axis=-1)

    if not TYPE_CHECKING:  # a type checker knows what there is

        def __getattr__(self, name: str) -> Any:
            if name.startswith("_"):  # Python, NumPy and notebooks ask for these
                raise AttributeError(name)
            parts = ("observables", Observables), ("state", type(vars(self).get("state")))
            places = {n: f"{part}.{n}" for part, kind in parts for n in getattr(kind, "__dataclass_fields__", ())}
            raise no_attribute(type(self), name, OTHER_NAMES | places)

    def __repr__(self) -> str:
        if is_traced(self.status):
            return f"Trajectory of a {self.system.describe()}, traced, with {self.times.shape[-1]} times"
        if np.ndim(self.status):
            return self._of_many()
        lines = [
            f"Trajectory of a {self.system.describe()}",
            f"  {number_of(self.times.size, 'time')} from {float(self.times[0]):g} to {float(self.times[-1]):g}",
        ]
        if int(self.status) == Status.IMPOSSIBLE:
            return "\n".join([*lines, f"  {self.message}"])
        steps = f"  {number_of(int(self.steps), 'step')}, {int(self.rejected)} of them rejected"
        lines += [steps, f"  {self.message}"]
        if isinstance(self.state, BallState | DiskState):
            z = np.atleast_1d(np.asarray(self.state.z)[-1])
            lines.append("  z at the end: " + ", ".join(f"{value:.12g}" for value in z))
        return "\n".join([*lines, *(f"  {line}" for line in self.history.lines)])

    def _repr_html_(self) -> str:
        if is_traced(self.status) or np.ndim(self.status) or not isinstance(self.state, BallState | DiskState):
            return as_html(repr(self))
        z = np.asarray(self.state.z)
        path = z if z.ndim == 2 else np.stack([np.asarray(self.times), z], axis=1)
        return as_html(repr(self), sketch_of(path, "the path on the ground" if z.ndim == 2 else "the place over time"))

    def _of_many(self) -> str:
        """Describes a batch in a few lines: how many runs, how they ended, and how many steps they took."""
        statuses, counts = np.unique(np.asarray(self.status), return_counts=True)
        ends = ", ".join(f"{count} {Status(int(s)).name}" for s, count in zip(statuses, counts, strict=True))
        steps = np.asarray(self.steps)
        return (
            f"Trajectories of a {self.system.describe()}, a batch of shape {np.shape(self.status)}\n"
            f"  {self.times.shape[-1]} times from {np.min(self.times):g} to {np.max(self.times):g}\n"
            f"  {np.min(steps)} to {np.max(steps)} steps\n"
            f"  how they ended: {ends}"
        )


def always_rolls(trajectory: Trajectory[Any, Any]) -> bool:
    """Returns whether a run is of a system without modes, which rolls and has extremes of the contact force."""
    return isinstance(trajectory.system, AbstractRollingSystem) and trajectory.history.always_rolls


@functools.cache
def _outline() -> Any:
    """Returns the structure of a trajectory whose fields are the leaves."""
    whole = object.__new__(Trajectory)
    for field in dataclasses.fields(Trajectory):
        object.__setattr__(whole, field.name, field.name)
    return jax.tree.structure(whole)


@programs.filter_jit
def _observe_all(system, times, state, ends) -> Observables:
    def observe_at(system, t, x):
        return compute_observables(system.shown, t, movement(system, t, x))

    return _at_each(observe_at, system, times, state, ends)


@programs.filter_jit
def _measure_all(sensors, system, times, states, ends) -> dict[str, Array]:
    def read_sensors(system, t, x):
        moves = movement(system, t, x)
        finite = jnp.all(jnp.isfinite(moves.state.Omega))
        readings = {name: sensor.reading(system.shown, t, moves) for name, sensor in sensors.items()}
        return {name: jnp.where(finite, reading, jnp.nan) for name, reading in readings.items()}

    return _at_each(read_sensors, system, times_before_jumps(system, times), states, ends)


@programs.filter_jit
def _call_at_all(method: str, system, times, state, ends) -> Any:
    return _at_each(lambda system, t, x: getattr(system, method)(t, x), system, times, state, ends)


def _at_each(function: Callable[..., Any], system: Any, times: Array, state: Any, ends: Array) -> Any:
    """Evaluates ``function(system, t, state)`` at each time; derivatives are NaN, too, beyond the end of the solve."""
    prepared = system.prepare()

    def one(t, x):
        finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(x)]))
        return with_unknown_derivatives(function(*differentiate_where(finite, (prepared, t, x))), x)

    return map_rows(one, times_looked_at(system, times, ends), state)


def times_looked_at(
    system: AbstractSystem, times: Float[Array, " T"], ends: Float[Array, " ends"]
) -> Float[Array, " T"]:
    """Returns the times at which to evaluate what depends on time: the times of a run, except for kinks at its end and
    where a mode ends.

    Jumps there are evaluated just before, because what comes after is not part of the run, or of the saved mode; as is
    what comes before the start.
    """
    # A mode that a jump ends may last a rounding longer than until that.
    late = jax.lax.stop_gradient(ends[None] - times[:, None])
    near = CLOSE_KINKS * float(jnp.finfo(times.dtype).eps) * jnp.abs(times)[:, None]
    at_end = jnp.any((late >= 0) & (late <= near), axis=1)
    return jnp.where(at_end, times_before_jumps(system, times), times)


def times_before_jumps(system: AbstractSystem, times: Float[Array, " T"]) -> Float[Array, " T"]:
    """Returns the times of a run, but just before a kink where there is one; not so its start, nor a row after one with
    the same time, which is of what comes after a switch.
    """
    again = jnp.concatenate([jnp.ones((1,), bool), times[1:] == times[:-1]])
    return jnp.where(again, times, just_before(system.kinks(), times))


@programs.filter_jit
def _evaluate(interpolant, t, start, reached, status, parameters) -> Any:
    def one(t):
        # Dense output is evaluated within the run alone: beyond it there is room without steps, and NaN in derivatives.
        inside = jnp.clip(t, start, reached)
        x = interpolant.vector(inside)
        valid = (t == inside) & jnp.all(jnp.isfinite(x)) & (status != Status.IMPOSSIBLE)
        state = interpolant.packing.system.state_to_show(interpolant.packing.unpack_where(valid, inside, x))
        return with_unknown_derivatives(state, parameters)

    if not t.ndim:
        return one(t)
    return jax.tree.map(lambda rows: rows.reshape(*t.shape, *rows.shape[1:]), map_rows(one, t.ravel()))
