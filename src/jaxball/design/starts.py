"""Where to start from."""

import numpy as np
from jaxtyping import Float

from .settings import Settings
from .space import DesignSpace


def starting_points(space: DesignSpace, settings: Settings) -> Float[np.ndarray, "starts n"]:
    """The given design first, and others: normally distributed about it, and uniformly between two bounds."""
    random, bounds = np.random.default_rng(settings.seed), space.bounds
    shape = (settings.starts - 1, space.size)
    both = np.isfinite(bounds.lower) & np.isfinite(bounds.upper)
    low, high = np.where(both, bounds.lower, 0.0), np.where(both, bounds.upper, 1.0)
    anywhere = low + (high - low) * random.uniform(size=shape)
    about = space.start + settings.spread * random.normal(size=shape)
    others = [np.where(both, bounds.variables(x), z) for x, z in zip(anywhere, about, strict=True)]
    return np.stack([space.start, *others])
