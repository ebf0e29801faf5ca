"""Six masses in straight tubes drive a ball round a figure eight, from rest to rest: optimal control by collocation.

It takes a few minutes. Three pairs of tubes are at right angles to one another and away from the centre, so that no two
intersect. Newton's method starts from a guess in which the ball rolls along the path without spin, with its masses
where gravity provides the required torque. From its optimum, continuation leads to a smaller tracking weight.
"""

from pathlib import Path

import jax
import numpy as np

from jaxball import Ball, ConstantRate, OnRail, PointMass, Tube, plot, write_scenario
from jaxball.programs import cpu
from jaxball.studies import design
from jaxball.studies.design import optimal_control

cpu.prepare()
jax.config.update("jax_enable_x64", True)

START, END = 0.0, 60.0
BESIDE, DOWN = 0.3, 0.65
WEIGHTS = (1e1, 3e-4)

# Two tubes along each axis, on either side of the centre. Initially the masses in the vertical tubes are low.
tubes = [Tube(axis, side * np.roll(axis, 1)) for axis in np.eye(3) for side in (BESIDE, -BESIDE)]
places = (0.0, 0.0, 0.0, 0.0, -DOWN, -DOWN)
masses = [PointMass(1.0, OnRail(tube, ConstantRate(place))) for tube, place in zip(tubes, places, strict=True)]
ball = Ball(mass=1.0, inertia=(2 / 3, 2 / 3, 2 / 3), masses=masses)
depth = -sum(places) / float(ball.total_mass)
eight = design.FigureEight(4.0, 2.0)


def problem(weight):
    """Round the figure eight and back to its crossing, with the tracking cost multiplied by ``weight``."""
    objectives = {
        "tracking": design.FollowTrajectory(eight, rest_to_rest=True, weight=weight),
        "effort": design.AccelerationEffort(weight=0.01),
        "near": design.MassesNearCentre(weight=3e-4),
    }
    return optimal_control.Rolling(ball, (START, END), objectives, place=(0.0, 0.0), depth=depth)


rows = []


def visit(solution):
    """Records a point of the branch."""
    means, weight = solution.means(), float(solution.problem.objectives["tracking"].weight)
    rows.append((weight, np.sqrt(means["tracking"]), means["effort"]))
    print("weight {:8.3g}   root mean square error {:.3e} r   effort {:.5f}".format(*rows[-1]), flush=True)


first, mesh = problem(WEIGHTS[0]), np.linspace(START, END, 61)
tight = first.solve(mesh, guess=first.rolling_along(mesh))
_, loose = tight.continue_to(problem(WEIGHTS[1]), tolerance=1e-4, visit=visit)
weights, errors, efforts = np.transpose(rows)
curvature = tight.least_curvature()
print(f"the least curvature of the cost is {curvature:.3g}")

# The schedules are written as a scenario for `jaxball simulate`, and simulated again by a solver of another family.
Path("six_tubes.toml").write_text(write_scenario(tight.scenario("Six masses in tubes, a figure eight")))
check = tight.resimulate()
print(f"simulated again, the path is {check.apart:.1e} r away; at the end the ball moves at {check.speed:.1e}, and the")
print(f"centre of mass is {check.below:.4f} r below the geometric centre and {check.away:.1e} r beside it")
print(f"least normal force {check.margin:.3f} M g, friction needed {check.friction:.3f}")

times = np.linspace(START, END, 601)
theta = np.stack([jax.vmap(schedule)(times) for schedule in tight.schedules()], axis=1)
room = np.sqrt(1 - BESIDE**2)
print(f"the masses move up to {np.max(np.abs(theta)):.3f} r from the middle of their tubes, which end at {room:.3f} r")
assert errors[0] < 1e-3
assert max(check.speed, check.away, check.missed) < 1e-6
assert check.below > 0
assert check.margin > 0
assert curvature > 0
assert np.max(np.abs(theta)) < room

figures = {
    "branch": plot.branch(weights, {"root mean square error": errors, "effort": efforts}, "weight of the tracking"),
    "path": plot.designed_path(loose.places(times), tight.places(times), np.asarray(eight.points(201))),
    "tubes": plot.rail_angles(times, theta),
    "accelerations": plot.rail_accelerations(times, tight.path.inputs(times)),
}
for name, ax in figures.items():
    plot.caption(ax.figure, ball, "Six masses in straight tubes, a figure eight")
    ax.figure.savefig(f"six_tubes_{name}.png", dpi=200)
