"""OREGO, the Oregonator: Field and Noyes' model of the Belousov–Zhabotinskii reaction.

Hairer & Wanner, *Solving Ordinary Differential Equations II*, section IV.10, OREGO.
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
        "Hairer & Wanner II, section IV.10; the end state from Radau collocation in 32 digits, to which OREGO of "
        "Mazzia & Magherini, Test Set for IVP Solvers, release 2.4 (2008), agrees to 2e-13"
    ),
    pieces=(Piece(0.0, 360.0),),
    initial=(1.0, 2.0, 3.0),
    rates=rates,
    exact=(1.0008148703185227, 1228.1785215498874, 132.05549428465045),
    measured=(0, 1, 2),
    relative=True,
    stiff=True,
    atol_over_rtol=1.0,
)
