"""Shared by the commands: exit codes, and the types of numbers that their options take."""

import argparse
import math

from ..interface.errors import UserError

BAD_INPUT = 2
FAILED_SOLVE = 3
BROKEN_PIPE = 141  # as a shell reports it for other programs


class BadInputError(UserError):
    """The command line asks for something impossible; the message is one sentence that says what and why."""


def positive(text: str) -> float:
    """A positive number, for argparse."""
    value = _parsed(text)
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"it must be a positive number, but it is {text}")
    return value


def number(text: str) -> float:
    """A finite number, for argparse."""
    value = _parsed(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"it must be a finite number, but it is {text}")
    return value


def count(text: str) -> int:
    """A whole number, 1 or more, for argparse."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"it must be a whole number, 1 or more, but it is {text}")
    return int(text)


def add_no_cache(parser: argparse.ArgumentParser) -> None:
    """Adds --no-cache."""
    parser.add_argument(
        "--no-cache",
        dest="cache",
        action="store_false",
        default=True,
        help="neither use nor keep compiled programs; see jaxball cache",
    )


def _parsed(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
