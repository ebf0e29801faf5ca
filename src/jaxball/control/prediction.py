"""Model predictive control along a motion: the best inputs over a horizon, within limits of motors and of friction."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .. import programs
from ..interface.arguments import whole_number
from ..interface.compat import is_traced
from ..interface.status import PENALTY
from ..numerics.arrays import Numbers, positive_number
from ..physics.observables import movement
from ..physics.state import PlacedState, RotationState
from .feedback import AbstractFeedback
from .loop import limits_of
from .quadratic_program import Plan, Stages, solve_stages
from .track import Track

FACETS = 8  # of the pyramid within the friction cone


class Limits(NamedTuple):
    """What bounds ξ and δu of each sample: L G (ξ, δu) ≤ d, in units of each limit.

    - ``G``: inputs that have limits, and the reaction of the plane over the weight, linearised, shape (N, q, n + m).
    - ``L``: their combinations that are bounded, shape (p, q).
    - ``d``: shape (N, p).
    """

    G: Float[Array, "samples q n_plus_m"]
    L: Float[Array, "p q"]
    d: Float[Array, "samples p"]


class Memory(NamedTuple):
    """What a predictive controller remembers: its last plan, and by how much each limit has been exceeded at most."""

    plan: Plan
    worst: Float[Array, " p"]


class PredictiveControl(AbstractFeedback):
    """Model predictive control along a motion, of :meth:`Track.mpc`.

    - ``sampled``, ``nominal``: the robot with its inputs, and the motion.
    - ``track``: the regulator, whose linear flow and weights it has, and whose cost-to-go is that beyond the horizon.
    - ``limits``: the linearised limits of each sample.
    - ``penalty``: the cost of exceeding a limit by its own size, per time.
    - ``horizon``: the number of samples that it looks ahead.
    - ``names``: of the limits.
    """

    track: Track
    limits: Limits
    penalty: Float[Array, ""]
    horizon: int = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)

    @property
    def directions(self) -> tuple[str, ...]:
        """The names of the local coordinates."""
        return self.track.directions

    def begin(self) -> Memory:
        H, p, size = self.horizon, len(self.limits.L), self.limits.G.shape[-1]
        zero = jnp.zeros((H, p), self.penalty.dtype)
        plan = Plan(jnp.zeros((H, size), zero.dtype), zero, zero, jnp.asarray(0), jnp.asarray(True))
        return Memory(plan, zero[0])

    def __call__(self, k: Int[Array, ""], state: PlacedState, memory: Memory) -> tuple[Float[Array, " m"], Memory]:
        plan = solve_stages(self.stages(k), self.deviation(k, state), _shift(memory.plan))
        worst = jnp.maximum(memory.worst, plan.exceeded[0])
        return plan.z[0, len(self.directions) :], Memory(plan, worst)

    def stages(self, sample: Int[Array, ""]) -> Stages:
        """Returns the program of a sample. After the end of the motion, the program of its last sample goes on."""
        # Beyond the end, stages repeat that of the last sample, and the cost-to-go is that at the end.
        ahead = jnp.minimum(sample + jnp.arange(self.horizon), self.nominal.samples - 1)
        end = jnp.minimum(sample + self.horizon, self.nominal.samples)
        A, B, c, K, k = (part[ahead] for part in (*self.track.linear, *self.track.regulator[:2]))
        M, P = self.track.W.T @ self.track.W, self.track.regulator.P[end]
        G, L, d = self.limits
        # The penalty is a cost per time, as the weights are.
        return Stages(A, B, c, K, k, M, P, G[ahead], L, d[ahead], self.sampled.sample * self.penalty)

    def plan(self, k: int, state: PlacedState) -> Plan:
        """Computes the plan of sample ``k`` at ``state``, without one to start from."""
        return _plan(self, jnp.asarray(whole_number("k", k, 0)), state)

    def exceeded(self, plan: Plan) -> tuple[str, ...]:
        """Writes a sentence for each limit that a plan exceeds, because it cannot be kept: by how much, and how far
        ahead.
        """
        beyond = np.asarray(plan.exceeded)
        sentences = []
        for row, name in enumerate(self.names):
            if np.any(beyond[:, row]):
                stage = int(np.argmax(beyond[:, row]))
                ahead = stage * float(self.sampled.sample)
                sentences.append(
                    f"{name} cannot be kept: the plan exceeds it by {beyond[stage, row]:.3g} of it, {ahead:g} ahead."
                )
        return tuple(sentences)

    def __repr__(self) -> str:
        samples = self.nominal.samples
        ahead = f"{min(self.horizon, samples)} of {samples} samples ahead"
        return f"Predictive control of a {self.sampled.system.describe()}\n  {ahead}, limits: {', '.join(self.names)}"


def mpc(
    track: Track,
    horizon: int,
    *,
    limits: Numbers | Mapping[str, Numbers] | None = None,
    friction: Numbers | None = None,
    penalty: Numbers = PENALTY,
) -> PredictiveControl:
    ahead = whole_number("horizon", horizon, 1)
    most = track.sampled.limits if limits is None else limits_of(track.sampled, limits)
    mu = None if friction is None else positive_number("friction", friction)
    cost = positive_number("penalty", penalty)
    return predictive(track, ahead, most, mu, cost, inputs_with_limits(most))


def inputs_with_limits(most: Float[Array, " m"]) -> tuple[int, ...]:
    """Returns the inputs that have limits, by their numbers; all where limits are traced."""
    if is_traced(most):
        # Whether a traced number is finite is not known while it is traced.
        return tuple(range(len(most)))
    return tuple(np.flatnonzero(np.isfinite(np.asarray(most))).tolist())


def predictive(
    track: Track,
    ahead: int,
    most: Float[Array, " m"],
    mu: Float[Array, ""] | None,
    cost: Float[Array, ""],
    limited: tuple[int, ...],
) -> PredictiveControl:
    """Makes predictive control with limits of the inputs that are ``limited``; traceable."""
    rows = _limits(track, most, mu, limited)
    inputs = [sign + track.inputs[i] for i in limited for sign in ("", "-")]
    of_plane = ["normal force"] if mu is None else [f"friction[{j}]" for j in range(len(rows.L) - len(inputs))]
    return PredictiveControl(track.sampled, track.nominal, track, rows, cost, ahead, (*inputs, *of_plane))


def _limit_rows(track: Track, mu: Array | None, limited: tuple[int, ...]) -> Float[Array, "p q"]:
    """Returns L: both signs of each limited input, and the sides of the pyramid of friction; without friction, N alone.

    G has the limited inputs, and then f and N over the weight. The sides, whose normals are in space axes, touch a cone
    that is narrower, so that their edges lie on the friction cone; a disk, which moves along e1, has two.
    """
    sides = 2 if track.sampled.system.planar else FACETS
    inner = 1.0 if sides == 2 else np.cos(np.pi / sides)
    angles = 2 * np.pi * np.arange(sides) / sides
    of_inputs = np.kron(np.eye(len(limited)), [[1.0], [-1.0]]).reshape(2 * len(limited), len(limited))
    normal = np.array([[0.0, 0.0, -1.0]])
    cone = np.stack([np.cos(angles), np.sin(angles), np.zeros(sides)], axis=1)
    of_plane = jnp.asarray(normal if mu is None else cone, track.W.dtype)
    if mu is not None:
        of_plane = of_plane.at[:, 2].set(-mu * inner)
    above = jnp.asarray(np.pad(of_inputs, ((0, 0), (0, 3))), track.W.dtype)
    return jnp.concatenate([above, jnp.pad(of_plane, ((0, 0), (len(limited), 0)))])


@programs.filter_jit
def _limits(track: Track, most: Array, mu: Array | None, limited: tuple[int, ...]) -> Limits:
    """Returns the limits of each sample, linearised."""
    sampled, nominal, n = track.sampled, track.nominal, len(track.directions)
    weight = sampled.system.total_mass * jnp.abs(sampled.system.gravity)
    # Rows are in units of each limit, so that one penalty suits all. A limit of 0 would divide by 0, and one that is
    # infinite, which is known only without a trace, is a row of 0 ≤ 1.
    limited_at_all = jnp.isfinite(most)
    scale = jnp.where(limited_at_all, jnp.where(most > 0, most, 1.0), jnp.inf)
    most_in_units = jnp.where(limited_at_all, most / scale, 1.0)
    L, indices = _limit_rows(track, mu, limited), np.asarray(limited, dtype=int)

    def one(t: Array, state: PlacedState, u: Array) -> tuple[Array, Array]:
        def quantities_with_limits(v: Array) -> Array:
            placed = sampled.displace(state, v[:n])
            placed = placed.in_space() if isinstance(placed, RotationState) else placed
            held = u + v[n:]
            R = movement(sampled.hold(held).prepare(), t, placed).R / weight
            return jnp.concatenate([(held / scale)[indices], R])

        zero = jnp.zeros(n + u.size, u.dtype)
        most_of_rows = jnp.append(jnp.repeat(most_in_units[indices], 2), jnp.zeros(len(L) - 2 * len(indices), u.dtype))
        return jax.jacfwd(quantities_with_limits)(zero), most_of_rows - L @ quantities_with_limits(zero)

    before = jax.tree.map(lambda leaf: leaf[:-1], nominal.states)
    G, d = jax.lax.map(lambda arguments: one(*arguments), (nominal.times[:-1], before, nominal.u))
    return Limits(G, L, d)


@programs.filter_jit
def _plan(control: PredictiveControl, k: Int[Array, ""], state: PlacedState) -> Plan:
    return solve_stages(control.stages(k), control.deviation(k, state))


def _shift(plan: Plan) -> Plan:
    """Takes a plan from its second stage on, with the last stage twice."""
    # The horizon moves on by a sample; the new last stage has nothing better than the one before.
    on: Any = jax.tree.map(lambda leaf: jnp.concatenate([leaf[1:], leaf[-1:]]), (plan.z, plan.multipliers))
    return plan._replace(z=on[0], multipliers=on[1])
