"""A scenario: everything that a run needs, as one object."""

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...interface.arguments import refusal
from ...interface.names import leave_to
from ...interface.printing import format_value, repr_html
from ...interface.wording import one_of
from ...physics.contact.law import Contact
from ...physics.contact.released import ReleasedState
from ...physics.sensors import AbstractSensor
from ...physics.system import AbstractState, AbstractSystem
from ...simulation import DEFAULT_TOLERANCE
from .errors import ScenarioError
from .solve import check_dae
from .solvers import SOLVERS

if TYPE_CHECKING:
    import diffrax

    from ...control.loop import ClosedLoop
    from ...simulation.events import AbstractEvent
    from ...simulation.trajectory import Trajectory
    from .feedback import AbstractFeedbackSettings, EstimatorSettings
    from .units import Units


@dataclasses.dataclass(frozen=True, eq=False)
class Scenario:
    """A system, its initial state, the save times, and solver settings: the content of a scenario file.

    - ``title``: a line that says what it is.
    - ``system``: a :class:`~jaxball.Ball`, a :class:`~jaxball.Disk`, or one of :mod:`jaxball.physics.classical`.
    - ``state``: the state at ``times[0]``; a :class:`~jaxball.physics.ReleasedState` only with ``contact``.
    - ``times``: the save times, increasing, in the units of the system.
    - ``solver``: the name of a solver: "dopri5", "dopri8", "tsit5", "kvaerno3" and "kvaerno5" of diffrax, and
      "radau5", "radau9", "radau13", "ndf", "adams", "gauss16", "trapezoidal" and "tr-bdf2" of
      :mod:`jaxball.simulation.solvers`.
    - ``rtol``, ``atol``, ``max_steps``, ``max_step``, ``step_to_times``, ``dae``, ``project``: as in
      :func:`jaxball.simulate`.
    - ``contact``: the :class:`~jaxball.Contact`, the law by which a ball or a disk may slip, fly and bounce; None for
      one that always rolls.
    - ``sensors``: those of :mod:`jaxball.physics.sensors` whose readings are saved and drawn with a run, by name.
    - ``feedback``: such as :class:`RegulatorSettings`, with which a run is a closed loop along
      the motion that the scenario has without it, sampled at the save times; None for a run without feedback.
    - ``estimator``: the :class:`EstimatorSettings` of feedback from what the sensors read; None for that of the state.
    - ``events``: what each run looks for, by name, such as an :class:`~jaxball.Event`; not with ``feedback``.
    - ``units``: the :class:`Units` of its numbers, with which runs are saved and drawn; None if they are not stated.

    **Example:**

    >>> import numpy as np
    >>> from jaxball import Disk, DiskState, Scenario
    >>> scenario = Scenario("rolling", Disk(mass=1.0, inertia=0.5), DiskState(phidot=-1.0), np.array([0.0, 1.0, 2.0]))
    >>> scenario.simulate().ok
    True
    """

    title: str
    system: AbstractSystem
    state: AbstractState | ReleasedState
    times: np.ndarray
    solver: str = "dopri8"
    rtol: float = DEFAULT_TOLERANCE
    atol: float = DEFAULT_TOLERANCE
    max_steps: int = 16384
    step_to_times: bool = False
    dae: bool = False
    project: bool = False
    contact: Contact | None = None
    sensors: Mapping[str, AbstractSensor] = dataclasses.field(default_factory=dict)
    feedback: "AbstractFeedbackSettings | None" = None
    estimator: "EstimatorSettings | None" = None
    events: "Mapping[str, AbstractEvent]" = dataclasses.field(default_factory=dict)
    units: "Units | None" = None
    max_step: float | None = None

    _repr_html_ = repr_html

    def __repr__(self) -> str:
        span = f"{len(self.times)} times from {self.times[0]:g} to {self.times[-1]:g}"
        head = f"Scenario {self.title!r}: {span}, {self.solver} at rtol {self.rtol:g}"
        sensors = [f"{name}: {sensor}" for name, sensor in self.sensors.items()]
        events = [f"{name}: {event}" for name, event in self.events.items()]
        parts = [self.system, format_value(self.state), self.contact, *sensors, self.feedback, self.estimator, *events]
        parts = [str(part) for part in parts if part is not None]
        return "\n  ".join([head, *"\n".join(parts).splitlines()])

    @property
    def may_slip(self) -> bool:
        """Whether there is a law of contact, by which the body may slip, fly and bounce."""
        return self.contact is not None

    @property
    def settings(self) -> dict[str, Any]:
        """The solver, and how it solves, as arguments of :func:`jaxball.simulate`."""
        names = ("rtol", "atol", "max_steps", "max_step", "step_to_times", "dae", "project")
        return {"solver": SOLVERS[self.solver](), **{name: getattr(self, name) for name in names}}

    def friction_or(self, otherwise: float) -> float:
        """Returns the kinetic friction coefficient of the law of contact, or ``otherwise`` where the body
        always rolls.
        """
        return otherwise if self.contact is None else float(self.contact.friction)

    @property
    def system_to_solve(self) -> AbstractSystem:
        """What is solved: the system itself, or one with its modes, such as those of a law of contact.

        **Raises:** ``TypeError`` for a law that the system has no equations for.
        """
        from ...simulation.arguments import system_to_solve  # here, as below

        return system_to_solve(self.system, self.contact)

    def simulate(
        self,
        *,
        solver: str | None = None,
        rtol: float | None = None,
        atol: float | None = None,
        max_steps: int | None = None,
        max_step: float | None = None,
        dense: bool = False,
        events: "Mapping[str, AbstractEvent] | None" = None,
        progress: "diffrax.AbstractProgressMeter | None" = None,
        throw: bool = False,
    ) -> "Trajectory[Any, Any]":
        """Computes the trajectory, with the scenario's own settings unless others are given; both are saved with it.

        With ``feedback`` it is that of the closed loop, whose history has the motion and what was estimated. The
        ``events`` are looked for besides those of the scenario, and are not saved with it.

        **Raises:** as :func:`jaxball.simulate`, and :class:`ScenarioError` where the solver does not support ``dae``,
        for dense output, events or another solver with ``feedback``, and for events of the same name as the scenario's.
        """
        # Imported here, because reading a scenario needs no solver, and these take long to import.
        from ...simulation.simulate import simulate

        named = "Key `solve.solver`" if solver is None else "Argument `solver`"
        solver = self.solver if solver is None else solver
        if not isinstance(solver, str) or solver not in SOLVERS:
            raise refusal("solver", f"a name, {one_of(list(SOLVERS))}", solver)
        check_dae(self.system, self.contact, solver, self.dae, named)
        overrides = {"solver": solver, "rtol": rtol, "atol": atol, "max_steps": max_steps, "max_step": max_step}
        used = dataclasses.replace(self, **{name: value for name, value in overrides.items() if value is not None})
        if used.feedback is not None:
            trajectory = used._simulate_loop(dense or bool(events) or bool(self.events))
            return trajectory.raise_if_failed() if throw else trajectory
        trajectory = simulate(
            self.system,
            self.times,
            self.state,
            **used.settings,
            dense=dense,
            events=self._with(events),
            contact=self.contact,
            progress=progress,
        ).set_scenario(used)
        return trajectory.raise_if_failed() if throw else trajectory

    def _with(self, events: "Mapping[str, AbstractEvent] | None") -> "Mapping[str, AbstractEvent] | None":
        """Returns the events of the scenario and others, which must have other names."""
        # What is no mapping of events is refused by `simulate`.
        if not self.events or not isinstance(events, Mapping):
            return self.events if events is None else events
        for name in events:
            if name in self.events:
                raise ScenarioError(
                    f'Argument `events` must have other names than the events of the scenario, but "{name}" is one of '
                    "them; choose another name."
                )
        return {**self.events, **events}

    @leave_to(".closed_loop:build_loop")
    def closed_loop(self) -> "ClosedLoop":
        """Builds the closed loop of a scenario with ``feedback``, like
        :meth:`jaxball.control.AbstractFeedback.closed_loop`.

        **Raises:** :class:`ScenarioError` without feedback, and where it does not fit;
        :class:`~jaxball.SolveError` where the motion that it holds cannot be simulated.
        """
        raise NotImplementedError

    @leave_to(".closed_loop:simulate_loop")
    def _simulate_loop(self, asks_for_more: bool) -> "Trajectory[Any, Any]":
        """Simulates the closed loop, or returns the run of the motion where that fails."""
        raise NotImplementedError
