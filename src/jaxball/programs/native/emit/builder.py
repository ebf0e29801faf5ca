"""One function as LLVM IR: numbers with constant folding, indices, memory, loops and branches."""

import contextlib
from collections.abc import Iterator

import numpy as np

from ..ir.elements import (
    COMPARED,
    FOLDED,
    Element,
    Index,
    Name,
    UnsupportedError,
    Vector,
    in_lanes,
    in_order,
    is_known,
    llvm_type,
    simpler_float,
    simpler_integer,
    width_of,
    write_element,
)
from ..ir.module import Module, Turn
from ..limits import ALIGNMENT
from ..targets.machine import multiplies_and_adds
from .instructions import BOOL, Instructions

INDEX = np.dtype(np.int64)


class Builder(Instructions):
    """Writes one function."""

    def __init__(self, module: Module):
        super().__init__(module)
        # The lanes in which memory changes, where not in all, and in how many blocks within each other that is said.
        self.mask: Vector | None = None
        self.level = 0
        self._ranges: dict[Name, tuple[int, int]] = {}  # of integers, the least and the greatest that they can be
        self._products: dict[Name, tuple[Element, Element]] = {}  # the factors of each

    # Numbers

    def convert(self, operation: str, source: np.dtype, target: np.dtype, x: Element) -> Name:
        """Writes an instruction that converts a number to another type."""
        name = self.cast(operation, source, target, x)
        bounds = self.range_of(x) if source.kind == "i" == target.kind else None
        if bounds and np.iinfo(target).min <= bounds[0] and bounds[1] <= np.iinfo(target).max:
            self.note_bounds(name, bounds)
        return name

    def note_bounds(self, name: Name, bounds: tuple[int, int] | None) -> None:
        """Records the bounds of an integer, from here on; None: that they are no longer known."""
        if bounds is None:
            self._ranges.pop(name, None)
        else:
            self._ranges[name] = bounds

    def range_of(self, x: Element) -> tuple[int, int] | None:
        """Returns the bounds of an integer, if known."""
        if isinstance(x, str):
            return self._ranges.get(x)
        return (int(x), int(x)) if isinstance(x, np.signedinteger | int) else None

    def binary(self, operation: str, dtype: np.dtype, x: Element, y: Element) -> Element:
        """Computes add, sub, mul and div of any type (integers' div apart); and, or, xor of integers and booleans."""
        # NumPy rounds as the processor does.
        if is_known(x) and is_known(y) and operation in FOLDED:
            with np.errstate(all="ignore"):
                return dtype.type(FOLDED[operation](x, y))
        if dtype.kind == "f":
            if simpler := simpler_float(operation, x, y):
                return simpler
            if operation == "mul":
                product = self.apply("fmul", dtype, *in_order(x, y))
                # Remembered, not written as a product with a sum: whether one follows, only the next operations tell.
                self._products[product] = x, y
                return product
            if fused := self._fuse(operation, dtype, x, y):
                return fused
            if operation == "add":
                x, y = in_order(x, y)
            return self.apply(f"f{operation}", dtype, x, y)
        simpler = simpler_integer(operation, dtype, x, y)
        if simpler is not None:
            return simpler
        return self.apply(operation, dtype, x, y)

    def negative(self, dtype: np.dtype, x: Element) -> Element:
        """Computes −x of a float."""
        return -x if is_known(x) else self.apply("fneg", dtype, x)

    def _fuse(self, operation: str, dtype: np.dtype, x: Element, y: Element) -> Name | None:
        """Writes a sum or a difference with a product as one term, rounded once; returns None without such a term.

        LLVM may fuse them as well, but only when it optimises, and as what surrounds them suggests: written here, they
        give the same bits however a program is compiled.
        """
        if operation == "div" or (isinstance(x, str) and x == y) or not multiplies_and_adds():
            return None
        for term, other in ((x, y), (y, x)):
            if term not in self._products:
                continue
            factor, number = self._products[term]
            if operation == "sub" and term is x:
                other = self.negative(dtype, other)
            elif operation == "sub":
                factor = self.negative(dtype, factor)
            return self.call("llvm.fma", dtype, *in_order(factor, number), other)
        return None

    def compare(self, predicate: str, dtype: np.dtype, x: Element, y: Element) -> Element:
        """Compares two numbers by LLVM's ``predicate``: ``olt``, ``une`` of floats, ``slt``, ``ult``, ``eq`` of
        integers.
        """
        kind = "fcmp" if dtype.kind == "f" else "icmp"
        if is_known(x) and is_known(y) and predicate in COMPARED:
            return np.bool_(COMPARED[predicate](x, y))
        # Only what JAX writes to wrap negative indices and to clamp slices: i < 0, and i ≥ n.
        x_range, y_range = self.range_of(x), self.range_of(y)
        if predicate not in ("slt", "sge") or x_range is None or y_range is None:
            return self.apply(f"{kind} {predicate}", dtype, x, y)
        if x_range[1] < y_range[0] or x_range[0] >= y_range[1]:
            return np.bool_((x_range[1] < y_range[0]) == (predicate == "slt"))
        return self.apply(f"{kind} {predicate}", dtype, x, y)

    def select(self, dtype: np.dtype, condition: Element, x: Element, y: Element) -> Element:
        """Returns x where the condition holds, else y; no complex numbers."""
        if is_known(condition):
            return x if condition else y
        # By its text, because equal numbers of floats include 0 and −0.
        if write_element(x) == write_element(y):
            return x
        name = self.choose(dtype, condition, x, y)
        if dtype.kind == "i" and (x_range := self.range_of(x)) and (y_range := self.range_of(y)):
            self.note_bounds(name, (min(x_range[0], y_range[0]), max(x_range[1], y_range[1])))
        return name

    def call(
        self,
        function: str,
        dtype: np.dtype,
        *operands: Element,
        to: np.dtype | None = None,
        flags: str = "",
        attributes: str = "memory(none)",
    ) -> Name:
        """Calls a function of LLVM's or of C's library with numbers of one type, which gives one of that or of type
        ``to``.

        It is written once for equal operands. LLVM's take vectors as well, C's are called for one lane after another.
        ``flags``: one more operand of an intrinsic.
        """
        if function.startswith("llvm."):
            return self.intrinsic(function, dtype, *operands, to=to, flags=flags)
        result, wide = to or dtype, width_of(*operands)
        if wide:
            rows = ([self.lane(dtype, x, lane) for x in operands] for lane in range(wide))
            calls = [self.call(function, dtype, *row, to=to, attributes=attributes) for row in rows]
            return self.gather(result, calls, wide)
        operand_type, result_type = llvm_type(dtype), llvm_type(result)
        head = f"declare {result_type} @{function}({', '.join([operand_type] * len(operands))})"
        self.module.declared.setdefault(f"@{function}", f"{head} nounwind willreturn {attributes}")
        numbers = ", ".join(f"{operand_type} {self.operand(dtype, x)}" for x in operands)
        return self.pure(f"call {result_type} @{function}({numbers})")

    # Indices, of 64 bits

    def plus(self, i: Index, j: Index) -> Index:
        if isinstance(i, int) and isinstance(j, int):
            return i + j
        if i == 0:
            return j
        return i if j == 0 else self.apply("add nsw", INDEX, i, j)

    def times(self, i: Index, factor: Index) -> Index:
        if isinstance(i, int) and isinstance(factor, int):
            return i * factor
        if i == 0 or factor == 0:
            return 0
        if i == 1:
            return factor
        return i if factor == 1 else self.apply("mul nsw", INDEX, i, factor)

    def within(self, i: Index, low: Index, high: Index) -> Element:
        """Returns whether low ≤ i < high."""
        if all(isinstance(number, int) for number in (i, low, high)):
            return np.bool_(low <= i < high)  # type: ignore[operator]
        return self.apply("and", BOOL, self.apply("icmp sge", INDEX, i, low), self.apply("icmp slt", INDEX, i, high))

    def clamp(self, i: Index, high: int) -> Index:
        """Returns the index in [0, high] that is next to i."""
        if isinstance(i, int):
            return min(max(i, 0), high)
        if high == 0:
            return 0
        # A counter of a loop over the array needs no clamp, which would keep LLVM from seeing how its addresses follow.
        least, greatest = self.range_of(i) or (-1, high + 1)
        if least >= 0 and greatest <= high:
            return i
        i = self.select(INDEX, self.apply("icmp slt", INDEX, i, 0), 0, i)
        return self.select(INDEX, self.apply("icmp sgt", INDEX, i, high), high, i)

    def as_index(self, element: Element, dtype: np.dtype) -> Index:
        """Returns an integer as an index."""
        if is_known(element):
            return int(element)
        if dtype.itemsize == 8:
            return element
        return self.convert("zext" if dtype.kind in "ub" else "sext", dtype, INDEX, element)

    # Memory

    def address(self, base: Name, offset: Index) -> Name:
        """Returns an address ``offset`` bytes behind another."""
        return base if offset == 0 else self.pure(f"getelementptr i8, ptr {base}, i64 {self.operand(INDEX, offset)}")

    def allocate(self, size: int) -> Name:
        """Allocates memory of ``size`` bytes, which belongs to the function while it runs."""
        name = self._new_name()
        if size <= self.module.target.most_on_stack:
            self._allocated.append(f"{name} = alloca [{size} x i8], align {ALIGNMENT}")
            return name
        # A static place for each array, also in loops: a buffer made within a loop is the same one in every turn.
        offset = self.module.workspace
        self.module.workspace += -(-size // ALIGNMENT) * ALIGNMENT
        self._allocated.append(f"{name} = getelementptr i8, ptr %workspace, i64 {offset}")
        return name

    def copy(self, target: Name, source: Name, size: int) -> None:
        """Copies ``size`` bytes from one place to another."""
        name = "@llvm.memcpy.p0.p0.i64"
        self.module.declared.setdefault(name, f"declare void {name}(ptr, ptr, i64, i1)")
        if target != source and size:
            self.write(f"call void {name}(ptr align 8 {target}, ptr align 8 {source}, i64 {size}, i1 false)")

    # Scopes, branches and loops

    def scope(self) -> contextlib.AbstractContextManager[None]:
        """Makes values computed in this Python block unknown after it, because it may not have been executed."""
        return self._scopes.scope()

    @contextlib.contextmanager
    def write_loop(self) -> Iterator[None]:
        """Makes the instructions written in this Python block a loop, preceded by its invariants."""
        with self._scopes.write_loop(self.reserve()) as loop:
            yield
        self.fill(loop.place, "\n".join(loop.before))

    def new_label(self, name: str) -> str:
        self._count += 1
        return f"{name}.{self._count}"

    @contextlib.contextmanager
    def loop(self, start: Index, end: Index, *carried: tuple[np.dtype, Element]) -> Iterator["Turn"]:
        """Writes a loop over indices from start to before end, at least one of them.

        ``carried``: numbers with which it begins; the block of Python sets ``following`` of the turn, with which the
        next one begins, and which are the loop's results after it.
        """
        before, body, after = self.label, self.new_label("loop"), self.new_label("end")
        carried = tuple((dtype, first) for dtype, first in carried)
        with self.write_loop(), self.scope():
            self.jump(body)
            self.begin(body)
            turn = Turn(self.fresh(), [self.fresh(in_lanes(first)) for _, first in carried])
            # What a phi is given by the last turn has no name yet.
            places = [self.reserve() for _ in (turn.index, *carried)]
            cost = self.cost
            yield turn
            following = [
                self.like(dtype, new, name)
                for (dtype, _), new, name in zip(carried, turn.following, turn.carried, strict=True)
            ]
            index = self.effect(f"add nuw nsw i64 {turn.index}, 1")
            self.branch(self.effect(f"icmp slt i64 {index}, {self.operand(INDEX, end)}"), body, after)
        # Otherwise one turn counts: the cost only says how often to look for signals.
        if isinstance(start, int) and isinstance(end, int):
            self.cost = cost + (self.cost - cost) * (end - start)
        self.fill_phi(places[0], turn.index, INDEX, [(start, before), (index, self.label)])
        rows = zip(places[1:], turn.carried, carried, following, strict=True)
        for place, name, (dtype, first), new in rows:
            self.fill_phi(place, name, dtype, [(first, before), (new, self.label)])
        self.begin(after)

    def like(self, dtype: np.dtype, x: Element, name: Name) -> Element:
        """Returns the element, as a vector where the name stands for one.

        **Raises:** ``UnsupportedError`` for a vector where the name stands for a single number.
        """
        if isinstance(name, Vector):
            return self.spread(dtype, x)
        if isinstance(x, Vector):
            raise UnsupportedError("A number that becomes one of each lane")
        return x

    @contextlib.contextmanager
    def where(self, condition: Element) -> Iterator[None]:
        """Makes the instructions written in this Python block be executed where the condition holds; in lanes, by
        masks.
        """
        if is_known(condition) and condition:
            yield
            return
        if isinstance(condition, Vector):
            with self.mask_writes(condition):
                yield
            return
        # The block that is never entered is written all the same: whoever writes it counts on the names in it.
        condition = "false" if is_known(condition) else condition
        yes, after = self.new_label("then"), self.new_label("after")
        self.branch(condition, yes, after)
        self.begin(yes)
        with self.scope():
            yield
            self.jump(after)
        self.begin(after)

    @contextlib.contextmanager
    def mask_writes(self, condition: Vector) -> Iterator[Vector]:
        """Makes the instructions written in this Python block change older memory only in the lanes of the condition.

        Yields the lanes: those of the condition within those of the block around this one.
        """
        around = self.mask
        self.mask = condition if around is None else Vector(self.apply("and", BOOL, condition, around))
        self.level += 1
        try:
            yield self.mask
        finally:
            self.mask, self.level = around, self.level - 1
