"""Each tutorial as a notebook for Jupyter, beside its page: the same text, and its Python blocks as cells."""

import re
from pathlib import Path

import nbformat
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook
from sphinx.application import Sphinx

from .links import DOCS

PLACE = DOCS / "made" / "site" / "tutorials"
# What becomes a cell of code: Python, and files, whose first line is a comment with their name.
CODE = re.compile(r"^```(?:python\n|toml\n# (?P<file>[\w-]+\.toml)\n)(?P<lines>.*?)^```\n", re.MULTILINE | re.DOTALL)
# Outputs and pictures are what the cells make.
MADE = re.compile(r"^```output\n.*?^```\n|^!\[[^\]]*\]\([^)]*\)\n|^\{.*\}\n", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\[([^\]]+)\]\((?!https?:)[^)]*\)")
ROLE = re.compile(r"\{[\w:]+\}(`[^`]+`)")
TITLE = re.compile(r"\A# .*\n")


def notebook(page: str) -> nbformat.NotebookNode:
    """The cells of a page written in Markdown; links to other pages become their words."""
    cells, end = [], 0
    for block in CODE.finditer(page):
        cells += [new_markdown_cell(words(page[end : block.start()])), new_code_cell(code(block))]
        end = block.end()
    cells.append(new_markdown_cell(words(page[end:])))
    cells = [cell for cell in cells if cell.source]
    for k, cell in enumerate(cells):
        cell.id = f"cell-{k}"  # and not a random one, so that the same page makes the same file
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    return new_notebook(cells=cells, metadata=kernel)


def code(block: re.Match[str]) -> str:
    """A cell that runs the block, or writes the file."""
    lines = block["lines"].rstrip()
    return f"%%writefile {block['file']}\n{lines}" if block["file"] else lines


def words(text: str) -> str:
    """A part of a page without code, for readers who are not on the site."""
    return ROLE.sub(r"\1", LINK.sub(r"\1", MADE.sub("", text))).strip()


def link(app: Sphinx, docname: str, source: list[str]) -> None:
    """Leads from each tutorial, below its title, to its notebook."""
    if docname in {f"tutorials/{page.stem}" for page in tutorials()}:
        anchor = f'<p><a href="{Path(docname).name}.ipynb" download>This page as a notebook</a></p>'
        source[0] = TITLE.sub(lambda title: f"{title[0]}\n```{{raw}} html\n{anchor}\n```\n", source[0])


def write_notebooks(app: Sphinx) -> None:
    PLACE.mkdir(parents=True, exist_ok=True)
    for page in tutorials():
        nbformat.write(notebook(page.read_text()), PLACE / f"{page.stem}.ipynb")


def tutorials() -> list[Path]:
    return sorted(page for page in (DOCS / "tutorials").glob("*.md") if page.stem != "index")


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", write_notebooks)
    app.connect("source-read", link)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
