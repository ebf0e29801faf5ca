"""``jaxball scenarios``: lists the built-in scenarios, or prints one as a file."""

import argparse

from ...files.scenario.sources import builtin_scenarios, builtin_text, builtin_title, with_schema


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", help="the scenario to print")


def run(options: argparse.Namespace) -> int:
    if options.name is not None:
        print(with_schema(builtin_text(options.name)), end="")
        return 0
    names = builtin_scenarios()
    width = max(len(name) for name in names)
    for name in names:
        print(f"{name:{width}}  {builtin_title(name)}")
    return 0
