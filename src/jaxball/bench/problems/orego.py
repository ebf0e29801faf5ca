"""OREGO, the Oregonator: Field and Noyes' model of the Belousov–Zhabotinskii reaction.

Hairer & Wanner, *Solving Ordinary Differential Equations II*, section IV.10, eq. (10.1).
"""

from collections.abc import Sequence

from ..problem import Functions, Piece, Problem, Scalar


def rates(t: Scalar, x: Sequence[Scalar], p: Sequence[Scalar], functions: Functions) -> list[Scalar]:
    """The rates of the scaled concentrations of HBrO₂, Br⁻ and Ce(IV)."""
    y1, y2, y3 = x
    return [
        77.27 * (y2 + y1 * (1.0 - 8.375e-6 * y1 - y2)),
        (y3 - (1.0 + y1) * y2) / 77.27,
        0.161 * (y1 - y3),
    ]


OREGO = Problem(
    name="orego",
    title="OREGO",
    source=(
        "Mazzia & Magherini, Test Set for IVP Solvers, release 2.4 (2008), problem OREGO: "
        "by RADAU in quadruple precision"
    ),
    pieces=(Piece(0.0, 360.0),),
    initial=(1.0, 2.0, 3.0),
    rates=rates,
    exact=(0.1000814870318523e1, 0.1228178521549917e4, 0.1320554942846706e3),
    measured=(0, 1, 2),
    relative=True,
    stiff=True,
    atol_over_rtol=1.0,
)
