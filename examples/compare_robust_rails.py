"""Compares rails designed for one ball with rails designed for 64 perturbed balls, on 1,000 other perturbed balls.

They were designed by `jaxball design` from problem_rail_shape.toml and problem_robust_rails.toml.
"""

import tomllib
from pathlib import Path

import jax
import numpy as np

from jaxball.programs import cpu
from jaxball.studies import design

cpu.prepare()
jax.config.update("jax_enable_x64", True)

HERE = Path(__file__).parent
file = design.load_problem(HERE / "problem_robust_rails.toml")
following = file.problem.objectives["follow-curve"]
assert isinstance(following, design.FollowCurve)
largest = {"distance": design.LargestDistance(following.curve)}
perturbations = design.Perturbations(1000, masses=0.02, offset=0.02, seed=1)

print("largest distance from the curve, in radii, over 1,000 balls")
for name in ("designed_rails", "designed_robust_rails"):
    document = tomllib.loads((HERE / f"{name}.toml").read_text(encoding="utf-8"))
    # The unchanged scenario: a design needs a variable, which keeps its value here.
    space = design.DesignSpace(document, [design.Variable(("masses[0].mass",))])
    problem = design.Problem(space, largest, file.problem.constraints)
    results = problem.perturbed(space.start, perturbations)
    middle, most, worst = np.quantile(results.terms[:, 0], [0.5, 0.95, 1.0])
    violation = np.max(results.violations)
    print(f"{name:24} median {middle:.3f}   95 % {most:.3f}   worst {worst:.3f}   largest violation {violation:.1e}")
