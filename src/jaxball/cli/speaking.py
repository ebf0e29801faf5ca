"""What a command says, and to whom: people, files of JSON, or programs that read its output."""

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ..interface.output import check_destination, replacing

STDOUT = Path("-")


def add_speaking(parser: argparse.ArgumentParser) -> None:
    """Adds --quiet and --json."""
    parser.add_argument("--quiet", action="store_true", help="print no summary, but for errors")
    add_json(parser, "the summary")


def add_json(parser: argparse.ArgumentParser, what: str) -> None:
    """Adds --json."""
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help=f"write {what} as JSON: .json, or - for standard output"
    )


def check_json(options: argparse.Namespace) -> None:
    """Raises an :class:`~jaxball.results.OutputError` where the file of --json cannot be."""
    if options.json is not None and options.json != STDOUT:
        check_destination(options.json, (".json",), "--json")


def write_json(options: argparse.Namespace, content: dict[str, Any]) -> None:
    """Writes the content where --json wants it; numbers that are not finite, which JSON does not have, as null."""
    if options.json is None:
        return
    text = json.dumps(_plain(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    if options.json == STDOUT:
        sys.stdout.write(text)
        return
    with replacing(options.json) as beside:
        beside.write_text(text, encoding="utf-8")


def say(options: argparse.Namespace, text: object) -> None:
    """Prints for people: nothing where they asked for quiet, and beside the JSON where that has standard output."""
    if not getattr(options, "quiet", False):
        print(text, file=sys.stderr if options.json == STDOUT else sys.stdout, flush=True)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, complex):
        return {"real": value.real, "imaginary": value.imag}
    return None if isinstance(value, float) and not math.isfinite(value) else value
