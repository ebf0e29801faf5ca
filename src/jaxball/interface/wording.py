"""Parts of messages: enumerations, counts with plurals, and "did you mean"."""

from collections.abc import Iterable, Sequence


def one_of(names: Sequence[str]) -> str:
    """``one of a, b, c``, and a single name as it is."""
    return names[0] if len(names) == 1 else f"one of {', '.join(names)}"


def all_of(names: Sequence[str]) -> str:
    """``a, b and c``."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def counted(number: int, thing: str, things: str = "") -> str:
    """``1 mass``, ``2 masses``, ``1,000 rows``; ``things`` is the plural where it is not formed by adding an s."""
    return f"{number:,} {thing if number == 1 else things or f'{thing}s'}"


def nearest(name: str, known: Iterable[str], most: int = 1, cutoff: float = 0.6) -> list[str]:
    """Up to ``most`` known names similar to ``name``, the most similar first, ignoring case."""
    import difflib  # here, because it is for mistakes alone

    lower = {one.lower(): one for one in known}
    return [lower[near] for near in difflib.get_close_matches(name.lower(), lower, most, cutoff)]


def did_you_mean(name: str, known: Iterable[str], otherwise: str = "", quote: str = '"') -> str:
    """``; did you mean "circle"?`` where a known name is similar, else ``otherwise`` as a clause, and a full stop."""
    for near in nearest(name, known):
        return f"; did you mean {quote}{near}{quote}?"
    return f"; {otherwise}." if otherwise else "."
