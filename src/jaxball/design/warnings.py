"""Warnings about a finished design."""

import numpy as np

from .search.design import Design

# A target missed by this many radii was not reached.
MISSED = 0.1


def warnings(design: Design) -> list[str]:
    """A sentence for each shortcoming of a design; none if all is well."""
    verified, tolerance = design.verified, design.settings.tolerance
    sentences = []
    if int(verified.finer.status) != 0:
        sentences.append(
            f"The best design could not be simulated to its end by {verified.solver}; allow more steps, or shorten the "
            "run."
        )
    violated = [f"`{name}` by {fine:.2g}" for name, (_, fine) in verified.violations.items() if not fine <= tolerance]
    if violated:
        sentences.append(
            f"The constraints could not all be fulfilled: the best design violates {', '.join(violated)}; check "
            "whether they contradict each other or the bounds, or search longer."
        )
    if verified.margin <= 0:
        sentences.append(
            f"The ball would leave the plane: its least normal force is {verified.margin:.2g} of its weight, and after "
            "that the equations of rolling do not hold; add the constraint `normal-force`."
        )
    sentences += [
        f"The target of `{name}` is missed by {by:.2g} radii, and nothing closer was found; give it more weight, more "
        "time or more variables, or another starting point."
        for name, by in verified.missed.items()
        if by > MISSED
    ]
    if not np.isfinite(design.merit.gradient):
        sentences.append(
            "The gradient at the best design is not finite, and the search could not continue from there; start "
            "elsewhere."
        )
    return sentences
