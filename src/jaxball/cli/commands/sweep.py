"""``jaxball sweep``: a study run over all its rows, its progress, and its figures."""

import argparse
import importlib.util
import sys
from pathlib import Path

from ...interface.interruption import INTERRUPTED, STOPPED, interrupt_message
from ...interface.output import check_folder
from ...interface.wording import all_of, counted
from ..options import FAILED_SOLVE, BadInputError, count

NEEDED = ("zarr", "pandas", "pyarrow", "scipy")


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser(
        "sweep",
        usage=(
            "jaxball sweep STUDY --out STORE [--workers N] [--shard K/N] [--dry-run [--measure]]\n"
            "       jaxball sweep status STORE\n"
            "       jaxball sweep plot STORE --out FOLDER [--result NAME ...] [--against PATH ...]"
        ),
        description="Runs a study, or resumes one that was stopped, whatever stopped it.",
    )
    parser.add_argument("study", metavar="STUDY", help="a study file, or the word status or plot")
    parser.add_argument("store", nargs="?", type=Path, metavar="STORE", help="the store whose status or figures")
    parser.add_argument("--out", type=Path, metavar="STORE", help="the store, .zarr; for figures, their folder")
    parser.add_argument("--workers", type=count, default=1, metavar="N", help="number of processes (default: 1)")
    parser.add_argument("--shard", type=_shard, default=(1, 1), metavar="K/N", help="only the K-th of N parts")
    parser.add_argument("--dry-run", action="store_true", help="print the number of rows and the size of the store")
    parser.add_argument("--measure", action="store_true", help="with --dry-run: solve a few rows to estimate the time")
    parser.add_argument("--result", nargs="+", default=[], metavar="NAME", help="what to draw, such as z[0]")
    parser.add_argument("--against", nargs="+", default=[], metavar="PATH", help="the numbers to draw it against")
    parser.set_defaults(run=lambda options: _run(parser, options))


def _run(parser: argparse.ArgumentParser, options: argparse.Namespace) -> int:
    # Imported here, because the other commands have no use for it.
    from ... import sweep

    if options.study == "status":
        if options.store is None:
            parser.error("the following argument is required after status: STORE")
        print(sweep.describe(options.store))
        return 0
    if options.study == "plot":
        return _plot(parser, options)
    for name in ("result", "against"):
        if getattr(options, name):
            parser.error(f"argument --{name} is for jaxball sweep plot")
    if options.measure and not options.dry_run:
        parser.error("argument --measure is for --dry-run")
    if options.store is not None:
        parser.error(f"unrecognized argument: {options.store}")
    _require(NEEDED)
    study = sweep.load_study(options.study)
    if options.dry_run:
        if options.measure:
            print("jaxball: compiling, then solving a few rows", file=sys.stderr)
        estimate = sweep.estimate(study, measure=options.measure).sentence(options.workers)
        print(estimate if options.measure else f"{estimate}; --measure solves a few rows to estimate the time")
        return 0
    if options.out is None:
        parser.error("the following argument is required: --out")
    return _sweep(study, options)


def _sweep(study, options: argparse.Namespace) -> int:
    from ... import sweep

    try:
        with interrupt_message(lambda: _stopped(options.out)):
            outcome = sweep.sweep(study, options.out, workers=options.workers, shard=options.shard, stream=sys.stderr)
    except sweep.WorkerError as error:
        print(f"jaxball: {error}", file=sys.stderr)
        return FAILED_SOLVE
    if outcome.interrupted:
        print(
            f"jaxball: Stopped with {outcome.done:,} of {outcome.rows:,} rows done; run the same command to resume.",
            file=sys.stderr,
        )
        return INTERRUPTED
    print(sweep.describe(outcome.store))
    written = f"{outcome.store}, {outcome.table}" if outcome.finished else f"{outcome.store}; other shards are not done"
    print(f"  written: {written}")
    return 0


def _plot(parser: argparse.ArgumentParser, options: argparse.Namespace) -> int:
    if options.store is None or options.out is None:
        parser.error("the following arguments are required after plot: STORE, --out")
    _require(("zarr",))
    from ... import plot, sweep

    data = sweep.open_dataset(options.store)
    check_folder(options.out, "--out")
    try:
        paths = plot.sweep_figures(data, options.out, options.result, options.against)
    except plot.PictureError as error:
        raise BadInputError(str(error)) from None
    print(f"{counted(len(paths), 'figure')} of {options.store}")
    for path in paths:
        print(f"  written: {path}")
    return 0


def _stopped(out: Path) -> str:
    return f'Stopped; the rows in "{out}" are complete; run the same command to resume.' if out.exists() else STOPPED


def _require(packages: tuple[str, ...]) -> None:
    """Raises where one of the packages is not installed."""
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        are = "is" if len(missing) == 1 else "are"
        raise BadInputError(
            f"A sweep needs {all_of(missing)}, which {are} not installed; pip install 'jaxball[sweep]'."
        )


def _shard(text: str) -> tuple[int, int]:
    part, _, parts = text.partition("/")
    if not (part.isdigit() and parts.isdigit() and 1 <= int(part) <= int(parts)):
        raise argparse.ArgumentTypeError(f"it must be K/N with K from 1 to N, but it is {text}")
    return int(part), int(parts)
