"""Settings of XLA's CPU backend under which the solves of this library run several times faster."""

import importlib.metadata
import os
import re
import subprocess
import sys

# The first compiles small loops as one function instead of running them operation by operation; the
# second lets results that share work be computed together. XLA reads them when its backend starts.
SMALL_LOOPS, FUSION = "xla_cpu_small_while_loop_byte_threshold=100000000", "xla_cpu_use_multi_output_fusion=true"
FLAG = f"--xla_backend_extra_options={SMALL_LOOPS},{FUSION}"

# With the second, jaxlib 0.10.1 computes wrong derivatives: in reverse mode through a ball's solve and its contact force,
# off in the fourth digit and without a word.
FLAG_FOR_DERIVATIVES = f"--xla_backend_extra_options={SMALL_LOOPS}"

# The versions of jaxlib, from the first to before the second, that were seen to accept the flag.
KNOWN_GOOD = ((0, 10), (0, 13))


def prepare(*, derivatives: bool = False) -> bool:
    """Sets ``XLA_FLAGS`` for fast solves on a CPU, beside the flags that are there already.

    Call it before the first array is made. The command line does; importing the library sets
    nothing. These options are internals of XLA, and XLA stops the process at an unknown flag, so for
    a version of jaxlib that is not known to accept them it is tried in another process first.

    **Arguments:**

    - ``derivatives``: whether reverse-mode derivatives are to be computed, with which one of the options is not safe.

    **Returns:** whether the options are set: False where ``XLA_FLAGS`` has extra options of the
    user's own, or where jaxlib does not accept them.
    """
    present, flag = os.environ.get("XLA_FLAGS", ""), FLAG_FOR_DERIVATIVES if derivatives else FLAG
    if "xla_backend_extra_options" in present:
        return flag in present.split()
    flags = f"{present} {flag}".strip()
    if not _known_good(importlib.metadata.version("jaxlib")) and not _accepted(flags):
        return False
    os.environ["XLA_FLAGS"] = flags
    return True


def _known_good(version: str) -> bool:
    numbers = tuple(int(part) for part in re.findall(r"\d+", version)[:3])
    return KNOWN_GOOD[0] <= numbers < KNOWN_GOOD[1]


def _accepted(flags: str) -> bool:
    """Whether a process that runs a compiled loop with these flags ends well."""
    program = "import jax; jax.jit(lambda x: jax.lax.fori_loop(0, 3, lambda i, x: x + i, x))(0.0)"
    environment = {**os.environ, "XLA_FLAGS": flags}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, check=False)
    return done.returncode == 0
