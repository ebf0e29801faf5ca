"""What all sensors share: their contract, where they are mounted, their errors, and several readings as one vector.

Kinds of sensors derive from ``AbstractSensor``; filters, environments and scenario files read several by a
``Measurement``. Noise, biases, delays and losses turn exact readings into those of a real sensor.

A sensor is on the shell, on a link of a mechanism or on a mass. A position on a link is given like those of joints and
carried masses: from the geometric centre, in body axes, where every θ is 0. A position on a mass is given from the
mass. The axes are those of the body where every θ is 0, and turn with the link; a mass on a rail, or of a mechanism
given by a function, has no axes of its own and keeps those of the body.
"""

import abc
import re
import zlib
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ... import programs
from ...interface.arguments import refusal, require
from ...interface.compat import is_traced
from ...interface.printing import Printed
from ...interface.wording import did_you_mean
from ...numerics.arrays import numbers
from ...numerics.calculus import two_derivatives
from ...numerics.declare import number
from ..body import AbstractBody, System
from ..dynamics.moments import kinematics
from ..mechanisms import Mechanism
from ..mechanisms.mechanism import EachJoint
from ..observables import Movement, movement
from ..prescribed.motion import Kinematics
from ..state import PlacedState, Rates, RotationState

# Times that differ by less, in spans of the run, are the same: more than rounding, less than any interval.
SAME_TIME = 1e-9


class SensorErrors(Printed):
    """The errors of a sensor: each reading is exact + bias + random walk + noise, and some are late or lost.

    All random numbers are Gaussian, and independent of each other and of those of other sensors.

    **Arguments:**

    - ``noise``: the standard deviation of white noise of each component, in the unit of the reading.
    - ``bias``: a constant error, one number, or one for each component, in the unit of the reading.
    - ``random_walk``: the standard deviation of the change of the bias since the start, over the square root of the
      time, in the unit of the reading over √time.
    - ``rate``: how many readings are taken in a unit of time, the first at the start of the run, 1/time; if not given,
      one at every saved time.
    - ``delay``: how long after it is taken a reading arrives, a time.
    - ``missing``: the probability that a reading is lost.
    - ``seed``: the seed of the random numbers. Sensors with different names have different ones anyway.

    **Raises:** ``ValueError`` for a negative number, a rate of 0 and a probability above 1.

    **Example:**

    >>> from jaxball import Ball, simulate
    >>> from jaxball.physics.sensors import Gyroscope, SensorErrors
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


_ON = re.compile(r"(masses|mechanisms)\[(\d+)\](?:\.(joints|masses)\[(\d+)\])?")


class AbstractSensor(Printed):
    """A sensor that reads the motion of a ball or a disk at one moment.

    A kind of sensor implements ``reading``, and ``places`` if its field ``on`` names what it is mounted on. ``units``
    and ``meaning`` describe its reading in files and figures. Every kind takes

    - ``errors``: what distinguishes what arrives from the exact reading; nothing if not given. :class:`SensorErrors`.
    """

    errors: SensorErrors | None = eqx.field(kw_only=True, default=None)

    units: ClassVar[str] = ""
    meaning: ClassVar[str] = "reading of a sensor"

    @abc.abstractmethod
    def reading(self, system: AbstractBody, t: Float[Array, ""], movement: Movement) -> Float[Array, "..."]:
        """Returns the sensor's reading for this motion of a body; ``system`` is prepared."""

    @classmethod
    def places(cls, system: AbstractBody) -> tuple[str, ...]:
        """Returns the names of the parts of a body that the sensor can be on."""
        return ()

    def require_on(self, system: AbstractBody, name: str) -> None:
        """Raises a ``ValueError`` unless the body has the part that it is on; ``name`` is the name of the sensor."""
        on = getattr(self, "on", None)
        places = self.places(system)
        if on is None or on in places:
            return
        hint = f"it can be on {', '.join(places)}" if places else "there is no part that it can be on"
        raise ValueError(
            f"Argument `{name}.on` must be a part of this {system.title}, but it is {on!r}"
            f"{did_you_mean(on, places, hint)}"
        )


def require_sensors(sensors: Any, system: Any) -> None:
    """Raises unless the argument ``sensors`` has sensors by name that fit the body.

    **Raises:** ``TypeError`` for anything else, ``ValueError`` where the body lacks the part that one is on.
    """
    if not isinstance(sensors, Mapping):
        raise refusal("sensors", 'a dictionary of sensors by name, such as {"gyro": Gyroscope()}', sensors)
    for name, sensor in sensors.items():
        require(f"sensors[{name!r}]", sensor, AbstractSensor, "a sensor, such as Accelerometer(...)")
        must = "a SensorErrors, or None"
        require(f"sensors[{name!r}].errors", sensor.errors, (SensorErrors, type(None)), must)
        sensor.require_on(system, f"sensors[{name!r}]")


class Measurement(Printed):
    """The readings of sensors one after the other, in the order of their names.

    - ``sensors``: by name.
    """

    sensors: dict[str, AbstractSensor]

    def parts(self, system: Any, t: Float[Array, ""], state: Any) -> dict[str, Float[Array, "..."]]:
        """Computes the exact reading of each sensor, of a body or, with its modes, of the system that was solved."""
        prepared = system.prepare()
        moves = movement(prepared, t, state.in_space() if isinstance(state, RotationState) else state)
        return {name: sensor.reading(prepared.shown, t, moves) for name, sensor in self.sensors.items()}

    def __call__(self, system: Any, t: Float[Array, ""], state: Any) -> Float[Array, " m"]:
        """Computes all exact readings; arguments as for :meth:`parts`."""
        return jnp.concatenate([jnp.ravel(part) for part in self.parts(system, t, state).values()])

    def sizes(self, system: System, state: PlacedState) -> dict[str, int]:
        """Counts the components that each sensor reads, in the order of the measurement."""
        parts = jax.eval_shape(lambda s: self.parts(system, jnp.zeros(()), s), state)
        return {name: int(np.prod(parts[name].shape)) for name in self.sensors}


def measurement_of(sensors: Mapping[str, AbstractSensor], system: System) -> Measurement:
    """Returns the measurement of sensors whose noise is known.

    **Raises:** ``TypeError`` for anything but sensors by name; ``ValueError`` for none, for one that does not fit the
    body, and for one without noise.
    """
    require_sensors(sensors, system)
    if not sensors:
        raise ValueError("Argument `sensors` must have one sensor or more, but it is empty.")
    for name, sensor in sensors.items():
        noise = None if sensor.errors is None else sensor.errors.noise
        if noise is None or not (is_traced(noise) or np.asarray(noise) > 0):
            raise ValueError(
                f"Argument `sensors[{name!r}]` must have noise, because a filter weighs readings by it, but it has "
                "none; give it errors=SensorErrors(noise=...)."
            )
    return Measurement(dict(sorted(sensors.items())))  # as JAX orders dictionaries


class Mount(NamedTuple):
    """A mount in the body: the rotation from its axes to those of the body, its rate in the body, and its position."""

    turn: Float[Array, "3 3"]
    rate: Float[Array, "3"]
    point: Kinematics


def mounts(system: AbstractBody) -> tuple[str, ...]:
    """Returns the names of the parts that a mount can be on, besides the shell."""
    names = [f"masses[{index}]" for index in range(system.n_masses)]
    for index, mechanism in enumerate(system.mechanisms):
        joints = range(mechanism.n_joints if isinstance(mechanism, Mechanism) else 0)
        names += [f"mechanisms[{index}].joints[{a}]" for a in joints]
        names += [f"mechanisms[{index}].masses[{i}]" for i in range(mechanism.mass.shape[-1])]
    return tuple(names)


def mount(system: AbstractBody, t: Float[Array, ""], angles: Rates, on: str | None, at: Float[Array, "3"]) -> Mount:
    """Returns the mount at ``at`` on a part of the body, None for the shell; ``angles`` are θ, θ̇ and θ̈ of
    the state.
    """
    still, upright = jnp.zeros_like(at), jnp.eye(3, dtype=at.dtype)
    if on is None:
        return Mount(upright, still, Kinematics(at, still, still))
    kind, index, part, number = parts(on)
    if kind == "masses":
        return Mount(upright, still, _beside(system, t, angles, index, at))
    mechanism = system.mechanisms[index]
    if not isinstance(mechanism, Mechanism):
        before = sum(predecessor.mass.shape[-1] for predecessor in system.mechanisms[:index])
        return Mount(upright, still, _beside(system, t, angles, system.n_masses + before + number, at))
    # A mass of a mechanism is on the link that carries it.
    link = number if part == "joints" else mechanism.carrier[number]
    return _on_link(
        mechanism, joint_rates(system, t, angles, index), link, at if part == "joints" else at + mechanism.place[number]
    )


def parts(on: str) -> tuple[str, int, str, int]:
    """Returns the kind and index of the part that a sensor is on, and the part within a mechanism."""
    match = _ON.fullmatch(on)
    assert match is not None
    kind, index, part, number = match.groups()
    return kind, int(index), part or "", int(number or 0)


def joint_rates(system: AbstractBody, t: Float[Array, ""], angles: Rates, index: int) -> EachJoint:
    """Returns θ, θ̇ and θ̈ of every joint of a mechanism."""
    mechanism = system.mechanisms[index]
    places = system.slots((index,), mechanism.in_state)[0]
    return mechanism.rates(t, (angles[0][places], angles[1][places], angles[2][places]))


def _beside(
    system: AbstractBody, t: Float[Array, ""], angles: Rates, row: int, offset: Float[Array, "3"]
) -> Kinematics:
    """Computes the position in the body, with its rates, of a point at a constant distance from a mass."""
    chi, chidot, chiddot = (values[row] for values in kinematics(system, t, angles))
    return Kinematics(chi + offset, chidot, chiddot)


def _on_link(mechanism: Mechanism, rates: EachJoint, link: int, point: Float[Array, "3"]) -> Mount:
    theta, thetadot, thetaddot = rates

    # A curve with these derivatives at s = 0 gives velocity and acceleration without writing out the chain of joints.
    def place_link(s: Float[Array, ""]) -> Float[Array, "4 3"]:
        """Places the link and the point, along a motion with these rates: a rotation and a position."""
        placement = mechanism.links(theta + s * thetadot + s**2 / 2 * thetaddot)[link].placement
        return jnp.concatenate([placement.turn, placement.of_point(point)[None]])

    place, velocity, acceleration = two_derivatives(place_link, jnp.zeros((), point.dtype))
    turn = place[:3]
    spin = jnp.sum(velocity[:3, None, :] * turn[None, :, :], axis=-1)  # ŵ = Ṙ Rᵀ
    return Mount(
        turn, jnp.stack([spin[2, 1], spin[0, 2], spin[1, 0]]), Kinematics(place[3], velocity[3], acceleration[3])
    )
