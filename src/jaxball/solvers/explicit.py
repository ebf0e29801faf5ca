"""The derivatives of a step of an explicit Runge–Kutta method in reverse mode, from the last stage to the first."""

from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .wrapping import AbstractWrappingSolver


def pulled_back_by_stages(solver: Any) -> Any:
    """The solver, if it is an explicit Runge–Kutta method or wraps one, with that as a :class:`PulledBackByStages`."""
    if isinstance(solver, AbstractWrappingSolver):
        return eqx.tree_at(lambda s: s.solver, solver, pulled_back_by_stages(solver.solver))
    if isinstance(solver, diffrax.AbstractERK) and solver.scan_kind is None:
        return PulledBackByStages(eqx.tree_at(lambda s: s.scan_kind, solver, "lax", is_leaf=lambda x: x is None))
    return solver


class PulledBackByStages(AbstractWrappingSolver):
    """An explicit method ``solver`` for an ``ODETerm``, whose steps are differentiated in reverse mode only.

    Its slopes are kept, and the field is evaluated once more at each stage, together with its derivatives.
    """

    solver: Any

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        slope = None if solver_state is None else solver_state[1]
        terms, fixed = eqx.partition(terms, eqx.is_array)
        leaves, structure = jax.tree.flatten((terms, t0, t1, y0, args, slope))

        def forward(leaves):
            terms, t0, t1, y0, args, slope = structure.unflatten(leaves)
            state = None if slope is None else (False, slope)
            y1, error, info, state, _ = self.solver.step(eqx.combine(terms, fixed), t0, t1, y0, args, state, False)
            return y1, error, info["k"], None if state is None else state[1]

        def kept(leaves):
            marks = [() if x.perturbed else None for x in leaves]
            leaves = [x.value for x in leaves]
            results = forward(leaves)
            return results, (leaves, results[2], marks)

        def backward(kept, cotangents):
            leaves, k, marks = kept
            terms, *given = structure.unflatten(leaves)
            _, *varies = structure.unflatten([mark is not None for mark in marks])
            results = _pulled_back(self.solver.tableau, eqx.combine(terms, fixed), given, k, cotangents, varies)
            unchanged = [None] * len(jax.tree.leaves(terms))
            return (unchanged + jax.tree.leaves(results, is_leaf=lambda x: x is None),)

        step = jax.custom_vjp(forward)
        step.defvjp(kept, backward, symbolic_zeros=True)
        y1, error, k, last = step(leaves)
        state = None if slope is None else (False, last)
        return y1, error, {"y0": y0, "y1": y1, "k": k}, state, diffrax.RESULTS.successful


def _dense(x: Any) -> Array:
    if isinstance(x, jax.custom_derivatives.SymbolicZero):
        return jnp.zeros(x.aval.shape, x.aval.dtype)
    return x


def _pulled_back(tableau, terms, given, k, cotangents, varies):
    t0, t1, y0, args, slope = given
    of_t0, of_t1, _, of_args, _ = varies
    timed = of_t0 or of_t1
    y1, error, slopes, last = cotangents
    s, begins = k.shape[0], slope is not None
    c = np.append(0.0 if tableau.c1 is None else tableau.c1, tableau.c)
    a = _square(tableau)
    of_k, of_y = _dense(slopes), _dense(y1)
    for weights, cotangent in ((tableau.b_sol, y1), (tableau.b_error, error)):
        if not isinstance(cotangent, jax.custom_derivatives.SymbolicZero):
            of_k = of_k + jnp.asarray(weights, k.dtype)[:, None] * cotangent
    of_last = jnp.zeros_like(y0) if last is None else _dense(last)
    of_args = jax.tree.leaves(of_args)
    flat, structure = jax.tree.flatten(args)
    changing = [x for x, p in zip(flat, of_args, strict=True) if p]
    control = terms.contr(t0, t1)

    def stage(carry, at):
        of_k, of_y, summed = carry
        i, row, node = at

        def slope_and_increment(y, moving):
            t, control, changing = moving
            rest = iter(changing)
            own = structure.unflatten([next(rest) if p else x for x, p in zip(flat, of_args, strict=True)])
            slope = terms.vf(t, y, own)
            return slope, terms.prod(slope, control)

        y = y0 + jnp.sum(row[:, None] * k, axis=0)
        times = jnp.where(node == 1, t1, t0 + node * (t1 - t0)), control
        cotangents = jnp.where(i == s - 1, of_last, 0.0), of_k[i]
        if timed:
            _, pull = jax.vjp(slope_and_increment, y, (*times, changing))
            at_y, (moved, of_control, own) = pull(cotangents)
            own = node * moved, moved, of_control, own
        else:
            _, pull = jax.vjp(lambda y, changing: slope_and_increment(y, (*times, changing)), y, changing)
            at_y, own = pull(cotangents)
            own = (), (), (), own
        summed = jax.tree.map(jnp.add, summed, own)
        return (of_k + row[:, None] * at_y, of_y + at_y, summed), None

    stages = np.arange(s)[::-1][: s - begins]
    summed = jax.tree.map(jnp.zeros_like, ((t0, t0, control) if timed else ((), (), ())) + (changing,))
    rows = jnp.asarray(stages), jnp.asarray(a[stages], k.dtype), jnp.asarray(c[stages], t0.dtype)
    (of_k, of_y, (later, moved, of_control, own)), _ = jax.lax.scan(stage, (of_k, of_y, summed), rows)
    of_slope, of_t0, of_t1 = None, None, None
    if begins:
        _, pull = jax.vjp(terms.prod, slope, control)
        of_slope, first = pull(of_k[0])
        of_control = of_control + first if timed else of_control
    if timed:
        _, pull = jax.vjp(terms.contr, t0, t1)
        by_t0, by_t1 = pull(of_control)
        of_t0, of_t1 = by_t0 + moved - later, by_t1 + later
    own = iter(own)
    return of_t0, of_t1, of_y, [next(own) if p else None for p in of_args], of_slope


def _square(tableau):
    s = tableau.num_stages
    a = np.zeros((s, s))
    for i, row in enumerate(tableau.a_lower):
        a[i + 1, : i + 1] = row
    return a
