"""A time-varying linear quadratic regulator along a motion: the feedback that holds it at the least cost."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .. import programs
from ..compat import is_traced
from ..interface.printing import format_value
from ..interface.wording import number_of
from ..numerics.arrays import AnyArray, Numbers, default_dtype, to_numpy
from ..simulation import DEFAULT_TOLERANCE
from ..simulation.trajectory import Trajectory
from .feedback import AbstractFeedback, NominalMotion, nominal_of, require_motion, samples_in
from .riccati import Regulator, regulator, stationary
from .sampled import Linear, SampledSystem, uncontrollable
from .weights import Weights, factor, require_positive, weight_matrix

SAMPLE = 0.01


class Track(AbstractFeedback):
    """The feedback δu = −K ξ − k along a motion, of :func:`tvlqr`.

    - ``sampled``, ``nominal``: the robot with its inputs, and the motion.
    - ``linear``: the flow of each sample in local coordinates ξ around the motion.
    - ``regulator``: K and k of each sample, and the cost-to-go.
    - ``W``: the weights of a sample: its cost is |W (ξ, δu)|².
    - ``directions``: the names of the local coordinates.
    """

    linear: Linear
    regulator: Regulator
    W: Float[Array, "rows n_plus_m"]
    directions: tuple[str, ...] = eqx.field(static=True)

    @property
    def times(self) -> Float[Array, " samples"]:
        """The times of the samples."""
        return self.nominal.times[:-1]

    @property
    def gains(self) -> Float[Array, "samples m n"]:
        """K of each sample."""
        return self.regulator.K

    @property
    def inputs(self) -> tuple[str, ...]:
        """The names of the inputs."""
        return self.sampled.inputs

    @property
    def uncontrollable(self) -> tuple[str, ...]:
        """The combinations of local coordinates at the end that no input changes, such as ``"z + phi"``, by name."""
        return uncontrollable(self.linear, self.directions)

    def __call__(self, k, state, memory):
        # After the end its last gain is held.
        sample = jnp.minimum(k, self.nominal.samples - 1)
        return -self.regulator.K[sample] @ self.deviation(k, state) - self.regulator.k[sample], memory

    def cost(self, xi: Float[Array, "samples_and_end n"], du: Float[Array, "samples m"]) -> Float[Array, ""]:
        """Computes Σ |W (ξ, δu)|² over samples, and the cost of ξ at the end: the sum that the regulator
        makes least.
        """
        now = jnp.concatenate([xi[:-1], du], axis=1) @ self.W.T
        end = jnp.append(xi[-1], 1.0)
        return jnp.sum(now**2) + end @ self.regulator.P[-1] @ end

    def __repr__(self) -> str:
        if is_traced(self.W):
            return f"Track of a {self.sampled.system.describe()}, traced"
        times, sizes = self.nominal.times, np.max(np.abs(np.asarray(self.gains)), axis=(0, 2))
        lines = [
            f"Track of a {self.sampled.system.describe()}",
            f"  {number_of(self.nominal.samples, 'sample')} of {format_value(self.sampled.sample)}, "
            f"from {float(times[0]):g} to {float(times[-1]):g}",
            *(f"  {name}: gains up to {size:.4g}" for name, size in zip(self.inputs, sizes, strict=True)),
        ]
        fixed = self.uncontrollable
        return "\n".join([*lines, f"  no input changes {', '.join(fixed)}"] if fixed else lines)


def tvlqr(
    run: Trajectory[Any, Any],
    Q: Weights,
    R: Weights,
    Qf: Weights | None = None,
    *,
    cross: Numbers | None = None,
    sample: Numbers = SAMPLE,
    inputs: Sequence[str] | None = None,
    rtol: Numbers = DEFAULT_TOLERANCE,
    atol: Numbers = DEFAULT_TOLERANCE,
) -> Track:
    """Computes the linear quadratic regulator along a motion: the feedback, sampled and held, that holds it at the
    least cost.

    It minimises Σ h (ξ·Q ξ + 2 ξ·cross δu + δu·R δu) + ξ·Qf ξ over the samples and at the end, where h is the time
    between samples, so that weights keep their meaning at other rates. ξ are the deviations in the local coordinates of
    the state: three of the attitude, a rotation vector in body axes, then Ω, the position, θ and θ̇, in the order of
    ``track.directions``; of a uniform ball those of the attitude are 0 and those of Ω are in space axes, see
    :meth:`SampledSystem.deviation`. The flow of each sample is linearised exactly, by differentiating its solve.

    What is to move the robot is an effort or an acceleration: see :class:`SampledSystem`. A joint with a schedule in
    ``run`` becomes one with a motor, which in the motion has the effort of the run. After the end, the last state,
    input and gain are held. Where deviations of a symmetry have weight 0, such as those of the place on a level plane,
    they cost nothing and do not act on the inputs: the robot then holds its motion from wherever it is.

    For motions of any shape that are found by optimisation, see :mod:`jaxball.design.optimal_control`.

    **Arguments:**

    - ``run``: what :func:`jaxball.simulate` returns, of a ball or a disk that rolls.
    - ``Q``, ``R``: weights of ξ and of δu per time: a number for all, a row of numbers, a matrix, or a dictionary of
      numbers by name, where ``"z"`` stands for all entries of z and names left out have weight 0. ``R`` must be
      positive. They may be traced, and gains be differentiated by them.
    - ``Qf``: the same at the end; by default the cost-to-go of the last sample's linearisation, repeated over another
      length of the motion, which for a motion that ends at rest holds it there.
    - ``cross``: weights of products of ξ and δu, shape (n, m); none if not given.
    - ``sample``: h; 100 a unit of time by default.
    - ``inputs``: names of the inputs, such as ``"mechanisms[0].joints[0]"``; by default all that a schedule, a law or a
      motor moves.
    - ``rtol``, ``atol``: tolerances of the solve of a sample.

    **Raises:** ``ValueError`` for a motion that is too short, one without inputs, unknown names, weights of another
    shape or sign; :class:`~jaxball.SolveError` for a run that failed.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> from jaxball import Disk, DiskState, Motor, planar_pendulum, simulate
    >>> from jaxball.control import tvlqr
    >>> robot = Disk(mass=1.0, inertia=0.5, mechanisms=[planar_pendulum(0.5, 0.6, drive=Motor(0.0, limit=0.2))])
    >>> run = simulate(robot, [0.0, 2.0])
    >>> track = tvlqr(run, Q={"phi": 1.0, "theta": 1.0}, R=1.0)
    >>> track.gains.shape, track.directions
    ((200, 1, 5), ('phi', 'phidot', 'z', 'theta[0]', 'thetadot[0]'))
    >>> track.uncontrollable  # z = −r φ, wherever the disk began
    ('phi + z',)
    """
    require_motion(run)
    sampled = SampledSystem.of(run.system, sample, inputs, rtol, atol)
    # The count decides the shapes, so that the sample is a number and not traced.
    count = samples_in(run.times, float(to_numpy(sample, "sample")))
    nominal = nominal_of(run, sampled, count)
    factors = factors_of(float(to_numpy(sample, "sample")), sampled, Q, R, Qf, cross)
    return build_track(sampled, nominal, *factors)


def build_track(
    sampled: SampledSystem,
    nominal: NominalMotion,
    W: Float[Array, "rows n_plus_m"],
    S: Float[Array, "rows_at_end n_plus_one"] | None,
) -> Track:
    """Builds the regulator along a motion, with factors of its weights; traceable."""
    linear, regulator = _regulate(sampled, nominal, W, S)
    return Track(sampled, nominal, linear, regulator, W, sampled.directions)


def factors_of(
    h: float, sampled: SampledSystem, Q: Weights, R: Weights, Qf: Weights | None, cross: Numbers | None = None
) -> tuple[Float[Array, "rows n_plus_m"], Float[Array, "rows_at_end n_plus_one"] | None]:
    """Returns W of the weights of a sample, and S of the weights at the end, None without them; weights may be traced.

    **Raises:** ``ValueError`` for weights of another shape or sign, and unknown names.
    """
    directions, dtype = sampled.directions, default_dtype()
    W = jnp.asarray(_factor(h, Q, R, cross, directions, sampled.inputs), dtype)
    if Qf is None:
        return W, None
    # The deviation is followed by the constant 1, which costs nothing at the end.
    return W, jnp.pad(jnp.asarray(factor(weight_matrix("Qf", Qf, directions)), dtype), (0, 1))


def _factor(
    h: float, Q: Weights, R: Weights, cross: Numbers | None, directions: Sequence[str], inputs: Sequence[str]
) -> Float[AnyArray, "rows n_plus_m"]:
    """Computes W of the weights of a sample."""
    n, m = len(directions), len(inputs)
    state, control = weight_matrix("Q", Q, directions), weight_matrix("R", R, inputs)
    traced = is_traced(state) or is_traced(control)
    if not traced:
        # Q may be singular, but R may not: the recursion divides by it.
        require_positive("R", control, strictly=True)
    mixed = np.zeros((n, m)) if cross is None else to_numpy(cross, "cross")
    if mixed.shape != (n, m):
        raise ValueError(f"Argument `cross` must be an array of shape ({n}, {m}), but its shape is {mixed.shape}.")
    if traced:
        return factor(h * jnp.block([[jnp.asarray(state), mixed], [mixed.T, control]]))
    whole = np.block([[state, mixed], [mixed.T, control]])
    require_positive("Q, R and cross" if cross is not None else "Q", whole)
    return factor(h * whole)


@programs.filter_jit
def _regulate(sampled: SampledSystem, nominal: NominalMotion, W: Array, S: Array | None) -> tuple[Linear, Regulator]:
    linear = linearise_flow(sampled, nominal)
    if S is None:
        # A motion that ends at rest can be held there for ever; the same number of samples as the motion has comes
        # close to that.
        S = stationary(jax.tree.map(lambda leaf: leaf[-1], linear), W, nominal.samples)
    return linear, regulator(linear, W, S)


def linearise_flow(sampled: SampledSystem, nominal: NominalMotion) -> Linear:
    """Linearises the flow of each sample along a motion."""
    before = jax.tree.map(lambda leaf: leaf[:-1], nominal.states)
    after = jax.tree.map(lambda leaf: leaf[1:], nominal.states)
    return jax.lax.map(
        lambda arguments: sampled.linearise_deviation(*arguments), (nominal.times[:-1], before, nominal.u, after)
    )
