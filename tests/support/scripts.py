"""Programs in processes of their own, and the scripts in the folder of benchmarks, as a user calls them."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def printed_by(*arguments: str, **options: Any) -> str:
    """What Python prints with these arguments, such as ``-c`` and a program, which must come to its end."""
    done = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


def run_script(name: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """What ``python benchmarks/name`` did with these arguments and variables of the environment."""
    line = [sys.executable, str(BENCHMARKS / name), *arguments]
    return subprocess.run(line, capture_output=True, text=True, check=False, env={**os.environ, **environment})
