"""What the commands share: exit codes, and the types of numbers that their options take."""

import argparse
import math

BAD_INPUT = 2
FAILED_SOLVE = 3
BROKEN_PIPE = 141  # as a shell reports it of other programs


class BadInputError(ValueError):
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
    """A whole number from 1 on, for argparse."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"it must be a whole number, 1 or more, but it is {text}")
    return int(text)


def _parsed(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
