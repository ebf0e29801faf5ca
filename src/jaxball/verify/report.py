"""The laws of a run with what was found of each, and whether to believe the run."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

ERROR_ALLOWED = 1e-3


@dataclasses.dataclass(frozen=True)
class Row:
    """One law and what was found of it in a run.

    - ``law``: its name, as in :data:`~jaxball.verify.LAWS`, or that of an entry of a classical system's laws.
    - ``residual``: how far the run departs from the law. Where a law does not apply, how much the quantity changes
      that it would keep, or None where there is no such quantity.
    - ``expected``: the largest residual that the tolerances explain, or, with ``at_least``, the least that will do.
    - ``reason``: why the law does not apply; empty where it does.
    - ``note``: what else there is to say.
    """

    law: str
    residual: float | None = None
    expected: float | None = None
    reason: str = ""
    note: str = ""
    at_least: bool = False

    @property
    def applies(self) -> bool:
        """Whether the law holds for such a system at all."""
        return not self.reason

    @property
    def ok(self) -> bool:
        """Whether the law holds, or does not apply. What is not a number does not hold."""
        if not self.applies:
            return True
        if self.residual is None or self.expected is None:
            return False
        return self.residual > self.expected if self.at_least else self.residual <= self.expected

    @property
    def verdict(self) -> str:
        """In words."""
        if not self.applies:
            return f"does not apply: {self.reason}"
        return f"{'holds' if self.ok else 'FAILS'}{': ' if self.note else ''}{self.note}"


@dataclasses.dataclass(frozen=True)
class Trust:
    """How far ahead a result can be trusted.

    Errors are relative to 1 + |x|, component by component, as the tolerances are where both are equal.

    - ``error``: the largest of the run, against a run at a tolerance of 1e-13.
    - ``growth``: by how much a small deviation of the initial state grows in the run, at most.
    - ``lyapunov_time``: the time in which it grows e-fold on average, the inverse of the finite-time Lyapunov exponent.
    - ``horizon``: the time at which the error reaches 1e-3. Beyond the end of the run it is an estimate by the mean
      growth, and too early where the motion is regular.
    - ``end``: when the run ended.
    """

    error: float
    growth: float
    lyapunov_time: float
    horizon: float
    end: float

    def __repr__(self) -> str:
        growth = f"{self.growth:.3g}-fold, e-fold in {self.lyapunov_time:.3g}"
        when = f"at t = {self.horizon:.3g}" if self.horizon <= self.end else f"not before t = {self.horizon:.3g}"
        return f"error {self.error:.1e}; small deviations grow {growth}; the error reaches {ERROR_ALLOWED:g} {when}"


@dataclasses.dataclass(frozen=True)
class Report:
    """The laws of one run.

    - ``title``: the first line.
    - ``rows``: one for each law.
    - ``trust``: how far ahead the result can be trusted; None where this was not asked for, or not found.
    - ``failure``: a sentence, where the solve failed and nothing could be checked.
    """

    title: str
    rows: tuple[Row, ...]
    trust: Trust | None = None
    failure: str = ""

    def __getitem__(self, law: str) -> Row:
        """The row of a law by its name."""
        for row in self.rows:
            if row.law == law:
                return row
        raise KeyError(law)

    @property
    def ok(self) -> bool:
        """Whether the run can be believed: it came to its end, all laws that apply hold, and the error is small."""
        return not self.doubts

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the run should not be believed; empty where it should."""
        if self.failure:
            return (self.failure,)
        found = [f"{row.law} {_broken(row)}" for row in self.rows if not row.ok]
        if self.trust is not None and not self.trust.error <= ERROR_ALLOWED:
            found.append(
                f"the error is {self.trust.error:.1e}, and more than {ERROR_ALLOWED:g} from t = "
                f"{self.trust.horizon:.3g} on (tighten the tolerances)"
            )
        return tuple(found)

    def __repr__(self) -> str:
        lines = [self.title] if self.title else []
        lines += table(self.rows)
        if self.trust is not None:
            lines.append(f"  {self.trust}")
        if not self.ok:
            lines.append("  Do not believe this run: " + "; ".join(self.doubts).rstrip(".") + ".")
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """All of it in plain types, for JSON. What is not finite is None."""
        rows = [
            {**dataclasses.asdict(row), "applies": row.applies, "ok": row.ok, "verdict": row.verdict}
            for row in self.rows
        ]
        trust = None if self.trust is None else dataclasses.asdict(self.trust)
        return _finite(
            {
                "title": self.title,
                "ok": self.ok,
                "doubts": list(self.doubts),
                "rows": rows,
                "trust": trust,
                "failure": self.failure,
            }
        )


def table(rows: Sequence[Row]) -> list[str]:
    """The lines of a table of laws, with its heading."""
    if not rows:
        return []
    width = max(len(row.law) for row in rows)
    lines = [f"  {'law':{width}}  {'found':>8}  {'expected':>9}"]
    for row in rows:
        bound = f"{'>' if row.at_least else '≤'} {_number(row, row.expected)}" if row.applies else ""
        found = _number(row, row.residual)
        lines.append(f"  {row.law:{width}}  {found:>8}  {bound:>9}  {row.verdict}")
    return lines


def _number(row: Row, value: float | None) -> str:
    """The number in a few digits: that of a residual by its power of ten, others plainly."""
    return "" if value is None else f"{value:.3g}" if row.at_least else f"{value:.1e}"


def _broken(row: Row) -> str:
    if row.residual is None or row.expected is None:
        return f"cannot be checked ({row.note})"
    limit = "must be above" if row.at_least else "is explained up to"
    note = f" ({row.note})" if row.note else ""
    return f"fails: {_number(row, row.residual)} was found and {limit} {_number(row, row.expected)}{note}"


def _finite(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list):
        return [_finite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content
