"""The equations of motion: their numbers, the sums over masses, the forces that act, and the accelerations.

``equations`` has them in the paper's form, and ``locked`` in the variables that a solver advances.
"""
