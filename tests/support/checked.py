"""Where shapes and types are checked at run time."""

import importlib.util
import pkgutil

# Its functions are called a hundred thousand times for a program, and take no arrays whose shapes could be wrong.
UNCHECKED = "native"


def modules() -> list[str]:
    """The modules and packages of jaxball, but for the compiler."""
    package = importlib.util.find_spec("jaxball")
    assert package is not None
    assert package.submodule_search_locations
    inside = pkgutil.iter_modules(list(package.submodule_search_locations))
    return [f"jaxball.{module.name}" for module in inside if module.name != UNCHECKED]
