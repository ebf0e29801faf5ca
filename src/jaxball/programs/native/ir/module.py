"""The LLVM module of a program: what all its functions share, and where each writes its pure instructions.

A pure instruction is written once, and before all loops on which it does not depend. Such loop-invariant instructions
go to a place before the loop. They are executed even if the loop's body is not, which is harmless, because none of them
can fail.
"""

import contextlib
import re
from collections.abc import Iterator

import numpy as np

from ..limits import ALIGNMENT, MOST_LINES
from ..targets.machine import HOST, Target
from .elements import Element, Lane, Name, UnsupportedError

_NAMES = re.compile(r"%\w+")  # of a lane, that of its vector: it is taken out where the vector is made


class Module:
    """What the functions of a program share: declarations, constants, the size of the workspace.

    **Arguments:**

    - ``target``: what its processor can do.
    """

    def __init__(self, target: Target = HOST) -> None:
        self.target = target
        self.declared: dict[str, str] = {}
        self.constants: dict[bytes, tuple[str, str]] = {}
        self.functions: list[str] = []
        self.workspace = 0
        self.lines = 0

    def count_line(self) -> None:
        """Counts an instruction.

        **Raises:** ``UnsupportedError`` if there are too many.
        """
        self.lines += 1
        if self.lines > MOST_LINES:
            raise UnsupportedError(f"A program of more than {MOST_LINES:,} instructions")

    def constant(self, numbers: np.ndarray) -> Name:
        """Returns the address of numbers that the program contains."""
        content = np.ascontiguousarray(numbers).tobytes()
        if content not in self.constants:
            name = f"@constant.{len(self.constants)}"
            text = "".join(f"\\{byte:02X}" for byte in content)
            line = f'{name} = private unnamed_addr constant [{len(content)} x i8] c"{text}", align {ALIGNMENT}'
            self.constants[content] = name, line
        return self.constants[content][0]

    def text(self) -> str:
        """Returns the text of the module."""
        constants = [line for _, line in self.constants.values()]
        return "\n".join([*self.declared.values(), *constants, *self.functions, ""])


class Loop:
    """A loop that is being written, or was: ``before`` are the instructions that are executed once, ahead of it.

    ``scope`` is the number of the block of instructions in which it stands.
    """

    __slots__ = ("before", "is_open", "outer", "place", "scope")

    def __init__(self, outer: "Loop | None", place: int, scope: int):
        self.outer, self.place, self.scope = outer, place, scope
        self.before: list[str] = []
        self.is_open = True


class Scopes:
    """The instructions of a function that have been written, by their text, in the scopes in which they are valid."""

    def __init__(self) -> None:
        self.loop: Loop | None = None
        self._known: dict[str, Name] = {}
        self._added: list[list[str]] = [[]]  # the keys of `_known`, scope by scope, so that they can be forgotten
        self._homes: dict[Name, Loop] = {}  # the innermost loop around a name, if any

    def find(self, instruction: str) -> Name | None:
        """Returns the result of an instruction that was written already."""
        return self._known.get(instruction)

    def note(self, instruction: str, name: Name) -> Loop | None:
        """Notes a new instruction; the loop ahead of which it is to be written, if not here."""
        home, loop, scope, ahead_of = self._home(instruction), self.loop, len(self._added) - 1, None
        # Out of loop after loop. It is known as far out as it is written, so that what follows the loop finds it too.
        while loop is not home and loop is not None:
            ahead_of, scope, loop = loop, loop.scope, loop.outer
        self._known[instruction] = name
        self._added[scope].append(instruction)
        if home is not None:
            self._homes[name] = home
        return ahead_of

    def name(self, name: Name) -> None:
        """Notes that a name is of the innermost loop."""
        if self.loop is not None:
            self._homes[name] = self.loop

    def _home(self, instruction: str) -> Loop | None:
        """Finds the innermost loop outside of which an instruction lacks an operand; None where it lacks none
        anywhere.
        """
        # The innermost home of an operand decides. Most operands are of the innermost loop, and end the search at once.
        loop = self.loop
        if loop is None:
            return None
        around = set()
        for name in _NAMES.findall(instruction):
            home = self._home_of(name)
            if home is loop:
                return loop
            around.add(home)
        while loop is not None and loop not in around:
            loop = loop.outer
        return loop

    def is_of_this_turn(self, element: Name) -> bool:
        """Returns whether a name, or the vector that it is a lane of, is of the innermost loop that is being
        written.
        """
        return self._home_of(element.vector if isinstance(element, Lane) else element) is self.loop

    def _home_of(self, name: Name) -> Loop | None:
        loop = self._homes.get(name)
        while loop is not None and not loop.is_open:  # what a loop has left is of the loop around it
            loop = loop.outer
        return loop

    @contextlib.contextmanager
    def scope(self) -> Iterator[None]:
        """Makes values computed in this Python block unknown after it, because it may not have been executed."""
        self._added.append([])
        try:
            yield
        finally:
            for key in self._added.pop():
                del self._known[key]

    @contextlib.contextmanager
    def write_loop(self, place: int) -> Iterator[Loop]:
        """Makes the instructions written in this Python block a loop; ``place`` is where to write the instructions that
        go before it.
        """
        loop = self.loop = Loop(self.loop, place, len(self._added) - 1)
        try:
            yield loop
        finally:
            loop.is_open, self.loop = False, loop.outer


class Turn:
    """One iteration of a loop: its index, the numbers carried into it, and those carried on."""

    def __init__(self, index: Name, carried: list[Name]):
        self.index, self.carried = index, carried
        self.following: list[Element] = []
