"""LLVM IR as text, one instruction at a time: constant folding, common subexpressions, loops and branches.

A pure instruction is found again by its text, in the scope in which it was written or one within it, and is placed
before loops in which it is invariant (:mod:`scopes`). Writing text is faster than building objects, and LLVM's parser
reads 20,000 lines in 20 ms.
"""

import contextlib
from collections.abc import Iterator, Sequence

import numpy as np

from .elements import (
    LANES,
    Element,
    Index,
    Lanes,
    Name,
    UnsupportedError,
    in_lanes,
    is_known,
    llvm_type,
    vector_type,
    width_of,
    with_lanes,
    written,
)
from .folding import COMPARED, FOLDED, read, simpler_float, simpler_integer, suffix
from .machine import multiplies_and_adds
from .module import ALIGNMENT, MOST_LINES, Module
from .scopes import Scopes, Turn

_ON_THE_STACK = 4096  # bytes of an array; larger ones are in the workspace

INDEX, BOOL = np.dtype(np.int64), np.dtype(bool)


class Builder:
    """Writes one function. ``label`` is the block that is being written."""

    def __init__(self, module: Module):
        self.module = module
        self.label = "entry"
        self._allocated: list[str] = []
        self._lines: list[str] = []
        self.cost = 0  # instructions executed by one run, including loops
        # The lanes in which memory changes, where not in all, and in how many blocks within each other that is said.
        self.mask: Lanes | None = None
        self.level = 0
        self._count = 0
        self._scopes = Scopes()
        self._ranges: dict[Name, tuple[int, int]] = {}  # of integers, the least and the greatest that they can be
        self._loaded: set[Name] = set()
        self._products: dict[Name, tuple[Element, Element]] = {}  # the factors of each
        self._vectors: dict[Name, tuple[np.dtype, int]] = {}  # type and width of those whose lanes have names

    def function(self, head: str) -> str:
        """The function's text. ``head``: its result, name and parameters."""
        lines = [*self._allocated, *self._lines]
        if self._vectors:
            lines = with_lanes("\n".join(lines), self._vectors)
        return "\n".join([f"define {head} {{", "entry:", *lines, "}"])

    @property
    def lines(self) -> int:
        """How many instructions have been written."""
        return len(self._lines)

    def write(self, line: str) -> None:
        """An instruction without a result."""
        self._lines.append(line)
        self.cost += 1
        self._count_line()

    def _count_line(self) -> None:
        self.module.lines += 1
        if self.module.lines > MOST_LINES:
            raise UnsupportedError(f"A program of more than {MOST_LINES:,} instructions")

    def effect(self, instruction: str, wide: int = 0) -> Name:
        """An instruction with an effect besides its result: a memory read, a call. ``wide``: its lanes, of a vector."""
        name = self.fresh(wide)
        self.write(f"{name} = {instruction}")
        return name

    def loaded(self, kind: str, address: Name, wide: int = 0) -> Name:
        """A number, or a vector, in memory."""
        name = self.effect(f"load {kind}, ptr {address}", wide)
        self._loaded.add(name)
        return name

    def is_loaded(self, element: Element) -> bool:
        """Whether a number was read from memory and nothing was computed of it yet."""
        return element in self._loaded

    def pure(self, instruction: str, wide: int = 0) -> Name:
        """A pure instruction, which cannot fail. ``wide``: its lanes, of a vector."""
        scopes = self._scopes
        name = scopes.found(instruction)
        if name is not None:
            return name
        home = scopes.home(instruction)
        if home is scopes.loop:
            name = self.effect(instruction, wide)
            scopes.note(instruction, name, scopes.loop)
            return name
        first = scopes.loop
        assert first is not None
        while first.outer is not home:
            first = first.outer
            assert first is not None
        name = self._unused(wide)
        scopes.name(name, home)
        scopes.note(instruction, name, home)
        first.before.append(f"{name} = {instruction}")
        self._count_line()
        return name

    def fresh(self, wide: int = 0) -> Name:
        name = self._unused(wide)
        self._scopes.name(name, self._scopes.loop)
        return name

    def _unused(self, wide: int = 0) -> Name:
        self._count += 1
        name = f"%v{self._count}"
        return Lanes(name, LANES if wide is True else wide) if wide else name

    # Lanes

    def operand(self, dtype: np.dtype, x: Element, wide: int) -> str:
        """An element as an operand; ``wide``: as a vector, in which all lanes are the same if x is not a vector."""
        if not wide or isinstance(x, Lanes):
            return written(x)
        return f"splat ({llvm_type(dtype)} {written(x)})" if is_known(x) else self.spread(dtype, x, wide)

    def spread(self, dtype: np.dtype, x: Element, width: int = LANES) -> Element:
        """A vector in which all lanes have the same number, or the vector that x is already."""
        if isinstance(x, Lanes):
            return x
        kind = vector_type(dtype, width)
        if is_known(x):
            numbers = f"{kind} splat ({llvm_type(dtype)} {written(x)})"
            return self.pure(f"select i1 true, {numbers}, {kind} poison", width)
        first = self.pure(f"insertelement {kind} poison, {llvm_type(dtype)} {x}, i64 0")
        return self.pure(f"shufflevector {kind} {first}, {kind} poison, <{width} x i32> zeroinitializer", width)

    def lane(self, dtype: np.dtype, x: Element, lane: int) -> Element:
        """The number of one lane."""
        return self.pure(f"extractelement {vector_type(dtype, x.width)} {x}, i64 {lane}") if in_lanes(x) else x

    def lanes_of(self, dtype: np.dtype, x: Element, count: int) -> list[Element]:
        """The numbers of the first lanes, by names; those that something reads are taken out of the vector."""
        if not isinstance(x, Lanes):
            return [x] * count
        if x.startswith("<"):  # of known numbers, which an operation left as they are
            numbers = [number.split()[1] for number in x[1:-1].split(", ")]
            return [read(dtype, number) for number in numbers[:count]]
        self._vectors[x] = dtype, x.width
        return [f"{x}.{lane}" for lane in range(count)]

    def vector_of(self, lane: Element) -> Lanes | None:
        """The vector of which a name is that of a lane."""
        vector = written(lane).partition(".")[0]
        return Lanes(vector, self._vectors[vector][1]) if vector in self._vectors else None

    def shuffled(self, dtype: np.dtype, x: Lanes, y: Lanes | None, lanes: Sequence[int]) -> Lanes:
        """A vector of lanes of one vector, or of two, of which those of the second are numbered from its width on."""
        kind, places = vector_type(dtype, x.width), ", ".join(f"i32 {lane}" for lane in lanes)
        other = f"{kind} {'poison' if y is None else y}"
        return Lanes(
            self.pure(f"shufflevector {kind} {x}, {other}, <{len(lanes)} x i32> <{places}>", len(lanes)), len(lanes)
        )

    def gathered(self, dtype: np.dtype, numbers: Sequence[Element], width: int = LANES) -> Lanes:
        """A vector of the numbers of the lanes."""
        vector: Name = "poison"
        for lane, number in enumerate(numbers):
            item = f"{llvm_type(dtype)} {written(number)}"
            vector = self.pure(f"insertelement {vector_type(dtype, width)} {vector}, {item}, i64 {lane}", width)
        return Lanes(vector, width)

    def is_same_in_every_turn(self, element: Element) -> bool:
        """Whether a number is computed before the innermost loop that is being written."""
        return is_known(element) or self._scopes.home(element) is not self._scopes.loop

    def any_lane(self, condition: Element) -> Element:
        """Whether a condition holds in any of the lanes."""
        if not isinstance(condition, Lanes):
            return condition
        name, kind = f"@llvm.vector.reduce.or.v{LANES}i1", vector_type(BOOL)
        self.module.declared.setdefault(name, f"declare i1 {name}({kind})")
        return self.pure(f"call i1 {name}({kind} {condition})")

    def apply(self, operation: str, dtype: np.dtype, *operands: Element) -> Name:
        """An instruction on numbers of one type, on vectors where one of them is one."""
        wide = width_of(*operands)
        kind = vector_type(dtype, wide)
        numbers = ", ".join(self.operand(dtype, x, wide) for x in operands)
        return self.pure(f"{operation} {kind} {numbers}", wide)

    def converted(self, operation: str, source: np.dtype, target: np.dtype, x: Element) -> Name:
        """An instruction that makes a number of another type."""
        wide = width_of(x)
        old, new = (vector_type(kind, wide) for kind in (source, target))
        name = self.pure(f"{operation} {old} {written(x)} to {new}", wide)
        bounds = self.range_of(x) if source.kind == "i" == target.kind else None
        if bounds and np.iinfo(target).min <= bounds[0] and bounds[1] <= np.iinfo(target).max:
            self.bound(name, bounds)
        return name

    # Numbers

    def bound(self, name: Name, bounds: tuple[int, int] | None) -> None:
        """Records the bounds of an integer, from here on; None: that they are no longer known."""
        if bounds is None:
            self._ranges.pop(name, None)
        else:
            self._ranges[name] = bounds

    def range_of(self, x: Element) -> tuple[int, int] | None:
        """The bounds of an integer, if known."""
        if isinstance(x, str):
            return self._ranges.get(x)
        return (int(x), int(x)) if isinstance(x, np.signedinteger | int) else None

    def binary(self, operation: str, dtype: np.dtype, x: Element, y: Element) -> Element:
        """add, sub, mul and div of any type (integers' div apart); and, or, xor of integers and booleans."""
        if is_known(x) and is_known(y) and operation in FOLDED:
            with np.errstate(all="ignore"):
                return dtype.type(FOLDED[operation](x, y))
        if dtype.kind == "f":
            if simpler := simpler_float(operation, x, y):
                return simpler
            if operation == "mul":
                return self._product(dtype, x, y)
            return self._fused(operation, dtype, x, y) or self.apply(f"f{operation}", dtype, x, y)
        simpler = simpler_integer(operation, dtype, x, y)
        if simpler is not None:
            return simpler
        return self.apply(operation, dtype, x, y)

    def negative(self, dtype: np.dtype, x: Element) -> Element:
        """−x of a float."""
        return -x if is_known(x) else self.apply("fneg", dtype, x)

    def _product(self, dtype: np.dtype, x: Element, y: Element) -> Name:
        name = self.apply("fmul", dtype, x, y)
        self._products[name] = x, y
        return name

    def _fused(self, operation: str, dtype: np.dtype, x: Element, y: Element) -> Name | None:
        """A sum or a difference with a product as one term, rounded once; None without such a term.

        LLVM may fuse them as well, but only when it optimises, and as what surrounds them suggests: written here, they
        give the same bits however a program is compiled.
        """
        if operation == "div" or (isinstance(x, str) and x == y) or not multiplies_and_adds():
            return None
        for term, other in ((x, y), (y, x)):
            if term not in self._products or width_of(term) != width_of(x, y):
                continue
            factor, number = self._products[term]
            if operation == "sub" and term is x:
                other = self.negative(dtype, other)
            elif operation == "sub":
                factor = self.negative(dtype, factor)
            return self.call("llvm.fma", dtype, factor, number, other)
        return None

    def compare(self, predicate: str, dtype: np.dtype, x: Element, y: Element) -> Element:
        """``predicate`` is LLVM's: ``olt``, ``une`` of floats, ``slt``, ``ult``, ``eq`` of integers."""
        kind = "fcmp" if dtype.kind == "f" else "icmp"
        if is_known(x) and is_known(y) and predicate in COMPARED:
            return np.bool_(COMPARED[predicate](x, y))
        one, other = self.range_of(x), self.range_of(y)
        if predicate not in ("slt", "sge") or one is None or other is None:
            return self.apply(f"{kind} {predicate}", dtype, x, y)
        if one[1] < other[0] or one[0] >= other[1]:
            return np.bool_((one[1] < other[0]) == (predicate == "slt"))
        return self.apply(f"{kind} {predicate}", dtype, x, y)

    def select(self, dtype: np.dtype, condition: Element, x: Element, y: Element) -> Element:
        """x where the condition holds, else y; no complex numbers."""
        if is_known(condition):
            return x if condition else y
        if written(x) == written(y):
            return x
        wide = width_of(condition, x, y)
        kind = vector_type(dtype, wide)
        choice = f"{vector_type(BOOL, width_of(condition))} {condition}"
        first, second = (f"{kind} {self.operand(dtype, number, wide)}" for number in (x, y))
        name = self.pure(f"select {choice}, {first}, {second}", wide)
        if dtype.kind == "i" and (one := self.range_of(x)) and (other := self.range_of(y)):
            self.bound(name, (min(one[0], other[0]), max(one[1], other[1])))
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
        """A function of LLVM's or of C's library of numbers of one type, which gives one of that or of type ``to``.

        It is written once for equal operands. LLVM's take vectors as well, C's are called for one lane after another.
        ``flags``: one more operand of an intrinsic.
        """
        intrinsic, result, wide = function.startswith("llvm."), to or dtype, width_of(*operands)
        if wide and not intrinsic:
            rows = ([self.lane(dtype, x, lane) for x in operands] for lane in range(wide))
            calls = [self.call(function, dtype, *row, to=to, attributes=attributes) for row in rows]
            return self.gathered(result, calls, wide)
        given, gives = (vector_type(kind, wide) for kind in (dtype, result))
        name = f"@{function}"
        if intrinsic:
            types = (result, dtype) if to is not None else (dtype,)
            name += "".join(f".v{wide}{suffix(kind)}" if wide else f".{suffix(kind)}" for kind in types)
        kinds = ", ".join(filter(None, [*[given] * len(operands), flags.partition(" ")[0]]))
        end = "" if intrinsic else f" nounwind willreturn {attributes}"
        self.module.declared.setdefault(name, f"declare {gives} {name}({kinds}){end}")
        numbers = [f"{given} {self.operand(dtype, x, wide)}" for x in operands]
        return self.pure(f"call {gives} {name}({', '.join(filter(None, [*numbers, flags]))})", wide)

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
        """Whether low ≤ i < high."""
        if all(isinstance(number, int) for number in (i, low, high)):
            return np.bool_(low <= i < high)  # type: ignore[operator]
        return self.apply("and", BOOL, self.apply("icmp sge", INDEX, i, low), self.apply("icmp slt", INDEX, i, high))

    def clamped(self, i: Index, high: int) -> Index:
        """The index in [0, high] that is next to i."""
        if isinstance(i, int):
            return min(max(i, 0), high)
        if high == 0:
            return 0
        least, greatest = self.range_of(i) or (-1, high + 1)
        if least >= 0 and greatest <= high:
            return i
        i = self.select(INDEX, self.apply("icmp slt", INDEX, i, 0), 0, i)
        return self.select(INDEX, self.apply("icmp sgt", INDEX, i, high), high, i)

    def as_index(self, element: Element, dtype: np.dtype) -> Index:
        """An integer as an index."""
        if is_known(element):
            return int(element)
        if dtype.itemsize == 8:
            return element
        return self.converted("zext" if dtype.kind in "ub" else "sext", dtype, INDEX, element)

    # Memory

    def address(self, base: Name, offset: Index) -> Name:
        """An address so many bytes behind another."""
        return base if offset == 0 else self.pure(f"getelementptr i8, ptr {base}, i64 {offset}")

    def allocate(self, size: int) -> Name:
        """Memory of so many bytes, which belongs to the function while it runs."""
        name = self._unused()
        if size <= _ON_THE_STACK:
            self._allocated.append(f"{name} = alloca [{size} x i8], align {ALIGNMENT}")
            return name
        offset = self.module.workspace
        self.module.workspace += -(-size // ALIGNMENT) * ALIGNMENT
        self._allocated.append(f"{name} = getelementptr i8, ptr %workspace, i64 {offset}")
        return name

    def copy(self, target: Name, source: Name, size: int) -> None:
        """So many bytes from one place to another."""
        name = "@llvm.memcpy.p0.p0.i64"
        self.module.declared.setdefault(name, f"declare void {name}(ptr, ptr, i64, i1)")
        if target != source and size:
            self.write(f"call void {name}(ptr align 8 {target}, ptr align 8 {source}, i64 {size}, i1 false)")

    # Scopes, branches and loops

    def scope(self) -> contextlib.AbstractContextManager[None]:
        """Values computed in this Python block are unknown after it, because it may not have been executed."""
        return self._scopes.scope()

    @contextlib.contextmanager
    def looped(self) -> Iterator[None]:
        """The instructions written in this Python block are a loop, preceded by its invariants."""
        with self._scopes.looped(self.reserve()) as loop:
            yield
        self.fill(loop.place, "\n".join(loop.before))

    def new_label(self, name: str) -> str:
        self._count += 1
        return f"{name}.{self._count}"

    def begin(self, label: str) -> None:
        """Begins the block with that label."""
        self._lines.append(f"{label}:")
        self.label = label

    def jump(self, label: str) -> None:
        self.write(f"br label %{label}")

    def branch(self, condition: Element, yes: str, no: str) -> None:
        self.write(f"br i1 {written(condition)}, label %{yes}, label %{no}")

    def reserve(self) -> int:
        """A place for a line that is written later, by :meth:`fill`."""
        self._lines.append("")
        return len(self._lines) - 1

    def fill(self, place: int, line: str) -> None:
        self._lines[place] = line

    @contextlib.contextmanager
    def loop(self, start: Index, end: Index, *carried: tuple[np.dtype, Element]) -> Iterator["Turn"]:
        """A loop over indices from start to before end, at least one of them.

        ``carried``: numbers with which it begins; the block of Python sets ``following`` of the turn, with which the
        next one begins, and which are the loop's results after it.
        """
        before, body, after = self.label, self.new_label("loop"), self.new_label("end")
        carried = tuple((dtype, first) for dtype, first in carried)
        with self.looped(), self.scope():
            self.jump(body)
            self.begin(body)
            turn = Turn(self.fresh(), [self.fresh(in_lanes(first)) for _, first in carried])
            places = [self.reserve() for _ in (turn.index, *carried)]
            cost = self.cost
            yield turn
            following = [
                self.like(dtype, new, name)
                for (dtype, _), new, name in zip(carried, turn.following, turn.carried, strict=True)
            ]
            index = self.effect(f"add nuw nsw i64 {turn.index}, 1")
            self.branch(self.effect(f"icmp slt i64 {index}, {end}"), body, after)
        if isinstance(start, int) and isinstance(end, int):
            self.cost = cost + (self.cost - cost) * (end - start)
        self.fill_phi(places[0], turn.index, INDEX, [(start, before), (index, self.label)])
        rows = zip(places[1:], turn.carried, carried, following, strict=True)
        for place, name, (dtype, first), new in rows:
            self.fill_phi(place, name, dtype, [(first, before), (new, self.label)])
        self.begin(after)

    def like(self, dtype: np.dtype, x: Element, name: Name) -> Element:
        """The element, as a vector where the name stands for one.

        **Raises:** ``UnsupportedError`` for a vector where the name stands for a single number.
        """
        if isinstance(name, Lanes):
            return self.spread(dtype, x)
        if isinstance(x, Lanes):
            raise UnsupportedError("A number that becomes one of each lane")
        return x

    @contextlib.contextmanager
    def where(self, condition: Element) -> Iterator[None]:
        """The instructions written in this Python block are executed where the condition holds; in lanes, by masks."""
        if is_known(condition) and condition:
            yield
            return
        if isinstance(condition, Lanes):
            with self.masked(condition):
                yield
            return
        condition = "false" if is_known(condition) else condition
        yes, after = self.new_label("then"), self.new_label("after")
        self.branch(condition, yes, after)
        self.begin(yes)
        with self.scope():
            yield
            self.jump(after)
        self.begin(after)

    @contextlib.contextmanager
    def masked(self, condition: Lanes) -> Iterator[Lanes]:
        """The instructions written in this Python block change older memory only in the lanes of the condition.

        Yields the lanes: those of the condition within those of the block around this one.
        """
        around = self.mask
        self.mask = condition if around is None else Lanes(self.apply("and", BOOL, condition, around))
        self.level += 1
        try:
            yield self.mask
        finally:
            self.mask, self.level = around, self.level - 1

    def fill_phi(self, place: int, name: Name, dtype: np.dtype, cases: Sequence[tuple[Element, str]]) -> None:
        """Writes, at a place that was reserved, that a name is the number that the block before gives."""
        wide = width_of(name)
        kind = vector_type(dtype, wide)
        ways = ", ".join(f"[ {self.operand(dtype, element, wide)}, %{label} ]" for element, label in cases)
        self.fill(place, f"{name} = phi {kind} {ways}")

    def phi(self, dtype: np.dtype, cases: Sequence[tuple[Element, str]]) -> Element:
        """The number that the block before this one gives; a vector where one of them is, and then so must all be that
        are not known.
        """
        texts = [written(element) for element, _ in cases]
        if len(set(texts)) == 1 and all(is_known(element) for element, _ in cases):
            return cases[0][0]
        name, place = self.fresh(in_lanes(*(element for element, _ in cases))), self.reserve()
        self.fill_phi(place, name, dtype, cases)
        return name
