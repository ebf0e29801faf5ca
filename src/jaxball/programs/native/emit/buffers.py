"""Buffers, the memory of arrays, and who owns them.

A value of StableHLO never changes, but to copy an array for an update of one element would cost far more than the
update. So an operation writes into the buffer of its operand where nothing reads the old numbers any more. That is
decided while the program is written, by two counts of each buffer:

- ``owners``: the values, still to be read, whose numbers lie in the buffer or are computed from it by formulas.
  ``Function.bind`` adds one, and ``Function.unbind`` drops it behind the last operation that reads the value.
- ``pins``: the loops, branches and calls, still being written, that need the buffer whatever lies in it.

Two rules follow, and nothing else decides:

- An operation may overwrite an operand that it is the last to read and that is the buffer's only owner
  (``Function.overwritable``). Pins do not prevent that: a loop's body is to overwrite what the loop carries.
- A buffer without owners and pins is memory of the next array of its size (:meth:`Buffers.free_unused`).

A region is written once, and executed once, often or never. So the owners of buffers from around it are set before it
is written, and restored behind it (:class:`OwnersBefore`):

- A function in the place of its call is executed once: an operand that only the call still reads loses its owner to the
  function's argument (``Function.transfer_owner``).
- A loop's body has the arguments that it may overwrite as only owners. The loop's condition may overwrite nothing, as
  the body comes after it, and finds one owner more.
- A branch may overwrite what nothing reads behind all branches, as if there were no other.

Arguments, constants and results of the function are not the program's memory: they are not ``writable``, or have no
``size`` that can be used again.
"""

from collections.abc import Iterable
from typing import Protocol

from ..ir.elements import Name
from .builder import Builder


class Buffer:
    """Memory of an array, with ``owners`` and ``pins``.

    - ``size``: its bytes, which are used again; 0 where they are not.
    - ``writable``: whether it is the program's, neither an argument nor a constant.
    - ``lanes``: whether each element is a vector; ``level``: in how many masks it was allocated.
    - ``shared``: whether it is one array of which each lane writes its own part, whoever owns it.
    """

    __slots__ = ("lanes", "level", "name", "owners", "pins", "shared", "size", "writable")

    def __init__(self, name: Name, size: int, writable: bool = True, lanes: bool = False, level: int = 0):
        self.name, self.size, self.writable = name, size, writable
        self.lanes, self.level, self.shared = lanes, level, False
        self.owners, self.pins = 0, 0


class InBuffers(Protocol):
    """An array whose numbers lie in buffers, or are computed from these by formulas."""

    @property
    def buffers(self) -> tuple[Buffer, ...]:
        """These buffers."""
        ...


class Buffers:
    """The buffers of one function."""

    def __init__(self, builder: Builder):
        self.builder = builder
        self._unused: dict[int, list[Name]] = {}
        self._recent: list[Buffer] = []

    def allocate_buffer(self, size: int, lanes: bool) -> Buffer:
        """Makes a buffer of memory that is unused, if there is any of this size."""
        unused = self._unused.get(size)
        name = unused.pop() if unused else self.builder.allocate(size)
        # A new object: arrays that nobody reads may still refer to the one that had this memory, and must not free it
        # again.
        buffer = Buffer(name, size, lanes=lanes, level=self.builder.level)
        # What an operation only works in never gets an owner, so that losing the last one cannot free it.
        self._recent.append(buffer)
        return buffer

    def add_owner(self, array: InBuffers) -> None:
        """Notes that one value more is in the array's buffers."""
        for buffer in array.buffers:
            buffer.owners += 1

    def drop_owner(self, array: InBuffers) -> None:
        """Notes that one value less is in the array's buffers."""
        for buffer in array.buffers:
            buffer.owners -= 1
            self._free_if_unused(buffer)

    def pin(self, array: InBuffers) -> None:
        """Notes that what is being written needs the array's buffers."""
        for buffer in array.buffers:
            buffer.pins += 1

    def unpin(self, array: InBuffers) -> None:
        """Notes that it does not need them any more. The owners that they have by then decide what becomes of them."""
        for buffer in array.buffers:
            buffer.pins -= 1

    def mark(self) -> int:
        """Marks what is allocated from here on, for :meth:`free_unused`."""
        return len(self._recent)

    def free_unused(self, mark: int) -> None:
        """Frees what was allocated since a mark and belongs to no value, as memory in which an operation worked."""
        if len(self._recent) > mark:
            for buffer in self._recent[mark:]:
                self._free_if_unused(buffer)
            del self._recent[mark:]

    def _free_if_unused(self, buffer: Buffer) -> None:
        if not buffer.owners and not buffer.pins and buffer.size and buffer.writable:
            self._unused.setdefault(buffer.size, []).append(buffer.name)
            buffer.size = 0  # so that it is freed once


class OwnersBefore:
    """The owners that buffers have where a region is about to be written."""

    def __init__(self, arrays: Iterable[InBuffers]):
        self._owners = [(buffer, buffer.owners) for array in arrays for buffer in array.buffers]

    def clear(self) -> None:
        """Leaves the buffers without owners but those that the region adds."""
        for buffer, _ in self._owners:
            buffer.owners = 0

    def restore(self) -> None:
        """Gives the buffers the owners back that they had."""
        for buffer, owners in self._owners:
            buffer.owners = owners
