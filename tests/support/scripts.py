"""The scripts in the folder of benchmarks, as a user calls them."""

import os
import subprocess
import sys
from pathlib import Path

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def run_script(name: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """What ``python benchmarks/name`` did with these arguments and variables of the environment."""
    line = [sys.executable, str(BENCHMARKS / name), *arguments]
    return subprocess.run(line, capture_output=True, text=True, check=False, env={**os.environ, **environment})
