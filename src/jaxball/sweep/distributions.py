"""Distributions of a number, by their inverse cumulative distribution functions."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..scenario.table import Key, read_one_of
from ..scenario.values import Numbers, key_error, shown

# The smallest and the largest number of 53 random bits, moved off 0 and 1, where the normal quantile is infinite.
_EDGE = 2.0**-54

_PAIR = Key(Numbers((2,)))


def _normal(u: np.ndarray) -> np.ndarray:
    # Imported here, because it belongs to the extra `sweep`.
    from scipy.special import ndtri

    return ndtri(np.clip(u, _EDGE, 1 - _EDGE))


_INVERSES: Mapping[str, Callable[[np.ndarray, float, float], np.ndarray]] = {
    "uniform": lambda u, low, high: low + (high - low) * u,
    "log-uniform": lambda u, low, high: low * (high / low) ** u,
    "normal": lambda u, mean, deviation: mean + deviation * _normal(u),
    "lognormal": lambda u, median, deviation: median * np.exp(deviation * _normal(u)),
}
DISTRIBUTIONS = {name: {name: _PAIR} for name in _INVERSES}


@dataclass(frozen=True)
class Distribution:
    """A distribution of a number.

    - ``uniform``: between two numbers;
    - ``log-uniform``: between two positive numbers, its logarithm uniform;
    - ``normal``: mean and standard deviation;
    - ``lognormal``: median, and the standard deviation of the logarithm.
    """

    kind: str
    first: float
    second: float

    def inverse(self, u: np.ndarray) -> np.ndarray:
        """The quantiles of the distribution at ``u``, 0 ≤ u < 1."""
        return _INVERSES[self.kind](u, self.first, self.second)


def read_distribution(values: Any, path: str) -> Distribution:
    """The distribution that a table such as ``{ normal = [0.0, 0.1] }`` describes.

    **Raises:** :class:`~jaxball.scenario.ScenarioError` for an unknown distribution, and for invalid parameters.
    """
    kind, table = read_one_of(values, path, DISTRIBUTIONS)
    first, second = map(float, table[kind])
    path, got = f"{path}.{kind}", shown(values[kind])
    if kind in ("uniform", "log-uniform") and not first < second:
        raise key_error(path, "two numbers, the smaller one first", got)
    if kind == "log-uniform" and not first > 0:
        raise key_error(path, "two positive numbers", got)
    if kind in ("normal", "lognormal") and not second > 0:
        raise key_error(path, "a number and a positive standard deviation", got)
    if kind == "lognormal" and not first > 0:
        raise key_error(path, "a positive median and a positive standard deviation", got)
    return Distribution(kind, first, second)
