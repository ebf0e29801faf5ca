"""The result of ``lyapunov_spectrum``: the exponents, how they converged, and which of them differ from zero."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...interface.names import leave_to
from ...interface.printing import Printed, format_value, is_single
from ...interface.status import SolveError, Status

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

PARTS = 16  # parts of the run, to whose means the limit is fitted
FEWEST_PARTS = 6
ALIGNING = 1 / 8  # of the run, during which the deviations align with their directions, and their rates mean nothing
STANDARD_ERRORS = 2.5  # a limit closer to zero than this many standard errors may be zero
FOLDS = (
    3.0  # this many e-folds or fewer may occur along regular motions too: t² gives 2.1 where it begins late in a run
)


class Limits(NamedTuple):
    """The limits of the growth rates, each fitted as λ + a/t with t from the start of the run, shape (k,).

    Along a regular motion deviations grow as a power tᵃ of time, whose rate is a/t, and λ is zero.

    - ``limits``, ``errors``: λ and its standard error, that of the fit alone; NaN where the run has too few intervals.
    - ``told``: whether the exponent is distinguished from zero: λ has the sign of the mean rate and is more than 2.5
      standard errors from zero, and deviations changed by more than three e-folds.
    - ``drifting``: whether, in addition, the mean differs from λ by more than its own standard error, and by more than
      a tenth, while a differs from zero by more than 2.5 of its own.
    """

    limits: Float[np.ndarray, " k"]
    errors: Float[np.ndarray, " k"]
    told: Bool[np.ndarray, " k"]
    drifting: Bool[np.ndarray, " k"]


def limits_of(
    start: float,
    times: Float[np.ndarray, " n"],
    rates: Float[np.ndarray, "n k"],
    standard_error: Float[np.ndarray, " k"],
) -> Limits:
    """Computes the limits of ``rates`` over equal intervals that end at ``times``, in a run that began at ``start``."""
    lost = np.any(np.isneginf(rates), axis=0)
    if np.any(lost):  # −∞ is no number to fit, and is known exactly
        others = limits_of(start, times, rates[:, ~lost], standard_error[~lost])
        whole = [np.full(lost.size, value) for value in (-np.inf, 0.0, True, False)]
        for column, values in zip(whole, others, strict=True):
            column[~lost] = values
        return Limits(*whole)
    count, k = rates.shape
    nothing = np.full(k, np.nan)
    step = (times[-1] - times[0]) / max(count - 1, 1)
    # Each rate is the mean over its interval, and stands for the middle of it.
    middle = times - start - step / 2
    late = middle >= ALIGNING * (times[-1] - start)
    parts = min(PARTS, int(np.sum(late)))
    if parts < FEWEST_PARTS or not np.all(np.isfinite(rates)):
        return Limits(nothing, nothing, np.full(k, False), np.full(k, False))
    # Means over parts, because successive rates are correlated, and a fit to them would claim to be too exact.
    length = int(np.sum(late)) // parts
    # The oldest of the late ones are left out where the parts do not come out even.
    used = slice(count - parts * length, None)
    means = rates[used].reshape(parts, length, k).mean(axis=1)
    # The mean of 1/t, not 1/t of the mean: then rates of exactly λ + a/t are fitted exactly.
    inverse = (1 / middle[used]).reshape(parts, length).mean(axis=1)
    basis = np.stack([np.ones(parts), inverse], axis=1)
    fitted, *_ = np.linalg.lstsq(basis, means)
    variance = np.sum((means - basis @ fitted) ** 2, axis=0) / (parts - 2)  # two numbers are fitted
    errors = np.sqrt(np.diag(np.linalg.inv(basis.T @ basis))[:, None] * variance)
    mean, length_of_run = rates.mean(axis=0), count * step
    nonzero = (np.abs(fitted[0]) > STANDARD_ERRORS * errors[0]) & (np.minimum(mean * fitted[0], mean**2) > 0)
    nonzero &= np.minimum(np.abs(fitted[0]), np.abs(mean)) * length_of_run > FOLDS
    change = np.abs(mean - fitted[0])
    drifting = nonzero & (change > standard_error) & (change > 0.1 * np.abs(mean))
    drifting &= np.abs(fitted[1]) > STANDARD_ERRORS * errors[1]
    return Limits(fitted[0], errors[0], nonzero, drifting)


def sentences(limits: Limits) -> list[str]:
    """Says what ``limits`` leave open, and what to do; empty if all exponents are distinguished from zero and
    converged.
    """
    lines = []
    untold, moving = np.flatnonzero(~limits.told), np.flatnonzero(limits.drifting)
    if np.any(np.isnan(limits.limits)):
        return [
            "The run has too few intervals to distinguish any exponent from zero; choose a later end, or shorter "
            "intervals."
        ]
    if untold.size:
        lines.append(
            f"The run cannot distinguish {_names(untold)} from zero: growth as a power of time, as along a regular "
            "motion, explains the data equally well; a run ten times as long narrows it down."
        )
    if moving.size:
        values = ", ".join(f"{limits.limits[i]:.3g}" for i in moving)
        lines.append(
            f"The means of {_names(moving)} still drift, as 1/t towards {values}; choose a transient, or a later end."
        )
    return lines


def _names(indices: Sequence[int] | np.ndarray) -> str:
    """Lists exponents by name: λ1 and λ2, or λ1 to λ3, or λ1, λ2 and λ4."""
    names = [f"λ{i + 1}" for i in indices]
    if len(names) > 2 and indices[-1] - indices[0] == len(names) - 1:
        return f"{names[0]} to {names[-1]}"
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


class LyapunovSpectrum(Printed):
    """Lyapunov exponents and their convergence. NaN after the time that the solve reached.

    - ``exponents``: the mean growth rates over the run without its transient, shape (k,), in 1/time, the largest first;
      all other arrays follow this order. −∞ where an event has made deviations one, as where a body comes to rest.
    - ``standard_error``: of each exponent, from the scatter of its means over sixteen parts of the run. It estimates
      how far a chaotic run is from its limit; for a regular run, whose means converge as log(t)/t or 1/t, it says
      little, and ``told_from_zero`` and ``limits``, which are printed, say more.
    - ``times``: the ends of the intervals, shape (n,).
    - ``rates``: the growth rates within each interval, shape (n, k).
    - ``running``: the means of the rates from the end of the transient to each of ``times``, shape (n, k).
    - ``x``: the state at the end, as the solver's vector.
    - ``vectors``: the orthonormal vectors at the end, a row for each exponent.
    - ``least_normal_force``: the least N of a rolling body over the whole run, including the transient; if it is not
      positive, the ball would have left the plane. None for other flows.
    - ``status``, ``reached``, ``steps``: as in a :class:`~jaxball.Trajectory`; ``ok`` and ``message`` read them.
    - ``start``: when the run began, including the transient.
    - ``solve_error``: how far errors of the solve may move an exponent, as large in each step as its tolerances allow.
    """

    exponents: Float[Array, "*batch k"]
    standard_error: Float[Array, "*batch k"]
    times: Float[Array, "*batch n"]
    rates: Float[Array, "*batch n k"]
    running: Float[Array, "*batch n k"]
    x: Float[Array, "*batch size"]
    vectors: Float[Array, "*batch k size"]
    status: Int[Array, "*batch"]
    reached: Float[Array, "*batch"]
    steps: Int[Array, "*batch"]
    start: Float[Array, "*batch"]
    solve_error: Float[Array, "*batch"]
    least_normal_force: Float[Array, "*batch"] | None = None

    @property
    def ok(self) -> bool:
        """Whether the run reached its end. For one spectrum, not for a batch."""
        return int(self.status) == Status.SUCCESS

    @property
    def message(self) -> str:
        """A sentence on how the run ended, and on what it does not determine about the exponents."""
        return " ".join([self._ending, *self._doubts])

    @property
    def limits(self) -> Limits:
        """The limits of the exponents, from a fit of λ + a/t to the rates, and which are distinguished from zero."""
        rates, errors = np.asarray(self.rates, float), np.asarray(self.standard_error, float)
        return limits_of(float(self.start), np.asarray(self.times, float), rates, errors)

    @property
    def told_from_zero(self) -> Bool[np.ndarray, " k"]:
        """Which exponents the run distinguishes from zero, see :class:`~jaxball.analysis.chaos.result.Limits`. Not for
        a batch.
        """
        return self.limits.told

    @property
    def _ending(self) -> str:
        return Status(int(self.status)).sentence(float(self.reached), float(self.times[-1]), alone=True)

    @property
    def _doubts(self) -> list[str]:
        return sentences(self.limits) if self.ok else []

    @property
    def dimension(self) -> float:
        """The Kaplan–Yorke dimension: how many exponents sum to zero, with a fraction of the last.

        NaN if the spectrum has too few exponents.
        """
        exponents = np.asarray(self.exponents)
        sums = np.cumsum(exponents)
        if np.any(np.isnan(sums)):
            return float("nan")
        j = int(np.argmax(sums < 0)) if np.any(sums < 0) else -1
        if j < 0:
            # All exponents together are not negative: the attractor fills the space, or exponents are missing.
            return float(len(sums)) if len(sums) == self.vectors.shape[-1] else float("nan")
        return float(j + (sums[j - 1] if j else 0.0) / abs(exponents[j]))

    def raise_if_failed(self) -> "LyapunovSpectrum":
        """Returns the spectrum itself, or raises a :class:`~jaxball.SolveError` with the message."""
        if not self.ok:
            raise SolveError(self.message)
        return self

    def __repr__(self) -> str:
        if not is_single(self.status):
            return format_value(self)
        title, values, errors = self._numbers_to_print()
        # As many digits as the smallest error has in two, so that none is printed as 0.
        smallest = np.min(errors, where=errors > 0, initial=1.0)
        digits = max(6, 1 - math.floor(math.log10(smallest)))
        # Rounded before, and 0 added, so that none is printed as −0.
        pairs = enumerate(zip(np.round(values, digits) + 0.0, errors, strict=True), start=1)
        lines = [f"  λ{i} = {value: .{digits}f} ± {error:.{digits}f}" for i, (value, error) in pairs]
        if self.least_normal_force is not None:
            lines.append(f"  least normal force {float(self.least_normal_force):.6g} (at the ends of the steps)")
        return "\n".join([title, *lines, *(f"  {line}" for line in (self._ending, *self._doubts))])

    def _numbers_to_print(self) -> tuple[str, Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """Returns a title, the exponents and errors that hold: the fitted limits, if the run has enough intervals."""
        limits, solve_error = self.limits, float(self.solve_error)
        if not np.any(np.isnan(limits.limits)):
            return "Lyapunov exponents, limits of the growth rates", limits.limits, limits.errors + solve_error
        errors = np.asarray(self.standard_error, float) + solve_error
        return "Lyapunov exponents, means of the growth rates", np.asarray(self.exponents, float), errors

    @leave_to("...plot.chaos:lyapunov_convergence")
    def plot(self, ax: "matplotlib.axes.Axes | None" = None) -> "matplotlib.axes.Axes":
        """Draws the running means of the Lyapunov exponents over time.

        **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
        """
        raise NotImplementedError
