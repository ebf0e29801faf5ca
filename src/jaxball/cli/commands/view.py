"""``jaxball view``: a saved run, a design or rows of a sweep as one HTML file."""

import argparse
from pathlib import Path

from ...interface.views import MOST_BODIES, check_view
from ...interface.wording import counted
from ...results.files import READ_BACK, RunError, check_saved
from ..jax_setup import set_up_jax
from ..options import BadInputError, positive
from ..output import add_quiet
from .sweep import require_packages

DESIGN, SWEEP = "design.toml", "zarr.json"  # by which folders are recognised


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser(
        "view",
        usage=(
            "jaxball view RUN --out FILE [--friction MU] [--all-times]\n"
            "       jaxball view DESIGN --out FILE [--friction MU] [--all-times]\n"
            "       jaxball view STORE --rows K,K,... [--colour NUMBER] --out FILE [--friction MU] [--all-times]"
        ),
        description="Writes a saved run as one HTML file, as `jaxball simulate --view` does: the body in "
        "three dimensions, played or stepped through, with graphs over time. For the folder of a design, it shows "
        "the runs before and after; for the store of a sweep, the rows given by --rows. The file needs no network.",
    )
    parser.add_argument("saved", type=Path, metavar="RUN", help="a saved run, or the folder of a design or a sweep")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the file to write: .html")
    parser.add_argument("--friction", type=positive, metavar="MU", help="draw the cone of this coefficient of friction")
    parser.add_argument("--rows", type=_rows, metavar="K,K,...", help="the rows of a sweep, as in 3,17,40")
    parser.add_argument("--colour", metavar="NUMBER", help="number that colours them, such as body.mass or z[0]")
    parser.add_argument("--all-times", action="store_true", help="show all saved times of a long run, in a large file")
    add_quiet(parser)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    check_view(options.out, "--out")
    kind = _kind(options.saved)
    if kind == SWEEP:
        if options.rows is None:
            raise BadInputError(f'Argument `--rows` must say which rows of "{options.saved}" to show, as in 3,17,40.')
        require_packages(("zarr", "google_crc32c"))
    else:
        for name in ("rows", "colour"):
            if getattr(options, name) is not None:
                raise BadInputError(f'Argument `--{name}` is for the store of a sweep, which "{options.saved}" is not.')
    set_up_jax()
    from ..work import view

    return {DESIGN: view.of_design, SWEEP: view.of_sweep}.get(kind, view.run)(options)


def _kind(path: Path) -> str:
    """What there is to show: the name of the file that identifies a folder, empty for a file."""
    if not path.is_dir():
        check_saved(path)
        return ""
    for name in (DESIGN, SWEEP):
        if (path / name).is_file():
            return name
    raise RunError(
        f"What is shown must be a run in a {' or '.join(READ_BACK)} file, or the folder of a design or of a sweep, but "
        f'"{path}" is a folder without a {DESIGN} or a {SWEEP}.'
    )


def _rows(text: str) -> tuple[int, ...]:
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdecimal() and part.isascii() for part in parts):
        raise argparse.ArgumentTypeError(f"it must be row numbers separated by commas, but it is {text}")
    rows = tuple(int(part) for part in parts)
    if len(set(rows)) < len(rows) or len(rows) > MOST_BODIES:
        given = counted(len(rows), "row") + " with one twice" * (len(set(rows)) < len(rows))
        raise argparse.ArgumentTypeError(f"it must be up to {MOST_BODIES} different rows, but it is {given}")
    return rows
