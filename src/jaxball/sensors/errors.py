"""The errors of sensors: noise, biases, delays and losses, which turn exact readings into those of a real sensor."""

import zlib
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .. import programs
from ..compat import is_traced
from ..interface.arguments import refusal, require
from ..interface.printing import Printed
from ..numerics.arrays import numbers
from ..numerics.declare import number

# Times that differ by less, in spans of the run, are the same: more than rounding, less than any interval.
SAME_TIME = 1e-9


class SensorErrors(Printed):
    """The errors of a sensor: each reading is exact + bias + random walk + noise, and some are late or lost.

    All random numbers are Gaussian, and independent of each other and of those of other sensors.

    **Arguments:**

    - ``noise``: the standard deviation of white noise of each component, in the units of the reading.
    - ``bias``: a constant error, in the same units: a number, or one for each component.
    - ``random_walk``: how fast the bias wanders from its value at the start: the standard deviation of its change
      divided by the square root of the time in which it changes.
    - ``rate``: how many readings are taken in a unit of time, the first at the start of the run; if not given, one at
      every saved time.
    - ``delay``: how long after it is taken a reading arrives, a time.
    - ``missing``: the probability that a reading is lost.
    - ``seed``: of the random numbers; sensors with different names have different ones anyway.

    **Raises:** ``ValueError`` for a negative number, a rate of 0 and a probability above 1.

    **Example:**

    >>> from jaxball import Ball, simulate
    >>> from jaxball.sensors import Gyroscope, SensorErrors
    >>> run = simulate(Ball(mass=1.0, inertia=(0.4, 0.4, 0.4)), [0.0, 0.5, 1.0, 1.5, 2.0])
    >>> slow = Gyroscope(errors=SensorErrors(bias=0.1, rate=1.0, delay=0.5))
    >>> run.measured({"slow": slow})["slow"][:, 2]
    Array([nan, 0.1, nan, 0.1, nan], dtype=float64)
    """

    noise: Float[Array, ""] = eqx.field(converter=number(), default=0.0)
    bias: Float[Array, " components"] = eqx.field(converter=lambda x: _in_list(x), default=0.0)
    random_walk: Float[Array, ""] = eqx.field(converter=number(), default=0.0)
    rate: float | None = eqx.field(static=True, default=None)
    delay: float = eqx.field(static=True, default=0.0)
    missing: Float[Array, ""] = eqx.field(converter=number(), default=0.0)
    seed: Int[Array, ""] = eqx.field(converter=lambda x: _whole("seed", x), default=0)

    def __check_init__(self):
        require("rate", self.rate, (int, float, type(None)), "a positive number, or None for a reading at each time")
        require("delay", self.delay, (int, float), "a number")
        for name, must, holds in [
            ("noise", "0 or positive", lambda x: x >= 0),
            ("random_walk", "0 or positive", lambda x: x >= 0),
            ("rate", "positive", lambda x: x is None or x > 0),
            ("delay", "0 or positive", lambda x: x >= 0),
            ("missing", "a probability, from 0 to 1", lambda x: 0 <= x <= 1),
        ]:
            value = getattr(self, name)
            if not is_traced(value) and not holds(value):
                raise ValueError(f"Argument `{name}` must be {must}, but it is {value}.")

    def apply(
        self, times: Float[Array, " T"], exact: Float[Array, "T *components"], key: Any
    ) -> Float[Array, "T *components"]:
        """Applies the errors to exact readings at ``times``: what has arrived at each time, NaN where nothing has."""
        of_walk, of_noise, of_losses = jax.random.split(key, 3)
        # A walk spreads by the root of time, whatever the steps between saved times.
        roots = jnp.concatenate([jnp.zeros((1,), times.dtype), jnp.sqrt(jnp.diff(times))])
        roots = roots.reshape(-1, *(1,) * (exact.ndim - 1))
        wandered = self.random_walk * jnp.cumsum(roots * jax.random.normal(of_walk, exact.shape, exact.dtype), axis=0)
        white = self.noise * jax.random.normal(of_noise, exact.shape, exact.dtype)
        bias = self.bias[0] if self.bias.size == 1 else self.bias[None]
        lost = jax.random.uniform(of_losses, times.shape, times.dtype) < self.missing
        place, arrives = self.arrivals(times)
        there = (arrives & ~lost).reshape(roots.shape)
        return jnp.where(there, (exact + bias + wandered + white)[place], jnp.nan)

    def arrivals(self, times: Float[Array, " T"]) -> tuple[Int[Array, " T"], Bool[Array, " T"]]:
        """Returns for each time whether a reading arrives then, and the place of the time at which it was taken."""
        # Relative to the run, for any unit of time.
        close = SAME_TIME * (times[-1] - times[0])
        reading_times = times - self.delay
        # `close` earlier, so that a time that rounding has put just below the reading's still counts.
        place = jnp.clip(jnp.searchsorted(times, reading_times - close), 0, times.size - 1)
        arrives = jnp.abs(times[place] - reading_times) <= close
        if self.rate is not None:
            turns = (times[place] - times[0]) * self.rate
            # Taken at multiples of 1/rate only: a whole number of turns since the start.
            arrives &= jnp.abs(turns - jnp.round(turns)) <= close * self.rate
        return place, arrives

    def require_times(self, name: str, times: Float[np.ndarray, " T"]) -> None:
        """Raises a ``ValueError`` unless readings are taken and arrive at saved times; ``name`` is the sensor's."""
        close = SAME_TIME * (times[-1] - times[0])
        reading_times = times
        if self.rate is not None:
            # Up to the last one within the run, in spite of rounding.
            reading_times = times[0] + np.arange(int((times[-1] - times[0] + close) * self.rate) + 1) / self.rate
        for what, needed in (("is taken", reading_times), ("arrives", reading_times + self.delay)):
            # Those after the end never come.
            needed = needed[needed <= times[-1] + close]
            gaps = np.min(np.abs(times[:, None] - needed[None]), axis=0, initial=np.inf)
            if needed.size and np.max(gaps) > close:
                raise ValueError(
                    f"Argument `{name}` must have readings at saved times, but one {what} at "
                    f"t = {needed[np.argmax(gaps > close)]:.6g}, which is none of them; save the run at more times, or "
                    "change `rate` or `delay`."
                )


def with_errors(
    errors: Mapping[str, SensorErrors | None], times: Float[Array, "*runs T"], exact: dict[str, Array], key: Any
) -> dict[str, Array]:
    """Returns the readings that arrive, with errors, of exact readings by name, at the times of a run or of each run of
    a batch.

    **Raises:** ``TypeError`` for a key that is none, ``ValueError`` for readings between saved times and for a bias
    with another number of components than the reading.
    """
    wrong = {name: sensor_errors for name, sensor_errors in errors.items() if sensor_errors is not None}
    if not wrong:
        return exact
    for name, sensor_errors in wrong.items():
        components = exact[name].shape[times.ndim :]
        if sensor_errors.bias.size != 1 and sensor_errors.bias.shape != components:
            raise ValueError(
                f"Argument `sensors[{name!r}].errors.bias` must be a number or have one for each component of the "
                f"reading, whose shape is {components}, but it has {sensor_errors.bias.size}."
            )
        if not is_traced(times):
            for row in np.unique(np.asarray(times).reshape(-1, times.shape[-1]), axis=0):
                sensor_errors.require_times(f"sensors[{name!r}].errors", row)
    applied = _apply_all
    keys = random_key(key)
    if times.ndim > 1:
        # Each run of a batch has errors of its own.
        keys, applied = jax.random.split(keys, times.shape[:-1]), eqx.filter_vmap(_apply_all, in_axes=(None, 0, 0, 0))
    return exact | applied(wrong, times, {name: exact[name] for name in wrong}, keys)


@programs.filter_jit
def _apply_all(errors: dict[str, SensorErrors], times: Array, exact: dict[str, Array], key: Any) -> dict[str, Array]:
    return {
        name: sensor_errors.apply(times, exact[name], key_of(name, sensor_errors, key))
        for name, sensor_errors in errors.items()
    }


def key_of(name: str, errors: SensorErrors, key: Any) -> Any:
    """Returns the random key of the sensor with this name, made from one key for all sensors."""
    return key_of_name(name, jax.random.fold_in(key, errors.seed))


def key_of_name(name: str, key: Any) -> Any:
    """Returns the random key that belongs to a name, made from one key for all names."""
    # By name, so that a further one changes no other's draws, and not by place, because JAX reorders dictionaries;
    # crc32, because Python's hash differs in each process.
    return jax.random.fold_in(key, zlib.crc32(name.encode()))


def random_key(key: Any) -> Any:
    if key is None:
        return jax.random.key(0)
    if isinstance(key, jax.Array) and jnp.issubdtype(key.dtype, jax.dtypes.prng_key) and key.shape == ():
        return key
    # The keys of `jax.random.PRNGKey`.
    if isinstance(key, jax.Array) and key.dtype == jnp.uint32 and key.ndim == 1:
        return jax.random.wrap_key_data(key)
    raise refusal("key", "a random key, such as jax.random.key(0), or None", key)


def _whole(name: str, x: Any) -> Int[Array, ""]:
    """Returns a whole number as an array, which may be traced."""
    if isinstance(x, jax.Array | np.ndarray) and jnp.issubdtype(x.dtype, jnp.integer) and x.ndim == 0:
        return jnp.asarray(x)
    require(name, x, int, "a whole number")
    return jnp.asarray(x)


def _in_list(x: Any) -> Float[Array, " components"]:
    # A number for all components has the same shape as one for each.
    return numbers("bias", ("n",))(x if np.ndim(x) else [x])
