"""Finds the inputs of a function: values in its trace that vary with time in a way that only sampling can follow.

The samples of a step say how a polynomial, or a few sinusoids, go on between them. They say nothing about a function
such as exp(−((t − c)/w)²), which is almost zero but for a moment. Where the time enters a trace by such a function, its
result is an input, and ``find_inputs`` returns all inputs as one function of time, which costs no more than it must.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..interface.compat import Literal, Program, argument, branches, function_of, loop, program_within

# A polynomial in time of higher degree, or sinusoids of more phases or harmonics, may be almost zero but for a moment.
MOST_DEGREES, MOST_PHASES, MOST_HARMONICS = 32, 8, 16

SINES = ("sin", "cos", "sine_cosine")
PRODUCTS = ("mul", "dot_general", "square", "integer_pow")
LINEAR = ("add", "add_any", "sub", "neg", "reduce_sum", "cumsum", "convert_element_type", "reduce_precision", "copy")
LINEAR += ("broadcast_in_dim", "reshape", "squeeze", "expand_dims", "transpose", "slice", "concatenate", "stack")
LINEAR += ("rev", "pad", "split", "real", "select_n")
BY_INDEX = ("gather", "dynamic_slice", "dynamic_update_slice", "scatter", "scatter-add")
PIECEWISE = ("abs", "max", "min", "clamp")  # linear where their operands are, between kinks that are known
COMPARISONS = ("lt", "le", "gt", "ge", "lt_to", "le_to", "sign", "floor", "ceil", "round")
LOGIC = ("and", "or", "not", "xor", "eq", "ne", "is_finite", "stop_gradient")
# Of an input, and of the time and the state together, only these are inputs: a quotient or a root is as smooth as what
# it is of, unless that comes close to zero, as the inertia of a body does not. But what grows with time, as t − x does
# for a place x, comes close to anything for a moment: what compares it, and a negative power of it, are inputs, too.
STEEP = ("exp", "exp2", "expm1", "tanh", "logistic", "erf", "erfc", "erf_inv", "sinh", "cosh", "pow", "log", "log1p")


class Course(NamedTuple):
    """How a value varies with time.

    - ``time``, ``state``: whether it depends on them.
    - ``degree``: of the polynomial in time that it is, between known kinks, or of that in it where it depends on the
      state; of a logical value the highest of the numbers that it compares.
    - ``phases``: the angles of sinusoids in it, by where they are computed, with how many each of them is.
    - ``harmonics``: the highest multiple of them.
    - ``sampled``: whether only sampling can follow it.
    """

    time: bool = False
    state: bool = False
    degree: int = 0
    phases: frozenset[tuple[int, int]] = frozenset()
    harmonics: int = 0
    sampled: bool = False

    @classmethod
    def join(cls, courses: Sequence["Course"]) -> "Course":
        """Returns the course of a linear function of several values."""
        return cls(
            any(course.time for course in courses),
            any(course.state for course in courses),
            max((course.degree for course in courses), default=0),
            frozenset().union(*(course.phases for course in courses)),
            max((course.harmonics for course in courses), default=0),
            any(course.sampled for course in courses),
        )

    @property
    def is_linear(self) -> bool:
        """Whether it is linear in time between known kinks."""
        return self.degree <= 1 and not self.phases and not self.sampled

    @property
    def is_simple(self) -> bool:
        """Whether the samples of a step tell how it goes on between them."""
        phases = sum(size for _, size in self.phases)
        return self.degree <= MOST_DEGREES and phases <= MOST_PHASES and self.harmonics <= MOST_HARMONICS


class _Operation(NamedTuple):
    """An equation of the trace, with the places of its operands and its results among all values."""

    equation: Any
    operands: tuple[Any, ...]
    results: tuple[int, ...]


def find_inputs(
    program: Program, modes: bool = False
) -> Callable[[Float[Array, ""], Any, Any], Float[Array, " inputs"]] | None:
    """Finds the inputs of a function of (t, x, parameters), arrays, from the program that it is traced to.

    ``modes``: whether what compares the time and the state tells modes, whose ends are found in each step, and is none.
    Returns the function of the same arguments that computes them; None if there are none, and where the function calls
    back to Python, which is not asked more often than a solve must.
    """
    trace = _Trace(modes)
    first = [trace.add(Course(time=True, degree=1)), trace.add(Course(state=True)), trace.add(Course())]
    trace.follow(program, first)
    return functools.partial(trace.evaluate, first) if trace.inputs and not trace.calls_back else None


def depends_on_time(program: Program) -> bool:
    """Returns whether any result of a function of (t, x, parameters), arrays, changes with t alone."""
    trace = _Trace(modes=False)
    results = trace.follow(program, [trace.add(Course(time=True)), trace.add(Course(state=True)), trace.add(Course())])
    return any(trace.courses[place].time for place in results)


class _Trace:
    """The values that are met on the way through a program, with their courses, and how they are computed."""

    def __init__(self, modes: bool):
        self.modes = modes
        self.courses: list[Course] = []
        self.constants: dict[int, Any] = {}
        self.places: dict[Any, Any] = {}  # of operations that have been met, which a derivative computes again
        self.operations: list[_Operation] = []
        self.calls_back = False
        self.inputs: list[tuple[int, bool]] = []  # whether it is the reciprocal that varies

    def add(self, course: Course) -> int:
        """Adds a value, and returns its place."""
        self.courses.append(course)
        return len(self.courses) - 1

    def follow(self, program: Program, operands: Sequence[int]) -> list[int]:
        """Returns the places of the results of a program."""
        places = dict(zip(program.jaxpr.invars, operands, strict=True))
        for variable, value in zip(program.jaxpr.constvars, program.consts, strict=True):
            places[variable] = self._constant(value)

        def read(variable: Any) -> int:
            if isinstance(variable, Literal):
                return self._place_number(np.asarray(variable.val, variable.aval.dtype))
            return places[variable]

        for equation in program.jaxpr.eqns:
            inputs = [read(variable) for variable in equation.invars]
            inner = program_within(equation)
            looks_up = str(equation.params.get("name", "")).startswith("_searchsorted")
            if inner is not None and not looks_up:
                results = self.follow(inner, inputs)
            else:
                results = self._apply(equation, inputs, looks_up)
            places |= dict(zip(equation.outvars, results, strict=True))
        return [read(variable) for variable in program.jaxpr.outvars]

    def _constant(self, value: Any) -> int:
        place = self.add(Course())
        self.constants[place] = value
        return place

    def _place_number(self, number: np.ndarray) -> int:
        """Returns the place of a number that is written in the function; the same one wherever it is."""
        key = number.dtype.str, number.shape, number.tobytes()
        if key not in self.places:
            self.places[key] = self._constant(number)
        return self.places[key]

    def _apply(self, equation: Any, operands: list[int], looks_up: bool) -> list[int]:
        """Adds an operation, unless it has been added before, and those of its results that are inputs."""
        key = equation.primitive.name, tuple(operands), tuple(sorted(equation.params.items()))
        try:
            hash(key)
        except TypeError:
            return self._add_operation(equation, operands, looks_up)
        if key not in self.places:
            self.places[key] = self._add_operation(equation, operands, looks_up)
        return self.places[key]

    def _add_operation(self, equation: Any, operands: list[int], looks_up: bool) -> list[int]:
        courses = [self.courses[place] for place in operands]
        name, whole = equation.primitive.name, Course.join(courses)
        self.calls_back |= "callback" in name
        is_input = False
        if whole.time and whole.state:
            course = Course(time=True, state=True, degree=_degree(name, equation, courses))
            is_input = bool(_primitives(equation) & set(STEEP))
            is_input |= not self.modes and _is_sudden(name, equation, courses)
            if name == "div" and courses[1].time and not courses[1].state and (operands[1], True) not in self.inputs:
                self.inputs.append((operands[1], True))
        elif whole.time:
            course = _join_compared(courses) if looks_up else _course(name, equation, operands, courses)
            if course is None or not course.is_simple:
                course = Course(time=True, sampled=True)
            # Of integers and logical values, what is chosen by them is the input.
            chosen = any(self._is_whole(place) for place, of in zip(operands, courses, strict=True) if of.sampled)
            is_input = course.sampled and (not whole.sampled or chosen or name in STEEP)
        else:
            course = whole
        results = [self.add(course) for _ in equation.outvars]
        self.operations.append(_Operation(equation, tuple(operands), tuple(results)))
        if is_input:
            for place, variable in zip(results, equation.outvars, strict=True):
                if jnp.issubdtype(variable.aval.dtype, jnp.floating):
                    self.inputs.append((place, False))
        return results

    def _is_whole(self, place: int) -> bool:
        for operation in reversed(self.operations):
            if place in operation.results:
                variable = operation.equation.outvars[operation.results.index(place)]
                return not jnp.issubdtype(variable.aval.dtype, jnp.floating)
        return False

    def evaluate(
        self, arguments: Sequence[int], t: Float[Array, ""], x: Any, parameters: Any
    ) -> Float[Array, " inputs"]:
        """Computes the inputs, by the operations that they need."""
        values: dict[int, Any] = dict(zip(arguments, (t, x, parameters), strict=True)) | self.constants
        for operation in self._list_needed():
            results = function_of(operation.equation)(*(values[place] for place in operation.operands))
            several = operation.equation.primitive.multiple_results
            values |= dict(zip(operation.results, results if several else [results], strict=True))
        inputs = (1 / values[place] if is_divisor else values[place] for place, is_divisor in self.inputs)
        return jnp.concatenate([jnp.ravel(value).astype(t.dtype) for value in inputs])

    def _list_needed(self) -> list[_Operation]:
        """Returns the operations that the inputs depend on, in their order."""
        asked, needed = {place for place, _ in self.inputs}, []
        for operation in reversed(self.operations):
            if asked & set(operation.results):
                needed.append(operation)
                asked |= set(operation.operands)
        return needed[::-1]


def _course(name: str, equation: Any, operands: list[int], courses: list[Course]) -> Course | None:
    """Returns the course of the result of an operation on the time and parameters; None where only sampling tells."""
    whole = Course.join(courses)
    if name in LINEAR or name in LOGIC:
        return whole
    if not any(jnp.issubdtype(of.aval.dtype, jnp.inexact) for of in (*equation.invars, *equation.outvars)):
        return whole  # Integers change where what they follow from jumps, as in the bisection of a table.
    if name in COMPARISONS:
        return _join_compared(courses)
    if name in BY_INDEX:
        return Course.join([courses[0], _join_compared(courses[1:])])
    if name in PRODUCTS:
        factors = courses * int(equation.params.get("y", 2)) if len(courses) == 1 else courses
        negative = equation.params.get("y", 2) < 0
        degree, harmonics = sum(of.degree for of in factors), sum(of.harmonics for of in factors)
        return None if negative else whole._replace(degree=degree, harmonics=harmonics)
    if name == "div" and not courses[1].time:
        return whole
    if name in PIECEWISE and whole.is_linear:
        return whole
    if name in SINES and not whole.sampled:
        (variable,) = equation.invars
        phase = (operands[0], int(variable.aval.size))
        return Course(time=True, phases=whole.phases | {phase}, harmonics=max(1, whole.harmonics))
    return None


def _degree(name: str, equation: Any, courses: Sequence[Course]) -> int:
    """Returns the degree of the polynomial in time in a value that also depends on the state."""
    if name in PRODUCTS:
        power = int(equation.params.get("y", 2)) if len(courses) == 1 else 1
        return power * sum(course.degree for course in courses) if power > 0 else 0
    if name == "div":
        return courses[0].degree
    keeps = name in LINEAR or name in LOGIC or name in COMPARISONS or name in PIECEWISE or name == "sqrt"
    return max(course.degree for course in courses) if keeps else 0


def _is_sudden(name: str, equation: Any, courses: Sequence[Course]) -> bool:
    """Returns whether a value that depends on the time and the state may be almost constant but for a moment."""
    if name in PIECEWISE:
        decisive = courses
    elif name == "select_n" or name == "rsqrt" or (name == "integer_pow" and equation.params["y"] < 0):
        decisive = courses[:1]
    else:
        decisive = []
    return any(course.time and course.state and course.degree > 0 for course in decisive)


def _join_compared(courses: Sequence[Course]) -> Course:
    """Returns the course of a value that jumps, at known kinks where linear functions of time are compared."""
    whole = Course.join(courses)
    return Course(time=whole.time, sampled=whole.time and not all(course.is_linear for course in courses))


def _primitives(equation: Any) -> set[str]:
    """Returns the names of all primitives of an equation, and of those within it."""
    name = equation.primitive.name
    if name == "cond":
        inner = branches(equation)
    elif name == "scan":
        inner = (loop(equation).body,)
    elif name == "while":
        inner = (argument(equation, "body_jaxpr"),)
    else:
        within = program_within(equation)
        inner = () if within is None else (within,)
    return {name}.union(*(_primitives(each) for program in inner for each in program.jaxpr.eqns))
