"""How colours look to readers who see fewer of them, and how far apart two colours are then.

The matrices are those of Machado, Oliveira and Fernandes (2009) for a full deficiency, in linear RGB. Distances are
Euclidean in CIELAB, where 2 is just seen side by side; grey keeps the luminance.
"""

import itertools

import matplotlib.colors
import numpy as np

SEEN_BY = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
    "grey": np.tile([0.2126, 0.7152, 0.0722], (3, 1)),
}
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
WHITE = TO_XYZ.sum(axis=1)


def linear(colour):
    """The linear RGB of a colour in any notation of matplotlib."""
    c = np.asarray(matplotlib.colors.to_rgb(colour))
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def lab(rgb):
    """CIELAB of linear RGB."""
    ratio = TO_XYZ @ rgb / WHITE
    f = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def distance(one, other, sight="normal"):
    """How far apart two colours are to a reader with this sight."""
    seen = [lab(np.clip(SEEN_BY[sight] @ linear(colour), 0.0, 1.0)) for colour in (one, other)]
    return float(np.linalg.norm(seen[0] - seen[1]))


def nearest(looks):
    """The pair of looks, colours with their dashes or marks, that is hardest to tell apart: distance, sight and pair.

    Looks with other dashes or marks are told apart by these.
    """
    alike = [pair for pair in itertools.combinations(looks, 2) if pair[0][1] == pair[1][1]]
    return min(
        ((distance(a[0], b[0], sight), sight, (a, b)) for a, b in alike for sight in SEEN_BY),
        key=lambda found: found[0],
        default=(np.inf, "", ()),
    )


def contrast(colour, paper):
    """The ratio of luminances that the guidelines for accessible pages (WCAG) ask to be 4.5 or more for text."""
    light, dark = sorted((float(SEEN_BY["grey"][0] @ linear(one)) + 0.05 for one in (colour, paper)), reverse=True)
    return light / dark
