"""Settings of XLA's CPU backend under which the solves of this library run several times faster."""

import importlib.metadata
import os
import re
import subprocess
import sys

__all__ = ["prepare"]

# The first compiles small loops as one function instead of running them operation by operation. The others are LLVM's
# own: it gives up vector instructions where it must check that many arrays do not overlap, or thinks that the check
# costs more than a loop over some lanes gains, which a higher cost of the loop's instructions refutes. XLA reads them
# when its backend starts. Multi-output fusion is not among them: with it, jaxlib 0.10.1 compiled a wrong reverse-mode
# derivative, off by 4e-4, and crashed where programs of derivatives were compiled in the newer way.
SMALL_LOOPS = "xla_cpu_small_while_loop_byte_threshold=100000000"
VECTORS = "-vectorize-memory-check-threshold=100000,-force-target-instruction-cost=10"
# Where there are 512-bit registers, they are used.
WIDE = "--xla_cpu_prefer_vector_width=512"
# XLA's older way of compiling fused operations takes a tenth to a third less time. Depending on the processor, its
# programs ran from a tenth faster to a fifth slower than those of the newer way. jaxlib 0.11 and later only have the
# newer one.
OLDER = "--xla_cpu_use_fusion_emitters=false"
EXTRA = "--xla_backend_extra_options"
FLAGS = (f"{EXTRA}={SMALL_LOOPS},{VECTORS}", WIDE)

WITHOUT_OLDER = (0, 11)
# The range of jaxlib versions, the second excluded, that are known to accept the flags.
KNOWN_GOOD = ((0, 10), (0, 13))


def prepare() -> bool:
    """Sets ``XLA_FLAGS`` for fast solves on a CPU, in addition to the flags that are already set.

    It also turns off JAX's option ``jax_cpu_enable_async_dispatch``, so that a program runs in the thread that calls
    it: handing it over takes 10 to 80 µs, as long as some solves.

    Call it before the first array is made. The command line does; importing the library sets nothing. These options are
    internals of XLA, and XLA aborts the process at an unknown flag, so with a version of jaxlib that is not known to
    accept them, they are first tried in another process.

    **Returns:** whether the options are set: False where the user has set extra options in ``XLA_FLAGS``, or where
    jaxlib does not accept these.
    """
    _run_in_the_calling_thread()
    present = os.environ.get("XLA_FLAGS", "").split()
    if any(flag.startswith(EXTRA) for flag in present):
        return FLAGS[0] in present
    names = {flag.split("=")[0] for flag in present}
    version = tuple(int(part) for part in re.findall(r"\d+", importlib.metadata.version("jaxlib"))[:3])
    flags = " ".join([*present, *(flag for flag in flags_of(version) if flag.split("=")[0] not in names)])
    if not KNOWN_GOOD[0] <= version < KNOWN_GOOD[1] and not _accepts(flags):
        return False
    os.environ["XLA_FLAGS"] = flags
    return True


def flags_of(version: tuple[int, ...]) -> tuple[str, ...]:
    """Returns the flags for a version of jaxlib."""
    return FLAGS if version >= WITHOUT_OLDER else (*FLAGS, OLDER)


def cores() -> int:
    """Counts the cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _run_in_the_calling_thread() -> None:
    import jax  # only here, because the settings of a process may be asked for without it

    jax.config.update("jax_cpu_enable_async_dispatch", False)


def _accepts(flags: str) -> bool:
    """Returns whether a process that runs a compiled loop with these flags succeeds."""
    program = "import jax; jax.jit(lambda x: jax.lax.fori_loop(0, 3, lambda i, x: x + i, x))(0.0)"
    environment = {**os.environ, "XLA_FLAGS": flags}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, check=False)
    return done.returncode == 0


def __dir__() -> list[str]:
    return __all__
