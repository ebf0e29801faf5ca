"""A Lyapunov spectrum, and how it converged."""

import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..interface.printing import Printed, is_single, shown
from ..interface.status import SolveError, Status
from .convergence import Limits, limits_of, sentences


class LyapunovSpectrum(Printed):
    """Lyapunov exponents and their convergence. NaN after the time that the solve reached.

    - ``exponents``: the mean growth rates over the run without its transient, shape (k,), in 1/time, the largest first;
      all other arrays follow this order.
    - ``standard_error``: of each exponent, from the scatter of its means over sixteen parts of the run. It estimates
      how far a chaotic run is from its limit; for a regular run, whose means converge as log(t)/t, it says little, and
      ``told_from_zero`` and ``limits`` say more.
    - ``times``: the ends of the intervals, shape (n,).
    - ``rates``: the growth rates within each interval, shape (n, k).
    - ``running``: the means of the rates from the end of the transient to each of ``times``, shape (n, k).
    - ``x``: the state at the end, as the solver's vector.
    - ``vectors``: the orthonormal vectors at the end, a row for each exponent.
    - ``least_normal_force``: the least N of a rolling body over the whole run, including the transient; if it is not
      positive, the ball would have left the plane. None for other flows.
    - ``status``, ``reached``, ``steps``: as in a :class:`~jaxball.Trajectory`; ``ok`` and ``message`` read them.
    - ``start``: when the run began, including the transient.
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
        """Which exponents the run distinguishes from zero, see :class:`~jaxball.chaos.Limits`. Not for a batch."""
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
        if not np.all(np.isfinite(sums)):
            return float("nan")
        j = int(np.argmax(sums < 0)) if np.any(sums < 0) else -1
        if j < 0:
            return float(len(sums)) if len(sums) == self.vectors.shape[-1] else float("nan")
        return float(j + (sums[j - 1] if j else 0.0) / abs(exponents[j]))

    def raise_if_failed(self) -> "LyapunovSpectrum":
        """The spectrum itself, or a :class:`~jaxball.SolveError` with the message."""
        if not self.ok:
            raise SolveError(self.message)
        return self

    def __repr__(self) -> str:
        if not is_single(self.status):
            return shown(self)
        pairs = zip(np.asarray(self.exponents), np.asarray(self.standard_error), strict=True)
        lines = [f"  λ{i} = {value: .6f} ± {error:.6f}" for i, (value, error) in enumerate(pairs, start=1)]
        if self.least_normal_force is not None:
            lines.append(f"  least normal force {float(self.least_normal_force):.6g} (at the ends of the steps)")
        return "\n".join(["Lyapunov exponents", *lines, *(f"  {line}" for line in (self._ending, *self._doubts))])
