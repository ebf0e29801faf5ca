"""The gallery: every scenario that comes with jaxball and every example, with what it shows and the file to copy.

What a page shows is made while the site is built, two at a time: a scenario is simulated, an example is run. It is kept
in ``docs/made`` with a hash of the package and of the file, and made again when either has changed. With
``-D gallery=short`` a few are made.
"""

import ast
import hashlib
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

import jaxball
from jaxball.scenario import builtin_scenarios, builtin_text, builtin_title

from .links import DOCS, ROOT, page_name, write_pages
from .scenes import draw_scenario, run_example

GALLERY = DOCS / "gallery"
SHOWN = DOCS / "made" / "site" / "gallery" / "shown"
FEW = ("ball", "heavy-top", "example-first-ball")  # of a short gallery
# What takes minutes is not run; a figure that it once wrote stands in the documents, if there is one.
LONG = {
    "10_wobble.py": ("roboball-wobble.png",),
    "ball_past_a_post.py": ("ball-past-a-post-path.png",),
    "compare_robust_rails.py": (),
    "disk_tracking.py": ("disk-tracking-path.png",),
    "six_tubes.py": ("figure-eight-tubes.png", "figure-eight-path.png"),
    "problem_pendulum_on_a_slope.toml": ("climb-torques.png",),
    "problem_rail_shape.toml": ("designed-rails.png", "designed-path.png"),
}
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Entry:
    """A page of the gallery.

    - ``name``: of the page.
    - ``title``, ``text``: what heads it and what it says before it shows anything.
    - ``file``, ``language``: what there is to copy.
    - ``make``, ``source``: the function that writes what is shown, and what it does that from; None if nothing is made.
    - ``kept``: figures of the documents that show it.
    """

    name: str
    title: str
    text: str
    file: str
    language: str
    make: Callable[..., None] | None = None
    source: str | Path = ""
    kept: Sequence[str] = ()

    @property
    def folder(self) -> Path:
        return SHOWN / self.name

    def page(self) -> str:
        parts = [f"# {self.title}", self.text]
        parts += [self._view(one.name) for one in sorted(self.folder.glob("*.html"))]
        made = [f"/{one.relative_to(DOCS)}" for one in sorted(self.folder.glob("*.png")) if one.stem != "thumbnail"]
        parts += [f"![{self.title}]({picture})" for picture in [*made, *(f"../figures/{one}" for one in self.kept)]]
        printed = self.folder / "printed.txt"
        if printed.exists():
            parts.append(f"It prints\n\n```text\n{printed.read_text().rstrip()}\n```")
        parts.append(f"## The file\n\n````{self.language}\n{self.file.rstrip()}\n````")
        return "\n\n".join(parts) + "\n"

    def _view(self, name: str) -> str:
        path = f"shown/{self.name}/{name}"
        frame = f'<iframe class="view" src="{path}" title="{self.title}" loading="lazy"></iframe>'
        return f'```{{raw}} html\n{frame}\n<p><a href="{path}">The view in a page of its own</a></p>\n```'


def scenarios() -> list[Entry]:
    def entry(name: str) -> Entry:
        text, title = builtin_text(name), builtin_title(name)
        head = " ".join(line.lstrip("# ") for line in text.partition("format =")[0].splitlines())
        command = (
            f"```console\njaxball simulate {name} --view {name}.html\njaxball scenarios {name} > my-{name}.toml\n```"
        )
        return Entry(name, title, f"{head}\n\n{command}", text, "toml", draw_scenario, text)

    return [entry(name) for name in builtin_scenarios()]


def examples() -> list[Entry]:
    return [entry_of(path) for path in sorted((ROOT / "examples").iterdir()) if path.suffix in (".py", ".toml")]


def entry_of(path: Path) -> Entry:
    """An example's page, with what its docstring or its first comment says."""
    text = path.read_text()
    if path.suffix == ".py":
        said = ast.get_docstring(ast.parse(text)) or ""
        make, source, language, command = run_example, path, "python", f"python {path.name}"
    else:
        comment = text.partition("format =")[0]
        said = " ".join(line.lstrip("# ") for line in comment.splitlines())
        make, source, language, command = draw_scenario, text, "toml", f"jaxball simulate {path.name}"
    if path.name.startswith("problem_"):
        make, command = None, f"jaxball design {path.name} --out result/"
    title, _, rest = said.partition(". " if path.suffix == ".toml" else "\n")
    text_after = f"{rest.strip()}\n\n```console\n{command}\n```"
    if path.name in LONG:
        make = None
    return Entry(
        page_name(path.stem), title.rstrip("."), text_after, text, language, make, source, LONG.get(path.name, ())
    )


def stamp(entry: Entry) -> str:
    """A hash of all that what is shown depends on."""
    digest = hashlib.sha256(entry.file.encode())
    package = Path(jaxball.__file__).parent
    for path in sorted(
        [*package.rglob("*.py"), package / "plot" / "view" / "view.bundle.js", DOCS / "extensions" / "scenes.py"]
    ):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def is_made(entry: Entry) -> bool:
    kept = entry.folder / "stamp"
    return kept.exists() and kept.read_text() == stamp(entry)


def make_all(entries: list[Entry]) -> None:
    wanted = [entry for entry in entries if entry.make and not is_made(entry)]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        solving = {}
        for entry in wanted:
            shutil.rmtree(entry.folder, ignore_errors=True)
            entry.folder.mkdir(parents=True)
            assert entry.make is not None
            solving[pool.submit(entry.make, entry.source, entry.folder)] = entry
        for k, done in enumerate(as_completed(solving), 1):
            entry = solving[done]
            logger.info(f"gallery: {entry.name}, {k} of {len(wanted)}")
            if error := done.exception():
                logger.warning(f"The gallery's {entry.name} could not be made: {error}")
            else:
                (entry.folder / "stamp").write_text(stamp(entry))


def write_gallery(app: Sphinx) -> None:
    of_scenarios, of_examples = scenarios(), examples()
    entries = of_scenarios + of_examples
    make_all([entry for entry in entries if app.config.gallery != "short" or entry.name in FEW])
    write_pages(GALLERY, {entry.name: entry.page() for entry in entries} | {"index": index(of_scenarios, of_examples)})


def index(of_scenarios: list[Entry], of_examples: list[Entry]) -> str:
    lead = (
        "# Gallery\n\nEvery scenario and example that comes with jaxball, with its view or figures and its file.\n"
        "The views play in the page: drag to rotate, and press the space bar to pause.\n"
    )
    parts = [lead]
    for title, entries in (("Scenarios", of_scenarios), ("Examples", of_examples)):
        cards = "\n".join(card(entry) for entry in entries)
        listed = "\n".join(entry.name for entry in entries)
        parts.append(
            f"## {title}\n\n::::{{container}} cards\n{cards}\n::::\n\n```{{toctree}}\n:hidden:\n\n{listed}\n```\n"
        )
    return "\n".join(parts)


def card(entry: Entry) -> str:
    """A picture that leads to the page, over its title."""
    made = sorted(entry.folder.glob("*.png"), key=lambda one: one.stem != "thumbnail")
    pictures = [*made, *(DOCS / "figures" / one for one in entry.kept)]
    picture = f"![](/{pictures[0].relative_to(DOCS)})\n" if pictures else ""
    return f":::{{container}} card\n{picture}\n[{entry.title}]({entry.name}.md)\n:::\n"


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_config_value("gallery", "all", "env", str)
    app.connect("builder-inited", write_gallery)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
