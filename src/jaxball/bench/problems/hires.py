"""HIRES, the response of a plant to light of high irradiance: eight reacting substances.

Schäfer, *A new approach to explain the "high irradiance responses" of photomorphogenesis on the basis of phytochrome*
(Journal of Mathematical Biology 2, 1975); Hairer & Wanner, *Solving Ordinary Differential Equations II*, section IV.10,
HIRES.
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
        "Hairer & Wanner II, section IV.10; the end state from Radau collocation in 32 digits with the constants that "
        "float64 holds, to which HIRES of Mazzia & Magherini, Test Set for IVP Solvers, release 2.4 (2008), agrees to "
        "2e-13, and with decimal constants to 3e-16"
    ),
    pieces=(Piece(0.0, 321.8122),),
    initial=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0057),
    rates=rates,
    exact=(
        7.3713125733255412e-4,
        1.4424857263161597e-4,
        5.8887297409673389e-5,
        1.1756513432831255e-3,
        2.3863561988309493e-3,
        6.2389682527415998e-3,
        2.8499983951855010e-3,
        2.8500016048144992e-3,
    ),
    measured=tuple(range(8)),
    relative=True,
    stiff=True,
    atol_over_rtol=1e-4,
)
