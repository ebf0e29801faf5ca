"""Default arguments of a solve, which can be read without importing a solver."""

DEFAULT_TOLERANCE = 1e-10
