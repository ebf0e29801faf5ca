"""What a view of a run under feedback shows besides its body: the motion that is held, the estimate and its ellipse.

Its graphs are those of the deviation from the motion and, from sensors, of the normalised innovations.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...control.estimation.estimate import bounds_of_squares, largest_square
from ...control.history import FeedbackHistory
from ...simulation.trajectory import Trajectory
from ..palette import DASHED, Line
from ..record import columns_by_field, finite_rows
from ..shapes import Setting
from ..surface import contacts_of
from .scene import BLUE, Numbers, continuous, each, graph, of_masses, series

CONFIDENCE = 0.95
GREY = "#8a8a8a"
LETTERS = {
    "attitude": "φ",
    "Omega": "Ω",
    "phi": "φ",
    "phidot": "φ̇",
    "z": "z",
    "theta": "θ",
    "thetadot": "θ̇",
}


def feedback_numbers(
    trajectory: Trajectory[Any, Any], setting: Setting, radius: float, lift: float
) -> dict[str, Numbers]:
    """Returns the pose of the motion, the place of the estimate on the ground, and the two half axes of its ellipse.

    Then the numbers of the graphs. In axes of the page; ``lift`` is how far the centre of a body lies above that of the
    first of all. Where nothing was estimated, at the end, the last estimate goes on.
    """
    history = trajectory.history
    if not isinstance(history, FeedbackHistory):
        return {}
    rows = finite_rows(trajectory)
    nominal = setting.page @ np.asarray(history.nominal.Lambda)[rows]
    held = _lying(trajectory, setting, history.nominal, rows, lift)
    numbers = {
        "nominal_centre": Numbers(held.centres, radius),
        "nominal_quaternion": Numbers(continuous(Rotation.from_matrix(nominal).as_quat()), 1.0),
        "deviation": Numbers(np.asarray(history.deviations(trajectory.state))[rows]),
    }
    if setting.contacts is not None:
        numbers["nominal_normal"] = Numbers(held.normals, 1.0)
    estimate = history.estimate
    if estimate is None:
        return numbers
    estimate_rows = np.flatnonzero(np.isfinite(np.asarray(estimate.covariance)[:, 0, 0]))
    last = np.minimum(rows, estimate_rows[-1])
    there = _lying(trajectory, setting, estimate.state, last, lift)
    planes = columns_by_field(estimate.directions)["z"]
    lower, upper = bounds_of_squares(np.asarray(estimate.read), CONFIDENCE)
    axes = half_axes(np.asarray(estimate.covariance)[last][:, planes][:, :, planes])
    return numbers | {
        "estimate": Numbers(there.centres - radius * there.normals, radius),
        "ellipse": Numbers((axes @ there.axes).reshape(len(rows), -1), radius),
        "innovation": Numbers(np.stack([np.asarray(estimate.nis), upper, lower], axis=1)[rows]),
    }


class Lying(NamedTuple):
    """Bodies at coordinates of the ground, at the times of a run; axes of the page."""

    centres: Float[np.ndarray, "T 3"]
    normals: Float[np.ndarray, "*T 3"]
    axes: Float[np.ndarray, "*T 3 3"]  # the first two rows say where the coordinates lead, the third is normal


def _lying(trajectory: Trajectory[Any, Any], setting: Setting, states: Any, rows: np.ndarray, lift: float) -> Lying:
    z, theta = np.asarray(states.z)[rows], np.asarray(states.theta)[rows]
    if setting.contacts is None:
        # On a plane coordinates are places; a disk has only the first.
        z = z[:, None] if z.ndim == 1 else z
        normal = setting.page[:, 2]
        centres = np.pad(z, ((0, 0), (0, 3 - z.shape[1]))) @ setting.page.T + setting.moved + lift * normal
        return Lying(centres, normal, setting.page.T)
    system, times = trajectory.system, np.asarray(trajectory.times)[finite_rows(trajectory)]
    touched = contacts_of(system.ground, times, z, theta)
    axes = np.concatenate([touched.slopes, touched.normals[:, None]], axis=1)
    return Lying(touched.feet + float(system.radius) * touched.normals, touched.normals, axes)


def feedback_graphs(trajectories: Sequence[Trajectory[Any, Any]]) -> list[dict[str, Any]]:
    """Returns the graphs of one run or two, if any is under feedback."""
    histories = [trajectory.history for trajectory in trajectories if isinstance(trajectory.history, FeedbackHistory)]
    if not histories:
        return []
    groups, lines = columns_by_field(histories[0].directions), []
    for (name, columns), line in zip(groups.items(), of_masses(range(1, len(groups) + 1)), strict=True):
        several = len(columns) > 1
        words = f"|δ{LETTERS[name]}|" if several else f"δ{LETTERS[name]}"
        lines.append(series(words, line.colour, "deviation", columns, several, line.dashes))
    graphs = [graph("Deviation", lines)]
    if all(history.estimate is None for history in histories):
        return graphs
    names, bound = ("νᵀS⁻¹ν", "upper bound", "lower bound"), Line(GREY, DASHED)
    return [*graphs, graph("Innovation, 95 %", each(names, (Line(BLUE), bound, bound), "innovation"))]


def half_axes(covariances: Float[np.ndarray, "T d d"]) -> Float[np.ndarray, "T 2 3"]:
    """Returns the half axes, in space axes, of the ellipses in which places lie with 95 % probability; for a line, one
    is 0.
    """
    size, d = np.sqrt(largest_square(CONFIDENCE, covariances.shape[1])), covariances.shape[1]
    values, vectors = np.linalg.eigh(covariances)
    axes = np.zeros((len(covariances), 2, 3))
    # The square of the distance, in standard deviations, is distributed as χ²; rounding can make an eigenvalue of a
    # singular covariance negative.
    axes[:, :d, :d] = size * np.sqrt(np.maximum(values, 0.0))[:, :, None] * np.swapaxes(vectors, 1, 2)
    return axes
