"""The quick tests of continuous integration: which Python they take, and that the lists of versions agree."""

import os
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
VERSIONS = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))
ABSENT, BROKEN = 127, 3


@pytest.fixture
def machine(tmp_path):
    """Commands of a machine: ``python3`` is 3.11, and no other Python runs until a test adds one."""

    def add(path, script):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)

    commands = tmp_path / "bin"
    for name in ("bash", "dirname", "sed", "sort", "mktemp", "rm"):
        (commands / name).parent.mkdir(exist_ok=True)
        (commands / name).symlink_to(shutil.which(name))
    add(commands / "python3", 'case "$2" in *print*) echo 3.11 ;; esac')
    for version in VERSIONS[1:]:
        add(commands / f"python{version}", f"exit {ABSENT}")  # as pyenv has it where a version is not chosen
    return commands, add


def python(version):
    """A Python that says its version, and cannot make an environment."""
    return f'case "$*" in *print*) echo {version} ;; "-m venv"*) echo "asked: {version}"; exit {BROKEN} ;; esac'


def quick(commands):
    environment = {name: value for name, value in os.environ.items() if name != "PYTHON"} | {"PATH": str(commands)}
    return subprocess.run([commands / "bash", ".ci/quick"], cwd=ROOT, env=environment, capture_output=True, text=True)


def test_without_a_newer_python_a_sentence_says_so(machine):
    done = quick(machine[0])
    assert done.returncode == 0, done.stderr
    assert done.stdout == (
        "No Python newer than 3.11 was found here, on PATH or through pyenv, so that the quick tests are skipped.\n"
    )


def test_the_newest_python_on_the_path_is_taken(machine):
    commands, add = machine
    for version in VERSIONS:
        add(commands / f"python{version}", python(version))
    done = quick(commands)
    assert (done.returncode, done.stdout) == (BROKEN, f"asked: {VERSIONS[-1]}\n"), done.stderr


def test_one_that_pyenv_has_is_taken(machine, tmp_path):
    commands, add = machine
    add(commands / "pyenv", f"echo {tmp_path}")
    add(tmp_path / "versions" / f"{VERSIONS[-1]}.4" / "bin" / "python3", python(VERSIONS[-1]))
    add(commands / f"python{VERSIONS[0]}", python(VERSIONS[0]))
    done = quick(commands)
    assert (done.returncode, done.stdout) == (BROKEN, f"asked: {VERSIONS[-1]}\n"), done.stderr


def test_versions_are_the_same_wherever_they_are_listed():
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text()
    (matrix,) = re.findall(r"python: \[(.*)\]", workflow)
    assert re.findall(r"3\.\d+", matrix) == VERSIONS
    assert PROJECT["requires-python"] == f">={VERSIONS[0]}"
    (oldest,) = (
        re.findall(r"^jax>=([\d.]+)", dependency) for dependency in PROJECT["dependencies"] if "jax>" in dependency
    )
    assert re.findall(r"jax==([\d.]+)", workflow) == oldest


def test_the_quick_tests_run_on_other_machines():
    """Each of which has another processor or another system than those on which all tests run."""
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text()
    job = workflow.partition("  elsewhere:")[2].partition("\n\n")[0]
    (machines,) = re.findall(r"machine: \[(.*)\]", job)
    assert [re.split(r"[-.]", name)[0] for name in machines.split(", ")] == ["macos", "windows", "ubuntu"]
    assert machines.endswith("-arm")
    assert "run: bash .ci/quick python" in job


def test_the_quick_tests_exist():
    lines = re.findall(r"tests/\S+", (ROOT / ".ci" / "quick").read_text())
    expanded = subprocess.run(
        ["bash", "-c", f"echo {' '.join(lines)}"], capture_output=True, text=True, check=True
    ).stdout
    assert len(expanded.split()) >= 10
    assert all((ROOT / path).exists() for path in expanded.split())
