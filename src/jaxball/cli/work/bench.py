"""Solvers compared, or listed."""

import argparse
import dataclasses
from pathlib import Path

from ... import bench
from ...interface.interruption import INTERRUPTED, STOPPED, interrupt_message
from ..options import BadInputError


def run(options: argparse.Namespace) -> int:
    """Prints the list, or compares."""
    if options.list:
        print(bench.listing())
        return 0
    try:
        plan = bench.plan(options.problems, options.solvers, quick=options.quick)
    except bench.SelectionError as error:
        raise BadInputError(str(error)) from None
    changes = {
        "tolerances": options.tolerances and tuple(options.tolerances),
        "budget": options.budget,
        "limit": options.limit,
    }
    settings = dataclasses.replace(plan.settings, **{key: value for key, value in changes.items() if value is not None})
    with interrupt_message(lambda: _stopped(options.out)):
        results = bench.bench(plan.problems, plan.contenders, settings, options.out)
    return INTERRUPTED if results.interrupted else 0


def _stopped(out: Path) -> str:
    written = (out / "results.json").exists()
    return f'Stopped; "{out}" has the problems that were finished.' if written else STOPPED
