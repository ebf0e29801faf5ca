"""Ends of optimal control that statics alone refuses: m l < (M + m) r sin α, and depths that no mass reaches."""

import numpy as np
import pytest

import jaxball
from jaxball.studies import design
from jaxball.studies.design import optimal_control
from jaxball.studies.design.optimal_control.guess import require_holdable
from tests.design.test_control_on_surfaces import climb, disk, problem
from tests.support.sentences import refuses

BOWL = 6.0
REACH = 0.8 * 0.5 / 1.8  # of the climber: its pendulum has 0.8 of 1.8 at 0.5 r


def on_bowl(sine):
    """An end where the normal leans by arcsin of ``sine``: the centre is on a sphere with the radius R − r."""
    return climb(jaxball.Bowl(BOWL), (0.0, 0.0), [[0.0, 0.0], [sine * (BOWL - 1.0), 0.0]])


def slope(sine):
    return disk(jaxball.Ground(angle=np.arcsin(sine)))


def test_a_flank_that_the_pendulum_can_hold_is_left_to_newton():
    require_holdable(on_bowl(REACH - 0.002))


def test_a_flank_that_nothing_can_hold_is_refused():
    with refuses(design.DesignError, "place", f"{REACH:.3g} r", "0.224 r"):
        on_bowl(REACH + 0.002).solve(np.linspace(0.0, 4.0, 5))


@pytest.mark.parametrize(("sine", "refused"), [(0.49, False), (0.51, True)])
def test_a_disk_on_a_plane(sine, refused):
    """Masses of 1, 1 and 1, of which two are on circles of 0.9 and 0.6: at most 1.5 / 3 of r."""
    system = problem(slope(sine))
    if not refused:
        require_holdable(system)
        return
    with refuses(design.DesignError, "place", "0.5 r", "0.51 r"):
        require_holdable(system)


@pytest.mark.parametrize(("depth", "refused"), [(0.49, False), (-0.51, True)])
def test_a_depth(depth, refused):
    """Above as below, on a level plane."""
    asked = optimal_control.Rolling(disk(None), (0.0, 8.0), {}, place=1.0, depth=depth)
    if not refused:
        require_holdable(asked)
        return
    with refuses(design.DesignError, "depth", "-0.51 r"):
        require_holdable(asked)


def test_a_slope_and_a_depth_together():
    """sin α = 0.3 and 0.45: 0.54 r from the centre."""
    asked = optimal_control.Rolling(slope(0.3), (0.0, 8.0), {}, place=1.0, depth=0.45)
    with refuses(design.DesignError, "depth", "0.3 r", "0.45 r"):
        require_holdable(asked)


def test_without_a_place_on_a_bowl_any_may_do():
    system = climb(jaxball.Bowl(BOWL), (0.0, 0.0), [[0.0, 0.0], [2.0, 0.0]])
    anywhere = optimal_control.Rolling(
        system.robot, (0.0, 4.0), system.objectives, jaxball.BallState(theta=(0.0, 0.0), thetadot=(0.0, 0.0))
    )
    require_holdable(anywhere)
