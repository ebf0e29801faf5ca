"""The program of a view is what its sources make."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from jaxball.plot import view

FOLDER = Path(view.__file__).parent


@pytest.mark.long
def test_the_program_is_made_of_its_sources(tmp_path):
    if shutil.which("npm") is None:
        pytest.skip("npm is not installed")
    source = tmp_path / "view" / "source"
    shutil.copytree(FOLDER / "source", source, ignore=shutil.ignore_patterns("node_modules"))
    install = ["npm", "install", "--no-package-lock", "--no-audit", "--no-fund", "--fetch-retries=0"]
    done = subprocess.run(install, cwd=source, capture_output=True, text=True, timeout=300)
    if done.returncode != 0:
        pytest.skip(f"npm cannot install three.js and esbuild: {done.stderr.strip().splitlines()[-1:]}")
    subprocess.run(["npm", "run", "build"], cwd=source, capture_output=True, check=True, timeout=300)
    assert (source.parent / "view.bundle.js").read_bytes() == (FOLDER / "view.bundle.js").read_bytes()
    assert (source / "node_modules" / "three" / "LICENSE").read_text() == (FOLDER / "three.LICENSE").read_text()


def test_versions_are_exact_and_no_registry_is_named():
    told = json.loads((FOLDER / "source" / "package.json").read_text())
    versions = [*told["dependencies"].values(), *told["devDependencies"].values()]
    assert all(version.replace(".", "").isdigit() for version in versions)
    assert not list((FOLDER / "source").glob("*lock*"))
    assert "</script" not in (FOLDER / "view.bundle.js").read_text().lower()
