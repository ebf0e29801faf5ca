"""The result of a simulation."""

import dataclasses
import functools
import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Generic, cast

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int
from typing_extensions import TypeVar

from ..interface.printing import Printed
from ..interface.status import SolveError, Status
from ..interface.wording import counted
from ..numerics import programs
from ..numerics.arrays import Numbers, to_array
from ..numerics.masks import differentiated_where
from ..physics.body import AbstractBody, System
from ..physics.body_on_plane import body_of
from ..physics.conditions import Problem
from ..physics.observables import Observables, observe, observe_on_plane
from ..physics.packing import Packing
from ..physics.state import BallState, DiskState, ReducedState, RotationState, State
from ..physics.system import AbstractState, AbstractSystem
from ..physics.validity import find_problems
from ..solvers.dense.continuous import DenseOutput
from .history import ContactHistory
from .occurrences import Occurrences

if TYPE_CHECKING:
    import pathlib

    import matplotlib.figure
    import xarray

    from ..plot.view.page import View


if TYPE_CHECKING:  # a trajectory is of a ball or a disk unless it is said to be of something else
    AnySystem = TypeVar("AnySystem", bound=AbstractSystem, default=System)
    AnyState = TypeVar("AnyState", bound=AbstractState, default=State)
else:  # from Python 3.13 on, beartype takes a default for all that a value may be
    AnySystem = TypeVar("AnySystem", bound=AbstractSystem)
    AnyState = TypeVar("AnyState", bound=AbstractState)


class Interpolant(eqx.Module, Generic[AnyState]):
    """The states between the saved times, by the solver's dense output."""

    solution: diffrax.Solution
    packing: Packing[Any, AnyState]

    @classmethod
    def of(cls, solution: diffrax.Solution, solver: Any, packing: Packing[Any, Any]) -> "Interpolant[Any]":
        """Of a solution by :class:`SolveLoop`, whose steps have the dense output of ``DenseOutput.of(solver)``."""
        steps = dataclasses.replace(
            cast(Any, solution.interpolation), interpolation_cls=DenseOutput.of(solver).interpolation
        )
        return cls(dataclasses.replace(solution, interpolation=steps), packing)


class Trajectory(Printed, Generic[AnySystem, AnyState]):
    """States of a system at saved times, and how the solve ended.

    - ``system``: what was simulated.
    - ``interpolant``: what ``at`` evaluates; None without dense output.
    - ``times``: the saved times, shape (T,).
    - ``state``: the states there; each of its arrays has T as leading axis. NaN where the solve did
      not come, or all of it where the solve could not start.
    - ``status``: a :class:`~jaxball.Status`; ``ok`` and ``message`` read it.
    - ``reached``: the time to which the solve came.
    - ``steps``, ``rejected``: how many steps were taken in all, and how many of them were rejected.
    - ``events``: the :class:`~jaxball.Occurrences` of each event, by name.
    - ``start``: the initial state that was given, also where no solve can start from it.
    - ``contact``: the :class:`ContactHistory` of a run with a law of contact: its modes and switches.

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
    contact: ContactHistory | None = None

    @classmethod
    def of(cls, *fields: Any) -> "Trajectory[Any, Any]":
        """A trajectory of all its fields in their order, made without the checks of a constructor.

        These take longer than a tenth of a short run.
        """
        return jax.tree.unflatten(_outline(), fields)

    @property
    def ok(self) -> bool:
        """Whether the solve reached its end, or an event that it was to end at. For one trajectory, not for a batch."""
        return int(self.status) in (Status.SUCCESS, Status.EVENT)

    @property
    def message(self) -> str:
        """A sentence that says how the solve ended."""
        return self.message_of([problem.sentence() for problem in self.problems])

    @property
    def problems(self) -> list[Problem]:
        """What no body can have, or which mass left the shell, where that is how the solve ended; otherwise nothing."""
        times, status = np.asarray(self.times), int(self.status)
        at_the_start = status == Status.NOT_FINITE and float(self.reached) == times[0]
        if status != Status.IMPOSSIBLE and status != Status.LEFT_SHELL and not at_the_start:
            return []
        system, start, states = self.system, self.start, self.state
        if self.contact is not None and isinstance(system, AbstractBody):
            system, states = self.contact.on_plane(system, states)
            start = system.prepare().start(to_array(times[0]), start)
        return find_problems(system, start, times, states if status == Status.LEFT_SHELL else None)

    def message_of(self, problems: Sequence[str]) -> str:
        """The same sentence with ``problems`` told in other words."""
        sentence = Status(int(self.status)).sentence(float(self.reached), float(self.times[-1]))
        return " ".join([sentence, *problems])

    def raise_if_failed(self) -> "Trajectory[AnySystem, AnyState]":
        """The trajectory itself, or a :class:`~jaxball.SolveError` with the message."""
        if not self.ok:
            raise SolveError(self.message)
        return self

    def at(self, t: Numbers) -> AnyState:
        """The state at any time ``t`` of the run, a number or an array, from dense output.

        NaN before the start and after the time to which the solve came.

        **Raises:** ``ValueError`` when the trajectory was made without ``dense=True``.
        """
        if self.interpolant is None:
            raise ValueError("Method `at` needs dense output; call simulate(..., dense=True).")
        return _evaluate(self.interpolant, to_array(t, "t"), self.times[0], self.reached, self.status)

    @property
    def observables(self) -> Observables:
        """Positions, energies and forces at every saved time.

        **Raises:** ``ValueError`` for a reduced trajectory, which does not know where the ball is, and for
        one of another system, which may have ``laws``.
        """
        if not isinstance(self.system, AbstractBody):
            raise ValueError(
                "The observables are those of a ball or a disk, but this trajectory is of a "
                f"{type(self.system).__name__}; its `laws` say what is constant in it."
            )
        if isinstance(self.state, ReducedState):
            raise ValueError(
                "The observables need the full state, but this trajectory is of a ReducedState; simulate "
                "with a BallState."
            )
        if self.contact is not None:
            plane, states = self.contact.on_plane(self.system, self.state)
            return _observe_all_on_plane(plane, self.times, states)
        return _observe_all(self.system, self.times, self.state)

    @property
    def laws(self) -> Any:
        """The laws of the system at every saved time: a named tuple, each entry with T as leading axis.

        **Raises:** ``ValueError`` for a ball or a disk, whose integrals are functions of a state.
        """
        if isinstance(self.system, AbstractBody):
            raise ValueError(
                f"The laws are those of other systems, but this trajectory is of a {type(self.system).__name__}; "
                "the modules jaxball.physics.integrals and jaxball.physics.momentum have its integrals."
            )
        return _laws_of_all(self.system, self.times, self.state)

    @property
    def friction_needed(self) -> Float[Array, ""]:
        """The largest |f| / N at the saved times; :func:`~jaxball.contact_extremes` finds μ_min of the whole run."""
        return jnp.max(self.observables.friction_ratio)

    # A user has a trajectory in hand and looks there for what can be done with it. These four import, when called,
    # modules that are built upon this one; the contracts in pyproject.toml name them as exceptions.

    def to_dataset(self) -> "xarray.Dataset":
        """The trajectory and all its observables, or laws; see :func:`jaxball.to_dataset`."""
        from .. import results

        return results.to_dataset(self)

    def save(self, path: str | os.PathLike[str]) -> "pathlib.Path":
        """Saves the trajectory as ``.nc``, ``.npz`` or ``.csv``; see :func:`jaxball.save`.

        :func:`jaxball.load_run` reads the first two back. With :func:`jaxball.save`, the file can say which scenario
        it is of.
        """
        from .. import results

        return results.save(self, os.fspath(path))

    def plot(self) -> "matplotlib.figure.Figure":
        """One figure: of a ball or a disk :func:`jaxball.plot.overview`, else :func:`jaxball.plot.classical_motion`.

        **Raises:** ``ValueError`` for a reduced trajectory or a batch.
        """
        from .. import plot

        body = isinstance(self.system, AbstractBody)
        return plot.overview(self) if body else plot.classical_motion(self).figure  # pyright: ignore

    def view(
        self,
        path: str | os.PathLike[str] | None = None,
        *,
        title: str = "",
        friction: float | None = None,
        all_times: bool = False,
    ) -> "View":
        """The run as a page: the body in three dimensions, and graphs over time, which a notebook shows in place.

        ``run.view().save("run.html")`` or ``run.view("run.html")`` writes it as one file that opens in any browser,
        without a network; ``run.view().html`` is its text. Each frame shows the nearest saved time.

        **Arguments:**

        - ``path``: a file that ends in ``.html``, to which it is written as well; see :func:`jaxball.plot.write_view`.
        - ``title``: a line that says which system it is.
        - ``friction``: a coefficient μ, whose cone is drawn at the contact point, and whose line beside |f| / N.
        - ``all_times``: whether a page that would be larger than 1 MB shows all saved times, and not some of them.

        **Raises:** as :func:`jaxball.plot.write_view`.
        """
        from .. import plot

        view = plot.View.of(self, title, friction=friction, all_times=all_times)
        if path is not None:
            view.save(path)
        return view

    def __repr__(self) -> str:
        if isinstance(self.status, Tracer):
            return f"Trajectory of a {self.system.described()}, traced, with {self.times.shape[-1]} times"
        if np.ndim(self.status):
            return self._of_many()
        lines = [
            f"Trajectory of a {self.system.described()}",
            f"  {counted(self.times.size, 'time')} from {float(self.times[0]):g} to {float(self.times[-1]):g}",
        ]
        if int(self.status) == Status.IMPOSSIBLE:
            return "\n".join([*lines, f"  {self.message}"])
        steps = f"  {counted(int(self.steps), 'step')}, {int(self.rejected)} of them rejected"
        lines += [steps, f"  {self.message}"]
        if isinstance(self.state, BallState | DiskState):
            z = np.atleast_1d(np.asarray(self.state.z)[-1])
            lines.append("  z at the end: " + ", ".join(f"{value:.12g}" for value in z))
        if self.contact is not None:
            lines += [f"  {line}" for line in self.contact.lines]
        return "\n".join(lines)

    def _of_many(self) -> str:
        """A batch in a few lines: how many runs, how they ended, and how many steps they took."""
        statuses, counts = np.unique(np.asarray(self.status), return_counts=True)
        ends = ", ".join(f"{count} {Status(int(s)).name}" for s, count in zip(statuses, counts, strict=True))
        steps = np.asarray(self.steps)
        return (
            f"Trajectories of a {self.system.described()}, a batch of shape {np.shape(self.status)}\n"
            f"  {self.times.shape[-1]} times from {np.min(self.times):g} to {np.max(self.times):g}\n"
            f"  {np.min(steps)} to {np.max(steps)} steps\n"
            f"  how they ended: {ends}"
        )


@functools.cache
def _outline() -> Any:
    """The structure of a trajectory whose fields are the leaves."""
    whole = object.__new__(Trajectory)
    for field in dataclasses.fields(Trajectory):
        object.__setattr__(whole, field.name, field.name)
    return jax.tree.structure(whole)


@programs.filter_jit
def _observe_all(system, times, state) -> Observables:
    def observed(system, t, x):
        return observe(system, t, x.in_space() if isinstance(x, RotationState) else x)

    return _at_each(observed, system.prepare(), times, state)


@programs.filter_jit
def _observe_all_on_plane(plane, times, states) -> Observables:
    return _at_each(observe_on_plane, plane.prepare(), times, states)


@programs.filter_jit
def _laws_of_all(system, times, state) -> Any:
    return _at_each(lambda system, t, x: system.laws(t, x), system.prepare(), times, state)


def _at_each(function: Callable[..., Any], system: Any, times: Array, state: Any) -> Any:
    """``function(system, t, state)`` at each time, without derivatives where the solve did not come."""

    def one(t, x):
        known = jnp.all(jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(x)]))
        return function(*differentiated_where(known, (system, t, x)))

    return jax.vmap(one)(times, state)


@programs.filter_jit
def _evaluate(interpolant, t, start, reached, status) -> Any:
    def one(t):
        inside = jnp.clip(t, start, reached)
        x = interpolant.solution.evaluate(inside)
        known = (t == inside) & jnp.all(jnp.isfinite(x)) & (status != Status.IMPOSSIBLE)
        return body_of(interpolant.packing.system, interpolant.packing.unpack_where(known, inside, x))[1]

    return jax.vmap(one)(t) if t.ndim else one(t)
