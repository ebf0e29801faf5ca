"""What XLA and NVIDIA's driver would be for a program of a GPU, on a machine without either."""

import ctypes
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from jaxball.programs.native.limits import ROWS_OF_LAUNCH

STREAM, KERNEL, RESIDENT = 0x5712EA, 0x4E12E1, 4096
_POINTER, _INT, _LONG = ctypes.c_void_p, ctypes.c_int, ctypes.c_int64
_UINT = ctypes.c_uint


class Launch(SimpleNamespace):
    """A call of ``cuLaunchKernel``: ``kernel``, ``groups``, ``threads``, ``stream``, and the ``table`` at that time."""


class Driver:
    """Records the launches of kernels. ``results`` are what they return, the last of them again and again."""

    def __init__(self, parts: int, results: Sequence[int] = (0,)):
        self.launches: list[Launch] = []
        self._parts, self._results = parts, list(results)
        kinds = [_POINTER, *[_UINT] * 7, _POINTER, ctypes.POINTER(ctypes.POINTER(_LONG)), _POINTER]
        self._function = ctypes.CFUNCTYPE(_INT, *kinds)(self._launch)
        self.launch = ctypes.cast(self._function, _POINTER).value

    def _launch(self, kernel, x, y, z, threads, ty, tz, shared, stream, parameters, extra) -> int:
        assert (y, z, ty, tz, shared, extra) == (1, 1, 1, 1, 0, None)
        table = [parameters[0][k] for k in range(6 + 2 * self._parts)]
        self.launches.append(Launch(kernel=kernel, groups=x, threads=threads, stream=stream, table=table))
        return self._results.pop(0) if len(self._results) > 1 else self._results[0]

    def load(self, code: bytes) -> int:
        return KERNEL

    def resident(self) -> int:
        return RESIDENT


class Xla:
    """Calls a handler with a frame as XLA makes it, and records what the handler asks XLA for.

    - ``most``: bytes of memory that it has to give.
    """

    def __init__(self, most: int = 2**62):
        self.allocated: list[int] = []
        self.freed: list[tuple[int, int]] = []
        self.errors: list[tuple[int, str]] = []
        self.dropped = 0
        self._most, self._memory = most, 0xA0000
        kind = ctypes.CFUNCTYPE(_POINTER, _POINTER)
        self._functions = {
            48: kind(self._create_error),
            64: ctypes.CFUNCTYPE(None, _POINTER)(self._destroy_error),
            80: kind(self._stream),
            120: kind(self._allocate),
            128: kind(self._free),
        }
        self._api = (_LONG * 32)()
        self._api[0] = 8 * 32
        for offset, function in self._functions.items():
            self._api[offset // 8] = ctypes.cast(function, _POINTER).value

    def _create_error(self, arguments: int) -> int:
        message = ctypes.string_at(_LONG.from_address(arguments + 16).value).decode()
        self.errors.append((ctypes.c_int32.from_address(arguments + 24).value, message))
        return 0xE0 + len(self.errors)

    def _destroy_error(self, arguments: int) -> None:
        self.dropped += 1

    def _stream(self, arguments: int) -> None:
        _LONG.from_address(arguments + 24).value = STREAM

    def _allocate(self, arguments: int) -> int | None:
        size = _LONG.from_address(arguments + 24).value
        if size > self._most:
            return 0xEE
        self.allocated.append(size)
        _LONG.from_address(arguments + 40).value = self._memory
        return None

    def _free(self, arguments: int) -> None:
        self.freed.append((_LONG.from_address(arguments + 24).value, _LONG.from_address(arguments + 32).value))

    def call(self, handler: int, takes: Sequence[np.ndarray], gives: Sequence[np.ndarray]) -> Any:
        """Executes; the error that the handler returns, if any."""
        frame = (_LONG * 32)()
        lists, kept = [], []
        for arrays in (takes, gives):
            buffers = []
            for array in arrays:
                lengths = (_LONG * max(array.ndim, 1))(*array.shape)
                buffer = (_LONG * 6)(48, 0, 0, array.ctypes.data, array.ndim, ctypes.addressof(lengths))
                kept += [lengths, buffer]
                buffers.append(ctypes.addressof(buffer))
            lists.append((_LONG * max(len(buffers), 1))(*buffers))
        frame[2] = ctypes.addressof(self._api)
        frame[72 // 8], frame[112 // 8] = map(ctypes.addressof, lists)
        return ctypes.CFUNCTYPE(_POINTER, _POINTER)(handler)(ctypes.addressof(frame))


__all__ = ["KERNEL", "RESIDENT", "ROWS_OF_LAUNCH", "STREAM", "Driver", "Xla"]
