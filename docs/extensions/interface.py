"""The reference of the Python interface: a page for each package, from the docstrings of every public name."""

import builtins
import functools
import importlib
import inspect
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util import logging

import jaxball

from .links import DOCS, write_pages

PLACE = DOCS / "reference" / "python"
logger = logging.getLogger(__name__)

# The names of `jaxball` itself, by the modules that hold them.
CHAPTERS = {
    "running": (
        "Simulating",
        [
            "simulation.simulate",
            "simulation.arguments",
            "simulation.trajectory",
            "simulation.global_error",
            "simulation.errors_of_results",
            "interface.status",
            "interface.warning",
            "programs.users_functions",
            "programs.native",
            "results",
            "scenario",
        ],
    ),
    "bodies": (
        "Bodies and their surroundings",
        [
            "physics.body",
            "physics.convex",
            "physics.shape",
            "physics.dynamics.parameters",
            "physics.prescribed.motion",
            "physics.grounds",
            "physics.grounds.ground",
            "physics.forces.force",
            "physics.forces.resistance",
            "physics.validity",
        ],
    ),
    "rails": ("Rails and frames", ["physics.prescribed.rails", "physics.prescribed.frames"]),
    "schedules": (
        "Schedules, signals and laws",
        [
            "physics.prescribed.schedules",
            "physics.prescribed.signals",
            "physics.prescribed.recorded",
            "physics.feedback",
            "numerics.functions",
        ],
    ),
    "mechanisms": ("Mechanisms", ["physics.mechanisms"]),
    "states": (
        "States and observables",
        ["physics.state", "physics.own_states", "physics.observables", "simulation.equilibrium"],
    ),
    "events": (
        "Events and extremes",
        ["simulation.events", "simulation.extremes", "simulation.losses"],
    ),
    "contact": (
        "Slip, flight and impact",
        ["physics.contact.law", "physics.contact.modes", "physics.contact.released", "physics.contact.history"],
    ),
    "systems": ("Systems of your own", ["physics.system", "physics.hybrid", "physics.rolling"]),
}
# Packages that a user imports, in the order in which the site lists them.
PACKAGES = [
    "classical",
    "sensors",
    "solvers",
    "plot",
    "scenario",
    "results",
    "mjcf",
    "urdf",
    "control",
    "estimation",
    "environments",
    "ensemble",
    "sweep",
    "design",
    "design.optimal_control",
    "chaos",
    "stability",
    "verify",
    "paper",
    "paper.reference",
    "paper.reproduce",
    "cpu",
    "cache",
]
LEAD = """# The Python interface

Every public name with its arguments, shapes, units and errors, from its docstring, which `help()` shows as well. The
names of `jaxball` itself come first, in chapters, followed by the packages. Shapes are written in the notation of
[jaxtyping](https://docs.kidger.site/jaxtyping/): `Float[Array, "*batch T"]` has one row for each time, after the axes
of a batch, if there are any.
"""
# Their types are named, but live in documents of others, which a site that is read without network cannot link to.
ELSEWHERE = (
    "jax",
    "jaxlib",
    "jaxtyping",
    "numpy",
    "diffrax",
    "equinox",
    "optimistix",
    "lineax",
    "matplotlib",
    "xarray",
    "gymnasium",
)


def entry(found: Any, name: str) -> str:
    """What is said of one name; a class is shown with what it adds to those it is derived from."""
    if not (is_constant(found) or inspect.getdoc(found)):
        logger.warning(f"{name} is public and has no docstring.")
    if inspect.isfunction(found):
        return f".. autofunction:: {name}\n"
    if is_constant(found):
        return f".. py:data:: {name}\n\n   {value_of(found)}\n"
    members = sorted(
        member
        for member, value in vars(found).items()
        if not member.startswith("_") and shows(value) and getattr(value, "__doc__", None)
    )
    listed = f"   :members: {', '.join(members)}\n" if members else ""
    return f".. autoclass:: {name}\n{listed}"


def value_of(constant: Any) -> str:
    if isinstance(constant, Mapping):
        return "A dictionary with the keys " + ", ".join(f"``{key!r}``" for key in constant) + "."
    return f"``{constant!r}``"


def is_constant(found: Any) -> bool:
    return not (inspect.isclass(found) or inspect.isfunction(found))


def shows(value: Any) -> bool:
    """Whether a class shows this member of its own: methods and properties, not what it holds."""
    return inspect.isfunction(value) or isinstance(value, property | classmethod | staticmethod)


def page(title: str, lead: str, module: str, names: Sequence[str], declared: bool) -> str:
    """A page of entries; what another page has under another name is only named."""
    package = importlib.import_module(module)
    first = {name: public_names()[id(getattr(package, name))] for name in names}
    own = [name for name in names if first[name] == f"{module}.{name}"]
    others = ", ".join(f":obj:`{first[name]}`" for name in names if name not in own)
    directive = "module" if declared else "currentmodule"
    parts = [f".. py:{directive}:: {module}", lead, others and f"Also here: {others}."]
    parts += [entry(getattr(package, name), name) for name in own]
    text = "\n\n".join(part for part in parts if part)
    return f"# {title}\n\n```{{eval-rst}}\n{text}\n```\n"


def escaped(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """A norm is written with bars, which mean something else in reStructuredText outside of code."""
    lines[:] = ["``".join(bars(part, k) for k, part in enumerate(line.split("``"))) for line in lines]


def bars(part: str, k: int) -> str:
    return part if k % 2 else part.replace("|", "\\|")


def write_reference(app: Sphinx) -> None:
    """Writes a page for each chapter and package."""
    held: dict[str, list[str]] = {}
    for name, module in jaxball._NAMES.items():
        held.setdefault(module.removeprefix("."), []).append(name)
    chapters = [module for _, modules in CHAPTERS.values() for module in modules]
    if sorted(chapters) != sorted(held):
        logger.warning(f"interface.CHAPTERS and the modules of jaxball differ: {set(chapters) ^ set(held)}")
    pages = {}
    for k, (stem, (title, modules)) in enumerate(CHAPTERS.items()):
        names = [name for module in modules for name in held[module]]
        pages[stem] = page(title, "", "jaxball", names, declared=not k)
    for name in PACKAGES:
        package = importlib.import_module(f"jaxball.{name}")
        lead = inspect.getdoc(package) or ""
        pages[name] = page(f"`jaxball.{name}`", lead, package.__name__, sorted(package.__all__), declared=True)
    listed = "\n".join(pages)
    pages["index"] = f"{LEAD}\n```{{toctree}}\n:maxdepth: 1\n\n{listed}\n```\n"
    write_pages(PLACE, pages)


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


def public_name(target: str) -> str | None:
    """The name under which the site has what an annotation or a docstring names, with its modules or without."""
    if "." in target:
        return public_names().get(id(found_at(target)))
    return next((name for name in public_names().values() if name.endswith(f".{target}")), None)


def resolve(app: Sphinx, env: BuildEnvironment, node: pending_xref, shown: nodes.TextElement) -> nodes.Element | None:
    """Leads from the module in which an object lives to the name under which it is public.

    What an annotation names and is not public, or lives in another library, stays a word. A role that leads nowhere is
    reported.
    """
    if node.get("refdomain") != "py":
        return None
    target = node["reftarget"]
    if (name := public_name(target)) and name != target:
        domain = env.get_domain("py")
        return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", name, node, shown)
    root = target.partition(".")[0]
    if root in ELSEWHERE or root in sys.stdlib_module_names or hasattr(builtins, root) or "refwarn" not in node:
        return shown
    return None


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", write_reference)
    app.connect("autodoc-process-docstring", escaped)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
