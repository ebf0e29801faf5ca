"""``jaxball cache``: shows or removes the compiled programs that are kept."""

import argparse

from ...interface.wording import number_of
from ...programs.cache import Contents, clear, contents


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = "Shows where compiled programs are kept, so that each is compiled once, and their size."
    parser.epilog = "JAXBALL_CACHE_DIR sets the folder; JAXBALL_NO_CACHE=1 or --no-cache turns the cache off."
    parser.add_argument("--clear", action="store_true", help="remove all of them")


def run(options: argparse.Namespace) -> int:
    if options.clear:
        print(f"{_amount(clear())} removed")
        return 0
    cache = contents()
    print(f"Compiled programs in {cache.folder}")
    print(f"  {_amount(cache)} of at most {_megabytes(cache.limit)}")
    print(f"  {number_of(cache.native + cache.xla, 'program')}: {cache.native} compiled natively, {cache.xla} by XLA")
    print(f"  not in use: {cache.objection}" if cache.objection else "  in use")
    return 0


def _amount(programs: Contents) -> str:
    return f"{number_of(programs.files, 'file')}, {_megabytes(programs.size)}"


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.1f} MB"
