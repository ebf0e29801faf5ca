"""Feedback from what sensors read: a filter in place of the state that a regulator asks for."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...interface.arguments import require
from ...numerics.arrays import Numbers, default_dtype, select_tree
from ...physics.body import System
from ...physics.contact.law import Contact
from ...physics.sensors import AbstractSensor
from ...physics.sensors.base import with_errors
from ..feedback import AbstractFeedback, NominalMotion
from ..loop import plant_of, until_end
from ..sampled import SampledSystem
from ..slipping import body_of, of_rolling, with_law
from .estimate import Belief, Followed, LoopEstimate, deviations_in
from .filter import ErrorStateFilter, Reading, align_late, samples_late


class Remembered(NamedTuple):
    """What feedback from sensors remembers from sample to sample.

    A late reading counts as one of the time at which it was taken: the filter runs again from the oldest sample whose
    readings may still arrive. For that it remembers, if the longest delay is D samples,

    - ``belief``: what is known of the state D samples ago, with all readings up to then.
    - ``y``: what was read at the last D samples, arrived or not; NaN where nothing was.
    - ``u``: the inputs that acted in the last D + 1 samples.

    Besides these it remembers

    - ``inner``: what the regulator remembers.
    - ``xi``, ``bias``: the estimated deviations from the motion at each sample so far, and biases of sensors.
    - ``P``: the covariances of the errors of both.
    - ``nis``, ``read``: the normalised innovation squared, and how many numbers were read, once all have arrived.
    """

    belief: Belief
    y: Float[Array, "late components"]
    u: Float[Array, "late_and_one m"]
    inner: Any
    xi: Float[Array, "samples n"]
    bias: Float[Array, "samples biases"]
    P: Float[Array, "samples whole whole"]
    nis: Float[Array, "samples"]
    read: Int[Array, "samples"]

    @property
    def deviations(self) -> Float[Array, "samples n"]:
        """The standard deviations of the errors of ``xi``."""
        return deviations_in(self.P)[:, : self.xi.shape[1]]


class OutputFeedback(AbstractFeedback):
    """A regulator that is given the estimates of a filter instead of the state: it acts on what sensors read.

    Between samples the filter predicts with the inputs that act, which a robot knows: within limits, and after a
    ``delay`` of :meth:`~jaxball.control.AbstractFeedback.closed_loop`. A reading feels the input that acts until its
    sample; at the first one that is the motion's. Readings of a sensor with a ``delay`` arrive so
    much later, and are taken for what they were: the filter then goes again from the sample at which they were taken.

    **Arguments** of :meth:`of`, which makes one:

    - ``feedback``: the regulator, such as :func:`~jaxball.control.tvlqr` makes.
    - ``sensors``, ``process``, ``biases``: as for an :class:`ErrorStateFilter`; a ``delay`` is a whole number of
      samples.
    - ``spread``: the standard deviations at the start, around the start of the motion, as for a filter.
    - ``contact``: a law with which the filter takes the robot for one that may slip, fly and land; it rolls without.
      Slip and height are estimated then, but not recorded. Give the law to ``closed_loop``, too.
    - ``system``: the robot that is measured, where it is not the one that the regulator and the filter know; give
      the same one to :meth:`~jaxball.control.AbstractFeedback.closed_loop`.
    - ``key``: of the errors of the sensors, as for :meth:`jaxball.Trajectory.measured`.

    Its other fields are

    - ``known``: the filter.
    - ``plant``: the robot that is measured.
    - ``wrong``: what the readings taken at each sample differ by from exact ones, shape (N + 1, components); NaN where
      none is.
    - ``late``: how many samples later each component arrives.

    **Raises:** ``TypeError`` and ``ValueError`` for sensors that a filter cannot use, and for unknown names.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> from jaxball import Disk, Motor, planar_pendulum, simulate
    >>> from jaxball.control import tvlqr
    >>> from jaxball.control.estimation import OutputFeedback
    >>> from jaxball.physics.sensors import Encoder, Position, SensorErrors
    >>> robot = Disk(mass=1.0, inertia=0.5, mechanisms=[planar_pendulum(0.5, 0.6, drive=Motor(0.0))])
    >>> track = tvlqr(simulate(robot, [0.0, 10.0]), Q={"phi": 1.0, "theta": 1.0}, R=1.0)
    >>> noise = SensorErrors(noise=0.001)
    >>> sensors = {"joint": Encoder("mechanisms[0].joints[0]", errors=noise), "camera": Position(errors=noise)}
    >>> seeing = OutputFeedback.of(track, sensors, spread={"phi": 0.2, "z": 0.2, "thetadot": 0.1})
    >>> held = seeing.closed_loop({"phi": 0.2, "z": -0.2})
    >>> bool(abs(held.xi[-1, 0]) < 0.02)
    True
    """

    sampled: SampledSystem
    nominal: NominalMotion
    feedback: AbstractFeedback
    known: ErrorStateFilter
    plant: SampledSystem
    spread: Float[Array, " n"]
    wrong: Float[Array, "samples_and_end components"]
    late: tuple[int, ...] = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        feedback: AbstractFeedback,
        sensors: Mapping[str, AbstractSensor],
        *,
        spread: Mapping[str, Numbers],
        process: Mapping[str, Numbers] | None = None,
        biases: Mapping[str, Numbers] | None = None,
        contact: Contact | None = None,
        system: System | None = None,
        key: Any = None,
    ) -> "OutputFeedback":
        """Builds the feedback of a regulator from sensors; its arguments stand above."""
        require("feedback", feedback, AbstractFeedback, "a feedback, such as tvlqr(...) makes")
        known = with_law(feedback.sampled, contact)
        estimator = ErrorStateFilter.for_sampled_system(known, sensors, process, biases)
        late = {name: samples_late(name, sensor, estimator.sampled) for name, sensor in sensors.items()}
        plant = plant_of(feedback, system, None)
        return cls.of_parts(feedback, estimator, plant, estimator.deviations(spread), late, key)

    @classmethod
    def of_parts(
        cls,
        feedback: AbstractFeedback,
        known: ErrorStateFilter,
        plant: SampledSystem,
        spread: Float[Array, " n"],
        late: Mapping[str, int],
        key: Any = None,
    ) -> "OutputFeedback":
        """Combines parts that fit each other, with how many samples late each sensor is; traceable."""
        nominal = feedback.nominal
        each = tuple(late[name] for name, size in known.sizes(nominal.state(0)).items() for _ in range(size))
        wrong = _errors(known, nominal, late, key)
        return cls(feedback.sampled, nominal, feedback, known, plant, spread, wrong, each)

    def begin(self) -> Remembered:
        start = of_rolling(self.known.sampled, self.nominal.state(0))
        belief, late = self.known.start(start, self.spread), max(self.late)
        none = (jnp.zeros((self.nominal.samples, *shape), belief.P.dtype) for shape in self._shapes(belief))
        xi, bias, P, nis = none
        y = jnp.full((late, len(self.late)), jnp.nan, belief.P.dtype)
        # Before the start, the inputs of the motion are all that can be assumed.
        u = jnp.repeat(self.nominal.input(0)[None], late + 1, axis=0)
        read = jnp.zeros(self.nominal.samples, int)
        return Remembered(belief, y, u, self.feedback.begin(), xi, bias, P, nis, read)

    def __call__(self, k, state, memory):
        return self._act(k, self.plant.hold(memory.u[-1]), state, memory)

    def act(self, k, plant, moving, memory):
        # Sensors feel a slip, and the blow of a landing.
        return self._act(k, plant.as_solved(self.plant.hold(memory.u[-1])), moving, memory)

    def _act(self, k: Int[Array, ""], system: Any, state: Any, memory: Remembered) -> tuple[Array, Remembered]:
        t = self._time(k)
        wrong = self.wrong[jnp.minimum(k, len(self.wrong) - 1)]
        # What acts until this sample is known; the input from here on is still to be found, by this reading.
        now = self.known.measurement(system, t, state) + wrong
        y = jnp.concatenate([memory.y, now[None]])
        (belief, oldest), seen = self._follow(k, memory, y)
        body, nominal = body_of(belief.state), self.nominal.state(k)
        added, inner = self.feedback(k, body, memory.inner)
        recorded = _recorded(len(nominal.directions), belief)
        values = nominal.difference(body), belief.bias, belief.P[recorded], *seen
        before = memory.xi, memory.bias, memory.P, memory.nis, memory.read
        late = max(self.late)
        # How much was read at a sample, and how well it fits, is known when the latest sensor has reported.
        places = k, k, k, k - late, k - late
        rows = (_put(history, place, value) for history, place, value in zip(before, places, values, strict=True))
        return added, Remembered(oldest, y[1:], memory.u, inner, *rows)

    def remember_inputs(self, k, u, memory):
        inner = self.feedback.remember_inputs(k, u, memory.inner)
        return memory._replace(u=jnp.concatenate([memory.u[1:], u[None]]), inner=inner)

    def _follow(self, k: Any, memory: Remembered, y: Array) -> tuple[tuple[Belief, Belief], tuple[Array, Array]]:
        """Returns what is known at sample ``k``, and at the oldest sample of ``y``; for the latter, also the innovation
        squared and how many numbers were read.
        """
        estimator, late = self.known, max(self.late)
        # At the sample of each row, what has arrived by now.
        arrived = np.arange(late, -1, -1)[:, None] >= np.array(self.late)[None]

        def step(belief: Belief, sample: Any) -> tuple[Belief, Any]:
            i, u, y, arrived = sample
            ahead = estimator.predict(self._time(i - 1), belief, u)[0]
            # Before the first sample there is nothing to predict or read: the belief stays that at the start.
            ahead = select_tree(i > 0, ahead, belief)
            there = arrived & jnp.isfinite(y)
            with_reading, innovation, S = estimator.update(
                self._time(i), ahead, u, Reading(jnp.where(there, y, 0.0), there)
            )
            after = select_tree(i >= 0, with_reading, ahead)
            return after, (after, innovation @ jnp.linalg.solve(S, innovation), jnp.sum(there))

        rows = k - late + jnp.arange(late + 1), memory.u, y, jnp.asarray(arrived)
        # Without a delay, there is one step, which need not be a loop.
        if not late:
            belief, (oldest, *seen) = step(memory.belief, jax.tree.map(lambda leaf: leaf[0], rows))
            return (belief, oldest), tuple(seen)
        belief, results = jax.lax.scan(step, memory.belief, rows)
        oldest, *seen = jax.tree.map(lambda leaf: leaf[0], results)
        return (belief, oldest), tuple(seen)

    def _time(self, k: Int[Array, ""]) -> Float[Array, ""]:
        return self.nominal.times[0] + self.sampled.sample * k.astype(self.spread.dtype)

    def _shapes(self, belief: Belief) -> tuple[tuple[int, ...], ...]:
        """Returns the shapes of deviations, biases, covariances and normalised innovations."""
        n, biases = len(self.nominal.state(0).directions), belief.bias.size
        return (n,), (biases,), 2 * (n + biases,), ()

    def estimates(self, times: Float[Array, " T"], memory: Remembered) -> LoopEstimate:
        count, samples = len(times), min(len(times) - 1, self.nominal.samples)
        nominal = jax.tree.map(lambda leaf: leaf[:samples], self.nominal.states)
        states = jax.vmap(lambda state, xi: state.retract(xi))(nominal, memory.xi[:samples])
        read = jnp.zeros(count, memory.read.dtype).at[:samples].set(memory.read[:samples])
        arrays = (states, memory.bias[:samples], memory.P[:samples], memory.nis[:samples])
        *belief, nis = jax.tree.map(lambda rows: until_end(rows, count), arrays)
        estimator, first = self.known, self.nominal.state(0)
        biases = estimator.names_of_biases(first)
        followed = Followed(Belief(*belief), jnp.where(read > 0, nis, jnp.nan), read)
        return LoopEstimate(times, first.directions, biases, followed)


def _recorded(n: int, belief: Belief) -> tuple[np.ndarray, ...]:
    """Returns the places of a covariance that are recorded: those of the ``n`` errors of the body, and of biases."""
    whole, biases = belief.P.shape[0], belief.bias.size
    return np.ix_(*2 * [np.r_[:n, whole - biases : whole]])


def _put(rows: Array, place: Int[Array, ""], row: Array) -> Array:
    """Returns the rows with another one at a place, unless there is none."""
    # A negative index would count from the end; one past the end is dropped.
    return rows.at[jnp.where(place < 0, len(rows), place)].set(row, mode="drop")


def _errors(
    estimator: ErrorStateFilter, nominal: NominalMotion, late: Mapping[str, int], key: Any
) -> Float[Array, "samples_and_end components"]:
    """Draws the errors of readings taken at each sample; NaN where there is no reading."""
    times, sizes = nominal.times, estimator.sizes(nominal.state(0))
    sensors = estimator.measurement.sensors
    zero = {name: jnp.zeros((times.size, size), default_dtype()) for name, size in sizes.items()}
    errors = with_errors({name: sensor.errors for name, sensor in sensors.items()}, times, zero, key)
    # `with_errors` puts readings where they arrive; here they stand at the samples at which they were taken.
    return jnp.concatenate([align_late(errors[name], late[name]) for name in sensors], axis=1)
