"""Figures of phase space: points of Poincaré maps, and eigenvalues of steady motions."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from ..stability import SteadyMotion
from .style import COMPONENTS, INK, SQUARE, legend_above, named, plane_axes

_SYMBOLS = {
    "Omega": r"\Omega",
    "Gamma": r"\Gamma",
    "phi": r"\phi",
    "phidot": r"\dot{\phi}",
    "theta": r"\theta",
    "thetadot": r"\dot{\theta}",
    "xdot": r"\dot{x}",
    "ydot": r"\dot{y}",
    "multiplier": r"\lambda",
}


def poincare_section(
    across: Float[np.ndarray, " n"], up: Float[np.ndarray, " n"], names: tuple[str, str], ax: Axes | None = None
) -> Axes:
    """The crossings of a section, by two components of the states there.

    **Arguments:**

    - ``across``, ``up``: the components, one entry for each crossing, shape (n,).
    - ``names``: their paths in a state, counted from 0, as ``Omega[0]``; the labels have the paper's symbols, which
      count from 1.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax, SQUARE)
    ax.plot(across, up, color=INK, marker=".", linestyle="none", ms=2.5, mew=0)
    named(ax, *map(symbol, names))
    return ax


def symbol(path: str) -> str:
    """The paper's symbol of a component: Ω₁ of ``Omega[0]``."""
    name, _, index = path.removesuffix("]").partition("[")
    below = ""
    if index:
        below = f"_{{{int(index) if name == 'q' else int(index) + 1}}}"
    return f"${_SYMBOLS.get(name, name)}{below}$"


def eigenvalues(motions: Sequence[SteadyMotion], ax: Axes | None = None) -> Axes:
    """The eigenvalues of steady motions in the complex plane: stable ones in one colour, unstable ones in another.

    **Arguments:**

    - ``motions``: what :mod:`jaxball.stability` finds.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax, SQUARE)
    ax.axvline(0.0, color="0.75", linewidth=0.6, zorder=0)
    ax.axhline(0.0, color="0.75", linewidth=0.6, zorder=0)
    for stable, label, marker, colour in (
        (True, "stable", "o", COMPONENTS[0]),
        (False, "unstable", "x", COMPONENTS[1]),
    ):
        values = [motion.eigenvalues for motion in motions if motion.stable == stable]
        if values:
            places = np.concatenate(values)
            ax.plot(
                np.real(places),
                np.imag(places),
                marker=marker,
                ms=5,
                linestyle="none",
                color=colour,
                label=label,
                mfc="none",
            )
    named(ax, r"$\mathrm{Re}\,\lambda$", r"$\mathrm{Im}\,\lambda$")
    legend_above(ax)
    return ax
