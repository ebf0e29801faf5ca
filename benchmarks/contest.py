"""Contenders in turns at every tolerance: the best time, and the error against another engine's tighter run."""

import argparse
import math
from collections.abc import Sequence

import harness
import numpy as np
import perturbed
from turns import Contender, Seats


def measure(
    contenders: Sequence[Contender],
    total: int,
    tolerances: Sequence[float],
    rounds: int,
    cores: int,
    references: dict[str, float],
) -> dict:
    """``rows``: one for each contender and tolerance. ``agreement``: how far the references are apart.

    - Times are the best of ``rounds``, in seconds; in each round every contender has its turn at every tolerance.
    - ``references``: two contenders and their tolerances. Errors are against the first of them that there is, and its
      own against the other.
    """
    with Seats(contenders, total, cores) as seats:
        exact = references_of(seats, references)
        builds = {
            contender: [seats.build(contender, tolerance) for tolerance in tolerances] for contender in seats.contenders
        }
        best = {(contender, tolerance): (math.inf, np.empty(0)) for contender in builds for tolerance in tolerances}
        for _ in range(rounds):
            for contender, tolerance in best:
                solved = seats.solve(contender, tolerance)
                if solved and solved[0] < best[contender, tolerance][0]:
                    best[contender, tolerance] = solved
        rows = [
            {
                **_row(contender, tolerance, *best[contender, tolerance], _against(contender, exact)),
                "build_time": build,
            }
            for contender in seats.contenders
            for tolerance, build in zip(tolerances, builds[contender], strict=True)
        ]
    return {"rows": rows, "agreement": agreement(exact)}


def references_of(seats: Seats, references: dict[str, float]) -> dict[str, np.ndarray]:
    """The references' final states, by the names of their contenders and in the order given."""
    by_name = {contender.name: contender for contender in seats.contenders}
    found = {}
    for name, tolerance in references.items():
        if name in by_name and seats.build(by_name[name], tolerance) is not None:
            solved = seats.solve(by_name[name], tolerance)
            found |= {name: solved[1]} if solved else {}
    return found


def agreement(exact: dict[str, np.ndarray]) -> dict:
    """How far the two references are apart; empty where there is one only."""
    if len(exact) < 2:
        return {}
    apart = perturbed.errors(*exact.values())
    return {"references": list(exact), "median": float(np.median(apart)), "max": float(np.max(apart))}


def agreement_sentence(found: dict) -> str:
    """The same in words."""
    if not found:
        return "There is one reference only, so its own engine's errors are not independent."
    first, second = found["references"]
    return (
        f"The references, {first} and {second}, are {found['median']:.1e} apart in the median and at most "
        f"{found['max']:.1e}; errors are against {first}, and its own against {second}."
    )


def _against(contender: Contender, exact: dict[str, np.ndarray]) -> np.ndarray:
    others = [state for reference, state in exact.items() if reference != contender.name]
    return (others or list(exact.values()))[0]


def _row(contender: Contender, tolerance: float, seconds: float, found: np.ndarray, exact: np.ndarray) -> dict:
    apart = perturbed.errors(found, exact)
    good = apart[np.isfinite(apart)]
    return {
        "solver": contender.name,
        "rows": contender.rows,
        "tolerance": tolerance,
        "time": seconds,
        "rate": contender.rows / seconds,
        "error_median": float(np.median(good)) if good.size else math.nan,
        "error_max": float(np.max(good)) if good.size else math.nan,
        "failed": int(np.sum(~np.isfinite(found).all(axis=1))),
    }


def parser(description: str, rows: int, tolerances: Sequence[float], rounds: int) -> argparse.ArgumentParser:
    """The arguments of a contest, with these defaults."""
    found = harness.parser(description, rows=rows, rounds=rounds)
    found.add_argument("--tolerances", type=float, nargs="+", default=tolerances)
    return found
