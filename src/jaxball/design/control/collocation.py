"""Direct collocation: an optimal control problem as equations for finitely many unknowns.

On each interval of a mesh the state is a polynomial of degree s that fulfils the differential equation at the s nodes
of Gauss, where the controls have their values (Betts, Practical Methods for Optimal Control, chapter 4; Hairer,
Lubich & Wanner, Geometric Numerical Integration, section II.1.3: states have order 2s at the ends of intervals). The
conditions of Karush, Kuhn and Tucker, that all derivatives of the Lagrangian vanish, are equations
F(y, λ) = 0 with as many unknowns: states, controls and multipliers. Their Jacobian is sparse, symmetric and exact.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse
from jaxtyping import Array, Float

from ...solvers.tableau import Tableau, gauss
from ..equations import AbstractEquations
from .problem import AbstractControlProblem

# So many nodes are looked at by one call of the compiled program, which is the same for each mesh.
CHUNK = 32

Vary = Callable[[Any, Float[Array, ""]], AbstractControlProblem]


def as_it_is(problem: AbstractControlProblem, parameter: Float[Array, ""]) -> AbstractControlProblem:
    """A problem that does not depend on λ."""
    return problem


class Unknowns(NamedTuple):
    """The parts of y.

    - ``knots``: states at the ends of the N intervals; ``nodes``, ``controls``: states and controls at the nodes.
    - ``at_start``, ``at_nodes``, ``at_knots``, ``at_end``: multipliers of the initial state, of the differential
      equation at the nodes, of the states at the ends of the intervals, and of the end conditions.
    """

    knots: Float[np.ndarray, "N_plus_one n"]
    nodes: Float[np.ndarray, "N s n"]
    controls: Float[np.ndarray, "N s m"]
    at_start: Float[np.ndarray, " n"]
    at_nodes: Float[np.ndarray, "N s n"]
    at_knots: Float[np.ndarray, "N n"]
    at_end: Float[np.ndarray, " k"]


class Collocation(AbstractEquations):
    """The equations for the problem vary(problem, λ) on a mesh, with s nodes an interval.

    ``vary`` is kept as it is, so pass the same one each time: a new lambda compiles anew.
    """

    def __init__(
        self,
        problem: Any,
        mesh: Float[np.ndarray, " N_plus_one"],
        stages: int = 3,
        vary: Vary = as_it_is,
    ):
        self.problem, self.mesh, self.stages, self.vary = problem, mesh, stages, vary
        self.tableau: Tableau = gauss(stages)
        self._last: tuple[np.ndarray, float, _Looked, _Looked] | None = None
        n, ends = (shape.size for shape in jax.eval_shape(functools.partial(_sizes, vary), problem))
        N, m = len(mesh) - 1, vary(problem, jnp.zeros(())).controls
        shapes: list[Any] = [(N + 1, n), (N, stages, n), (N, stages, m), (n,), (N, stages, n), (N, n), (ends,)]
        self.shapes = Unknowns(*shapes)
        places = np.split(np.arange(self.size), np.cumsum([np.prod(shape) for shape in self.shapes])[:-1])
        self.places = Unknowns(*(at.reshape(shape) for at, shape in zip(places, self.shapes, strict=True)))

    @property
    def size(self) -> int:
        """How many unknowns there are."""
        return int(sum(np.prod(shape) for shape in self.shapes))

    @property
    def steps(self) -> Float[np.ndarray, " N"]:
        """The lengths of the intervals."""
        return np.diff(self.mesh)

    @property
    def times(self) -> Float[np.ndarray, "N s"]:
        """The nodes."""
        return self.mesh[:-1, None] + self.steps[:, None] * self.tableau.c

    def parts(self, y: Float[np.ndarray, " size"]) -> Unknowns:
        """The parts of y."""
        return Unknowns(*(y[at] for at in self.places))

    def joined(self, parts: Unknowns) -> Float[np.ndarray, " size"]:
        """The inverse of :meth:`parts`."""
        return np.concatenate([np.ravel(part) for part in parts])

    @property
    def unconstrained(self) -> int:
        """How many of the unknowns, the first ones, are states and controls; the others are multipliers."""
        return int(sum(np.prod(shape) for shape in self.shapes[:3]))

    def residual(self, y, parameter):
        node, end = self._looked_at(y, parameter)
        first = self.linear @ y
        first[self.places.at_start] -= _initial(self.vary, self.problem, jnp.asarray(parameter))[0]
        np.add.at(first, self._node_places, node.gradient)
        np.add.at(first, self._end_places, end.gradient)
        return first

    def jacobian(self, y, parameter):
        node, end = self._looked_at(y, parameter)
        at_nodes = _scattered(self._node_places, node.hessian, self.size)
        at_end = _scattered(self._end_places[None], end.hessian[None], self.size)
        by_parameter = np.zeros(self.size)
        np.add.at(by_parameter, self._node_places, node.by_parameter)
        np.add.at(by_parameter, self._end_places, end.by_parameter)
        by_parameter[self.places.at_start] -= _initial(self.vary, self.problem, jnp.asarray(parameter))[1]
        return self.linear + at_nodes + at_end, by_parameter

    def cost(self, y: Float[np.ndarray, " size"], parameter: float) -> float:
        """The mean of the running cost, by the weights of Gauss."""
        parts = self.parts(y)
        return float(np.sum(self._node(parts._replace(at_nodes=0 * parts.at_nodes), parameter).value))

    @functools.cached_property
    def linear(self) -> scipy.sparse.sparray:
        """The second derivatives of the Lagrangian that are the same everywhere: coefficients of linear equations."""
        s, n, N = self.stages, self.shapes.at_start[0], len(self.steps)
        # Rows: h F = A⁻¹ (X − x_k) at the nodes, and x_{k+1} = x_k + b·A⁻¹ (X − x_k). Columns: x_k, X, x_{k+1}.
        slopes, ends = self.tableau.A_inverse, self.tableau.b @ self.tableau.A_inverse
        at_nodes = np.column_stack([np.sum(slopes, axis=1), -slopes, np.zeros(s)])
        block = np.vstack([at_nodes, [1 - np.sum(ends), *ends, -1.0]])
        states = self.places
        columns = np.concatenate([states.knots[:-1, None], states.nodes, states.knots[1:, None]], axis=1)
        rows = np.concatenate([states.at_nodes, states.at_knots[:, None]], axis=1)
        shape = (N, s + 1, s + 2, n)
        data = np.broadcast_to(block[None, :, :, None], shape)
        row, column = np.broadcast_to(rows[:, :, None], shape), np.broadcast_to(columns[:, None], shape)
        entries = [(data, row, column), (np.ones(n), states.at_start, states.knots[0])]
        data, row, column = (np.concatenate([np.ravel(x) for x in part]) for part in zip(*entries, strict=True))
        lower = scipy.sparse.csr_array((data, (row, column)), shape=(self.size, self.size))
        return lower + lower.T

    @functools.cached_property
    def _node_places(self) -> np.ndarray:
        """Where X, u and the multiplier of each node are in y."""
        parts = (self.places.nodes, self.places.controls, self.places.at_nodes)
        return np.concatenate([part.reshape(-1, part.shape[-1]) for part in parts], axis=1)

    @functools.cached_property
    def _end_places(self) -> np.ndarray:
        return np.concatenate([self.places.knots[-1], self.places.at_end])

    def _looked_at(self, y: np.ndarray, parameter: float) -> tuple["_Looked", "_Looked"]:
        """The terms of the nodes and of the end; kept, because residual and Jacobian are wanted at the same point."""
        if self._last is None or self._last[1] != parameter or not np.array_equal(self._last[0], y):
            parts = self.parts(y)
            self._last = (y.copy(), parameter, self._node(parts, parameter), self._end(parts, parameter))
        return self._last[2:]

    def _node(self, parts: Unknowns, parameter: float) -> "_Looked":
        """The nodes' terms of the Lagrangian."""
        local = np.concatenate([parts.nodes, parts.controls, parts.at_nodes], axis=2)
        local = local.reshape(-1, local.shape[-1])
        h = np.broadcast_to(self.steps[:, None], self.times.shape)
        weights = h * self.tableau.b / (self.mesh[-1] - self.mesh[0])
        at = jnp.asarray(parameter)
        function = functools.partial(_nodes, self.vary, self.shapes.at_start[0], self.problem, at)
        return _Looked(*in_chunks(function, np.ravel(self.times), np.ravel(weights), np.ravel(h), local))

    def _end(self, parts: Unknowns, parameter: float) -> "_Looked":
        """The end conditions' term of the Lagrangian."""
        local = jnp.asarray(np.concatenate([parts.knots[-1], parts.at_end]))
        return _Looked(
            *map(np.asarray, _ends(self.vary, self.shapes.at_start[0], self.problem, jnp.asarray(parameter), local))
        )


def in_chunks(function: Callable[..., Any], *rows: np.ndarray) -> Any:
    """A function of many rows, called with ``CHUNK`` of them at a time; the last ones are repeated to fill a chunk."""
    found = []
    for at in range(0, len(rows[0]), CHUNK):
        few = [row[at : at + CHUNK] for row in rows]
        count = len(few[0])
        filled = [np.concatenate([row, np.repeat(row[-1:], CHUNK - count, axis=0)]) for row in few]
        found.append(jax.tree.map(lambda x, count=count: np.asarray(x)[:count], function(*map(jnp.asarray, filled))))
    return jax.tree.map(lambda *parts: np.concatenate(parts), *found)


class _Looked(NamedTuple):
    """A term of the Lagrangian, its derivatives, and the derivative of its gradient with respect to λ."""

    value: np.ndarray
    gradient: np.ndarray
    hessian: np.ndarray
    by_parameter: np.ndarray


def _looked(term: Callable[..., Float[Array, ""]], local: Float[Array, " k"], parameter: Float[Array, ""]) -> _Looked:
    def first(local, parameter):
        value, gradient = jax.value_and_grad(term)(local, parameter)
        return gradient, (value, gradient)

    # One derivative of one trace, because these programs take longer to compile than to run.
    (hessian, by_parameter), (value, gradient) = jax.jacfwd(first, argnums=(0, 1), has_aux=True)(local, parameter)
    return _Looked(value, gradient, hessian, by_parameter)


def _sizes(vary: Vary, problem: Any) -> tuple[Array, Array]:
    at = vary(problem, jnp.zeros(()))
    return at.initial, at.conditions(at.initial)


@functools.partial(jax.jit, static_argnums=(0, 1))
def _nodes(vary: Vary, n: int, problem: Any, parameter, times, weights, steps, local) -> _Looked:
    def one(t, weight, h, local):
        def term(local, parameter):
            at = vary(problem, parameter)
            x, u, multiplier = local[:n], local[n:-n], local[-n:]
            return weight * at.cost(t, x, u) + h * jnp.sum(multiplier * at.rate(t, x, u))

        return _looked(term, local, parameter)

    return jax.vmap(one)(times, weights, steps, local)


@functools.partial(jax.jit, static_argnums=(0, 1))
def _ends(vary: Vary, n: int, problem: Any, parameter, local) -> _Looked:
    def term(local, parameter):
        at, x, multipliers = vary(problem, parameter), local[:n], local[n:]
        return jnp.sum(multipliers * at.conditions(x)) - at.softness * jnp.sum(multipliers**2) / 2

    return _looked(term, local, parameter)


@functools.partial(jax.jit, static_argnums=0)
def _initial(vary: Vary, problem: Any, parameter: Float[Array, ""]):
    """The initial state, and its derivative with respect to λ."""
    return jax.jvp(lambda parameter: vary(problem, parameter).initial, (parameter,), (jnp.ones_like(parameter),))


def _scattered(places: np.ndarray, blocks: np.ndarray, size: int) -> scipy.sparse.csr_array:
    """The sum of blocks, each at its places of rows and columns."""
    rows = np.broadcast_to(places[:, :, None], blocks.shape)
    columns = np.broadcast_to(places[:, None, :], blocks.shape)
    return scipy.sparse.csr_array((np.ravel(blocks), (np.ravel(rows), np.ravel(columns))), shape=(size, size))
