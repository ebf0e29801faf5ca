"""The rules, one file for each family of operations. Importing this enters them all."""

from . import control, elementwise, indexing, linear_algebra, products, reductions, shapes, sorting

__all__ = ["control", "elementwise", "indexing", "linear_algebra", "products", "reductions", "shapes", "sorting"]
