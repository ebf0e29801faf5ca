"""A disk follows a target that moves there and back, from rest to rest: optimal control by collocation.

It takes a minute or two. As in Putkaradze & Rogers, On the optimal control of rolling ball robots actuated by internal
point masses: four masses on circles, a tracking cost, an acceleration cost, and continuation in the tracking weight.
"""

from pathlib import Path

import jax
import numpy as np

from jaxball import Circle, ConstantRate, Disk, OnRail, PointMass, plot, write_scenario
from jaxball.programs import cpu
from jaxball.studies import design
from jaxball.studies.design import optimal_control

cpu.prepare()
jax.config.update("jax_enable_x64", True)

START, END, PLACE = 0.0, 12.0, 0.5
masses = [PointMass(1.0, OnRail(Circle(r), ConstantRate(-np.pi / 2))) for r in (9 / 10, 19 / 30, 11 / 30, 1 / 10)]
disk = Disk(mass=1.0, inertia=1.0, masses=masses)
there_and_back = design.Through([[0.0, 0.0], [1.0, 0.0], [PLACE, 0.0]])


def problem(weight):
    """From rest to rest at ``PLACE``, with the tracking cost multiplied by ``weight``."""
    tracking = design.FollowTrajectory(there_and_back, rest_to_rest=True, weight=weight)
    effort = design.AccelerationEffort(weight=0.01)
    return optimal_control.Rolling(disk, (START, END), {"tracking": tracking, "effort": effort}, place=PLACE)


rows = []


def visit(solution):
    """Records a point of the branch."""
    means, weight = solution.means(), float(solution.problem.objectives["tracking"].weight)
    rows.append((weight, np.sqrt(means["tracking"]), means["effort"]))
    print("weight {:8.3g}   root mean square error {:.3e} r   effort {:.4f}".format(*rows[-1]))


easy = problem(1e-2).solve(np.linspace(START, END, 21))
branch, hard = easy.continue_to(problem(1e2), visit=visit)
weights, errors, efforts = np.transpose(rows)
print(f"the tracking error falls by a factor of {errors[0] / errors[-1]:.0f} along the branch")
curvature = hard.least_curvature()
print(f"the least curvature of the cost is {curvature:.3g}")

# The schedules are written as a scenario for `jaxball simulate`, and simulated again by a solver of another family.
Path("disk_tracking.toml").write_text(write_scenario(hard.scenario("The disk there and back")))
check = hard.resimulate()
print(f"simulated again, the path is {check.apart:.1e} r away; at the end the disk moves at {check.speed:.1e}, and the")
print(f"centre of mass is {check.below:.4f} r below the geometric centre and {check.away:.1e} r beside it")
print(f"least normal force {check.margin:.3f} M g, friction needed {check.friction:.3f}")
assert errors[0] > 10 * errors[-1]
assert max(check.speed, check.away, check.missed) < 1e-6
assert check.below > 0
assert curvature > 0

times = np.linspace(START, END, 401)
targets = hard.problem.objectives["tracking"].targets(times)[:, 0]
paths = {f"weight {weight:g}": (times, run.places(times)) for weight, run in ((1e-2, easy), (1e2, hard))}
figures = {
    "branch": plot.branch(weights, {"root mean square error": errors, "effort": efforts}, "weight of the tracking"),
    "path": plot.place_in_time(paths, (times, targets)),
    "accelerations": plot.rail_accelerations(times, hard.path.inputs(times)),
}
for name, ax in figures.items():
    plot.caption(ax.figure, disk, "Four masses on circles in a disk, there and back")
    ax.figure.savefig(f"disk_tracking_{name}.png", dpi=200)
