"""The driver of a GPU, against a stub of its library."""

import ctypes

import pytest

from jaxball.programs.native.targets.cuda import CudaError, Driver
from tests.support.sentences import refuses

CUBIN = b"\x7fELF of a kernel"


class Library:
    """Some functions of ``libcuda``, which record their calls. ``fails``: the functions that return an error."""

    def __init__(self, capabilities=((9, 0),), **fails):
        self.calls, self.fails, self.capabilities = [], fails, capabilities
        self.cubin = ctypes.create_string_buffer(CUBIN, len(CUBIN))

    def __getattr__(self, name):
        if not name.startswith("cu") or self.fails.get(name) == "missing":
            raise AttributeError(name)

        def function(*arguments):
            self.calls.append(name)
            if name == "cuGetErrorString":
                arguments[1]._obj.value = b"out of memory"
                return 0
            return self.fails.get(name) or self.answer(name, arguments)

        return function

    def answer(self, name, arguments):
        if name == "cuDriverGetVersion":
            arguments[0]._obj.value = 12090
        elif name == "cuDeviceGetCount":
            arguments[0]._obj.value = len(self.capabilities)
        elif name == "cuDeviceGetAttribute":
            place, attribute, device = arguments
            place._obj.value = {16: 132, 75: self.capabilities[device][0], 76: self.capabilities[device][1]}[attribute]
        elif name == "cuLinkComplete":
            arguments[1]._obj.value = ctypes.addressof(self.cubin)
            arguments[2]._obj.value = len(CUBIN)
        elif name == "cuLibraryGetKernel":
            arguments[0]._obj.value = 0x4E1
        return 0


def test_a_gpu_is_described():
    gpu = Driver(Library())
    assert (gpu.version, gpu.capabilities(), gpu.resident()) == (12090, [(9, 0)], 132 * 256)


def test_ptx_is_compiled_in_the_context_that_jax_uses_and_left_as_it_was():
    library = Library()
    gpu = Driver(library)
    library.calls.clear()
    assert gpu.compile(".version 7.0") == CUBIN
    assert library.calls == [
        "cuDevicePrimaryCtxRetain",
        "cuCtxPushCurrent_v2",
        "cuLinkCreate_v2",
        "cuLinkAddData_v2",
        "cuLinkComplete",
        "cuLinkDestroy",
        "cuCtxPopCurrent_v2",
        "cuDevicePrimaryCtxRelease_v2",
    ]


@pytest.mark.parametrize("function", ["cuLinkCreate_v2", "cuLinkAddData_v2", "cuLinkComplete"])
def test_a_failure_is_a_sentence_and_leaves_nothing_behind(function):
    library = Library(**{function: 2})
    gpu = Driver(library)
    with refuses(CudaError, function):
        gpu.compile(".version 7.0")
    assert library.calls[-2:] == ["cuCtxPopCurrent_v2", "cuDevicePrimaryCtxRelease_v2"]


def test_an_old_driver_is_named():
    gpu = Driver(Library(cuLibraryLoadData="missing"))
    with refuses(CudaError, "The driver of the GPU"):
        gpu.load(CUBIN)


def test_a_kernel_is_loaded_for_all_devices():
    library = Library()
    assert Driver(library).load(CUBIN) == 0x4E1
    assert library.calls[-2:] == ["cuLibraryLoadData", "cuLibraryGetKernel"]
