"""Each tutorial as a notebook for Jupyter, beside its page: the same text, and its Python blocks as cells."""

import re
from pathlib import Path

import nbformat
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook
from sphinx.application import Sphinx

from .links import DOCS

PLACE = DOCS / "made" / "site" / "tutorials"
BLOCK = re.compile(r"^```python\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
# Outputs and pictures are what the cells make, and the link to the notebook leads nowhere in it.
MADE = re.compile(
    r"^```output\n.*?^```\n|^!\[[^\]]*\]\([^)]*\)\n|^\{.*\}\n|^\[This page as a notebook.*?\n\n",
    re.MULTILINE | re.DOTALL,
)
LINK = re.compile(r"\[([^\]]+)\]\((?!https?:)[^)]*\)")


def notebook(page: str) -> nbformat.NotebookNode:
    """The cells of a page written in Markdown; links to other pages become their words."""
    cells, end = [], 0
    text = LINK.sub(r"\1", MADE.sub("", page))
    for block in BLOCK.finditer(text):
        cells += [new_markdown_cell(text[end : block.start()].strip()), new_code_cell(block[1].rstrip())]
        end = block.end()
    cells.append(new_markdown_cell(text[end:].strip()))
    cells = [cell for cell in cells if cell.source]
    for k, cell in enumerate(cells):
        cell.id = f"cell-{k}"  # and not a random one, so that the same page makes the same file
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    return new_notebook(cells=cells, metadata=kernel)


def write_notebooks(app: Sphinx) -> None:
    PLACE.mkdir(parents=True, exist_ok=True)
    for page in tutorials():
        nbformat.write(notebook(page.read_text()), PLACE / f"{page.stem}.ipynb")


def tutorials() -> list[Path]:
    return sorted(page for page in (DOCS / "tutorials").glob("*.md") if page.stem != "index")


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", write_notebooks)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
