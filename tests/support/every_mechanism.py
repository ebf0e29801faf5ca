"""A scenario with every joint but prescribed ones, every force, a ground, resistance, a linear law and sensors."""

import jax.numpy as jnp

import jaxball


def wind(t, motion, parameters):
    """A force and a torque of a function that a file names."""
    velocity = parameters["velocity"] - motion.velocity
    return jaxball.Wrench(parameters["drag"] * velocity, -parameters["spin"] * jnp.cos(t) * motion.omega)


EVERY_MECHANISM = """
format = 1
title = "Every joint, force, ground and resistance"
kind = "ball"

[body]
mass = 1.0
radius = 2.0
inertia = [0.9, 1.0, 1.1]
gravity = 1.0

[force]
function = "tests.support.every_mechanism:wind"
parameters = { drag = 0.02, spin = 0.01, velocity = [0.3, 0.1, 0.0] }
kink_times = [1.0]

[ground]
angle = 0.1
heading = 0.5
turntable = { turning = { kind = "constant-rate", theta = 0.0, rate = 0.3 }, centre = [1.0, 0.5] }
belt = { travel = { kind = "constant-rate", theta = 0.0, rate = 0.2 }, heading = 0.1 }

[ground.motion]
rail = { kind = "circle", radius = 3.0, frame = { azimuth = 0.1, elevation = 0.2 } }
schedule = { kind = "sinusoids", theta = 0.0, amplitude = [0.1], frequency = [1.0] }

[resistance]
rolling = 0.01
spinning = 0.02
drag = 0.03
rotational_drag = 0.04
dry = 0.01
smoothing = 0.01
negative = true

[[masses]]
mass = 0.2
rail = { kind = "circle", radius = 0.9 }

[[masses]]
mass = 0.2
free = { constant = [0.0, 0.0, 0.3], powers = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0]] }

[[mechanisms]]

[[mechanisms.joints]]
kind = "hinge"
axis = [0.0, 1.0, 0.0]
point = [0.0, 0.0, 0.2]
force = { kind = "damper", coefficient = 0.1 }

[[mechanisms.joints]]
kind = "slider"
axis = [1.0, 0.0, 0.0]
on = 0
force = [
  { kind = "motor", signal = 0.1, limit = 0.5 },
  { kind = "motor", signal = { kind = "steps", times = [0.0, 1.0, 2.0], values = [0.1, -0.1] } },
  { kind = "spring", stiffness = 2.0, rest = 0.1 },
  { kind = "damper", coefficient = -0.01, negative = true },
  { kind = "end-stops", lower = -0.3, upper = 0.3, stiffness = 50.0, damping = 0.5 },
  { kind = "joint-friction", kinetic = 0.01, static = 0.02, stribeck = 0.1, smoothing = 0.1 },
  { kind = "joint-friction", kinetic = 0.0, static = 0.01, viscous = 0.01, exponent = 1, stribeck = 1, smoothing = 1 },
  { kind = "majd-simaan-friction", viscous = 0.01, kinetic = 0.01, peak = 0.01, rate = 0.1, steepness = 4.0 },
]

[[mechanisms.joints]]
kind = "carriage"
rail = { kind = "circle", radius = 0.2, centre = [0.1, 0.0, 0.0], frame = { versor = [1.0, 0.1, 0.0, 0.0] } }

[mechanisms.joints.force]
kind = "pd-servo"
target = { kind = "constant-rate", theta = 0.2 }
stiffness = 1.0
damping = 0.1
limit = 2.0

[[mechanisms.masses]]
mass = 0.1
place = [0.0, 0.0, -0.5]
joint = 0

[[mechanisms.masses]]
mass = 0.2
place = [0.1, 0.0, -0.4]
joint = 1

[[mechanisms.masses]]
mass = 0.1

[[mechanisms]]

[[mechanisms.joints]]
kind = "hinge"
axis = [1.0, 0.0, 0.0]
accelerated = true

[[mechanisms.joints]]
kind = "hinge"
axis = [0.0, 0.0, 1.0]

[mechanisms.joints.force]
kind = "speed-limited-motor"
command = { kind = "piecewise", times = [0.0, 1.0, 2.0], values = [[0.1, 0.2], [0.3, 0.0]] }
stall = 0.3
free_speed = 2.0

[[mechanisms.masses]]
mass = 0.1
place = [0.3, 0.2, -0.2]

[actuation]
form = "linear"
theta = [[-4.0, 0.0, 0.0, 0.0, 0.1, 0.0], [0.0, 0.0, 0.0, 0.0, -3.0, 0.0]]
thetadot = [[-1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, -1.0, 0.0]]
Omega = [[0.0, 0.1, 0.0], [0.1, 0.0, 0.0]]
Gamma = [[0.0, 0.1, 0.0], [0.1, 0.0, 0.0]]
z = [[0.01, 0.0], [0.0, 0.01]]
signals = [0.1, { kind = "sinusoids", theta = 0.0, amplitude = [0.2], frequency = [2.0] }]

[initial]
Omega = [0.0, 0.1, 0.0]
theta = [0.4, 0.1, 0.0, 0.1, 0.2, 0.3]
thetadot = [0.0, 0.0, 0.1, 0.0, 0.0, 0.0]

[sensors.felt]
kind = "accelerometer"
at = [0.1, 0.0, 0.2]
on = "mechanisms[0].joints[1]"
frame = { matrix = [[0, -1, 0], [1, 0, 0], [0, 0, 1]] }

[sensors.turned]
kind = "gyroscope"
on = "masses[0]"
frame = { versor = [1.0, 0.2, 0.0, 0.0] }

[sensors.angle]
kind = "encoder"
on = "mechanisms[1].joints[0]"

[sensors.rate]
kind = "tachometer"
on = "masses[0]"

[sensors.seen]
kind = "position"
at = [0.0, 0.1, 0.2]

[sensors.seen.errors]
noise = 0.01
bias = [0.1, 0.0, 0.2]
random_walk = 0.02
rate = 1.0
delay = 0.5
missing = 0.1
seed = 3

[time]
start = 0.0
end = 2.0
step = 0.5
"""
