"""What the commands share: exit codes, and the kinds of numbers that their options take."""

import argparse
import math

BAD_INPUT = 2
FAILED_SOLVE = 3
BROKEN_PIPE = 141  # as a shell reports it of other programs


class BadInputError(ValueError):
    """What was typed cannot be; the message is one sentence that says what and why."""


def positive(text: str) -> float:
    """A positive number, for argparse."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"it must be a positive number, but it is {text}")
    return value


def number(text: str) -> float:
    """A finite number, for argparse."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"it must be a finite number, but it is {text}")
    return value
