"""The rules, one file for each family of operations. Importing this registers them all."""

from . import control, elementwise, indexing, linear_algebra, loops, products, reductions, shapes, sorting  # noqa: F401
