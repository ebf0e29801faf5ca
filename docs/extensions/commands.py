"""The reference of the command line: what ``--help`` prints, of each command and of each of its own commands."""

import argparse

from sphinx.application import Sphinx

from jaxball.cli.dispatch import COMMANDS, parser_of

from .links import DOCS, write_page

LEAD = """# The command line

This is what `jaxball COMMAND --help` prints. [Scenario files](scenario-files.md#scenarios-on-the-command-line) explains
the options that change a scenario, and [exit codes](scenario-files.md#exit-codes).
"""


def parsers(command: str, parser: argparse.ArgumentParser) -> list[tuple[str, argparse.ArgumentParser]]:
    """A command, and the commands within it."""
    within = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return [(command, parser)] + [
        pair for action in within for name, one in action.choices.items() for pair in parsers(f"{command} {name}", one)
    ]


def write_commands(app: Sphinx) -> None:
    text = LEAD
    for name in COMMANDS:
        whole = next(action for action in parser_of([name])._actions if isinstance(action, argparse._SubParsersAction))
        for command, parser in parsers(name, whole.choices[name]):
            parser.formatter_class = of_width(parser.formatter_class)
            depth = "#" * (1 + len(command.split()))
            text += f"\n{depth} jaxball {command}\n\n```text\n{parser.format_help().rstrip()}\n```\n"
    write_page(DOCS / "reference" / "command-line.md", text)


def of_width(formatter: type[argparse.HelpFormatter]):
    """A formatter that is as wide as the page, and not as the terminal in which the site is built."""
    return lambda prog: formatter(prog, width=92)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", write_commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
