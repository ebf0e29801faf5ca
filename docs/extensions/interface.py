"""The reference of the Python interface: a page for each package, from the docstrings of every public name."""

import builtins
import functools
import importlib
import inspect
import sys
from types import ModuleType
from typing import Any

import jaxball
from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util import logging

from .links import DOCS, write_page

PLACE = DOCS / "reference" / "python"
logger = logging.getLogger(__name__)

# The names of `jaxball` itself, by the modules that hold them.
CHAPTERS = {
    "running": ("Simulating", ["simulation.simulate", "simulation.trajectory", "interface.status", "results", "scenario"]),
    "bodies": (
        "Bodies and their surroundings",
        ["physics.body", "physics.motion", "physics.ground", "physics.force", "physics.resistance", "physics.validity"],
    ),
    "rails": ("Rails and frames", ["physics.rails", "physics.frames"]),
    "schedules": (
        "Schedules, signals and laws",
        ["physics.schedules", "physics.signals", "physics.feedback", "numerics.harmonics"],
    ),
    "mechanisms": ("Mechanisms", ["physics.mechanisms"]),
    "states": ("States and what is read off them", ["physics.state", "physics.observables", "simulation.equilibrium"]),
    "events": (
        "Events and extremes",
        ["simulation.events", "simulation.occurrences", "simulation.extremes"],
    ),
    "systems": ("Systems of your own", ["physics.system"]),
}
# Packages that a user imports, in the order in which the site lists them.
PACKAGES = [
    "classical",
    "solvers",
    "plot",
    "scenario",
    "results",
    "ensemble",
    "sweep",
    "design",
    "design.control",
    "chaos",
    "stability",
    "verify",
    "paper",
    "paper.reference",
    "paper.reproduce",
    "bench",
    "cpu",
    "cache",
]
LEAD = """# The Python interface

Every public name with its arguments, shapes, units and errors, from its docstring, which `help()` shows too. The names of
`jaxball` itself come first, in chapters; then the packages. Shapes are written as
[jaxtyping](https://docs.kidger.site/jaxtyping/) does: `Float[Array, "*batch T"]` has a row for each time after the axes of a
batch, if there is one.
"""
# Their types are named, but live in documents of others, which a site that is read without network cannot link to.
ELSEWHERE = ("jax", "jaxlib", "jaxtyping", "numpy", "diffrax", "equinox", "optimistix", "lineax", "matplotlib", "xarray")


def entry(found: Any, name: str) -> str:
    """What autodoc is told of one name."""
    if inspect.isclass(found):
        members = sorted(
            member
            for member, value in vars(found).items()
            if not member.startswith("_") and (getattr(value, "__doc__", None) and shows(value))
        )
        listed = f"\n   :members: {', '.join(members)}" if members else ""
        return f".. autoclass:: {name}{listed}\n"
    return f".. autofunction:: {name}\n" if inspect.isfunction(found) else f".. autodata:: {name}\n   :no-value:\n"


def shows(value: Any) -> bool:
    """Whether a class shows this member of its own: methods and properties, not what it holds."""
    return inspect.isfunction(value) or isinstance(value, property | classmethod | staticmethod)


def page(title: str, lead: str, module: str, names: list[str], declared: bool) -> str:
    package = importlib.import_module(module)
    directive = "module" if declared else "currentmodule"
    entries = "\n".join(entry(getattr(package, name), name) for name in names)
    return f"# {title}\n\n{lead}\n\n```{{eval-rst}}\n.. py:{directive}:: {module}\n\n{entries}\n```\n"


def described(module: ModuleType) -> str:
    """A package's docstring as Markdown, whose ends of code are single."""
    return "```{eval-rst}\n" + inspect.getdoc(module) + "\n```"


def write_reference(app: Sphinx) -> None:
    """Writes a page for each chapter and package."""
    held = {module: names.split() for module, names in jaxball._NAMES.items()}
    chapters = [module for _, modules in CHAPTERS.values() for module in modules]
    if sorted(chapters) != sorted(held):
        logger.warning(f"interface.CHAPTERS and the modules of jaxball differ: {set(chapters) ^ set(held)}")
    for k, (stem, (title, modules)) in enumerate(CHAPTERS.items()):
        names = [name for module in modules for name in held[module]]
        write_page(PLACE / f"{stem}.md", page(title, "", "jaxball", names, declared=not k))
    for name in PACKAGES:
        package = importlib.import_module(f"jaxball.{name}")
        text = page(f"`jaxball.{name}`", described(package), package.__name__, sorted(package.__all__), declared=True)
        write_page(PLACE / f"{name}.md", text)
    listed = "\n".join([*CHAPTERS, *PACKAGES])
    write_page(PLACE / "index.md", f"{LEAD}\n```{{toctree}}\n:maxdepth: 1\n\n{listed}\n```\n")


@functools.cache
def public_names() -> dict[int, str]:
    """Where a user finds each object: the first of its names."""
    names: dict[int, str] = {}
    for module in ("jaxball", *(f"jaxball.{name}" for name in PACKAGES)):
        package = importlib.import_module(module)
        for name in package.__all__:
            names.setdefault(id(getattr(package, name)), f"{module}.{name}")
    return names


def found_at(path: str) -> Any:
    """What a dotted path leads to, or None."""
    parts = path.split(".")
    for k in range(len(parts), 0, -1):
        try:
            return functools.reduce(getattr, parts[k:], importlib.import_module(".".join(parts[:k])))
        except ImportError:
            continue
        except AttributeError:
            return None
    return None


def resolve(app: Sphinx, env: BuildEnvironment, node: pending_xref, shown: nodes.TextElement) -> nodes.Element | None:
    """Leads from the module in which an object lives to the name under which it is public.

    What an annotation names and is not public, or lives in another library, stays a word. A role that leads nowhere is
    reported.
    """
    if node.get("refdomain") != "py":
        return None
    target = node["reftarget"]
    if (name := public_names().get(id(found_at(target)))) and name != target:
        domain = env.get_domain("py")
        return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", name, node, shown)
    root = target.partition(".")[0]
    if root in ELSEWHERE or root in sys.stdlib_module_names or hasattr(builtins, root) or "refwarn" not in node:
        return shown
    return None


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", write_reference)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
