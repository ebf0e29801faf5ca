"""The time-stepping loop of a solve: how long its steps are, where they end, what is saved of them, and when to stop.

``simulate`` runs it within its program.

diffrax prepares what the loop needs, and its solvers and controllers take the steps. Its own loop is not used, because
the program of that is twice as large, and because diffrax checks the times at which to save by calling back to Python,
which took a third of a solve.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..numerics.arrays import select_tree
from ..physics.hybrid import Accuracy
from ..physics.system import AbstractSystem
from ..programs.batches import fill_vectors
from ..programs.derivatives.reverse_rules import CarryOut, at_once, put, put_while
from ..programs.derivatives.reversible_loop import Parts, Recorded, while_loop
from ..programs.derivatives.steering import control_error
from ..programs.native import is_traced_natively
from .inputs import LimitedSteps
from .observers import Observers, Step
from .solvers import StepToKinks
from .solvers.dense.continuous import DenseOutput, has_one_tableau, whole_info
from .solvers.dense.steps import AfterPauses, Pause
from .solvers.explicit import depends_on_arguments_alone, with_first_slope, with_stages_pulled_back
from .solvers.moving import of_moving, with_zeros
from .solvers.multistep import AbstractMultistep, AbstractMultistepController, PlannedError
from .switching import BetweenSteps, NextStep, Taken
from .watch import Watch, Within

# A step that would end this close to the end of the run, relative to it, ends there.
CLOSE_TO_END = 100
# A shorter step ends the solve, as no step is accepted where the field is not finite; of runs shorter than 1, in runs.
LEAST_STEP = 1e-30
MOST_CHECKPOINTS = 4096  # of some kilobytes each, which XLA fills with zeros
MOST_NATIVELY = 16384  # where memory that is not used costs nothing
RESULTS: Any = diffrax.RESULTS


class SavedStates(NamedTuple):
    """The vectors at the times between the first and the last; the first ``filled`` are known, the others infinite."""

    filled: Int[Array, ""]
    vectors: Float[Array, "inner size"]


class SolveLoop(diffrax.AbstractAdjoint):
    """The loop of a solve that saves the vectors at ``times``, infinite at times that it does not reach.

    What ``switching`` and ``watch`` carried to the end is among the statistics, as ``switching`` and ``watched``, and
    the vector at the ``end``; with ``observers``, so is what they ``found``.

    ``mode`` is the way in which it is differentiated: ``RecursiveCheckpointAdjoint`` for reverse mode, ``ForwardMode``
    for forward mode or none.
    """

    mode: diffrax.RecursiveCheckpointAdjoint | diffrax.ForwardMode = eqx.field(static=True)
    times: Float[Array, " T"]
    switching: BetweenSteps
    observers: Callable[[Any], Observers] | None = eqx.field(static=True)  # a function of the terms' arguments
    watch: Watch | None = eqx.field(static=True)
    accuracy: Accuracy
    parameters: list[Array]
    join: Callable[[list[Array]], Array] = eqx.field(static=True)

    @property
    def reverse(self) -> bool:
        """Whether derivatives are those of reverse mode."""
        return isinstance(self.mode, diffrax.RecursiveCheckpointAdjoint)

    def loop(
        self,
        *,
        args: Any,
        terms: Any,
        solver: Any,
        stepsize_controller: Any,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        max_steps: int,
        init_state: Any,
        progress_meter: diffrax.AbstractProgressMeter,
        **_: Any,
    ) -> tuple[Any, dict[str, Any]]:
        """Returns the state of diffrax's loop at the end of a solve, and all that was saved; no further statistics."""
        if not self.reverse and isinstance(solver, diffrax.AbstractRungeKutta) and solver.scan_kind is None:
            solver = eqx.tree_at(lambda s: s.scan_kind, solver, "lax", is_leaf=lambda x: x is None)
        output, dense = DenseOutput.of(solver), init_state.dense_ts is not None
        output = output._replace(moving=self.switching.count_moving(init_state.y, args))
        if dense:
            infos = output.room(init_state.dense_infos, max_steps)
            if self.switching.jumps:
                infos = {"pause": Pause.empty(init_state.y, max_steps), "info": infos}
            init_state = dataclasses.replace(init_state, dense_ts=init_state.dense_ts.at[0].set(t0), dense_infos=infos)
        reverse, of_stages, of_resets = self.reverse, Recorded("stages"), Recorded("reset")
        by_stages = reverse and depends_on_arguments_alone(terms, t0, init_state.y, args)  # or derivatives get lost

        def stepper_of(recorded: Recorded) -> Any:
            return with_stages_pulled_back(solver, recorded) if by_stages else solver

        resets = (self.parameters, of_resets) if reverse else (args, at_once)
        fixed = output, stepsize_controller, args, resets, t0, t1, progress_meter, self.switching, self.accuracy
        solve = _Solve(terms, solver, stepper_of(of_stages), *fixed)
        y0, switching, watch = init_state.y, self.switching, self.watch
        observers = None if self.observers is None else self.observers(args)

        def is_unfinished(carry: tuple[Any, ...]) -> Bool[Array, ""]:
            state, _, hybrid, *_ = carry
            return (state.tprev < t1) & (state.result == RESULTS.successful) & switching.goes_on(hybrid)

        recorder = _Recorder(self, solve, output, observers, dense)

        def advance(carry: tuple[Any, ...], counts: Bool[Array, ""]) -> tuple[Any, ...]:
            before, saved, hybrid, seen, watched, size = carry
            state, until, hybrid = solve.after_reset(before, switching.with_event_if(counts, hybrid))
            new, info, keep, hybrid, size = solve.advance(state, hybrid, size)
            pause = Pause(before.y, until, state.tprev)
            new, *recorded = recorder.record(before.tprev, pause, state, new, info, keep & counts, saved, seen, watched)
            return new, recorded[0], hybrid, *recorded[1:], size

        inner = SavedStates(jnp.asarray(0), jnp.full((self.times.size - 2, *y0.shape), jnp.inf, y0.dtype))
        seen = None if observers is None else observers.begin(y0)
        watched = None if watch is None else watch.begin(t0, y0, args)
        hybrid = switching.init(t0, y0, init_state.tnext - t0)
        state, saved, hybrid, seen, watched, _ = while_loop(
            is_unfinished,
            advance,
            (init_state, inner, hybrid, seen, watched, jnp.zeros((), y0.dtype)),
            max_steps=max_steps,
            buffers=lambda carry: (*_buffers(carry), switching.record(carry[2])),
            reverse=reverse,
            rows=self._checkpoints(max_steps),
            recorded=(of_stages, of_resets),
            parts=Parts(args, self.parameters, self.join),
            moved=lambda carry: carry[0].y,
        )
        done = state.tprev >= t1
        last = jnp.where(done, state.y, jnp.inf)
        first = switching.first(hybrid, y0)
        states = jnp.concatenate([first[None], saved.vectors, last[None]])
        state = dataclasses.replace(
            state,
            save_state=dataclasses.replace(state.save_state, ts=state.tprev[None], ys=states),
            num_rejected_steps=state.num_steps - state.num_accepted_steps,
            result=RESULTS.where(is_unfinished((state, saved, hybrid)), RESULTS.max_steps_reached, state.result),
        )
        statistics = {"switching": hybrid, "watched": watched, "end": state.y}
        if observers is not None:
            solve = solve._replace(stepper=stepper_of(Recorded("stages")))  # its steps are none of the loop's
            statistics["found"] = observers.results(seen, t0, first, functools.partial(solve.again, output))
        return state, statistics

    def _checkpoints(self, max_steps: int) -> int | None:
        """Returns how many steps are kept for reverse mode.

        With fewer than all steps, derivatives after the end of a slip were off by up to 2e-5, presumably
        because a recomputed step rounds differently. So where modes end, all steps are kept, up to a limit.
        """
        chosen = self.mode.checkpoints if isinstance(self.mode, diffrax.RecursiveCheckpointAdjoint) else None
        if chosen is None and self.switching.jumps:
            return min(max_steps, MOST_NATIVELY if is_traced_natively() else MOST_CHECKPOINTS)
        return chosen

    def save_states(
        self, saved: SavedStates, interpolation: diffrax.AbstractLocalInterpolation, until: Float[Array, ""]
    ) -> SavedStates:
        """Saves the states up to ``until`` as well, from the interpolation of a step."""
        if self.times.size == 2:
            return saved

        inner = self.times[1:-1]

        def row_of(k: Int[Array, ""]) -> Float[Array, " size"]:
            # Not at `due`, which is infinite where nothing is: in a batch, that would be differentiated.
            return interpolation.evaluate(inner[k])

        vectors, filled = put_while(
            lambda k: self.due(k) <= until, row_of, saved.vectors, saved.filled, reverse=self.reverse
        )
        return SavedStates(filled, vectors)

    def due(self, filled: Int[Array, ""]) -> Float[Array, ""]:
        """Returns the next interior time, after the first ``filled``; infinite where there is none."""
        inner = self.times[1:-1]
        return jnp.where(filled < inner.size, inner[filled], jnp.inf) if inner.size else jnp.asarray(jnp.inf)


class _Recorder(NamedTuple):
    """Keeps what a run shows of its steps: saved states, dense output, extremes and events."""

    loop: SolveLoop
    solve: "_Solve"
    output: DenseOutput
    observers: Observers | None
    dense: bool

    def record(
        self,
        t0: Float[Array, ""],
        pause: Pause,
        state: Any,
        new: Any,
        info: Any,
        keep: Bool[Array, ""],
        saved: SavedStates,
        seen: Any,
        watched: Any,
    ) -> tuple[Any, SavedStates, Any, Any]:
        """Returns the ``new`` state and the records, with the step from ``state`` if it is to ``keep``.

        ``t0`` is the end of the step before, from which the pause lasts; ``info`` is what the step's interpolation is
        made of.
        """
        loop, observers, watch, output = self.loop, self.observers, self.loop.watch, self.output
        reverse, args, run = loop.reverse, self.solve.args, (self.solve.t0, self.solve.t1)
        step = {"t0": state.tprev, "t1": state.tnext}
        exactly = self.dense or (observers is not None and observers.needs_exact)
        coarse = self.solve.solver.interpolation_cls(**step, **whole_info(info))
        interpolation = shown = coarse
        glance, begin, end = None, None, state.tnext
        if watch is not None:
            sketch = jax.tree_util.Partial(output.sketch, info, coarse)
            glance = watch.glance(watched, Within(state.tprev, state.tnext, sketch, run), args)
        if exactly or loop.times.size > 2 or glance is not None:
            # A continuous extension costs evaluations of the field, so it is made only where a state is asked for.
            asked = keep & (exactly | (loop.due(saved.filled) < state.tnext))
            asked |= False if glance is None else keep & ~glance.quiet
            info = output.info(info, self.solve.terms, **step, args=args, asked=asked)
            interpolation = shown = output.interpolation(**step, **info)
            if loop.switching.jumps:
                begin = t0
                shown = AfterPauses(output.interpolation)(t0=t0, t1=state.tnext, pause=pause, info=info)
                info = {"pause": pause, "info": info}
            # Of a rejected step nothing is due.
            saved = loop.save_states(saved, shown, jnp.where(keep, state.tnext, -jnp.inf))
        if self.dense:
            new = _keep_for_dense_output(new, info, keep)
        if watch is not None and glance is not None:
            exact = jax.tree_util.Partial(fill_vectors, interpolation.evaluate)
            within = Within(state.tprev, state.tnext, exact, run)
            before, watched = watched, watch.record(watched, glance, within, args, keep, reverse=reverse)
            if observers is not None and watch.may_end_run:
                end = watch.end(before, watched, within, args)
            result = RESULTS.where(watched.log.ended, RESULTS.event_occurred, new.result)
            new = dataclasses.replace(new, result=result)
        if observers is not None:
            observed_step = Step(state.tprev, end, state.y, coarse.evaluate, shown.evaluate, begin)
            seen = observers.observe(seen, observed_step, run, keep, reverse=reverse)
        return new, saved, seen, watched


class _Solve(NamedTuple):
    """What stays the same from step to step."""

    terms: Any
    solver: Any
    stepper: Any  # the same, with steps that can be differentiated
    output: DenseOutput
    controller: Any
    args: Any
    resets: tuple[Any, CarryOut]  # the parameters of a reset, and how it is carried out
    t0: Float[Array, ""]
    t1: Float[Array, ""]
    progress_meter: diffrax.AbstractProgressMeter
    switching: BetweenSteps
    accuracy: Accuracy

    def after_reset(self, state: Any, hybrid: Any) -> tuple[Any, Array, Any]:
        """Returns the state with which the next step begins, which is after the reset where there was an event, and the
        vector before it.
        """
        step = NextStep(jnp.asarray(True), state.tprev, state.tnext, None, jnp.asarray(False))
        run = self.t0, self.t1
        hybrid, step, reset = self.switching.apply_reset(hybrid, step, state.y, run, *self.resets)
        jumped = state.made_jump | reset.happened
        # After a pause, the step is as long as before it.
        limited = isinstance(self.controller, LimitedSteps) and self.switching.jumps
        end = self.controller.limit(step.start, step.end) if limited else step.end
        state = dataclasses.replace(state, tprev=step.start, tnext=end, y=reset.after, made_jump=jumped)
        return state, reset.before, hybrid

    def advance(self, state: Any, hybrid: Any, size: Float[Array, ""]) -> tuple[Any, Any, Bool[Array, ""], Any, Any]:
        """Takes a step: the state after it, what its interpolation is made of, whether it was accepted, what is carried
        of the modes, and of the probe its ``size``.
        """
        limited = isinstance(self.controller, LimitedSteps)
        chooses = self.controller.controller if limited else self.controller
        smooth = isinstance(chooses, diffrax.PIDController | AbstractMultistepController)
        jumps = self.switching.jumps or not smooth
        # A plain False, where nothing jumps, keeps the evaluation after a jump out of the program.
        jumped = state.made_jump if jumps else False
        y, error, info, solver_state, step_result = self._take_step(state, jumped)
        if not isinstance(error, PlannedError):  # by which multistep methods choose their order as well
            rtol, atol, *_ = self.accuracy
            weights = atol + rtol * jnp.maximum(jnp.abs(state.y), jnp.abs(y))
            error, size = control_error(error, (state.y, y), weights, self.accuracy.tolerance, size)
        keep, tprev, tnext, made_jump, controller_state, control_result = self.controller.adapt_step_size(
            state.tprev,
            state.tnext,
            state.y,
            y,
            self.args,
            # Of an error that is NaN the next length would be NaN, too; for an infinite one, the step is tried again,
            # shorter.
            jax.tree.map(lambda leaf: jnp.where(jnp.isnan(leaf), jnp.inf, leaf), error),
            self.solver.error_order(self.terms),
            state.controller_state,
        )
        if smooth and jumps:  # as in StepToKinks: a length that moved with a switch would do so more and more
            tnext = jax.lax.stop_gradient(tnext) + (tprev - jax.lax.stop_gradient(tprev))
        attempt = self._describe_step(state, y, info)
        proposed = NextStep(keep, tprev, tnext, controller_state, jnp.asarray(False))
        hybrid, following = self.switching.detect(hybrid, attempt, proposed, self.args)
        keep, tprev, tnext, controller_state, exact = following
        tprev = jnp.minimum(tprev, self.t1)
        # A step that would almost reach the end goes there, because the last one would have no length; after a
        # rejection only half way, or the same step would be tried again.
        almost = self.t1 - CLOSE_TO_END * float(jnp.finfo(self.t1.dtype).eps) * jnp.abs(self.t1)
        end = jnp.where(keep, self.t1, tprev + 0.5 * (self.t1 - tprev))
        y, solver_state = select_tree(keep, (y, solver_state), (state.y, state.solver_state))
        result = RESULTS.where(keep, step_result, RESULTS.successful)
        share = (tprev - self.t0) / (self.t1 - self.t0)
        state = dataclasses.replace(
            state,
            y=y,
            tprev=tprev,
            tnext=jnp.where((tnext > almost) & ~exact, end, tnext),
            made_jump=jnp.where(keep, made_jump, state.made_jump) if jumps else state.made_jump,
            solver_state=solver_state,
            controller_state=controller_state,
            progress_meter_state=self.progress_meter.step(state.progress_meter_state, share),
            result=RESULTS.where(result == RESULTS.successful, control_result, result),
            num_steps=state.num_steps + 1,
            num_accepted_steps=state.num_accepted_steps + jnp.where(keep, 1, 0),
        )
        return state, info, keep, hybrid, size

    def _take_step(self, state: Any, jumped: Bool[Array, ""] | bool) -> tuple[Any, ...]:
        """Takes a step of the solver, and returns what ``diffrax.AbstractSolver.step`` does."""
        t0, t1, y, solver_state = state.tprev, state.tnext, state.y, state.solver_state
        if not has_one_tableau(self.solver):
            return self.stepper.step(self.terms, t0, t1, y, self.args, solver_state, jumped)
        terms, moving, args, kept = of_moving(self.terms, y, self.args, self.output.moving)
        first, slope = solver_state
        start = first, slope[: moving.size]
        if self.stepper is self.solver:
            start, jumped = with_first_slope(self.solver, terms, t0, moving, args, (first | jumped, start[1])), False
        moved, error, info, (first, slope), result = self.stepper.step(terms, t0, t1, moving, args, start, jumped)
        y1 = jnp.concatenate([moved, kept]) if kept.size else moved
        info = {"y0": y, "y1": y1, "k": info["k"]}
        return y1, with_zeros(error, y.size), info, (first, with_zeros(slope, y.size)), result

    def _describe_step(self, state: Any, y: Float[Array, " size"], info: Any) -> Taken:
        """Returns the step from ``state`` to ``y``, for the detection of the ends of modes."""
        t0, t1 = state.tprev, state.tnext
        coarse = self.solver.interpolation_cls(t0=t0, t1=t1, **whole_info(info))
        sketch = jax.tree_util.Partial(self.output.sketch, info, coarse)
        exact = jax.tree_util.Partial(self.output.exact, self.terms, info, t0, t1, self.args)
        return Taken(t0, t1, state.y, y, sketch, exact, state.controller_state, (self.t0, self.t1))

    def again(self, output: DenseOutput, t0: Array, t1: Array, y: Array) -> Step:
        """Computes once more a step that was taken, which is cheaper than keeping its intermediate values."""
        fresh = self.solver.init(self.terms, t0, t1, y, self.args)
        _, _, info, _, _ = self.stepper.step(self.terms, t0, t1, y, self.args, fresh, True)
        info = output.info(info, self.terms, t0, t1, args=self.args, asked=jnp.asarray(True))
        within = output.interpolation(t0=t0, t1=t1, **info)
        return Step(t0, t1, y, within.evaluate, within.evaluate)


def _buffers(carry: tuple[Any, ...]) -> tuple[Any, ...]:
    """Returns the buffers in which a step writes a row, and reads none."""
    state, saved, _, _, watched, _ = carry
    return saved.vectors, state.dense_ts, state.dense_infos, () if watched is None else watched.buffers


def _keep_for_dense_output(state: Any, info: Any, keep: Bool[Array, ""]) -> Any:
    index = state.dense_save_index
    return dataclasses.replace(
        state,
        dense_ts=put(state.dense_ts, index + 1, state.tprev, keep),
        dense_infos=jax.tree.map(
            lambda array, new: put(array, index, new, keep),
            state.dense_infos,
            info,
        ),
        dense_save_index=index + jnp.where(keep, 1, 0),
    )


def by_tolerances(
    rtol: Float[Array, ""],
    atol: Float[Array, ""],
    solver: diffrax.AbstractSolver | None = None,
    norm: Callable[[PyTree], Float[Array, ""]] = optx.rms_norm,
    longest: float | None = None,
    least: Float[Array, ""] | float = LEAST_STEP,
) -> diffrax.PIDController | AbstractMultistepController:
    """Steps by the tolerances only, no longer than ``longest``, with the controller that ``solver`` needs.

    A step below ``least`` ends the solve.
    """
    if isinstance(solver, AbstractMultistep):
        return solver.controller_cls(rtol, atol, norm, dtmin=least, dtmax=longest)
    return diffrax.PIDController(rtol=rtol, atol=atol, norm=norm, dtmin=least, dtmax=longest, force_dtmin=False)


def least_step(times: Float[Array, " T"]) -> Float[Array, ""]:
    """Returns the length below which a step of a run that is saved at ``times`` ends the solve, in any unit of time."""
    span = jax.lax.stop_gradient(times[-1] - times[0])
    return jnp.maximum(LEAST_STEP * jnp.minimum(span, 1.0), jnp.finfo(times.dtype).tiny)


def to_kinks(
    controller: diffrax.AbstractAdaptiveStepSizeController, kinks: Float[Array, " kinks"]
) -> diffrax.AbstractAdaptiveStepSizeController:
    """Returns the step size controller with steps that end at kinks."""
    return StepToKinks(controller, kinks) if kinks.size else controller


def kinks_of(system: AbstractSystem) -> Float[Array, " kinks"]:
    """Returns the kink times of prescribed motions, and of laws and forces.

    At the kinks of motions the field is continuous, so that moving the end of a step there moves nothing, and they
    have no derivatives. One that coincides with a kink of a law or a force is left out, which would share its
    derivative.
    """
    smooth, driving = jax.lax.stop_gradient(system.motion_kinks()), system.driving_kinks()
    shared = jnp.any(smooth[:, None] == jax.lax.stop_gradient(driving)[None], axis=1)
    return jnp.concatenate([jnp.where(shared, jnp.inf, smooth), driving])
