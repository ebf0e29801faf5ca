"""Figures of the estimates of a filter: their errors with bands of their probability, biases and innovations."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import chi2

from ..estimation.estimate import AbstractEstimate
from ..physics.state import PlacedState
from ..simulation.variables import STATE
from .over_time import Series, over_time
from .palette import COMPONENTS, DASH_DOTTED, DASHED, INK, SOLID
from .shown import ShownFigure
from .style import ATTITUDE, WIDE_FIGURE, label_axes

ESTIMATE_PANEL_HEIGHT = 1.5  # the height of a panel, inches
BAND_OPACITY = 0.15
LOOKS = [(colour, dashes) for dashes in (SOLID, DASHED, DASH_DOTTED) for colour in COMPONENTS]


def estimate(estimate: AbstractEstimate, truth: PlacedState | None = None, confidence: float = 0.95) -> Figure:
    """Draws errors of an estimate over time, the biases of sensors, and in the last panels normalised squares.

    Bands show where errors, and around their estimates biases, lie with this probability if the filter is right; where
    the truth is known, lines show the errors. The normalised squares of innovations, and of errors where the truth is
    known, lie between the dashed lines with the same probability.

    **Arguments:**

    - ``estimate``: what a filter or a smoother has found, also in a closed loop.
    - ``truth``: the states at the samples, as a simulation has them.
    - ``confidence``: the probability.

    **Raises:** as :meth:`jaxball.estimation.AbstractEstimate.errors`; ``ValueError`` for a probability that is not
    between 0 and 1.
    """
    if not 0 < confidence < 1:
        raise ValueError(f"Argument `confidence` must be between 0 and 1, but it is {confidence}.")
    names = (*estimate.directions, *estimate.biases)
    errors = None if truth is None else np.asarray(estimate.errors(truth))
    groups = _groups(names)
    squares = [(r"$\nu^\top S^{-1}\nu$", np.asarray(estimate.nis), np.asarray(estimate.read))]
    if truth is not None:
        nees = np.asarray(estimate.nees(truth)), np.asarray(estimate.uncertain)
        squares.insert(0, (r"$\xi^\top P^{-1}\xi$", *nees))
    count = len(groups) + len(squares)
    figure = ShownFigure(figsize=(WIDE_FIGURE[0], ESTIMATE_PANEL_HEIGHT * count), layout="constrained")
    panels = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    width = float(np.sqrt(chi2.ppf(confidence, 1)))
    for ax, (group, places) in zip(panels, groups.items(), strict=False):
        _draw_errors(ax, estimate, group, places, errors, width)
    for ax, square in zip(panels[len(groups) :], squares, strict=True):
        _draw_squares(ax, np.asarray(estimate.times), *square, confidence)
    for ax in panels[:-1]:
        ax.label_outer()
    return figure


def _groups(names: Sequence[str]) -> dict[str, list[int]]:
    """Returns the places of the numbers of each field, by its name."""
    groups: dict[str, list[int]] = {}
    for place, name in enumerate(names):
        groups.setdefault(name.partition("[")[0], []).append(place)
    return groups


def _draw_errors(
    ax: Axes,
    estimate: AbstractEstimate,
    group: str,
    places: Sequence[int],
    errors: Float[np.ndarray, "K directions"] | None,
    width: float,
) -> None:
    times, names = np.asarray(estimate.times), (*estimate.directions, *estimate.biases)
    symbol = ATTITUDE if group == "attitude" else STATE[group].symbol if group in STATE else ""
    symbol = rf"\delta {symbol}" if symbol else rf"\mathrm{{{group.replace('_', ' ')}}}"
    series = []
    for k, place in enumerate(places):
        name, (colour, dashes) = names[place], LOOKS[k % len(LOOKS)]
        values, centre = np.full_like(times, np.nan), 0.0
        if name in estimate.bias:
            values = centre = np.asarray(estimate.bias[name])
        elif errors is not None:
            values = errors[:, place]
        deviation = width * np.asarray(estimate.deviations[name])
        ax.fill_between(times, centre - deviation, centre + deviation, color=colour, alpha=BAND_OPACITY, linewidth=0)
        label = f"${symbol}_{{{k + 1}}}$" if len(places) > 1 else ""
        series.append(Series(values, label, colour, dashes))
    over_time(None, times, series, f"${symbol}$", ax)


def _draw_squares(
    ax: Axes,
    times: Float[np.ndarray, " K"],
    name: str,
    squares: Float[np.ndarray, " K"],
    degrees: Int[np.ndarray, " K"],
    confidence: float,
) -> None:
    """Draws numbers that are distributed as χ² with a number of degrees of freedom, and their bounds."""
    tails = (1 - confidence) / 2, (1 + confidence) / 2
    bounds = [np.where(degrees > 0, chi2.ppf(p, np.maximum(degrees, 1)), np.nan) for p in tails]
    lines = [Series(squares, "", COMPONENTS[0]), *(Series(bound, "", INK, DASHED) for bound in bounds)]
    over_time(None, times, lines, name, ax)
    label_axes(ax, "$t$", name)
