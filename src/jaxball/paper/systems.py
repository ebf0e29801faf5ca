"""The two systems whose motion Putkaradze & Rogers (2018) compute: section 4's disk and section 5's ball.

Every number is the paper's; masses, radii and gravity are scaled so that m = r = g = 1.
"""

import math

from ..physics.body import Ball, Disk
from ..physics.dynamics.parameters import PointMass
from ..physics.prescribed.frames import SphericalFrame
from ..physics.prescribed.motion import OnRail
from ..physics.prescribed.rails import Circle
from ..physics.prescribed.schedules import Pulse

# Both sections run from a = 0 to b = 20.
PAPER_START, PAPER_END = 0.0, 20.0

# Tolerances supplied to every integrator, relative and absolute: section 4 and section 5.
DISK_TOLERANCE = 1e-12
BALL_TOLERANCE = 1e-10

# Section 4, fig_disk_masses_rails_bf_gc: r_1 … r_4 = .9, .63̅, .36̅, .1.
DISK_RAIL_RADII = (9 / 10, 19 / 30, 11 / 30, 1 / 10)
# table_disk_ICs: θ_a of all four masses.
DISK_THETA = -math.pi / 2

# Section 5, fig_ball_masses_rail_bf_gc: r_1, r_2, r_3.
BALL_RAIL_RADII = (0.95, 0.9, 0.85)
# Section 5: azimuth and elevation of v_1, v_2, v_3.
BALL_RAIL_DIRECTIONS = ((0.0, 0.0), (math.pi / 2, 0.0), (math.pi / 4, math.pi / 4))
# table_ball_ICs: θ_a, rounded to four digits as printed.
BALL_THETA = (0.0, 2.0369, 0.7044)


def disk() -> Disk:
    """Builds the disk of section 4 with four masses on concentric circles, pushed by ``eq_prescribed_u_disk``.

    It starts at rest at the origin (``eq_disk_initial_conds_spec``), the default state.

    **Example:**

    >>> from jaxball import paper
    >>> disk = paper.disk()
    >>> disk.n_masses, float(disk.total_mass)
    (4, 5.0)
    """
    return Disk(
        mass=1.0,  # m_0
        inertia=1.0,  # d_2
        radius=1.0,
        offset=(0.0, 0.0, 0.0),  # ζ_0
        gravity=1.0,
        masses=[
            PointMass(1.0, OnRail(Circle(radius=r_i), Pulse(theta=DISK_THETA, height=(-1.0) ** i)))
            for i, r_i in enumerate(DISK_RAIL_RADII, start=1)
        ],
    )


def ball() -> Ball:
    """Builds the ball of section 5 with three masses on circles, pushed by ``eq_prescribed_u_ball``.

    It starts at rest at the origin (``eq_ball_initial_conds_spec``), the default state.

    **Example:**

    >>> from jaxball import paper
    >>> float(paper.ball().total_mass)
    4.0
    """
    rails = zip(BALL_RAIL_RADII, BALL_RAIL_DIRECTIONS, BALL_THETA, strict=True)
    return Ball(
        mass=1.0,  # m_0
        inertia=(0.9, 1.0, 1.1),  # d_1, d_2, d_3
        radius=1.0,
        offset=(0.0, 0.0, -0.05),  # ζ_0
        gravity=1.0,
        masses=[
            PointMass(1.0, OnRail(Circle(radius=r_i, frame=SphericalFrame(*v_i)), Pulse(theta=theta_i)))
            for r_i, v_i, theta_i in rails
        ],
    )
