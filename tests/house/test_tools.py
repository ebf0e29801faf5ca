"""The house: style, types, layers, and nothing global on import."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def run(*command: str, **options) -> subprocess.CompletedProcess:
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600, **options)


@pytest.mark.parametrize(
    "tool",
    [
        ("ruff", "check", "."),
        ("ruff", "format", "--check", "."),
        pytest.param(("basedpyright", "--pythonpath", sys.executable), marks=pytest.mark.thorough),
    ],
    ids=lambda tool: " ".join(tool[:2]),
)
def test_tool_has_nothing_to_say(tool):
    done = run(sys.executable, "-m", *tool)
    assert done.returncode == 0, done.stdout + done.stderr


def test_arrows_between_the_layers_go_down_only():
    program = "import sys; from importlinter.cli import lint_imports_command; sys.exit(lint_imports_command())"
    done = run(sys.executable, "-c", program)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_breach_of_the_layers_would_be_seen(tmp_path):
    """The negative control: physics that imports an integrator breaks a contract."""
    source = tmp_path / "src"
    subprocess.run(["cp", "-r", str(ROOT / "src"), str(source)], check=True)
    (tmp_path / "pyproject.toml").write_text((ROOT / "pyproject.toml").read_text())
    equations = source / "jaxball" / "physics" / "dynamics" / "equations.py"
    equations.write_text(equations.read_text().replace("import jax.numpy", "import diffrax\nimport jax.numpy", 1))
    program = (
        f"import sys; sys.path.insert(0, {str(source)!r}); "
        "from importlinter.cli import lint_imports_command; sys.exit(lint_imports_command())"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "jaxball.physics.dynamics.equations -> diffrax" in done.stdout


def test_import_changes_nothing_global():
    program = """
import os, logging, matplotlib, jax
import diffrax, optimistix
before = dict(os.environ), dict(matplotlib.rcParams), list(logging.root.handlers), dict(jax.config.values)
import jaxball, jaxball.paper, jaxball.plot, jaxball.paper.reproduce
assert (dict(os.environ), dict(matplotlib.rcParams), list(logging.root.handlers), dict(jax.config.values)) == before
jax.config.update("jax_platforms", "nonexistent")  # too late only if a backend had been started
try:
    jax.devices()
except RuntimeError:
    print("no backend was started")
"""
    done = run(sys.executable, "-c", program)
    assert done.stdout.strip().endswith("no backend was started"), done.stdout + done.stderr


def test_no_source_file_is_long():
    long = {
        str(path.relative_to(ROOT)): lines
        for folder in ("src", "tests", "benchmarks", "examples")
        for path in (ROOT / folder).rglob("*.py")
        if (lines := len(path.read_text().splitlines())) > 500
    }
    assert not long
