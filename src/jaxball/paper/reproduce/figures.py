"""The figures of sections 4 and 5, each in a file named after the paper's label of the figure."""

from pathlib import Path

import numpy as np

from ... import paper, plot
from ...plot.report import write_figure
from ...simulation.simulate import simulate
from .experiments import Experiment

TIMES = 2001
TITLES = {"disk": "The paper's disk, section 4", "ball": "The paper's ball, section 5"}

FIGURES = {
    "disk": {
        "fig_abs_ui": plot.acceleration,
        "fig_disk_masses_rails_bf_gc": plot.configuration,
        "fig_disk_cm_time_bf_gc": plot.body_paths,
        "fig_disk_cm_time_spatial_gc": plot.space_paths,
        "fig_disk_dot_angle": plot.angular_velocity,
        "fig_disk_gc": plot.centre_path,
    },
    "ball": {
        "fig_ball_masses_rail_bf_gc": plot.configuration,
        "fig_ball_cm_bf_gc": plot.body_paths,
        "fig_ball_cm_spatial_gc": plot.space_paths,
        "fig_ball_Omega": plot.angular_velocity,
        "fig_ball_gc_path": plot.centre_path,
    },
}

# Quantities that the paper does not draw.
ADDITIONAL = {
    "energies": plot.energies,
    "power": plot.power,
    "contact_force": plot.contact_force,
    "friction_ratio": plot.friction_ratio,
}


def draw(experiment: Experiment, folder: Path) -> list[Path]:
    """Writes the figures of ``experiment`` as PNG into ``folder``, and returns their paths.

    **Raises:** :class:`~jaxball.SolveError` when the solve fails.
    """
    times = np.linspace(paper.START, paper.END, TIMES)
    tolerance = experiment.tolerance
    trajectory = simulate(experiment.system, times, rtol=tolerance, atol=tolerance, throw=True)
    functions = FIGURES[experiment.name] | {f"{experiment.name}_{name}": f for name, f in ADDITIONAL.items()}
    paths = []
    for name, function in functions.items():
        paths.append(folder / f"{name}.png")
        write_figure(function(trajectory), paths[-1], trajectory.system, TITLES[experiment.name])
    return paths
