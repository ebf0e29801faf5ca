"""Scenarios to be designed."""

import copy
import tomllib

from jaxball.files.scenario.sources import builtin_text


def builtin(name, **time):
    """The document of a built-in scenario, with other times."""
    document = copy.deepcopy(tomllib.loads(builtin_text(name)))
    if time:
        document["time"] = time
    return document
