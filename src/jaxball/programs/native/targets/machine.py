"""The kinds of processors that programs are written for, and LLVM, which compiles LLVM IR to machine code or to PTX.

LLVM comes with llvmlite, which is imported when it is first needed.
"""

import contextlib
import ctypes
import functools
import importlib
import importlib.util
import re
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from ..limits import LANES, LONG_PROGRAM, MOST_ON_STACK, MOST_ON_STACK_OF_GPU, MOST_QUICKLY

# LLVM's context, in which modules are parsed, is shared by the process.
_lock = threading.Lock()

# What PTX is written for; drivers of CUDA 12 and newer compile it for every GPU from this one on.
OLDEST_GPU, VERSION_OF_PTX = "sm_70", "+ptx70"

# Declarations of routines, as linear_algebra.py writes them.
_ROUTINE = re.compile(r"declare void @scipy\.(lapack|blas)\.(\w+)\(")


class Target(NamedTuple):
    """What a kind of processor offers to programs.

    - ``has_library``: elementary functions of the C library, where they take less time than this package's own.
    - ``has_routines``: LAPACK and BLAS.
    - ``has_vectors``: vectors of numbers.
    - ``has_signals``: Python, which may have a signal to handle, and another compiler that can take over.
    - ``most_on_stack``: bytes of an array on the stack; larger ones are in the memory to work in.
    """

    has_library: bool
    has_routines: bool
    has_vectors: bool
    has_signals: bool
    most_on_stack: int


HOST = Target(has_library=True, has_routines=True, has_vectors=True, has_signals=True, most_on_stack=MOST_ON_STACK)
# One of a GPU's.
THREAD = Target(
    has_library=False, has_routines=False, has_vectors=False, has_signals=False, most_on_stack=MOST_ON_STACK_OF_GPU
)


@functools.cache
def is_present() -> bool:
    """Returns whether llvmlite is installed."""
    try:
        return importlib.util.find_spec("llvmlite") is not None
    except ValueError:  # if None is in its place
        return False


def identity() -> list[str]:
    """Lists everything that, besides its text, determines the code of a program: the versions of LLVM and llvmlite, the
    processor.
    """
    import llvmlite

    llvm = _llvm()
    version = ".".join(map(str, llvm.llvm_version_info))
    return [llvmlite.__version__, version, llvm.get_default_triple(), *_processor()]


def processor_name() -> str:
    """Returns LLVM's name of this processor."""
    return _processor()[0]


def triple() -> str:
    """Returns LLVM's name of the target."""
    return _llvm().get_default_triple()


def object_code(text: str, quickly: bool = False) -> bytes:
    """Returns the machine code of a module of LLVM's IR, which :class:`Code` loads, in this process or in another one.

    - ``quickly``: in a third of the time, as code that runs up to twice as long, with the same results to the last bit.
    """
    quickly = quickly and len(text) <= MOST_QUICKLY
    return _emit(text, lambda: _pipeline(quickly), lambda machine, module: machine.emit_object(module))


def ptx(text: str) -> str:
    """Returns the PTX of a module of LLVM's IR that has a ``kernel``."""
    return _emit(text, _pipeline_to_ptx, lambda machine, module: machine.emit_assembly(module))


def _emit(text: str, pipeline: Callable[[], tuple[Any, Callable[[Any], None]]], emit: Callable[[Any, Any], Any]) -> Any:
    """Optimises a module and emits its code; one thread at a time, because passes are shared as well."""
    llvm = _llvm()
    with _lock:
        machine, optimise = pipeline()
        module = llvm.parse_assembly(text)
        module.triple, module.data_layout = machine.triple, str(machine.target_data)
        try:
            optimise(module)
            with _with_settings(llvm, text):
                return emit(machine, module)
        finally:
            module.close()


def routines_in(text: str) -> tuple[tuple[str, str], ...]:
    """Returns the routines of LAPACK and BLAS that a module calls: the library and the name of each."""
    return tuple(sorted(set(_ROUTINE.findall(text))))


class Code:
    """Machine code in memory, for as long as this object lives. ``routines``: those that it calls."""

    def __init__(self, code: bytes, routines: Sequence[tuple[str, str]] = ()):
        llvm = _llvm()
        for library, name in routines:
            # Code from a store was compiled by another process, where the routine had another address.
            llvm.add_symbol(f"scipy.{library}.{name}", routine(library, name))
        with _lock:
            # An engine owns its module and its target machine. One for each program, so that its memory is given back.
            self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine())
            self._engine.add_object_file(llvm.ObjectFileRef.from_data(code))
            self._engine.finalize_object()

    def address(self, name: str) -> int:
        """Returns the address of a function."""
        return self._engine.get_function_address(name)

    def close(self) -> None:
        """Frees the memory."""
        with _lock:
            self._engine.close()

    def __del__(self, is_finalizing: Callable[[], bool] = sys.is_finalizing) -> None:
        if hasattr(self, "_engine") and not is_finalizing():  # when LLVM is gone already
            self.close()


@functools.cache
def multiplies_and_adds() -> bool:
    """Returns whether the processor has x y + z, rounded once, as an instruction; functions for it take 50 times as
    long.
    """
    features = _llvm().get_host_cpu_features()
    return bool(features.get("fma") or features.get("neon"))


@functools.cache
def routine(library: str, name: str) -> int | None:
    """Returns where a routine of ``lapack`` or ``blas`` is in this process, as SciPy has it; None where it takes no
    integers of 32 bits, or where there is none.
    """
    capsule = importlib.import_module(f"scipy.linalg.cython_{library}").__pyx_capi__.get(name)
    if capsule is None:
        return None
    signature, pointer = ctypes.pythonapi.PyCapsule_GetName, ctypes.pythonapi.PyCapsule_GetPointer
    signature.argtypes, signature.restype = [ctypes.py_object], ctypes.c_char_p
    pointer.argtypes, pointer.restype = [ctypes.py_object, ctypes.c_char_p], ctypes.c_void_p
    kind = signature(capsule)
    return pointer(capsule, kind) if b" int *" in kind or b"(int *" in kind else None


@functools.cache
def _llvm() -> Any:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    # C's functions and Python's by the addresses that this process has, however it was linked.
    for name in ("PyEval_SaveThread", "PyEval_RestoreThread", "PyErr_CheckSignals"):
        function = getattr(ctypes.pythonapi, name)
        llvm.add_symbol(name, ctypes.cast(function, ctypes.c_void_p).value)
    return llvm


@functools.cache
def _processor() -> tuple[str, str]:
    """Returns the processor's name and its features."""
    llvm = _llvm()
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def _machine(quickly: bool = False) -> Any:
    llvm = _llvm()
    name, features = _processor()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(cpu=name, features=features, opt=0 if quickly else 2, jit=True)


@contextlib.contextmanager
def _with_settings(llvm: Any, text: str) -> Iterator[None]:
    """Applies process-wide LLVM settings while a program is compiled.

    With them the time is proportional to the length of a program. CodeGenPrepare takes a time quadratic in a block's
    length (60 s, against 4 s for the rest, for an event of an Adams method), and made none of the programs faster. So
    do the scheduler's lists of accesses to the same memory (50 s of 80 s for a chart of Floquet multipliers), and a
    second scheduler after registers are allocated: a fifth to a half of the time for all, and Gauss's method and
    Radau's ran 1 to 3% slower without it, Dopri8 as fast. So does the combination of nodes that join more than some
    tens of stores: 23 of 26 s for the gradient of a run's contact extremes, whose code was as long with it.

    Where most numbers are vectors, as in lanes, instructions are put in an order in which fewer of them must wait in
    memory: with AVX2, balls with a law of contact took three quarters of the time, others 3% less, and LLVM as long.
    Other programs took up to an eighth longer with it.
    """
    llvm.set_option("", "-disable-cgp=true")
    llvm.set_option("", "-disable-post-ra=true")
    llvm.set_option("", f"-dag-maps-huge-region={200 if len(text) > LONG_PROGRAM else 1000}")
    llvm.set_option("", "-combiner-tokenfactor-inline-limit=16")
    llvm.set_option("", f"-pre-RA-sched={'list-hybrid' if _is_of_vectors(text) else 'default'}")
    try:
        yield
    finally:
        llvm.set_option("", "-disable-cgp=false")
        llvm.set_option("", "-disable-post-ra=false")
        llvm.set_option("", "-dag-maps-huge-region=1000")
        llvm.set_option("", "-combiner-tokenfactor-inline-limit=2048")
        llvm.set_option("", "-pre-RA-sched=default")


def _is_of_vectors(text: str) -> bool:
    """Returns whether most instructions of a program are about the longest vectors."""
    lines, vector = text.split("\n"), f"<{LANES} x "
    return 2 * sum(vector in line for line in lines) > len(lines)


@functools.cache
def _pipeline(quickly: bool) -> tuple[Any, Callable[[Any], None]]:
    """Returns the machine of this processor, and the function that optimises a module for it.

    Common subexpressions and constants were found, and products and sums fused, when the program was written. None of
    LLVM's other passes made the programs faster, and its new GVN, in LLVM 22, confused numbers of different loop
    iterations (``tests/programs/native/test_reductions.py``, ``test_windows``).

    One for all programs of a kind, because llvmlite gives back only a part of the memory of passes and builders.
    """
    machine = _machine(quickly)
    return machine, _passes(machine, quickly)


@functools.cache
def _pipeline_to_ptx() -> tuple[Any, Callable[[Any], None]]:
    """Returns the machine of the oldest GPUs that programs run on, and the function that optimises a module for it;
    drivers compile the code for all newer ones.
    """
    llvm = _llvm()
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = llvm.Target.from_triple("nvptx64-nvidia-cuda")
    machine = target.create_target_machine(cpu=OLDEST_GPU, features=VERSION_OF_PTX, opt=2)
    return machine, _passes(machine, False)


def _passes(machine: Any, quickly: bool) -> Callable[[Any], None]:
    """Returns the passes that pay for the time they take."""
    llvm = _llvm()
    passes = llvm.create_new_module_pass_manager()
    if not quickly:
        passes.add_sroa_pass()
    passes.add_dead_code_elimination_pass()
    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=2))
    return lambda module: passes.run(module, builder)
