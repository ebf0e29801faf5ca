"""Runs the command that was typed, and prints errors as sentences."""

import argparse
import contextlib
import importlib
import json
import keyword
import os
import shlex
import sys
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from .. import __version__
from ..interface.starting import EXIT_INTERRUPTED, STOPPED
from ..interface.wording import UserError, did_you_mean, plain
from .options import BAD_INPUT, BROKEN_PIPE, OUT_MISSING, add_no_cache, sentence

PACKAGES = (
    "jax", "jaxlib", "diffrax", "equinox", "optimistix", "jaxtyping", "llvmlite", "numpy", "scipy", "matplotlib",
    "xarray", "h5netcdf", "zarr", "mujoco",
)  # fmt: skip
SETTINGS = ("JAXBALL_", "JAX_", "XLA_", "CUDA_VISIBLE_DEVICES", "OMP_NUM_THREADS")


# Only the command that runs is imported.
COMMANDS = {
    "scenarios": "list the built-in scenarios, or print one as a file",
    "validate": "check scenario, study and problem files",
    "schema": "print the JSON Schema of a kind of file, for editors",
    "simulate": "simulate a scenario",
    "plot": "draw a saved run",
    "view": "show a saved run in one HTML file",
    "chaos": "Lyapunov exponents, charts of them and Poincaré maps of a scenario",
    "stability": "steady motions of a scenario's ball, and their stability",
    "periodic": "periodic motions of a scenario, their stability, and charts of it",
    "track": "hold a scenario's motion by feedback, and see which disturbed starts come back",
    "verify": "check the laws of mechanics on a run",
    "sweep": "run a study: a scenario with other numbers in each row",
    "design": "find a design by gradients through the simulation",
    "export": "write a scenario's robot as a file of MuJoCo",
    "import": "read a robot from a file of MuJoCo or ROS",
    "reproduce": "reproduce both runs of Putkaradze & Rogers (2018)",
    "cache": "show or remove kept compiled programs",
}
WITHOUT_CACHE = ("scenarios", "schema", "cache")
PROGRAM_OPTIONS = ("-h", "--help", "--version")


def run(arguments: Sequence[str], parser: Callable[[Sequence[str]], argparse.ArgumentParser]) -> int:
    """Runs a command, and returns its exit code.

    - ``parser``: makes the parser of the arguments, which says what ``run`` of them is, and whether they have a
      ``cache``.
    """
    try:
        try:
            return _run(arguments, parser)
        # Within the other block, so that a closed pipe is noticed here, and not as a traceback when the interpreter
        # ends.
        finally:
            _flush()
    except KeyboardInterrupt as error:
        print(f"jaxball: {error.args[0] if error.args else STOPPED}", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # such as from `| head`, which stops reading
        return BROKEN_PIPE
    except (UserError, OSError) as error:
        for line in sentence(error).split("\n"):  # one for each problem of a file
            print(f"jaxball: {plain(line)}", file=sys.stderr)
        return BAD_INPUT


def _run(arguments: Sequence[str], parser: Callable[[Sequence[str]], argparse.ArgumentParser]) -> int:
    options = parser(arguments).parse_args(arguments)
    with contextlib.ExitStack() as stack:
        # Imported here, because help and lists need neither.
        if options.cache:
            from ..programs import cache

            stack.enter_context(cache.of_a_command(arguments))
        else:
            from ..programs.store import current

            stack.enter_context(current.keep_within(None))
        try:
            return options.run(options)
        except SystemExit as error:
            if error.code:
                raise  # of a mistake in the options, which has been told
            raise UserError(
                "The command must come to its end, but a Python function or class that the file names ended it; "
                "leave out its call of exit()."
            ) from None


def _flush() -> None:
    """Writes out what was printed; if that fails, the interpreter does not try again when it ends."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise


class Parser(argparse.ArgumentParser):
    """Suggests the word that may have been meant, where argparse would list all choices.

    Unknown arguments are reported by the command that they were given to, not, as in argparse, by the program. Where
    --out is missing, the whole command to type is shown.
    """

    def parse_known_args(self, args=None, namespace=None):  # pyright: ignore[reportIncompatibleMethodOverride]
        self.typed = list(args or ())
        options, left_over = super().parse_known_args(args, namespace)
        if left_over:
            typed, option_names = left_over[0].partition("=")[0], list(self._option_string_actions)
            hint = did_you_mean(typed, option_names, f"{self.prog} --help shows what there is", quote="")
            self.error(f"there is no {typed} here{hint}")
        return options, left_over

    def error(self, message: str) -> NoReturn:
        if message == OUT_MISSING:
            (metavar,) = [action.metavar for action in self._actions if "--out" in action.option_strings]
            message += f", as in {self.prog} {shlex.join(self.typed)} --out {metavar}"
        super().error(message)

    def _check_value(self, action: argparse.Action, value: object) -> None:
        if action.choices is not None and value not in action.choices:
            hint = did_you_mean(str(value), map(str, action.choices), f"{self.prog} --help shows what there is")
            raise argparse.ArgumentError(action, f'there is no "{value}"{hint}')


class _Program(Parser):
    """The parser of the whole program: options of a command may also be typed before it."""

    def parse_known_args(self, args=None, namespace=None):  # pyright: ignore[reportIncompatibleMethodOverride]
        return super().parse_known_args(args if args is None else command_first(args), namespace)


class _Version(argparse.Action):
    """Prints the version, or all that a report of an error needs, and ends."""

    def __init__(self, *names: Any, as_json: bool, **named: Any) -> None:
        super().__init__(*names, nargs=0, **named)
        self.as_json = as_json

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        if self.as_json:
            print(json.dumps(_installation(), indent=2))
        else:
            print(f"jaxball {__version__}")
        parser.exit()


def _installation() -> dict[str, Any]:
    """Describes the versions, the processor, the devices, the compilers and the settings of the environment."""
    import platform

    import jax  # here, because --version alone does without

    from ..programs.native import gpu
    from ..programs.native.choice import current_choice
    from ..programs.native.targets import machine

    return {
        "jaxball": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processor": machine.processor_name() if machine.is_present() else platform.processor(),
        "cores": os.cpu_count(),
        "packages": {name: _version(name) for name in PACKAGES},
        "compiler": current_choice(),
        "backend": jax.default_backend(),
        "devices": [device.device_kind for device in jax.devices()],
        "gpu": gpu.why_not() or "available",
        "settings": {name: value for name, value in sorted(os.environ.items()) if name.startswith(SETTINGS)},
    }


def _version(name: str) -> str | None:
    import importlib.metadata

    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def command_first(arguments: Sequence[str]) -> list[str]:
    """Returns the arguments with the command before all options, as its parser takes them."""
    place = next((place for place, word in enumerate(arguments) if word in COMMANDS), 0)
    before = arguments[:place]
    # The program's own options, which may be shortened as far as --h, stay; so does a word that is no option, such as
    # a command that is mistyped.
    of_program = any(option.startswith(word) for word in before if word != "-" for option in PROGRAM_OPTIONS)
    if of_program or not "".join(before[:1]).startswith("--"):
        return list(arguments)
    return [arguments[place], *before, *arguments[place + 1 :]]


def parser_of(arguments: Sequence[str]) -> argparse.ArgumentParser:
    """Builds the parser, with the options of the command in ``arguments``, and only the names of the others."""
    parser = _Program(
        prog="jaxball",
        description="Simulates a rolling ball or disk driven by point masses moving inside it.",
    )
    parser.add_argument(
        "--version",
        action=_Version,
        # Looked up here: --version ends the parse, maybe before --json is reached.
        as_json="--json" in arguments,
        help="show the version and exit; `--version --json` shows what a report of an error needs",
    )
    parser.set_defaults(cache=False)
    commands = parser.add_subparsers(title="commands", prog=parser.prog, required=True, metavar="COMMAND")
    for name, summary in COMMANDS.items():
        if name in command_first(arguments)[:1]:
            # `import` is a keyword of Python, which a module cannot have as its name.
            module_name = f"{name}_" if keyword.iskeyword(name) else name  # of the module
            module, command = (
                importlib.import_module(f".commands.{module_name}", __package__),
                commands.add_parser(name),
            )
            module.add(command)
            command.set_defaults(run=module.run)
            if name not in WITHOUT_CACHE:
                add_no_cache(command)
        else:
            commands.add_parser(name, help=summary)
    return parser
