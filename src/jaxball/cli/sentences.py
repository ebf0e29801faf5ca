"""Errors as sentences of the command line."""

import re

# What the command line calls arguments of Python functions that are not options of the same name.
POSITIONAL = {
    "source": "FILE",
    "name": "NAME",
    "problems": "PROBLEM",
    "data": "STORE",
    "ball": "The scenario's ball",
    "inclination": "INCLINATION",
    "precession": "PRECESSION",
}


def sentence(error: Exception) -> str:
    """The message of an error, with arguments named as on the command line."""
    if isinstance(error, OSError) and error.strerror:
        place = "The output" if error.filename is None else f'"{error.filename}"'
        return f"{place} cannot be {'written' if error.filename is None else 'used'}: {error.strerror}."

    def on_command_line(match: re.Match[str]) -> str:
        return POSITIONAL.get(match[1]) or f"Argument `--{match[1].replace('_', '-')}`"

    return re.sub(r"Argument `(\w+)`", on_command_line, str(error))
