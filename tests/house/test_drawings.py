"""The sketches of the pages are those that their script draws."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.support.pictures import coarse

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drawn")
    done = subprocess.run([sys.executable, DOCS / "drawings", folder], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.parametrize("name", ["notation", "ground", "modes", "rooms"])
def test_the_sketch_is_what_the_script_draws(name, drawn):
    pictures = [coarse(folder / f"{name}.png") for folder in (DOCS / "figures", drawn)]
    assert np.sqrt(np.mean(np.subtract(*pictures) ** 2)) < 8.0
