"""Every cross-reference in the source names something that exists."""

import contextlib
import importlib
import pkgutil
import re
from pathlib import Path

import jaxball

SOURCE = Path(jaxball.__file__).parent
REFERENCE = re.compile(r":(?:attr|class|data|exc|func|meth|mod|obj):`(?:[^`<]*<)?~?([^`>]+)>?`")


def installed_modules():
    """All modules by their names, but for those of libraries that are not installed."""
    modules = {"jaxball": jaxball}
    for found in pkgutil.walk_packages([str(SOURCE)], "jaxball."):
        with contextlib.suppress(ImportError):
            modules[found.name] = importlib.import_module(found.name)
    return modules


def has_member(bearer, path):
    """Whether an object has a member, which has another, and so on; fields of classes may have no value."""
    for name in path:
        if not hasattr(bearer, name):
            fields = (vars(base).get("__annotations__", {}) for base in getattr(bearer, "__mro__", ()))
            return any(name in field for field in fields)
        bearer = getattr(bearer, name)
    return True


def exists(target, module, modules):
    """As for Sphinx: from a dot on, the end of any name; otherwise a full name, or one of the module or its package."""
    names = target.removeprefix(".").split(".")
    heads = {k: ".".join(names[:k]) for k in range(len(names) + 1)}
    if target.startswith(("jaxball", ".")):
        ends = {k: head if target[0] != "." else f".{head}".rstrip(".") for k, head in heads.items()}
        bearers = [
            (name, k)
            for name in modules
            for k, end in ends.items()
            if name == end or (target[0] == "." and name.endswith(end))
        ]
        return any(has_member(modules[name], names[k:]) for name, k in bearers)
    package = ".".join(module.split(".")[:2])
    around = [name for name in modules if name.startswith(package) or module.startswith(f"{name}.")]
    classes = [value for value in vars(modules[module]).values() if isinstance(value, type)]
    return any(has_member(bearer, names) for bearer in (*map(modules.get, around), *classes))


def test_references_lead_somewhere():
    modules, dead, count = installed_modules(), [], 0
    for module in modules:
        path = SOURCE.joinpath(*module.split(".")[1:])
        text = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text("utf-8")
        targets = sorted(set(REFERENCE.findall(text)))
        count += len(targets)
        dead += [f"{module}: {target}" for target in targets if not exists(target, module, modules)]
    assert dead == []
    assert count > 300
    assert not exists(".rows.put", "jaxball.programs.derivatives.reversible_loop", modules)
    assert not exists("jaxball.files.scenario.errors.collect_conditions", "jaxball.files.scenario.files", modules)
