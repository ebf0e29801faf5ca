"""Writes the page of a view: template, program and the dictionary of the runs in one self-contained HTML file."""

import base64
import functools
import hashlib
import html
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ...interface.arguments import require_flags
from ...interface.output import MARK, check_view, replacing
from ..pictures import Picture
from ..style import ColourScale
from .document import Runs, in_element, view_document
from .scene import Discs

HERE = Path(__file__).parent
LARGEST_PAGE, LARGEST_PAGE_OF_SEVERAL = 1_000_000, 2_000_000  # bytes of a page, unless all saved times are requested
HEIGHT = 760  # of the page within a notebook, pixels


class View:
    """A run as a page, which a notebook shows in place.

    :meth:`jaxball.Trajectory.view` makes one. ``html`` is the page, one self-contained text.

    **Arguments:**

    - ``document``: the dictionary that the page shows; the module ``jaxball.plot.view.document`` describes it.
    """

    def __init__(self, document: Mapping[str, Any]) -> None:
        self.document = document

    @classmethod
    def of(
        cls,
        trajectories: Runs,
        title: str = "",
        *,
        friction: float | None = None,
        wanted: Float[np.ndarray, "k 2"] | None = None,
        discs: Discs = (),
        scale: ColourScale | None = None,
        picture: Picture | None = None,
        all_times: bool = False,
    ) -> "View":
        """Makes the view of a run or of several; the arguments and the errors are the same as for
        :func:`write_view`.
        """
        require_flags(all_times=all_times)
        largest = (
            LARGEST_PAGE_OF_SEVERAL if isinstance(trajectories, Mapping) and len(trajectories) > 1 else LARGEST_PAGE
        )
        # Without the page itself, whose program takes most of it.
        room = np.inf if all_times else float(largest - len(page({}).encode()))
        shown = {"wanted": wanted, "discs": discs, "scale": scale, "picture": picture}
        return cls(view_document(trajectories, title, friction, **shown, room=room))

    @functools.cached_property
    def html(self) -> str:
        """The page."""
        return page(self.document)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes the page to ``path``, a file that ends in ``.html``, and returns the path.

        **Raises:** :class:`~jaxball.results.OutputError` when it cannot be written, and when an existing file is not
        such a page; that file is not changed.
        """
        path = Path(path)
        check_view(path)
        with replacing(path) as temporary:
            temporary.write_text(self.html, encoding="utf-8", newline="\n")
        return path

    def __repr__(self) -> str:
        bodies, arrays = self.document["bodies"], self.document["arrays"]
        times = max(arrays[body["arrays"]["time"]]["shape"][0] for body in bodies)
        shown = f"{len(bodies)} runs of up to {times} times" if len(bodies) > 1 else f"{times} times"
        return f"View of {self.document['title']!r}, {shown}, {len(self.html.encode()) / 1e6:.2f} MB"

    def _repr_html_(self) -> str:
        return (
            # The page runs in a frame of its own, in which its scripts cannot reach the notebook.
            f'<iframe srcdoc="{html.escape(self.html)}" sandbox="allow-scripts" title="jaxball" '
            f'style="width: 100%; height: {HEIGHT}px; border: 0"></iframe>'
        )


def write_view(
    trajectories: Runs,
    path: str | os.PathLike[str],
    title: str = "",
    *,
    friction: float | None = None,
    wanted: Float[np.ndarray, "k 2"] | None = None,
    discs: Discs = (),
    scale: ColourScale | None = None,
    picture: Picture | None = None,
    all_times: bool = False,
) -> Path:
    """Writes runs as one HTML file: the bodies in three dimensions, and graphs over time.

    The file needs no network and no other files. Each frame shows the nearest saved time, so save often enough for a
    smooth motion, such as every 0.02 for a ball that turns about once in a unit of time. Several runs share one clock,
    and rolling bodies share one ground; rigid bodies are side by side.

    **Arguments:**

    - ``trajectories``: what :func:`jaxball.simulate` returns, or :func:`jaxball.load_run`; or up to 24 of them by name,
      as in ``{"before": before, "after": after}``. Only their finite states are shown.
    - ``path``: a file that ends in ``.html``; it is replaced if it is already such a page.
    - ``title``: a line that says which system it is, such as that of a scenario.
    - ``friction``: a coefficient μ, drawn as a cone at the contact point and as a line beside |f| / N. By default, the
      cone of a run with a law of contact is that of μ_s.
    - ``wanted``: points of a path to draw dashed on the ground, by their coordinates, length on a plane, shape
      (k, 2), or None.
    - ``discs``: centre and radius of each disc to avoid, likewise.
    - ``scale``: a :class:`ColourScale`, by which several bodies are coloured.
    - ``picture``: for systems with a Lagrangian, a function of (t, q) that returns a list of points and lines, each an
      array of shape (points, 2), the second upwards, or (points, 3).
    - ``all_times``: whether to show all saved times. Otherwise, a page of one run that would be larger than 1 MB, or of
      several that would be larger than 2 MB, shows evenly spaced ones.

    **Returns:** the path of the file.

    **Raises:** ``ValueError`` for a system that is neither a ball, a disk, a rigid body, a particle nor one with a
    Lagrangian and a ``picture``, runs of more than one of these kinds, a reduced trajectory, a batch, one without a
    finite state, bodies that do not roll on the same ground, no run or more than 24, a ``scale`` with another number of
    values, a ``friction`` that is not positive, and ``friction``, ``wanted`` or ``discs`` for systems without a ground;
    :class:`~jaxball.results.OutputError` as :meth:`View.save`.
    """
    check_view(Path(path))
    shown = {"friction": friction, "wanted": wanted, "discs": discs, "scale": scale, "picture": picture}
    return View.of(trajectories, title, **shown, all_times=all_times).save(path)


def page(document: Mapping[str, Any]) -> str:
    """Returns the text of the page that shows ``document``. Only jaxball's own program may run, identified by
    its hash.
    """
    program = _read("view.bundle.js")
    pieces = {
        "mark": MARK,
        # The page's policy lets a program with this hash run, and no other: nothing in a title or a name can be one.
        "hash": base64.b64encode(hashlib.sha256(program.encode()).digest()).decode("ascii"),
        "style": _read("page.css"),
        "licence": _read("three.LICENSE"),
        "program": program,
        "document": in_element(document),
    }
    # In one pass, so that marks of this kind within a text are left as they are.
    return re.sub(r"\{\{(\w+)\}\}", lambda match: pieces[match[1]], _read("page.html"))


@functools.cache
def _read(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")
