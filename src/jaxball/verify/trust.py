"""How far ahead the result of a run can be trusted."""

import math

import numpy as np

from .case import Case
from .report import ERROR_ALLOWED, Trust

POLYNOMIAL = 2.0  # the highest power of time at which deviations grow where the motion is regular, and one more


def trust(case: Case) -> Trust | None:
    """What the growth of small deviations means for the error; None where there is no precise run to tell.

    Between the middle and the end of the run a power t^p grows 2^p-fold. What grows more than fourfold counts as
    exponential, with the mean rate over that half; regular motions have p = 1.
    """
    if not case.reference.ok:
        return None
    times = case.scenario.times - case.scenario.times[0]
    growth, errors = np.maximum.accumulate(case.growth), np.maximum.accumulate(case.errors)
    middle = int(np.argmin(np.abs(times - times[-1] / 2)))
    doubled = math.log(growth[-1] / growth[middle]) if np.isfinite(growth[-1]) else math.nan
    exponential = doubled > POLYNOMIAL * math.log(2.0)
    rate = doubled / (times[-1] - times[middle]) if exponential else 0.0
    start, end = float(case.scenario.times[0]), float(case.scenario.times[-1])
    late = errors > ERROR_ALLOWED
    ahead = math.log(ERROR_ALLOWED / max(float(errors[-1]), 1e-300))
    if late.any():
        horizon = float(case.scenario.times[int(np.argmax(late))])
    elif exponential:
        horizon = end + ahead / rate
    else:
        power = max(doubled / math.log(2.0), 1.0)
        horizon = start + (end - start) * math.exp(ahead / power)
    return Trust(
        error=float(errors[-1]),
        growth=float(growth[-1]),
        lyapunov_time=1 / rate if exponential else math.inf,
        horizon=horizon,
        end=end,
    )
