"""The solvers that the authors name, the counterpart of each here, and the times that they report."""

from collections.abc import Mapping
from typing import NamedTuple

import diffrax

from ... import solvers


class Counterpart(NamedTuple):
    """A solver with the same method as one of the authors' solvers. ``name``: how it is made."""

    name: str
    solver: diffrax.AbstractAdaptiveSolver


# Sections 4 and 5, in their order: MATLAB R2017b, and radau5 by Hairer & Wanner in Fortran.
ODE = {
    "ode45": Counterpart("Dopri5()", diffrax.Dopri5()),
    "ode113": Counterpart("Adams()", solvers.Adams()),
    "ode15s": Counterpart("NDF()", solvers.NDF()),
    "ode23t": Counterpart("Trapezoidal()", solvers.Trapezoidal()),
    "ode23tb": Counterpart("TRBDF2()", solvers.TRBDF2()),
    "radau5": Counterpart("RadauIIA()", solvers.RadauIIA()),
}
# Section 5 only, `rolling_ball_dae_g`.
DAE = {name: ODE[name] for name in ("ode15s", "ode23t", "radau5")}

# In seconds, to t = 20. All six exist for the ball, and ode45, ode113 and ode23tb solve only the ODE.
TIMES: Mapping[str, Mapping[str, float]] = {
    "disk": {"ode45": 0.23, "ode113": 0.06, "ode15s": 0.30, "ode23t": 5.01, "ode23tb": 7.18, "radau5": 0.27},
    "ball": {"ode45": 0.25, "ode113": 0.10, "ode15s": 0.25, "ode23t": 2.19, "ode23tb": 3.72, "radau5": 0.41},
}
SOURCE_OF_TIMES = (
    "a comment in the LaTeX source of section 4, which is not printed; MATLAB R2017b and, for radau5, Fortran, on a "
    "machine that is not named"
)
