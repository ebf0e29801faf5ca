"""The LLVM module of a program: what all its functions share, and its text."""

import numpy as np

from ..limits import ALIGNMENT, MOST_LINES
from ..targets.processors import HOST, Target
from .elements import Name, UnsupportedError


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
