"""What determines how a program is compiled, besides itself and JAX's settings: sources, versions, flags, processor."""

import contextlib
import functools
import hashlib
import importlib
import importlib.util
import os
import platform
import sys
from collections.abc import Iterator
from pathlib import Path

OWN = Path(__file__).parents[1]
COMPILERS = ("jax", "jaxlib", "numpy")
# Python packages that may be installed in editable form.
LIBRARIES = ("equinox", "diffrax", "optimistix", "lineax", "jaxtyping")
VARIABLES = ("XLA_", "JAX_", "EQX_", "TF_XLA_")
PROCESSOR = ("model name", "flags", "Features", "CPU implementer", "CPU part")


@functools.cache
def identity(sources: str) -> str:
    """A digest of all of these; ``sources`` is that of jaxball's own files."""
    parts = [
        sys.version,
        platform.platform(),
        *(f"{name} {importlib.import_module(name).__version__}" for name in COMPILERS),
        *(f"{variable}={value}" for variable, value in sorted(os.environ.items()) if variable.startswith(VARIABLES)),
        *_processor(),
        sources,
    ]
    for library in LIBRARIES:
        spec = importlib.util.find_spec(library)
        if spec is not None and spec.origin is not None:
            parts.extend(_dates(Path(spec.origin).parent))
    return hashlib.blake2b(os.fsencode("\n".join(parts)), digest_size=20).hexdigest()


def sources() -> str:
    """A digest of jaxball's own files; a different one each time if they cannot be read."""
    digest = hashlib.blake2b(digest_size=20)
    try:
        paths = sorted(OWN.rglob("*.py"))
        for path in paths:
            content = path.read_bytes()
            digest.update(f"{path.relative_to(OWN)} {len(content)}\n".encode())
            digest.update(content)
    except OSError:
        paths = []
    return digest.hexdigest() if paths else os.urandom(20).hex()


def _dates(package: Path) -> Iterator[str]:
    """The size and modification time of each file."""
    yield str(package)
    for path in sorted(package.rglob("*.py")):
        with contextlib.suppress(OSError):
            status = path.stat()
            yield f"{path} {status.st_size} {status.st_mtime_ns}"


def _processor() -> list[str]:
    """The model and the instructions of the processor; if they cannot be read, the name of the machine."""
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return [platform.processor(), platform.node()]
    lines = [line for line in text.split("\n\n")[0].splitlines() if line.startswith(PROCESSOR)]
    return [platform.machine(), *lines] if lines else [platform.machine(), platform.node()]
