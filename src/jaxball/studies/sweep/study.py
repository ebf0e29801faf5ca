"""A study: a scenario, the axes along which its numbers change, and the results to keep of each run."""

import dataclasses
import functools
import io
import math
import tomllib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomli_w
from jaxtyping import Float, Int

from ...files.scenario import read_document
from ...files.scenario.errors import ScenarioError, describe, each_of, key_error, raise_first, try_readers
from ...files.scenario.files import ABOUT, OF_SCENARIO, with_defaults
from ...files.scenario.imports import import_name
from ...files.scenario.own import own_class, trying_class
from ...files.scenario.paths import check_number, value_at, with_numbers
from ...files.scenario.scenario import Scenario
from ...files.scenario.sources import document_of, naming, naming_scenario, scenario_document, text_of
from ...files.scenario.table import Key, read_list, read_one_of, read_table
from ...files.scenario.values import Choice, Flag, Integer, Numbers, Text, unread
from ...interface.names import leave_to
from ...interface.printing import repr_html
from ...interface.status import BACK_WITHIN
from ...interface.wording import did_you_mean, number_of
from ...numerics.declare import POSITIVE
from ...physics.rolling import AbstractRollingSystem
from ...simulation.ensemble import REDUCTIONS, AbstractReduction, Drift, Integral, Maximum, Minimum
from ...simulation.ensemble.reductions import reductions_of
from .axes import AXES, Axis, keys_of_paths, read_axis
from .files import StudyError

if TYPE_CHECKING:
    from .progress import Stream
    from .rows import Engine
    from .run import Estimate, Outcome

KINDS: Mapping[str, type[Any]] = {"maximum": Maximum, "minimum": Minimum, "integral": Integral, "drift": Drift}
OWN = "reduction"  # of a user's class
_FIND_SAYS = {
    "maximum": 'the largest value of a function over the run, "module:function"',
    "minimum": 'the smallest value of a function over the run, "module:function"',
    "integral": 'the integral of a function over the run, "module:function"',
    "drift": 'the largest distance of a function from its value at the start, "module:function"',
    OWN: 'a class of your own, "module:Class"',
}
_NAME = Key(Text(), says="its name in the store")
FINDS = {kind: {"name": _NAME, kind: Key(Text(), says=_FIND_SAYS[kind])} for kind in (*KINDS, OWN)}


@dataclasses.dataclass(frozen=True)
class Find:
    """A reduction by name: one of ``jaxball.simulation.ensemble.REDUCTIONS``, or of a module's function or class."""

    name: str
    kind: str = ""
    function: str = ""

    def reduction(self) -> AbstractReduction:
        """Returns the reduction itself.

        **Raises:** :class:`~jaxball.ScenarioError` when there is no such function or class.
        """
        if not self.kind:
            return REDUCTIONS[self.name]
        if self.kind == OWN:
            kind = own_class(self.function, "find", AbstractReduction)
            with trying_class("find", self.function):
                return kind()
        return KINDS[self.kind](import_name("find", self.function))


def read_finds(values: Any, template: Scenario) -> tuple[Find, ...]:
    """Reads the reductions that the key `find` lists.

    **Raises:** :class:`~jaxball.ScenarioError`, with one sentence, for a result that cannot be found for
    this scenario.
    """
    if not isinstance(values, list):
        raise key_error("find", "a list of names and tables", describe(values))
    finds = tuple(_read_find(item, f"find[{k}]", template) for k, item in enumerate(values))
    names = [find.name for find in finds]
    if len(set(names)) < len(names):
        raise key_error("find", "a list of different names", describe(names))
    # Made once here, so that a wrong name is an error of the file and not of a worker.
    for find in finds:
        find.reduction()
    return finds


def _read_find(value: Any, path: str, template: Scenario) -> Find:
    if isinstance(value, str):
        reductions = reductions_of(template.system)
        if value not in reductions:
            hint = f"the names are {', '.join(reductions)}" if reductions else "there are none for this system"
            raise StudyError(
                f"Key `{path}` must be a table or a name that is known, but it is {describe(value)}"
                f"{did_you_mean(value, reductions, hint)}"
            )
        return Find(value)
    kind, table = read_one_of(value, path, FINDS)
    return Find(table["name"], kind, table[kind])


LARGEST_CHUNK = 8192
MOST_NUMBERS = 2**24  # in the states of a chunk
NUMBERS_OF_A_STATE = 16  # about as many as for a ball with a few driven masses
SMALLEST_CHUNK = 16
ENOUGH_CHUNKS = 16  # for a small study


@dataclasses.dataclass(frozen=True)
class Study:
    """A scenario whose numbers change from row to row: the content of a study file.

    The rows are the points of all axes crossed, the last axis changing fastest. Row k is computed from k alone.

    - ``title``: a one-line description.
    - ``document``: the scenario, as the TOML document of its file.
    - ``axes``: what changes: each axis has the paths of one or more numbers in the document.
    - ``save``: the state at the end of each run, or at all of the scenario's save times. It is "end" or "times".
    - ``contact``: whether to compute the extremes of the contact force, and whether the body would have left the plane.
      The extremes are those over each run, including μ_min.
    - ``detachment``: whether a run ends where the body would leave the plane.
    - ``readings``: whether to keep the extremes of what the sensors read at the save times, and all readings where
      these are saved.
    - ``within``: how small the weighted deviation of a run under feedback must be at the end to have returned.
    - ``finds``: what else to compute for each run.
    - ``chunk``: how many rows are solved and written together.
    """

    title: str
    document: dict[str, Any]
    axes: tuple[Axis, ...]
    save: str = "end"
    contact: bool = False
    detachment: bool = False
    finds: tuple[Find, ...] = ()
    chunk: int = 1
    readings: bool = False
    within: float = BACK_WITHIN

    _repr_html_ = repr_html

    def __repr__(self) -> str:
        axes = [f"  {', '.join(axis.paths)}: {number_of(axis.size, 'point')}" for axis in self.axes]
        finds = [f"  finds {', '.join(find.name for find in self.finds)}"] if self.finds else []
        return "\n".join([f"Study {self.title!r}: {number_of(self.rows, 'row')}", *axes, *finds])

    @property
    def shape(self) -> tuple[int, ...]:
        """The sizes of the axes."""
        return tuple(axis.size for axis in self.axes)

    @property
    def rows(self) -> int:
        """How many rows there are."""
        return math.prod(self.shape)

    @property
    def chunks(self) -> int:
        """How many chunks there are; the last may be shorter than the others."""
        return -(-self.rows // self.chunk)

    @property
    def paths(self) -> tuple[str, ...]:
        """The paths of the numbers that change."""
        return tuple(path for axis in self.axes for path in axis.paths)

    def rows_of(self, chunk: int) -> Int[np.ndarray, " rows"]:
        """Returns the rows of a chunk."""
        return np.arange(chunk * self.chunk, min((chunk + 1) * self.chunk, self.rows))

    def values(self, rows: Int[np.ndarray, " rows"]) -> Float[np.ndarray, "rows numbers"]:
        """Returns the numbers that change, in the order of ``paths``, for each of ``rows``."""
        indices = np.unravel_index(rows, self.shape)
        return np.concatenate([axis.values(k) for axis, k in zip(self.axes, indices, strict=True)], axis=1)

    def scenario(self, row: int) -> Scenario:
        """Returns the scenario of a row.

        **Raises:** :class:`StudyError`, which names the row, where its numbers are impossible.
        """
        values = self.values(np.asarray([row]))[0]
        try:
            return self.scenario_with(values)
        except ScenarioError as error:
            raise StudyError(f"Row {row}: {error}") from None

    def scenario_with(self, values: Float[np.ndarray, " numbers"]) -> Scenario:
        """Returns the scenario with ``values`` at ``paths``.

        **Raises:** :class:`~jaxball.ScenarioError` where they are impossible.
        """
        return read_document(self.document_with(values))

    def document_with(self, values: Float[np.ndarray, " numbers"]) -> dict[str, Any]:
        """Returns the scenario's document with ``values`` at ``paths``."""
        return with_numbers(self.document, dict(zip(self.paths, values.tolist(), strict=True)))

    def template(self) -> Scenario:
        """Returns the scenario itself, with everything that all rows have in common."""
        # As text, because a dictionary cannot be the key of a cache; workers ask for each chunk.
        return _read(tomli_w.dumps(self.document))

    def identity(self) -> dict[str, str]:
        """Returns everything that the results depend on, except versions, as text; files are identified by their
        SHA-256.
        """
        axes = repr(self.axes)
        names = ("save", "contact", "detachment", "finds", "chunk", "readings", "within")
        options = ", ".join(f"{name} = {getattr(self, name)}" for name in names)
        return {"scenario": tomli_w.dumps(self.document), "axes": axes, "settings": options}

    # What can be done with a study needs modules that are built upon this one.

    def run(
        self,
        out: str | Path,
        *,
        workers: int = 1,
        executor: Any = None,
        shard: tuple[int, int] = (1, 1),
        engine: "Engine | None" = None,
        stream: "Stream | None" = None,
    ) -> "Outcome":
        """Runs the study, or resumes it, and writes a Zarr store and, at the end, a Parquet table.

        Chunks of rows are written atomically, so a run that was killed at any moment is resumed when this is called
        again; chunks whose files have been changed from outside are then recomputed. The finished files are identical,
        byte for byte, whatever the number of workers and the order of chunks, as long as all workers have the same
        versions, the same ``XLA_FLAGS`` and the same kind of processor.

        **Arguments:**

        - ``out``: the store, a path that ends in ``.zarr``; the table is beside it and ends in ``.parquet``.
        - ``workers``: the number of processes. With one, it is this process, whose threads use every core; several
          share the cores. A script that starts several does so under ``if __name__ == "__main__":``.
        - ``executor``: instead of workers, an executor in the style of ``concurrent.futures``, such as
          ``dask.distributed.Client(...).get_executor()``; its workers must see the folder of ``out``.
        - ``shard``: (k, n) computes the k-th of n parts, with k from 1. The last one to finish writes the table.
        - ``engine``: how the rows of a chunk are solved.
        - ``stream``: where to show the progress; nothing is shown if not given.

        **Raises:** :class:`StoreError` when the store cannot be written or belongs to another study,
        :class:`StudyError` for a row that is invalid in this study and where float64 is not enabled,
        :class:`WorkerError` when a worker was killed, ``ValueError`` for invalid arguments.
        """
        from .outputs import outputs_of
        from .run import STOPPING, check_arguments, complete, only_one, solve_in_lanes
        from .store import open_store

        check_arguments(workers, shard)
        store = open_store(Path(out).resolve(), self, outputs_of(self, self.template()))
        words = STOPPING if stream is not None else ""
        stream = io.StringIO() if stream is None else stream
        with only_one(store.folder, shard, stream):
            return complete(store, shard, workers, executor, engine or solve_in_lanes, stream, words)

    @leave_to(".run")
    def estimate(
        self, engine: "Engine | None" = None, *, measure: bool = False, workers: int | None = None
    ) -> "Estimate":
        """Estimates the size of the store, at once.

        **Arguments:**

        - ``engine``: what solves its rows.
        - ``measure``: whether to solve a few rows, to estimate how long all of them take. If a chunk takes only
          seconds, it is solved and written as in the sweep, by each of the workers at the same time. The programs are
          those of the sweep.
        - ``workers``: the number of processes that share the cores; if not given, one or as many as there are cores,
          whichever is quicker.

        **Raises:** :class:`StudyError` as :meth:`run`, and ``ValueError`` for fewer workers than one.
        """
        raise NotImplementedError


KEYS = {
    **ABOUT,
    **OF_SCENARIO,
    "axes": Key(unread("a list of tables", AXES, forms=("list",)), says="what varies, each under [[axes]]"),
    "save": Key(Choice(("end", "times")), "end", (Study, "save")),
    "contact": Key(Flag(), False, (Study, "contact")),
    "detachment": Key(Flag(), False, (Study, "detachment")),
    "readings": Key(Flag(), False, (Study, "readings")),
    "within": Key(Numbers(rule=POSITIVE), BACK_WITHIN, (Study, "within")),
    "find": Key(unread("a list of names and tables", FINDS, forms=("list",), others=(Text(),)), [], (Study, "finds")),
    "chunk": Key(
        Integer(1, 2**20),
        None,
        says="how many rows are solved and written together; by the size of the study if not given",
    ),
}


def ends_at_detachment(settings: str) -> bool:
    """Returns whether the ``settings`` of an identity belong to a study whose runs end where the ball would leave the
    plane.
    """
    return settings.partition(", finds = ")[0].endswith(", detachment = True")


def load_study(source: str | Path) -> Study:
    """Reads the study of the file at the path ``source``.

    **Raises:** :class:`~jaxball.ScenarioError`, with one sentence, when there is no such file, when it
    is not TOML, when a key of it or of its scenario is misspelt, missing or wrong, and when an axis names no number.
    """
    text = text_of(source, "study file", StudyError)
    with naming(source):
        return read_study(text, Path(source).parent)


def read_study(text: str, folder: str | Path = ".") -> Study:
    """Reads the study that the ``text`` of a file describes; files that it names are looked for relative to ``folder``.

    **Raises:** as :func:`load_study`.

    **Example:**

    >>> from jaxball.studies.sweep import read_study
    >>> study = read_study('''
    ... format = 1
    ... scenario = "disk"
    ...
    ... [[axes]]
    ... path = "body.mass"
    ... log = { from = 0.5, to = 2.0, count = 4 }
    ... ''')
    >>> study.rows, study.paths
    (4, ('body.mass',))
    """
    document, folder = document_of(text, "study", StudyError), Path(folder)

    def axis(values: Any, path: str) -> Axis:
        return read_axis(values, path, folder)

    (table, read, axes), errors = try_readers(
        lambda: read_table(document, "", KEYS),
        lambda: _template(document["scenario"], folder) if "scenario" in document else None,
        lambda: tuple(read_list(document["axes"], "axes", axis)) if "axes" in document else None,
    )
    scenario, template = read or ({}, None)
    # Errors in one of these parts must not hide errors in the others.
    # An axis may change a number that the scenario leaves at its default.
    if axes and template:
        scenario = with_defaults(scenario, template, (path for axis in axes for path in axis.paths))
    (*_, finds), later = try_readers(
        lambda: table and template and _check_contact(table, template),
        lambda: table and template and _check_sensors(table, template),
        lambda: axes and template and _check_paths(axes, scenario, template, document.get("readings") is True),
        lambda: template and read_finds(document.get("find", []), template),
    )
    raise_first([*errors, *later])
    if table is None or template is None or axes is None:
        raise AssertionError("A part that could not be read has an error.")
    rows = math.prod(axis.size for axis in axes)
    # What is kept at each time needs memory in proportion to the number of times.
    looked_at = table["save"] == "times" or table["readings"] or template.feedback is not None
    saves = template.times.size if looked_at else 1
    chunk = _chunk_for(rows, saves) if table["chunk"] is None else min(table["chunk"], rows)
    as_read = {name: table[name] for name in ("title", "save", "contact", "detachment", "readings", "within")}
    return Study(document=scenario, axes=axes, finds=finds, chunk=chunk, **as_read)


@functools.lru_cache(maxsize=4)
def _read(document: str) -> Scenario:
    return read_document(tomllib.loads(document))


def _template(value: Any, folder: Path) -> tuple[dict[str, Any], Scenario]:
    """Reads the document of the scenario that a study contains or names, and its contents."""
    document = scenario_document(value, folder, StudyError)
    with naming_scenario(value, "study", StudyError):
        return document, read_document(document)


def _check_contact(table: dict[str, Any], template: Scenario) -> None:
    for key in ("contact", "detachment"):
        if table[key] and not isinstance(template.system, AbstractRollingSystem):
            must = f"false for a {template.system.title}, which does not roll on a plane"
            raise key_error(key, must, "true", StudyError)
        if table[key] and template.may_slip:
            must = "false where the scenario has a law of contact, with which the body may slip and fly"
            raise key_error(key, must, "true", StudyError)
    if table["detachment"] and "detachment" in template.events:
        must = "false where the scenario has an event of that name, which the store keeps"
        raise key_error("detachment", must, "true", StudyError)
    if table["detachment"] and template.feedback is not None:
        must = "false where the scenario has feedback, whose samples are solved one by one"
        raise key_error("detachment", must, "true; `contact = true` finds the least normal force", StudyError)


def _check_sensors(table: dict[str, Any], template: Scenario) -> None:
    if table["readings"] and not template.sensors:
        raise StudyError("Key `readings` must be false where the scenario has no [sensors], but it is true.")


def _check_paths(axes: tuple[Axis, ...], scenario: dict[str, Any], template: Scenario, readings: bool) -> None:
    keys = [item for k, axis in enumerate(axes) for item in keys_of_paths(axis, f"axes[{k}]")]
    paths = [path for path, _ in keys]
    measured = readings or template.estimator is not None
    each_of(*(functools.partial(check_number, scenario, path, measured, key, has_defaults=True) for path, key in keys))
    if template.feedback is not None:
        each_of(*(functools.partial(_check_of_loop, scenario, path) for path in paths))
    for path, count in Counter(paths).items():
        if count > 1:
            raise StudyError(f"Key `{path}` must be in one axis, but it is in two.")


def _check_of_loop(scenario: dict[str, Any], path: str) -> None:
    """Raises for a number that determines how a closed loop is computed."""
    if path.partition(".")[0] == "time":
        raise StudyError(
            f"Key `{path}` must be the same in all rows with feedback, because save times are its samples."
        )
    if path.endswith(".errors.random_walk") and not value_at(scenario, path):
        raise StudyError(
            f"Key `{path}` must be positive in the scenario if rows change it, because a filter estimates a bias only "
            "of a sensor that has a random walk, but it is 0; give a small one."
        )


def _chunk_for(rows: int, saves: int) -> int:
    """Chooses the rows of a chunk: enough chunks to share among workers and to lose little, but not as many as make
    lanes and files costly.
    """
    most = min(LARGEST_CHUNK, MOST_NUMBERS // (NUMBERS_OF_A_STATE * saves))
    # A power of two, from about a sixteenth of the rows.
    return max(1, min(max(SMALLEST_CHUNK, 1 << (rows // ENOUGH_CHUNKS).bit_length()), most, rows))
