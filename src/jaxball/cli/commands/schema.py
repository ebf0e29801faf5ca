"""``jaxball schema``: prints the JSON Schema of a kind of file, by which editors complete and check such files."""

import argparse
import json
from typing import Any

from ..jax_setup import set_up_jax

KINDS = ("scenario", "study", "problem", "control")


def schema(kind: str) -> dict[str, Any]:
    """Returns the JSON Schema of a kind of file."""
    from ...scenario.schema import scenario_schema, schema_of

    if kind == "scenario":
        return scenario_schema()
    if kind == "study":
        from ...sweep.study import KEYS

        return schema_of("study", KEYS)
    from ...design.files import schemas

    return schemas()[kind]


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Prints the JSON Schema of a kind of file. An editor that knows it completes keys and marks what no such file "
        "may have. Rules that involve several keys are checked by `jaxball validate`."
    )
    parser.add_argument("kind", choices=KINDS, help="the kind of file; control is a problem with the table [control]")


def run(options: argparse.Namespace) -> int:
    set_up_jax()
    print(json.dumps(schema(options.kind), indent=1, ensure_ascii=False))
    return 0
