"""How far ahead the result of a run can be trusted."""

import math

import numpy as np

from .case import Case
from .report import ERROR_ALLOWED, Trust

LEAST_ERROR = 1e-16


def trust(case: Case) -> Trust | None:
    """What the growth of small deviations means for the error; None where there is no precise run to tell.

    With G their growth over the run of length T, log(G) / T is the finite-time Lyapunov exponent, and an error is
    taken to go on growing at that rate. In a regular motion deviations grow as time does and the exponent falls as
    log(T) / T, so that the error stays small for longer than this says.
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
