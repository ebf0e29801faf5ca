"""The reference of the Python interface: a page for each package, from the docstrings of every public name."""

import builtins
import functools
import importlib
import inspect
import re
import sys
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any, get_args

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util import logging

import jaxball
from jaxball.interface.names import imports_of, public_packages

from .links import DOCS, write_pages

PLACE = DOCS / "reference" / "python"
logger = logging.getLogger(__name__)

# The names of `jaxball` itself, by the modules that define them.
CHAPTERS = {
    "running": ("Simulating", "simulation.simulate simulation.trajectory interface.status programs files"),
    "bodies": (
        "Bodies and their surroundings",
        "physics.body physics.convex physics.dynamics physics.prescribed.motion physics.grounds physics.forces "
        "physics.validity",
    ),
    "rails": ("Rails and frames", "physics.prescribed.rails physics.prescribed.frames"),
    "schedules": (
        "Schedules, signals and laws",
        "physics.prescribed.schedules physics.prescribed.signals physics.prescribed.recorded physics.feedback "
        "numerics.functions",
    ),
    "mechanisms": ("Mechanisms", "physics.mechanisms"),
    "states": ("States and observables", "physics.state physics.observables simulation.equilibrium"),
    "events": ("Events, slip and flight", "simulation.events simulation.extremes physics.contact"),
    "systems": ("Systems of your own", "physics.system"),
}
LEAD = """# The Python interface

Every public name with its arguments, shapes, units and errors, from its docstring, which `help()` shows as well. The
names of `jaxball` itself come first, in chapters, followed by the packages; what a function returns stands below it.
Shapes are written in the notation of [jaxtyping](https://docs.kidger.site/jaxtyping/): `Float[Array, "*batch T"]` has
one row for each time, after the axes of a batch, if there are any.
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
        for member, value in members_of(found).items()
        if not member.startswith("_") and shows(value) and getattr(value, "__doc__", None)
    )
    listed = f"   :members: {', '.join(members)}\n" if members else ""
    return f".. autoclass:: {name}\n{listed}"


def members_of(found: Any) -> dict[str, Any]:
    """What a class has of its own, and what a base without a public name leaves to other modules."""
    bases = [base for base in found.__mro__[1:] if id(base) not in public_names()]
    left = {name: value for base in bases for name, value in vars(base).items() if hasattr(value, "left_to")}
    return left | dict(vars(found))


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
    """A page of entries, and of what these return."""
    package = importlib.import_module(module)
    directive = "module" if declared else "currentmodule"
    parts = [f".. py:{directive}:: {module}", lead]
    parts += [entry(getattr(package, name), name) for name in names]
    for result in results_of([getattr(package, name) for name in names]):
        parts += [f".. py:currentmodule:: {result.__module__}", entry(result, result.__name__)]
    text = "\n\n".join(part for part in parts if part)
    return f"# {title}\n\n```{{eval-rst}}\n{text}\n```\n"


_shown: dict[int, str] = {}  # results that a page has, under the names of their modules


def results_of(found: Sequence[Any]) -> list[Any]:
    """The classes of jaxball that functions and methods return, without a public name, and what those of them return;
    each on the first such page.
    """
    results = []
    for one in found:
        members = [value for name, value in members_of(one).items() if name[0] != "_"] if is_class(one) else [one]
        for member in members:
            function = getattr(member, "fget", None) or getattr(member, "__func__", member)
            returned = getattr(function, "__annotations__", {}).get("return", "")
            for result in classes_in(returned, known_to(function)):
                if id(result) not in public_names() and id(result) not in _shown:
                    _shown[id(result)] = f"{result.__module__}.{result.__name__}"
                    results.append(result)
    return results + (results_of(results) if results else [])


def known_to(function: Any) -> dict[str, Any]:
    """The names in the module of a function, and in that to which it is left."""
    left_to = getattr(function, "left_to", None)
    known = vars(sys.modules[getattr(function, "__module__", "jaxball")])
    return known if left_to is None else known | vars(importlib.import_module(*left_to[:2]))


def classes_in(annotation: Any, known: Mapping[str, Any]) -> list[Any]:
    """The documented classes of jaxball that an annotation names."""
    words = re.findall(r"[A-Za-z_]\w*", annotation if isinstance(annotation, str) else repr(annotation))
    named = [annotation] if is_class(annotation) else [*get_args(annotation), *(known.get(word) for word in words)]
    return [one for one in named if is_class(one) and one.__module__.startswith("jaxball.") and inspect.getdoc(one)]


def is_class(found: Any) -> bool:
    return inspect.isclass(found)


def escaped(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """A norm is written with bars, which mean something else in reStructuredText outside of code."""
    lines[:] = ["``".join(bars(part, k) for k, part in enumerate(line.split("``"))) for line in lines]


def bars(part: str, k: int) -> str:
    return part if k % 2 else part.replace("|", "\\|")


def write_reference(app: Sphinx) -> None:
    """Writes a page for each chapter and package."""
    held: dict[str, list[str]] = {}
    for name in jaxball.__all__:
        module = imports_of("jaxball")[name].removeprefix(".")
        (stem,) = (stem for stem, (_, within) in CHAPTERS.items() if is_within(module, within.split()))
        held.setdefault(stem, []).append(name)
    pages = {}
    for k, (stem, (title, _)) in enumerate(CHAPTERS.items()):
        pages[stem] = page(title, "", "jaxball", held[stem], declared=not k)
    for package in packages():
        name = package.__name__.removeprefix("jaxball.")
        pages[name] = page(f"`jaxball.{name}`", inspect.getdoc(package) or "", package.__name__, package.__all__, True)
    listed = "\n".join(pages)
    pages["index"] = f"{LEAD}\n```{{toctree}}\n:maxdepth: 1\n\n{listed}\n```\n"
    write_pages(PLACE, pages)


def is_within(module: str, packages: Sequence[str]) -> bool:
    return any(f"{module}.".startswith(f"{package}.") for package in packages)


def packages() -> list[ModuleType]:
    """The packages that have public names, beside ``jaxball`` itself."""
    return [package for package in public_packages(jaxball) if package.__all__ and package is not jaxball]


@functools.cache
def public_names() -> dict[int, str]:
    """Where a user finds each object."""
    return {
        id(getattr(package, name)): f"{package.__name__}.{name}"
        for package in (jaxball, *packages())
        for name in package.__all__
    }


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


def name_on_site(target: str) -> str | None:
    """The name under which the site has what an annotation or a docstring names, with its modules or without."""
    names = public_names() | _shown
    if name := names.get(id(found_at(target))):
        return name
    owner, _, member = target.partition(".")
    of_owner = next((name for name in names.values() if name.endswith(f".{owner}")), None)
    return of_owner and f"{of_owner}.{member}".rstrip(".")


def resolve(app: Sphinx, env: BuildEnvironment, node: pending_xref, shown: nodes.TextElement) -> nodes.Element | None:
    """Leads from the module in which an object lives to the name under which it is public.

    What is not on the site, or lives in another library, stays a word. A role that leads nowhere is reported where it
    stands on a page that is written by hand; a test finds those of docstrings.
    """
    if node.get("refdomain") != "py":
        return None
    target = node["reftarget"]
    if (name := name_on_site(target)) and name != target:
        domain = env.get_domain("py")
        if (link := domain.resolve_xref(env, node["refdoc"], app.builder, "obj", name, node, shown)) is not None:
            return link
    root = target.partition(".")[0]
    if node["refdoc"].startswith("reference/python/"):
        return shown
    if root in ELSEWHERE or root in sys.stdlib_module_names or hasattr(builtins, root) or "refwarn" not in node:
        return shown
    return None


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", write_reference)
    app.connect("autodoc-process-docstring", escaped)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
