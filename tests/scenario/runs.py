"""Runs of the built-in scenarios whose bodies roll all the time."""

import numpy as np

from jaxball import load_scenario


def rolling_run(name):
    """A run with its times and observables: its ground presses at all times, and its masses stay in the shell."""
    trajectory = load_scenario(name).simulate(throw=True)
    seen = trajectory.observables
    assert np.all(np.asarray(seen.normal_force) > 0), name
    assert np.all(np.isfinite(seen.friction_ratio)), name
    distance = np.linalg.norm(seen.mass_positions_body, axis=-1)
    assert np.all(distance < float(trajectory.system.radius)), name
    return trajectory, np.asarray(trajectory.times), seen
