"""``jaxball bench``: solvers compared at equal achieved error."""

import argparse
import dataclasses
import sys
from pathlib import Path

from ..results import OutputError
from .options import BAD_INPUT, INTERRUPTED, positive


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser("bench", help="compare solvers at equal achieved error")
    parser.add_argument("problems", nargs="*", metavar="PROBLEM", help="which problems (default: all)")
    parser.add_argument("--solvers", nargs="+", default=[], metavar="NAME", help="a solver, a package, or words of one")
    parser.add_argument("--tolerances", nargs="+", type=positive, metavar="RTOL", help="default: 1e-4 to 1e-13")
    parser.add_argument("--budget", type=positive, metavar="SECONDS", help="of timed calls for each setting")
    parser.add_argument("--limit", type=positive, metavar="SECONDS", help="leave out what solves more slowly")
    parser.add_argument("--out", type=Path, default=Path("out/bench"), metavar="FOLDER", help="default: out/bench")
    parser.add_argument("--quick", action="store_true", help="two problems, a few solvers, two tolerances")
    parser.add_argument("--list", action="store_true", help="list problems and solvers")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    # Imported here, because the problems hold arrays, and the other commands have no use for them.
    from .. import bench

    if options.list:
        print(bench.listing())
        return 0
    if options.out.exists() and not options.out.is_dir():
        raise OutputError(f'Argument `--out` must be a folder, but "{options.out}" is a file.')
    try:
        plan = bench.plan(options.problems, options.solvers, quick=options.quick)
    except bench.SelectionError as error:
        print(f"jaxball: {error}", file=sys.stderr)
        return BAD_INPUT
    changes = {
        "tolerances": options.tolerances and tuple(options.tolerances),
        "budget": options.budget,
        "limit": options.limit,
    }
    settings = dataclasses.replace(plan.settings, **{key: value for key, value in changes.items() if value is not None})
    done = bench.bench(plan.problems, plan.contenders, settings, options.out)
    return INTERRUPTED if done.interrupted else 0
