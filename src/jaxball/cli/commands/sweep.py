"""``jaxball sweep``: runs a study over all its rows, shows its progress, and draws its figures."""

import argparse
import importlib.util
import sys
from pathlib import Path

from ...interface.interruption import exit_code, interrupt_message
from ...interface.output import check_folder
from ...interface.starting import STOPPED
from ...interface.wording import all_of, number_of, pip_install
from ..input import STUDY, gather_problems, text_and_document
from ..jax_setup import set_up_jax
from ..options import FAILED_SOLVE, OUT_MISSING, BadInputError, add_formats, add_replacing, count, working

OF_FIGURES = ("result", "against", "label", "format", "svg_text", "force")
OF_RUNS = ("workers", "shard", "device", "dry_run", "measure")
NEEDED = ("zarr", "google_crc32c", "pandas", "pyarrow", "scipy", "filelock", "psutil")


def add(parser: argparse.ArgumentParser) -> None:
    parser.usage = (
        "jaxball sweep STUDY --out STORE [--workers N] [--shard K/N] [--device cpu|gpu] [--dry-run [--measure]]\n"
        "       jaxball sweep status STORE\n"
        "       jaxball sweep plot STORE --out FOLDER [--result NAME ...] [--against PATH ...]\n"
        "               [--label NAME=TEXT ...] [--format FORMAT ...] [--svg-text] [--force]"
    )
    parser.description = "Runs a study, or resumes one that was interrupted, for whatever reason."
    parser.add_argument("study", metavar="STUDY", help="a study file, or the word status or plot")
    parser.add_argument("store", nargs="?", type=Path, metavar="STORE", help="the store to describe or draw")
    parser.add_argument("--out", type=Path, metavar="STORE", help="the store, .zarr; for figures, their folder")
    parser.add_argument("--workers", type=count, metavar="N", help="number of processes (default: 1, on every core)")
    parser.add_argument("--shard", type=_shard, default=(1, 1), metavar="K/N", help="only the K-th of N parts")
    parser.add_argument(
        "--device", choices=("cpu", "gpu"), help="where runs are computed (default: a GPU, if JAX has one)"
    )
    parser.add_argument("--dry-run", action="store_true", help="print the number of rows and the size of the store")
    parser.add_argument("--measure", action="store_true", help="with --dry-run: solve a few rows to estimate the time")
    parser.add_argument("--result", nargs="+", default=[], metavar="NAME", help="results to draw, such as z[0]")
    parser.add_argument("--against", nargs="+", default=[], metavar="PATH", help="numbers to draw the results against")
    parser.add_argument(
        "--label",
        nargs="+",
        type=_label,
        default=[],
        metavar="NAME=TEXT",
        help="name of a number or a result in the figures, instead of its symbol, as in 'body.mass=$M$ (kg)'",
    )
    add_formats(parser, "--format")
    add_replacing(parser)
    # For errors that argparse does not find, with the usage of this command.
    parser.set_defaults(parser=parser)


def run(options: argparse.Namespace) -> int:
    parser: argparse.ArgumentParser = options.parser
    if options.study == "status":
        if options.store is None:
            parser.error("the following argument is required after status: STORE")
        _refuse(parser, options, ("out", *OF_FIGURES, *OF_RUNS), "has no meaning for jaxball sweep status")
        set_up_jax()
        from ...studies import sweep

        print(sweep.open_store(options.store).describe())
        return 0
    if options.study == "plot":
        _refuse(parser, options, OF_RUNS, "has no meaning for jaxball sweep plot")
        return _plot(parser, options)
    _refuse(parser, options, OF_FIGURES, "is for jaxball sweep plot")
    if options.measure and not options.dry_run:
        parser.error("argument --measure is for --dry-run")
    if options.store is not None:
        parser.error(f"unrecognized argument: {options.store}")
    if options.out is None and not options.dry_run:
        parser.error(OUT_MISSING)
    if not options.dry_run or options.measure:
        require_packages(NEEDED)
    text, _ = text_and_document(options.study, "study", STUDY)
    set_up_jax(options.device)
    return _sweep(options, text)


def _refuse(parser: argparse.ArgumentParser, options: argparse.Namespace, names: tuple[str, ...], why: str) -> None:
    """Ends the command where one of these options is given."""
    for name in names:
        if getattr(options, name) != parser.get_default(name):
            parser.error(f"argument --{name.replace('_', '-')} {why}")


def _sweep(options: argparse.Namespace, text: str) -> int:
    """Runs the study of a file with this text, or says how much there is to run."""
    from ...studies import sweep

    with gather_problems(options.study):
        study = sweep.read_study(text, Path(options.study).parent)
    if options.dry_run:
        with working(options, "solving a few rows"):
            estimate = study.estimate(measure=options.measure, workers=options.workers).sentence()
        print(estimate if options.measure else f"{estimate}; --measure solves a few rows to estimate the time")
        return 0
    try:
        with interrupt_message(lambda: _describe_stop(options.out)):
            workers = options.workers or 1
            outcome = study.run(options.out, workers=workers, shard=options.shard, stream=sys.stderr)
    except sweep.WorkerError as error:
        print(f"jaxball: {error}", file=sys.stderr)
        return FAILED_SOLVE
    if outcome.interrupted:
        print(
            f"jaxball: Stopped with {outcome.done:,} of {outcome.rows:,} rows done; run the same command to resume.",
            file=sys.stderr,
        )
        return exit_code()
    print(sweep.open_store(outcome.store).describe())
    written = f"{outcome.store}, {outcome.table}" if outcome.finished else f"{outcome.store}; other shards are not done"
    print(f"  written: {written}")
    return 0


def _describe_stop(out: Path) -> str:
    return f'Stopped; the rows in "{out}" are complete; run the same command to resume.' if out.exists() else STOPPED


def _plot(parser: argparse.ArgumentParser, options: argparse.Namespace) -> int:
    if options.store is None:
        parser.error("the following argument is required after plot: STORE")
    if options.out is None:
        parser.error(f"{OUT_MISSING}, as in {parser.prog} plot {options.store} --out FOLDER")
    require_packages(("zarr", "google_crc32c"))
    check_folder(options.out, "--out")
    set_up_jax()
    from ... import plot
    from ...studies import sweep
    from ...studies.sweep.files import check_intact
    from ..files import suffixes

    data = sweep.open_store(options.store).dataset()
    # Before anything is drawn of numbers that something else may have changed.
    check_intact(options.store)
    try:
        with working(options, "drawing"):
            paths = plot.sweep_figures(
                data,
                options.out,
                options.result,
                options.against,
                formats=suffixes(options.format),
                labels=dict(options.label),
                svg_text=options.svg_text,
                replace=options.force,
            )
    except plot.PictureError as error:
        raise BadInputError(str(error)) from None
    print(f"{number_of(len(paths), 'figure')} of {options.store}")
    for path in paths:
        print(f"  written: {path}")
    return 0


def require_packages(packages: tuple[str, ...]) -> None:
    """Raises where one of the packages is not installed."""
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        are = "is" if len(missing) == 1 else "are"
        raise BadInputError(f"A sweep needs {all_of(missing)}, which {are} not installed; {pip_install('sweep')}.")


def _label(text: str) -> tuple[str, str]:
    name, equals, label = text.partition("=")
    if not (name and equals and label):
        raise argparse.ArgumentTypeError(f"it must be NAME=TEXT, but it is {text}")
    return name, label


def _shard(text: str) -> tuple[int, int]:
    part, _, parts = text.partition("/")
    if not (part.isdigit() and parts.isdigit() and 1 <= int(part) <= int(parts)):
        raise argparse.ArgumentTypeError(f"it must be K/N with K from 1 to N, but it is {text}")
    return int(part), int(parts)
