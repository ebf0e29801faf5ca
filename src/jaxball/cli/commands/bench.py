"""``jaxball bench``: solvers compared at equal achieved error."""

import argparse
from pathlib import Path

from ...interface.output import check_folder
from ..jax_setup import set_up_jax
from ..options import positive


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser("bench")
    parser.add_argument("problems", nargs="*", metavar="PROBLEM", help="which problems (default: all)")
    parser.add_argument("--solvers", nargs="+", default=[], metavar="NAME", help="solvers, packages, or parts of names")
    parser.add_argument("--tolerances", nargs="+", type=positive, metavar="RTOL", help="default: 1e-4 to 1e-13")
    parser.add_argument("--budget", type=positive, metavar="SECONDS", help="time for the timed calls of each setting")
    parser.add_argument(
        "--limit", type=positive, metavar="SECONDS", help="leave out solvers that take longer per solve"
    )
    parser.add_argument("--out", type=Path, default=Path("out/bench"), metavar="FOLDER", help="default: out/bench")
    parser.add_argument("--quick", action="store_true", help="two problems, a few solvers, two tolerances")
    parser.add_argument("--list", action="store_true", help="list problems and solvers")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    if not options.list:
        check_folder(options.out, "--out")
    set_up_jax()
    from ..work.bench import run

    return run(options)
