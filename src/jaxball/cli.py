"""The command line: ``jaxball`` and its commands, one a file in ``commands``."""

import argparse
import importlib.metadata
import sys
from collections.abc import Sequence

import jax

from . import cpu
from .commands import bench, chaos, design, plot, reproduce, scenarios, simulate, stability, sweep, validate, verify
from .commands.options import BAD_INPUT
from .results import OutputError
from .scenario import ScenarioError
from .simulation import PrecisionError

COMMANDS = (scenarios, validate, simulate, plot, chaos, stability, verify, sweep, design, reproduce, bench)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command, and returns its exit code.

    0, 1 for a run that is not to be believed, 2 for bad input, 3 for a solve that failed, 130 for Ctrl-C.
    """
    options = _parser().parse_args(arguments)
    cpu.prepare(gradients=options.gradients)
    jax.config.update("jax_enable_x64", True)
    try:
        return options.run(options)
    except (ScenarioError, OutputError, PrecisionError, OSError) as error:
        print(f"jaxball: {error}", file=sys.stderr)
        return BAD_INPUT


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="jaxball",
        description="Simulates a rolling ball or disk driven by point masses moving inside it.",
    )
    parser.add_argument("--version", action="version", version=f"jaxball {importlib.metadata.version('jaxball')}")
    parser.set_defaults(gradients=False)
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add(commands)
    return parser
