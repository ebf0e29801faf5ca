"""The computed rows of a study, failed ones too, as its figures need them.

They have their indices in the data set, results by name such as ``z[0]``, and labels with symbols and units. The
figures of ``plot.sweeps`` read studies through them; ``sweep_scale`` colours the bodies of ``jaxball view --rows``.
"""

import dataclasses
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Int

from ...files.scenario.paths import entries
from ...interface.status import SUCCESSES, Status
from ...interface.wording import did_you_mean
from ...simulation import DEFAULT_TOLERANCE
from ...simulation.variables import EXTREMES, FINDS, RUN, symbol_of
from ..style import ColourScale, label_with

if TYPE_CHECKING:
    import xarray

# The path of a number, in which # stands for an index, with its symbol, in which # stands for that index from 1, and
# its unit.
NUMBERS = {
    "body.mass": ("m_0", "mass"),
    "body.radius": ("r", "length"),
    "body.gravity": ("g", "length/time²"),
    "body.inertia": ("d", "mass length²"),
    "body.inertia[#]": ("d_{#}", "mass length²"),
    "body.offset[#]": (r"\chi_{0,#}", "length"),
    "body.chi[#]": (r"\chi_{#}", "length"),
    "masses[#].mass": ("m_{#}", "mass"),
    "masses[#].rail.radius": ("r_{#}", "length"),
    "masses[#].rail.semi_axes[#]": ("a_{#,#}", "length"),
    "masses[#].schedule.theta": (r"\theta_{#}(t_0)", "rad"),
    "masses[#].schedule.rate": (r"\dot{\theta}_{#}", "rad/time"),
    "masses[#].schedule.height": (r"\ddot{\theta}_{#}", "rad/time²"),
    "mechanisms[#].masses[#].mass": ("M_{#,#}", "mass"),
    "mechanisms[#].masses[#].position[#]": (r"\chi_{#,#,#}", "length"),
    "mechanisms[#].joints[#].schedule.theta": (r"\theta_{#,#}(t_0)", ""),
    "mechanisms[#].joints[#].schedule.rate": (r"\dot{\theta}_{#,#}", ""),
    "mechanisms[#].joints[#].force.signal": ("Q_{#,#}", ""),
    "mechanisms[#].joints[#].force.limit": (r"|Q_{#,#}|_{\max}", ""),
    "mechanisms[#].joints[#].force.stiffness": ("k_{#,#}", ""),
    "mechanisms[#].joints[#].force.damping": ("c_{#,#}", ""),
    "ground.angle": ("a", "rad"),
    "ground.heading": ("b", "rad"),
    "contact.friction": (r"\mu", ""),
    "contact.static_friction": (r"\mu_s", ""),
    "contact.restitution": ("e", ""),
    "initial.Omega[#]": (r"\Omega_{#}(t_0)", "rad/time"),
    "initial.phi": (r"\phi(t_0)", "rad"),
    "initial.phidot": (r"\dot{\phi}(t_0)", "rad/time"),
    "initial.z": ("z(t_0)", "length"),
    "initial.z[#]": ("z_{#}(t_0)", "length"),
    "initial.theta[#]": (r"\theta_{#}(t_0)", ""),
    "initial.thetadot[#]": (r"\dot{\theta}_{#}(t_0)", ""),
    "initial.velocity[#]": ("V_{#}(t_0)", "length/time"),
    "initial.height": ("h(t_0)", "length"),
    "time.end": ("t_1", "time"),
}
Labels = Mapping[str, str] | None
GREEK = {"Gamma": "Γ", "Lambda": "Λ", "Omega": "Ω", "chi": "χ", "lambda": "λ", "mu": "μ", "phi": "φ", "theta": "θ"}
SUBSCRIPTS = str.maketrans("0123456789sx", "₀₁₂₃₄₅₆₇₈₉ₛₓ")
SEED = 0
FEW_PATHS = 2
_NEEDED = ("shape", "paths", "path_axis", "path_logarithmic", "axis_scattered")
_KNOWN = RUN | EXTREMES | FINDS
_FIRST = ("friction_needed", "z", "phi", "x", "y")
_NOT_RESULTS = ("row", "status")
_LEADING = ("row", "save")  # dimensions before those of a result itself
MOST_STANDARD = 3


def number_label(
    path: str, labels: Labels = None, *, data: "xarray.Dataset | None" = None, with_unit: bool = True
) -> str:
    """Returns the label of the number at a path: from ``labels``, or its symbol or its path, with its unit.

    The unit is that which the store ``data`` states, or else a dimension in words, for those that have a symbol.
    """
    if labels and path in labels:
        return labels[path]
    indices = iter(re.findall(r"\[(\d+)\]", path))
    symbol, dimension = NUMBERS.get(re.sub(r"\[\d+\]", "[#]", path), ("", ""))
    # A function, because a replacement text would take backslashes of the symbol as its own.
    numbered = re.sub("#", lambda _: str(int(next(indices)) + 1), symbol)
    unit = ("" if data is None else data[path].attrs.get("units", "")) or dimension
    return label_with(f"${numbered}$" if symbol else path, unit if with_unit else "")


def plain(path: str) -> str:
    """Returns a path as part of a file's name, without brackets: ``masses0.mass``, ``z0``."""
    # A hyphen between two indices, which would otherwise become one number.
    return re.sub(r"[^\w.-]+", "_", re.sub(r"\[(\d+)\]", r"\1", path.replace("][", "]-["))).strip("_")


def in_plain_text(label: str) -> str:
    """Writes a label in the characters of plain text, for a page without TeX: ``Ω₃(t₀) (rad/time)``."""
    text = re.sub(r"\\ddot\{(\\?\w+)\}", "\\1\N{COMBINING DIAERESIS}", label.replace("$", ""))
    text = re.sub(r"\\dot\{(\\?\w+)\}", "\\1\N{COMBINING DOT ABOVE}", text)
    text = re.sub(r"\\([A-Za-z]+)", lambda match: GREEK.get(match[1], match[1]), text)
    return re.sub(r"_\{([^}]*)\}|_(\w)", lambda match: _lower(match[1] or match[2]), text)


def _lower(subscript: str) -> str:
    """Lowers a subscript, if there is a sign for each of its characters."""
    lowered = subscript.translate(SUBSCRIPTS)
    return f"_{subscript}" if re.search("[A-Za-z]", lowered) else lowered


class PictureError(ValueError):
    """A study cannot be drawn as requested; the message is one sentence."""


@dataclasses.dataclass(frozen=True)
class Rows:
    """Some of the computed rows of a study.

    - ``data``: the data set of all rows.
    - ``places``: the indices of these rows in it.
    - ``indices``: the index of each row along each axis.
    - ``status``: the status of each.
    """

    data: Any
    places: Int[np.ndarray, " rows"]
    indices: Int[np.ndarray, "rows axes"]
    status: Int[np.ndarray, " rows"]

    def __len__(self) -> int:
        return len(self.places)

    @property
    def paths(self) -> tuple[str, ...]:
        """The paths of the numbers that change."""
        return tuple(list_attribute(self.data, "paths"))

    @property
    def failed(self) -> Bool[np.ndarray, " rows"]:
        """Which rows failed."""
        return ~np.isin(self.status, SUCCESSES)

    def axis_of(self, path: str) -> int:
        """Returns the axis along which the number at ``path`` changes.

        **Raises:** :class:`PictureError` when the study changes no such number.
        """
        if path not in self.paths:
            hint = did_you_mean(path, self.paths, f"it changes {', '.join(self.paths)}", "`")
            raise PictureError(f"Path `{path}` must be one of the numbers that the study changes{hint}")
        return int(list_attribute(self.data, "path_axis")[self.paths.index(path)])

    def is_scattered(self, path: str) -> bool:
        """Returns whether the values at ``path`` come from a design or from a file."""
        return bool(list_attribute(self.data, "axis_scattered")[self.axis_of(path)])

    def is_logarithmic(self, path: str) -> bool:
        """Returns whether the values at ``path`` are spaced logarithmically."""
        return bool(list_attribute(self.data, "path_logarithmic")[self.paths.index(path)])

    def number(self, path: str) -> Float[np.ndarray, " rows"]:
        """Returns the number at ``path`` in each row."""
        self.axis_of(path)
        return self.data[path].values[self.places]

    def varying(self) -> list[str]:
        """Lists the paths whose numbers are not the same in all rows."""
        return [path for path in self.paths if np.ptp(self.number(path)) > 0]

    def choose(self, which: Bool[np.ndarray, " rows"] | Int[np.ndarray, " some"]) -> "Rows":
        """Returns the rows that a mask or indices choose."""
        return dataclasses.replace(
            self, places=self.places[which], indices=self.indices[which], status=self.status[which]
        )


def rows_of(data: "xarray.Dataset") -> Rows:
    """Returns the rows that were computed.

    **Raises:** :class:`PictureError` when ``data`` is not of a study, when none of its rows was computed, and when all
    of them failed.
    """
    missing = [name for name in _NEEDED if name not in data.attrs] + [
        name for name in ("row", "status") if name not in data.variables
    ]
    if missing:
        raise PictureError(
            "Argument `data` must be the store of a study, opened by xarray.open_zarr, but it has no "
            f"{', '.join(missing)}."
        )
    row, status = data["row"].values, data["status"].values.astype(int)
    # Rows that were not computed yet have the fill value −1.
    computed = np.flatnonzero(row >= 0)
    if not computed.size:
        raise PictureError("Argument `data` must have a row that was computed, but none of its rows is done yet.")
    status = status[computed]
    if not np.any(np.isin(status, SUCCESSES)):
        counts = ", ".join(f"{np.sum(status == code):,} {Status(code).name}" for code in np.unique(status).tolist())
        raise PictureError(
            f"Argument `data` must have a row that succeeded, but all {len(status):,} that are done failed: {counts}; "
            "see `jaxball sweep status` for what is wrong with the first of them."
        )
    indices = np.stack(np.unravel_index(row[computed], tuple(list_attribute(data, "shape"))), axis=1)
    return Rows(data, computed, indices, status)


def fix_axes(
    rows: Rows, free: set[int], at: Mapping[str, float] | None, labels: Labels = None
) -> tuple[Rows, list[str]]:
    """Fixes each axis that is not in ``free``; returns the rows left, and sentences that say at which point.

    The point is the one whose number is nearest to that in ``at``; by default it is, among the points at which a row
    succeeded, the middle one of an axis, or the first of a scattered axis.

    **Raises:** :class:`PictureError` when ``at`` has a number that the study does not change, or one of a free axis.
    """
    numbers = at or {}
    for path in numbers:
        if rows.axis_of(path) in free:
            raise PictureError(f"Argument `at` must have no number of an axis that is drawn, but it has `{path}`.")
    sentences = []
    for axis in sorted(set(range(rows.indices.shape[1])) - free):
        present = np.unique(rows.indices[:, axis])
        if len(present) == 1:
            continue
        paths = [path for path in rows.paths if rows.axis_of(path) == axis]
        fixed_paths = [path for path in paths if path in numbers]
        if fixed_paths:
            distances = sum(np.abs(rows.number(path) - numbers[path]) for path in fixed_paths)
            point = rows.indices[np.argmin(distances), axis]
        else:
            succeeded = np.unique(rows.indices[~rows.failed, axis])
            candidates = succeeded if succeeded.size else present
            point = candidates[0 if rows.is_scattered(paths[0]) else len(candidates) // 2]
        rows = rows.choose(rows.indices[:, axis] == point)
        if fixed_paths or len(paths) <= FEW_PATHS:
            named = {path: number_label(path, labels, with_unit=False) for path in fixed_paths or paths}
            sentences += [f"{name} = {rows.number(path)[0]:.4g}" for path, name in named.items()]
        else:
            sentences.append(f"point {point} of {number_label(paths[0], labels, with_unit=False)}, …")
    return rows, sentences


def sample(rows: Rows, most: int) -> tuple[Int[np.ndarray, " some"], list[str]]:
    """Returns the indices of up to ``most`` rows, chosen by a generator with a fixed seed, and a sentence that says so.

    There is no sentence if all rows are chosen. Some of the failed rows are always chosen.
    """
    if len(rows) <= most:
        return np.arange(len(rows)), []
    generator, failed = np.random.default_rng(SEED), np.flatnonzero(rows.failed)
    # Failed rows are few, but what a reader looks for: a sample without them would hide them.
    some = generator.choice(failed, min(len(failed), max(1, most // 20)), replace=False)
    others = generator.choice(np.setdiff1d(np.arange(len(rows)), some), most - len(some), replace=False)
    drawn = np.sort(np.concatenate([some, others]))
    return drawn, [f"{len(drawn):,} of {len(rows):,} rows drawn"]


def list_attribute(data: Any, name: str) -> list[Any]:
    """Returns an attribute that is a list; some file formats store a list of one as a number or a text."""
    value = data.attrs[name]
    return [value] if isinstance(value, str) else np.atleast_1d(value).tolist()


def result_names(data: "xarray.Dataset") -> list[str]:
    """Lists the names of all results of a study, first the ones that its key ``find`` lists; vectors by entries, as
    ``z[0]``.
    """
    names = [str(name) for name in data.data_vars if name not in _NOT_RESULTS and "row" in data[name].dims]
    first = [*_finds(data), *_FIRST]
    names.sort(key=lambda name: (first.index(name) if name in first else len(first), name))
    sizes = {name: {axis: size for axis, size in data[name].sizes.items() if axis not in _LEADING} for name in names}
    return [entry for name in names for entry in entries(name, tuple(sizes[name].values()))]


def standard_results(data: "xarray.Dataset") -> list[str]:
    """Lists a few important results: the ones that the key ``find`` lists, or else the friction needed and the final
    position where they exist, and the steps.
    """
    names = [name for name in result_names(data) if name not in ("steps", "rejected", "reached")]
    return [*names[: max(MOST_STANDARD, len(_finds(data)))], "steps"]


def _finds(data: "xarray.Dataset") -> list[str]:
    """Lists the results that the study's key ``find`` lists."""
    return [name for name in list_attribute(data, "finds") if name in data.data_vars] if "finds" in data.attrs else []


def values_of(rows: Rows, result: str) -> Float[np.ndarray, " rows"]:
    """Returns a result of each row, at the last save time if there are several.

    **Raises:** :class:`PictureError` when there is no such result.
    """
    name, index = parse_result(rows.data, result)
    array = rows.data[name]
    if "save" in array.dims:
        array = array.isel(save=-1)
    return array.values[(rows.places, *index)].astype(float)


def tolerance_of(data: "xarray.Dataset") -> float:
    """Returns the absolute tolerance of the solves of a study: a smaller result is an error."""
    solve = tomllib.loads(data.attrs.get("scenario", "")).get("solve", {})
    return float(solve.get("atol", DEFAULT_TOLERANCE))


def histories_of(rows: Rows, result: str) -> Float[np.ndarray, "rows saves"]:
    """Returns a result of each row at all save times; only these rows are read.

    **Raises:** :class:`PictureError` when there is no such result, or when it was not saved at all times.
    """
    name, index = parse_result(rows.data, result)
    array = rows.data[name]
    if "save" not in array.dims:
        saved = [item for item in result_names(rows.data) if "save" in rows.data[parse_result(rows.data, item)[0]].dims]
        choices = ", ".join(saved) or 'none: the study needs `save = "times"`'
        raise PictureError(f"Result `{result}` must be one that was saved at all times, which are {choices}.")
    return array.isel(row=rows.places).values[(slice(None), slice(None), *index)]


def parse_result(data: "xarray.Dataset", result: str) -> tuple[str, tuple[int, ...]]:
    """Returns the variable that a name such as ``z[0]`` stands for, and the index in it.

    **Raises:** :class:`PictureError` when there is no such result.
    """
    names = result_names(data)
    if result not in names:
        hint = did_you_mean(result, names, f"it has {', '.join(names)}", "`")
        raise PictureError(f"Result `{result}` must be one of the study's results{hint}")
    return result.partition("[")[0], tuple(int(k) for k in re.findall(r"\[(\d+)\]", result))


def label_of(data: "xarray.Dataset", result: str, labels: Labels = None, *, at_the_end: bool = True) -> str:
    """Returns the label of a result in a figure, from ``labels``, or with its units."""
    if labels and result in labels:
        return labels[result]
    name, index = parse_result(data, result)
    entry = _KNOWN.get(name)
    words = (entry and entry.words) or name.replace("_", " ")
    if symbol_of(name):
        dimensions = [dimension for dimension in data[name].dims if dimension not in _LEADING]
        indices = [_index(data, str(dimension), k) for dimension, k in zip(dimensions, index, strict=True)]
        words = f"${symbol_of(name)}{'_{' + ','.join(indices) + '}' if indices else ''}$"
        words += " at the end" if at_the_end else ""
    units = data[name].attrs.get("units", "") or (entry.units if entry else "")
    return label_with(words, units)


def _index(data: "xarray.Dataset", dimension: str, k: int) -> str:
    """Returns the index of the paper's symbol: it counts from 1, for a versor from 0; for driven masses it is the
    mass's.
    """
    if dimension == "component":
        return str(k)
    masses = dimension == "driven" and dimension in data.variables and data[dimension].dtype.kind == "i"
    return str(1 + (int(data[dimension][k]) if masses else k))


def sweep_scale(data: "xarray.Dataset", rows: Sequence[int], by: str | None = None) -> ColourScale | None:
    """Returns a number of a study in some of its rows, by which their bodies are coloured.

    **Arguments:**

    - ``data``: the rows of a study, as ``dataset`` of a :func:`jaxball.studies.sweep.open_store` opens them.
    - ``rows``: the numbers of the rows, from 0.
    - ``by``: the path of a number that the study changes, or a result such as ``"z[0]"``, at the end; by default the
      first number that differs between the rows.

    **Returns:** the number by its symbol and unit, as in ``Ω₃(t₀) (rad/time)``; None if no number is given and none
    differs.

    **Raises:** :class:`PictureError` if the study has no number of that name.
    """
    places = np.asarray(rows, dtype=int)
    chosen = Rows(data, places, np.zeros((places.size, 0), dtype=int), data["status"].values[places].astype(int))
    paths = [str(path) for path in list_attribute(data, "paths")]
    if by is None:
        by = next(iter(chosen.varying()), None)
    if by is None:
        return None
    if by in paths:
        return ColourScale(
            in_plain_text(number_label(by, data=data)), chosen.number(by).tolist(), chosen.is_logarithmic(by)
        )
    results = result_names(data)
    if by not in results:
        raise PictureError(
            f"Number `{by}` must be one that the study changes, {', '.join(paths)}, or one of its results, "
            f"{', '.join(results)}."
        )
    return ColourScale(in_plain_text(label_of(data, by)), values_of(chosen, by).tolist())
