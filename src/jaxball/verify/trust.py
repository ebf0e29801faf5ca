"""How far ahead the result of a run can be trusted."""

import dataclasses
import math

import numpy as np

from .case import Case

ERROR_ALLOWED = 1e-3
LEAST_ERROR = 1e-16


@dataclasses.dataclass(frozen=True)
class Trust:
    """How far ahead a result can be trusted.

    Errors are relative to 1 + |x|, component by component, like the tolerances if both are equal.

    - ``error``: the largest error of the run, measured against a run at a tolerance of 1e-13.
    - ``growth``: the largest factor by which a small deviation of the initial state grows in the run.
    - ``lyapunov_time``: the time in which it grows e-fold on average, the inverse of the finite-time Lyapunov exponent.
    - ``horizon``: the time at which the error reaches 1e-3. Beyond the end of the run it is extrapolated with the mean
      growth rate, and is too early where the motion is regular.
    - ``end``: when the run ended.
    """

    error: float
    growth: float
    lyapunov_time: float
    horizon: float
    end: float

    def __repr__(self) -> str:
        growth = f"{self.growth:.3g}-fold, e-fold in {self.lyapunov_time:.3g}"
        reached = self.horizon <= self.end
        bound = f"reaches {ERROR_ALLOWED:g} at" if reached else f"stays below {ERROR_ALLOWED:g} until"
        return f"error {self.error:.1e}; small deviations grow {growth}; the error {bound} t = {self.horizon:.3g}"


def trust(case: Case) -> Trust | None:
    """How far ahead the run can be trusted, from its error and the growth of small deviations.

    With their growth G over a run of length T, log(G) / T is the finite-time Lyapunov exponent, and the error is
    extrapolated at that rate. In a regular motion deviations grow linearly in time and the exponent falls as
    log(T) / T, so the error stays small for longer than this says. None where the reference run failed.
    """
    if not case.reference.ok:
        return None
    times = np.asarray(case.scenario.times)
    errors = np.maximum.accumulate(case.errors)
    error, growth = float(errors[-1]), float(np.max(case.growth))
    lyapunov_time = float(times[-1] - times[0]) / math.log(growth) if growth > 1 else math.inf
    late = ~(errors <= ERROR_ALLOWED)
    if late.any():
        horizon = float(times[int(np.argmax(late))])
    else:
        horizon = float(times[-1]) + lyapunov_time * math.log(ERROR_ALLOWED / max(error, LEAST_ERROR))
    return Trust(error=error, growth=growth, lyapunov_time=lyapunov_time, horizon=horizon, end=float(times[-1]))
