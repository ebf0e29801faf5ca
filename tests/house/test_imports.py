"""A module is asked for a name only if it defines it, so that a reader who follows an import gets there at once."""

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "src/jaxball"
ROOMS = sorted(path.name for path in SOURCE.iterdir() if path.is_dir() and path.name != "__pycache__")


def statements(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """The statements of a module that are carried out when it is imported, also those under conditions."""
    for statement in body:
        yield statement
        if isinstance(statement, ast.If | ast.Try | ast.With):
            yield from statements([*statement.body, *getattr(statement, "orelse", [])])
            yield from statements([inner for handler in getattr(statement, "handlers", []) for inner in handler.body])


@functools.cache
def imported_alone(module: Path) -> set[str]:
    """The names that a module imports and does not define."""
    imported, defined = set(), set()
    for statement in statements(ast.parse(module.read_text()).body):
        if isinstance(statement, ast.ImportFrom):
            imported |= {alias.asname or alias.name for alias in statement.names}
        elif isinstance(statement, ast.FunctionDef | ast.ClassDef):
            defined.add(statement.name)
        elif isinstance(statement, ast.Assign | ast.AnnAssign):
            defined |= {node.id for node in ast.walk(statement) if isinstance(node, ast.Name)}
    return imported - defined


def roundabout(file: Path) -> list[tuple[int, str, str]]:
    """The imports within jaxball of names that the module only imports: line, module and name."""
    ways = []
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level and node.module:
            module = file.parents[node.level - 1].joinpath(*node.module.split(".")).with_suffix(".py")
            if module.is_file():  # and not a package, whose interface consists of such names
                passed_on = imported_alone(module)
                ways += [(node.lineno, node.module, alias.name) for alias in node.names if alias.name in passed_on]
    return ways


@pytest.mark.parametrize("room", ROOMS)
def test_names_are_imported_from_where_they_are_defined(room):
    ways = [
        f"{file.relative_to(SOURCE)}:{line}: {imported} of {module}"
        for file in sorted((SOURCE / room).rglob("*.py"))
        for line, module, imported in roundabout(file)
    ]
    assert not ways, "\n".join(ways)
