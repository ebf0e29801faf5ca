"""What a release states in several places agrees."""

import ast
import json
import re
import tomllib
from pathlib import Path

import jaxball
from jaxball.interface.deprecation import removal

ROOT = Path(__file__).parents[2]
RECIPE = (ROOT / ".ci/conda/recipe.yaml").read_text()
OTHER_NAMES = {"matplotlib": "matplotlib-base", "typing-extensions": "typing_extensions"}  # conda-forge's


def test_versions_agree():
    assert f'version: "{jaxball.__version__}"' in RECIPE
    assert f"\nversion: {jaxball.__version__}\n" in (ROOT / "CITATION.cff").read_text()


def test_the_recipe_requires_what_the_package_requires():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for dependency in project["dependencies"]:
        name, bounds = re.fullmatch(r"([\w-]+)([^;]*?)(?:;.*)?", dependency.replace(" ", "")).groups()
        assert f"    - {OTHER_NAMES.get(name, name)} {bounds}\n" in RECIPE
    assert f"    - python {project['requires-python']}\n" in RECIPE


def test_groups_ask_for_extras_that_exist_and_list_no_package_again():
    """What uv installs for a group is what pip installs for the extra."""
    content = tomllib.loads((ROOT / "pyproject.toml").read_text())
    extras, groups = content["project"]["optional-dependencies"], content["dependency-groups"]
    name = re.compile(r"[\w-]+")
    stated = {name.match(item)[0] for items in extras.values() for item in items}
    for items in groups.values():
        for item in items:
            if isinstance(item, dict):
                assert item["include-group"] in groups
            elif asked := re.fullmatch(r"jaxball\[([\w,-]+)\]", item):
                assert {*asked[1].split(",")} <= {*extras}
            else:
                assert name.match(item)[0] not in stated
    assert {"test", "docs", "bench", "dev"} <= {*groups}
    assert {"include-group": "test"} in groups["dev"]


def test_titles_agree():
    zenodo = json.loads((ROOT / ".zenodo.json").read_text())
    assert f'title: "{zenodo["title"]}"' in (ROOT / "CITATION.cff").read_text()


KEEPERS = {"keep_old_names", "keep_old_argument", "OldAttribute"}


def overdue(source: str, version: str) -> list[int]:
    """Lists the lines of a module that keep an old name for longer than it must be kept."""
    number = lambda text: tuple(map(int, re.findall(r"\d+", text)[:2]))  # noqa: E731
    return [
        node.lineno
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] in KEEPERS
        for argument in [*node.args, *(keyword.value for keyword in node.keywords if keyword.arg == "since")]
        if isinstance(argument, ast.Constant) and re.fullmatch(r"\d+\.\d+", str(argument.value))
        if number(version) >= number(removal(str(argument.value)))
    ]


def test_old_names_are_found_when_they_may_go():
    source = "a = OldAttribute('b', since='0.2')\n@deprecation.keep_old_argument('c', 'd', '0.10')\ndef f(d): ..."
    assert overdue(source, "0.3.9") == []
    assert overdue(source, "0.4.0") == [1]
    assert overdue(source, "0.12.0") == [1, 2]


def test_no_old_name_is_kept_longer_than_the_page_says():
    files = sorted((ROOT / "src/jaxball").rglob("*.py"))
    late = {str(file.relative_to(ROOT)): overdue(file.read_text(), jaxball.__version__) for file in files}
    assert not {file: lines for file, lines in late.items() if lines}
