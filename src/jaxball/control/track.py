"""A time-varying linear quadratic regulator along a motion: the feedback that holds it at the least cost.

Its gains follow from the Riccati recursion in square-root form. The cost-to-go of a deviation ξ from a motion is
|S (ξ, 1)|², with S upper triangular. It follows from that of the next sample by a QR factorisation, without subtraction
and without the inverse of anything but a triangle that the weights of the inputs keep regular; so S may be singular,
where deviations cost nothing. Source: Kailath, Sayed & Hassibi, *Linear Estimation* (2000), chapter 12, for the filter
that is dual to it.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .. import programs
from ..interface.compat import is_traced
from ..interface.names import leave_to
from ..interface.printing import format_value
from ..interface.status import PENALTY
from ..interface.wording import number_of
from ..numerics.arrays import AnyArray, Numbers, default_dtype, to_numpy
from ..simulation import DEFAULT_TOLERANCE
from ..simulation.trajectory import Trajectory
from .feedback import AbstractFeedback, NominalMotion, nominal_of, require_motion, samples_in
from .sampled import Linear, SampledSystem, uncontrollable
from .weights import Weights, factor, require_positive, weight_matrix

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

    from .prediction import PredictiveControl


class Regulator(NamedTuple):
    """The best feedback of each sample, δu = −K ξ − k, and its cost-to-go.

    - ``K``, ``k``: shapes (N, m, n) and (N, m).
    - ``P``: of (ξ, 1), symmetric: the cost from each sample on is (ξ, 1)·P (ξ, 1), shape (N + 1, n + 1, n + 1).
    """

    K: Float[Array, "samples m n"]
    k: Float[Array, "samples m"]
    P: Float[Array, "samples_and_end n_plus_one n_plus_one"]


def regulator(linear: Linear, W: Float[Array, "rows n_plus_m"], S: Float[Array, "n_plus_one n_plus_one"]) -> Regulator:
    """Computes the regulator with the least Σ |W (ξ, δu)|² + |S (ξ, 1)|² at the end, for ξ⁺ = A ξ + B δu + c.

    ``WᵀW`` must be positive definite in δu. It can be differentiated in both modes.
    """
    A, B = _homogeneous(linear)
    gains, P = _solve_backward(A, B, W, S)
    return Regulator(gains[..., :-1], gains[..., -1], P)


def stationary(linear: Linear, W: Float[Array, "rows n_plus_m"], samples: int) -> Float[Array, "n_plus_one n_plus_one"]:
    """Computes S at the start of ``samples`` samples of one linear flow, without its c: near its limit, if there are
    enough.
    """
    # With c, which the motion itself misses, the cost would grow with every repeated sample; without it there is a
    # limit.
    A, B = _homogeneous(linear._replace(c=jnp.zeros_like(linear.c)))
    n = linear.A.shape[-1]
    end = jnp.zeros((n + 1, n + 1), A.dtype)

    def step(S, _):
        return _previous(A, B, W, S)[1], None

    return jax.lax.scan(step, end, length=samples)[0]


def _homogeneous(linear: Linear) -> tuple[Array, Array]:
    """Returns A and B of (ξ, 1)."""
    A, B, c = linear
    below = jnp.zeros_like(A[..., :1, :])
    last = jnp.concatenate([below, below[..., :1] + 1], axis=-1)
    A = jnp.concatenate([jnp.concatenate([A, c[..., None]], axis=-1), last], axis=-2)
    return A, jnp.concatenate([B, jnp.zeros_like(B[..., :1, :])], axis=-2)


def _previous(A: Array, B: Array, W: Array, S: Array) -> tuple[Array, Array]:
    """Computes the gain of a sample, and S at its start, from S at its end."""
    size, m = B.shape
    # Inputs come first, so that the triangle's first rows have the gain, and the rest of it is S.
    now = jnp.concatenate([W[:, size - 1 :], W[:, : size - 1], jnp.zeros_like(W[:, :1])], axis=1)
    stacked = jnp.concatenate([now, jnp.concatenate([S @ B, S @ A], axis=1)])
    triangle = jnp.linalg.qr(stacked, mode="r")
    gain = jax.scipy.linalg.solve_triangular(triangle[:m, :m], triangle[:m, m:])
    return gain, triangle[m:, m:]


@jax.custom_jvp
def _solve_backward(A: Array, B: Array, W: Array, S: Array) -> tuple[Array, Array]:
    """Computes the gains of all samples, and P = SᵀS at each and at the end."""

    def step(S, sample):
        A, B = sample
        gain, before = _previous(A, B, W, S)
        return before, (gain, before.T @ before)

    gains, P = jax.lax.scan(step, S, (A, B), reverse=True)[1]
    return gains, jnp.concatenate([P, (S.T @ S)[None]])


@_solve_backward.defjvp
def _derivative(primals, tangents):
    """Differentiates by the recursion for P itself, in Joseph's form: a triangle that is singular has no
    derivatives.
    """
    return _solve_backward(*primals), jax.jvp(_by_joseph, primals, tangents)[1]


def _by_joseph(A: Array, B: Array, W: Array, S: Array) -> tuple[Array, Array]:
    size = A.shape[-1]
    # The constant 1, the last component, has no weight of its own.
    Wx = jnp.concatenate([W[:, : size - 1], jnp.zeros_like(W[:, :1])], axis=1)
    Wu = W[:, size - 1 :]

    def step(P, sample):
        A, B = sample
        gain = jnp.linalg.solve(Wu.T @ Wu + B.T @ P @ B, Wu.T @ Wx + B.T @ P @ A)
        closed, cost = A - B @ gain, Wx - Wu @ gain
        before = closed.T @ P @ closed + cost.T @ cost
        return before, (gain, before)

    end = S.T @ S
    gains, P = jax.lax.scan(step, end, (A, B), reverse=True)[1]
    return gains, jnp.concatenate([P, end[None]])


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

    @leave_to(".prediction")
    def mpc(
        self,
        horizon: int,
        *,
        limits: Numbers | Mapping[str, Numbers] | None = None,
        friction: Numbers | None = None,
        penalty: Numbers = PENALTY,
    ) -> "PredictiveControl":
        """Makes model predictive control along a motion, which foresees its limits.

        At each sample it finds the inputs over a horizon that have the least cost of the track along its linear flow,
        with its cost-to-go beyond, among those within the limits; and applies the first. Where its regulator keeps the
        limits, it is the same. It begins from its last plan. Limits that cannot be kept are exceeded as little as their
        ``penalty`` makes best; :meth:`PredictiveControl.exceeded` names them.

        Plans can be differentiated in both modes, by all numbers, also where limits are active.

        Friction and normal force are linearised along the motion. The friction cone is replaced by a pyramid of eight
        sides within it, in which the normal force is positive too.

        **Arguments:**

        - ``horizon``: the number of samples ahead; at most those of the motion.
        - ``limits``: the largest magnitude of each input: a number for all, a row, or numbers by name; by default those
          of the motors.
        - ``friction``: the coefficient μ of |f| ≤ μ N; if not given, only N ≥ 0 is required.
        - ``penalty``: the cost, per time, of exceeding a limit by its own size, and the friction cone by the weight. It
          must be more than keeping a limit costs, or limits that could be kept are exceeded.

        **Raises:** ``ValueError`` for a horizon below 1, and for limits, friction or a penalty that are not positive or
        do not fit.

        **Example:**

        >>> import jax
        >>> jax.config.update("jax_enable_x64", True)
        >>> from jaxball import Disk, Motor, planar_pendulum, simulate
        >>> from jaxball.control import tvlqr
        >>> robot = Disk(mass=1.0, inertia=0.5, mechanisms=[planar_pendulum(0.5, 0.6, drive=Motor(0.0, limit=0.05))])
        >>> track = tvlqr(simulate(robot, [0.0, 5.0]), Q={"phi": 1.0, "theta": 1.0}, R=1.0, sample=0.05)
        >>> control = track.mpc(20, friction=0.3)
        >>> control.names
        ('mechanisms[0].joints[0]', '-mechanisms[0].joints[0]', 'friction[0]', 'friction[1]')
        >>> plan = control.plan(0, track.nominal.state(0).retract([0.3, 0.0, 0.0, 0.0, 0.0]))
        >>> control.exceeded(plan), bool(abs(plan.z[0, -1]) <= 0.05 + 1e-9)
        ((), True)
        """
        raise NotImplementedError

    @leave_to("..plot.control:gains")
    def plot(self, name: str | None = None, ax: "matplotlib.axes.Axes | None" = None) -> "matplotlib.axes.Axes":
        """Draws the gains of one input over time, one line for each local coordinate whose gain is not 0 throughout.

        **Arguments:**

        - ``name``: that of the input; the first if not given.

        **Raises:** ``ValueError`` for an unknown input, and when ``ax`` is three-dimensional.
        """
        raise NotImplementedError


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

    For motions of any shape that are found by optimisation, see :mod:`jaxball.studies.design.optimal_control`.

    **Arguments:**

    - ``run``: what :func:`jaxball.simulate` returns, of a ball or a disk that rolls.
    - ``Q``, ``R``: weights of ξ and of δu per time: a number for all, a row of numbers, a matrix, or a dictionary of
      numbers by name, where ``"z"`` stands for all entries of z and names left out have weight 0. ``R`` must be
      positive. They may be traced, and gains be differentiated by them.
    - ``Qf``: the same at the end; by default the cost-to-go of the last sample's linearisation, repeated over another
      length of the motion, which for a motion that ends at rest holds it there.
    - ``cross``: weights of products of ξ and δu, shape (n, m); none if not given.
    - ``sample``: h; 100 a unit of time by default. Only whole samples are held: of a run to 4 sampled each 0.03, 133,
      which end at 3.99.
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
