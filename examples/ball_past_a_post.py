"""The paper's ball rolls past a post, from rest to rest: optimal control by collocation. It takes a minute or two.

As in Putkaradze & Rogers, Numerical simulations of a rolling ball robot actuated by internal point masses: three masses
on circles, a tracking cost, an acceleration cost and a penalty around the post. The target path leads straight through
the post. While the ball is at rest, the conditions at the end do not depend on its spin to first order, so they are
softened until the ball moves; then continuation increases the penalty.
"""

from pathlib import Path

import jax
import numpy as np

from jaxball import ConstantRate, OnRail, PointMass, balance, paper, plot, simulate, write_scenario
from jaxball.programs import cpu
from jaxball.simulation import with_angles
from jaxball.studies import design
from jaxball.studies.design import optimal_control

cpu.prepare()
jax.config.update("jax_enable_x64", True)

START, END, PLACE = 0.0, 10.0, (-1.5, 0.0)
POST, RADIUS = (-0.75, 0.0), 0.3
WEIGHTS = (1e-4, 3e-2)

ball = paper.ball()
resting = [PointMass(mass.mass, OnRail(mass.motion.rail, ConstantRate(0.0))) for mass in ball.point_masses]
ball = ball.with_masses(resting)
# Of the solutions with the centre of mass below the centre, the one in which it is lowest.
angles = balance(ball, (0, 1, 2), above=False).solutions
heights = sum(jax.vmap(mass.motion.rail)(angles[:, i])[:, 2] for i, mass in enumerate(ball.point_masses))
ball = with_angles(ball, (0, 1, 2), angles[np.argmin(heights)], START)
depth = -float(simulate(ball, (START, END)).observables.centre_of_mass_space[0, 2])


def problem(place, tracking, avoiding, softness):
    """From rest to rest at ``place``, with the given weights."""
    objectives = {
        "tracking": design.FollowTrajectory(design.Through([[0.0, 0.0], PLACE]), rest_to_rest=True, weight=tracking),
        "effort": design.AccelerationEffort(weight=0.01),
        "post": design.AvoidObstacles([POST], [RADIUS], softness=0.05, weight=avoiding),
    }
    return optimal_control.Rolling(ball, (START, END), objectives, place=place, depth=depth, softness=softness)


times = np.linspace(START, END, 401)
rows = []


def clearance(path):
    """The least distance of the geometric centre from the post's disc, in radii of the ball."""
    return np.min(np.linalg.norm(path - np.asarray(POST), axis=1)) - RADIUS


def visit(solution):
    """Records a point of the branch."""
    means, weight = solution.means(), float(solution.problem.objectives["post"].weight)
    rows.append((weight, means["post"], means["effort"], clearance(solution.places(times))))
    print("weight of the post {:8.3g}   penalty {:.3e}   effort {:.4f}   clearance {:+.4f} r".format(*rows[-1]))


mesh = np.linspace(START, END, 17)
solution = problem((0.0, 0.0), 0.0, 0.0, 1e-2).solve(mesh)
print("at rest")
for step in (problem(PLACE, 0.0, 0.0, 1e-2), problem(PLACE, 0.0, 0.0, 0.0), problem(PLACE, 0.01, WEIGHTS[0], 0.0)):
    branch, solution = solution.continue_to(step, tolerance=1e-4)
    effort = solution.means()["effort"]
    print(f"{len(branch.parameter)} points, {len(branch.folds)} folds, effort {effort:.4f}")
straight = solution
branch, past = straight.continue_to(problem(PLACE, 0.01, WEIGHTS[1], 0.0), tolerance=1e-6, visit=visit)
curvature = past.least_curvature()
print(f"the least curvature of the cost is {curvature:.3g}")

Path("ball_past_a_post.toml").write_text(write_scenario(past.scenario("The ball past a post")))
check = past.resimulate()
print(f"simulated again, the path is {check.apart:.1e} r away; at the end the ball moves at {check.speed:.1e}, and the")
print(f"centre of mass is {check.below:.4f} r below the geometric centre and {check.away:.1e} r beside it")
print(f"least normal force {check.margin:.3f} M g, friction needed {check.friction:.3f}")
assert max(check.speed, check.away, check.missed) < 1e-6
assert check.below > 0
assert curvature > 0
assert clearance(past.places(times)) > 0

weights, penalties, efforts, clearances = np.transpose(rows)
figures = {
    "branch": plot.branch(weights, {"penalty": penalties, "effort": efforts}, "weight of the post"),
    "path": plot.designed_path(
        straight.places(times),
        past.places(times),
        np.array([[0.0, 0.0], PLACE]),
        [(POST, RADIUS)],
    ),
    "accelerations": plot.rail_accelerations(times, past.path.inputs(times)),
}
for name, ax in figures.items():
    plot.caption(ax.figure, ball, "The paper's ball past a post")
    ax.figure.savefig(f"ball_past_a_post_{name}.png", dpi=200)
