"""Runs a study over all its rows, shows its progress, and draws its figures."""

import argparse
import sys
from pathlib import Path

from ... import sweep
from ...interface.interruption import STOPPED, exit_code, interrupt_message
from ...interface.output import OutputError
from ...interface.wording import counted
from ...scenario.sources import naming
from ...sweep.files import check_intact
from ..options import FAILED_SOLVE, BadInputError
from ..output import working
from .files import suffixes


def run(options: argparse.Namespace, text: str) -> int:
    """Runs the study of a file with this text, or says how much there is to run."""
    with naming(options.study):
        study = sweep.read_study(text, Path(options.study).parent)
    if options.dry_run:
        with working(options, "compiling, then solving a few rows"):
            estimate = sweep.estimate(study, measure=options.measure).sentence(options.workers)
        print(estimate if options.measure else f"{estimate}; --measure solves a few rows to estimate the time")
        return 0
    return _sweep(study, options)


def status(options: argparse.Namespace) -> int:
    """Prints the progress of a store."""
    print(sweep.describe(options.store))
    return 0


def plot(options: argparse.Namespace) -> int:
    """Draws the figures of a store."""
    data = sweep.open_dataset(options.store)
    check_intact(options.store)
    from ... import plot as figures  # here, because importing matplotlib takes longer than reading a study

    try:
        with working(options, "drawing"):
            paths = figures.sweep_figures(
                data,
                options.out,
                options.result,
                options.against,
                formats=suffixes(options.format),
                labels=dict(options.label),
                svg_text=options.svg_text,
                replace=options.force,
            )
    except OutputError as error:
        raise OutputError(str(error).replace("replace=True", "--force")) from None
    except figures.PictureError as error:
        raise BadInputError(str(error)) from None
    print(f"{counted(len(paths), 'figure')} of {options.store}")
    for path in paths:
        print(f"  written: {path}")
    return 0


def _sweep(study, options: argparse.Namespace) -> int:
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
        return exit_code()
    print(sweep.describe(outcome.store))
    written = f"{outcome.store}, {outcome.table}" if outcome.finished else f"{outcome.store}; other shards are not done"
    print(f"  written: {written}")
    return 0


def _stopped(out: Path) -> str:
    return f'Stopped; the rows in "{out}" are complete; run the same command to resume.' if out.exists() else STOPPED
