"""NVIDIA's assembler takes the kernels of programs of each kind, where this machine has it."""

import re
import shutil
import subprocess

import pytest

from jaxball.programs.native.pipeline import kernel_text
from jaxball.programs.native.targets.machine import ptx

from .emulation import emit_computation, recorded
from .programs import PROGRAMS

PTXAS = shutil.which("ptxas")
ARCHITECTURES = ("sm_75", "sm_80", "sm_90", "sm_100")
QUICK = ("a disk",)
# Of an explicit method, with matrices, with modes, back through a run, of 32 bits, and with reductions.
NAMES = ("a disk", "Dopri8", "NDF", "slip and flight", "grad", "float32", "an ensemble")

pytestmark = pytest.mark.skipif(PTXAS is None, reason="this machine has no ptxas, which is in CUDA's toolkit")


def supported() -> list[str]:
    """Those of the architectures that this version of the assembler knows."""
    listed = subprocess.run([str(PTXAS), "--help"], capture_output=True, text=True, check=True).stdout
    return [name for name in ARCHITECTURES if re.search(rf"'{name}'", listed)]


@pytest.mark.parametrize(
    ("place", "name"),
    [(k, name) if name in QUICK else pytest.param(k, name, marks=pytest.mark.long) for k, name in enumerate(NAMES)],
)
def test_kernels_are_accepted(place, name, tmp_path):
    """All architectures for one program; one for each of the others, of which the assembler may take a minute."""
    with recorded() as calls:
        PROGRAMS[name]()
    text = ptx(kernel_text(emit_computation(calls[-1][0])))
    # Without a rounding mode, the assembler may fuse a product and a sum, and round otherwise than a CPU.
    assert not re.search(r"\b(add|sub|mul)\.f(32|64)\b", text)
    source = tmp_path / "kernel.ptx"
    source.write_text(text)
    known = supported()
    assert len(known) >= 3
    for architecture in known if name in QUICK else [known[place % len(known)]]:
        command = [str(PTXAS), "-O1", f"-arch={architecture}", str(source), "-o", str(tmp_path / "kernel.cubin")]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
