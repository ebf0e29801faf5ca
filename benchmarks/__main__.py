"""``python -m benchmarks``, in a clone of jaxball: solvers compared at equal achieved error.

Its benchmarks are imported when they run, as the commands of jaxball are.
"""

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

from jaxball.cli import main
from jaxball.cli.dispatch import Parser
from jaxball.cli.jax_setup import set_up_jax
from jaxball.cli.options import BadInputError, positive
from jaxball.interface.interruption import interrupt_message
from jaxball.interface.output import check_folder
from jaxball.interface.starting import EXIT_INTERRUPTED, STOPPED

ENGINES = "engines"


def parser(_: Sequence[str]) -> argparse.ArgumentParser:
    """Makes the parser of the command, whatever its arguments are."""
    parser = Parser(prog="python -m benchmarks", description="Compares solvers at equal achieved error.")
    parser.set_defaults(cache=False, run=run)
    parser.add_argument(
        "problems",
        nargs="*",
        metavar="PROBLEM",
        help="problems to solve (default: all); after the word engines, robots to simulate in general engines",
    )
    parser.add_argument(
        "--solvers", nargs="+", default=[], metavar="NAME", help="solvers, packages, or parts of names; or engines"
    )
    parser.add_argument("--tolerances", nargs="+", type=positive, metavar="RTOL", help="default: 1e-4 to 1e-13")
    parser.add_argument("--budget", type=positive, metavar="SECONDS", help="time for the timed calls of each setting")
    parser.add_argument("--limit", type=positive, metavar="SECONDS", help="skip settings whose solves take longer")
    parser.add_argument("--out", type=Path, default=Path("out/bench"), metavar="FOLDER", help="default: out/bench")
    parser.add_argument(
        "--gradients",
        action="store_true",
        help="after engines: derivatives of a robot's final place instead of its motions",
    )
    parser.add_argument("--quick", action="store_true", help="two problems, a few solvers, two tolerances")
    parser.add_argument("--list", action="store_true", help="list problems and solvers")
    return parser


def run(options: argparse.Namespace) -> int:
    """Runs what the options choose, and returns the exit code."""
    if not options.list:
        check_folder(options.out, "--out")
    if options.gradients:
        _check_gradients(options)
    set_up_jax()
    if options.problems[:1] == [ENGINES]:
        return _engines(options)
    import comparison

    if options.list:
        print(comparison.listing())
        return 0
    try:
        plan = comparison.plan(options.problems, options.solvers, quick=options.quick)
    except comparison.SelectionError as error:
        raise BadInputError(str(error)) from None
    changes = {
        "tolerances": options.tolerances and tuple(options.tolerances),
        "budget": options.budget,
        "limit": options.limit,
    }
    settings = dataclasses.replace(plan.settings, **{key: value for key, value in changes.items() if value is not None})
    with interrupt_message(lambda: _describe_stop(options.out)):
        results = comparison.compare(plan.problems, plan.contenders, settings, options.out)
    return EXIT_INTERRUPTED if results.interrupted else 0


def _check_gradients(options: argparse.Namespace) -> None:
    if options.problems[:1] != [ENGINES]:
        raise BadInputError("Argument `--gradients` must be left out without the word engines before it.")
    if options.problems[1:]:
        raise BadInputError("Argument PROBLEM must be engines alone with `--gradients`, which has one robot.")
    for name in ("solvers", "quick"):
        if getattr(options, name):
            raise BadInputError(f"Argument `--{name}` must be left out with `--gradients`, which has one robot.")


def _engines(options: argparse.Namespace) -> int:
    """Runs robots in general engines, beside the exact solution."""
    for name in ("tolerances", "budget", "limit"):
        if getattr(options, name) is not None:
            raise BadInputError(f"Argument `--{name}` must be left out after `engines`, whose time steps are given.")
    from comparison import SelectionError
    from comparison.engines import run as engines

    if options.list:
        print(engines.listing())
        return 0
    if options.gradients:
        from comparison.engines import gradients

        gradients.measure(options.out)
        return 0
    try:
        plan = engines.plan(options.problems[1:], options.solvers, quick=options.quick)
    except SelectionError as error:
        raise BadInputError(str(error)) from None
    engines.measure(plan, options.out)
    return 0


def _describe_stop(out: Path) -> str:
    written = (out / "results.json").exists()
    return f'Stopped; "{out}" has the problems that were finished.' if written else STOPPED


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))
    sys.exit(main(parser=parser))
