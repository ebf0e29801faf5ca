"""Van der Pol's relaxation oscillation, in its original time and in a time in which the period is of order one.

Hairer & Wanner, *Solving Ordinary Differential Equations II*, section IV.10, VDPOL. Both describe the same motion:
z̈ = μ (1 − z²) ż − z with μ = 1000 becomes ε y₂' = (1 − y₁²) y₂ − y₁ with ε = 1/μ² = 1e-6 in the time t/μ. The rate
1/ε is often called μ = 1e6. For a solver they differ in the magnitudes of t and of the second component.
"""

from collections.abc import Sequence

from ..problem import Functions, Piece, Problem, Scalar

MU = 1e3
SOURCE = (
    "Hairer & Wanner II, section IV.10, VDPOL; the end state from Radau collocation in 32 digits, to which {} of "
    "Mazzia & Magherini, Test Set for IVP Solvers, release 2.4 (2008), agrees to {}"
)


def rates(t: Scalar, x: Sequence[Scalar], p: Sequence[Scalar], functions: Functions) -> list[Scalar]:
    """ż and z̈ = μ (1 − z²) ż − z."""
    return [x[1], MU * (1.0 - x[0] * x[0]) * x[1] - x[0]]


def scaled_rates(t: Scalar, x: Sequence[Scalar], p: Sequence[Scalar], functions: Functions) -> list[Scalar]:
    """y₁' = y₂ and y₂' = ((1 − y₁²) y₂ − y₁) / ε."""
    return [x[1], MU * MU * ((1.0 - x[0] * x[0]) * x[1] - x[0])]


VAN_DER_POL = Problem(
    name="van-der-pol",
    title="Van der Pol, μ = 1e3",
    source=SOURCE.format("VDPOLM", "5e-15"),
    pieces=(Piece(0.0, 2 * MU),),
    initial=(2.0, 0.0),
    rates=rates,
    exact=(1.7061677321704650, -0.89280970102481655e-3),
    measured=(0, 1),
    relative=True,
    stiff=True,
    atol_over_rtol=1e-3,
)
VAN_DER_POL_SCALED = Problem(
    name="van-der-pol-scaled",
    title="Van der Pol, 1/ε = 1e6",
    source=SOURCE.format("VDPOL", "3e-14"),
    pieces=(Piece(0.0, 2.0),),
    initial=(2.0, 0.0),
    rates=scaled_rates,
    exact=(1.7061677321704650, -0.89280970102481655),
    measured=(0, 1),
    relative=True,
    stiff=True,
    atol_over_rtol=1.0,
)
