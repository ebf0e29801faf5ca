"""From a system and times to its motion: the solve, its trajectory, events, extremes and equilibria.

Single runs; many at once are in :mod:`jaxball.ensemble`.
"""

DEFAULT_TOLERANCE = 1e-10
MOST_STEPS = 10**9  # which take days, and which a counter of 32 bits holds
