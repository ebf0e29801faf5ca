"""``simulate``, the entry point: from a system, times and a state to a trajectory."""

import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, cast, overload

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from .. import programs
from ..interface.arguments import require_flags
from ..interface.compat import is_traced
from ..interface.status import Status
from ..numerics.arrays import Numbers
from ..physics.body import System
from ..physics.contact.law import Contact
from ..physics.contact.modes import ContactState, Mode
from ..physics.contact.released import ReleasedState
from ..physics.dynamics.footing import end_of_ground, has_end
from ..physics.hybrid import Accuracy
from ..physics.limits.confinement import may_swing_out, until_left
from ..physics.packing import Packing, ravel_state
from ..physics.state import State
from ..physics.system import AbstractState, AbstractSystem, require_system
from ..physics.validity import possible_start
from ..programs.derivatives.differentiation import (
    differentiate_where,
    forward_only,
    keep_known_rows,
    reverse_only,
    with_unknown_derivatives,
)
from ..programs.identity.closures import change_with_captures, put_captures, take_captures
from . import DEFAULT_TOLERANCE
from .arguments import (
    adjoint_in_mode,
    check_adjoint,
    check_longest_step,
    check_progress,
    check_solver,
    check_steps,
    check_times,
    check_tolerances,
    require_dae,
    require_projection,
    require_single,
    require_single_numbers,
    system_to_solve,
)
from .events import AbstractEvent, EndOfGround, Leaving, check_events
from .inputs import LimitedSteps, limits_of_steps, share_of
from .loop import SolveLoop, by_tolerances, kinks_of, least_step, to_kinks
from .observers import Observation, Observers, visible
from .solvers import SwitchingMassMatrixTerm
from .solvers.base import approach_of
from .solvers.collocation import fills_vectors
from .solvers.wrapping import ProjectedSteps
from .switching import BetweenSteps, Switching
from .trajectory import Interpolant, Trajectory
from .watch import Watch, end_by_events, occurrences_of, values_of

FEW_STEPS = (256, 2048)
# Runs with these have tried steps to where the equations do not hold.
BROKEN = (int(Status.NOT_FINITE), int(Status.LEFT_SURFACE), int(Status.WEDGED))
# The names of events among those of a solve, and not of its result.
LEAVING = "(something leaves)"
ENDS = {"(the ground is too curved)": Status.WEDGED, "(the ground ends)": Status.LEFT_SURFACE}


def simulate(
    system: AbstractSystem,
    times: Numbers,
    state: AbstractState | ReleasedState | None = None,
    *,
    solver: diffrax.AbstractAdaptiveSolver | None = None,
    rtol: Numbers = DEFAULT_TOLERANCE,
    atol: Numbers = DEFAULT_TOLERANCE,
    dense: bool = False,
    step_to_times: bool = False,
    dae: bool = False,
    project: bool = False,
    events: Mapping[str, AbstractEvent] | None = None,
    contact: Contact | None = None,
    adjoint: diffrax.AbstractAdjoint | None = None,
    max_steps: int = 16384,
    max_step: float | None = None,
    progress: diffrax.AbstractProgressMeter | None = None,
    inside: bool = True,
    throw: bool = False,
) -> Trajectory[Any, Any]:
    """Integrates the equations of motion from ``times[0]`` to ``times[-1]``, saving at each of ``times``.

    **Arguments:**

    - ``system``: a :class:`~jaxball.Ball`, a :class:`~jaxball.Disk`, one of :mod:`jaxball.physics.classical`, or any
      other :class:`~jaxball.AbstractSystem`. Of a hybrid one, ``trajectory.switches`` has the ends of modes.
    - ``times``: increasing, two or more. The solver chooses its own steps, which end at kinks of actuation and force.
    - ``state``: the state at ``times[0]``; if not given, at rest at the origin with θ of free joints 0. Its kind
      determines the equations: :class:`~jaxball.BallState` (versor), :class:`~jaxball.physics.RotationState` (matrix),
      :class:`~jaxball.physics.ReducedState` (Ω, Γ), or :class:`~jaxball.DiskState`; most other systems have a single
      kind.
    - ``solver``: any adaptive diffrax solver; ``diffrax.Dopri8()`` if not given.
    - ``rtol``, ``atol``: tolerances of the step-size control. Changing them compiles nothing again.
    - ``dense``: whether the trajectory can be evaluated at any time, ``trajectory.at(t)``.
    - ``step_to_times``: whether steps end at each of ``times``, where states otherwise are those of a polynomial.
    - ``dae``: whether to solve the differential-algebraic form of the paper, in which |q|² = 1 determines a component
      of q, with a solver that knows mass matrices, such as :class:`jaxball.simulation.solvers.RadauIIA`.
    - ``project``: whether each step ends with q, Γ or Λ normalised, or on the constraints of a
      :class:`~jaxball.physics.classical.LagrangianSystem`; with holonomic ones it always does. A disk has neither.
    - ``events``: the events to detect, by name, such as an :class:`~jaxball.Event`; ``trajectory.events[name]`` says
      when each happened. One that ends the run sets its status, and the states saved after that are NaN.
    - ``contact``: a :class:`~jaxball.Contact`, by which a body may slip, leave the ground and land on it, also from a
      :class:`~jaxball.physics.ReleasedState`; ``trajectory.contact`` has the modes. If not given, it always rolls.
    - ``adjoint``: for reverse mode alone ``diffrax.RecursiveCheckpointAdjoint()``, for forward mode alone
      ``diffrax.ForwardMode()``; if not given both, in any order, of events and hybrid systems up to the second.
    - ``max_steps``: the most steps, accepted and rejected, that the solve may take; its derivatives, which may need
      more, are NaN where this does not suffice for them. With ``dense`` the status beside them then is MAX_STEPS.
    - ``max_step``: the longest step, a time; none if not given. Where forces and motions change fast, steps are short
      without it; it is for changes that samples over the run miss. Each value compiles a program.
    - ``progress``: a diffrax progress meter.
    - ``inside``: whether a run is ``IMPOSSIBLE`` that starts with rails or masses outside the body, and ends as
      ``LEFT_SHELL`` when a mass leaves the shell; of a body that is traced, masses on hinges are checked at
      ``times`` only. The equations do not depend on the shell; False is for searches that pass through such bodies.
    - ``throw``: whether a failed solve raises; otherwise it is a status on the trajectory.

    **Raises:** :class:`PrecisionError` when float32 cannot reach the tolerances, ``ValueError`` or ``TypeError`` for
    wrong arguments and an ``adjoint`` differentiated in the other mode, :class:`~jaxball.SolveError` with ``throw``.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> from jaxball import Disk, DiskState, simulate
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    >>> print(run.state.z)
    [0. 1. 2.]
    """
    flags = {"dense": dense, "step_to_times": step_to_times, "dae": dae, "project": project, "inside": inside}
    require_flags(**flags, throw=throw)
    times = check_times(times)
    moving = system_to_solve(system, contact)
    state = at_rest(system) if state is None else state
    require_single(moving, state)
    tolerances = check_tolerances(rtol, atol)
    if dae:
        require_dae(moving, state, solver)
    if project:
        require_projection(moving, state)
    flags["swinging"] = inside and may_swing_out(moving)
    method = Method.of(solver, adjoint, max_steps, progress, max_step, **flags)
    trajectory = _run(method, moving, times, state, *tolerances, check_events(moving, events))
    return _raise_if_failed(trajectory) if throw else trajectory


class Method(NamedTuple):
    """What a program is compiled for; everything else may change from call to call.

    ``swinging``: whether masses on hinges, which may get out, are looked at in each step.
    """

    solver: diffrax.AbstractAdaptiveSolver
    adjoint: diffrax.RecursiveCheckpointAdjoint | diffrax.ForwardMode | None
    progress: diffrax.AbstractProgressMeter
    max_steps: int
    max_step: float | None = None
    dense: bool = False
    step_to_times: bool = False
    dae: bool = False
    project: bool = False
    inside: bool = True
    swinging: bool = False
    observation: Observation | None = None

    @classmethod
    def of(
        cls,
        solver: diffrax.AbstractAdaptiveSolver | None,
        adjoint: diffrax.AbstractAdjoint | None,
        max_steps: int,
        progress: diffrax.AbstractProgressMeter | None = None,
        max_step: float | None = None,
        **flags: Any,
    ) -> "Method":
        """Makes the method of arguments of :func:`simulate`, after checks of all but the flags."""
        limits = check_steps(max_steps), check_longest_step(max_step)
        return cls(check_solver(solver), check_adjoint(adjoint), check_progress(progress), *limits, **flags)


def _run(
    method: Method, system: AbstractSystem, times: Any, state: AbstractState | ReleasedState, *others: Any
) -> Trajectory[Any, Any]:
    """Computes a trajectory. Dense output has room for few steps at first, because unused room costs time as well."""

    def trajectory_by(method: Method) -> Trajectory[Any, Any]:
        *solved, history = _program(method)(system, times, state, *others)
        return Trajectory.of(system.shown, times, *solved, state, history)

    if method.dense and not any(map(is_traced, jax.tree.leaves((system, times, state, *others)))):
        for room in (room for room in FEW_STEPS if room < method.max_steps):
            trajectory = trajectory_by(method._replace(max_steps=room))
            if np.max(np.asarray(trajectory.steps)) < room:
                return trajectory
    return trajectory_by(method)


def _program(method: Method) -> Callable[..., tuple]:
    try:
        return _compile_program(method)
    except TypeError:  # a solver that carries arrays has no hash
        return functools.partial(_simulated_filtered, method)


@functools.cache
def _compile_program(method: Method) -> Callable[..., tuple]:
    in_lanes = not fills_vectors(method.solver)
    how = {"in_lanes": in_lanes, "steered": True, "by_steps": method.dense}
    return programs.jit(functools.partial(simulate_arrays, method), **how)


def simulate_arrays(method: Method, system: AbstractSystem, times: Array, *others: Any) -> tuple:
    """Returns the fields of a trajectory except ``system`` and ``times``, which a program could only copy."""
    return simulate_and_observe(method, system, times, *others)[0]


def simulate_and_observe(method: Method, system: AbstractSystem, times: Array, *others: Any) -> tuple[tuple, Any]:
    """Simulates, and returns the same fields, and what was observed."""
    require_single_numbers(system, others[-1])
    saved, *solved, record, observations = solve(method, system, times, *others)
    return (system.state_to_show(saved), *solved, system.history(times, saved, record)), observations


def solve(
    method: Method,
    system: AbstractSystem,
    times: Array,
    state: Any,
    rtol: Array,
    atol: Array,
    events: dict[str, AbstractEvent],
) -> tuple:
    """Solves: the saved states, where and how it ended, its steps, the interpolant, events, switches, observations."""
    adjoint = adjoint_in_mode(method.adjoint)
    if isinstance(adjoint, diffrax.RecursiveCheckpointAdjoint):
        system, times, state, rtol, atol, events = change_with_captures(
            reverse_only, (system, times, state, rtol, atol, events)
        )
    state = system.start(times[0], state)
    startable, arguments = _startable(system, times, state, method.inside), (system, times, state)
    # Impossible numbers have no derivatives: theirs may be NaN, which masks on results do not stop.
    where_startable = functools.partial(differentiate_where, startable)
    system, times, state, events = change_with_captures(where_startable, (system, times, state, events))
    packing, initial = _pack(system, times[0], state)
    leaving = Leaving(packing.system.leaving_status, method.swinging) if method.inside else None
    events = _add_ends_of_run(events, packing.system, times[0], state, leaving)
    functions = _Functions(method, system, packing, events)
    order = float(method.solver.error_order(diffrax.ODETerm(functions.field)) or 1)  # pyright: ignore
    accuracy = Accuracy(rtol, atol, order, approach_of(method.solver))
    switching = Switching(accuracy, functions.unpack, system.max_switches) if system.is_hybrid else BetweenSteps()
    solver = ProjectedSteps(method.solver, functions.projected) if functions.projects else method.solver
    solution = diffrax.diffeqsolve(
        functions.terms(initial),
        solver,
        times[0],
        jnp.where(startable, times[-1], times[0]),  # of no length, where it cannot start
        None,
        jnp.where(startable, initial, 0.0),  # not NaN, which the loop would differentiate
        args=functions.parameters,
        saveat=diffrax.SaveAt(t1=True, dense=method.dense),
        stepsize_controller=_controller(method, system, times, initial, functions, accuracy),
        adjoint=SolveLoop(
            adjoint,
            times,
            switching,
            functools.partial(functions.observers, rtol, atol) if method.observation else None,
            Watch(events, functions.event_values, functions.field, functions.event_state) if events else None,
            accuracy=accuracy,
            parameters=functions.leaves,
            join=lambda leaves: ravel_pytree(leaves)[0],
        ),
        max_steps=method.max_steps,
        progress_meter=method.progress,
        throw=False,
    )
    if isinstance(adjoint, diffrax.ForwardMode):
        solution = forward_only(solution)
    states, ended = cast(Array, solution.ys), cast(Array, solution.ts)
    finite = startable & jnp.all(jnp.isfinite(states), axis=1)
    saved = _unpack(packing, finite, times, states, functions.projects)
    reached, status, occurrences = ended[0], _status(solution, packing), {}
    if events:
        unravel_shown = ravel_state(system.state_to_show(packing.unpack(times[0], initial)))[1]
        occurrences = occurrences_of(cast(Any, solution.stats["watched"]), events, unravel_shown, startable)
        reached, status = end_by_events(occurrences, events, reached, status)
        saved = jax.tree.map(lambda leaf: keep_known_rows(times <= reached, leaf), saved)
        occurrences = {name: occurrence for name, occurrence in occurrences.items() if name not in ENDS}
    status, record = switching.outcome(cast(Any, solution.stats["switching"]), status, packing)
    if method.inside:
        left = occurrences.pop(LEAVING).times[0] if LEAVING in occurrences else None
        # One that ends the run has done so, with derivatives.
        left = None if left is None or events[LEAVING].terminal else left
        reached, status = until_left(packing.system, times, saved, reached, status, left)
    status = jnp.where(startable, status, Status.IMPOSSIBLE)
    # Reverse mode goes through the steps that were tried beyond that, too.
    broken = jnp.any(status == jnp.asarray(BROKEN))
    spoilt = broken & isinstance(adjoint, diffrax.RecursiveCheckpointAdjoint)
    saved, record, occurrences = with_unknown_derivatives((saved, record, occurrences), arguments, spoilt)
    interpolant = None
    if method.dense:
        interpolant = Interpolant.of(solution, solver, packing, projects=functions.projects, pauses=switching.jumps)
    counts = (cast(Array, solution.stats[name]) for name in ("num_steps", "num_rejected_steps"))
    return saved, reached, status, *counts, interpolant, occurrences, record, solution.stats.get("found")


def _add_ends_of_run(
    events: dict[str, AbstractEvent], system: AbstractSystem, start: Array, state: Any, leaving: Leaving | None
) -> dict[str, AbstractEvent]:
    """Returns the events with those that end a run: what leaves the inside of a system, and the end of its ground."""
    if leaving is not None and leaving.clearance(system, start, state) is not None:
        events = events | {LEAVING: leaving}
    if has_end(system.shown):
        events = events | {name: EndOfGround(status) for name, status in ENDS.items()}
    return dict(sorted(events.items()))  # as they are where they are taken apart as a PyTree


class _Functions:
    """The functions that a solve evaluates, with all parameters as one array.

    One array, because XLA copies each operand of a nested loop once an iteration.
    """

    def __init__(
        self, method: Method, system: AbstractSystem, packing: Packing[Any, Any], events: dict[str, AbstractEvent]
    ) -> None:
        self._method, self._system, self._packing = method, system, packing
        self.projects = method.project or packing.system.always_projected
        with_captures = take_captures((packing, events))
        self.parameters, self._unravel = ravel_pytree(with_captures)
        self.leaves, self._structure = jax.tree.flatten(with_captures)
        # Compiled on their own, they are traced once; diffrax traces a step several times.
        self.field, self.dae_field = jax.jit(self._field), jax.jit(self._dae_field)
        self.event_values = jax.jit(self._event_values)

    def unpack(self, parameters: Array | list[Array]) -> tuple[Packing[Any, Any], dict[str, AbstractEvent]]:
        """Returns the packing and the events, from one array or from a list of all."""
        is_list = isinstance(parameters, list)
        return put_captures(*(self._structure.unflatten(parameters) if is_list else self._unravel(parameters)))

    def terms(self, initial: Array) -> diffrax.AbstractTerm:
        """Returns the equations: ẋ = f(t, x), or M ẋ = f(t, x) where they are solved as a DAE."""
        if not self._method.dae:
            return diffrax.ODETerm(self.field)
        return SwitchingMassMatrixTerm(
            self.dae_field,
            mass=lambda component: self._packing.mass_diagonal(initial, component),
            choose=lambda t, x, _: self._packing.algebraic_component(x),
        )

    def _field(self, t, x, parameters):
        return self.unpack(parameters)[0].field(t, x)

    def _dae_field(self, t, x, parameters, component):
        return self.unpack(parameters)[0].dae_field(t, x, component)

    def _event_values(self, times, vectors, parameters):
        packing, events = self.unpack(parameters)
        return jax.vmap(functools.partial(values_of, packing, events))(times, vectors)

    def observers(self, rtol: Array, atol: Array, parameters: Array) -> Observers:
        """Makes the observers of quantities along the run."""
        observation = self._method.observation
        assert observation is not None
        return Observers(observation, self.unpack(parameters)[0], rtol, atol, visible(rtol))

    def event_state(self, t, x, parameters):
        """Returns the state that an event's function is given, as a vector."""
        packing, _ = self.unpack(parameters)
        x = packing.projected(t, x) if self.projects else x
        return ravel_state(self._system.state_to_show(packing.unpack(t, x)))[0]

    def projected(self, t, x, parameters):
        """Finds the nearest vector on the constraints."""
        return self.unpack(parameters)[0].projected(t, x)


def _startable(system: AbstractSystem, times: Array, state: AbstractState, inside: bool) -> Array:
    """Returns whether a solve can start: whether all numbers are possible, and every entry of the initial vector is
    finite.
    """
    packing, initial = _pack(system, times[0], state)
    return possible_start(system, packing.system, times, state, inside) & jnp.all(jnp.isfinite(initial))


@jax.jit
def _pack(system: AbstractSystem, t: Array, state: AbstractState) -> tuple[Packing[Any, Any], Array]:
    """Makes the packing of a system with its initial vector. Compiled on its own, it is traced once."""
    packing = Packing.of(system.prepare(), state)
    return packing, packing.pack(t, state)


def _unpack(packing: Packing[Any, Any], mask: Array, times: Array, states: Array, projects: bool) -> Any:
    """Unpacks the states of vectors that are ``mask``; the others are NaN, and have no derivatives.

    - ``projects``: whether steps end on the constraints; so do then states within steps.
    """
    # Some known vector stands in for each unknown one: what is unpacked from NaN has derivatives of NaN, and a
    # mask on its result would not stop them.
    times, states = jnp.where(mask, times, times[0]), jnp.where(mask[:, None], states, states[0])

    def unpack(sample: tuple[Array, Array]) -> Any:
        t, x = sample
        return packing.unpack(t, packing.projected(t, x) if projects else x)

    unpacked = jax.lax.map(unpack, (times, states))
    return jax.tree.map(functools.partial(keep_known_rows, mask), unpacked)


_simulated_filtered = programs.filter_jit(simulate_arrays)


def _controller(
    method: Method, system: AbstractSystem, times: Array, initial: Array, functions: _Functions, accuracy: Accuracy
) -> diffrax.AbstractAdaptiveStepSizeController:
    """Steps by the tolerances, to the kinks and, where asked for, to ``times``, and no longer than the inputs allow."""
    least = least_step(times)
    controller = by_tolerances(accuracy.rtol, accuracy.atol, method.solver, longest=method.max_step, least=least)
    if method.step_to_times:
        controller = diffrax.ClipStepSizeController(controller, step_ts=times)
    kinks, parameters = kinks_of(system), functions.parameters
    controller = to_kinks(controller, kinks)
    how = accuracy.tolerance, share_of(method.solver), system.is_hybrid
    limits = limits_of_steps(functions.field, times, initial, parameters, kinks, *how)
    return controller if limits is None else LimitedSteps(controller, limits)


def _status(solution: diffrax.Solution, packing: Packing[Any, Any]) -> Array:
    """Returns the status of a solution by :class:`SolveLoop`, which tells the end of a ground from other failures."""
    status = status_of(solution.result)
    if not has_end(packing.system.shown):
        return status
    end = jax.lax.stop_gradient((cast(Array, solution.ts)[0], cast(Array, solution.stats["end"])))
    cause = _cause_of_end(packing, *end)
    failed = (status == int(Status.NOT_FINITE)) | (status == int(Status.SOLVER_FAILED))
    return jnp.where(failed & (cause != int(Status.SUCCESS)), cause, status)


def _cause_of_end(packing: Packing[Any, Any], t: Array, x: Array) -> Array:
    """Says why the ground lets a body not go on from a vector: a status, or SUCCESS if it lets it."""
    system, state = packing.system, packing.unpack(t, x)
    end = end_of_ground(system.shown, t, system.state_to_show(state))
    # In flight it needs no ground.
    return jnp.where(state.is_in(Mode.FLIGHT), int(Status.SUCCESS), end) if isinstance(state, ContactState) else end


def status_of(result: diffrax.RESULTS) -> Array:
    """Returns the status of a result: a step below the least length means that none was accepted, because the field is
    not finite.
    """
    R = diffrax.RESULTS
    status = jnp.where((result == R.successful) | (result == R.event_occurred), Status.SUCCESS, Status.SOLVER_FAILED)
    status = jnp.where(result == R.nonfinite, Status.NOT_FINITE, status)
    status = jnp.where(result == R.max_steps_reached, Status.MAX_STEPS, status)
    return jnp.where(result == R.dt_min_reached, Status.NOT_FINITE, status)


@overload
def at_rest(system: System) -> State: ...


@overload
def at_rest(system: AbstractSystem) -> AbstractState: ...


def at_rest(system: AbstractSystem) -> AbstractState:
    """Returns the default initial state: for a ball or a disk, at rest at the origin, upright.

    **Raises:** ``ValueError`` where a state must be given, for instance because it contains angles.
    """
    require_system(system)
    return type(system).default_state(system)  # which costs less than a bound method, see `require_state`


def _raise_if_failed(trajectory: Trajectory[Any, Any]) -> Trajectory[Any, Any]:
    """Returns the trajectory of a solve that has not failed, where that is known."""
    if is_traced(trajectory.status):
        raise ValueError(
            "Argument `throw` must be False where the solve is traced, as within jit or vmap, but it is True; "
            "return the trajectory's status and check it outside."
        )
    return trajectory.raise_if_failed()
