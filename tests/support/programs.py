"""Compiled programs, which most of the time and of the memory of the tests goes into: made quickly, kept, forgotten."""

import ctypes
import gc
import importlib.metadata
import os
import shutil
import subprocess
import sys
from pathlib import Path

import equinox
import jax

import jaxball.programs.cache
import jaxball.programs.program

# XLA's newer emitters take longer for a loop than all the rest of compiling without optimisations. Processes that test
# `cpu.prepare` start without this flag.
OLDER_EMITTERS = "--xla_cpu_use_fusion_emitters=false"
KNOWN_JAXLIB = "0.10."

MOST_ON_DISK = 2 << 30  # bytes
# Linux lets a process have 65,530 mappings of memory, and a compiled program takes several; then XLA aborts.
MOST_MAPPINGS = 42_000
# Of the machine's memory, which two processes of tests share with those that they start; one test may need 0.8 GB more.
MEMORY_PART = 1 / 6
LEAST_MEMORY = 1_700 << 20  # bytes that a process may take on any machine


def compile_quickly() -> None:
    """Starts XLA, which reads its flags then: what a test or a page of the documentation sets later, processes read."""
    flags = os.environ.get("XLA_FLAGS", "").split()
    if OLDER_EMITTERS not in flags and _accepted(flags := [*flags, OLDER_EMITTERS]):
        os.environ["XLA_FLAGS"] = " ".join(flags)
    jax.devices()


def _accepted(flags: list[str]) -> bool:
    """XLA stops the process at a flag that it does not know."""
    if importlib.metadata.version("jaxlib").startswith(KNOWN_JAXLIB):
        return True
    program = [sys.executable, "-c", "import jax; jax.devices()"]
    environment = {**os.environ, "XLA_FLAGS": " ".join(flags)}
    return subprocess.run(program, env=environment, capture_output=True, check=False).returncode == 0


def keep_in(folder: Path) -> None:
    """The other processes of this run, this one when it has forgotten its programs, and the next run find them there:
    those of XLA and, in a folder inside, jaxball's own.
    """
    if "PYTEST_XDIST_WORKER" not in os.environ and sum(file.stat().st_size for file in folder.iterdir()) > MOST_ON_DISK:
        shutil.rmtree(folder)
    own = folder / "native"
    own.mkdir(parents=True, exist_ok=True)
    own.chmod(0o700)
    os.environ["JAXBALL_NO_CACHE"], os.environ["JAXBALL_CACHE_DIR"] = "", str(own)
    jaxball.programs.cache.enable()
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def forget_if_many(*, module_ends: bool) -> None:
    """Where Linux tells how much there is. Mappings, which take milliseconds to count, at the ends of modules."""
    statistics, mappings = Path("/proc/self/statm"), Path("/proc/self/maps")
    if not statistics.exists():
        return
    page = os.sysconf("SC_PAGE_SIZE")
    memory, most = int(statistics.read_text().split()[1]) * page, MEMORY_PART * os.sysconf("SC_PHYS_PAGES") * page
    if memory > max(LEAST_MEMORY, most) or (module_ends and mappings.read_text().count("\n") > MOST_MAPPINGS):
        equinox.clear_caches()
        jax.clear_caches()
        jaxball.programs.program.forget()
        gc.collect()
        if hasattr(libc := ctypes.CDLL(None), "malloc_trim"):  # else the C library keeps what is free for itself
            libc.malloc_trim(0)
