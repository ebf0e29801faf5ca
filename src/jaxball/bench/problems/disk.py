"""The paper's disk, section 4: x = (θ, θ̇, φ, φ̇), with the sums over masses as they are printed."""

from collections.abc import Sequence

import numpy as np

from ... import paper
from ...paper import reference
from ...physics.state import DiskState
from ..problem import Form, Functions, Problem, Scalar
from .own_form import own_form
from .pulse import PIECES, push

N = len(paper.DISK_RAIL_RADII)
SIGNS = tuple((-1.0) ** i for i in range(1, N + 1))


def rates(t: Scalar, x: Sequence[Scalar], p: Sequence[Scalar], functions: Functions) -> list[Scalar]:
    """ẋ of ``eq_rdisk_dynamics`` with m_i = r = g = d_2 = 1 and ζ_0 = 0."""
    theta, thetadot, phi, phidot = x[:N], x[N : 2 * N], x[2 * N], x[2 * N + 1]
    u = push(t, p)
    thetaddot = [sign * u for sign in SIGNS]
    s, c = functions.sin(phi), functions.cos(phi)
    # m_0 rests in the centre: K_0 = 0, and it adds m_0 r² to the inertia d_2.
    K, inertia = 0.0, 2.0
    for i, r_i in enumerate(paper.DISK_RAIL_RADII):
        cosine, sine = functions.cos(theta[i]), functions.sin(theta[i])
        # ζ_i and its derivatives along the rail
        zeta1, zeta3 = r_i * cosine, r_i * sine
        v1, v3 = -zeta3 * thetadot[i], zeta1 * thetadot[i]
        a1 = -zeta3 * thetaddot[i] - v3 * thetadot[i]
        a3 = zeta1 * thetaddot[i] + v1 * thetadot[i]
        arm1, arm3 = s + zeta1, c + zeta3
        K = K + (  # eq_K_i
            (1.0 + phidot * phidot) * (zeta3 * s - zeta1 * c)
            + arm3 * (a1 - 2.0 * phidot * v3)
            - arm1 * (a3 + 2.0 * phidot * v1)
        )
        inertia = inertia + (arm1 * arm1 + arm3 * arm3)
    return [*thetadot, *thetaddot, phidot, K / inertia]  # eqmo_chap_disk_4


def form() -> Form:
    """jaxball's own form, with exact θ(t)."""
    return own_form(paper.disk(), DiskState(), lambda end: np.array([*DISK.exact[: 2 * N], end.phi, end.phidot]))


DISK = Problem(
    name="disk",
    title="The paper's disk",
    source="Putkaradze & Rogers (2018), section 4; the 30-digit reference of jaxball.paper.reference",
    pieces=PIECES,
    initial=(*[paper.DISK_THETA] * N, *[0.0] * N, 0.0, 0.0),
    rates=rates,
    exact=tuple(map(float, reference.disk().values[-1])),
    measured=(2 * N, 2 * N + 1),
    relative=False,
    stiff=False,
    atol_over_rtol=1.0,
    form=form,
)
