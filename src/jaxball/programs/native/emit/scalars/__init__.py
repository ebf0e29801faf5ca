"""Instructions for operations on single numbers, which the rules apply to the elements of arrays."""
