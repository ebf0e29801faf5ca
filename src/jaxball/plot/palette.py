"""The colours and dashes of figures and views, each stated once.

Lines of one panel differ in lightness and hue, for readers with full, dichromatic or no colour vision, or they differ
in their dashes; a test simulates these readers. The masses' colours are those of Okabe and Ito, those of components
Tol's high-contrast ones.
"""

from typing import NamedTuple

from ..physics.contact.modes import Mode

INK = "black"
SHELL = "0.45"
FAINT = "0.82"
TRAIL = "#BB5566"
MASSES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
COMPONENTS = ("#004488", "#BB5566", "#DDAA33")

# On and off, in widths of the line.
Dashes = tuple[float, ...]
SOLID: Dashes = ()
DASHED: Dashes = (4.0, 2.0)
DOTTED: Dashes = (1.0, 1.5)
DASH_DOTTED: Dashes = (5.0, 1.5, 1.0, 1.5)
# Two colours of one of the first three differ in lightness too, which the six colours together cannot.
OF_MASSES: tuple[Dashes, ...] = (SOLID, (6.0, 1.5), (5.0, 1.2, 1.0, 1.2))
OF_MORE_MASSES: tuple[Dashes, ...] = ((1.0, 1.2), (10.0, 2.5), (5.0, 1.2, 1.0, 1.2, 1.0, 1.2))


class Line(NamedTuple):
    """A colour and its dashes."""

    colour: str
    dashes: Dashes = SOLID


TAKEN = {"to friction": Line("#997700", DASH_DOTTED), "to impacts": Line("#6699CC", DOTTED)}
# Of bands behind what is drawn over time, which show a share of these.
MODES = {Mode.SLIDING: "#555555", Mode.FLIGHT: "#66CCEE"}
BAND_SHARE = 0.2
# Of arrows in views, which have names at their tips.
ARROWS = {
    "normal": COMPONENTS[0],
    "friction": COMPONENTS[1],
    "slip": COMPONENTS[2],
    "spin": "#56B4E9",
    "momentum": "#7B3FA0",
    "xi": "#009E73",
}


def mass_colour(i: int) -> str:
    """Returns the colour of mass i = 1 … n, the same in every figure."""
    return MASSES[(i - 1) % len(MASSES)]


def mass_look(i: int) -> Line:
    """Returns the colour and the dashes of mass i = 1 … n: no two of the first twelve have both."""
    more = (i - 1) // len(MASSES) % 2
    dashes = OF_MORE_MASSES if more else OF_MASSES
    return Line(mass_colour(i), dashes[(i - 1) % len(dashes)])


def on_white(colour: str) -> str:
    """Returns a colour for bands, pale on white."""
    parts = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return "#" + "".join(f"{round(255 - BAND_SHARE * (255 - part)):02X}" for part in parts)
