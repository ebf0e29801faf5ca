"""Direct collocation: an optimal control problem as equations for finitely many unknowns.

On each interval of a mesh the state is a polynomial of degree s that fulfils the differential equation at the s nodes
of Gauss, where the controls have their values (Betts, Practical Methods for Optimal Control, chapter 4; Hairer, Lubich
& Wanner, Geometric Numerical Integration, section II.1.3: states have order 2s at the ends of intervals). The
conditions of Karush, Kuhn and Tucker, that all derivatives of the Lagrangian vanish, are equations F(y, λ) = 0 with as
many unknowns: states, controls and multipliers. Their Jacobian is sparse and exact. Inequalities hold at the nodes.
They enter by complementary pairs: slack > 0, multiplier > 0, and slack · multiplier = µ, the conditions of an interior
point with the barrier µ, as functions of one free number s = slack − multiplier. They hold whatever s is (Chen & Harker
1993, Kanzow 1996), so that Newton's method need not keep anything positive, and may start where an inequality is
violated.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse
from jaxtyping import Array, Float, Int

from .... import programs
from ....programs.batches import in_batches, of_rows
from ....simulation.solvers.tableau import Tableau, gauss
from ..continuation import AbstractEquations
from .problem import AbstractControlProblem, Path


def slack(s: Float[Array, " k"], barrier: Float[Array, ""]) -> Float[Array, " k"]:
    """Computes (√(s² + 4 µ) + s) / 2."""
    return (jnp.sqrt(s**2 + 4 * barrier) + s) / 2


def multiplier(s: Float[Array, " k"], barrier: Float[Array, ""]) -> Float[Array, " k"]:
    """Computes (√(s² + 4 µ) − s) / 2."""
    return slack(-s, barrier)


Vary = Callable[[Any, Float[Array, ""]], AbstractControlProblem]


class Term(NamedTuple):
    """Some terms of the equations F, with their derivatives by their own unknowns and by λ.

    - ``cost``: the contribution of a node to the mean of the running cost; 0 at the end.
    """

    cost: np.ndarray
    value: np.ndarray
    jacobian: np.ndarray
    by_parameter: np.ndarray


class NodeTerm(NamedTuple):
    """The terms of nodes, with derivatives by x and u alone: the others follow from these, as the Lagrangian's.

    - ``by_slack``: w times the derivative of each slack by its unknown s; ``by_multiplier``: that of each multiplier.
    """

    term: Term
    by_slack: np.ndarray
    by_multiplier: np.ndarray

    def whole(self, shape: "Sizes") -> Term:
        """Returns the terms with derivatives by all unknowns of each node: x, u, the costate and s."""
        moving, free = shape.states + shape.controls, 2 * shape.states + shape.controls
        derivatives = self.term.jacobian
        jacobian = np.zeros((*derivatives.shape[:2], derivatives.shape[1]))
        jacobian[:, :, :moving] = derivatives
        # The Lagrangian's second derivatives are symmetric: the columns of costates are the rows of rates,
        # transposed.
        jacobian[:, :moving, moving:free] = np.swapaxes(derivatives[:, moving:free], 1, 2)
        # Row s contains −w g, the rows of x and u contain −w σ(s) g′: derived by s, σ′ times the former derived by x
        # and u.
        jacobian[:, :moving, free:] = np.swapaxes(self.by_multiplier[:, :, None] * derivatives[:, free:], 1, 2)
        # Each slack depends on its own s only.
        slacks = np.arange(free, derivatives.shape[1])
        jacobian[:, slacks, slacks] = self.by_slack
        return self.term._replace(jacobian=jacobian)


class Sizes(NamedTuple):
    """How many states, controls, end conditions and inequalities there are."""

    states: int
    controls: int
    conditions: int
    inequalities: int


def sizes(vary: Vary, problem: Any) -> Sizes:
    """Returns the sizes of vary(problem, λ)."""

    def parts(problem):
        variant = vary(problem, jnp.zeros(()))
        u = jnp.zeros_like(variant.initial, shape=(variant.controls,))
        return (
            variant.initial,
            u,
            variant.conditions(variant.initial),
            variant.inequalities(variant.start, variant.initial, u),
        )

    return Sizes(*(part.size for part in jax.eval_shape(parts, problem)))


def find_held(vary: Vary, problem: Any, states: int) -> Float[np.ndarray, " n"]:
    """Returns 1 for each entry of the state that vary(problem, λ) determines at the start, and 0 for the others."""
    variant = jax.eval_shape(lambda problem: vary(problem, jnp.zeros(())), problem)
    fixed = np.ones(states)
    fixed[list(variant.free_at_start)] = 0.0
    return fixed


def at_nodes(vary: Vary, shape: Sizes, problem: Any, parameter, barrier, times, weights, steps, local) -> NodeTerm:
    """Computes the derivatives of the Lagrangian by x, u and the costate of each node, and its complementarity.

    The Lagrangian of a node is w (cost − σ·g) + h λ·rate, with the inequalities g ≥ 0 and their multipliers σ, which
    are functions of the node's last unknowns s; these are found from w (slack(s) − g) = 0.
    """
    n, moving, free = shape.states, shape.states + shape.controls, 2 * shape.states + shape.controls

    def one(t, weight, h, local):
        s = local[free:]

        def equations(moved, parameter):
            variant = vary(problem, parameter)

            def lagrangian(local):
                x, u, costate = local[:n], local[n:-n], local[-n:]
                cost, g = weight * variant.cost(t, x, u), variant.inequalities(t, x, u)
                # σ is weighted like the cost, as a density in time: its values do not depend on the mesh.
                pushed = weight * jnp.sum(multiplier(s, barrier) * g)
                return cost - pushed + h * jnp.sum(costate * variant.rate(t, x, u)), (cost, g)

            rows = jnp.concatenate([moved, local[moving:free]])
            gradient, (cost, g) = jax.grad(lagrangian, has_aux=True)(rows)
            # The slack's equation is weighted like the cost, which makes the matrix symmetric up to the factor σ′.
            return jnp.concatenate([gradient, weight * (slack(s, barrier) - g)]), cost

        by_s = [jax.jvp(lambda s, of=of: of(s, barrier), (s,), (jnp.ones_like(s),))[1] for of in (slack, multiplier)]
        return NodeTerm(_term(equations, local[:moving], parameter), weight * by_s[0], by_s[1])

    return of_rows(one, times, weights, steps, local)


def at_end(vary: Vary, shape: Sizes, problem: Any, parameter, local) -> Term:
    """Computes the derivatives of the end conditions' term of the Lagrangian by x and the multipliers at the end."""
    n = shape.states

    def equations(local, parameter):
        def lagrangian(local):
            variant, x, multipliers = vary(problem, parameter), local[:n], local[n:]
            return jnp.sum(multipliers * variant.conditions(x)) - variant.softness * jnp.sum(multipliers**2) / 2

        return jax.grad(lagrangian)(local), jnp.zeros_like(parameter)

    return _term(equations, local, parameter)


def initial(vary: Vary, problem: Any, parameter: Float[Array, ""]):
    """Returns the initial state, and its derivative with respect to λ."""
    return jax.jvp(lambda parameter: vary(problem, parameter).initial, (parameter,), (jnp.ones_like(parameter),))


def _term(
    equations: Callable[..., tuple[Float[Array, " k"], Float[Array, ""]]],
    local: Float[Array, " k"],
    parameter: Float[Array, ""],
) -> Term:
    def along(
        direction: Float[Array, " k_plus_one"],
    ) -> tuple[Float[Array, " k"], Float[Array, " k"], Float[Array, ""]]:
        return jax.jvp(equations, (local, parameter), (direction[:-1], direction[-1]), has_aux=True)

    # Value, cost and derivatives by one function of each direction: these programs take longer to compile than to
    # run.
    # The last direction is that of λ.
    value, slopes, cost = of_rows(along, jnp.eye(local.size + 1, dtype=local.dtype))
    return Term(cost[0], value[0], slopes[:-1].T, slopes[-1])


# The number of nodes evaluated by one call of a compiled program, the same for each mesh.
NODES = 64
# The barrier at the start, and that of a finished solution; it only affects inequalities.
BARRIER, SHARP = 1e-2, 1e-8


def as_it_is(problem: AbstractControlProblem, parameter: Float[Array, ""]) -> AbstractControlProblem:
    """Returns the problem, which does not depend on λ."""
    return problem


class Unknowns(NamedTuple):
    """The parts of y.

    - ``knots``: states at the ends of the N intervals; ``nodes``, ``controls``: states and controls at the nodes.
    - ``at_start``, ``at_nodes``, ``at_knots``, ``at_end``: multipliers of the initial state, of the differential
      equation at the nodes, of the states at the ends of the intervals, and of the end conditions.
    - ``excess``: of the inequalities' slacks over their multipliers, at the nodes.
    """

    knots: Float[np.ndarray, "N_plus_one n"]
    nodes: Float[np.ndarray, "N s n"]
    controls: Float[np.ndarray, "N s m"]
    at_start: Float[np.ndarray, " n"]
    at_nodes: Float[np.ndarray, "N s n"]
    at_knots: Float[np.ndarray, "N n"]
    at_end: Float[np.ndarray, " c"]
    excess: Float[np.ndarray, "N s i"]


class Collocation(AbstractEquations):
    """The equations for the problem vary(problem, λ) on a mesh, with s nodes an interval, and the barrier µ.

    ``vary`` is compiled into programs, so pass the same one each time: a new lambda compiles again.

    **Arguments:**

    - ``problem``: what ``vary`` changes with λ.
    - ``mesh``: times, the start first and the end last, shape (N + 1,).
    - ``stages``: s.
    - ``barrier``: µ.

    It has ``steps``, the lengths of the intervals; ``times``, the nodes; ``weights``, theirs in a mean over the run;
    ``size``, the number of unknowns; ``unconstrained``, how many of them, the first ones, are states and controls, the
    others being multipliers; ``equalities``, the indices of the multipliers of all conditions except inequalities; and
    ``inequalities``, how many of these hold at each node.
    """

    def __init__(
        self,
        problem: Any,
        mesh: Float[np.ndarray, " N_plus_one"],
        stages: int = 3,
        vary: Vary = as_it_is,
        barrier: float = BARRIER,
    ):
        self.problem, self.mesh, self.stages, self.vary, self.barrier = problem, mesh, stages, vary, barrier
        self.tableau: Tableau = gauss(stages)
        self._last: tuple[np.ndarray, float, Term, Term] | None = None
        self._sizes = Sizes(*map(int, _compile_partial(sizes, vary)(problem)))
        n, m, c, i = self._sizes
        self.held = find_held(vary, problem, n)
        N, s = len(mesh) - 1, stages
        shapes: list[Any] = [(N + 1, n), (N, s, n), (N, s, m), (n,), (N, s, n), (N, n), (c,), (N, s, i)]
        self.shapes = Unknowns(*shapes)
        counts = [int(np.prod(shape)) for shape in shapes]
        self.size, self.unconstrained, self.inequalities = sum(counts), sum(counts[:3]), i
        self.equalities = slice(self.unconstrained, self.size - counts[-1])
        self.steps = np.diff(mesh)
        self.times = mesh[:-1, None] + self.steps[:, None] * self.tableau.c
        self.weights = self.steps[:, None] * self.tableau.b / (mesh[-1] - mesh[0])
        places = np.split(np.arange(self.size), np.cumsum(counts)[:-1])
        self.places = Unknowns(*(indices.reshape(shape) for indices, shape in zip(places, self.shapes, strict=True)))

    def with_changes(self, **changes: Any) -> "Collocation":
        """Returns the equations with other arguments, such as another mesh or barrier."""
        names = ("problem", "mesh", "stages", "vary", "barrier")
        return Collocation(**{name: getattr(self, name) for name in names} | changes)

    def parts(self, y: Float[np.ndarray, " size"]) -> Unknowns:
        """Returns the parts of y."""
        return Unknowns(*(y[indices] for indices in self.places))

    def join(self, parts: Unknowns) -> Float[np.ndarray, " size"]:
        """Inverts :meth:`parts`."""
        return np.concatenate([np.ravel(part) for part in parts])

    @functools.cached_property
    def order(self):
        """Interval by interval, the unknowns of nodes before what they determine."""
        places = self.places
        # Within an interval each unknown is coupled to others of it and to the knots at both ends; this makes the
        # band.
        intervals = [
            places.knots[:-1, None],
            places.excess,
            places.nodes,
            places.controls,
            places.at_nodes,
            places.at_knots[:, None],
        ]
        return np.concatenate([in_time(*intervals, first=places.at_start), places.knots[-1], places.at_end])

    def sizes(self, y):
        """Returns 1 + |y|, without multipliers that are sensitive to rounding.

        These are all of them if there are inequalities, near a boundary, and those of the end if its conditions are
        soft, because some conditions may follow from others.
        """
        sizes = super().sizes(y)
        # With an infinite scale, a correction counts as 0.
        if self.inequalities:
            sizes[self.unconstrained :] = np.inf
        elif self._soft:
            sizes[self.places.at_end] = np.inf
        return sizes

    def length(self, change, y):
        # The norm must leave out the same multipliers, or the monotonicity test would compare their rounding.
        return super().length(change / self.sizes(y) if self.inequalities or self._soft else change, y)

    def residual(self, y, parameter):
        node, end = self._terms(y, parameter)
        first = self.linear @ y
        first[self.places.at_start] -= self._initial(parameter)[0]
        np.add.at(first, self._node_places, node.value)
        np.add.at(first, self._end_places, end.value)
        return first

    def jacobian(self, y, parameter):
        node, end = self._terms(y, parameter)
        at_nodes = _sum_blocks(self._node_places, node.jacobian, self.size)
        at_end = _sum_blocks(self._end_places[None], end.jacobian[None], self.size)
        by_parameter = np.zeros(self.size)
        np.add.at(by_parameter, self._node_places, node.by_parameter)
        np.add.at(by_parameter, self._end_places, end.by_parameter)
        by_parameter[self.places.at_start] -= self._initial(parameter)[1]
        return self.linear + at_nodes + at_end, by_parameter

    def _initial(self, parameter: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns the initial state and its derivative by λ, 0 where it is free."""
        value, slope = _compile_partial(initial, self.vary)(self.problem, jnp.asarray(parameter))
        return self.held * np.asarray(value), self.held * np.asarray(slope)

    def cost(self, y: Float[np.ndarray, " size"], parameter: float) -> float:
        """Computes the mean of the running cost, by the weights of Gauss."""
        return float(np.sum(self._terms(y, parameter)[0].cost))

    def along(self, path: Path, name: str, times: Float[np.ndarray, " k"], parameter: float) -> Any:
        """Evaluates a function of (t, x, u) that the problem has under this name, such as ``rate``, at times along a
        path.
        """
        function = functools.partial(_compile_partial(_along, name, self.vary), self.problem, jnp.asarray(parameter))
        return _over_nodes(function, times, path.states(times), path.inputs(times))

    def problem_at(self, parameter: float) -> Any:
        """Returns the problem at a λ."""
        return _compile_partial(self.vary)(self.problem, jnp.asarray(parameter))

    @functools.cached_property
    def _soft(self) -> bool:
        """Whether the conditions at the end are soft, and stay so for all λ."""
        return all(self.problem_at(share).softness > 0 for share in (0.0, 1.0))

    @functools.cached_property
    def linear(self) -> scipy.sparse.sparray:
        """The constant part of the Jacobian: coefficients of linear equations."""
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
        # What is free at the start has the multiplier 0 there, in place of a value; the diagonal counts twice below.
        entries = [(data, row, column), (self.held, states.at_start, states.knots[0])]
        entries.append(((1 - self.held) / 2, states.at_start, states.at_start))
        data, row, column = (np.concatenate([np.ravel(x) for x in part]) for part in zip(*entries, strict=True))
        lower = scipy.sparse.csr_array((data, (row, column)), shape=(self.size, self.size))
        # These equations are linear in the states, and their multipliers enter the other rows by the same
        # coefficients: the matrix of the conditions of Karush, Kuhn and Tucker is symmetric.
        return lower + lower.T

    @functools.cached_property
    def _node_places(self) -> np.ndarray:
        """The indices in y of X, u, the costate and the inequalities' unknowns of each node."""
        return _local(self.places)

    @functools.cached_property
    def _end_places(self) -> np.ndarray:
        return np.concatenate([self.places.knots[-1], self.places.at_end])

    def _terms(self, y: np.ndarray, parameter: float) -> tuple[Term, Term]:
        """Returns the terms of the nodes and of the end; cached, because residual and Jacobian are needed at the same
        point.
        """
        # Newton's method asks for residual and Jacobian at one point after the other; comparing y is far cheaper than
        # evaluating.
        if self._last is None or self._last[1] != parameter or not np.array_equal(self._last[0], y):
            parts = self.parts(y)
            # A copy, because the caller may change its y in place.
            self._last = (y.copy(), parameter, self._node(parts, parameter), self._end(parts, parameter))
        return self._last[2:]

    def _node(self, parts: Unknowns, parameter: float) -> Term:
        h = np.broadcast_to(self.steps[:, None], self.times.shape)
        arguments = (self.problem, jnp.asarray(parameter), jnp.asarray(self.barrier))
        rows = [np.ravel(self.times), np.ravel(self.weights), np.ravel(h), _local(parts)]
        function = functools.partial(_compile_partial(at_nodes, self.vary, self._sizes), *arguments)
        return _over_nodes(function, *rows).whole(self._sizes)

    def _end(self, parts: Unknowns, parameter: float) -> Term:
        local = jnp.asarray(np.concatenate([parts.knots[-1], parts.at_end]))
        term = _compile_partial(at_end, self.vary, self._sizes)(self.problem, jnp.asarray(parameter), local)
        return jax.tree.map(np.asarray, term)


@functools.lru_cache(maxsize=64)
def _compile_partial(function: Callable[..., Any], *arguments: Any) -> programs.Program:
    """Compiles a function whose first arguments are given."""
    # Cached by the identity of `vary`: the same function again finds its compiled program.
    return programs.jit(functools.partial(function, *arguments))


def _over_nodes(function: Callable[..., Any], *rows: np.ndarray) -> Any:
    return in_batches(lambda batch: function(*batch), rows, NODES)


def _along(name: str, vary: Vary, problem: Any, parameter, times, states, controls):
    return of_rows(getattr(vary(problem, parameter), name), times, states, controls)


def _local(parts: Unknowns) -> np.ndarray:
    """Returns the entries that belong to each node, a row for each."""
    rows = np.concatenate([parts.nodes, parts.controls, parts.at_nodes, parts.excess], axis=2)
    return rows.reshape(-1, rows.shape[-1])


def in_time(*places: Int[np.ndarray, "N _ _"], first: Int[np.ndarray, " n"]) -> Int[np.ndarray, " places"]:
    """Lists indices in the order of time: ``first``, and then, interval by interval, the indices of each kind."""
    count = len(places[0])
    return np.concatenate([first, np.ravel(np.concatenate([indices.reshape(count, -1) for indices in places], axis=1))])


def _sum_blocks(places: np.ndarray, blocks: np.ndarray, size: int) -> scipy.sparse.csr_array:
    """Sums blocks, each at its own rows and columns."""
    rows = np.broadcast_to(places[:, :, None], blocks.shape)
    columns = np.broadcast_to(places[:, None, :], blocks.shape)
    # Entries at the same place add up in a sparse array.
    return scipy.sparse.csr_array((np.ravel(blocks), (np.ravel(rows), np.ravel(columns))), shape=(size, size))
