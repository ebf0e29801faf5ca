"""LLVM IR as text, one instruction at a time, with common subexpressions found, in single numbers and in vectors.

A pure instruction is found again by its text, in the scope in which it was written or one within it, and is placed
before loops in which it is invariant (:class:`~.module.Scopes`). Writing text is faster than building objects, and
LLVM's parser reads 20,000 lines in 20 ms.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from ..ir.elements import (
    Element,
    Lane,
    Name,
    Vector,
    in_lanes,
    is_known,
    llvm_type,
    read_element,
    suffix_of,
    vector_type,
    width_of,
    write_element,
)
from ..ir.module import Module, Scopes
from ..limits import LANES

BOOL = np.dtype(bool)


class Instructions:
    """The instructions of one function, those of vectors too. ``label`` is the block that is being written."""

    def __init__(self, module: Module):
        self.module = module
        self.label = "entry"
        self._allocated: list[str] = []
        self._lines: list[str] = []
        self.cost = 0  # instructions executed by one run, including loops
        self._count = 0
        self._scopes = Scopes()
        self._loaded: set[Name] = set()
        # Of the vectors whose lanes are elements: the type, and the lanes that instructions read.
        self._lanes: dict[Name, tuple[str, set[int]]] = {}

    def function(self, head: str) -> str:
        """Returns the function's text. ``head``: its result, name and parameters."""
        lines = [*self._allocated, *self._lines]
        return "\n".join([f"define {head} {{", "entry:", *self._take_lanes(lines), "}"])

    @property
    def lines(self) -> int:
        """How many instructions have been written."""
        return len(self._lines)

    def write(self, line: str) -> None:
        """Writes an instruction without a result."""
        self._lines.append(line)
        self.cost += 1
        self.module.count_line()

    def effect(self, instruction: str, wide: int = 0) -> Name:
        """Writes an instruction with an effect besides its result: a memory read, a call. ``wide``: its lanes, of a
        vector.
        """
        name = self.fresh(wide)
        self.write(f"{name} = {instruction}")
        return name

    def load(self, kind: str, address: Name, wide: int = 0) -> Name:
        """Loads a number, or a vector, from memory."""
        # Not found again by its text: the same address may hold another number by then.
        name = self.effect(f"load {kind}, ptr {address}", wide)
        self._loaded.add(name)
        return name

    def is_loaded(self, element: Element) -> bool:
        """Returns whether a number was read from memory and nothing was computed from it yet."""
        return element in self._loaded

    def pure(self, instruction: str, wide: int = 0) -> Name:
        """Writes a pure instruction, which cannot fail. ``wide``: its lanes, of a vector."""
        scopes = self._scopes
        # A name is given once, so equal texts are equal numbers.
        name = scopes.find(instruction)
        if name is not None:
            return name
        name = self._new_name(wide)
        ahead_of = scopes.note(instruction, name)
        if ahead_of is None:
            self.write(f"{name} = {instruction}")
        else:
            ahead_of.before.append(f"{name} = {instruction}")
            self.module.count_line()
        return name

    def fresh(self, wide: int = 0) -> Name:
        name = self._new_name(wide)
        self._scopes.name(name)
        return name

    def _new_name(self, wide: int = 0) -> Name:
        self._count += 1
        name = f"%v{self._count}"
        return Vector(name, LANES if wide is True else wide) if wide else name

    # Lanes

    def operand(self, dtype: np.dtype, x: Element, wide: int = 0) -> str:
        """Writes an element as an operand; ``wide``: as a vector, in which all lanes are the same if x is not a vector.

        Every element that an instruction reads is written by this method, which notes the lanes among them.
        """
        if isinstance(x, Vector):
            return x
        if not wide:
            if not isinstance(x, str):
                return write_element(x)
            if isinstance(x, Lane):
                self._lanes[x.vector][1].add(x.position)
            return x
        return f"splat ({llvm_type(dtype)} {write_element(x)})" if is_known(x) else self.spread(dtype, x, wide)

    def spread(self, dtype: np.dtype, x: Element, width: int = LANES) -> Element:
        """Returns a vector in which all lanes have the same number, or the vector that x is already."""
        if isinstance(x, Vector):
            return x
        kind = vector_type(dtype, width)
        if is_known(x):
            numbers = f"{kind} splat ({llvm_type(dtype)} {write_element(x)})"
            # A constant vector needs a name, by which it is found again and is placed before loops.
            return self.pure(f"select i1 true, {numbers}, {kind} poison", width)
        first = self.pure(f"insertelement {kind} poison, {llvm_type(dtype)} {self.operand(dtype, x)}, i64 0")
        return self.pure(f"shufflevector {kind} {first}, {kind} poison, <{width} x i32> zeroinitializer", width)

    def lane(self, dtype: np.dtype, x: Element, lane: int) -> Element:
        """Returns the number of one lane."""
        return self.pure(f"extractelement {vector_type(dtype, x.width)} {x}, i64 {lane}") if in_lanes(x) else x

    def lanes_of(self, dtype: np.dtype, x: Element, count: int) -> list[Element]:
        """Returns the numbers of the first lanes. Nothing is written for those that no instruction reads."""
        if not isinstance(x, Vector):
            return [x] * count
        # Known numbers are folded further where they are read one by one.
        if x.startswith("<"):  # of known numbers, which an operation left as they are
            numbers = [number.split()[1] for number in x[1:-1].split(", ")]
            return [read_element(dtype, number) for number in numbers[:count]]
        self._lanes.setdefault(x, (vector_type(dtype, x.width), set()))
        return [Lane(x, position) for position in range(count)]

    def _take_lanes(self, lines: Sequence[str]) -> Iterator[str]:
        """Takes the lanes that instructions read out of their vectors, directly behind these.

        Most operations on short arrays read whole vectors, so which lanes are read is known only now, when all
        instructions are written.
        """
        waiting: list[str] = []  # behind the last phi of a block, since phis come first in it
        for line in "\n".join(lines).split("\n"):
            vector, _, instruction = line.partition(" = ")
            is_phi = instruction.startswith("phi ")
            if not is_phi:
                yield from waiting
                waiting = []
            yield line
            if vector not in self._lanes:
                continue
            kind, read = self._lanes[vector]
            extractions = [f"{vector}.{lane} = extractelement {kind} {vector}, i64 {lane}" for lane in sorted(read)]
            if is_phi:
                waiting += extractions
            else:
                yield from extractions

    def shuffle(self, dtype: np.dtype, x: Vector, y: Vector | None, lanes: Sequence[int]) -> Vector:
        """Makes a vector of lanes of one vector, or of two; the lanes of the second are numbered from its width on."""
        kind, places = vector_type(dtype, x.width), ", ".join(f"i32 {lane}" for lane in lanes)
        other = f"{kind} {'poison' if y is None else y}"
        return Vector(
            self.pure(f"shufflevector {kind} {x}, {other}, <{len(lanes)} x i32> <{places}>", len(lanes)), len(lanes)
        )

    def gather(self, dtype: np.dtype, numbers: Sequence[Element], width: int = LANES) -> Vector:
        """Makes a vector of the numbers of the lanes."""
        vector: Name = "poison"
        for lane, number in enumerate(numbers):
            item = f"{llvm_type(dtype)} {self.operand(dtype, number)}"
            vector = self.pure(f"insertelement {vector_type(dtype, width)} {vector}, {item}, i64 {lane}", width)
        return Vector(vector, width)

    def is_same_in_every_turn(self, element: Element) -> bool:
        """Returns whether a number is computed before the innermost loop that is being written."""
        return is_known(element) or not self._scopes.is_of_this_turn(element)

    def any_lane(self, condition: Element) -> Element:
        """Returns whether a condition holds in any of the lanes."""
        if not isinstance(condition, Vector):
            return condition
        name, kind = f"@llvm.vector.reduce.or.v{condition.width}i1", vector_type(BOOL, condition.width)
        self.module.declared.setdefault(name, f"declare i1 {name}({kind})")
        return self.pure(f"call i1 {name}({kind} {condition})")

    def apply(self, operation: str, dtype: np.dtype, *operands: Element) -> Name:
        """Applies an instruction to numbers of one type, to vectors where one of them is one."""
        wide = width_of(*operands)
        kind = vector_type(dtype, wide)
        numbers = ", ".join([self.operand(dtype, x, wide) for x in operands])
        return self.pure(f"{operation} {kind} {numbers}", wide)

    def cast(self, operation: str, source: np.dtype, target: np.dtype, x: Element) -> Name:
        """Writes an instruction that converts a number to another type."""
        wide = width_of(x)
        old, new = (vector_type(kind, wide) for kind in (source, target))
        return self.pure(f"{operation} {old} {self.operand(source, x)} to {new}", wide)

    def choose(self, dtype: np.dtype, condition: Name, x: Element, y: Element) -> Name:
        """Returns x where a condition that is not known holds, else y."""
        wide = width_of(condition, x, y)
        kind = vector_type(dtype, wide)
        choice = f"{vector_type(BOOL, width_of(condition))} {self.operand(BOOL, condition)}"
        first, second = (f"{kind} {self.operand(dtype, number, wide)}" for number in (x, y))
        return self.pure(f"select {choice}, {first}, {second}", wide)

    def intrinsic(
        self, function: str, dtype: np.dtype, *operands: Element, to: np.dtype | None = None, flags: str = ""
    ) -> Name:
        """Calls a function of LLVM's; ``to``: the type of its result, if another; ``flags``: one more operand."""
        result, wide = to or dtype, width_of(*operands)
        operand_type, result_type = (vector_type(kind, wide) for kind in (dtype, result))
        types = (dtype,) if to is None else (result, dtype)
        name = f"@{function}" + "".join(f".{f'v{wide}' if wide else ''}{suffix_of(kind)}" for kind in types)
        kinds = ", ".join(filter(None, [*[operand_type] * len(operands), flags.partition(" ")[0]]))
        self.module.declared.setdefault(name, f"declare {result_type} {name}({kinds})")
        numbers = [f"{operand_type} {self.operand(dtype, x, wide)}" for x in operands]
        return self.pure(f"call {result_type} {name}({', '.join(filter(None, [*numbers, flags]))})", wide)

    # Blocks

    def begin(self, label: str) -> None:
        """Begins the block with that label."""
        self._lines.append(f"{label}:")
        self.label = label

    def jump(self, label: str) -> None:
        self.write(f"br label %{label}")

    def branch(self, condition: Element, yes: str, no: str) -> None:
        self.write(f"br i1 {self.operand(BOOL, condition)}, label %{yes}, label %{no}")

    def reserve(self) -> int:
        """Reserves a place for a line that is written later, by :meth:`fill`."""
        self._lines.append("")
        return len(self._lines) - 1

    def fill(self, place: int, line: str) -> None:
        self._lines[place] = line

    def fill_phi(self, place: int, name: Name, dtype: np.dtype, cases: Sequence[tuple[Element, str]]) -> None:
        """Writes, at a place that was reserved, that a name is the number that the block before gives."""
        wide = width_of(name)
        kind = vector_type(dtype, wide)
        ways = ", ".join(f"[ {self.operand(dtype, element, wide)}, %{label} ]" for element, label in cases)
        self.fill(place, f"{name} = phi {kind} {ways}")

    def phi(self, dtype: np.dtype, cases: Sequence[tuple[Element, str]]) -> Element:
        """Returns the number that the block before this one gives; a vector where one of them is one, and then all that
        are not known must be vectors.
        """
        texts = [write_element(element) for element, _ in cases]
        if len(set(texts)) == 1 and all(is_known(element) for element, _ in cases):
            return cases[0][0]
        name, place = self.fresh(width_of(*(element for element, _ in cases))), self.reserve()
        self.fill_phi(place, name, dtype, cases)
        return name
