"""The derivatives of a step of an explicit Runge–Kutta method in reverse mode, from its last stage to its first.

The loop of a solve wraps such a method in it, where it is to have reverse mode.
"""

import functools
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...interface.compat import is_traced
from ...programs.derivatives.reverse_rules import CarryOut, add_arrays, choose, or_zeros, replace_chosen
from .wrapping import AbstractWrappingSolver


def with_stages_pulled_back(solver: Any, carry_out: CarryOut) -> Any:
    """Returns the solver, if it is an explicit Runge–Kutta method, or wraps one, as a :class:`StagesPulledBack`."""
    if isinstance(solver, AbstractWrappingSolver):
        return eqx.tree_at(lambda s: s.solver, solver, with_stages_pulled_back(solver.solver, carry_out))
    if not isinstance(solver, diffrax.AbstractERK) or not isinstance(solver.tableau, diffrax.ButcherTableau):
        return solver
    return StagesPulledBack(eqx.tree_at(lambda s: s.scan_kind, solver, "lax", is_leaf=lambda x: x is None), carry_out)


def depends_on_arguments_alone(terms: Any, t: Array, y: Array, args: Any) -> bool:
    """Returns whether the field is a function of its arguments, and not also of traced numbers of a function
    around it.
    """
    arrays, others = eqx.partition(terms, eqx.is_array)

    def field(arrays: Any, t: Array, y: Array, args: Any) -> Any:
        return eqx.combine(arrays, others).vf(t, y, args)

    return not any(map(is_traced, jax.make_jaxpr(field)(arrays, t, y, args).consts))


class StagesPulledBack(AbstractWrappingSolver):
    """The explicit method ``solver``, for reverse mode only.

    - ``carry_out``: carries out a step, and pulls it back. There, arguments of the field may be given in another form.
    """

    solver: Any
    carry_out: CarryOut = eqx.field(static=True)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        arrays, others = eqx.partition(terms, eqx.is_array)
        slope, fresh = None, None
        if solver_state is not None:
            first, slope = solver_state
            fresh = jnp.asarray(first | made_jump)

        def step(operands: Any) -> list[Array]:
            arrays, t0, t1, y0, args, slope, fresh = operands
            state, terms = None, eqx.combine(arrays, others)
            if slope is not None:
                state = with_first_slope(self.solver, terms, t0, y0, args, (fresh, slope))
            y1, error, info, state, _ = self.solver.step(terms, t0, t1, y0, args, state, False)
            return [y1, error, info["k"]] + ([] if state is None else [state[1]])

        def pull(residuals: Any, cotangents: list[Array | None], varies: Any) -> Any:
            (arrays, t0, t1, y0, args, slope, fresh), (_, _, k, *_) = residuals
            _, of_t0, of_t1, _, of_args, _, _ = varies
            begun = eqx.combine(arrays, others), t0, t1, y0, args, slope, fresh
            stages = _Stages(self.solver.tableau, *begun, k, of_t0 or of_t1, of_args)
            # Of a rejected step cotangents are 0, and its stages may not be finite: 0 times those is not 0.
            counts = functools.reduce(jnp.logical_or, (jnp.any(x != 0) for x in cotangents if x is not None), False)
            input_cotangents = jax.tree.map(
                lambda x: jnp.where(counts, x, jnp.zeros_like(x)), stages.pull_back(*cotangents)
            )
            # Numbers in the terms have no cotangents: ``depends_on_arguments_alone`` has made sure that the field does
            # not need them.
            return jax.tree.map(lambda _: None, arrays), *input_cotangents, None

        y1, error, k, *last = self.carry_out(step, pull, (arrays, t0, t1, y0, args, slope, fresh))
        state = (False, last[0]) if last else None
        return y1, error, {"y0": y0, "y1": y1, "k": k}, state, diffrax.RESULTS.successful


def with_first_slope(solver: Any, terms: Any, t: Array, y: Array, args: Any, state: tuple[Any, Array]) -> Any:
    """Returns the state of a method that begins with the last slope of the step before, with that slope where it is
    ``fresh``.

    The method can evaluate it as well, but then steps differ in how many stages they have.
    """
    fresh, slope = state
    return jnp.asarray(False), jax.lax.cond(fresh, lambda: solver.func(terms, t, y, args), lambda: slope)


class _Stages(NamedTuple):
    """The stages of a step, by their increments ``k``; whether its ends vary, and which arguments of the field."""

    tableau: diffrax.ButcherTableau
    terms: Any
    t0: Float[Array, ""]
    t1: Float[Array, ""]
    y0: Float[Array, " n"]
    args: Any
    slope: Float[Array, " n"] | None
    fresh: Bool[Array, ""] | None
    k: Float[Array, "stages n"]
    timed: bool
    of_args: Any

    def pull_back(self, y1: Any, error: Any, k: Any, last: Any = None) -> tuple[Any, ...]:
        """Computes the cotangents of t0, t1, y0, args and slope, from those of the results of a step."""
        of_k, of_y, of_last = or_zeros(k, self.k), or_zeros(y1, self.y0), or_zeros(last, self.y0)
        for weights, cotangent in ((self.tableau.b_sol, y1), (self.tableau.b_error, error)):
            if cotangent is not None:
                of_k = of_k + jnp.asarray(weights, self.k.dtype)[:, None] * cotangent[None]
        control, (matrix, nodes) = self.terms.contr(self.t0, self.t1), self.coefficients()
        times = [self.t0, self.t0, control] if self.timed else []
        count = self.k.shape[0]

        def back(turn: Array, carry: tuple[Array, Array, list[Array]]) -> tuple[Array, Array, list[Array]]:
            i, (of_k, of_y, summed) = count - 1 - turn, carry
            cotangents = jnp.where(i == count - 1, of_last, 0.0), of_k[i]
            of_stage, new = self.pull_back_stage(matrix[i], nodes[i], control, cotangents)
            return of_k + matrix[i][:, None] * of_stage[None], of_y + of_stage, add_arrays(summed, new)

        start = of_k, of_y, [jnp.zeros_like(x) for x in [*times, *choose(jax.tree.leaves(self.args), self.which)]]
        first_stage = (
            jnp.asarray(0) if self.fresh is None else jnp.where(self.fresh, 0, 1)
        )  # stages that are not evaluated
        of_k, of_y, summed = jax.lax.fori_loop(0, count - first_stage, back, start)
        times, of_args = summed[: len(times)], summed[len(times) :]
        of_slope = None
        if self.slope is not None and self.fresh is not None:
            of_slope, of_control = jax.vjp(self.terms.prod, self.slope, control)[1](of_k[0])
            of_slope = jnp.where(self.fresh, 0.0, of_slope)
            times = [*times[:2], times[2] + jnp.where(self.fresh, 0.0, of_control)] if times else times
        leaves = replace_chosen([None] * len(self.which), self.which, of_args)
        return *self.of_times(times), of_y, jax.tree.structure(self.args).unflatten(leaves), of_slope

    @property
    def which(self) -> list[bool]:
        """Which arrays among the arguments of the field vary."""
        return jax.tree.leaves(self.of_args)

    def coefficients(self) -> tuple[Array, Array]:
        """Returns the matrix of the method, and its nodes."""
        matrix = np.zeros((self.tableau.num_stages,) * 2)
        for i, row in enumerate(self.tableau.a_lower):
            matrix[i + 1, : i + 1] = row
        nodes = np.append(0.0 if self.tableau.c1 is None else self.tableau.c1, self.tableau.c)
        return jnp.asarray(matrix, self.k.dtype), jnp.asarray(nodes, self.t0.dtype)

    def pull_back_stage(self, row: Array, node: Array, control: Any, cotangents: Any) -> tuple[Array, list[Array]]:
        """Computes cotangents of the state at a stage; those of its time, times its node, of the control, of args."""
        leaves, structure = jax.tree.flatten(self.args)
        y = self.y0 + jnp.sum(row[:, None] * self.k, axis=0)
        # As in the step itself: rounding must not lead past its end, which may be a kink.
        t = jnp.where(node == 1, self.t1, self.t0 + node * (self.t1 - self.t0))

        def slope_and_increment(y: Array, of_args: list[Array], t: Array = t, control: Any = control) -> Any:
            slope = self.terms.vf(t, y, structure.unflatten(replace_chosen(leaves, self.which, of_args)))
            return slope, self.terms.prod(slope, control)

        operands = (y, choose(leaves, self.which), *((t, control) if self.timed else ()))
        of_y, of_args, *times = jax.vjp(slope_and_increment, *operands)[1](cotangents)
        return of_y, [*((node * times[0], *times) if times else ()), *of_args]

    def of_times(self, times: list[Array]) -> tuple[Any, Any]:
        """Computes the cotangents of the ends of the step."""
        if not times:
            return None, None
        later, all_times, of_control = times
        of_t0, of_t1 = jax.vjp(self.terms.contr, self.t0, self.t1)[1](of_control)
        return of_t0 + all_times - later, of_t1 + later
