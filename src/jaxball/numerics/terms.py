"""Arithmetic of terms that may be absent: None stands for a term that is 0 and is not computed.

A sum over what acts on a body is then written once, whatever acts, and a program contains nothing but the terms there
are.
"""

from collections.abc import Callable
from typing import overload

from jaxtyping import Array


@overload
def add(first: Array, /, *others: Array | None) -> Array: ...
@overload
def add(*terms: Array | None) -> Array | None: ...
def add(*terms: Array | None) -> Array | None:
    """Adds the terms that there are, in their order; None if there are none."""
    total = None
    for term in terms:
        total = term if total is None else total if term is None else total + term
    return total


@overload
def convert(function: Callable[[Array], Array], term: Array) -> Array: ...
@overload
def convert(function: Callable[[Array], Array], term: None) -> None: ...
@overload
def convert(function: Callable[[Array], Array], term: Array | None) -> Array | None: ...
def convert(function: Callable[[Array], Array], term: Array | None) -> Array | None:
    """Returns a linear function of a term; None of a term that is absent."""
    return None if term is None else function(term)
