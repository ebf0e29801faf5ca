"""``jaxball schema``: prints the JSON Schema of a kind of file, by which editors complete and check such files."""

import argparse

from ...files.scenario.sources import SCHEMAS

KINDS = ("scenario", "study", "problem", "control")


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Prints the JSON Schema of a kind of file. An editor that knows it completes keys and marks what no such file "
        "may have. Rules that involve several keys are checked by `jaxball validate`."
    )
    parser.add_argument("kind", choices=KINDS, help="the kind of file; control is a problem with the table [control]")


def run(options: argparse.Namespace) -> int:
    print((SCHEMAS / f"{options.kind}.json").read_text(encoding="utf-8"), end="")
    return 0
