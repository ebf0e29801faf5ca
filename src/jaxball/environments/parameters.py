"""Numbers of a robot and of its start, by name."""

from collections.abc import Iterable, Mapping
from typing import Any

import jax
from jaxtyping import Array, Float

from ..interface.wording import did_you_mean
from ..physics.body import System


def numbers_of(system: System) -> dict[str, Float[Array, "..."]]:
    """The arrays among the arguments that make a body, by their paths, such as ``mechanisms[0].mass``."""
    return {_name(path): leaf for path, leaf in jax.tree_util.tree_leaves_with_path(system.arguments)}


def with_numbers(system: System, values: Mapping[str, Float[Array, "..."]]) -> System:
    """The body with other arrays, by their paths; traceable."""
    leaves, structure = jax.tree_util.tree_flatten_with_path(system.arguments)
    changed = [values.get(_name(path), leaf) for path, leaf in leaves]
    return type(system)(**jax.tree.unflatten(structure, changed))


def require_numbers_of(system: System, names: Iterable[str]) -> dict[str, Float[Array, "..."]]:
    """The arrays of a body with these paths.

    **Raises:** ``ValueError`` for one that it does not have.
    """
    known = numbers_of(system)
    for name in names:
        if name not in known:
            there = f"its numbers are {', '.join(known)}"
            raise ValueError(
                f"Argument `parameters` must have paths of numbers of this {system.title} as keys, but one is {name!r}"
                f"{did_you_mean(name, known, there)}"
            )
    return {name: known[name] for name in names}


def directions_by_name(names: Iterable[str], directions: tuple[str, ...]) -> dict[str, list[int]]:
    """The places of local coordinates, by their names or by that of a field, ``"z"`` for ``"z[0]"`` and ``"z[1]"``.

    **Raises:** ``ValueError`` for an unknown name, and for a coordinate that two names give.
    """
    found: dict[str, list[int]] = {}
    known = list(dict.fromkeys([*(own.partition("[")[0] for own in directions), *directions]))
    for name in names:
        found[name] = [k for k, own in enumerate(directions) if name in (own, own.partition("[")[0])]
        if not found[name]:
            there = f"the names are {', '.join(known)}"
            raise ValueError(
                f"Argument `starts` must have local coordinates as keys, but one is {name!r}"
                f"{did_you_mean(name, known, there)}"
            )
    places = [place for places in found.values() for place in places]
    for place in places:
        if places.count(place) > 1:
            raise ValueError(f"Argument `starts` must give {directions[place]} once, but two of its keys do.")
    return found


def _name(path: Any) -> str:
    return f"{path[0].key}{jax.tree_util.keystr(path[1:])}"
