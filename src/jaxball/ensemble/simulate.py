"""The entry point for many runs, and its result: from systems that differ in numbers to trajectories."""

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any, cast

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .. import native
from ..cpu import cores
from ..interface.arguments import described, require, require_flags
from ..interface.printing import Printed, shown
from ..interface.status import Status
from ..numerics.arrays import Numbers, is_traced, to_numpy
from ..numerics.batches import even_size, in_threads, unpadded
from ..physics.body_on_plane import BodyOnPlane
from ..physics.contact_law import Contact
from ..physics.released import ReleasedState
from ..physics.system import AbstractState, AbstractSystem
from ..simulation.arguments import (
    DEFAULT_SOLVER,
    DEFAULT_TOLERANCE,
    checked_steps,
    checked_tolerances,
    require_kind_of_state,
)
from ..simulation.history import ContactHistory
from ..simulation.modal import history, on_plane
from ..simulation.trajectory import Trajectory
from . import mapped
from .parameters import for_all_rows, shared_leaves
from .program import Settings, compiled
from .reductions import AbstractReduction
from .runge_kutta import fits

LANES = 64
BLOCK = 4096

# The compiled programs, by everything that they are compiled for.
_warm: set[Any] = set()


class Ensemble(Printed):
    """Many runs, with the runs as leading axis; ``ensemble[k]`` is the trajectory of run k.

    - ``trajectory``: as ``jax.vmap`` of :func:`jaxball.simulate` gives it.
    - ``reductions``: the results of reductions for each run, by name.
    - ``executed``: the steps of all lanes, including idle ones.
    - ``system``, ``times``, ``state``, ``reached``, ``status``, ``steps``, ``rejected``, ``start``, ``contact``: those
      of ``trajectory``.
    """

    trajectory: Trajectory[Any, Any]
    reductions: dict[str, Float[Array | np.ndarray, " runs"]]
    executed: Int[Array | np.ndarray, ""]

    def __repr__(self) -> str:
        lines = [repr(self.trajectory)]
        for name, values in self.reductions.items():
            if is_traced(values):
                lines.append(f"  {name} {shown(values)}")
                continue
            finite = np.asarray(values)[np.isfinite(values)]
            span = f"from {np.min(finite):.6g} to {np.max(finite):.6g}" if finite.size else "not finite in any run"
            lines.append(f"  {name} {span}")
        return "\n".join(lines)

    def __len__(self) -> int:
        return len(self.trajectory.status)

    def __getitem__(self, run: int) -> Trajectory[Any, Any]:
        """The trajectory of one run, with its ``observables``, ``plot()`` and so on."""
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
    def ok(self) -> Bool[Array, " runs"]:
        """Whether each solve reached its end, or a terminal event."""
        return (self.status == Status.SUCCESS) | (self.status == Status.EVENT)

    @property
    def efficiency(self) -> Float[Array, ""]:
        """The share of the executed steps that belong to a run."""
        return jnp.sum(self.trajectory.steps) / self.executed


def simulate_ensemble(
    system: AbstractSystem,
    times: Numbers,
    state: AbstractState | ReleasedState,
    *,
    contact: Contact | None = None,
    solver: diffrax.AbstractSolver | None = None,
    rtol: Numbers = DEFAULT_TOLERANCE,
    atol: Numbers = DEFAULT_TOLERANCE,
    max_steps: int = 16384,
    reductions: Mapping[str, AbstractReduction] | None = None,
    lanes: int | None = None,
    block: int | None = None,
    threads: int | None = None,
    inside: bool = True,
    in_axes: Any = 0,
) -> Ensemble:
    """Many runs of systems of one structure; each agrees with :func:`jaxball.simulate`, to within the tolerances.

    **Arguments:**

    - ``system``, ``state``: every array has the runs as leading axis, as ``jax.vmap`` takes them and ``jax.tree.map``
      with ``np.stack`` makes them, unless ``in_axes`` says otherwise.
    - ``times``: of shape (runs, T), or (T,) for all runs.
    - ``contact``: a :class:`~jaxball.Contact`, as for one run: each run may roll, slide and fly, and
      ``trajectory.contact`` has its modes. Each of its numbers is for all runs or, made by ``jax.vmap``, of shape
      (runs,). ``state`` may then be a :class:`~jaxball.ReleasedState`. Its ``room`` for switches is the same for every
      run.
    - ``solver``: an explicit method of diffrax whose last stage is the first of the next step: ``Dopri8()`` if not
      given, ``Dopri5()``, ``Tsit5()``, ``Bosh3()``.
    - ``rtol``, ``atol``: for all runs, or of shape (runs,).
    - ``max_steps``: as for one run.
    - ``reductions``: results to find in each run while it is computed, by name: some of
      ``jaxball.ensemble.REDUCTIONS``, or any :class:`Maximum`, :class:`Minimum`, :class:`Drift` or :class:`Integral` of
      your own function.
    - ``lanes``: how many runs XLA computes side by side; by default 64, which was fastest on the CPU measured, or a
      whole block on a GPU. Native programs always take 8 runs, and the next 8 begin when the longest of these has
      ended: put runs of similar length next to each other.
    - ``block``: how many runs a compiled program takes at a time; fewer are padded, so that calls with other numbers of
      runs share it. By default the runs are divided equally among threads, or GPUs, with at most 512 at a time natively
      and 4096 with XLA on CPUs.
    - ``threads``: how many blocks are computed at a time; by default the number of this process's cores, or GPUs.
    - ``inside``: whether rails and masses must be in the body, as for one run.
    - ``in_axes``: which arrays of ``(system, state)`` have the runs as leading axis, as ``jax.vmap`` takes it: 0 for
      those that have, None for those that all runs share, which is cheaper; each for one array or for all of a part, so
      that ``(None, 0)`` is one system from many states. By default 0.

    A run that fails has its status and NaN, and does not affect the others. Within ``jax.jit`` and under ``jax.jvp``,
    all runs are one block. Derivatives are forward-mode: ``jax.jvp``, ``jax.jacfwd``.

    **Raises:** ``ValueError`` where leading axes differ or ``in_axes`` is not of this form, ``TypeError`` for other
    solvers, and :class:`~jaxball.PrecisionError` when float32 cannot reach the tolerances.

    **Example:**

    >>> import jax
    >>> import jax.numpy as jnp
    >>> from jaxball import Disk, DiskState
    >>> from jaxball.ensemble import simulate_ensemble
    >>> def rolling(radius):
    ...     return Disk(mass=1.0, inertia=0.5, radius=radius), DiskState(phidot=-jnp.ones_like(radius))
    >>> disks, starts = jax.vmap(rolling)(jnp.array([1.0, 2.0, 3.0]))
    >>> ensemble = simulate_ensemble(disks, [0.0, 2.0], starts)
    >>> print(ensemble.state.z[:, -1])
    [2. 4. 6.]
    >>> round(float(ensemble[1].observables.kinetic_energy[-1]), 9)  # ½ (1/2 + r²) φ̇²
    2.25
    """
    require_flags(inside=inside)
    if contact is None or not isinstance(state, ReleasedState):
        require_kind_of_state(system, state)
    simulated = system if contact is None else on_plane(system, state, contact, False, {})
    method = _checked_method(DEFAULT_SOLVER if solver is None else solver)
    rtol, atol = checked_tolerances(rtol, atol, of_many=True)
    given = times if isinstance(times, jax.Array) else to_numpy(times, "times").astype(rtol.dtype)
    reductions = _checked_reductions(reductions)
    shared = shared_leaves(in_axes, (system, state))
    if contact is not None:
        of_contact = tuple(np.ndim(leaf) == 0 for leaf in jax.tree.leaves(contact))
        of_system = len(jax.tree.leaves(system))
        shared = (*shared[:of_system], *of_contact, *shared[of_system:])
    parameters = simulated, state
    runs = _count(parameters, shared, given, rtol, atol)
    whole = given if given.ndim == 2 else jnp.broadcast_to(given, (runs, given.shape[-1]))
    limits = tuple(x if x.ndim else jnp.broadcast_to(x, (runs,)) for x in (rtol, atol))
    leaves = jax.tree.leaves((parameters, whole, limits))
    traced = any(map(is_traced, (*leaves, jnp.zeros(()))))
    on_cpu = jax.default_backend() == "cpu"
    natively = not traced and native.chosen() == "native" and native.usable(leaves)
    threads = threads or (cores() if on_cpu else jax.local_device_count())
    most = (mapped.BLOCK if natively else BLOCK) if on_cpu else runs
    block = runs if traced else block or min(runs, even_size(runs, most, threads))
    settings = Settings(
        solver=method,
        max_steps=checked_steps(max_steps),
        lanes=min(block, lanes or (LANES if on_cpu else block)),
        shared=shared,
        reductions=tuple(reductions.items()),
        inside=inside,
    )
    if traced:
        results = compiled(settings)(parameters, whole, *limits)
    else:
        arrays = tuple(np.asarray(x) for x in (whole, *limits))
        blocks = _in_blocks(settings, parameters, arrays, mapped.filled(block) if natively else block, threads)
        results = _joined(blocks, runs)
    states, *solved, of_contact, reported, executed = results
    simulated, state = for_all_rows(parameters, shared, runs, jnp if traced else np)
    if not isinstance(simulated, BodyOnPlane):
        return Ensemble(Trajectory(simulated, whole, states, *solved, start=state), reported, executed)
    modes = history(simulated.contact, states, *of_contact)
    return Ensemble(
        Trajectory(simulated.body, whole, states.body, *solved, start=state, contact=modes), reported, executed
    )


def _checked_method(solver: diffrax.AbstractSolver) -> diffrax.AbstractERK:
    """The solver.

    **Raises:** ``TypeError`` for one that lanes do not support.
    """
    if not fits(solver):
        raise TypeError(
            "Argument `solver` must be an explicit Runge-Kutta method of diffrax whose last stage is the first of the "
            f"next step, such as Dopri8, Dopri5, Tsit5 or Bosh3, but it is {described(solver)}; use jax.vmap of "
            "jaxball.simulate for other methods."
        )
    return cast(diffrax.AbstractERK, solver)


def _checked_reductions(reductions: Mapping[str, AbstractReduction] | None) -> Mapping[str, AbstractReduction]:
    given = {} if reductions is None else reductions
    require("reductions", given, Mapping, "a dictionary of reductions by name, some of jaxball.ensemble.REDUCTIONS")
    for name, one in given.items():
        must = "one of jaxball.ensemble.REDUCTIONS, or a Maximum, Minimum, Drift or Integral"
        require(f"reductions[{name!r}]", one, AbstractReduction, must)
    return given


def _in_blocks(settings: Settings, parameters: Any, arrays: tuple[np.ndarray, ...], block: int, threads: int) -> list:
    """The results of the compiled program for each block; ``arrays`` are times and tolerances."""
    leaves, structure = jax.tree.flatten(parameters)
    own = list(zip(map(np.asarray, leaves), settings.shared, strict=True))

    def call(given: Any) -> Any:
        natively = mapped.compiled(settings).natively(*given)
        if natively is not None:
            with contextlib.suppress(native.CallbackReachedError):
                return natively()
        return compiled(settings)(*given)

    def take(places: np.ndarray) -> Any:
        parts = [leaf if shared else leaf[places] for leaf, shared in own]
        spans, *others = (x[places] for x in arrays)
        # A run that only pads a block ends as it begins.
        spans[np.append(False, places[1:] == places[:-1])] = spans[-1, :1]
        return structure.unflatten(parts), spans, *others

    shapes = tuple(leaf.shape if shared else leaf.shape[1:] for leaf, shared in own)
    key = settings, structure, shapes, block, arrays[0].shape[1]
    blocks = in_threads(lambda batch: call(take(batch)), len(arrays[0]), block, threads, compiled=key in _warm)
    _warm.add(key)
    return blocks


def _count(parameters: Any, shared: Sequence[bool], times: Any, *tolerances: Any) -> int:
    own = [leaf for leaf, one in zip(jax.tree.leaves(parameters), shared, strict=True) if not one]
    counts = {np.shape(leaf)[0] if np.ndim(leaf) else None for leaf in own}
    counts |= {times.shape[0]} if times.ndim == 2 else set()
    counts |= {x.shape[0] for x in tolerances if x.ndim}
    runs = next(iter(counts)) if len(counts) == 1 else None
    if runs is None:
        raise ValueError(
            "Arguments `system`, `state`, `times` and tolerances must have the same number of runs as leading axis of "
            f"every array, but the leading axes are {sorted(counts, key=str)}; stack systems with jax.tree.map, and "
            "use `in_axes` for what all runs share."
        )
    return runs


def _joined(blocks: list[Any], runs: int) -> tuple[Any, ...]:
    """The results of all blocks, without padding."""
    executed = sum(int(block[-1]) for block in blocks)
    whole = jax.tree.map(jnp.asarray, unpadded([block[:-1] for block in blocks], runs))
    return *whole, jnp.asarray(executed)
