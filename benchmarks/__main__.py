"""``python -m benchmarks``, in a clone of jaxball: solvers compared at equal achieved error."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from comparison.command import parser

from jaxball.cli import main

if __name__ == "__main__":
    sys.exit(main(parser=parser))
