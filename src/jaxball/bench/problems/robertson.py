"""Robertson's autocatalytic reaction, as an ODE and with the conservation of mass as an algebraic equation.

Robertson, *The solution of a set of reaction rate equations* (in: Walsh, Numerical Analysis, an Introduction, 1966);
Hairer & Wanner, *Solving Ordinary Differential Equations II*, section IV.10, ROBER.
"""

import dataclasses
from collections.abc import Sequence

from ..problem import Functions, Piece, Problem, Scalar

END = 1e11


def rates(t: Scalar, x: Sequence[Scalar], p: Sequence[Scalar], functions: Functions) -> list[Scalar]:
    """The rates of the concentrations of A, B and C."""
    decay = 0.04 * x[0]
    autocatalysis = 1e4 * x[1] * x[2]
    pairing = 3e7 * x[1] * x[1]
    return [autocatalysis - decay, decay - autocatalysis - pairing, pairing]


def mass_excess(x: Sequence[Scalar]) -> Scalar:
    """What the concentrations sum up to beyond one."""
    return x[0] + x[1] + x[2] - 1.0


ROBERTSON = Problem(
    name="robertson",
    title="Robertson",
    source=(
        "Hairer & Wanner II, section IV.10, ROBER, to t = 1e11; the end state from Radau collocation in 32 digits, "
        "to which ROBER of Mazzia & Magherini, Test Set for IVP Solvers, release 2.4 (2008), agrees to 2e-14"
    ),
    pieces=(Piece(0.0, END),),
    initial=(1.0, 0.0, 0.0),
    rates=rates,
    exact=(2.0833401497012941e-8, 8.3333607703347832e-14, 0.99999997916651517),
    measured=(0, 1, 2),
    relative=True,
    stiff=True,
    atol_over_rtol=1e-8,
)
ROBERTSON_DAE = dataclasses.replace(
    ROBERTSON,
    name="robertson-dae",
    title="Robertson, DAE",
    pieces=(Piece(0.0, END, algebraic=2),),
    constraint=mass_excess,
)
