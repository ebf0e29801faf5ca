"""The scenario that a command reads: a file, a built-in one or standard input, with some of its values changed."""

import argparse
import sys
from typing import Any

from ..scenario import Scenario, ScenarioError, load_scenario, read_document, read_scenario, scenario_text
from ..scenario.paths import with_values
from ..scenario.sources import document_of, naming

STDIN = "-"


def add_scenario(parser: argparse.ArgumentParser) -> None:
    """Adds FILE|NAME and --set."""
    parser.add_argument(
        "scenario", metavar="FILE|NAME", help="a scenario file, a built-in scenario, or - for standard input"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="PATH=VALUE",
        help="change a value of the scenario, as in body.mass=2 or 'masses[0].mass=0.3'; may be given several times",
    )


def input_text(source: str) -> str | None:
    """The text of standard input where ``source`` is -, else None.

    **Raises:** :class:`~jaxball.ScenarioError` where it is not text.
    """
    if source != STDIN:
        return None
    try:
        return sys.stdin.read()
    except UnicodeDecodeError:
        raise ScenarioError("Standard input must be text in UTF-8, but it is not.") from None


def named_scenario(source: str) -> Scenario:
    """The scenario of a file, of a built-in name, or on standard input.

    **Raises:** :class:`~jaxball.ScenarioError` where it cannot be read.
    """
    text = input_text(source)
    if text is None:
        return load_scenario(source)
    with naming(source_name(source)):
        return read_scenario(text)


def scenario_of(options: argparse.Namespace, end: float | None = None) -> Scenario:
    """The scenario that the options name, changed by ``--set`` and, where it is given, with another ``time.end``.

    **Raises:** :class:`~jaxball.ScenarioError` where it cannot be read, before or after the changes.
    """
    document = scenario_document(options, end)
    with naming(source_name(options.scenario)):
        return read_document(document)


def scenario_document(options: argparse.Namespace, end: float | None = None) -> dict[str, Any]:
    """The document that :func:`scenario_of` reads."""
    text = input_text(options.scenario)
    text = scenario_text(options.scenario) if text is None else text
    with naming(source_name(options.scenario)):
        document = document_of(text, "scenario", ScenarioError)
    document = with_values(document, options.set)
    if end is not None:
        times = document.get("time")
        if isinstance(times, dict) and "at" in times:
            raise ScenarioError(
                "Argument `--end` must be left out where the scenario lists its times one by one, as this one does "
                "in `time.at`; give others with --set 'time.at=[0, 1, 2]'."
            )
        document = with_values(document, [f"time.end={end!r}"])
    return document


def source_name(source: str) -> str:
    """What messages call a source."""
    return "standard input" if source == STDIN else source
