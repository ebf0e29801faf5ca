"""Every Python block of the documentation runs, in order, and so does every example."""

import re
import subprocess
import sys
from pathlib import Path

import jax
import pytest
from sybil import Sybil
from sybil.parsers.markdown import PythonCodeBlockParser

ROOT = Path(__file__).parents[2]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
# Whose programs run longer than they compile, and are compiled as users do.
LONG_RUNS = ("chaos-and-stability.md", "sweeps.md")


@pytest.fixture
def optimised(document):
    """The other tests switch most of the compiler's optimisations off."""
    if document.name not in LONG_RUNS:
        yield
        return
    before = jax.config.read("jax_disable_most_optimizations")
    jax.config.update("jax_disable_most_optimizations", False)
    yield
    jax.config.update("jax_disable_most_optimizations", before)


@pytest.mark.usefixtures("optimised")
@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_python_blocks_run(document, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("XLA_FLAGS", "EQX_ON_ERROR"):
        monkeypatch.setenv(name, "")
    sybil = Sybil(parsers=[PythonCodeBlockParser()], pattern="*.md", path=str(ROOT))
    for example in sybil.parse(document):
        example.evaluate()


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs(example, tmp_path):
    done = subprocess.run([sys.executable, str(example)], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_links_between_files_lead_somewhere():
    for document in [*DOCUMENTS, ROOT / "CONTRIBUTING.md", ROOT / "benchmarks" / "README.md"]:
        for target in re.findall(r"\]\((?!https?:)([^)#]+)", document.read_text()):
            assert (document.parent / target).exists(), f"{document.name} links to {target}"


def test_commands_of_the_readme(tmp_path):
    """The console lines of the section on the command line, typed one after the other."""
    section = (ROOT / "README.md").read_text().split("## On the command line")[1]
    lines = section.split("```console\n")[1].split("```")[0].splitlines()
    program = Path(sys.executable).parent / "jaxball"
    for line in lines:
        command = line.split("#")[0].strip().replace("jaxball", str(program), 1)
        done = subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, f"{line}: {done.stderr}"
    assert (tmp_path / "run.nc").stat().st_size > 0
    assert list((tmp_path / "figures").glob("*.png"))
