"""Links of the pages to files beside ``docs``, which stand on the site as pages too, and those pages."""

import os
import re
from pathlib import Path

from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
# Documents that people find in the repository first; the site has a copy of each.
COPIES = {
    "benchmarks/README.md": "project/benchmarks.md",
    "tests/README.md": "project/tests.md",
    "src/jaxball/programs/README.md": "project/compiler.md",
    "CONTRIBUTING.md": "project/contributing.md",
    "CHANGELOG.md": "project/changelog.md",
}
PAGES = {name: f"docs/{page}" for name, page in COPIES.items()} | {
    "README.md": "docs/index.md",
    "examples": "docs/gallery/index.md",
}
LINK = re.compile(r"(?<=\]\()(?!https?:|/)([^)#\s]+)((?:#[^)\s]*)?\))")


def page_of(target: str) -> str:
    """Where the site has what a path from the root leads to, as a path from the root."""
    name, suffix = os.path.splitext(os.path.basename(target))
    if os.path.dirname(target) == "examples" and suffix in (".py", ".toml"):
        return f"docs/gallery/{page_name(name)}.md"
    return PAGES.get(target, target)


def page_name(example: str) -> str:
    """The name of an example's page, after that of its file; a scenario may have the same."""
    return "example-" + re.sub(r"^\d+_", "", example).replace("_", "-")


def with_links(text: str, written_in: str, shown_in: str) -> str:
    """A document with its links as they are from where it is shown; both are paths from the root."""

    def moved(link: re.Match) -> str:
        target = os.path.normpath(os.path.join(os.path.dirname(written_in), link[1]))
        return os.path.relpath(page_of(target), os.path.dirname(shown_in)) + link[2]

    return LINK.sub(moved, text)


def write_page(page: Path, text: str) -> None:
    """Writes a page that is made, unless it says the same already, so that only what changed is built again."""
    if not page.exists() or page.read_text() != text:
        page.parent.mkdir(parents=True, exist_ok=True)
        page.write_text(text)


def write_pages(folder: Path, pages: dict[str, str]) -> None:
    """Writes the pages of a folder by their names, and removes those of an earlier build."""
    for old in folder.glob("*.md"):
        if old.stem not in pages:
            old.unlink()
    for name, text in pages.items():
        write_page(folder / f"{name}.md", text)


def copy_documents(app: Sphinx) -> None:
    for name, page in COPIES.items():
        write_page(DOCS / page, with_links((ROOT / name).read_text(), name, f"docs/{page}"))


def move_links(app: Sphinx, docname: str, source: list[str]) -> None:
    page = f"docs/{docname}.md"
    source[0] = with_links(source[0], page, page)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", copy_documents)
    app.connect("source-read", move_links)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
