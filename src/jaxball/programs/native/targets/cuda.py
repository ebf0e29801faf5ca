"""NVIDIA's driver, ``libcuda``, by its functions in C: programs are compiled for the GPU, loaded, and started.

The driver is all that is needed; the toolkit of CUDA is not. It is loaded when JAX has found a GPU.
"""

import contextlib
import ctypes
import functools
import sys
from collections.abc import Iterator
from typing import Any

from ..limits import LONGEST_LOG, THREADS_OF_EACH

_NAME = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"

# Numbers of CUDA's interface (cuda.h).
_PTX, _MULTIPROCESSORS, _MAJOR, _MINOR = 1, 16, 75, 76
_LOG, _BYTES_OF_LOG = 5, 6  # of errors, as options of the compiler


class CudaError(RuntimeError):
    """What the driver says in an error."""


class Driver:
    """The driver, and the GPUs that it knows."""

    def __init__(self, library: Any):
        self._library = library
        self._call("cuInit", 0)
        version, count = ctypes.c_int(), ctypes.c_int()
        self._call("cuDriverGetVersion", ctypes.byref(version))
        self._call("cuDeviceGetCount", ctypes.byref(count))
        self.version = version.value
        self._devices = range(count.value)

    def _call(self, name: str, *arguments: Any) -> None:
        """Calls a function.

        **Raises:** :class:`CudaError` with the driver's sentence.
        """
        try:
            result = getattr(self._library, name)(*arguments)
        except AttributeError:
            raise CudaError(f"The driver of the GPU has no {name}: jaxball needs one for CUDA 12 or newer.") from None
        if result:
            text = ctypes.c_char_p()
            self._library.cuGetErrorString(result, ctypes.byref(text))
            raise CudaError(f"{name} of the GPU's driver: {(text.value or b'error').decode()} ({result}).")

    def _attribute(self, attribute: int, device: int) -> int:
        value = ctypes.c_int()
        self._call("cuDeviceGetAttribute", ctypes.byref(value), attribute, device)
        return value.value

    def capabilities(self) -> list[tuple[int, int]]:
        """Returns the compute capability of each GPU."""
        return [(self._attribute(_MAJOR, device), self._attribute(_MINOR, device)) for device in self._devices]

    def resident(self) -> int:
        """Returns how many threads of programs with all registers the largest GPU runs at once."""
        return THREADS_OF_EACH * max(self._attribute(_MULTIPROCESSORS, device) for device in self._devices)

    def compile(self, ptx: str) -> bytes:
        """Compiles PTX for the first GPU.

        **Raises:** :class:`CudaError` with what the compiler says.
        """
        log, state, code, size = ctypes.create_string_buffer(LONGEST_LOG), *(ctypes.c_void_p() for _ in range(3))
        options = (ctypes.c_int * 2)(_LOG, _BYTES_OF_LOG)
        values = (ctypes.c_void_p * 2)(ctypes.addressof(log), LONGEST_LOG)
        source = ptx.encode() + b"\0"
        with self._context():
            self._call("cuLinkCreate_v2", 2, options, values, ctypes.byref(state))
            try:
                self._call("cuLinkAddData_v2", state, _PTX, source, ctypes.c_size_t(len(source)), None, 0, None, None)
                self._call("cuLinkComplete", state, ctypes.byref(code), ctypes.byref(size))
                return ctypes.string_at(code, size.value or 0)
            except CudaError as error:
                raise CudaError(f"{error} {log.value.decode(errors='replace')}".strip()) from None
            finally:
                self._call("cuLinkDestroy", state)

    @contextlib.contextmanager
    def _context(self) -> Iterator[None]:
        """Enters the first GPU's context, which JAX uses as well."""
        context, popped = ctypes.c_void_p(), ctypes.c_void_p()
        self._call("cuDevicePrimaryCtxRetain", ctypes.byref(context), 0)
        try:
            self._call("cuCtxPushCurrent_v2", context)
            try:
                yield
            finally:
                self._call("cuCtxPopCurrent_v2", ctypes.byref(popped))
        finally:
            self._call("cuDevicePrimaryCtxRelease_v2", 0)

    def load(self, code: bytes) -> int:
        """Loads compiled code, or PTX with a zero at its end; returns its kernel, which every GPU can run.

        It is loaded for as long as the process lives.
        """
        library, kernel = ctypes.c_void_p(), ctypes.c_void_p()
        self._call("cuLibraryLoadData", ctypes.byref(library), code, None, None, 0, None, None, 0)
        self._call("cuLibraryGetKernel", ctypes.byref(kernel), library, b"kernel")
        return kernel.value or 0

    @property
    def launch(self) -> int:
        """The address of the function that starts a kernel."""
        return ctypes.cast(self._library.cuLaunchKernel, ctypes.c_void_p).value or 0


@functools.cache
def driver() -> Driver:
    """Returns the driver of this machine.

    **Raises:** :class:`CudaError` where there is none that works.
    """
    try:
        library = ctypes.CDLL(_NAME)
    except OSError as error:
        raise CudaError(f"The driver of an NVIDIA GPU is not there: {error}.") from None
    return Driver(library)
