"""The report of a verification: a row for each law, and whether the run can be trusted."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ...interface.printing import json_types, repr_html
from ...interface.wording import heading
from .case import ERROR_ALLOWED, Trust


@dataclasses.dataclass(frozen=True)
class Row:
    """How well one law holds in a run.

    - ``law``: its name, as in :data:`~jaxball.analysis.verify.laws.LAWS`, or that of an entry of a classical system's
      laws.
    - ``residual``: the departure of the run from the law; where a law does not apply, the change of the quantity it
      would conserve, or None where there is no such quantity.
    - ``expected``: the largest residual that the tolerances explain, or, with ``at_least``, the smallest valid value.
    - ``reason``: why the law does not apply; empty where it does.
    - ``note``: a remark.
    - ``residuals``: of a balance or an integral, the residual at each of the report's ``times``.
    """

    law: str
    residual: float | None = None
    expected: float | None = None
    reason: str = ""
    note: str = ""
    at_least: bool = False
    residuals: Float[np.ndarray, " steps"] | None = dataclasses.field(default=None, repr=False, compare=False)

    @property
    def applies(self) -> bool:
        """Whether the law applies to the system."""
        return not self.reason

    @property
    def ok(self) -> bool:
        """Whether the law holds or does not apply. A residual of NaN does not hold."""
        if not self.applies:
            return True
        if self.residual is None or self.expected is None:
            return False
        return self.residual > self.expected if self.at_least else self.residual <= self.expected

    @property
    def verdict(self) -> str:
        """Whether the law applies and holds, as text."""
        if not self.applies:
            return f"does not apply: {self.reason}"
        return f"{'holds' if self.ok else 'FAILS'}{': ' if self.note else ''}{self.note}"


@dataclasses.dataclass(frozen=True)
class Report:
    """The laws of one run.

    - ``title``: the first line.
    - ``rows``: one for each law.
    - ``trust``: how far ahead the result can be trusted; None where this was not requested or could not be determined.
    - ``failure``: why the solve failed, so that nothing could be checked; empty where it did not.
    - ``times``: the ends of the run's steps, at which the rows of balances have residuals; None without such rows.
    """

    title: str
    rows: tuple[Row, ...]
    trust: Trust | None = None
    failure: str = ""
    times: Float[np.ndarray, " steps"] | None = dataclasses.field(default=None, repr=False, compare=False)

    def __getitem__(self, law: str) -> Row:
        """Returns the row of a law by its name."""
        for row in self.rows:
            if row.law == law:
                return row
        raise KeyError(law)

    @property
    def residuals(self) -> dict[str, Float[np.ndarray, " steps"]]:
        """The residuals at ``times`` of the laws that apply, as multiples of those that the tolerances explain."""
        return {
            row.law: row.residuals / row.expected
            for row in self.rows
            if row.applies and row.residuals is not None and row.expected
        }

    @property
    def ok(self) -> bool:
        """Whether the run can be trusted: it reached its end, all laws that apply hold, and the error is small."""
        return not self.doubts

    @property
    def doubts(self) -> tuple[str, ...]:
        """The reasons not to trust the run; empty if there are none."""
        if self.failure:
            return (self.failure,)
        doubts = [f"{row.law} {_failure(row)}" for row in self.rows if not row.ok]
        if self.trust is not None and not self.trust.error <= ERROR_ALLOWED:
            doubts.append(
                f"the error is {self.trust.error:.1e}, and more than {ERROR_ALLOWED:g} from t = "
                f"{self.trust.horizon:.3g} on (tighten the tolerances)"
            )
        return tuple(doubts)

    _repr_html_ = repr_html

    def __repr__(self) -> str:
        lines = [heading(self.title)] if self.title else []
        lines += table(self.rows)
        if self.trust is not None:
            lines.append(f"  {self.trust}")
        if not self.ok:
            lines.append("  Do not trust this run: " + "; ".join(self.doubts).rstrip(".") + ".")
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """Returns the report in the types of JSON. Numbers that are not finite are None."""
        rows = [
            {**dataclasses.asdict(row), "applies": row.applies, "ok": row.ok, "verdict": row.verdict}
            for row in self.rows
        ]
        for row in rows:
            del row["residuals"]  # only for figures
        trust = None if self.trust is None else dataclasses.asdict(self.trust)
        report = {"title": self.title, "ok": self.ok, "doubts": self.doubts}
        return json_types({**report, "rows": rows, "trust": trust, "failure": self.failure})


def table(rows: Sequence[Row]) -> list[str]:
    """Returns the lines of the table of laws, with its heading."""
    if not rows:
        return []
    width = max(len(row.law) for row in rows)
    lines = [f"  {'law':{width}}  {'residual':>8}  {'expected':>9}"]
    for row in rows:
        expected = f"{'>' if row.at_least else '≤'} {_number(row, row.expected)}" if row.applies else ""
        lines.append(f"  {row.law:{width}}  {_number(row, row.residual):>8}  {expected:>9}  {row.verdict}")
    return lines


def _number(row: Row, value: float | None) -> str:
    """Formats the number in a few digits: a residual with its power of ten, a value that must be large enough
    without.
    """
    return "" if value is None else f"{value:.3g}" if row.at_least else f"{value:.1e}"


def _failure(row: Row) -> str:
    if row.residual is None or row.expected is None:
        return f"cannot be checked ({row.note})"
    limit = "the value must be above" if row.at_least else "the tolerances explain at most"
    note = f" ({row.note})" if row.note else ""
    return f"fails: it is {_number(row, row.residual)}, and {limit} {_number(row, row.expected)}{note}"
