"""Scenario files of balls on surfaces, with all keys that such a ground has."""

ON_SURFACE = """
format = 1
title = "On a surface"
kind = "ball"
body = { mass = 1.0, radius = 0.1, inertia = [0.004, 0.004, 0.004], gravity = 9.81 }
initial = { z = [0.2, 0.1] }
time = { start = 0.0, end = 0.5, saves = 3 }

[ground]
"""
_TURNS = """
[[ground.motion.turns]]
axis = [0.0, 1.0, 0.5]
angle = { kind = "sinusoids", theta = 0.0, amplitude = [0.1], frequency = [2.0] }

[ground.motion]
pivot = [0.0, 0.0, 0.5]
"""
_TILT = """
kind = "tilting-plane"
about_e1 = { kind = "sinusoids", theta = 0.0, amplitude = [0.1], frequency = [2.0] }
about_e2 = { kind = "constant-rate", theta = 0.1 }
pivot = [0.1, 0.2, 0.0]
"""
_ALONG = """
rail = { kind = "circle", radius = 0.3, frame = { azimuth = 0.1, elevation = 0.2 } }
schedule = { kind = "constant-rate", theta = 0.0, rate = 0.1 }
"""
_SHAKEN = """
free = { constant = [0.0, 0.0, 0.0], amplitude = [[0.2, 0.0, 0.0]], frequency = [1.0], phase = [0.2] }
"""
_DRIVEN = (
    ON_SURFACE.replace("[ground]", "")
    + """
[ground]
kind = "tilting-plane"
accelerated = ["about_e1", "about_e2"]
"""
)
_BALANCED = """
[actuation]
form = "linear"
z = [[0.0, 2.0], [-2.0, 0.0]]
omega = [[-0.5, 0.0, 0.0], [0.0, -0.5, 0.0]]
theta = [[-24.0, 0.0], [0.0, -24.0]]
thetadot = [[-8.0, 0.0], [0.0, -8.0]]
"""
_FOLLOWED = """
about_e1 = { kind = "sinusoids", theta = 0.0, amplitude = [0.1], frequency = [2.0] }
about_e2 = { kind = "constant-rate", theta = 0.1 }

[actuation]
form = "servo"
stiffness = [20.0, 10.0]
damping = [6.0, 3.0]
"""
ON_SURFACES = {
    "in a bowl": ON_SURFACE + 'kind = "bowl"\nradius = 1.0\n' + _TURNS + "[ground.motion.displacement]" + _ALONG,
    "on a sphere": ON_SURFACE + 'kind = "sphere"\nradius = 1.0\n' + "[ground.motion.displacement]" + _SHAKEN,
    "in a pipe": ON_SURFACE
    + 'kind = "cylinder"\nradius = 1.0\naxis = [0.0, 0.0, 1.0]\nstart = [1.0, 0.0, 0.0]\ncentre = [0.0, 0.0, 1.0]\n',
    "outside a pipe": ON_SURFACE + 'kind = "cylinder"\nradius = 1.0\nstart = [0.0, 0.0, 1.0]\noutside = true\n',
    "in an egg": ON_SURFACE
    + 'kind = "signed-distance"\nfunction = "tests.support.signed_distances:inside_ellipsoid"\n'
    + "parameters = [1.0, 1.0, 1.4]\nkink_times = [0.2]\ncentre = [0.0, 0.0, 0.1]\nguess = 1.4\n"
    + _TURNS,
    "on a saddle": ON_SURFACE + 'kind = "paraboloid"\ncurvatures = [0.5, -0.5]\n',
    "on a washboard": ON_SURFACE
    + 'kind = "washboard"\namplitude = 0.1\nwavelength = 4.0\nphase = 0.1\nheading = 0.2\n',
    "on a tilting plane": ON_SURFACE + _TILT + "[ground.displacement]" + _ALONG,
    "on a shaken plane": ON_SURFACE + _TILT + "[ground.displacement]" + _SHAKEN,
    "on a plate that a law tilts": _DRIVEN + _BALANCED,
    "on a plate that follows": _DRIVEN + _FOLLOWED,
}
