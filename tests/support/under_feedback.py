"""Documents with every key of feedback and of an estimator."""

import re

UNDER_FEEDBACK = """
format = 1
title = "A disk that holds its place by what its sensors read"
kind = "disk"
body = { mass = 1.0, inertia = 0.5, radius = 1.0, gravity = 2.0 }

[[mechanisms]]
joints = [{ kind = "hinge", axis = [0.0, 1.0, 0.0], force = { kind = "motor", signal = 0.0 } }]
masses = [{ mass = 0.5, place = [0.0, 0.0, -0.6] }]

[sensors.camera]
kind = "position"
errors = { noise = 0.01, missing = 0.2 }

[sensors.gyro]
kind = "gyroscope"
errors = { noise = 0.02, bias = [0.05], random_walk = 0.01 }

[feedback]
kind = "tvlqr"
Q = { phi = 1.0, theta = 1.0 }
R = 1.0
Qf = 1.0
inputs = ["mechanisms[0].joints[0]"]
limits = { "mechanisms[0].joints[0]" = 0.5 }
delay = 1
start = { phi = 0.2, z = -0.2 }
pushes = [{ force = [0.2, 0.0, 0.0], start = 0.21, duration = 0.1, torque = [0.0, 0.1, 0.0] }]
model = { "body.mass" = 0.9 }

[estimator]
spread = { phi = 0.2, z = 0.2, thetadot = 0.1 }
process = { phidot = 0.05 }
biases = { gyro = 0.1 }
sensors = ["camera", "gyro"]

[time]
start = 0.0
end = 1.0
step = 0.05
"""

OF_STATE = re.sub(r"\n\[estimator\].*(?=\n\[time\])", "", UNDER_FEEDBACK, flags=re.DOTALL)
PREDICTIVE = OF_STATE.replace('"tvlqr"', '"mpc"\nhorizon = 4\nfriction = 0.3\npenalty = 100.0')
FEEDFORWARD = re.sub(r'"tvlqr"\nQ = .*\nR = .*\nQf = .*', '"feedforward"', OF_STATE)
