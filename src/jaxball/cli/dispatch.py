"""The command that was typed: found, run, and its errors told as sentences."""

import argparse
import importlib
import os
import re
import sys
from collections.abc import Sequence

from ..interface.interruption import INTERRUPTED, STOPPED
from ..interface.wording import did_you_mean
from .options import BAD_INPUT, BROKEN_PIPE, BadInputError

# A command is imported when it is the one to run.
COMMANDS = {
    "scenarios": "list the built-in scenarios, or print one as a file",
    "validate": "check scenario, study and problem files",
    "simulate": "simulate a scenario",
    "plot": "draw a saved run",
    "chaos": "Lyapunov exponents, charts of them and Poincaré maps of a scenario",
    "stability": "steady motions of a scenario's ball, and their stability",
    "verify": "check the laws of mechanics on a run",
    "sweep": "run a study: a scenario with other numbers in each row",
    "design": "find a design by gradients through the simulation",
    "reproduce": "reproduce both runs of Putkaradze & Rogers (2018)",
    "bench": "compare solvers at equal achieved error",
}
# What the command line calls an argument of Python that is not an option of the same name.
TYPED = {
    "source": "FILE",
    "name": "NAME",
    "problems": "PROBLEM",
    "data": "STORE",
    "inclination": "INCLINATION",
    "precession": "PRECESSION",
}


def run(arguments: Sequence[str]) -> int:
    """Runs a command, and returns its exit code."""
    try:
        try:
            return _run(arguments)
        finally:
            _flush()
    except KeyboardInterrupt as error:
        print(f"jaxball: {error.args[0] if error.args else STOPPED}", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # as of `| head`, which has seen enough
        return BROKEN_PIPE
    except Exception as error:
        if not isinstance(error, _refusals()):
            raise
        print(f"jaxball: {_sentence(error)}", file=sys.stderr)
        return BAD_INPUT


def _run(arguments: Sequence[str]) -> int:
    options = _parser(arguments).parse_args(arguments)
    # Imported here, because help and wrong options need no numbers.
    import jax

    from .. import cpu

    cpu.prepare(gradients=options.gradients)
    jax.config.update("jax_enable_x64", True)
    return options.run(options)


def _refusals() -> tuple[type[Exception], ...]:
    """The errors whose messages are sentences for the user; asked for when there is an error."""
    from ..interface.output import OutputError
    from ..scenario import ScenarioError
    from ..simulation.simulate import PrecisionError

    return ScenarioError, OutputError, PrecisionError, BadInputError, OSError


def _flush() -> None:
    """Writes out what was printed; what cannot be is not tried again when the interpreter ends."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise


def _sentence(error: Exception) -> str:
    """The message of an error, with the names of arguments as they are on the command line."""
    if isinstance(error, OSError) and error.strerror:
        place = "The output" if error.filename is None else f'"{error.filename}"'
        return f"{place} cannot be {'written' if error.filename is None else 'used'}: {error.strerror}."

    def typed(match: re.Match[str]) -> str:
        name = match[1]
        return TYPED[name] if name in TYPED else f"Argument `--{name.replace('_', '-')}`"

    return re.sub(r"Argument `(\w+)`", typed, str(error))


class _Parser(argparse.ArgumentParser):
    """Says which word was perhaps meant, where argparse would list all there are."""

    def _check_value(self, action: argparse.Action, value: object) -> None:
        if action.choices is not None and value not in action.choices:
            hint = did_you_mean(str(value), map(str, action.choices), f"{self.prog} --help shows what there is")
            raise argparse.ArgumentError(action, f'there is no "{value}"{hint}')


class _Version(argparse.Action):
    """Says the version, which is looked up only then, because that takes longer than all else here."""

    def __call__(self, parser, namespace, values, option_string=None):
        import importlib.metadata

        print(f"jaxball {importlib.metadata.version('jaxball')}")
        parser.exit()


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    """The parser, with the options of the command that ``arguments`` name, and the names of the others."""
    parser = _Parser(
        prog="jaxball",
        description="Simulates a rolling ball or disk driven by point masses moving inside it.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    parser.set_defaults(gradients=False)
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for name, summary in COMMANDS.items():
        if name in arguments[:1]:
            importlib.import_module(f".commands.{name}", __package__).add(commands)
        else:
            commands.add_parser(name, help=summary)
    return parser
