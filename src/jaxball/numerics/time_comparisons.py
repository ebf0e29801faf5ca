"""Finds the times at which a function of time compares the time with something, in its trace, for ``kinks``.

A comparison such as ``t < p`` in a user's function is a jump or a kink of it. Where the time enters linearly, with
coefficients that depend on nothing but parameters, the time of the change is known, with its derivatives.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.compat import Literal, Program, argument, branches, function_of, loop, program_within
from .time_dependence import (
    Dependent,
    Fixed,
    Piece,
    Piecewise,
    Value,
    fix_value,
    is_linear,
    join_dependences,
    pieces_of,
    read_literal,
    through,
)

MOST_TIMES = 64  # of one comparison: steps end at each of them
MOST_EQUATIONS = 4096  # of a loop that is followed turn by turn
GUARD = 1e-6  # a number of one sign that is compared with less is kept from 0, as before a division

COMPARISONS = {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "lt_to": "<", "le_to": "<="}
KEEP_SIGN = ("add", "mul", "div", "max", "reduce_sum", "reduce_max", "convert_element_type")
KEEP_SIGN += ("broadcast_in_dim", "reshape", "squeeze")
STEP_FUNCTIONS = ("floor", "ceil", "round")


ROUNDINGS = 8  # roundings, of all numbers involved, between the time of a change and where it really is

Comparison = Callable[[Any, Any], Any]


class TimeComparisons(NamedTuple):
    """What the trace of a function of time shows.

    - ``times``: those at which a comparison changes, unsorted; infinite where it never does.
    - ``unresolved``: the operations that compare or round the time in another way, as they are written in Python.
    """

    times: Float[Array, " times"]
    unresolved: tuple[str, ...]


def find_compared_times(program: Program, t: Float[Array, ""], parameters: Any) -> TimeComparisons:
    """Finds the times with which a function of (t, parameters, others) compares ``t``, from the program that it is
    traced to.

    - ``t``: any time; only its type matters.
    - ``parameters``: arrays in a PyTree, by which the times are differentiable. Of the others nothing is known.
    """
    parameter_values = [fix_value(value) for value in jax.tree.leaves(parameters)]
    unknown = [Dependent(False, True)] * (len(program.jaxpr.invars) - 1 - len(parameter_values))
    trace = _Trace()
    trace.follow(program, list(map(fix_value, program.consts)), [_the_time(t), *parameter_values, *unknown])
    times = [jnp.ravel(time).astype(t.dtype) for time in trace.times]
    return TimeComparisons(
        jnp.concatenate(times) if times else jnp.zeros((0,), t.dtype), tuple(dict.fromkeys(trace.unresolved))
    )


def _the_time(t: Float[Array, ""]) -> Value:
    return Piecewise((Piece(lambda: jnp.ones_like(t), lambda: jnp.zeros_like(t), lambda t: t, True),))


class _Trace:
    """The comparisons that are met on the way through a program."""

    def __init__(self):
        self.times: list[Array] = []
        self.unresolved: list[str] = []
        self.tables_are_smooth = False  # as between the rows of an interpolation
        self.loops = 0  # that are not followed turn by turn, around what is being looked at

    def follow(self, program: Program, constants: Sequence[Value], operands: Sequence[Value]) -> list[Value]:
        """Returns the results of a program, as they depend on time."""
        jaxpr = program.jaxpr
        values = dict(zip(jaxpr.constvars, constants, strict=True)) | dict(zip(jaxpr.invars, operands, strict=True))

        def read(variable: Any) -> Value:
            return read_literal(variable) if isinstance(variable, Literal) else values[variable]

        for equation in jaxpr.eqns:
            inputs = list(map(read, equation.invars))
            constant = [value for value in inputs if isinstance(value, Fixed)]
            results = (
                _compute_known(equation, constant) if len(constant) == len(inputs) else self._results(equation, inputs)
            )
            values |= dict(zip(equation.outvars, results, strict=True))
        return list(map(read, jaxpr.outvars))

    def _results(self, equation: Any, inputs: list[Value]) -> Sequence[Value]:
        name, inner = equation.primitive.name, program_within(equation)
        if inner is not None:
            return self._of_call(equation, inner, inputs)
        if name == "cond":
            which, *operands = inputs
            each = [self.follow(branch, list(map(fix_value, branch.consts)), operands) for branch in branches(equation)]
            return [_choose(which, cases) for cases in zip(*each, strict=True)]
        if name == "scan":
            return self._of_scan(equation, inputs)
        if name == "while":
            return self._of_while(equation, inputs)
        if is_linear(name, equation, inputs):
            return [through(equation, inputs)]
        rule = _RULES.get(name)
        result = rule(self, equation, inputs) if rule is not None else _join(name, equation, inputs)
        return [result] * len(equation.outvars)

    def _of_call(self, equation: Any, inner: Program, operands: list[Value]) -> Sequence[Value]:
        name = str(equation.params.get("name", ""))
        primitives = {within.primitive.name for within in inner.jaxpr.eqns}
        if _hides_comparisons(name, primitives):
            return [join_dependences(operands)] * len(equation.outvars)
        if name.startswith("_searchsorted"):
            # In any order of operands: the table is the only sequence that no time changes.
            tables = [
                value for value, variable in zip(operands, equation.invars, strict=True) if variable.aval.ndim == 1
            ]
            queries = [value for value in operands if not isinstance(value, Fixed)]
            if len(tables) == len(queries) == 1 and isinstance(tables[0], Fixed) and isinstance(queries[0], Piecewise):
                return [self._look_up(tables[0], queries[0])] * len(equation.outvars)
        before = self.tables_are_smooth
        self.tables_are_smooth = before or name == "_interp"
        try:
            return self.follow(inner, list(map(fix_value, inner.consts)), operands)
        finally:
            self.tables_are_smooth = before

    def _look_up(self, table: Fixed, query: Piecewise) -> Value:
        """Returns the row of a table of times in which a time is."""
        if jnp.size(table.value()) <= MOST_TIMES:
            self._take(query.to_each(), table)
        elif not self.tables_are_smooth:
            self.unresolved.append("searchsorted")
        return Dependent(False, False)

    def _of_scan(self, equation: Any, operands: list[Value]) -> Sequence[Value]:
        scan = loop(equation)
        constants, carried = operands[: scan.constants], operands[scan.constants : scan.constants + scan.carried]
        sequences, body_constants = operands[scan.constants + scan.carried :], list(map(fix_value, scan.body.consts))
        if scan.length * len(scan.body.jaxpr.eqns) > MOST_EQUATIONS:
            self._follow_any_turn(scan.body, constants, carried, sequences)
            return [join_dependences(operands)] * len(equation.outvars)
        turns, rows = range(scan.length), []
        for turn in reversed(turns) if scan.backwards else turns:
            elements = [_element(sequence, turn) for sequence in sequences]
            results = self.follow(scan.body, body_constants, [*constants, *carried, *elements])
            carried = results[: scan.carried]
            rows.append(results[scan.carried :])
        return (
            [*carried, *(join_dependences(column) for column in zip(*rows, strict=True))]
            if rows
            else [join_dependences(operands)] * len(equation.outvars)
        )

    def _of_while(self, equation: Any, operands: list[Value]) -> Sequence[Value]:
        first = argument(equation, "cond_nconsts")
        start = first + argument(equation, "body_nconsts")
        # Whether there is another turn is no jump of the limit of an iteration.
        self._follow_any_turn(argument(equation, "body_jaxpr"), operands[first:start], operands[start:], [])
        return [join_dependences(operands)] * len(equation.outvars)

    def _follow_any_turn(
        self, body: Program, constants: Sequence[Value], carried: Sequence[Value], sequences: Sequence[Value]
    ) -> None:
        unknown = join_dependences([*constants, *carried, *sequences])
        self.loops += 1
        self.follow(body, list(map(fix_value, body.consts)), [*constants, *[unknown] * (len(carried) + len(sequences))])
        self.loops -= 1

    def _compare(self, symbol: str, comparison: Comparison, left: Value, right: Value) -> Value:
        """Returns the result of a comparison, which changes at times that are taken if they are known."""
        either = join_dependences([left, right])
        if isinstance(left, Fixed | Piecewise) and isinstance(right, Fixed | Piecewise):
            self._take(left, right, comparison)
            return Dependent(False, False)
        if either.time and not _is_guard(left, right) and (not self.loops or _is_linear_in_time(left, right)):
            self.unresolved.append(symbol)
        return Dependent(False, either.state)

    def _take(self, left: Value, right: Value, comparison: Comparison = jnp.less) -> None:
        """Records the times at which a comparison of two values changes."""
        for piece in pieces_of(left):
            for other in pieces_of(right):
                if piece.slope is None and other.slope is None:
                    continue
                time = _crossing(piece, other)
                if time.size > MOST_TIMES:
                    self.unresolved.append(f"a comparison with {time.size} numbers")
                    continue
                # The time itself and constants are compared as they are, and the change is exactly where they are
                # equal.
                if not (piece.exact and other.exact and (piece.slope is None or other.slope is None)):
                    time = _as_rounded(time, piece, other, comparison)
                self.times.append(time)


def _crossing(line: Piece, other: Piece) -> Array:
    """Computes the times at which two linear functions are equal; infinite where they never are, or always."""
    slope = sum(sign * piece.slope() for sign, piece in ((1, line), (-1, other)) if piece.slope is not None)
    # A comparison that never changes is at no time; the inner `where` keeps the division by 0 out of derivatives.
    moves = jnp.asarray(slope != 0)
    difference = other.offset() - line.offset()
    return jnp.where(moves, difference / jnp.where(moves, slope, 1.0), jnp.inf)


def _as_rounded(times: Array, line: Piece, other: Piece, comparison: Comparison) -> Array:
    """Finds the floating-point times, near these, at which a comparison really changes.

    Rounding within the function may move that by a few numbers. A step that ends beyond it would not see the side that
    it is on. Found by bisection, one number at a time: of a whole array, XLA divides in another way.
    """
    offsets = jnp.abs(line.offset()) + jnp.abs(other.offset())
    slopes = sum(jnp.abs(piece.slope()) for piece in (line, other) if piece.slope is not None)
    moves = jnp.isfinite(times)
    near = jnp.abs(times) + offsets / jnp.where(moves, slopes, 1.0)
    width = ROUNDINGS * jnp.finfo(times.dtype).eps * jnp.where(moves, near, 0.0)
    centre = jnp.where(moves, times, 0.0)

    def holds_at(t: Array, place: Array) -> Array:
        results = jnp.ravel(jnp.broadcast_to(comparison(line.evaluate(t), other.evaluate(t)), times.shape))
        return results[0] if times.size == 1 else jnp.any(results & (jnp.arange(times.size) == place))

    def change(near: tuple[Array, Array, Array]) -> Array:
        """Finds the first time between two at which the comparison is not what it is at the first of them."""
        first, last, place = near
        before = holds_at(first, place)

        def halve(bounds: tuple[Array, Array]) -> tuple[Array, Array]:
            lower, upper = bounds
            middle = lower + 0.5 * (upper - lower)
            same = holds_at(middle, place) == before
            return jnp.where(same, middle, lower), jnp.where(same, upper, middle)

        def wide(bounds: tuple[Array, Array]) -> Array:
            lower, upper = bounds
            middle = lower + 0.5 * (upper - lower)
            return (middle > lower) & (middle < upper)

        return jax.lax.while_loop(wide, halve, (first, last))[1]

    # Without derivatives, which bisection does not have: those of the exact crossing remain.
    bounds = jax.lax.stop_gradient((jnp.ravel(centre - width), jnp.ravel(centre + width)))
    places = jnp.arange(times.size)
    if times.size == 1:
        changes = change((bounds[0][0], bounds[1][0], places[0]))[None]
    else:
        changes = jax.lax.map(change, (*bounds, places))
    shift = jnp.where(moves, changes.reshape(times.shape) - jax.lax.stop_gradient(times), 0.0)
    return times + jax.lax.stop_gradient(shift)


def _hides_comparisons(name: str, primitives: set[str]) -> bool:
    """Returns whether a function of JAX only compares so as to be accurate, as ``logaddexp``, or periodic, as
    ``mod``.
    """
    return {"max", "exp", "log1p"} <= primitives or (name == "remainder" and "rem" in primitives)


def _join(name: str, equation: Any, operands: list[Value]) -> Value:
    """Returns the result of an operation without a rule of its own, which depends on all that its operands
    depend on.
    """
    return join_dependences(operands)._replace(positive=_gives_positive(name, equation, operands))


def _gives_positive(name: str, equation: Any, operands: Sequence[Value]) -> bool:
    """Returns whether a result is never negative."""
    if name in ("exp", "exp2", "logistic", "square", "sqrt", "abs"):
        return True
    if name == "integer_pow" and argument(equation, "y") % 2 == 0:
        return True
    if name in ("mul", "dot_general") and equation.invars[0] is equation.invars[1]:
        return True
    return name in KEEP_SIGN and all(map(_is_positive, operands))


def _is_positive(value: Value) -> bool:
    return not isinstance(value, Piecewise) and value.positive


def _is_guard(left: Value, right: Value) -> bool:
    """Returns whether a number that is never negative is compared with 0, or almost: to touch that is no change of
    sign.
    """
    for value, other in ((left, right), (right, left)):
        small = isinstance(value, Fixed) and value.known is not None and abs(value.known) <= GUARD
        if small and _is_positive(other):
            return True
    return False


def _is_linear_in_time(*values: Value) -> bool:
    return any(isinstance(value, Piecewise) and join_dependences([value]).time for value in values)


def _choose(which: Value, cases: Sequence[Value]) -> Value:
    """Chooses one of several values, by an index."""
    by = join_dependences([which])
    if not by.time and not by.state and all(isinstance(case, Fixed | Piecewise) for case in cases):
        pieces = tuple(dict.fromkeys(piece for case in cases for piece in pieces_of(case)))
        return Piecewise.of(pieces)
    whole = join_dependences([which, *cases])
    return whole._replace(positive=all(map(_is_positive, cases)))


def _element(sequence: Value, turn: int) -> Value:
    if isinstance(sequence, Fixed):
        return Fixed(lambda: sequence.value()[turn])
    return join_dependences([sequence])


def _compute_known(equation: Any, operands: Sequence[Fixed]) -> Iterator[Fixed]:
    """Yields the results of an operation on numbers that depend on nothing but parameters, computed if they
    are needed.
    """
    results: list[Any] = []

    def compute() -> list[Any]:
        if not results:
            value = function_of(equation)(*(operand.value() for operand in operands))
            results.extend(value if equation.primitive.multiple_results else [value])
        return results

    name = equation.primitive.name
    copies = name in ("convert_element_type", "broadcast_in_dim", "reshape", "squeeze", "copy")
    number, positive = operands[0].known if copies else None, _gives_positive(name, equation, operands)
    for index, _ in enumerate(equation.outvars):
        yield Fixed(lambda index=index: compute()[index], number, positive)


# What operations that jump or have kinks do. Each takes the trace, the equation and its operands, and gives its result.


def _compare(trace: _Trace, equation: Any, operands: list[Value]) -> Value:
    return trace._compare(COMPARISONS[equation.primitive.name], function_of(equation), *operands)


def _of_larger_or_smaller(trace: _Trace, equation: Any, operands: list[Value]) -> Value:
    if all(isinstance(value, Fixed | Piecewise) for value in operands):
        left, right = operands
        trace._take(left, right)
        return Piecewise.of(tuple(piece for value in operands for piece in pieces_of(value)))
    return _join(equation.primitive.name, equation, operands)


def _clamp(trace: _Trace, equation: Any, operands: list[Value]) -> Value:
    lowest, value, highest = operands
    return _of_larger_or_smaller(trace, equation, [_of_larger_or_smaller(trace, equation, [lowest, value]), highest])


def _magnitude(trace: _Trace, equation: Any, operands: list[Value]) -> Value:
    (value,) = operands
    if isinstance(value, Piecewise):
        trace._take(value, _zero(equation))
        return Piecewise.of(tuple(piece for both in value.pieces for piece in (both, both.transform(jnp.negative))))
    return _join("abs", equation, operands)


def _sign(trace: _Trace, equation: Any, operands: list[Value]) -> Value:
    return trace._compare("sign", jnp.less, operands[0], _zero(equation))


def _zero(equation: Any) -> Fixed:
    of = equation.invars[0].aval
    return Fixed(lambda: jnp.zeros(of.shape, of.dtype), 0.0)


def _round(trace: _Trace, equation: Any, operands: list[Value]) -> Value:
    whole = join_dependences(operands)
    if whole.time and not trace.loops:
        trace.unresolved.append(name if (name := equation.primitive.name) in STEP_FUNCTIONS else "astype(int)")
    return Dependent(False, whole.state)


def _convert(trace: _Trace, equation: Any, operands: list[Value]) -> Value:
    was, becomes = equation.invars[0].aval.dtype, equation.outvars[0].aval.dtype
    if jnp.issubdtype(was, jnp.floating) and jnp.issubdtype(becomes, jnp.integer):
        return _round(trace, equation, operands)
    return _join("convert_element_type", equation, operands)


def _equal(trace: _Trace, equation: Any, operands: list[Value]) -> Value:
    return Dependent(False, join_dependences(operands).state)  # at single instants, which no integral notices


def _select(trace: _Trace, equation: Any, operands: list[Value]) -> Value:
    return _choose(operands[0], operands[1:])


_RULES: dict[str, Callable[[_Trace, Any, list[Value]], Value]] = {
    **dict.fromkeys(COMPARISONS, _compare),
    **dict.fromkeys(STEP_FUNCTIONS, _round),
    **dict.fromkeys(("eq", "ne", "eq_to", "is_finite"), _equal),
    **dict.fromkeys(("max", "min"), _of_larger_or_smaller),
    "clamp": _clamp,
    "abs": _magnitude,
    "sign": _sign,
    "convert_element_type": _convert,
    "select_n": _select,
}
