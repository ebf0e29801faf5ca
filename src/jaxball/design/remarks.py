"""What is wrong with a finished design, in sentences."""

import numpy as np

from .search import Design

# A target that is missed by so many radii was not reached.
MISSED = 0.1


def remarks(design: Design) -> list[str]:
    """A sentence for whatever a search could not do; none where all is well."""
    return [*_ended(design), *_constraints(design), *_plane(design), *_targets(design), *_gradient(design)]


def _ended(design: Design) -> list[str]:
    seen = design.verified
    if int(seen.finer.status) == 0:
        return []
    return [f"The best design could not be simulated to its end by {seen.solver}; give it more steps, or less time."]


def _constraints(design: Design) -> list[str]:
    found = {name: fine for name, (_, fine) in design.verified.violations.items()}
    broken = [f"`{name}` by {by:.2g}" for name, by in found.items() if not by <= design.settings.tolerance]
    if not broken:
        return []
    return [
        f"The constraints could not all be fulfilled: the best design violates {', '.join(broken)}; look whether they "
        "contradict each other or the bounds, or look longer."
    ]


def _plane(design: Design) -> list[str]:
    margin = design.verified.margin
    if not margin <= 0:
        return []
    return [
        f"The ball would leave the plane: its least normal force is {margin:.2g} of its weight, and after that the "
        "equations of rolling do not hold; add the constraint `normal-force`."
    ]


def _targets(design: Design) -> list[str]:
    return [
        f"The target of `{name}` is missed by {by:.2g} radii, and nothing nearer was found; give it more weight, more "
        "time or more variables, or another place to start from."
        for name, by in design.verified.missed.items()
        if by > MISSED
    ]


def _gradient(design: Design) -> list[str]:
    if np.isfinite(design.worth.gradient):
        return []
    return [
        "The gradient at the best design is not finite, and the search could not go on from there; start elsewhere."
    ]
