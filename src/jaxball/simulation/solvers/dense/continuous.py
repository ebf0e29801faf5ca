"""Continuous extensions of explicit Runge–Kutta methods: states within a step nearly as accurate as at its ends.

The interpolants of diffrax's methods are less accurate than their steps: that of ``Dopri8``, of order 8, is of order 5.
A polynomial with the values and slopes at the ends of a step, and with slopes at points between that are computed from
another polynomial, has one order more than that one (Enright, Jackson, Nørsett & Thomsen, Interpolants for Runge–Kutta
formulas, ACM Transactions on Mathematical Software 12 (1986) 193–218). So the field is evaluated a few more times, but
only in steps within which a state is needed.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.polynomial import legendre

from ....interface.compat import unvmap_any
from ....numerics.arrays import default_dtype
from ....numerics.vectors import polynomial
from ....programs.batches import fill_vectors
from ..interpolation import CollocationPolynomial
from ..moving import of_moving, with_zeros
from ..stages import combine
from ..tableau import integrals
from ..wrapping import Projected, ProjectedSteps

# The orders of diffrax's interpolants; for other methods, of the cubic with the values and slopes at the ends.
ORDERS: dict[Any, int] = {
    diffrax.Dopri8.interpolation_cls: 5,
    diffrax.Dopri5.interpolation_cls: 4,
    diffrax.Tsit5.interpolation_cls: 4,
}
CUBIC = 3
# A local error of order 8 is that by which steps of Dopri8 are controlled, and no larger than what all steps add up to.
HIGHEST_DENSE = 7
# More than any interpolation of diffrax has, and what is left of those that it does not have.
MOST_POWERS, NO_POWER = 10, 1e-7
# As many fractions of a step at which a polynomial determines it: Chebyshev's.
PLACES = (1 - np.cos(np.pi * (np.arange(MOST_POWERS) + 0.5) / MOST_POWERS)) / 2


class ContinuousMethod(NamedTuple):
    """The coefficients that an explicit method with s stages needs for the states within its steps.

    - ``nodes``: where the field is evaluated again, in units of the step.
    - ``rows``: these take slopes, those of the stages and then those at nodes before, to the increments at the nodes.
    - ``expansion``: what takes all slopes to the coefficients in P̃ₖ of the slope of the polynomial.
    """

    nodes: np.ndarray
    rows: Float[Array | np.ndarray, "nodes slopes"]
    expansion: np.ndarray

    def coefficients(
        self,
        increment: Callable[[Float[Array, ""], Float[Array, " n"]], Float[Array, " n"]],
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        y0: Float[Array, " n"],
        k: Float[Array, "s n"],
    ) -> Float[Array, "degree n"]:
        """Computes the polynomial of a step from ``increment(t, y)``, h times the field; ``k`` are the increments at
        the stages.
        """
        stages, dtype = k.shape[0], k.dtype
        nodes, rows = jnp.asarray(self.nodes, t0.dtype), jnp.asarray(self.rows, dtype)

        def stage(K: Array, entry: tuple[Array, Array, Array]) -> tuple[Array, None]:
            place, node, row = entry
            # The row is 0 for slopes that are not known yet.
            y = y0 + jnp.sum(row[:, None] * K, axis=0)
            return K.at[place].set(increment(jnp.minimum(t0 + node * (t1 - t0), t1), y)), None

        K = jnp.concatenate([k, jnp.zeros((nodes.size, *y0.shape), dtype)])
        K, _ = jax.lax.scan(stage, K, (stages + jnp.arange(nodes.size), nodes, rows))
        return combine(self.expansion, K)

    def straight(self, k: Float[Array, "s n"]) -> Float[Array, "degree n"]:
        """Returns the straight line from one end of a step to the other, for a step within which no state is needed."""
        line = combine(self.expansion[:1, : k.shape[0]], k)
        return jnp.concatenate([line, jnp.zeros((self.expansion.shape[0] - 1, *line.shape[1:]), line.dtype)])


class DenseOutput(NamedTuple):
    """The dense output of a solver: by a continuous method, or else by its own interpolation.

    - ``weights``: of each stage of an explicit method, the polynomial by which its own interpolation weighs it, in
      powers of the fraction of the step; None of another method.
    - ``moving``: how many entries of the vectors, the first ones, change within steps; None if all may.
    """

    method: ContinuousMethod | None
    interpolation: Callable[..., diffrax.AbstractLocalInterpolation]
    weights: np.ndarray | None = None
    moving: int | None = None

    @classmethod
    def of(cls, solver: Any) -> "DenseOutput":
        """Returns the dense output of a solver."""
        if isinstance(solver, Projected):
            inner = cls.of(solver.solver)
            return inner._replace(interpolation=solver.projecting(inner.interpolation), weights=None)
        if isinstance(solver, ProjectedSteps):
            return cls.of(solver.solver)
        method = continuous(solver)
        interpolation = solver.interpolation_cls if method is None else CollocationPolynomial
        return cls(method, interpolation, _stage_weights(solver, default_dtype()) if has_one_tableau(solver) else None)

    def info(
        self, info: Any, terms: Any, t0: Float[Array, ""], t1: Float[Array, ""], args: Any, asked: Bool[Array, ""]
    ) -> Any:
        """Returns the data of the interpolation of a step, from the solver's ``info``, accurate within it where
        ``asked``.
        """
        if self.method is None:
            return whole_info(info)
        method, y0, k = self.method, info["y0"], info["k"]
        terms, start, args, _ = of_moving(terms, y0, args, k.shape[1])

        def curve() -> Array:
            control = terms.contr(t0, t1)
            return method.coefficients(lambda t, y: terms.vf_prod(t, y, args, control), t0, t1, start, k)

        # Of rows side by side a condition would compute both branches: so all are computed if any of them is asked for,
        # and none otherwise.
        coefficients = jax.lax.cond(unvmap_any(asked), curve, lambda: method.straight(k))
        return {"y0": y0, "coefficients": with_zeros(coefficients, y0.size)}

    def exact(
        self, terms: Any, info: Any, t0: Float[Array, ""], t1: Float[Array, ""], args: Any, asked: Bool[Array, ""]
    ) -> Callable[[Float[Array, " m"]], Float[Array, "m n"]]:
        """Returns the vectors at times within a step as a function, as accurate as the step where ``asked``."""
        info = self.info(info, terms, t0, t1, args=args, asked=asked)
        if self.interpolation is not CollocationPolynomial or self.moving is None:
            return functools.partial(fill_vectors, self.interpolation(t0=t0, t1=t1, **info).evaluate)
        y0, coefficients = info["y0"], info["coefficients"]
        moving = CollocationPolynomial(t0, t1, y0[: self.moving], coefficients[:, : self.moving])
        return lambda times: self._with_still(fill_vectors(moving.evaluate, times), y0)

    def sketch(
        self, info: Any, own: diffrax.AbstractLocalInterpolation, times: Float[Array, " m"]
    ) -> Float[Array, "m n"]:
        """Evaluates the vectors at a few times within a step by the method's ``own`` interpolation, which needs no
        evaluation of the field.

        The sum over the stages is written out, because it is short in vectors, one of the times in each lane.
        """
        if self.weights is None:
            return fill_vectors(own.evaluate, times)
        y0, k = info["y0"], info["k"]
        width = own.t1 - own.t0
        fractions = ((times - own.t0) / jnp.where(width == 0, 1.0, width)).astype(y0.dtype)
        moving = jnp.broadcast_to(y0[: self.moving], (times.size, *y0[: self.moving].shape))
        for stage, powers in enumerate(self.weights):
            if np.any(powers):
                moving += (fractions * polynomial(powers, fractions))[:, None] * k[stage, : self.moving][None]
        return self._with_still(moving, y0)

    def _with_still(self, moving: Float[Array, "m moving"], y0: Float[Array, " n"]) -> Float[Array, "m n"]:
        """Returns vectors with the entries that do not change in a step from ``y0``."""
        still = y0[moving.shape[1] :]
        return jnp.concatenate([moving, jnp.broadcast_to(still, (len(moving), still.size))], axis=1)

    def room(self, infos: Any, steps: int) -> Any:
        """Makes room for the interpolation data of ``steps`` steps, from the room for the solver's ``infos``."""
        if self.method is None:
            return infos
        y0, degree = infos["y0"], len(self.method.expansion)
        return {"y0": y0, "coefficients": jnp.full((steps, degree, *y0.shape[1:]), jnp.inf, y0.dtype)}


def whole_info(info: Any) -> Any:
    """Returns what a method's own interpolation is made of, with the slopes of all numbers: a step has only those of
    the ones that move.
    """
    if "k" not in info or jnp.ndim(info["k"]) != 2:
        return info
    return {**info, "k": with_zeros(info["k"], info["y0"].size)}


def has_one_tableau(solver: diffrax.AbstractSolver) -> bool:
    """Returns whether this is an explicit method whose last stage is the slope at the end."""
    tableau = getattr(solver, "tableau", None)  # a wrapped method may lack it
    if not isinstance(solver, diffrax.AbstractERK) or not isinstance(tableau, diffrax.ButcherTableau):
        return False
    return tableau.fsal and tableau.ssal


def continuous(solver: Any) -> ContinuousMethod | None:
    """Returns the continuous extension of a method; None if its own interpolation is as good, or if it is not
    explicit.
    """
    if not has_one_tableau(solver):
        return None
    order = min(solver.order(diffrax.ODETerm(lambda t, y, args: y)), HIGHEST_DENSE)
    base_order = ORDERS.get(solver.interpolation_cls, CUBIC)
    if order <= base_order:
        return None
    method = _make_extension(solver.tableau, base_order, order)
    if base_order == CUBIC:
        return method
    # The states at the first nodes come from the method's own interpolation, of the order ``base_order``, not from the
    # cubic.
    nodes, degree = method.nodes[: _count(base_order)], MOST_POWERS - 1
    from_places = legendre.legvander(2 * nodes - 1, degree) @ np.linalg.inv(legendre.legvander(2 * PLACES - 1, degree))
    method.rows[: _count(base_order), : solver.tableau.num_stages] = from_places @ _own_weights(solver, default_dtype())
    return method


def _make_extension(tableau: diffrax.ButcherTableau, base_order: int, order: int) -> ContinuousMethod:
    """Makes the extension, in rounds that each gain an order, starting from the cubic."""
    stages, counts = tableau.num_stages, [_count(q) for q in range(base_order, order)]
    slopes = np.eye(stages + sum(counts))
    step = tableau.b_sol @ slopes[:stages]
    nodes, rows = np.zeros(0), np.zeros((0, len(slopes)))
    expansion = _through(np.array([0.0, 1.0]), slopes[[0, stages - 1]], step)
    for count in counts:
        new = _nodes(count)
        places, at_nodes = np.concatenate([[0.0], new, [1.0]]), stages + nodes.size + np.arange(count)
        rows = np.concatenate([rows, integrals(new, len(expansion)) @ expansion])
        nodes = np.concatenate([nodes, new])
        expansion = _through(places, slopes[[0, *at_nodes, stages - 1]], step)
    return ContinuousMethod(nodes, rows, expansion)


def _count(order: int) -> int:
    """Returns the number of intermediate slopes needed for a polynomial of one order more."""
    return order - 2


def _through(places: np.ndarray, slopes: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Computes the coefficients in P̃ₖ of the slope of a polynomial, which is ``slopes`` at places; its integral is
    ``step``.
    """
    conditions = legendre.legvander(2 * places - 1, len(places))
    whole = np.eye(1, len(places) + 1)  # ∫₀¹ P̃ₖ = 0 for k > 0
    coefficients = np.linalg.solve(np.concatenate([conditions, whole]), np.concatenate([slopes, step[None]]))
    return np.concatenate([step[None], coefficients[1:]])


def _nodes(count: int) -> np.ndarray:
    """Returns all inner Gauss–Lobatto nodes except one: to leading order the polynomial has the right slope at that one
    too.
    """
    inner = np.real(legendre.Legendre.basis(count + 2).deriv().roots())
    return np.delete(0.5 + 0.5 * np.sort(inner), count // 2)


@functools.cache
def _own_weights(solver: Any, dtype: Any) -> np.ndarray:
    """Computes the weights of the stages in a method's own interpolation, which is linear in them, at ``PLACES``.

    ``dtype``: the type of numbers in which JAX computes.
    """

    def evaluate(t0: Array, t1: Array, y1: Array, k: Array, places: Array) -> Array:
        interpolation = solver.interpolation_cls(t0=t0, t1=t1, y0=jnp.zeros_like(y1), y1=y1, k=k)
        return jax.vmap(interpolation.evaluate)(places)

    ends, each_stage = np.array([0, 1], dtype), np.eye(solver.tableau.num_stages, dtype=dtype)
    numbers = *ends, solver.tableau.b_sol.astype(dtype), each_stage, PLACES.astype(dtype)
    # A program that is compiled here gives numbers within a trace as well. By `jax.ensure_compile_time_eval` each
    # operation would be a program of its own: some twenty, and half a second.
    return np.asarray(jax.jit(evaluate).lower(*numbers).compile()(*numbers), np.float64)


def _stage_weights(solver: Any, dtype: Any) -> np.ndarray:
    """Computes the polynomials of ``_own_weights``, divided by the fraction of the step, one for each stage."""
    weights, terms = _own_weights(solver, dtype) / PLACES[:, None], np.vander(PLACES, increasing=True)
    powers = np.linalg.solve(terms, weights)
    matters = abs(powers) > NO_POWER * np.max(abs(powers))
    count = 1 + int(np.max(np.nonzero(np.any(matters, axis=1))))
    # Once more, without the powers that there are not, because rounding grows with their number.
    powers = np.linalg.lstsq(terms[:, :count], weights, rcond=None)[0]
    return np.where(matters[:count], powers, 0.0).T
