"""Six magnets in straight tubes lead a ball round a designed figure eight, and hold it there when it is pushed.

It takes some minutes, most of them for the design: that of `six_tubes.py`, with its tight tracking alone. The regulator
along it sets the accelerations of all six masses ten times in a unit of time. Then the ball is pushed twice, and drifts
away without feedback; with it, it comes back, whether the regulator is told the state or has to estimate it from a
camera, a gyroscope and the places of the masses.
"""

import dataclasses

import jax
import numpy as np

from jaxball import Ball, ConstantRate, OnRail, PointMass, Tube, plot, save
from jaxball.control import Push
from jaxball.files.scenario import EstimatorSettings, RegulatorSettings
from jaxball.files.scenario.closed_loop import feedback_along, loop_along, nominal_run, with_estimator
from jaxball.physics.sensors import Encoder, Gyroscope, Position, SensorErrors
from jaxball.programs import cpu
from jaxball.studies import design
from jaxball.studies.design import optimal_control

cpu.prepare()
jax.config.update("jax_enable_x64", True)

END, SAMPLE, BESIDE, DOWN = 60.0, 0.1, 0.3, 0.65

# The design: two tubes along each axis, on either side of the centre.
tubes = [Tube(axis, side * np.roll(axis, 1)) for axis in np.eye(3) for side in (BESIDE, -BESIDE)]
places = (0.0, 0.0, 0.0, 0.0, -DOWN, -DOWN)
masses = [PointMass(1.0, OnRail(tube, ConstantRate(place))) for tube, place in zip(tubes, places, strict=True)]
ball = Ball(mass=1.0, inertia=(2 / 3, 2 / 3, 2 / 3), masses=masses)
eight = design.FigureEight(4.0, 2.0)
objectives = {
    "tracking": design.FollowTrajectory(eight, rest_to_rest=True, weight=10.0),
    "effort": design.AccelerationEffort(weight=0.01),
    "near": design.MassesNearCentre(weight=3e-4),
}
depth = -sum(places) / float(ball.total_mass)
problem = optimal_control.Rolling(ball, (0.0, END), objectives, place=(0.0, 0.0), depth=depth)
mesh = np.linspace(0.0, END, 61)
found = problem.solve(mesh, guess=problem.rolling_along(mesh))
designed = found.scenario("Six magnets in tubes, a figure eight that is held")

# Its feedback, pushes and sensors, as they could stand in a scenario file.
pushes = (Push((0.15, 0.1, 0.0), start=12.0, duration=1.0), Push((0.0, -0.2, 0.0), start=35.0, duration=1.0))
noise = SensorErrors(noise=0.01)
sensors = {f"place_{k}": Encoder(f"masses[{k}]", errors=SensorErrors(noise=0.002)) for k in range(6)}
sensors |= {"camera": Position(errors=noise), "gyro": Gyroscope(errors=noise)}
held = dataclasses.replace(
    designed,
    times=np.linspace(0.0, END, round(END / SAMPLE) + 1),
    solver="dopri8",
    rtol=1e-8,
    atol=1e-8,
    sensors=sensors,
    feedback=RegulatorSettings(Q={"z": 1.0, "attitude": 0.3, "Omega": 1.0, "theta": 0.1}, R=1.0, pushes=pushes),
    estimator=EstimatorSettings(spread={"attitude": 0.02, "Omega": 0.01, "z": 0.02}, process={"Omega": 0.02}),
)
feedback = feedback_along(held, nominal_run(held).raise_if_failed())
loops = {
    "without feedback": loop_along(held, feedback.feedforward()),
    "with feedback": loop_along(held, feedback),
    "from sensors": loop_along(held, with_estimator(held, feedback)),
}

missed = {}
for name, loop in loops.items():
    away = np.linalg.norm(np.asarray(loop.states.z - loop.feedback.nominal.states.z), axis=1)
    reach, N = np.max(np.abs(loop.states.theta)), np.min(loop.run.observables.normal_force)
    missed[name] = away[-1]
    print(f"{name:<17} up to {np.max(away):.3f} r from the eight, {away[-1]:.4f} r at the end;", end=" ")
    print(f"masses within {reach:.2f} r, least N {N:.2f}")
assert missed["without feedback"] > 10 * missed["with feedback"]
assert missed["without feedback"] > 4 * missed["from sensors"]

run = loops["from sensors"].run.set_scenario(held)
save(run, "figure_eight_held.nc")
run.view("figure_eight_held.html")
figures = {"paths": plot.held_paths(loops), "inputs": plot.held_inputs({"with feedback": loops["with feedback"]})}
for name, ax in figures.items():
    plot.caption(ax.figure, ball, held.title)
    ax.figure.savefig(f"figure_eight_held_{name}.png", dpi=150)
