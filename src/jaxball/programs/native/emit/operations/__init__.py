"""The rules, one file for each family of operations. Importing this registers them all."""

from . import control, custom, elementwise, indexing, loops, products, reductions, shapes, sorting

__all__ = ["control", "custom", "elementwise", "indexing", "loops", "products", "reductions", "shapes", "sorting"]
