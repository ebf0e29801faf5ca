"""A robot under sampled feedback: measured at each sample, with inputs that are limited, delayed and held.

What the run records besides its states is in :mod:`.history`.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .. import programs
from ..interface.arguments import refusal, require, whole_number
from ..interface.compat import is_traced
from ..interface.printing import Printed
from ..interface.status import Status
from ..numerics.arrays import Numbers, to_array
from ..physics.body import System
from ..physics.contact.law import Contact
from ..physics.forces.force import AbstractWrench, Wrenches
from ..physics.hybrid import NO_HISTORY, AbstractHistory
from ..physics.state import PlacedState
from ..physics.system import require_one_state
from ..simulation.arguments import system_to_solve
from ..simulation.events import Event
from ..simulation.extremes import most_steps_of_sample
from ..simulation.simulate import simulate
from ..simulation.trajectory import Trajectory
from .feedback import AbstractFeedback
from .history import FeedbackHistory
from .inputs import replay_inputs
from .sampled import SampledSystem
from .weights import by_name


def until_end(rows: Float[Array, "samples ..."], count: int) -> Float[Array, "samples_and_end ..."]:
    """Returns the first ``count`` rows, and NaN where there are fewer."""
    missing = jnp.full((max(count - rows.shape[0], 0), *rows.shape[1:]), jnp.nan, rows.dtype)
    return jnp.concatenate([rows[:count], missing])


PAST_FAILURE = 1e-6  # of a sample


class ClosedLoop(Printed):
    """A run under feedback.

    - ``times``: of the samples, and the end, shape (N + 1,).
    - ``moving``: what the robot advances, at ``times``, as :meth:`SampledSystem.advance` has it: the states or, with a
      law of contact, more than these.
    - ``u``: the inputs that acted, shape (N, m).
    - ``du``: what feedback added to those of the motion, after delay and limits, shape (N, m).
    - ``xi``: the deviations from the motion in local coordinates, shape (N + 1, n).
    - ``feedback``: the feedback.
    - ``plant``: the robot that was simulated.
    - ``memory``: what the feedback remembers at the end.
    - ``status``: the :class:`~jaxball.Status` of the first sample whose solve failed, or ``SUCCESS``.
    """

    times: Float[Array, " samples_and_end"]
    moving: Any
    u: Float[Array, "samples m"]
    du: Float[Array, "samples m"]
    xi: Float[Array, "samples_and_end n"]
    feedback: AbstractFeedback
    plant: SampledSystem
    memory: Any
    status: Int[Array, ""]

    @property
    def states(self) -> PlacedState:
        """The states at ``times``."""
        return self.plant.body_state(self.moving)

    @property
    def ok(self) -> bool:
        """Whether the run reached its end."""
        return int(self.status) == Status.SUCCESS

    @property
    def reached(self) -> Float[Array, ""]:
        """The last sample, or the end, whose state is known."""
        # Where a run fails, all later deviations are NaN.
        return self.times[jnp.sum(jnp.all(jnp.isfinite(self.xi), axis=1)) - 1]

    @property
    def saturated(self) -> Bool[Array, "samples m"]:
        """Where an input was at its limit."""
        return jnp.abs(self.u) >= self.plant.limits[None]

    @property
    def run(self) -> Trajectory[Any, Any]:
        """The run as a trajectory of the robot with the inputs that acted: with observables, figures and files.

        One that has modes is simulated again, in one piece, with their history.
        """
        plant = self.plant
        system = replay_inputs(plant.system, plant.places, plant.limits, self.times, self.u)
        start = jax.tree.map(lambda leaf: leaf[0], self.states)
        if system_to_solve(system, plant.contact).is_hybrid:
            return self._simulate_again(start)
        none = jnp.zeros_like(self.status)
        steps, history = none + self.u.shape[0], self._history(NO_HISTORY)
        return Trajectory.of(
            system, self.times, self.states, self.reached, self.status, steps, none, None, {}, start, history
        )

    def _simulate_again(self, start: PlacedState) -> Trajectory[Any, Any]:
        """Simulates the run in one piece, as far as the loop came."""
        plant, u, events = self.plant, self.u, {}
        stopped = not is_traced(self.status) and not self.ok
        if stopped:
            # The solve must not see inputs after the failure, which are unknown: it ends soon after the last sample.
            u, end = jnp.nan_to_num(u), self.reached + PAST_FAILURE * plant.sample
            events = {"end": Event(lambda system, t, state: t - end, terminal=True)}
        run = simulate(
            replay_inputs(plant.system, plant.places, plant.limits, self.times, u),
            self.times,
            start,
            contact=plant.contact,
            rtol=plant.rtol,
            atol=plant.atol,
            max_steps=self.u.shape[0] * most_steps_of_sample(plant.contact),
            events=events,
            inside=False,
        )
        run = dataclasses.replace(run, history=self._history(run.history))
        if stopped and run.ok:
            run = dataclasses.replace(run, status=self.status, reached=self.reached, events={})
        return run

    def _history(self, modes: AbstractHistory) -> FeedbackHistory:
        count, nominal = len(self.times), self.feedback.nominal
        # After the end of the motion its last state is held.
        numbered = jnp.minimum(jnp.arange(count), nominal.samples)
        states = jax.tree.map(lambda leaf: leaf[numbered], nominal.states)
        estimate = self.feedback.estimates(self.times, self.memory)
        u = until_end(self.u, count)
        return FeedbackHistory(modes, states, u, estimate, self.plant.inputs)

    def __repr__(self) -> str:
        if is_traced(self.u):
            return f"Run of a {self.plant.system.describe()} under feedback, traced"
        sizes = np.linalg.norm(np.asarray(self.xi), axis=1)
        lines = [
            f"Run of a {self.plant.system.describe()} under feedback",
            f"  {len(self.u)} samples from {float(self.times[0]):g} to {float(self.times[-1]):g}",
            f"  |ξ| from {sizes[0]:.4g} to {sizes[-1]:.4g}",
        ]
        share = np.mean(np.asarray(self.saturated))
        return "\n".join([*lines, f"  inputs at their limits in {share:.1%} of samples"] if share else lines)


def closed_loop(
    feedback: AbstractFeedback,
    start: PlacedState | Mapping[str, Numbers] | Numbers | None = None,
    *,
    system: System | None = None,
    limits: Numbers | Mapping[str, Numbers] | None = None,
    delay: int = 0,
    push: AbstractWrench | None = None,
    samples: int | None = None,
    contact: Contact | None = None,
    adjoint: diffrax.AbstractAdjoint | None = None,
) -> ClosedLoop:
    plant = plant_of(feedback, system, limits, push, contact)
    first = start_of(feedback, start)
    count = feedback.nominal.samples if samples is None else whole_number("samples", samples, 1)
    late = whole_number("delay", delay, 0, count - 1)  # else feedback would never act
    return _run_loop(feedback, plant, first, count, late, adjoint)


def run_loop(
    feedback: AbstractFeedback,
    plant: SampledSystem,
    start: PlacedState,
    samples: int,
    delay: int | Int[Array, ""] = 0,
    adjoint: diffrax.AbstractAdjoint | None = None,
    longest: int | None = None,
) -> ClosedLoop:
    """Runs the loop; traceable.

    A ``delay`` that is traced is at most the ``longest``.
    """
    nominal, limits = feedback.nominal, plant.limits
    # With a traced delay the queue must have the length of the longest one.
    room = int(delay) if longest is None else longest
    t0 = nominal.times[0]

    def step(carry: Any, k: Array) -> Any:
        moving, memory, waiting = carry
        state = plant.body_state(moving)
        added, memory = feedback.act(k, plant, moving, memory)
        # The newest entry is the last, at `room`; the one that takes effect was appended `delay` samples ago.
        queue = jnp.concatenate([waiting, added[None]])
        planned = nominal.input(k)
        # Only what feedback adds is late: the inputs of the motion are known beforehand.
        u = jnp.clip(planned + queue[room - delay], -limits, limits)
        memory = feedback.remember_inputs(k, u, memory)
        after, status = plant.advance(plant.hold(u), t0 + plant.sample * k.astype(t0.dtype), moving, adjoint)
        seen = moving, u, u - planned, feedback.deviation(k, state), status
        # As in `flow`.
        return (after.projected(), memory, queue[1:]), seen

    waiting = jnp.zeros((room, nominal.u.shape[1]), nominal.u.dtype)
    numbered = jnp.arange(samples)
    begun = plant.begin(plant.hold(nominal.input(0)), t0, start)
    (last, memory, _), (moving, u, du, xi, statuses) = jax.lax.scan(step, (begun, feedback.begin(), waiting), numbered)
    # States begin at the samples; the scan does not give the last one, at the end.
    moving = jax.tree.map(lambda along, end: jnp.concatenate([along, end[None]]), moving, last)
    xi = jnp.concatenate([xi, feedback.deviation(jnp.asarray(samples), plant.body_state(last))[None]])
    times = t0 + plant.sample * jnp.arange(samples + 1, dtype=t0.dtype)
    # What follows a failure has states of NaN, which is impossible; the first says what it was.
    status = statuses[jnp.argmax(statuses != int(Status.SUCCESS))]
    return ClosedLoop(times, moving, u, du, xi, feedback, plant, memory, status)


_run_loop = programs.filter_jit(run_loop)


def plant_of(
    feedback: AbstractFeedback,
    system: System | None,
    limits: Numbers | Mapping[str, Numbers] | None,
    push: AbstractWrench | None = None,
    contact: Contact | None = None,
) -> SampledSystem:
    """Returns the robot that is simulated.

    **Raises:** ``ValueError`` for one whose state differs from that of the motion, and for limits that do not fit.
    """
    require("contact", contact, (Contact, type(None)), "a Contact, such as Contact(0.3), or None")
    design = feedback.sampled
    plant = design
    if system is not None:
        plant = SampledSystem.of(system, design.sample, design.inputs, design.rtol, design.atol)
        coordinates, needed = plant.system.coordinates, design.system.coordinates
        if coordinates != needed or type(plant.system) is not type(design.system):
            raise ValueError(
                f"Argument `system` must be a {design.system.title} whose state holds {', '.join(needed)}, as that of "
                f"the motion, but it is a {plant.system.title} whose state holds {', '.join(coordinates) or 'none'}."
            )
    if limits is not None:
        plant = eqx.tree_at(lambda s: s.limits, plant, limits_of(design, limits))
    if push is not None:
        require("push", push, AbstractWrench, "a force, such as a Push")
        force = push if plant.system.force is None else Wrenches((plant.system.force, push))
        # Without a force there is no leaf to replace.
        plant = eqx.tree_at(lambda s: s.system.force, plant, force, is_leaf=lambda x: x is None)
    return dataclasses.replace(plant, contact=contact)


def start_of(feedback: AbstractFeedback, start: PlacedState | Mapping[str, Numbers] | Numbers | None) -> PlacedState:
    """Returns the state at which a closed loop starts.

    **Raises:** ``TypeError`` for another kind of state, ``ValueError`` for one, or for coordinates, of another size,
    and for coordinates that are not finite.
    """
    first = feedback.nominal.state(0)
    if start is None:
        return first
    if isinstance(start, eqx.Module):
        if type(start) is not type(first):
            raise refusal("start", f"a {type(first).__name__}, as that of the motion", start)
        require_one_state(feedback.sampled.system, start)
        return start
    names = first.directions
    xi = to_array(by_name("start", start, names) if isinstance(start, Mapping) else start, "start")
    if xi.shape != (len(names),):
        raise ValueError(
            f"Argument `start` must be a state, or {len(names)} local coordinates, {', '.join(names)}, but its shape "
            f"is {xi.shape}."
        )
    if not is_traced(xi) and not np.all(np.isfinite(xi)):
        raise ValueError(f"Argument `start` must have finite numbers, but they are {np.asarray(xi)}.")
    return feedback.sampled.displace(first, xi)


def limits_of(sampled: SampledSystem, given: Numbers | Mapping[str, Numbers]) -> Float[Array, " m"]:
    """Returns the limits of all inputs, which are passed as one number, a row, or by name; infinite for inputs left
    out.

    **Raises:** ``ValueError`` for another shape, unknown names, and negative numbers.
    """
    inputs = sampled.inputs
    array = to_array(by_name("limits", given, inputs, np.inf) if isinstance(given, Mapping) else given, "limits")
    if array.ndim > 1 or (array.ndim == 1 and array.shape != (len(inputs),)):
        raise ValueError(
            f"Argument `limits` must be a number, or one for each of {', '.join(inputs)}, but its shape is "
            f"{array.shape}."
        )
    if not is_traced(array) and not bool(np.all(np.asarray(array) >= 0)):
        raise ValueError(f"Argument `limits` must be 0 or positive, but it is {np.asarray(array).tolist()}.")
    return jnp.broadcast_to(array, (len(inputs),))
