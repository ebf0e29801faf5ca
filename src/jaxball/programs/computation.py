"""A function for arrays of certain types: traced once, with its compiled programs, its derivatives, and its batches.

Its derivative along tangents, the cotangents of its arguments, and the function of many rows or directions at once are
such functions again, each compiled where it is first needed. ``program`` makes one for each kind of arguments.
"""

import contextlib
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..interface.activity import compiling
from ..interface.compat import Program, captures, evaluate, settings
from . import native, traces
from .compiled import QUICKLY, Compiled, Place, Rest, is_kept_by_jax, place_in
from .derivatives.differentiation import differentiate_forward, without_captured_derivatives
from .derivatives.reverse_rules import choose
from .following import (
    Result,
    cotangents_by_tangents,
    cotangents_of,
    first_of,
    has_tangents,
    in_directions,
    in_steps_of_probe,
    of_each_row,
    results_and_rates,
    tangents_and_probe,
    tangents_of,
)
from .store import current
from .store.current import Store

MOST_RATES = 2**28  # bytes of derivatives that are computed beside the results of a run
ROWS_OF_BLOCK = native.FEWEST * native.LANES  # rows that a program computes at once
ROWS_OF_XLA = 64  # rows that are one solve by XLA on a CPU, where 512 were no faster


def call_with(
    function: Callable[..., Any], is_dynamic: Callable[[Any], bool] | None, rest: Rest, arrays: list[Any]
) -> Result:
    """Applies a function of PyTrees to the arrays of its arguments and their ``rest``."""
    args, kwargs = rest.with_keys(arrays)
    result, arrays = take_arrays(*jax.tree.flatten(function(*args, **kwargs)), is_dynamic)
    return Result([jnp.asarray(native.numbers(array)) for array in arrays], result)


def take_arrays(leaves: list[Any], structure: Any, is_dynamic: Callable[[Any], bool] | None) -> tuple[Rest, list[Any]]:
    """Splits a flattened PyTree into its arrays, which are all leaves if there is no ``is_dynamic``, and the rest."""
    if is_dynamic is None or not leaves:
        return Rest(structure, keys=native.implementations(leaves)), leaves
    dynamic = tuple(map(is_dynamic, leaves))
    static = tuple(None if new else leaf for leaf, new in zip(leaves, dynamic, strict=True))
    arrays = choose(leaves, dynamic)
    return Rest(structure, static, dynamic, native.implementations(arrays)), arrays


class Computation:
    """A function of a list of arrays, for arrays of certain types.

    **Arguments:**

    - ``function``: of a list of arrays, to another, or to a :class:`Result`.
    - ``arrays``: such arrays, or their types.
    - ``name``: in messages and profiles.
    - ``large``: whether what has loops over large arrays is compiled natively, too.
    - ``in_lanes``: whether rows are computed side by side in the lanes of vectors, or else one after another.
    - ``together``: how many rows XLA computes side by side on a CPU.
    - ``steered``: whether it has loops whose steps are chosen for its derivatives as well.
    - ``by_steps``: whether its results list such steps, so that beside derivatives they must be of the same steps.
    - ``gives``: the types of the results, where they are known.
    - ``opaque``: whether all within is one program; otherwise, as in a user's function, computations in it are
      differentiated and mapped by themselves.
    """

    # What follows from it: how a function made of ``function`` can be differentiated, and which arguments are linear.
    smooth: Callable[[list[Any]], Any]  # the same function, in a form that forward mode differentiates
    linear: tuple[bool, ...]
    is_derivative = False
    along: Callable[[Sequence[bool], int, list[Any]], list[Any]] | None = None  # of tangents, the same along several
    rows: native.Rows | None = None

    def __init__(
        self,
        function: Callable[[list[Any]], Any],
        arrays: Sequence[Any],
        *,
        name: str,
        large: bool = False,
        in_lanes: bool = True,
        together: int = ROWS_OF_XLA,
        opaque: bool = True,
        steered: bool = False,
        by_steps: bool = False,
        gives: Sequence[Any] | None = None,
    ):
        self.function = self.smooth = function
        self.name, self.large, self.in_lanes, self.together, self.opaque = name, large, in_lanes, together, opaque
        self.steered, self.by_steps, self._gives = steered, by_steps, gives
        self._results: list[Rest] = []
        self.linear = (False,) * len(arrays)
        self.traced = native.Lowered(
            self._of_arrays,
            arrays,
            name,
            native.current_choice() == "native",
            lambda: traces.within_a_computation(self.opaque),
        )
        self.takes = self.traced.takes
        self._made: dict[Any, Any] = {}

    def _of_arrays(self, arrays: list[Any]) -> list[Any]:
        with compiling():  # which tracing is the first part of
            result = self.function(arrays)
        if not isinstance(result, Result):
            result = Result(result, Rest(jax.tree.structure(result)))
        self._results.append(result.rest)
        return result.arrays

    # What is known of its results

    @property
    def gives(self) -> list[Any]:
        """The types of the arrays of the result."""
        if self._gives is None:
            self._gives = self._in_store.gives if self._in_store else self.traced.gives
        return list(self._gives)

    @property
    def result(self) -> Rest:
        """The parts of the result that are not arrays."""
        if self._in_store:
            return self._in_store.result
        if not self._results:
            _ = self.traced.trace
        return self._results[-1]

    def is_pure(self) -> bool:
        """Returns whether it does nothing but compute, of its arguments alone, numbers that XLA's arrays can hold."""
        if any(not isinstance(result.dtype, np.dtype) or result.dtype == jax.dtypes.float0 for result in self.gives):
            return False
        if self._in_store:
            return self._in_store.target is not None
        return not self.traced.trace.jaxpr.effects and not self.captures

    @property
    def captures(self) -> list[Any]:
        """Arrays that are traced around the function, which uses them besides its arguments."""
        if self._in_store:
            return []
        traced = self.traced.trace
        return captures(traced) if len(traced.jaxpr.in_avals) > len(self.takes) else []

    def of_captures(self, arrays: list[Any]) -> tuple["Computation", list[Any]]:
        """Returns the same function, but of its captures and its own arrays, with all these arrays.

        It is traced here in both forms, because captures cannot be used when the trace around it has ended.
        """
        with differentiate_forward(), self.traced.as_traced():
            forms = [self.traced.trace, self.traced.function.trace(self.takes)]
        captured = {id(array): array for traced in forms for array in captures(traced)}
        functions = [_OfCaptures(traced, list(captured), self.opaque) for traced in forms]
        passed = [*captured.values(), *arrays]
        computation = self._from_callable(functions[0], list(map(native.type_of, passed)), self.gives)
        computation.smooth = functions[1]
        return computation, passed

    @functools.cached_property
    def _in_store(self) -> Compiled | None:
        """The native program that another process has compiled, which tells what a trace would tell."""
        if current.store() is None or self._results:
            return None
        if jax.default_backend() == "cpu":
            program = self.natively(current.store(), compiles=False)
        else:
            program = self.on_gpu(current.store(), compiles=False)
        return program if isinstance(program, Compiled) else None

    # Programs

    def here(self, arrays: Sequence[Any]) -> list[Any]:
        """Returns the results, written into the program that is being traced."""
        traced = self.traced if native.is_traced_natively() else self.traced.for_xla()
        with traced.as_traced():
            return traced.function(list(arrays))

    def __call__(self, arrays: Sequence[Any]) -> list[Any]:
        """Returns the arrays of the result, for arrays that are not traced."""
        program = self.obtain(current.store())
        if program is not None:
            with contextlib.suppress(native.CallbackReachedError):
                return program.run(list(arrays))
        return self.here(arrays)

    def obtain(self, store: Store | None) -> Compiled | None:
        """Returns the program, from the store or compiled: natively, or by XLA if that is chosen or necessary.

        None if JAX compiles it as usual.
        """
        natively = self.natively(store)
        if isinstance(natively, Compiled):
            return natively
        if store is None and natively is None:
            return None
        return self._once(("xla", store), lambda: self._by_xla(store if native.on_one_cpu() else None, natively))

    def natively(self, store: Store | None, compiles: bool = True) -> Compiled | native.Refusal | None:
        """Returns the native program, a refusal, or None if the compiler is not chosen or cannot be used.

        - ``compiles``: whether it is compiled if it is not in the store.
        """
        if native.current_choice() != "native" or not native.is_allowed():
            return None
        return self._once(("native", store), lambda: self._natively(store, compiles))

    def _once(self, which: Any, make: Callable[[], Any]) -> Any:
        """Returns the result of ``make``, kept for the present settings unless it is None."""
        if self.steered and traces.finer.value is not None:
            with traces.finer(None):  # as in a call of its :class:`~.program.Program`
                return self._once(which, make)
        key = which, native.explicit_choice(), native.settings(), settings()[QUICKLY]
        if self._made.get(key) is None:
            self._made[key] = make()
        return self._made[key]

    def _natively(self, store: Store | None, compiles: bool) -> Compiled | native.Refusal | None:
        large = self.large or native.explicit_choice() == "native"
        quickly = settings()[QUICKLY] and not large  # Vectors would take several times the stack, which threads lack.
        place = place_in(store, self._describe(), "native", large, *native.identity())
        stored_program = None
        if place is not None and quickly:
            stored_program, place = place.find(), place.of_quick_code()
        if not compiles:
            return stored_program or (place and place.find())
        program = stored_program or self._obtain(place, lambda: self.traced.compile_natively(large, quickly, self.rows))
        if isinstance(program, native.Refusal):
            native.warn_if_chosen_by_name(program, self.name)
        return program

    def _by_xla(self, store: Store | None, natively: Any) -> Compiled | None:
        kept = store is not None and store.keeps_xla and not is_kept_by_jax()
        place = place_in(store, self._describe(), "xla", settings()[QUICKLY]) if kept else None
        if place is None and natively is None:
            return None
        program = self._obtain(place, self.traced.compile_by_xla)
        return program if isinstance(program, Compiled) else None

    def _describe(self) -> list[Any]:
        """Lists everything that determines its programs, besides the compiler."""
        takes = [(array.shape, array.dtype, array.weak_type) for array in self.takes]
        finer = traces.finer.value
        return [self.function, self.opaque, self.rows, takes, finer and (finer.tolerance, finer.steps)]

    def _obtain(self, place: Place | None, make: Callable[[], Any]) -> Compiled | native.Refusal:
        """Returns the program: loaded from the store, or compiled and written there."""

        def compile_now() -> Compiled | native.Refusal:
            with compiling():
                program = make()
            return program if isinstance(program, native.Refusal) else Compiled(program, self.result)

        return compile_now() if place is None else place.obtain(compile_now, len(self.takes))

    def program_of_rows(self, rows: tuple[bool, ...], count: int) -> native.Executable | None:
        """Returns the natively compiled program of this many rows, which XLA may call too, if there is one.

        - ``rows``: which arrays have rows as leading axis.
        """
        if any(rows) and count == 0:
            return None
        several = self.in_lanes and any(rows) and count > 1
        for computation in (*((self.block(rows),) if several else ()), self):
            natively = computation.natively(current.store())
            if isinstance(natively, Compiled) and natively.target is not None:
                return natively.executable
        return None

    def on_gpu(self, store: Store | None, compiles: bool = True) -> Compiled | native.Refusal | None:
        """Returns the program by which a GPU computes rows, each in a thread; otherwise like :meth:`natively`."""
        if native.current_choice() != "native" or not native.is_allowed_on_gpu():
            return None
        return self._once(("gpu", store), lambda: self._on_gpu(store, compiles))

    def _on_gpu(self, store: Store | None, compiles: bool) -> Compiled | native.Refusal | None:
        large = self.large or native.explicit_choice() == "native"
        place = place_in(store, self._describe(), "gpu", large, *native.identity_on_gpu())
        if not compiles:
            return place and place.find()
        try:
            program = self._obtain(place, lambda: self.traced.compile_for_gpu(large))
        except native.CudaError as error:  # which need not come again, so that no store keeps it
            program = native.Refusal(str(error))
        if isinstance(program, native.Refusal):
            native.warn_if_chosen_by_name(program, self.name)
        return program

    # Computations that follow from it

    @functools.cached_property
    def _followers(self) -> dict[Any, "Computation"]:
        return {}

    def _following(self, key: Any, make: Callable[[], "Computation"]) -> "Computation":
        if key not in self._followers:
            self._followers.setdefault(key, make())
        return self._followers[key]

    def _from_callable(self, function: Callable[[list[Any]], Any], arrays: Sequence[Any], gives: Sequence[Any]) -> Any:
        computation = Computation(
            function,
            arrays,
            name=self.name,
            large=self.large,
            in_lanes=self.in_lanes,
            together=self.together,
            opaque=self.opaque,
            steered=self.steered,
            gives=list(gives),
        )
        computation.is_derivative = self.is_derivative
        return computation

    def tangents(self, which: tuple[bool, ...]) -> "Computation":
        """Returns the computation of the tangents of the results that have some, from the arrays and the tangents of
        the arrays chosen by ``which``.
        """

        def make() -> Computation:
            moving = choose(self.takes, which)
            steered = self.steered and not self.is_derivative
            along = functools.partial(tangents_and_probe, self.smooth, which)
            # Of one direction the computation of several with the probe is the first.
            function = (
                functools.partial(first_of, along) if steered else functools.partial(tangents_of, self.smooth, which)
            )
            computation = self._from_callable(function, [*self.takes, *moving], list(filter(has_tangents, self.gives)))
            computation.linear, computation.is_derivative = (False,) * len(which) + (True,) * len(moving), True
            computation.along = along if steered else None
            return computation

        return self._following(("tangents", which), make)

    def beside_derivatives(self, which: tuple[bool, ...]) -> "Computation":
        """Returns the computation of the results that belong to derivatives by the arrays chosen by ``which``: where
        results list steps, those of the derivatives, to rounding; exactly so by :meth:`with_rates`.
        """
        return self._in_steps(in_steps_of_probe, which, ()) if self.by_steps else self

    def with_rates(self, which: tuple[bool, ...]) -> "Computation | None":
        """Returns the computation of the results, and of their derivatives by each number of the arrays chosen by
        ``which``; None where results do not list steps, or where these would be too many.

        Another computation of the derivatives has the same steps only to rounding, which the length of a step
        amplifies: from an error as small as rounding it follows with an error of 1e-5.
        """
        if not self.by_steps:
            return None
        count = sum(math.prod(array.shape) for array in choose(self.takes, which))
        rates = [in_rows(array, count) for array in self.gives if has_tangents(array)]
        if sum(math.prod(array.shape) * array.dtype.itemsize for array in rates) > MOST_RATES:
            return None
        return self._in_steps(results_and_rates, which, rates)

    def _in_steps(self, compute: Callable[..., list[Any]], which: tuple[bool, ...], more: Sequence[Any]) -> Any:
        def make() -> Computation:
            computation = self._from_callable(
                functools.partial(compute, self.smooth, which), self.takes, [*self.gives, *more]
            )
            computation.is_derivative = True  # whose own derivatives are of the same steps
            return computation

        return self._following((compute.__name__, which), make)

    def cotangents(self, which: tuple[bool, ...], of: tuple[bool, ...]) -> "Computation":
        """Returns the computation of the cotangents of the arrays chosen by ``which``, from all arrays and the
        cotangents of some results.

        - ``of``: which results, among those that have tangents.
        """

        def make() -> Computation:
            by_tangents = functools.partial(cotangents_by_tangents, self.smooth, which, of)
            going_back = functools.partial(cotangents_of, _Traced(self), which, of, self.steered)
            results = choose(list(filter(has_tangents, self.gives)), of)
            function = by_tangents if self.is_derivative else going_back
            computation = self._from_callable(function, [*self.takes, *results], choose(self.takes, which))
            computation.smooth = by_tangents
            computation.linear, computation.is_derivative = (False,) * len(which) + (True,) * len(results), True
            return computation

        return self._following(("cotangents", which, of), make)

    def directions(self, mapped: tuple[bool, ...], count: int) -> "Computation":
        """Returns this computation for ``count`` sets of the ``mapped`` arrays, which are linear, so that the rest is
        computed once.
        """

        def make() -> Computation:
            function, smooth = (functools.partial(in_directions, f, mapped) for f in (_Traced(self), self.smooth))
            if self.along is not None:
                function = functools.partial(self.along, mapped, count)
            takes = [in_rows(array, count) if many else array for array, many in zip(self.takes, mapped, strict=True)]
            computation = self._from_callable(function, takes, [in_rows(array, count) for array in self.gives])
            computation.smooth, computation.linear = smooth, self.linear
            return computation

        return self._following(("directions", mapped, count), make)

    def block(self, taken: tuple[bool, ...]) -> "Computation":
        """Returns this computation for a block of rows; ``taken`` says which arrays have them as leading axis."""

        def make() -> Computation:
            takes = [
                in_rows(array, ROWS_OF_BLOCK) if many else array for array, many in zip(self.takes, taken, strict=True)
            ]
            function = functools.partial(of_each_row, _Traced(self), taken)
            computation = self._from_callable(function, takes, [in_rows(array, ROWS_OF_BLOCK) for array in self.gives])
            computation.rows, computation.large = native.Rows(ROWS_OF_BLOCK, taken), True
            return computation

        return self._following(("block", taken), make)


class _Traced:
    """The function of a computation, which is not traced again."""

    follows = ("_computation",)  # what does not determine what it computes

    def __init__(self, computation: Computation):
        self._function, self._computation = computation.function, computation

    def __call__(self, arrays: list[Any]) -> list[Any]:
        return self._computation.here(arrays)


class _OfCaptures:
    """A traced function as one of arrays that it captured and of its arguments.

    - ``identities``: of all arrays that are passed as captures, some of which it uses.
    - ``constant``: whether there must be no derivatives of them, because rules within took them as constants.
    """

    def __init__(self, traced: Any, identities: list[int], constant: bool):
        self._constant = constant
        self._program: Program = traced.jaxpr
        self._places = [identities.index(id(array)) for array in captures(traced)]
        self._passed = len(identities)

    def __call__(self, arrays: list[Any]) -> list[Any]:
        captured = [arrays[place] for place in self._places]
        if self._constant:
            captured = without_captured_derivatives(captured)
        return evaluate(self._program, self._program.consts, [*captured, *arrays[self._passed :]])


def in_rows(one: Any, rows: int) -> jax.ShapeDtypeStruct:
    """Returns the type of this many rows of arrays of a type."""
    return jax.ShapeDtypeStruct((rows, *one.shape), one.dtype, weak_type=one.weak_type)
