"""An extended Kalman filter on the manifold of states: the error-state filter.

Users call it on a log of readings; ``OutputFeedback`` predicts and updates with it sample by sample, and scenario files
build it for their estimator.

The estimate is a state and the biases of sensors; its error is a vector, the local coordinates of the true state around
the estimated one and then the errors of the biases, and has a covariance. Between samples the state follows the exact
flow of the simulation, and the covariance the derivative of that flow. Source: Solà, Deray & Atchuthan, *A micro Lie
theory for state estimation in robotics* (2018), arXiv:1812.01537; Joseph's form of the update and the normalised
innovations as in Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001).
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ... import programs
from ...interface.arguments import refusal, require
from ...interface.compat import is_traced
from ...interface.printing import Printed
from ...interface.wording import did_you_mean, number_of
from ...numerics.arrays import Numbers, default_dtype, to_array
from ...physics.body import Ball, Disk, System
from ...physics.contact.history import ContactHistory
from ...physics.contact.law import Contact
from ...physics.contact.modes import ContactState
from ...physics.contact.released import ReleasedState
from ...physics.contact.slipping import Estimated, SlippingState
from ...physics.sensors import AbstractSensor
from ...physics.sensors.base import SAME_TIME, Measurement, measurement_of
from ...physics.state import PlacedState
from ...physics.system import require_one_state
from ...simulation import DEFAULT_TOLERANCE
from ...simulation.arguments import require_single
from ...simulation.trajectory import Trajectory
from ..sampled import SampledSystem, in_words, null_space, reachability_factor
from ..slipping import body_of, follow, moving, of_rolling, with_law
from ..weights import by_name
from .estimate import Belief, Estimate, Filtered, propagate, symmetric


class Reading(NamedTuple):
    """The readings at one sample, and which of them there are; those that are missing are 0."""

    y: Float[Array, " m"]
    there: Bool[Array, " m"]


class ErrorStateFilter(Printed):
    """Estimates the state of a robot, and the biases of its sensors, from what the sensors read.

    **Arguments** of :meth:`of`, which makes one:

    - ``system``: the robot as the filter knows it, a :class:`~jaxball.Ball` or a :class:`~jaxball.Disk`. Schedules,
      springs and the like act on it as they do in a simulation.
    - ``sensors``: by name, each with :class:`~jaxball.physics.sensors.SensorErrors` whose ``noise`` is positive. A bias
      is estimated for those that have a ``random_walk`` or stand in ``biases``; the value of ``errors.bias``, which a
      robot does not know, is not used.
    - ``sample``: the time between samples.
    - ``inputs``: the names of efforts and accelerations that are known at each sample, as for a
      :class:`~jaxball.control.sampled.SampledSystem`; by default none.
    - ``process``: how much the motion differs from that of the simulation: the standard deviation of the change of
      local coordinates in a unit of time, by name, as in ``{"Omega": 0.05}``; by default 0.
    - ``biases``: the standard deviations of biases at the start, by the name of the sensor, in units of its reading.
    - ``contact``: a :class:`~jaxball.Contact`, with which the robot may slip, fly and land; it always rolls without.
      ``slip``, ``rise`` and ``height`` are then among the names of errors, and known to be 0 where it rolls.
    - ``rtol``, ``atol``: tolerances of the solve of a sample.

    Its fields are

    - ``sampled``: the robot, with inputs that are held over a sample.
    - ``measurement``: what the sensors read of a state.
    - ``spread_of_biases``: the standard deviations of biases at the start, by the names of their sensors.

    **Raises:** ``TypeError`` and ``ValueError`` for sensors without noise, unknown names and negative numbers.

    **Example:**

    >>> import jax
    >>> import jax.numpy as jnp
    >>> jax.config.update("jax_enable_x64", True)
    >>> from jaxball import Disk, DiskState, simulate
    >>> from jaxball.control.estimation import ErrorStateFilter
    >>> from jaxball.physics.sensors import Gyroscope, SensorErrors
    >>> disk = Disk(mass=1.0, inertia=0.5)
    >>> sensors = {"gyro": Gyroscope(errors=SensorErrors(noise=0.1))}
    >>> run = simulate(disk, jnp.linspace(0.0, 1.0, 101), DiskState(phidot=-1.0))
    >>> known = ErrorStateFilter.of(disk, sensors, sample=0.01)
    >>> estimate = known(run.measured(sensors), DiskState(), {"phidot": 1.0})
    >>> round(float(estimate.deviations["phidot"][-1]), 3)  # 0.1/√101, because the rate does not change
    0.01
    >>> known.unobservable(DiskState(), samples=10)
    ('phi', 'z')
    """

    sampled: SampledSystem
    measurement: Measurement
    process: Float[Array, " n"]
    spread_of_biases: dict[str, Float[Array, ""]]

    @classmethod
    def of(
        cls,
        system: System,
        sensors: Mapping[str, AbstractSensor],
        sample: Numbers,
        *,
        inputs: Sequence[str] = (),
        process: Mapping[str, Numbers] | None = None,
        biases: Mapping[str, Numbers] | None = None,
        contact: Contact | None = None,
        rtol: Numbers = DEFAULT_TOLERANCE,
        atol: Numbers = DEFAULT_TOLERANCE,
    ) -> "ErrorStateFilter":
        """Builds the filter of a robot and its sensors; its arguments stand above."""
        require("system", system, (Ball, Disk), "a Ball or a Disk")
        if inputs:
            sampled = SampledSystem.of(system, sample, inputs, rtol, atol)
        else:
            sampled = SampledSystem.without_inputs(system, sample, rtol, atol)
        return cls.for_sampled_system(with_law(sampled, contact), sensors, process, biases)

    @classmethod
    def for_sampled_system(
        cls,
        sampled: SampledSystem,
        sensors: Mapping[str, AbstractSensor],
        process: Mapping[str, Numbers] | None = None,
        biases: Mapping[str, Numbers] | None = None,
    ) -> "ErrorStateFilter":
        """Builds the filter of a sampled system; arguments as for :meth:`of`."""
        measurement = measurement_of(sensors, sampled.system)
        rates = to_array(by_name("process", process or {}, _directions(sampled)), "process")
        require_not_negative("process", rates)
        # A bias that wanders is estimated even if it is known at the start.
        spread = {name: 0.0 for name, sensor in sensors.items() if wanders(sensor)} | dict(biases or {})
        for name in spread:
            if name not in sensors:
                there = f"the sensors are {', '.join(sensors)}"
                raise ValueError(
                    f"Argument `biases` names {name!r}, which is no sensor{did_you_mean(name, sensors, there)}"
                )
        spread = {name: to_array(value, f"biases[{name!r}]") for name, value in spread.items()}
        for name, value in spread.items():
            require_not_negative(f"biases[{name!r}]", value)
        return cls(sampled, measurement, rates, dict(sorted(spread.items())))

    def __call__(
        self,
        readings: Mapping[str, Numbers],
        start: PlacedState | ReleasedState,
        spread: Mapping[str, Numbers],
        *,
        u: Numbers | None = None,
        t0: Numbers = 0.0,
    ) -> Estimate:
        """Estimates the state at each sample, from the readings up to then.

        **Arguments:**

        - ``readings``: of each sensor at each sample, as :meth:`jaxball.Trajectory.measured` has them, shape (K, ...):
          NaN where nothing has arrived. A reading of a sensor with a ``delay`` arrives so much later, and is taken for
          what it was; the estimate at a sample then uses what arrives later as well.
        - ``start``: the estimated state at the first sample; with a law of contact, a
          :class:`~jaxball.physics.ReleasedState` slips or flies.
        - ``spread``: the standard deviations of its local coordinates, by name, as in ``{"attitude": 0.3, "z": 0.1}``;
          0 for the others, which are known.
        - ``u``: the inputs, each row from its sample to the next, shape (K − 1, m). A reading feels the input that acts
          until its sample, the first one that from there on.
        - ``t0``: the time of the first sample.

        **Raises:** ``TypeError`` and ``ValueError`` for readings, a start and inputs that do not fit the filter.
        """
        first = to_array(t0, "t0")
        at = self._begin(first, start)
        require("spread", spread, Mapping, 'a dictionary of standard deviations by name, such as {"Omega": 0.1}')
        deviations = self.deviations(spread)
        read = self._align(readings)
        count = len(read.y)
        filtered = _filter(self, read, at, deviations, self._inputs(u, count - 1), first)
        return Estimate(self.times(first, count), at.directions, self.names_of_biases(at), filtered)

    def unobservable(
        self, start: PlacedState | ReleasedState, samples: int, *, u: Numbers | None = None, t0: Numbers = 0.0
    ) -> tuple[str, ...]:
        """Finds the combinations of errors at the start that no reading of the sensors tells, by name.

        Near the motion from ``start``, as far as readings depend on errors linearly. An estimate may look surer of them
        than it can be, because a filter linearises at other states before and after each reading.

        **Arguments:**

        - ``start``: the state at the first sample.
        - ``samples``: how many readings.
        - ``u``, ``t0``: as for the estimate itself.
        """
        first = to_array(t0, "t0")
        at = self._begin(first, start)
        names = (*at.directions, *self.names_of_biases(at))
        F, H = _linearise(self, at, self._inputs(u, samples - 1), first)
        # The dual of reachability: the flow backwards, transposed.
        F, H = (np.swapaxes(np.asarray(x), 1, 2)[::-1] for x in (F, H))
        seen = reachability_factor(np.concatenate([np.eye(len(names))[None], F]), H)
        return in_words(null_space(seen), names)

    def deviations(self, spread: Mapping[str, Numbers]) -> Float[Array, " n"]:
        """Returns the standard deviation of each local coordinate, given by name.

        **Raises:** ``ValueError`` for unknown names and negative numbers.
        """
        spreads = to_array(by_name("spread", spread, _directions(self.sampled)), "spread")
        require_not_negative("spread", spreads)
        return spreads

    def truth(self, run: Trajectory[Any, Any]) -> Estimated:
        """Returns the states of a run as they are estimated, for ``errors``, ``nees`` and ``plot`` of an estimate.

        Those of a body; with a law of contact, ``SlippingState`` with ``body``, ``slip``, ``rise`` and ``height``.

        **Raises:** ``ValueError`` for a run without a law of contact, if the filter has one.
        """
        if self.sampled.contact is None:
            return run.state
        if not isinstance(run.history, ContactHistory):
            raise ValueError(
                "Argument `run` must be of a body with a law of contact, as the filter has one, but it has none; "
                "simulate it with `contact`."
            )
        return _true_states(run.system.prepare(), jnp.asarray(run.times), run.history.states_of(run.system, run.state))

    def _begin(self, t: Float[Array, ""], start: PlacedState | ReleasedState) -> Estimated:
        """Returns the estimated state of a start.

        **Raises:** ``TypeError`` and ``ValueError`` for one that does not fit the robot.
        """
        system = self.sampled.system
        if self.sampled.contact is None:
            require_one_state(system, start)
        else:
            require_single(self.sampled.as_solved(system), start)
        if isinstance(start, ReleasedState):
            return SlippingState.of(system.prepare(), t, start)
        return of_rolling(self.sampled, start)

    def _inputs(self, u: Numbers | None, count: int) -> Float[Array, "samples inputs"]:
        """Returns the inputs of each sample but the last.

        **Raises:** ``ValueError`` for another number of them.
        """
        m = len(self.sampled.inputs)
        inputs = jnp.zeros((count, 0), default_dtype()) if u is None else to_array(u, "u")
        if inputs.shape != (count, m):
            raise ValueError(
                f"Argument `u` must have a row for each of the {count} samples and {number_of(m, 'column')}, for "
                f"{', '.join(self.sampled.inputs) or 'no inputs'}, but its shape is {inputs.shape}."
            )
        return inputs

    def times(self, t0: Float[Array, ""], count: int) -> Float[Array, " K"]:
        """Returns the times of ``count`` samples from ``t0`` on."""
        return t0 + self.sampled.sample * jnp.arange(count, dtype=t0.dtype)

    def start(self, state: Estimated, deviations: Float[Array, " n"]) -> Belief:
        """Returns what is known before the first reading: biases of 0."""
        spread = [jnp.full((size,), self.spread_of_biases[name]) for name, size in self._bias_sizes(state).items()]
        whole = jnp.concatenate([deviations, *spread]).astype(deviations.dtype)
        return Belief(state, jnp.zeros_like(whole[deviations.size :]), jnp.diag(whole**2))

    def predict(
        self, t: Float[Array, ""], belief: Belief, u: Float[Array, " inputs"]
    ) -> tuple[Belief, Float[Array, "n n"]]:
        """Predicts a sample after ``t`` without a further reading; returns the derivative of the flow of errors."""
        following, A = follow(self.sampled, t, belief.state, u)
        n, whole = len(A), belief.P.shape[0]
        # Biases do not change on their own, so that their part is the identity.
        F = jnp.eye(whole, dtype=A.dtype).at[:n, :n].set(A)
        rates = jnp.concatenate([self.process, self._walks(belief.state)])
        # The variance of a random walk grows in proportion to the time.
        added = jnp.diag(self.sampled.sample * rates**2)
        return Belief(following, belief.bias, propagate(F, belief.P) + added), F

    def expect_readings(
        self, t: Float[Array, ""], belief: Belief, u: Float[Array, " inputs"]
    ) -> tuple[Float[Array, " m"], Float[Array, "m n"]]:
        """Computes what the sensors should read, and its derivative by the errors of the estimate."""
        state, bias = belief.state, belief.bias
        system, of_bias = self.sampled.hold(u), self._of_bias(state)
        solved, read = self.sampled.as_solved(system), moving(self.sampled, system, t, state)

        def of_error(error: Float[Array, " n"]) -> Float[Array, " m"]:
            xi, bias_change = error[: error.size - bias.size], error[error.size - bias.size :]
            return self.measurement(solved, t, read(state.retract(xi))) + of_bias @ (bias + bias_change)

        zero = jnp.zeros(belief.P.shape[0], belief.P.dtype)
        return of_error(zero), jax.jacfwd(of_error)(zero)

    def update(
        self, t: Float[Array, ""], belief: Belief, u: Float[Array, " inputs"], read: Reading
    ) -> tuple[Belief, Float[Array, " m"], Float[Array, "m m"]]:
        """Updates with a reading; returns the innovation, 0 where nothing was read, and its covariance, 1 there."""
        state, P = belief.state, belief.P
        h, H = self.expect_readings(t, belief, u)
        if read.y.shape != h.shape:  # here, where it is traced once; other shapes would be broadcast
            raise ValueError(
                "Argument `readings` must have as many components at each sample as the sensors have, "
                f"{self.sizes(state)}, but they have {read.y.size} in all."
            )

        # A missing reading keeps its row, as shapes are fixed while tracing: without sensitivity, and with a variance
        # of 1 that makes S regular, it changes nothing.
        there = read.there[:, None]
        H = jnp.where(there, H, 0.0)
        innovation = jnp.where(read.there, read.y - h, 0.0)
        R = jnp.where(read.there, self._noise(state) ** 2, 1.0)
        S = symmetric(H @ P @ H.T + jnp.diag(R))
        # The transpose of P Hᵀ S⁻¹, by the symmetry of both covariances.
        K = jnp.linalg.solve(S, H @ P).T
        rest = jnp.eye(len(P), dtype=P.dtype) - K @ H
        # Joseph's form remains positive semidefinite in spite of rounding.
        with_reading = belief._replace(P=rest @ P @ rest.T + (K * R[None]) @ K.T)
        return with_reading.move(K @ innovation), innovation, S

    def _align(self, readings: Mapping[str, Numbers]) -> Reading:
        """Shifts the readings of all sensors to the samples at which they were taken."""
        require("readings", readings, Mapping, "the readings of each sensor by name")
        sensors = self.measurement.sensors
        for name in sensors:
            if name not in readings:
                raise ValueError(f"Argument `readings` must have those of every sensor, but {name!r} is missing.")
        columns = {}
        for name, sensor in sensors.items():
            values = to_array(readings[name], f"readings[{name!r}]")
            if values.ndim == 0:
                raise refusal(f"readings[{name!r}]", "readings at each sample", readings[name])
            columns[name] = align_late(values.reshape(values.shape[0], -1), samples_late(name, sensor, self.sampled))
        lengths = {name: len(column) for name, column in columns.items()}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"Argument `readings` must have as many samples of each sensor, but there are {lengths}.")
        y = jnp.concatenate(list(columns.values()), axis=1)
        # NaN would enter derivatives although it is not used.
        return Reading(jnp.where(jnp.isfinite(y), y, 0.0), jnp.isfinite(y))

    def sizes(self, state: Estimated) -> dict[str, int]:
        """Counts the components that each sensor reads, in the order of the measurement."""
        return self.measurement.sizes(self.sampled.system, body_of(state))

    def _bias_sizes(self, state: Estimated) -> dict[str, int]:
        return {name: size for name, size in self.sizes(state).items() if name in self.spread_of_biases}

    def _of_bias(self, state: Estimated) -> Float[np.ndarray, "m biases"]:
        """Returns the matrix that takes biases to the readings that they are in."""
        sizes = self.sizes(state)
        mask = np.concatenate([np.full(size, name in self.spread_of_biases) for name, size in sizes.items()])
        return np.eye(len(mask))[:, mask]

    def _noise(self, state: Estimated) -> Float[Array, " m"]:
        """Returns the standard deviation of each component."""
        return self._each(state, lambda errors: errors.noise)

    def _walks(self, state: Estimated) -> Float[Array, " biases"]:
        return self._each(state, lambda errors: errors.random_walk) @ self._of_bias(state)

    def _each(self, state: Estimated, number: Callable[[Any], Array]) -> Float[Array, " m"]:
        sensors = self.measurement.sensors
        return jnp.concatenate(
            [jnp.full((size,), number(sensors[name].errors)) for name, size in self.sizes(state).items()]
        )

    def names_of_biases(self, state: Estimated) -> tuple[str, ...]:
        """Returns the estimated biases, by name."""
        sizes = self._bias_sizes(state)
        return tuple(f"{name}[{k}]" if size > 1 else name for name, size in sizes.items() for k in range(size))


def _directions(sampled: SampledSystem) -> tuple[str, ...]:
    """Returns the names of the errors of an estimated state."""
    return of_rolling(sampled, sampled.system.upright_state()).directions


@programs.filter_jit
def _true_states(system: System, times: Array, states: ContactState) -> SlippingState:
    return jax.vmap(functools.partial(SlippingState.in_mode, system))(times, states)


@programs.filter_jit
def _filter(
    estimator: ErrorStateFilter, read: Reading, start: Estimated, deviations: Array, u: Array, t0: Array
) -> Filtered:
    """Filters all samples. The last input is held at the last one, after which there is none."""
    times, held = estimator.times(t0, read.y.shape[0]), _hold_last(u)
    begun = estimator.start(start, deviations)

    def step(belief: Belief, sample: Any) -> tuple[Belief, tuple]:
        k, since, t, before, reading = sample
        # Prediction is over the sample that ends at t, with the input held there, which the reading at t feels, too.
        # The first sample has nothing to predict; a batch predicts there from its own time, and drops that.
        ahead, F = jax.lax.cond(
            k > 0,
            lambda: estimator.predict(since, belief, before),
            lambda: (belief, jnp.eye(len(belief.P), dtype=t.dtype)),
        )
        belief, innovation, S = estimator.update(t, ahead, before, reading)
        return belief, (belief, ahead, innovation, S, F)

    since, before = (jnp.concatenate([x[:1], x[:-1]]) for x in (times, held))
    samples = jnp.arange(len(times)), since, times, before, read
    _, (now, ahead, innovation, S, F) = jax.lax.scan(step, begun, samples)
    return Filtered(now, ahead, F[1:], innovation, S, read.there)


@programs.filter_jit
def _linearise(estimator: ErrorStateFilter, start: Estimated, u: Array, t0: Array) -> tuple[Array, Array]:
    """Computes the derivatives of the flow of errors over each sample, and of each reading, along a motion."""
    times, held = estimator.times(t0, len(u) + 1), _hold_last(u)
    # The derivatives do not depend on the covariance.
    belief = estimator.start(start, jnp.ones(len(start.directions), t0.dtype))

    def step(belief: Belief, sample: tuple[Array, Array, Array]) -> tuple[Belief, tuple[Array, Array]]:
        t, before, u = sample
        H = estimator.expect_readings(t, belief, before)[1]
        ahead, F = estimator.predict(t, belief, u)
        return ahead, (F, H)

    before = jnp.concatenate([held[:1], held[:-1]])
    last, (F, H) = jax.lax.scan(step, belief, (times[:-1], before[:-1], held[:-1]))
    return F, jnp.concatenate([H, estimator.expect_readings(times[-1], last, held[-1])[1][None]])


def _hold_last(u: Float[Array, "samples inputs"]) -> Float[Array, "samples_and_end inputs"]:
    """Returns the inputs of all samples, of which the last one holds the one before."""
    return jnp.concatenate([u, u[-1:] if len(u) else jnp.zeros((1, u.shape[1]), u.dtype)])


def align_late(arrived: Float[Array, "K m"], late: int) -> Float[Array, "K m"]:
    """Shifts readings to the samples at which they were taken; NaN at the last ones, which are still to arrive."""
    return jnp.concatenate([arrived[late:], jnp.full_like(arrived[:late], jnp.nan)])


def samples_late(name: str, sensor: AbstractSensor, sampled: SampledSystem) -> int:
    """Returns how many samples later the readings of a sensor of this name arrive.

    **Raises:** ``ValueError`` for a delay that is no whole number of samples.
    """
    delay = 0.0 if sensor.errors is None else sensor.errors.delay
    if not delay:
        return 0
    late = delay / float(np.asarray(sampled.sample))
    if abs(late - round(late)) > SAME_TIME * max(late, 1.0):
        raise ValueError(
            f"Argument `sensors[{name!r}].errors.delay` must be a whole number of samples, but it is {late:.6g} of "
            "them."
        )
    return round(late)


def wanders(sensor: AbstractSensor) -> bool:
    """Returns whether the bias of a sensor has a random walk, by which it is estimated."""
    walk = None if sensor.errors is None else sensor.errors.random_walk
    return walk is not None and (is_traced(walk) or bool(np.asarray(walk) > 0))


def require_not_negative(name: str, values: Array) -> None:
    """Raises a ``ValueError`` for a negative number, unless it is traced."""
    if not is_traced(values) and not np.all(np.asarray(values) >= 0):
        raise ValueError(f"Argument `{name}` must be 0 or positive, but it is {np.asarray(values).tolist()}.")
