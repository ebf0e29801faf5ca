"""What a release states in several places agrees."""

import json
import re
import tomllib
from pathlib import Path

import jaxball

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
