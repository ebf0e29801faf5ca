"""The tutorials as notebooks: files that Jupyter reads, whose cells are what the page says to type."""

import ast
import re
import sys
from pathlib import Path

import pytest

pytest.importorskip("sphinx")  # of the extra `docs`, as is nbformat
nbformat = pytest.importorskip("nbformat")

DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted(page for page in (DOCS / "tutorials").glob("*.md") if page.stem != "index")


@pytest.fixture
def notebooks(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    import extensions.notebooks

    yield extensions.notebooks
    for name in [name for name in sys.modules if name.partition(".")[0] == "extensions"]:
        del sys.modules[name]


def fenced(text: str, language: str) -> list[str]:
    """The blocks of a language, found line by line."""
    blocks, inside = [], None
    for line in text.splitlines():
        if line.startswith("```"):
            inside = line[3:] if inside is None else None
            if inside == language:
                blocks.append([])
        elif inside == language:
            blocks[-1].append(line)
    return ["\n".join(block) for block in blocks]


@pytest.mark.parametrize("page", PAGES, ids=[page.stem for page in PAGES])
def test_cells_are_the_blocks_of_the_page_in_order(page, notebooks):
    text = page.read_text()
    made = notebooks.notebook(text)
    nbformat.validate(made)
    code = [cell.source for cell in made.cells if cell.cell_type == "code"]
    assert [cell for cell in code if not cell.startswith("%%")] == fenced(text, "python")
    for cell in code:
        if cell.startswith("%%writefile "):
            name, _, lines = cell.removeprefix("%%writefile ").partition("\n")
            assert f"# {name}\n{lines}" in fenced(text, "toml")
        else:
            ast.parse(cell)
    told = "\n".join(cell.source for cell in made.cells if cell.cell_type == "markdown")
    assert re.findall("^#+ .*", told, re.MULTILINE) == re.findall("^#+ .*", without_blocks(text), re.MULTILINE)
    assert "```output" not in told
    assert "{py:" not in told
    assert not re.search(r"\]\((?!https?:)", told)


def without_blocks(text: str) -> str:
    """The page's words, in which a line that begins with # is a heading."""
    return re.sub(r"^```(python|toml|output)\n.*?^```\n", "", text, flags=re.MULTILINE | re.DOTALL)


def test_indexing_a_call_is_not_taken_for_a_link(notebooks):
    page = "# Title\n\n[A page](other.md)\n\n```python\nvalues[0](t)\n```\n"
    words, code = notebooks.notebook(page).cells
    assert (words.source, code.source) == ("# Title\n\nA page", "values[0](t)")
