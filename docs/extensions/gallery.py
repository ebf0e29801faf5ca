"""The gallery: every scenario that comes with jaxball and every example, with what it shows and the file to copy.

What a page shows is made while the site is built, two at a time: a scenario is simulated, an example is run. It is kept
in ``docs/made`` with a hash of the package and of the file, and made again when either has changed. With
``-D gallery=short`` a few are made.
"""

import ast
import hashlib
import shutil
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

import jaxball
from jaxball.files.scenario import builtin_scenarios
from jaxball.files.scenario.sources import builtin_text, builtin_title

from .cards import CARDS, GROUPS, read_words
from .examples import EXAMPLES, Example
from .links import DOCS, ROOT, page_name, write_pages
from .scenes import draw_scenario, run_example

GALLERY = DOCS / "gallery"
SHOWN = DOCS / "made" / "site" / "gallery" / "shown"
FEW = ("ball", "heavy-top", "example-first-ball")  # of a short gallery
WITHOUT_VIEW = ("chaplygin-sleigh",)  # no body that rolls or turns about a point, and no particle
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Entry:
    """A page of the gallery.

    - ``name``: of the page.
    - ``short``: its name for readers, in a few words.
    - ``title``, ``text``: what heads it and what it says before it shows anything.
    - ``file``, ``language``: what there is to copy.
    - ``make``, ``source``: the function that writes what is shown, and what it does that from; None if nothing is made.
    - ``robot``: the entry whose thumbnail stands for this one; its own if empty.
    - ``pictures``: what is seen in pictures, by their names.
    - ``kept``: those of them that are figures of the documents.
    """

    name: str
    short: str
    title: str
    text: str
    file: str
    language: str
    make: Callable[..., None] | None = None
    source: str | Path = ""
    robot: str = ""
    pictures: Mapping[str, str] = field(default_factory=dict)
    kept: Sequence[str] = ()

    @property
    def folder(self) -> Path:
        return SHOWN / self.name

    def page(self) -> str:
        parts = [f"# {self.title}", self.text]
        parts += [self._view(one.name) for one in sorted(self.folder.glob("*.html"))]
        made = sorted(self.folder.glob("*.png"))
        parts += [self.picture(one) for one in [*made, *(DOCS / "figures" / name for name in self.kept)]]
        if not (made or self.kept or self.robot):
            parts.append(self.thumbnail())
        printed = self.folder / "printed.txt"
        if printed.exists():
            parts.append(f"It prints\n\n```text\n{printed.read_text().rstrip()}\n```")
        parts.append(f"## The file\n\n````{self.language}\n{self.file.rstrip()}\n````")
        return "\n\n".join(parts) + "\n"

    def picture(self, path: Path) -> str:
        """A picture with what is seen in it, which stands in a text beside it where it was made from a scenario."""
        told = path.with_suffix(".txt")
        words = told.read_text() if told.exists() else self.pictures[path.name]
        return f"![{words}](/{path.relative_to(DOCS)})"

    def thumbnail(self) -> str:
        """The picture that stands for the entry, which is stored."""
        path = CARDS / f"{self.name}.webp"
        return f"![{read_words()[self.name]}](/{path.relative_to(DOCS)})"

    def _view(self, name: str) -> str:
        path = f"shown/{self.name}/{name}"
        frame = f'<iframe class="view" src="{path}" title="{self.short}: an interactive view" loading="lazy"></iframe>'
        return f'```{{raw}} html\n{frame}\n<p><a href="{path}">The view in a page of its own</a></p>\n```'


def scenarios() -> list[Entry]:
    def entry(name: str) -> Entry:
        text, title = builtin_text(name), builtin_title(name)
        head = " ".join(line.lstrip("# ") for line in text.partition("format =")[0].splitlines())
        shown = f"--plot {name}" if name in WITHOUT_VIEW else f"--view {name}.html"
        command = f"```console\njaxball simulate {name} {shown}\njaxball scenarios {name} > my-{name}.toml\n```"
        short = name.replace("-", " ").capitalize()
        return Entry(name, short, title, f"{head}\n\n{command}", text, "toml", draw_scenario, text)

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
    told = EXAMPLES.get(path.name) or Example(path.stem.replace("_", " ").capitalize())
    return Entry(
        page_name(path.stem),
        told.name,
        title.rstrip("."),
        text_after,
        text,
        language,
        None if told.long else make,
        source,
        told.robot,
        told.pictures,
        tuple(told.pictures) if told.long else (),
    )


def stamp(entry: Entry) -> str:
    """A hash of all that what is shown depends on."""
    digest = hashlib.sha256(entry.file.encode())
    package = Path(jaxball.__file__).parent
    makers = [DOCS / "extensions" / name for name in ("scenes.py", "thumbnails.py")]
    for path in sorted([*package.rglob("*.py"), package / "plot" / "view" / "view.bundle.js", *makers]):
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
    write_pages(GALLERY, {entry.name: entry.page() for entry in entries} | {"index": index(entries)})


def index(entries: list[Entry]) -> str:
    """The page with a card for each entry, by kind."""
    lead = (
        "# Gallery\n\nEvery scenario and example that comes with jaxball, with its view or figures and its file.\n"
        "The views play in the page: drag to rotate, and press the space bar to pause.\n"
    )
    parts = [lead]
    by_name = {entry.name: entry for entry in entries}
    for title, names in GROUPS.items():
        group = [by_name[name] for name in names]
        cards = "\n".join(card(entry, by_name[entry.robot or entry.name]) for entry in group)
        listed = "\n".join(f"{entry.short} <{entry.name}>" for entry in group)
        parts.append(
            f"## {title}\n\n::::{{container}} cards\n{cards}\n::::\n\n```{{toctree}}\n:hidden:\n\n{listed}\n```\n"
        )
    return "\n".join(parts)


def card(entry: Entry, robot: Entry) -> str:
    """A picture of its robot and its short name, which leads to the page, over its title."""
    picture = robot.thumbnail()
    return f":::{{container}} card\n{picture}\n\n[{entry.short}]({entry.name}.md)\n\n{entry.title}\n:::\n"


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_config_value("gallery", "all", "env", str)
    app.connect("builder-inited", write_gallery)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
