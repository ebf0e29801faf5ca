"""Feedback from what sensors read: a filter in place of the state that a regulator asks for."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..control.feedback import AbstractFeedback
from ..control.history import until_end
from ..control.loop import plant_of
from ..control.nominal import NominalMotion
from ..control.sampled import SampledSystem
from ..interface.arguments import require
from ..numerics.arrays import Numbers, default_dtype
from ..physics.body import System
from ..sensors import AbstractSensor
from ..sensors.errors import with_errors
from .belief import Belief
from .estimate import Followed, LoopEstimate
from .filter import ErrorStateFilter, Reading


class Remembered(NamedTuple):
    """What feedback from sensors remembers from sample to sample.

    - ``belief``: what is known of the state before the next reading.
    - ``u``: the inputs that act.
    - ``inner``: what the regulator remembers.
    - ``xi``, ``bias``: the estimated deviations from the motion at each sample so far, and biases of sensors.
    - ``P``: the covariances of the errors of both.
    - ``nis``, ``read``: the normalised innovation squared, and how many numbers were read.
    """

    belief: Belief
    u: Float[Array, " m"]
    inner: Any
    xi: Float[Array, "samples n"]
    bias: Float[Array, "samples biases"]
    P: Float[Array, "samples whole whole"]
    nis: Float[Array, "samples"]
    read: Int[Array, "samples"]

    @property
    def deviations(self) -> Float[Array, "samples n"]:
        """The standard deviations of the errors of ``xi``."""
        return jnp.sqrt(jnp.diagonal(self.P, axis1=1, axis2=2))[:, : self.xi.shape[1]]


class OutputFeedback(AbstractFeedback):
    """A regulator that is given the estimates of a filter instead of the state: it acts on what sensors read.

    Between samples the filter predicts with the inputs that the regulator has asked for, within limits; a ``delay`` of
    :func:`~jaxball.control.closed_loop` is unknown to it.

    **Arguments** of :meth:`of`, which makes one:

    - ``feedback``: the regulator, such as :func:`~jaxball.control.tvlqr` makes.
    - ``sensors``, ``process``, ``biases``: as for an :class:`ErrorStateFilter`; sensors must have no ``delay``.
    - ``spread``: the standard deviations at the start, around the start of the motion, as for a filter.
    - ``system``: the robot that is measured, where it is not the one that the regulator and the filter know; give
      the same one to :func:`~jaxball.control.closed_loop`.
    - ``key``: of the errors of the sensors, as for :meth:`jaxball.Trajectory.measured`.

    Its other fields are

    - ``known``: the filter.
    - ``plant``: the robot that is measured.
    - ``wrong``: what readings differ by from exact ones, shape (N + 1, components); NaN where nothing is read.

    **Raises:** ``TypeError`` and ``ValueError`` for sensors that a filter cannot use, and for unknown names.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> from jaxball import Disk, Motor, planar_pendulum, simulate
    >>> from jaxball.control import closed_loop, tvlqr
    >>> from jaxball.estimation import OutputFeedback
    >>> from jaxball.sensors import Encoder, Position, SensorErrors
    >>> robot = Disk(mass=1.0, inertia=0.5, mechanisms=[planar_pendulum(0.5, 0.6, drive=Motor(0.0))])
    >>> track = tvlqr(simulate(robot, [0.0, 10.0]), Q={"phi": 1.0, "theta": 1.0}, R=1.0)
    >>> noise = SensorErrors(noise=0.001)
    >>> sensors = {"joint": Encoder("mechanisms[0].joints[0]", errors=noise), "camera": Position(errors=noise)}
    >>> seeing = OutputFeedback.of(track, sensors, spread={"phi": 0.2, "z": 0.2, "thetadot": 0.1})
    >>> held = closed_loop(seeing, {"phi": 0.2, "z": -0.2})
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

    @classmethod
    def of(
        cls,
        feedback: AbstractFeedback,
        sensors: Mapping[str, AbstractSensor],
        *,
        spread: Mapping[str, Numbers],
        process: Mapping[str, Numbers] | None = None,
        biases: Mapping[str, Numbers] | None = None,
        system: System | None = None,
        key: Any = None,
    ) -> "OutputFeedback":
        """The feedback of a regulator from sensors; its arguments stand above."""
        require("feedback", feedback, AbstractFeedback, "a feedback, such as tvlqr(...) makes")
        sampled, nominal = feedback.sampled, feedback.nominal
        known = ErrorStateFilter.for_sampled(sampled, sensors, process, biases)
        for name, sensor in sensors.items():
            if sensor.errors is not None and sensor.errors.delay:
                raise ValueError(
                    f"Argument `sensors[{name!r}].errors.delay` must be 0 for feedback, which waits for no reading, "
                    f"but it is {sensor.errors.delay:g}."
                )
        plant, wrong = plant_of(feedback, system, None, None), _errors(known, nominal, key)
        return cls(sampled, nominal, feedback, known, plant, known.deviations(spread), wrong)

    def begin(self) -> Remembered:
        belief = self.known.start(self.nominal.state(0), self.spread)
        none = (jnp.zeros((self.nominal.samples, *shape), belief.P.dtype) for shape in _shapes(belief))
        xi, bias, P, nis = none
        read = jnp.zeros(self.nominal.samples, int)
        return Remembered(belief, self.nominal.input(0), self.feedback.begin(), xi, bias, P, nis, read)

    def __call__(self, k, state, memory):
        nominal, known = self.nominal, self.known
        t = nominal.times[0] + self.sampled.sample * k.astype(self.spread.dtype)
        wrong = self.wrong[jnp.minimum(k, len(self.wrong) - 1)]
        y = known.measurement(self.plant.held(memory.u), t, state) + wrong
        there = jnp.isfinite(wrong)
        reading = Reading(jnp.where(there, y, 0.0), there)
        belief, innovation, S = known.updated(t, memory.belief, memory.u, reading)
        added, inner = self.feedback(k, belief.state, memory.inner)
        limits = self.plant.limits
        u = jnp.clip(nominal.input(k) + added, -limits, limits)
        nis = innovation @ jnp.linalg.solve(S, innovation)
        found = self.deviation(k, belief.state), belief.bias, belief.P, nis, jnp.sum(there)
        before = memory.xi, memory.bias, memory.P, memory.nis, memory.read
        rows = (kept.at[k].set(one, mode="drop") for kept, one in zip(before, found, strict=True))
        return added, Remembered(known.predicted(t, belief, u)[0], u, inner, *rows)

    def estimated(self, times: Float[Array, " T"], memory: Remembered) -> LoopEstimate:
        count, samples = len(times), min(len(times) - 1, self.nominal.samples)
        nominal = jax.tree.map(lambda leaf: leaf[:samples], self.nominal.states)
        states = jax.vmap(lambda state, xi: state.retract(xi))(nominal, memory.xi[:samples])
        read = jnp.zeros(count, memory.read.dtype).at[:samples].set(memory.read[:samples])
        found = (states, memory.bias[:samples], memory.P[:samples], memory.nis[:samples])
        state, bias, P, nis = jax.tree.map(lambda rows: until_end(rows, count), found)
        known, first = self.known, self.nominal.state(0)
        biases = known.names_of_biases(first)
        followed = Followed(state, bias, P, jnp.where(read > 0, nis, jnp.nan), read)
        return LoopEstimate(times, first.directions, biases, followed)


def _shapes(belief: Belief) -> tuple[tuple[int, ...], ...]:
    """The shapes of deviations, biases, covariances and normalised innovations."""
    biases, whole = belief.bias.size, belief.P.shape
    return (whole[0] - biases,), (biases,), whole, ()


def _errors(known: ErrorStateFilter, nominal: NominalMotion, key: Any) -> Float[Array, "samples_and_end components"]:
    """What readings differ by from exact ones at each sample; NaN where there is none."""
    times, sizes = nominal.times, known.sizes(nominal.state(0))
    sensors = known.measurement.sensors
    zero = {name: jnp.zeros((times.size, size), default_dtype()) for name, size in sizes.items()}
    found = with_errors({name: sensor.errors for name, sensor in sensors.items()}, times, zero, key)
    return jnp.concatenate([found[name] for name in sensors], axis=1)
