"""NVIDIA's assembler takes the kernels of all programs, where this machine has it."""

import re
import shutil
import subprocess

import pytest

from jaxball.native.entry import kernel_text
from jaxball.native.machine import ptx

from .emulation import entry_of, recorded
from .programs import PROGRAMS

PTXAS = shutil.which("ptxas")
ARCHITECTURES = ("sm_70", "sm_80", "sm_90", "sm_100")
QUICK = ("a disk",)

pytestmark = pytest.mark.skipif(PTXAS is None, reason="this machine has no ptxas, which is in CUDA's toolkit")


def supported() -> list[str]:
    """Those of the architectures that this version of the assembler knows."""
    listed = subprocess.run([str(PTXAS), "--help"], capture_output=True, text=True, check=True).stdout
    return [name for name in ARCHITECTURES if re.search(rf"'{name}'", listed)]


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.long) for name in PROGRAMS]
)
def test_kernels_are_accepted(name, tmp_path):
    with recorded() as calls:
        PROGRAMS[name]()
    assert len(supported()) >= 3
    for computation, *_ in calls[-1:]:
        text = ptx(kernel_text(entry_of(computation)))
        # Without a rounding mode, the assembler may fuse a product and a sum, and round otherwise than a CPU.
        assert not re.search(r"\b(add|sub|mul)\.f(32|64)\b", text)
        source = tmp_path / "kernel.ptx"
        source.write_text(text)
        for architecture in supported():
            command = [str(PTXAS), "-O1", f"-arch={architecture}", str(source), "-o", str(tmp_path / "kernel.cubin")]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
