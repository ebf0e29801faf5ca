"""An environment: a robot with sampled inputs and a goal, reset and stepped by pure functions of arrays."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...interface.arguments import refusal, require, require_callable, whole_number
from ...interface.compat import is_traced
from ...interface.names import leave_to
from ...interface.printing import Printed
from ...interface.status import Status
from ...numerics.arrays import Numbers, numbers, positive_number, to_array
from ...physics.body import System
from ...physics.contact.law import Contact
from ...physics.grounds import AbstractSurface
from ...physics.grounds.ground import require_plane
from ...physics.sensors import AbstractSensor
from ...physics.sensors.base import key_of_name, random_key
from ...physics.state import BallState, DiskState, PlacedState, RotationState
from ...physics.system import require_one_state
from ...simulation.simulate import at_rest
from ..inputs import hold_inputs
from ..loop import limits_of
from ..sampled import SampledSystem
from .observations import AbstractObservation, ObservedState, observation_of
from .tasks import (
    AbstractDistribution,
    AbstractGoal,
    AbstractReward,
    Moment,
    QuadraticReward,
    directions_by_name,
    require_numbers_of,
    with_numbers,
)

if TYPE_CHECKING:
    import gymnasium

    from .adapters import BraxEnvironment

SAMPLE_TOLERANCE = 1e-6  # of the solve of a sample, far below what a policy could tell


class Episode(Printed):
    """Where an episode is: what :meth:`Environment.step` advances.

    - ``state``: that of the robot; with a law of contact, all that a solve advances, with its mode.
    - ``k``: how many steps were taken.
    - ``waiting``: the inputs asked for at the last samples, the newest first, shape (most + 1, m).
    - ``delay``: how many samples pass before an input acts, drawn at the reset.
    - ``parameters``: the numbers of the robot that were drawn, by name.
    - ``target``: what the goal has drawn.
    - ``memory``: what the observation remembers.
    - ``key``: the random key of the following steps.
    """

    state: Any
    k: Int[Array, ""]
    waiting: Float[Array, "samples m"]
    delay: Int[Array, ""]
    parameters: dict[str, Float[Array, "..."]]
    target: Any
    memory: Any
    key: Any


class Transition(NamedTuple):
    """What a step returns.

    - ``episode``: where the episode is after it.
    - ``observation``: the observation then, shape (numbers,).
    - ``reward``: of the step.
    - ``terminated``: whether the episode ended of itself: its goal is reached, the robot slips, or the solve failed.
    - ``truncated``: whether it has only come to its last step.
    - ``info``: ``status``, a :class:`~jaxball.Status` by its number; ``misses``, what the goal is missed by, shape
      (misses,); ``u``, the inputs that acted, shape (m,); of :meth:`Environment.step_or_reset` also
      ``final_observation``.
    """

    episode: Episode
    observation: Float[Array, " numbers"]
    reward: Float[Array, ""]
    terminated: Bool[Array, ""]
    truncated: Bool[Array, ""]
    info: dict[str, Array]


class Environment(Printed):
    """A robot whose inputs a policy sets at each sample, with a goal.

    An action is what each input is to be, as a share of its limit, from −1 to 1; beyond, it is cut off. ``reset`` and
    ``step`` are pure functions of arrays, for ``jax.jit``, ``jax.vmap`` and ``jax.lax.scan``, and differentiable.

    **Arguments:**

    - ``system``: a :class:`~jaxball.Ball` or a :class:`~jaxball.Disk`.
    - ``goal``: such as :class:`ReachPoint`.
    - ``sample``: the time between samples.
    - ``samples``: of an episode, after which it is truncated.
    - ``inputs``: names of the coordinates that are set, as for :class:`~jaxball.control.sampled.SampledSystem`; by
      default all that a schedule, a law or a motor moves.
    - ``limits``: the largest magnitude of each input: a number for all, a row, or numbers by name; by default those of
      the motors.
    - ``observation``: by default :class:`ObservedState`; a dictionary of sensors stands for :class:`ObservedSensors`.
    - ``shows_goal``: whether what a policy sees of the goal follows the observation.
    - ``reward``: by default :class:`QuadraticReward`; each step is rewarded for its time.
    - ``penalty``: what is taken off the reward where the solve failed or the robot slips.
    - ``state``: where episodes start; by default at rest.
    - ``starts``: the distributions of its local coordinates, by name, as in ``{"z": Uniform(-1, 1)}``; those left out
      are 0.
    - ``parameters``: the distributions of numbers of the robot, by their path among the arguments that make it, as in
      ``{"mass": Uniform(0.9, 1.1), "mechanisms[0].mass": Factor(Normal(1, 0.1))}``.
    - ``delay``: how many samples pass before an action acts: a number, or the least and the most, between which it is
      drawn. Until the first acts, inputs are 0.
    - ``friction``: a coefficient μ; if given, an episode ends where the robot needs |f| > μ N after a step, and where
      it would leave the plane.
    - ``contact``: a :class:`~jaxball.Contact`, in place of ``friction``; if given, the robot slips, flies and lands,
      and rolls again, and no episode ends because of that.
    - ``rtol``, ``atol``: tolerances of the solve of a sample.
    - ``adjoint``: as for :func:`jaxball.simulate`.

    Its other field, ``sampled``, is the robot with sampled inputs.

    **Raises:** ``TypeError`` and ``ValueError`` for what does not fit the robot, and for inputs without a limit.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> import jaxball
    >>> from jaxball.control.environments import Environment, ReachPoint, Uniform
    >>> pendulum = jaxball.planar_pendulum(0.5, 0.6, drive=jaxball.Motor(0.0, limit=1.0))
    >>> robot = jaxball.Disk(mass=1.0, inertia=0.5, mechanisms=[pendulum])
    >>> environment = Environment(robot, ReachPoint(2.0), sample=0.1, starts={"z": Uniform(-1.0, 1.0)})
    >>> episode, observation = environment.reset(jax.random.key(0))
    >>> after = jax.jit(environment.step)(episode, jax.numpy.array([0.5]))
    >>> after.observation.shape, bool(after.terminated), bool(after.truncated)
    ((12,), False, False)
    """

    sampled: SampledSystem
    goal: AbstractGoal
    observation: AbstractObservation
    reward: AbstractReward
    state: PlacedState
    starts: dict[str, AbstractDistribution]
    parameters: dict[str, AbstractDistribution]
    penalty: Float[Array, ""]
    friction: Float[Array, ""] | None
    contact: Contact | None
    adjoint: diffrax.AbstractAdjoint | None
    samples: int = eqx.field(static=True)
    delay: tuple[int, int] = eqx.field(static=True)
    shows_goal: bool = eqx.field(static=True)

    def __init__(
        self,
        system: System,
        goal: AbstractGoal,
        *,
        sample: Numbers,
        samples: int = 200,
        inputs: Sequence[str] | None = None,
        limits: Numbers | Mapping[str, Numbers] | None = None,
        observation: AbstractObservation | Mapping[str, AbstractSensor] | None = None,
        shows_goal: bool = True,
        reward: AbstractReward | None = None,
        penalty: Numbers = 0.0,
        state: PlacedState | None = None,
        starts: Mapping[str, AbstractDistribution] | None = None,
        parameters: Mapping[str, AbstractDistribution] | None = None,
        delay: int | tuple[int, int] = 0,
        friction: Numbers | None = None,
        contact: Contact | None = None,
        rtol: Numbers = SAMPLE_TOLERANCE,
        atol: Numbers = SAMPLE_TOLERANCE,
        adjoint: diffrax.AbstractAdjoint | None = None,
    ):
        require("goal", goal, AbstractGoal, "a goal, such as ReachPoint(...)")
        if getattr(system, "shape", None) is not None:
            raise refusal("system", "a ball or a disk for an environment", system)
        ground = getattr(system, "ground", None)
        if not isinstance(ground, AbstractSurface):
            require_plane(ground, "an environment")
        require("contact", contact, (Contact, type(None)), "a Contact, such as Contact(0.3), or None")
        if contact is not None and friction is not None:
            raise ValueError(
                "Argument `friction` must be left out with `contact`, because it ends an episode where the robot would "
                "slip, but both are given."
            )
        sampled = _with_limits(SampledSystem.of(system, sample, inputs, rtol, atol), limits)
        self.sampled, self.contact = dataclasses.replace(sampled, contact=contact), contact
        goal.require_fits(self.sampled.system)
        self.goal = goal
        self.observation = ObservedState() if observation is None else observation_of(observation)
        require("observation", self.observation, AbstractObservation, "an observation, or sensors by name")
        self.observation.require_fits(self.sampled.system)
        require("shows_goal", shows_goal, bool, "True or False")
        self.reward = QuadraticReward() if reward is None else reward
        require("reward", self.reward, AbstractReward, "a reward, such as QuadraticReward(...)")
        self.state = _start(self.sampled.system, state)
        self.starts = _distributions("starts", starts)
        directions_by_name(self.starts, self.state.directions)
        self.parameters = _distributions("parameters", parameters)
        require_numbers_of(self.sampled.system, self.parameters)
        self.penalty = numbers("penalty")(penalty)
        self.friction = None if friction is None else positive_number("friction", friction)
        self.adjoint = adjoint
        self.samples, self.delay, self.shows_goal = whole_number("samples", samples, 1), _range(delay), shows_goal

    @property
    def n_actions(self) -> int:
        """The number m of inputs."""
        return len(self.sampled.inputs)

    @property
    def n_observations(self) -> int:
        """How many numbers a policy observes."""
        return jax.eval_shape(self.reset, jax.random.key(0))[1].size

    def reset(self, key: Any) -> tuple[Episode, Float[Array, " numbers"]]:
        """Returns the beginning of an episode, with everything drawn by a random key, and its first observation.

        **Raises:** ``TypeError`` for what is no random key.
        """
        require("key", key, jax.Array, "a random key, such as jax.random.key(0)")
        # A key for each purpose: what one of them draws does not depend on whether another draws at all.
        of_start, of_robot, of_delay, of_goal, of_memory, of_reading, later = jax.random.split(random_key(key), 7)
        state = self._start(of_start)
        drawn = self._parameters(of_robot)
        zero = jnp.zeros_like(self.sampled.limits)
        # Its inputs are 0, as they stay until the first action acts.
        robot, t = self.robot(drawn, zero), jnp.zeros_like(self.sampled.sample)
        state = self.sampled.begin(robot, t, state)
        moment = self._moment(t, robot, state, zero)
        target = self.goal.draw(of_goal, moment)
        memory = self.observation.begin(of_memory, moment)
        seen, memory = self._observe(of_reading, target, moment, memory)
        least, most = self.delay
        delay = jax.random.randint(of_delay, (), least, most + 1)
        # As long as the longest delay, whatever is drawn, so that all episodes have arrays of one shape.
        waiting = jnp.zeros((most + 1, zero.size), zero.dtype)
        return Episode(state, jnp.zeros((), jnp.int32), waiting, delay, drawn, target, memory, later), seen

    def step(self, episode: Episode, action: Float[Array, " m"]) -> Transition:
        """Moves the episode on by a sample, with the inputs held that the actions so far and the delay give.

        Where the solve fails, the robot stays where it was, and the episode is terminated with the status of the solve.
        An episode that is over can be stepped further, as if it went on; ``truncated`` stays true.

        **Raises:** ``TypeError`` for anything but an episode and numbers, ``ValueError`` for another number of inputs.
        """
        require("episode", episode, Episode, "an episode, as reset(key) and step(...) return it")
        h, limits, action = self.sampled.sample, self.sampled.limits, self._one_action(action)
        waiting = jnp.concatenate([(limits * jnp.clip(action, -1.0, 1.0))[None], episode.waiting[:-1]])
        u = waiting[episode.delay]
        system = self.robot(episode.parameters, u)
        t = h * episode.k.astype(h.dtype)
        state, status = self.sampled.advance(system, t, episode.state, self.adjoint)
        failed = status != Status.SUCCESS
        # Projected afterwards: the derivatives of a failed solve are not known, and 0 of them are to be 0.
        state = jax.tree.map(lambda new, old: jnp.where(failed, old, new), state, episode.state).projected()
        u = jnp.where(failed, 0.0, u)  # which may not be finite
        moment = self._moment(t + h, self.robot(episode.parameters, u), state, u)
        # As int32 on every path, for a scan.
        status = self._in_contact(moment, status.astype(jnp.int32))
        misses = self.goal.misses(episode.target, moment)
        ended = status != Status.SUCCESS
        # An episode's rewards add up to an integral over time, whatever the sample is.
        reward = h * self.reward(misses, moment) - jnp.where(ended, self.penalty, 0.0)
        terminated = ended | self.goal.is_reached(episode.target, moment)
        of_reading, later = jax.random.split(episode.key)
        seen, memory = self._observe(of_reading, episode.target, moment, episode.memory)
        k = episode.k + 1
        after = Episode(state, k, waiting, episode.delay, episode.parameters, episode.target, memory, later)
        info = {"status": status, "misses": misses, "u": u}
        return Transition(after, seen, reward, terminated, (k >= self.samples) & ~terminated, info)

    def _moment(self, t: Float[Array, ""], robot: System, state: Any, u: Float[Array, " m"]) -> Moment:
        if self.contact is None:
            return Moment(t, robot, state, u)
        return Moment(t, robot, state.body, u, state, self.contact)

    def _one_action(self, action: Any) -> Float[Array, " m"]:
        """Returns the argument ``action`` as an array of a number for each input; one input may have a bare number."""
        array, m = to_array(action, "action"), self.n_actions
        if array.shape != (m,) and (array.shape != () or m > 1):
            raise ValueError(
                f"Argument `action` must have the shape ({m},), a number for each of {', '.join(self.sampled.inputs)}, "
                f"but its shape is {array.shape}; take jax.vmap over many episodes."
            )
        return array.reshape(m)

    def step_or_reset(self, episode: Episode, action: Float[Array, " m"]) -> Transition:
        """Takes a step, after which an episode that is over is followed at once by a new one.

        Reward, ``terminated`` and ``truncated`` are those of the step, and ``info["final_observation"]`` the
        observation after it. Where the episode is over, ``episode`` and ``observation`` are those of a reset.
        """
        after = self.step(episode, action)
        over = after.terminated | after.truncated
        # Split once more: the next episode must not draw what steps of this one have drawn.
        anew, later = jax.random.split(after.episode.key)
        fresh = self.reset(anew)
        continuation = eqx.tree_at(lambda e: e.key, after.episode, later), after.observation
        # Both are computed at every step, because under vmap each episode chooses for itself.
        episode, observation = jax.tree.map(lambda new, old: jnp.where(over, new, old), fresh, continuation)
        info = after.info | {"final_observation": after.observation}
        return after._replace(episode=episode, observation=observation, info=info)

    def rollout(
        self, key: Any, policy: Callable[[Float[Array, " numbers"]], Float[Array, " m"]], samples: int | None = None
    ) -> Transition:
        """Simulates an episode under a policy, its transitions one after the other, with the samples as leading axis.

        It has always as many, by default ``samples`` of the environment; after the end of the episode rewards are 0.

        **Arguments:**

        - ``key``: the random key of the episode.
        - ``policy``: the action for an observation; traced.
        - ``samples``: how many.

        **Raises:** ``TypeError`` and ``ValueError`` for another policy or number of samples.
        """
        require_callable("policy", policy, "observation")
        count = self.samples if samples is None else whole_number("samples", samples, 1)

        def following(carry: Any, _: None) -> Any:
            episode, seen, goes_on = carry
            after = self.step(episode, policy(seen))
            reward = jnp.where(goes_on, after.reward, 0.0)
            goes_on = goes_on & ~(after.terminated | after.truncated)
            return (after.episode, after.observation, goes_on), after._replace(reward=reward)

        # In reverse mode each step is taken again: what its solve would keep is a hundred times as long as a state.
        following = jax.checkpoint(following, prevent_cse=False)
        return jax.lax.scan(following, (*self.reset(key), jnp.ones((), bool)), None, length=count)[1]

    def robot(self, parameters: dict[str, Float[Array, "..."]], u: Float[Array, " m"]) -> System:
        """Returns the body with the parameters of an episode, while its inputs are ``u``."""
        system = with_numbers(self.sampled.system, parameters) if parameters else self.sampled.system
        return hold_inputs(system, self.sampled.places, u)

    def _start(self, key: Any) -> PlacedState:
        if not self.starts:
            return self.state
        xi = jnp.zeros(len(self.state.directions), self.sampled.sample.dtype)
        for name, places in directions_by_name(self.starts, self.state.directions).items():
            drawn = self.starts[name].draw(key_of_name(name, key), jnp.zeros(len(places), xi.dtype))
            # In local coordinates, so that an orientation that is drawn is one.
            xi = xi.at[np.array(places)].set(drawn)
        return self.state.retract(xi)

    def _parameters(self, key: Any) -> dict[str, Float[Array, "..."]]:
        nominal = require_numbers_of(self.sampled.system, self.parameters)
        return {name: self.parameters[name].draw(key_of_name(name, key), value) for name, value in nominal.items()}

    def _observe(self, key: Any, target: Any, moment: Moment, memory: Any) -> tuple[Float[Array, " numbers"], Any]:
        seen, memory = self.observation(key, moment, memory, self.sampled.sample)
        return jnp.concatenate([seen, self.goal.observe(target, moment)]) if self.shows_goal else seen, memory

    def _in_contact(self, moment: Moment, status: Int[Array, ""]) -> Int[Array, ""]:
        """Returns the status, or the status of a robot that leaves the plane or slips."""
        if self.friction is None:
            return status
        # Judged at the end of the step only, with the inputs that acted in it.
        force = moment.system.prepare().plane_reaction(moment.t, moment.state)
        slips = jnp.where(force.ratio > self.friction, int(Status.SLIPPED), int(Status.SUCCESS))
        # Where the plane does not press there is no friction to compare.
        contact_status = jnp.where(force.normal > 0, slips, int(Status.DETACHED)).astype(status.dtype)
        return jnp.where(status == Status.SUCCESS, contact_status, status)

    def __hash__(self) -> int:
        """Returns its identity, by which ``jax.jit`` knows its methods; equal ones have programs of their own."""
        return id(self)

    def __repr__(self) -> str:
        lines = [
            f"Environment of a {self.sampled.system.describe()}: {type(self.goal).__name__}",
            f"  {self.samples} samples of {float(self.sampled.sample):g}, inputs {', '.join(self.sampled.inputs)}",
            f"  {self.n_observations} numbers observed: {type(self.observation).__name__}"
            + (" and the goal" if self.shows_goal else ""),
        ]
        drawn = [*self.starts, *self.parameters, *(["delay"] if self.delay[0] < self.delay[1] else [])]
        return "\n".join([*lines, f"  drawn at each reset: {', '.join(drawn)}"] if drawn else lines)

    @leave_to(".adapters:gymnasium_env")
    def gymnasium(self) -> "gymnasium.Env":
        """Returns the environment as a ``gymnasium.Env``.

        Observations and actions are arrays of float32; actions are from −1 to 1. ``reset(seed=...)`` determines all
        that follows. ``info`` has ``status``, ``misses`` and ``u`` of a step.

        **Raises:** ``ImportError`` where Gymnasium is not installed.
        """
        raise NotImplementedError

    @leave_to(".adapters:gymnasium_vector_env")
    def gymnasium_vector(self, num_envs: int) -> "gymnasium.vector.VectorEnv":
        """Makes many copies of the environment side by side as a ``gymnasium.vector.VectorEnv``, compiled as one
        program.

        An episode that is over is followed by a new one in the same step, ``AutoresetMode.SAME_STEP``, as its
        ``metadata`` say: ``info["final_obs"]`` has the observation at its end where ``info["_final_obs"]`` is true.

        **Arguments:**

        - ``num_envs``: how many.

        **Raises:** ``ImportError`` where Gymnasium is not installed.
        """
        raise NotImplementedError

    @leave_to(".adapters:BraxEnvironment")
    def brax(self) -> "BraxEnvironment":
        """Returns the environment with the methods that wrappers and training loops of Brax call.

        **Example:**

        >>> import jax
        >>> jax.config.update("jax_enable_x64", True)
        >>> import jaxball
        >>> from jaxball.control.environments import Environment, ReachPoint
        >>> pendulum = jaxball.planar_pendulum(0.5, 0.6, drive=jaxball.Motor(0.0, limit=1.0))
        >>> robot = jaxball.Disk(mass=1.0, inertia=0.5, mechanisms=[pendulum])
        >>> like_brax = Environment(robot, ReachPoint(2.0), sample=0.1).brax()
        >>> state = like_brax.reset(jax.random.PRNGKey(0))
        >>> state = jaxball.jit(like_brax.step)(state, jax.numpy.array([0.5]))
        >>> state.obs.shape, float(state.done)
        ((12,), 0.0)
        """
        raise NotImplementedError


def _with_limits(sampled: SampledSystem, bounds: Numbers | Mapping[str, Numbers] | None) -> SampledSystem:
    limits = sampled.limits if bounds is None else limits_of(sampled, bounds)
    for name, limit in zip(sampled.inputs, limits, strict=True):
        if not is_traced(limit) and not np.isfinite(np.asarray(limit)):
            raise ValueError(
                f"Argument `limits` must be given for {name}, because actions are shares of limits and its motor has "
                "none; give limits=..., or Motor(..., limit=...)."
            )
    return eqx.tree_at(lambda s: s.limits, sampled, limits)


def _start(system: System, state: PlacedState | None) -> PlacedState:
    start: Any = at_rest(system) if state is None else state
    require("state", start, (BallState, RotationState, DiskState), "a BallState, a RotationState or a DiskState")
    require_one_state(system, start)
    return start


def _distributions(name: str, entries: Mapping[str, AbstractDistribution] | None) -> dict[str, AbstractDistribution]:
    if entries is None:
        return {}
    require(name, entries, Mapping, 'a dictionary of distributions by name, such as {"mass": Uniform(0.9, 1.1)}')
    for key, entry in entries.items():
        require(f"{name}[{key!r}]", entry, AbstractDistribution, "a distribution, such as Uniform(0.9, 1.1)")
    return dict(entries)


def _range(delay: Any) -> tuple[int, int]:
    if isinstance(delay, list | tuple):
        if len(delay) != 2:
            raise refusal("delay", "a whole number of samples, or the least and the most", delay)
        least = whole_number("delay[0]", delay[0], 0)
        return least, whole_number("delay[1]", delay[1], least)
    number = whole_number("delay", delay, 0)
    return number, number
