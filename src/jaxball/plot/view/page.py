"""Writes the page of a view: template, program and the dictionary of the runs in one self-contained HTML file.

The runs are one plain dictionary of JSON's types: all that a page needs to show them, and nothing else.
``format`` and ``version`` say what the dictionary is. ``bodies`` are those of the runs, all of one kind and on one
clock; each has its ``name``, its kind ``body``, which is ball, disk, rigid, particle or drawn, what else it is made of,
and where its ``arrays`` are in the list ``arrays`` of the dictionary. Equal arrays are there once, each with its
``type``, float32 or float64, its ``shape`` and its ``data``: the bytes, the least significant first, in base64. They
have numbers at each saved time that the solve reached; where these are too many for the file, only evenly spaced ones
are kept, as ``note`` says, and ``saved`` is the number of all. A ball or a disk has

- ``time`` (T,); ``centre`` (T, 3), of the shell, and ``quaternion`` (T, 4), the scalar last: from body axes to those of
  the page; ``moved`` (T, 3), ``turned`` (T,) and ``belt`` (T, 2), of a ground that moves, of a turntable and of a belt;
- of a body that is no ball, ``foot`` (T, 3), from there to its lowest point, in axes of the page, and its ``surface``
  (49 · 97, 3) in body axes, row after row from E3 down, each from E1 around E3;
- on a surface, ``mesh`` (S, nodes, 3), row after row, in axes that move with it, of which S = T if it changes its form
  and then has ``nodes`` (T, 2), the row and the column at the contact point; ``carried`` (T, 4), the quaternion from
  these axes to those of the page, if it turns; and ``normal`` and ``tangent`` (T, 3) of it at the contact point, in
  whose axes ``friction`` is;
- ``masses`` (T, n, 3) and ``arms_j`` (T, n_j, points, 3), of the j-th mechanism, in body axes from the centre;
  ``rail_j`` (points, 3), which is at rest there. With the ``shell``, masses give the centre of mass;
- ``normal_force`` (T,), ``friction`` (T, 2) in space axes, ``angular_velocity`` and ``angular_momentum`` (T, 3) in body
  axes, the latter Π about the contact point, and whatever else the ``plots`` draw. Each of their ``series`` names an
  array and some of its columns, and draws their sum, or with ``norm`` their length as a vector, divided by the array
  ``over`` if there is one; ``dash`` is on and off in pixels. A value that is rounding beside the ``size`` of its graph
  is drawn as 0, and no line crosses a change of mode where there are ``gaps``. Names stand beside values, unless
  ``valued`` is false; ``levels`` are names and values of horizontal lines.
- with a law of contact, ``spells``, its modes one after the other, each of them ``[mode, start, end]``, and
  ``switches``, the times of impacts and of all else that ends a mode, each of which is twice among the times, for what
  is just before it and what is just after; and ``height`` (T,) over the plane, ``slip``
  (T, 2), the velocity of the lowest point along it in space axes, and ``taken`` (T, 2), the energies that friction of
  sliding and impacts took. Π is about the lowest point. ``cone`` of the dictionary is the coefficient μ_s.

- under feedback, ``nominal_centre`` (T, 3) and ``nominal_quaternion`` (T, 4), the pose of the motion that it holds, and
  ``deviation`` (T, n) from it in local coordinates; and from sensors, ``estimate`` (T, 3), the estimated place on the
  plane, ``ellipse`` (T, 6), the two half axes of the ellipse around it in which the place lies with 95 % probability,
  if the filter is right, and ``innovation`` (T, 3), the normalised innovation squared and its upper and lower bounds of
  that probability.

A rigid body has ``time``, ``centre``, which is its fixed point, or the centre of a rolling ellipsoid in axes that
travel with it, ``quaternion`` and ``angular_velocity`` as above;
``angular_momentum`` 𝕀Ω (T, 3) and ``vertical`` Γ (T, 3) in body axes, ``momentum_in_space`` (T, 3), and in Suslov's
problem ``xi`` (T, 3), of length 1, in body axes. Its ``ellipsoid`` has its ``centre`` in the body, three ``semi_axes``
and the ``quaternion`` from these to body axes; ``centre_of_mass`` is in body axes, or None, and so is the ``place`` of
the ``tip`` whose path is drawn. A particle has ``time``, ``centre``, where it is, and ``velocity`` (T, 3). What a
function draws of a system with a Lagrangian has ``time``, ``line_k`` (T, points, 3), of which a single point is a dot,
``centre`` (T, 3), where the last of them ends, ``q`` and ``qdot`` (T, n), and λ as ``multipliers`` (T, k); its
``lines`` are their colours, and ``corners`` of the dictionary those of a box around all. The array ``laws`` (T, laws)
of all has the changes of conserved quantities since the start; of a vector, its length.

``axes`` are three rows that take space axes to those of the page, whose third axis points against gravity; ``floor`` is
the plane, in axes of the page, or None where there is none. Where radii differ, it is that of the first body. Of a
surface it has the numbers of rows and columns of the ``mesh`` and the ``corners`` of a box around it. ``obstacles`` are
discs on it, each ``[x, y, radius]`` in space axes; on a surface, the points of their edges. ``wanted`` is the place of
an array (points, 3) on it, or None. ``scale`` says which number the bodies' colours stand for, by its values at equal
steps of the colours ``stops``, or is None.
"""

import base64
import functools
import hashlib
import html
import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, to_hex

from ...interface.arguments import require_flags
from ...interface.output import MARK, MOST_BODIES, check_view, replacing
from ...physics.body import AbstractBody
from ...physics.classical import LagrangianState, ParticleState, VakonomicState
from ...physics.classical.state import OrientedState
from ...simulation.trajectory import Trajectory
from ..palette import ARROWS, COMPONENTS, MODES, TRAIL, mass_colour
from ..record import Picture
from ..style import COLOURS, ColourScale, describe, describe_units, dimensionless, norm_of
from .free import particle_scene, picture_scene, rigid_scene
from .rolling import rolling_scene
from .scene import PAIR, Discs, Pool, Scene, choose_rows

FORMAT, VERSION = "jaxball view", 5
BEFORE, UNKNOWN = "#8a8a8a", "#8a8a8a"
PALETTE = {"trail": TRAIL, "modes": {mode.name.lower(): colour for mode, colour in MODES.items()}} | ARROWS
STOPS = 9
# So that no text of a run can end the element that contains it, or a line of a program that reads it.
ESCAPES = {ord(letter): f"\\u{ord(letter):04x}" for letter in "<>&\u2028\u2029"}
Runs = Trajectory[Any, Any] | Mapping[str, Trajectory[Any, Any]]
ROLLING, RIGID, PARTICLE, DRAWN = "body that rolls", "rigid body", "particle", "system with a Lagrangian"
SHOWN_SYSTEMS = (
    "a ball, a disk, a rigid body with a RigidBodyState or an EllipsoidState, a particle with a ParticleState or a "
    "VakonomicState or a system with a LagrangianState"
)


def view_document(
    trajectories: Runs,
    title: str = "",
    friction: float | None = None,
    *,
    wanted: Float[np.ndarray, "k 2"] | None = None,
    discs: Discs = (),
    scale: ColourScale | None = None,
    picture: Picture | None = None,
    room: float = np.inf,
) -> dict[str, Any]:
    """Returns the dictionary of a run, or of several by name, in at most ``room`` characters of JSON if possible.

    **Raises:** ``ValueError`` as :func:`~jaxball.plot.write_view`.
    """
    if friction is not None and not 0 < friction < np.inf:
        raise ValueError(f"Argument `friction` must be a positive number, but it is {friction}.")
    named = trajectories if isinstance(trajectories, Mapping) else {"": trajectories}
    count, runs = len(named), list(named.values())
    if not 1 <= count <= MOST_BODIES:
        raise ValueError(f"Argument `trajectories` must have from one run to {MOST_BODIES}, but it has {count}.")
    if scale is not None and len(scale.values) != count:
        raise ValueError(
            f"Argument `scale` must have a value for each of the {count} runs, but it has {len(scale.values)}."
        )
    scene = _scene(named, friction, wanted, discs, picture)
    looks, same_units = _looks(count, scale), all(dimensionless(trajectory.system) for trajectory in runs)
    stated = describe_units(runs[0]) if len({describe_units(run) for run in runs}) == 1 else ""
    document = {
        "format": FORMAT,
        "version": VERSION,
        "title": title or (describe(runs[0].system) if count == 1 else f"{count} runs"),
        "units": stated or ("dimensionless, m₀ = r = g = 1" if same_units else "in the units of its parameters"),
        "friction": friction,
        "palette": {"components": list(COMPONENTS)} | PALETTE,
        "scale": None if scale is None else _stops(scale),
        "plots": scene.plots,
        "bodies": [{"name": name, **look} | parts for name, look, parts in zip(named, looks, scene.made, strict=True)],
    } | scene.stand
    document |= _outcome(document["bodies"]) | {"note": "", "wanted": None}
    extra = {} if scene.wanted is None else {"wanted": scene.wanted}
    lengths = [body["saved"] for body in document["bodies"]]
    # The numbers may take what all else leaves; room is kept for the note, whose numbers depend on the choice of
    # rows.
    left = room - len(in_element(document).encode()) - len(_note(0, 0))
    rows = choose_rows([*scene.numbers, extra], [*lengths, 2], left)
    pool = Pool()
    for body, numbers, shown_rows in zip(document["bodies"], scene.numbers, rows, strict=False):
        body["arrays"] = {name: pool.add(array, shown_rows) for name, array in numbers.items()}
    shown_rows, saved = sum(map(len, rows[:-1])), sum(lengths)
    return document | {
        "note": _note(shown_rows, saved) if shown_rows < saved else "",
        "wanted": pool.add(extra["wanted"]) if extra else None,
        "arrays": pool.arrays,
    }


def _scene(
    named: Mapping[str, Trajectory[Any, Any]],
    friction: float | None,
    desired_path: Float[np.ndarray, "k 2"] | None,
    discs: Discs,
    picture: Picture | None,
) -> Scene:
    """Builds the scene of runs of one kind.

    **Raises:** ``ValueError`` for runs of several kinds, of a kind that cannot be shown, and for arguments that do not
    apply.
    """
    kinds = {name: kind_of(trajectory) for name, trajectory in named.items()}
    first, kind = next(iter(kinds.items()))
    for name, other in kinds.items():
        if other is None:
            system = named[name].system
            raise ValueError(
                f"Argument `trajectory` must be of {SHOWN_SYSTEMS}, but it is of a {type(system).__name__}; its method "
                "plot() draws its motion."
            )
        if other != kind:
            raise ValueError(
                f'Argument `trajectories` must have runs of one kind, but "{name}" is a {other} and "{first}" is a '
                f"{kind}; show them one by one."
            )
    if picture is not None and kind != DRAWN:
        raise ValueError(
            f"Argument `picture` must be left out for a {kind}, which is drawn without, but it is given; it draws a "
            f"{DRAWN}."
        )
    if kind == ROLLING:
        return rolling_scene(named, desired_path, discs)
    for name, value in (("friction", friction), ("wanted", desired_path), ("discs", discs or None)):
        if value is not None:
            raise ValueError(
                f"Argument `{name}` must be left out for a {kind}, which is no ball or disk, but it is given."
            )
    trajectories = list(named.values())
    if kind == DRAWN:
        if picture is None:
            raise ValueError(
                f"Argument `picture` must be given for a {DRAWN}: a function of (t, q) that returns a list of points "
                "and lines; its method plot() draws its coordinates without."
            )
        return picture_scene(trajectories, picture)
    return rigid_scene(trajectories) if kind == RIGID else particle_scene(trajectories)


def in_element(document: Mapping[str, Any]) -> str:
    """Writes a document as JSON that can stand in an element of HTML."""
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.translate(ESCAPES)


def _looks(count: int, scale: ColourScale | None) -> list[dict[str, Any]]:
    """Returns the colour of each body, None for a single one, whether its curves are ``dashed``, and its ``value``."""
    plain: dict[str, Any] = {"dashed": False, "value": None}
    if scale is not None:
        values = np.asarray(scale.values, dtype=float)
        colours = ScalarMappable(norm_of(values, scale.logarithmic), COLOURS).to_rgba(values)
        return [
            plain | ({"colour": to_hex(colour), "value": value} if np.isfinite(value) else {"colour": UNKNOWN})
            for colour, value in zip(colours, values.tolist(), strict=True)
        ]
    if count == 1:
        return [plain | {"colour": None}]
    if count == PAIR:
        return [plain | {"colour": BEFORE, "dashed": True}, plain | {"colour": TRAIL}]
    return [plain | {"colour": mass_colour(k)} for k in range(1, count + 1)]


def _stops(scale: ColourScale) -> dict[str, Any]:
    norm = norm_of(np.asarray(scale.values, dtype=float), scale.logarithmic)
    shares = np.linspace(0.0, 1.0, STOPS)
    colours = ScalarMappable(None, COLOURS).to_rgba(shares, norm=False)
    return {
        "name": scale.name,
        "low": float(norm.vmin or 0.0),
        "high": float(norm.vmax or 0.0),
        "logarithmic": isinstance(norm, LogNorm),
        "stops": [to_hex(colour) for colour in colours],
    }


def _outcome(bodies: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Returns whether all solves reached their end, and a sentence for each that did not."""
    failed = [body for body in bodies if not body["ok"]]
    if len(bodies) == 1:
        return {"ok": not failed, "message": bodies[0]["message"]}
    sentences = [f"{body['name']}: {body['message']}" for body in failed]
    return {"ok": not failed, "message": " ".join(sentences) or "Every solve reached its end."}


def _note(count: int, saved: int) -> str:
    """Returns the sentence that says how many of the saved times are shown."""
    if not saved:
        return " " * 200  # as long as it may be
    return (
        f"Shown are {count:,} of the {saved:,} saved times, evenly spaced, to keep this file small; all_times=True in "
        "Python, or --all-times of jaxball view, keeps all of them."
    )


def kind_of(trajectory: Trajectory[Any, Any]) -> str | None:
    """Returns the kind as which a run is shown; None if it cannot be shown."""
    if isinstance(trajectory.system, AbstractBody):
        return ROLLING
    if isinstance(trajectory.state, OrientedState):
        return RIGID
    if isinstance(trajectory.state, LagrangianState):
        return DRAWN
    return PARTICLE if isinstance(trajectory.state, ParticleState | VakonomicState) else None


HERE = Path(__file__).parent
LARGEST_PAGE, LARGEST_PAGE_OF_SEVERAL = 1_000_000, 2_000_000  # bytes of a page, unless all saved times are requested
HEIGHT = 760  # of the page within a notebook, pixels


class View:
    """A run as a page, which a notebook shows in place.

    :meth:`jaxball.Trajectory.view` makes one. ``html`` is the page, one self-contained text.

    **Arguments:**

    - ``document``: the dictionary that the page shows; the module ``jaxball.plot.view.page`` describes it.
    """

    def __init__(self, document: Mapping[str, Any]) -> None:
        self.document = document

    @classmethod
    def of(cls, trajectories: Runs, title: str = "", *, all_times: bool = False, **shown: Any) -> "View":
        """Makes the view of a run or of several; arguments and errors are as for :func:`write_view`."""
        require_flags(all_times=all_times)
        largest = (
            LARGEST_PAGE_OF_SEVERAL if isinstance(trajectories, Mapping) and len(trajectories) > 1 else LARGEST_PAGE
        )
        # Without the page itself, whose program takes most of it.
        room = np.inf if all_times else float(largest - len(page({}).encode()))
        return cls(view_document(trajectories, title, **shown, room=room))

    @functools.cached_property
    def html(self) -> str:
        """The page."""
        return page(self.document)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes the page to ``path``, a file that ends in ``.html``, and returns the path.

        **Raises:** :class:`~jaxball.files.results.OutputError` when it cannot be written, and when an existing file is
        not such a page; that file is not changed.
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


def view_run(
    run: Trajectory[Any, Any],
    path: str | os.PathLike[str] | None = None,
    *,
    title: str | None = None,
    friction: float | None = None,
    picture: Picture | None = None,
    all_times: bool = False,
) -> View:
    """Makes the page of a run; see :meth:`jaxball.Trajectory.view`."""
    default_title = "" if run.scenario is None else run.scenario.title
    shown = {"friction": friction, "picture": picture, "all_times": all_times}
    page = View.of(run, default_title if title is None else title, **shown)
    if path is not None:
        page.save(path)
    return page


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
    :class:`~jaxball.files.results.OutputError` as :meth:`View.save`.
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
