"""Programs on a GPU: a kernel, and the function by which XLA starts it."""

import ctypes
import functools
import hashlib
import threading
from typing import Any, NamedTuple

import jax
import numpy as np

from .targets import machine
from .targets.cuda import CudaError, Driver, driver

_targets: dict[str, Any] = {}  # the programs that XLA may call at any time
_lock = threading.Lock()


class GridForm(NamedTuple):
    """A program for a GPU as plain data. Nothing here needs the compiler.

    - ``kernel``: its code for this kind of GPU, or PTX with a zero at its end.
    - ``launcher``: the machine code of the handler that starts it.
    - ``gives``: shape, type and whether the type is weak, of the arrays that a run gives.
    - ``longest_map``: how many turns its longest loop of independent turns has.
    """

    kernel: bytes
    launcher: bytes
    gives: tuple[tuple[tuple[int, ...], np.dtype, bool], ...]
    longest_map: int


class GridExecutable:
    """A program that XLA runs on a GPU, each row in a thread."""

    def __init__(self, form: GridForm):
        self.form = form

    @functools.cached_property
    def target(self) -> str | None:
        """The name by which XLA calls the program, for as long as the process lives; None if it cannot be loaded."""
        digest = hashlib.blake2b(self.form.kernel + self.form.launcher, digest_size=16)
        name = f"jaxball_gpu_{digest.hexdigest()}"
        with _lock:
            if name not in _targets:
                try:
                    code = connect(self.form, driver())
                except CudaError:
                    return None
                address = ctypes.cast(code.address("call"), ctypes.c_void_p)
                jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(address), platform="CUDA")
                _targets[name] = code
        return name


def connect(form: GridForm, gpu: Driver) -> machine.Code:
    """Loads a program: the code of its launcher, which knows the kernel and the driver's function that starts it."""
    code = machine.Code(form.launcher)
    kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)
    kind(code.address("connect"))(gpu.launch, gpu.load(form.kernel), gpu.resident())
    return code


def compile_for_gpus(ptx: str) -> bytes:
    """Compiles PTX for the GPUs of this machine; where they are of several kinds, it stays PTX, with a zero at its end.

    **Raises:** :class:`~.cuda.CudaError`.
    """
    gpu = driver()
    # Machine code is for one kind; each GPU's driver compiles PTX when it loads it.
    return gpu.compile(ptx) if len(set(gpu.capabilities())) == 1 else ptx.encode() + b"\0"


def identity() -> list[str]:
    """Lists everything that, besides its text, determines the code of a program: LLVM, this processor, the driver and
    the GPUs.
    """
    gpu = driver()
    return [*machine.identity(), machine.OLDEST_GPU, machine.VERSION_OF_PTX, str(gpu.version), repr(gpu.capabilities())]


def why_not() -> str | None:
    """Says why programs cannot be compiled for a GPU here; None where they can."""
    try:
        driver()
    except CudaError as error:
        return str(error)
    return None
