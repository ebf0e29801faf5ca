"""HIRES, the response of a plant to light of high irradiance: eight reacting substances.

Schäfer, *A new approach to explain the "high irradiance responses" of photomorphogenesis on the basis of phytochrome*
(Journal of Mathematical Biology 2, 1975); Hairer & Wanner, *Solving Ordinary Differential Equations II*, section IV.10,
eq. (10.4).
"""

from collections.abc import Sequence

from ..problem import Functions, Piece, Problem, Scalar


def rates(t: Scalar, x: Sequence[Scalar], p: Sequence[Scalar], functions: Functions) -> list[Scalar]:
    """The rates of the eight concentrations."""
    y1, y2, y3, y4, y5, y6, y7, y8 = x
    binding = 280.0 * y6 * y8 - 1.81 * y7
    return [
        -1.71 * y1 + 0.43 * y2 + 8.32 * y3 + 0.0007,
        1.71 * y1 - 8.75 * y2,
        -10.03 * y3 + 0.43 * y4 + 0.035 * y5,
        8.32 * y2 + 1.71 * y3 - 1.12 * y4,
        -1.745 * y5 + 0.43 * y6 + 0.43 * y7,
        -280.0 * y6 * y8 + 0.69 * y4 + 1.71 * y5 - 0.43 * y6 + 0.69 * y7,
        binding,
        -binding,
    ]


HIRES = Problem(
    name="hires",
    title="HIRES",
    source=(
        "Mazzia & Magherini, Test Set for IVP Solvers, release 2.4 (2008), problem HIRES: "
        "by RADAU5 in true double precision on a Cray C90"
    ),
    pieces=(Piece(0.0, 321.8122),),
    initial=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0057),
    rates=rates,
    exact=(
        0.7371312573325668e-3,
        0.1442485726316185e-3,
        0.5888729740967575e-4,
        0.1175651343283149e-2,
        0.2386356198831331e-2,
        0.6238968252742796e-2,
        0.2849998395185769e-2,
        0.2850001604814231e-2,
    ),
    measured=tuple(range(8)),
    relative=True,
    stiff=True,
    atol_over_rtol=1e-4,
)
