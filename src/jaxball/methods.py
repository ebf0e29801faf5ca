"""Methods of a ``Trajectory`` and a ``Scenario`` that need packages built upon them: files, figures, closed loops.

Their classes have the docstrings. They are provided when jaxball is imported, and import those packages when called.
"""

import os

from .interface.provided import provide

TYPE_CHECKING = False  # as in jaxball/__init__.py, which imports this module

if TYPE_CHECKING:
    import pathlib
    from collections.abc import Callable
    from typing import Any

    import matplotlib.figure
    import xarray

    from .control.loop import ClosedLoop
    from .plot.pictures import Picture
    from .plot.view.page import View
    from .scenario.scenario import Scenario
    from .simulation.trajectory import Trajectory


def error_estimate(run: "Trajectory[Any, Any]", of: "Callable[[Trajectory[Any, Any]], Any] | None" = None) -> "Any":
    from .simulation.global_error import estimate_error

    return estimate_error(run, of)


def to_dataset(run: "Trajectory[Any, Any]") -> "xarray.Dataset":
    from . import results

    return results.to_dataset(run)


def save(run: "Trajectory[Any, Any]", path: str | os.PathLike[str]) -> "pathlib.Path":
    from . import results

    return results.save(run, os.fspath(path))


def plot(run: "Trajectory[Any, Any]") -> "matplotlib.figure.Figure":
    from . import plot
    from .classical import LagrangianState
    from .physics.body import AbstractBody

    if isinstance(run.system, AbstractBody):
        return plot.overview(run)
    if isinstance(run.state, LagrangianState):
        return plot.lagrangian_motion(run)
    return plot.classical_motion(run).figure  # pyright: ignore


def view(
    run: "Trajectory[Any, Any]",
    path: str | os.PathLike[str] | None = None,
    *,
    title: str | None = None,
    friction: float | None = None,
    picture: "Picture | None" = None,
    all_times: bool = False,
) -> "View":
    from . import plot

    default_title = "" if run.scenario is None else run.scenario.title
    shown = {"friction": friction, "picture": picture, "all_times": all_times}
    page = plot.View.of(run, default_title if title is None else title, **shown)
    if path is not None:
        page.save(path)
    return page


def closed_loop(scenario: "Scenario") -> "ClosedLoop":
    from .scenario.closed_loop import build_loop

    return build_loop(scenario)


def _simulate_loop(scenario: "Scenario", asks_for_more: bool) -> "Trajectory[Any, Any]":
    from .scenario.closed_loop import simulate_loop

    return simulate_loop(scenario, asks_for_more)


provide("Trajectory", error_estimate, to_dataset, save, plot, view)
provide("Scenario", closed_loop, _simulate_loop)
