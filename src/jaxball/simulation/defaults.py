"""Arguments of a solve where they are not given, for those who need no solver to know them."""

DEFAULT_TOLERANCE = 1e-10
