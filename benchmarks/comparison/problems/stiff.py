"""Stiff problems of the literature: Van der Pol, Robertson, HIRES and the Oregonator."""

import dataclasses
from collections.abc import Sequence

from ..problem import Functions, Piece, Problem, Scalar

MU = 1e3
SOURCE = (
    "Hairer & Wanner II, section IV.10, VDPOL; the end state from Radau collocation in 32 digits, to which {} of "
    "Mazzia & Magherini, Test Set for IVP Solvers, release 2.4 (2008), agrees to {}"
)


def van_der_pol_rates(t: Scalar, x: Sequence[Scalar], p: Sequence[Scalar], functions: Functions) -> list[Scalar]:
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
    rates=van_der_pol_rates,
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


ROBERTSON_END = 1e11


def robertson_rates(t: Scalar, x: Sequence[Scalar], p: Sequence[Scalar], functions: Functions) -> list[Scalar]:
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
    pieces=(Piece(0.0, ROBERTSON_END),),
    initial=(1.0, 0.0, 0.0),
    rates=robertson_rates,
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
    pieces=(Piece(0.0, ROBERTSON_END, algebraic=2),),
    constraint=mass_excess,
)


def hires_rates(t: Scalar, x: Sequence[Scalar], p: Sequence[Scalar], functions: Functions) -> list[Scalar]:
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
    rates=hires_rates,
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


def orego_rates(t: Scalar, x: Sequence[Scalar], p: Sequence[Scalar], functions: Functions) -> list[Scalar]:
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
    rates=orego_rates,
    exact=(1.0008148703185227, 1228.1785215498874, 132.05549428465045),
    measured=(0, 1, 2),
    relative=True,
    stiff=True,
    atol_over_rtol=1.0,
)
