"""Simulates many systems that differ in numbers, and holds their trajectories as one :class:`Ensemble`."""

import itertools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...interface.arguments import require, require_flags
from ...interface.compat import is_traced
from ...interface.printing import Printed, format_value
from ...interface.status import SUCCESSES
from ...interface.wording import no_attribute
from ...numerics.arrays import Numbers, to_numpy
from ...physics.contact.history import ContactHistory
from ...physics.contact.law import Contact
from ...physics.contact.released import ReleasedState
from ...physics.limits.confinement import may_swing_out
from ...physics.observables import Observables
from ...physics.system import AbstractState, AbstractSystem
from ...programs.operation import in_threads
from .. import DEFAULT_TOLERANCE
from ..arguments import check_tolerances, require_dae, require_kind_of_state, require_projection, system_to_solve
from ..events import AbstractEvent, Occurrences, check_events
from ..simulate import Method, at_rest
from ..trajectory import Trajectory
from .program import Settings, solve_all
from .reductions import AbstractReduction

DEFAULT_LANES = 64


class Ensemble(Printed):
    """Many runs, with the runs as leading axis; ``ensemble[k]`` is the trajectory of run k.

    - ``trajectory``: as ``jax.vmap`` of :func:`jaxball.simulate` gives it.
    - ``reductions``: the results of reductions for each run, by name.
    - ``executed``: the steps of all lanes, including idle ones.
    - ``system``, ``times``, ``state``, ``reached``, ``status``, ``steps``, ``rejected``, ``start``, ``contact``,
      ``events``, ``observables``, ``friction_needed``: those of ``trajectory``.
    """

    trajectory: Trajectory[Any, Any]
    reductions: dict[str, Float[Array | np.ndarray, " runs"]]
    executed: Int[Array | np.ndarray, ""]

    def __repr__(self) -> str:
        lines = [repr(self.trajectory)]
        for name, values in self.reductions.items():
            if is_traced(values):
                lines.append(f"  {name} {format_value(values)}")
                continue
            finite = np.asarray(values)[np.isfinite(values)]
            span = f"from {np.min(finite):.6g} to {np.max(finite):.6g}" if finite.size else "not finite in any run"
            lines.append(f"  {name} {span}")
        return "\n".join(lines)

    def __len__(self) -> int:
        return len(self.trajectory.status)

    def __getitem__(self, run: int | np.integer | slice) -> Trajectory[Any, Any]:
        """Returns the trajectory of one run, with ``observables``, ``plot()`` and so on, or those of a slice of runs.

        **Raises:** ``IndexError`` for a number that no run has, which ends a loop over the runs.
        """
        count = len(self)
        if isinstance(run, int | np.integer) and not -count <= run < count:  # where JAX would take the last run
            raise IndexError(
                f"The number of a run must be from 0 to {count - 1}, or from {-count} to -1, but it is {run}."
            )
        return jax.tree.map(lambda leaf: jnp.asarray(leaf[run]), self.trajectory)

    @property
    def system(self) -> Any:
        return self.trajectory.system

    @property
    def times(self) -> Float[Array | np.ndarray, "runs T"]:
        return self.trajectory.times

    @property
    def state(self) -> Any:
        return self.trajectory.state

    @property
    def reached(self) -> Float[Array, " runs"]:
        return self.trajectory.reached

    @property
    def status(self) -> Int[Array, " runs"]:
        return self.trajectory.status

    @property
    def steps(self) -> Int[Array, " runs"]:
        return self.trajectory.steps

    @property
    def rejected(self) -> Int[Array, " runs"]:
        return self.trajectory.rejected

    @property
    def start(self) -> Any:
        return self.trajectory.start

    @property
    def contact(self) -> ContactHistory | None:
        return self.trajectory.contact

    @property
    def events(self) -> dict[str, Occurrences]:
        return self.trajectory.events

    @property
    def observables(self) -> Observables:
        return self.trajectory.observables

    @property
    def friction_needed(self) -> Float[Array, " runs"]:
        return self.trajectory.friction_needed

    @property
    def ok(self) -> Bool[Array, " runs"]:
        """Whether each solve reached its end, or a terminal event."""
        return jnp.isin(self.status, jnp.asarray(SUCCESSES))

    @property
    def efficiency(self) -> Float[Array, ""]:
        """The share of the executed steps that belong to a run."""
        return jnp.sum(self.trajectory.steps) / self.executed

    if not TYPE_CHECKING:  # a type checker knows what there is

        def __getattr__(self, name: str) -> Any:
            if name.startswith("_"):  # Python, NumPy and notebooks ask for these
                raise AttributeError(name)
            of_one = {name: f"ensemble[k].{name}"} if hasattr(Trajectory, name) else {}
            raise no_attribute(type(self), name, of_one)


def simulate_ensemble(
    system: AbstractSystem,
    times: Numbers,
    state: AbstractState | ReleasedState | None = None,
    *,
    events: Mapping[str, AbstractEvent] | None = None,
    contact: Contact | None = None,
    solver: diffrax.AbstractAdaptiveSolver | None = None,
    rtol: Numbers = DEFAULT_TOLERANCE,
    atol: Numbers = DEFAULT_TOLERANCE,
    step_to_times: bool = False,
    dae: bool = False,
    project: bool = False,
    adjoint: diffrax.AbstractAdjoint | None = None,
    max_steps: int = 16384,
    max_step: float | None = None,
    reductions: Mapping[str, AbstractReduction] | None = None,
    lanes: int | None = None,
    chunk: int | None = None,
    threads: int | None = None,
    inside: bool = True,
    in_axes: Any = 0,
) -> Ensemble:
    """Simulates many runs of systems of one structure; each agrees with :func:`jaxball.simulate` within tolerances.

    **Arguments:**

    - ``system``, ``state``: every array has the runs as leading axis, as ``jax.vmap`` makes them, or as in ``in_axes``.
    - ``times``: of shape (runs, T), or (T,) for all runs.
    - ``events``: the same for all runs, or as in ``in_axes``. Reductions go on to the end of the last step, within
      which the first terminal event ends the run.
    - ``contact``: each of its numbers is for all runs or, made by ``jax.vmap``, of shape (runs,); its ``capacity`` is
      the same for every run.
    - ``solver``, ``step_to_times``, ``dae``, ``project``, ``inside``, ``adjoint``, ``max_steps``, ``max_step``: as for
      one run. A run that fails has its status and NaN, and does not affect the others.
    - ``rtol``, ``atol``: for all runs, or of shape (runs,).
    - ``reductions``: results to find in each run while it is computed, by name, of
      ``jaxball.simulation.ensemble.REDUCTIONS`` or a :class:`Maximum`, :class:`Minimum`, :class:`Drift` or
      :class:`Integral` of your own function.
    - ``lanes``: how many runs XLA computes side by side, by default 64 on a CPU, all on a GPU; native programs 8 or 1.
    - ``chunk``: how many runs are in memory at a time while they are computed; by default all.
    - ``threads``: of native programs, by default as many as this process has cores. Results do not depend on it.
    - ``in_axes``: which arrays of ``(system, state)`` have the runs as leading axis, as ``jax.vmap`` takes it: 0 for
      those that have, None for those that all runs share, which is cheaper; ``(None, 0)`` is one system from many
      states. A third entry is for the arrays of ``events``; without it all runs share them.

    **Raises:** as :func:`jaxball.simulate`, and ``ValueError`` where leading axes differ or ``in_axes`` is wrong.

    **Example:**

    >>> import jax
    >>> import jax.numpy as jnp
    >>> from jaxball import Disk, DiskState
    >>> from jaxball.simulation.ensemble import simulate_ensemble
    >>> disks = jax.vmap(lambda radius: Disk(mass=1.0, inertia=0.5, radius=radius))(jnp.array([1.0, 2.0, 3.0]))
    >>> ensemble = simulate_ensemble(disks, [0.0, 2.0], DiskState(phidot=-1.0), in_axes=(0, None))
    >>> print(ensemble.state.z[:, -1])
    [2. 4. 6.]
    """
    flags = {"step_to_times": step_to_times, "dae": dae, "project": project, "inside": inside}
    require_flags(**flags)
    simulated = system_to_solve(system, contact)
    if state is None:
        state, in_axes = at_rest(system), _without_state(in_axes)
    require_kind_of_state(simulated, state)
    if dae:
        require_dae(simulated, state, solver)
    if project:
        require_projection(simulated, state)
    events = check_events(simulated, events)
    swinging = inside and may_swing_out(simulated)
    method = Method.of(solver, adjoint, max_steps, None, max_step, swinging=swinging, **flags)
    rtol, atol = check_tolerances(rtol, atol, of_many=True)
    instants = times if isinstance(times, jax.Array) else to_numpy(times, "times").astype(rtol.dtype)
    results = tuple(_check_reductions(reductions).items())
    own_shared, shared = _find_shared(in_axes, system, state, contact, events)
    runs = _count((simulated, state, events), shared, instants, rtol, atol)
    whole, *limits = (_for_each(runs, x, axes) for x, axes in ((instants, 1), (rtol, 0), (atol, 0)))
    settings = Settings(method, results, lanes or (DEFAULT_LANES if jax.default_backend() == "cpu" else runs))
    with in_threads(threads):
        ends, reported, executed = _in_chunks(settings, shared, chunk, (simulated, state, events), whole, *limits)
    system, state = for_all_rows((system, state), own_shared, runs, jnp if _is_any_traced(system, state) else np)
    return Ensemble(Trajectory(system, whole, **ends._asdict(), start=state), reported, executed)


def _for_each(runs: int, array: Any, axes: int) -> Any:
    """Returns an array with this number of axes for each of the runs, if it is one for all."""
    return array if array.ndim > axes else jnp.broadcast_to(array, (runs, *array.shape))


def _find_shared(
    in_axes: Any, system: Any, state: Any, contact: Contact | None, events: Any
) -> tuple[tuple[bool, ...], tuple[bool, ...]]:
    """Finds which arrays of (system, state), and which of all that is simulated, are shared by all runs."""
    of_both, of_events = (in_axes[:2], in_axes[2]) if _has_three(in_axes) else (in_axes, None)
    flags = find_shared_leaves(of_both, (system, state))
    # A law of contact is no part of ``in_axes``: its numbers have an axis of runs, or they have none.
    of_contact = tuple(np.ndim(leaf) == 0 for leaf in jax.tree.leaves(contact))
    of_system = len(jax.tree.leaves(system))
    return flags, (*flags[:of_system], *of_contact, *flags[of_system:], *find_shared_leaves(of_events, events))


def _in_chunks(
    settings: Settings, shared: tuple[bool, ...], chunk: int | None, parameters: Any, *others: Any
) -> tuple[Any, ...]:
    """Computes the results of all runs; outside a trace in chunks, where that is asked for."""
    runs = len(others[0])
    if chunk is None or chunk >= runs or _is_any_traced(parameters, others):
        return solve_all(settings, shared, parameters, *others)
    leaves, structure = jax.tree.flatten(parameters)
    starts, results = list(range(0, runs, chunk)), []
    if starts[-1] == runs - 1 and chunk > 1:  # A run alone would be another program, which rounds otherwise.
        starts.pop()
    for start, end in itertools.pairwise([*starts, runs]):
        rows = slice(start, end)
        chunk_leaves = [leaf if is_shared else leaf[rows] for leaf, is_shared in zip(leaves, shared, strict=True)]
        results.append(solve_all(settings, shared, structure.unflatten(chunk_leaves), *(x[rows] for x in others)))
    *parts, executed = zip(*results, strict=True)
    return *(jax.tree.map(lambda *of: jnp.concatenate(of), *part) for part in parts), sum(executed)


def _is_any_traced(*trees: Any) -> bool:
    # Within a trace a new array is traced even where all arguments are known numbers.
    return any(map(is_traced, (*jax.tree.leaves(trees), jnp.zeros(()))))


def _without_state(in_axes: Any) -> Any:
    """Returns the axes of (system, state), or those with events, of runs that share their state."""
    if not isinstance(in_axes, tuple) or len(in_axes) not in {2, 3}:
        return in_axes, None
    return in_axes[0], None, *in_axes[2:]


def _has_three(in_axes: Any) -> bool:
    """Returns whether there are axes for events, besides the axes of system and state."""
    return isinstance(in_axes, tuple) and len(in_axes) == 3


def _check_reductions(reductions: Mapping[str, AbstractReduction] | None) -> Mapping[str, AbstractReduction]:
    by_name = {} if reductions is None else reductions
    require(
        "reductions",
        by_name,
        Mapping,
        "a dictionary of reductions by name, some of jaxball.simulation.ensemble.REDUCTIONS",
    )
    for name, reduction in by_name.items():
        must = "one of jaxball.simulation.ensemble.REDUCTIONS, or a Maximum, Minimum, Drift or Integral"
        require(f"reductions[{name!r}]", reduction, AbstractReduction, must)
    return by_name


def _count(parameters: Any, shared: Sequence[bool], times: Any, *tolerances: Any) -> int:
    arrays = [leaf for leaf, is_shared in zip(jax.tree.leaves(parameters), shared, strict=True) if not is_shared]
    counts = {np.shape(leaf)[0] if np.ndim(leaf) else None for leaf in arrays}
    counts |= {times.shape[0]} if times.ndim == 2 else set()
    counts |= {x.shape[0] for x in tolerances if x.ndim}
    runs = next(iter(counts)) if len(counts) == 1 else None
    if runs is None:
        raise ValueError(
            "Arguments `system`, `state`, `times` and tolerances must have the same number of runs as leading axis of "
            f"every array, but the leading axes are {sorted(counts, key=str)}; stack systems with jax.tree.map, and "
            "use `in_axes` for what all runs share."
        )
    if not runs:
        raise ValueError("Arguments `system` and `state` must be those of one run or more, but they are of none.")
    return runs


def find_shared_leaves(in_axes: Any, tree: Any) -> tuple[bool, ...]:
    """Finds the leaves of a PyTree that all rows share: their axis is None in ``in_axes``, which is a prefix of it.

    **Raises:** ``ValueError`` where it is none, or an axis is neither 0 nor None.
    """
    of_leaves: list[Any] = []

    def note(axis: Any, part: Any) -> None:
        of_leaves.extend([axis] * len(jax.tree.leaves(part)))

    try:
        jax.tree.map(note, in_axes, tree, is_leaf=lambda axis: axis is None)
    except ValueError:
        # What does not fit the tree is refused below, with everything else that is no axis.
        of_leaves = [in_axes]
    axes = [*of_leaves, *jax.tree.leaves(in_axes, is_leaf=lambda axis: axis is None)]
    if not all(axis is None or (type(axis) is int and axis == 0) for axis in axes):
        raise ValueError(
            "Argument `in_axes` must be 0 where arrays have the runs as leading axis and None where all runs share "
            "them, for all arrays, for (system, state) or (system, state, events), or in PyTrees of these structures "
            f"as jax.vmap takes them, but it is {in_axes!r}."
        )
    return tuple(axis is None for axis in of_leaves)


def for_all_rows(tree: Any, shared: Sequence[bool], rows: int, namespace: Any) -> Any:
    """Returns a PyTree in which every leaf has the rows as leading axis; with NumPy for ``namespace``,
    without copies.
    """
    leaves, structure = jax.tree.flatten(tree)
    whole = [
        namespace.broadcast_to(x, (rows, *x.shape)) if is_shared else x
        for x, is_shared in zip(leaves, shared, strict=True)
    ]
    return structure.unflatten(whole)
