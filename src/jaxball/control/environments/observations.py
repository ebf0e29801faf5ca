"""What a policy observes of the robot: its state, or what sensors read of it."""

import abc
import math
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import require_flags
from ...interface.printing import Printed
from ...numerics.arrays import join_arrays
from ...numerics.vectors import apply, cross, sine_cosine
from ...physics.body import System
from ...physics.dynamics.moments import kinematics
from ...physics.mechanisms import Hinge, Mechanism
from ...physics.prescribed.motion import Driven
from ...physics.sensors import AbstractSensor
from ...physics.sensors.base import Measurement, key_of, require_sensors
from .tasks import Moment


class AbstractObservation(Printed):
    """What a policy observes of the robot; what it sees of the goal comes after it.

    A kind of observation implements ``__call__``, and ``begin`` if it remembers something from sample to sample. Both
    are traced, for one robot.
    """

    def begin(self, key: Any, moment: Moment) -> Any:
        """Returns what the observation remembers before the first one of an episode: a PyTree of arrays."""
        return ()

    @abc.abstractmethod
    def __call__(
        self, key: Any, moment: Moment, memory: Any, sample: Float[Array, ""]
    ) -> tuple[Float[Array, " numbers"], Any]:
        """Returns the observation of a moment, one ``sample`` after the last, and what is to be remembered of it."""

    def require_fits(self, system: System) -> None:
        """Raises an error where it cannot be made of this body; called when an environment is made."""


class ObservedState(AbstractObservation):
    """The state, in numbers that change smoothly however far the body rolls, and that depend on no place or heading.

    They are, in this order, of a ball and of a disk,

    - the velocity of the centre, ahead and to the left, and the angular velocity Ω·Γ about the vertical (3); the
      velocity (1);
    - with ``attitude``, the vertical Γ in body axes (3); its first and third component (2);
    - with ``joints``, of each joint, mass and angle of a plate in the state cos θ and sin θ where it turns all around,
      or else θ, and θ̇;
    - with ``masses``, where each mass is, from the centre, and its velocity relative to that: ahead, to the left, and
      up (6); ahead and up (4);
    - with ``own``, the body's :class:`~jaxball.physics.OwnStates`.

    Ahead is the direction in which the body rolls about its axis E2. On a plane that is not level and at rest, a
    heading matters as well, and on a surface the place, which a goal shows relative to its own; observe there with
    sensors, or write an observation of your own.

    **Arguments:**

    - ``attitude``, ``joints``, ``masses``, ``own``: which of them are observed. Where all masses are on joints,
      ``masses`` alone determine the joints and the attitude, and are what a policy learns from fastest.
    """

    attitude: bool = eqx.field(static=True, default=True)
    joints: bool = eqx.field(static=True, default=True)
    masses: bool = eqx.field(static=True, default=True)
    own: bool = eqx.field(static=True, default=True)

    def __check_init__(self):
        require_flags(attitude=self.attitude, joints=self.joints, masses=self.masses, own=self.own)

    def __call__(self, key, moment, memory, sample):
        state, is_disk = moment.state, moment.system.planar
        parts = [moment.ahead(moment.velocity)]
        if not is_disk:
            parts.append(moment.spin[None])
        if self.attitude:
            # A disk turns about E2 alone, so the second component is always 0.
            parts.append(state.Gamma[::2] if is_disk else state.Gamma)
        if self.joints:
            parts += _of_joints(moment)
        if self.masses:
            rows = _masses(moment)
            parts.append(jnp.ravel(rows[..., ::2] if is_disk else rows))
        if self.own and state.own is not None:
            parts.append(state.own)
        return join_arrays(parts), memory


def _of_joints(moment: Moment) -> list[Float[Array, " numbers"]]:
    parts, state = [], moment.state
    for k, turn in enumerate(_turns(moment.system)):
        theta, thetadot = state.theta[k], state.thetadot[k]
        # The angle of a joint that turns all around is shown by cosine and sine, which do not jump at a whole turn.
        shown = [theta] if turn is None else [*sine_cosine(theta * (2 * math.pi / turn))][::-1]
        parts.append(jnp.stack([*shown, thetadot]))
    return parts


def _turns(system: System) -> list[float | None]:
    """Returns the θ of a whole turn of each coordinate of the state; None for one that does not turn."""
    turns: list[float | None] = []
    for index in system.driven:
        motion = system.point_masses[index].motion
        turns.append(motion.rail.period if isinstance(motion, Driven) else None)
    for index, a in system.joints:
        mechanism = system.mechanisms[index]
        hinge = isinstance(mechanism, Mechanism) and isinstance(mechanism.joints[a], Hinge)
        turns.append(2 * math.pi if hinge else None)
    return [*turns, *(None for _ in system.driven_ground)]


def _masses(moment: Moment) -> Float[Array, "masses 2 3"]:
    """Computes the position and velocity of each mass relative to the centre: ahead, to the left, and up."""
    system, state = moment.system.prepare(), moment.state
    # Positions and rates need no accelerations, for which zeros stand.
    angles = state.theta, state.thetadot, jnp.zeros_like(state.theta)
    motion = kinematics(system, moment.t, angles)

    def see(chi: Array, chidot: Array) -> Array:
        # The velocity relative to the centre, in the axes of space: that in the body plus its turning.
        velocity = chidot + cross(state.Omega[None], chi[None])[0]
        rows = jnp.stack([apply(state.Lambda, chi), apply(state.Lambda, velocity)])
        c, s = moment.heading
        x, y = rows[:, 0], rows[:, 1]
        return jnp.stack([c * x + s * y, c * y - s * x, rows[:, 2]], axis=-1)

    rows = [see(motion.chi[i], motion.chidot[i]) for i in range(motion.chi.shape[0])]
    return jnp.stack(rows) if rows else jnp.zeros((0, 2, 3), state.theta.dtype)


class ObservedSensors(AbstractObservation):
    """What sensors read at each sample, with their errors: noise, bias, its random walk, and lost readings.

    The readings come one after the other, in the order of the sensors' names. In place of one that is lost the last one
    is observed again, and 0 before the first.

    **Arguments:**

    - ``sensors``: such as a :class:`~jaxball.physics.sensors.Gyroscope`, by names of your choice. Their errors must
      have no ``rate`` and no ``delay``; what an environment delays are its inputs.
    """

    sensors: dict[str, AbstractSensor]

    def require_fits(self, system: System) -> None:
        """Raises ``TypeError`` and ``ValueError`` for sensors that the body cannot carry, or with a rate or a delay."""
        require_sensors(self.sensors, system)
        for name, sensor in self.sensors.items():
            if sensor.errors is not None and (sensor.errors.rate is not None or sensor.errors.delay):
                raise ValueError(
                    f"Argument `sensors[{name!r}].errors` must have no rate and no delay in an environment, which "
                    "reads every sensor at each sample, but it has; leave them out, and delay the inputs instead."
                )

    def _read(self, moment: Moment) -> dict[str, Float[Array, "..."]]:
        system, state = moment.as_solved
        return Measurement(self.sensors).parts(system, moment.t, state)

    def begin(self, key, moment):
        # The readings themselves only tell the shapes.
        parts = self._read(moment)
        zero = {name: jnp.zeros_like(jnp.ravel(part)) for name, part in parts.items()}
        return zero, zero

    def __call__(self, key, moment, memory, sample):
        wandered, last = dict(memory[0]), dict(memory[1])
        parts = self._read(moment)
        for name, sensor in self.sensors.items():
            exact, errors = jnp.ravel(parts[name]), sensor.errors
            if errors is None:
                last[name] = exact
                continue
            of_walk, of_noise, of_losses = jax.random.split(key_of(name, errors, key), 3)
            # At the start of an episode the bias has not wandered yet.
            step = errors.random_walk * jnp.where(moment.t > 0, jnp.sqrt(sample), 0.0)
            wandered[name] = wandered[name] + step * jax.random.normal(of_walk, exact.shape, exact.dtype)
            white = errors.noise * jax.random.normal(of_noise, exact.shape, exact.dtype)
            bias = jnp.broadcast_to(errors.bias, exact.shape)
            lost = jax.random.uniform(of_losses, (), exact.dtype) < errors.missing
            # Lost in all its components, as a message is.
            last[name] = jnp.where(lost, last[name], exact + bias + wandered[name] + white)
        return join_arrays([last[name] for name in sorted(last)]), (wandered, last)


def observation_of(given: Mapping[str, AbstractSensor] | AbstractObservation) -> AbstractObservation:
    """Returns an observation, from sensors by name as well."""
    return ObservedSensors(dict(given)) if isinstance(given, Mapping) else given
