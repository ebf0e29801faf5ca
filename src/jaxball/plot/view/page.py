"""The page of a run: the template, the program and the run's dictionary in one file that asks for nothing else."""

import base64
import functools
import hashlib
import html
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...interface.output import replacing
from ...interface.views import MARK, check_view
from ...simulation.trajectory import Trajectory
from .document import view_document

HERE = Path(__file__).parent
# So that no text of a run ends the element that it stands in, or a line of a program that reads it.
ESCAPES = {ord(letter): f"\\u{ord(letter):04x}" for letter in "<>&\u2028\u2029"}
HEIGHT = 760  # of the page within a notebook, pixels


class View:
    """A run as a page, which a notebook shows in place.

    :meth:`jaxball.Trajectory.view` makes one. ``html`` is the page, one self-contained text.

    **Arguments:**

    - ``document``: the dictionary that the page shows; the module ``jaxball.plot.view.document`` says what is in it.
    """

    def __init__(self, document: Mapping[str, Any]) -> None:
        self.document = document

    @classmethod
    def of(cls, trajectory: Trajectory[Any, Any], title: str = "", friction: float | None = None) -> "View":
        """The view of a run; the arguments are those of :func:`write_view`, and so are the errors."""
        return cls(view_document(trajectory, title, friction))

    @functools.cached_property
    def html(self) -> str:
        """The page."""
        return page(self.document)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes the page to ``path``, a file that ends in ``.html``, and returns the path.

        **Raises:** :class:`~jaxball.results.OutputError` when it cannot be written, and when there is a file that is
        no such page, which stays as it is.
        """
        path = Path(path)
        check_view(path)
        with replacing(path) as temporary:
            temporary.write_text(self.html, encoding="utf-8", newline="\n")
        return path

    def __repr__(self) -> str:
        times = self.document["arrays"]["time"]["shape"][0]
        return f"View of {self.document['title']!r}, {times} times, {len(self.html.encode()) / 1e6:.2f} MB"

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{html.escape(self.html)}" sandbox="allow-scripts" title="jaxball" '
            f'style="width: 100%; height: {HEIGHT}px; border: 0"></iframe>'
        )


def write_view(
    trajectory: Trajectory[Any, Any],
    path: str | os.PathLike[str],
    title: str = "",
    *,
    friction: float | None = None,
) -> Path:
    """Writes a run as one HTML file: the body in three dimensions, and graphs over time.

    The file needs no network and nothing beside it. Each frame shows the nearest saved time, so save often enough for a
    smooth motion, such as every 0.02 for a ball that turns about once in a unit of time.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns, or :func:`jaxball.load_run`; only its finite states are
      shown.
    - ``path``: a file that ends in ``.html``; it is replaced if it is such a page already.
    - ``title``: a line that says which system it is, such as that of a scenario.
    - ``friction``: a coefficient μ, whose cone is drawn at the contact point, and whose line beside |f| / N.

    **Returns:** the path of the file.

    **Raises:** ``ValueError`` for a classical system, a reduced trajectory, a batch, one without a finite state, and a
    ``friction`` that is not positive; :class:`~jaxball.results.OutputError` as :meth:`View.save`.
    """
    check_view(Path(path))
    return View.of(trajectory, title, friction).save(path)


def page(document: Mapping[str, Any]) -> str:
    """The text of the page that shows ``document``. Only the program of jaxball is run, by its hash."""
    program = _read("view.bundle.js")
    pieces = {
        "mark": MARK,
        "hash": base64.b64encode(hashlib.sha256(program.encode()).digest()).decode("ascii"),
        "style": _read("page.css"),
        "licence": _read("three.LICENSE"),
        "program": program,
        "document": in_element(document),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda match: pieces[match[1]], _read("page.html"))


def in_element(document: Mapping[str, Any]) -> str:
    """JSON that can stand in an element of HTML."""
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.translate(ESCAPES)


@functools.cache
def _read(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")
