"""Steady motions of a ball and their linear stability: permanent rotations, and rolling in circles."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Complex, Float

from ... import programs
from ...interface.arguments import require
from ...interface.printing import Printed, format_value
from ...interface.wording import all_of
from ...numerics.arrays import Numbers, to_array, to_numpy
from ...numerics.vectors import cross
from ...physics.body import Ball, System
from ...physics.dynamics.moments import moments
from ...physics.packing import normal_of, phase_point
from ...physics.state import ReducedState, State
from ...physics.system import vector_field

STEADY = 1e-8  # the rate, in units of the largest eigenvalue, up to which a state counts as steady
NEUTRAL_EIGENVALUE = 1e-7  # the real part, in the same units, that counts as zero
ZERO_EIGENVALUE = 1e-5  # the size that counts as zero: a threefold zero is found as the cube root of the rounding error


class SteadyMotion(Printed):
    """A motion whose state is constant or turns about E3 at a constant rate, and its linear stability.

    - ``state``: the point of the phase space: a :class:`~jaxball.physics.ReducedState`, the state of a disk, or a
      :class:`~jaxball.BallState` where a force acts or the ground is tilted or moves.
    - ``turning``: the rate at which Ω and Γ turn about E3 in the body, rad/time; nonzero only for a body of revolution.
    - ``residual``: the largest rate of change of the state apart from this turning.
    - ``ok``: whether that is zero up to rounding.
    - ``eigenvalues``: of the equations linearised on the tangent of |Γ| = 1, in the co-rotating frame, in 1/time, the
      largest real part first.
    - ``kind``: "centre" if none has a real part, "sink" or "source" if all nonzero real parts are negative, or all
      positive, "saddle" if both occur, and "saddle-centre" if imaginary pairs occur as well. Zero eigenvalues, which
      come from symmetries and integrals, do not count.
    - ``message``: a sentence that says all this.
    """

    state: State
    turning: float
    residual: float
    ok: bool
    eigenvalues: Complex[np.ndarray, " n"]
    kind: str
    message: str

    def __repr__(self) -> str:
        eigenvalues = ", ".join(f"{value:.6g}" for value in self.eigenvalues)
        return f"Steady motion at {format_value(self.state)}\n  {self.message}\n  eigenvalues {eigenvalues}"

    @property
    def stable(self) -> bool:
        """Whether the motion is spectrally stable: no eigenvalue has a positive real part."""
        return self.kind in ("centre", "sink")

    @property
    def growth(self) -> float:
        """The largest real part of an eigenvalue."""
        return float(self.eigenvalues[0].real)


def steady_motion(system: System, state: State, *, turning: float = 0.0, t: Numbers = 0.0) -> SteadyMotion:
    """Computes the linear stability of a steady motion of ``system``.

    The derivative of the reduced equations (``uncon_ball_eqns_explicit``) comes from forward mode, and is restricted to
    δΓ orthogonal to Γ. Spectral stability is necessary for stability; for a motion without dissipation it only means
    that deviations do not grow exponentially.

    **Arguments:**

    - ``state``: of any kind; position and heading do not matter, unless a force acts or the ground is tilted or moves:
      then it must be a state at rest, and there are zero eigenvalues from the position and from |q| = 1.
    - ``turning``: the rate at which Ω and Γ turn about E3, for a body of revolution; see :func:`steady_rolling`.
    - ``t``: the time at which schedules are read; the masses must be at rest in the body at that time, and stay at
      rest.

    **Raises:** ``TypeError`` for a state of another kind of system.

    **Example:**

    >>> from jaxball import Disk, DiskState, Fixed, PointMass
    >>> from jaxball.analysis.stability import steady_motion
    >>> disk = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, Fixed((0.0, 0.0, 0.5)))])
    >>> steady_motion(disk, DiskState()).message  # with its mass on top
    'The motion is unstable, a saddle: deviations grow as exp(0.308607 t).'
    """
    state = phase_point(system, state)
    rates, derivative, normal = _linearise(system, state, to_array(turning), to_array(t))
    matrix = np.asarray(derivative)
    if normal is not None:  # on the vectors orthogonal to the normal of the sphere of Γ
        basis = np.linalg.svd(np.asarray(normal)[None])[2][1:]
        matrix = basis @ matrix @ basis.T
    eigenvalues = np.linalg.eigvals(matrix).astype(complex)
    # Rounded, so that the two of a complex pair compare as equal, and the sign of the imaginary part decides.
    eigenvalues = eigenvalues[np.lexsort((-np.imag(eigenvalues), -np.real(eigenvalues).round(12)))]
    # The frequency of rocking is the unit where all eigenvalues vanish, as for a uniform ball.
    size = max(float(np.max(np.abs(eigenvalues))), math.sqrt(abs(float(system.gravity)) / float(system.radius)))
    residual = float(np.max(np.abs(rates)))
    steady = residual <= STEADY * size
    kind = kind_of(eigenvalues / size)
    return SteadyMotion(
        state, turning, residual, steady, eigenvalues, kind, _message(steady, residual, kind, eigenvalues)
    )


def require_prescribed(ball: Ball) -> None:
    """Raises a ``ValueError`` where something in the ball moves by a law or freely, states of its own do, or
    resistance acts.
    """
    if ball.coordinates:
        moving = all_of(ball.coordinates)
        raise ValueError(
            f"Argument `ball` must have nothing that moves by a law or freely, but {moving} do; hold these with a "
            "schedule, or see `periodic_motion`."
        )
    if ball.own_states is not None:
        raise ValueError(
            f"Argument `ball` must have no `own_states`, but it has {all_of(ball.own_states.names)}; leave them out, "
            "or use `steady_motion`, which is given the values at which they are steady."
        )
    if not ball.is_reducible or ball.resistance is not None:
        raise ValueError(
            "Argument `ball` must roll on a level ground at rest, without force and resistance, but it has a `force`, "
            "a `ground` or a `resistance`; use `steady_motion` for any steady motion, `periodic_motion` for one that "
            "repeats."
        )


@programs.filter_jit
def _linearise(system: System, state: State, turning, t):
    """Computes the rates apart from the turning, their derivative, and the normal of the sphere of Γ, if any."""
    prepared = system.prepare()
    x, unravel = ravel_pytree(state)

    def field(x):
        point = unravel(x)
        rates = ravel_pytree(vector_field(prepared, t, point))[0]
        if not isinstance(point, ReducedState):
            return rates
        # In axes that turn with the motion, a precessing ball is at rest.
        axis = jnp.stack([jnp.zeros_like(turning), jnp.zeros_like(turning), turning])
        turned = jnp.zeros_like(x).at[:6].set(jnp.concatenate([cross(axis, point.Omega), cross(axis, point.Gamma)]))
        return rates - turned

    normal = normal_of(state)
    return field(x), jax.jacfwd(field)(x), None if normal is None else normal(x)


def kind_of(eigenvalues: np.ndarray) -> str:
    """Returns the kind, see :class:`SteadyMotion`, by eigenvalues in units of about the largest."""
    real = np.where(np.abs(eigenvalues) > ZERO_EIGENVALUE, np.real(eigenvalues), 0.0)
    growing, falling = bool(np.any(real > NEUTRAL_EIGENVALUE)), bool(np.any(real < -NEUTRAL_EIGENVALUE))
    turning = bool(np.any((np.abs(real) <= NEUTRAL_EIGENVALUE) & (np.abs(eigenvalues) > ZERO_EIGENVALUE)))
    if growing and falling:
        return "saddle-centre" if turning else "saddle"
    return "source" if growing else "sink" if falling else "centre"


def _message(steady: bool, residual: float, kind: str, eigenvalues: np.ndarray) -> str:
    if not steady:
        return (
            f"The state is not steady: it changes at the rate {residual:.3g}, so the eigenvalues say nothing about "
            "stability; use `periodic_motion` for motions that repeat."
        )
    if kind in ("centre", "sink"):
        decay = "all on the imaginary axis" if kind == "centre" else "none with a positive real part"
        return f"The motion is spectrally stable, a {kind}: its eigenvalues are {decay}."
    growth = eigenvalues[0].real
    return f"The motion is unstable, a {kind}: deviations grow as exp({growth:.6g} t)."


ROUND = 1e-9


def steady_rolling(ball: Ball, inclination: float, precession: float, *, t: Numbers = 0.0) -> SteadyMotion:
    """Computes the Routh sphere's steady motion: its axis E3 precesses about the vertical at a constant inclination.

    With Γ = (sin ϑ, 0, cos ϑ) and Ω = P Γ + σ E3, the balance of angular momentum about the centre of mass, where the
    contact force follows from the centre of mass's own circle, gives the spin σ relative to the plane through E3 and
    the vertical:

        P [ C + M r (r + ℓ cos ϑ) ] σ = M ℓ [ g + P² (r + ℓ cos ϑ) ] + P² (A − C) cos ϑ

    with A and C the moments about the centre of mass, across E3 and along it, and ℓ the height of the centre of mass on
    E3. In the body, Ω and Γ turn about E3 at −σ. The geometric centre moves on a circle of radius r |σ sin ϑ / P|.

    **Arguments:**

    - ``ball``: a body of revolution about E3.
    - ``inclination``: ϑ, from E3 to the vertical, in rad.
    - ``precession``: P, the rate of precession of E3 about the vertical, in rad per time; not zero.
    - ``t``: the time at which schedules are read; the masses must be at rest in the ball.

    **Raises:** ``ValueError`` when the ball is not a body of revolution about E3, when masses are driven by a feedback
    law, and for zero precession.

    **Example:**

    >>> from jaxball import Ball
    >>> from jaxball.analysis.stability import steady_rolling
    >>> sphere = Ball(mass=1.0, inertia=(0.4, 0.4, 0.5), offset=(0.0, 0.0, -0.2))
    >>> steady_rolling(sphere, inclination=0.5, precession=1.0).message
    'The motion is spectrally stable, a centre: its eigenvalues are all on the imaginary axis.'
    """
    require("ball", ball, Ball, "a Ball")
    require_prescribed(ball)
    if precession == 0:
        raise ValueError(
            "Argument `precession` must not be zero, because the ball would then rest or roll in a straight line."
        )
    nothing = jnp.zeros((0,))
    body_moments = moments(ball.prepare(), to_array(t), (nothing, nothing, nothing))
    p, J, M = np.asarray(body_moments.p), np.asarray(body_moments.J), float(body_moments.M)
    # A body of revolution has these at 0: the centre of mass off E3, the products of inertia, and the difference of
    # the moments across.
    across = np.abs(np.concatenate([p[:2], J[np.triu_indices(3, 1)], [J[0, 0] - J[1, 1]]]))
    if np.max(across) > ROUND * max(float(np.max(np.abs(J))), M * float(ball.radius)):
        raise ValueError(
            "Argument `ball` must be a body of revolution about E3, with equal moments across it and the centre of "
            f"mass on it, but its moments are {J.tolist()} and its centre of mass is at {(p / M).tolist()}."
        )
    r, g, height = float(ball.radius), float(ball.gravity), p[2] / M
    # By Steiner's theorem; along E3 the centre of mass is on the axis, and the moments are the same.
    A, C = J[0, 0] - M * height**2, J[2, 2]
    s, c = np.sin(inclination), np.cos(inclination)
    arm = r + height * c
    numerator = M * height * (g + precession**2 * arm) + precession**2 * (A - C) * c
    spin = float(numerator / (precession * (C + M * r * arm)))
    Gamma = np.array([s, 0.0, c])
    Omega = precession * Gamma + np.array([0.0, 0.0, spin])
    # Seen from the body, the vertical turns the other way.
    return steady_motion(ball, ReducedState(Omega, Gamma), turning=-spin, t=t)


STARTS = 128
SAME_MOTION = 1e-6


def permanent_rotations(
    ball: Ball, rate: float = 0.0, *, guess: Numbers | None = None, t: Numbers = 0.0
) -> tuple[SteadyMotion, ...]:
    """Finds the directions Γ about which ``ball`` can rotate forever at ``rate`` with its contact point at rest.

    For these, Ω = ω Γ, so that Γ̇ = 0, and Ω̇ = 0 is solved for Γ by Newton's method from many points of the sphere at
    once. With ``rate`` zero these are the equilibria, where the centre of mass is above or below the geometric centre.
    Where the directions are not isolated, as on a cone about the axis of a body of revolution, many of them are found.

    **Arguments:**

    - ``rate``: ω, in rad per time.
    - ``guess``: directions from which to search instead, shape (n, 3).
    - ``t``: the time at which schedules are read; the masses must be at rest in the ball.

    **Returns:** the motions found, each once, the most stable first.

    **Raises:** ``ValueError`` where a force acts, masses are driven by a feedback law, or ``guess`` has another shape.

    **Example:**

    >>> from jaxball import Ball
    >>> from jaxball.analysis.stability import permanent_rotations
    >>> ball = Ball(mass=1.0, inertia=(0.4, 0.5, 0.6), offset=(0.0, 0.0, -0.2))
    >>> [(motion.kind, round(float(motion.state.Gamma[2]), 6)) for motion in permanent_rotations(ball)]
    [('centre', 1.0), ('saddle', -1.0)]
    """
    require("ball", ball, Ball, "a Ball")
    require_prescribed(ball)
    starts = _sphere() if guess is None else np.atleast_2d(to_numpy(guess, "guess"))
    if starts.shape[1:] != (3,):
        raise ValueError(f"Argument `guess` must be directions of shape (n, 3), but its shape is {starts.shape}.")
    ends = np.asarray(_search(ball, to_array(rate), to_array(t), to_array(starts)))
    distinct: list[np.ndarray] = []
    # Newton's method ends in NaN from starts that lead nowhere.
    for Gamma in ends[np.all(np.isfinite(ends), axis=1)]:
        if all(np.max(np.abs(Gamma - other)) > SAME_MOTION for other in distinct):
            distinct.append(Gamma)
    motions = [steady_motion(ball, ReducedState(rate * Gamma, Gamma), t=t) for Gamma in distinct]
    # Others ended between motions, where the iterations ran out.
    return tuple(sorted((motion for motion in motions if motion.ok), key=lambda motion: motion.growth))


@programs.filter_jit
def _search(ball: Ball, rate, t, starts) -> Float[Array, "n 3"]:
    prepared = ball.prepare()

    def residual(Gamma, _: Any):
        rates = vector_field(prepared, t, ReducedState(rate * Gamma, Gamma))
        # Γ·BΩ̇ = 0 for every Γ, so that the sum is zero only where both terms are.
        return rates.Omega + Gamma * (jnp.sum(Gamma**2) - 1)

    def one(start):
        newton = optimistix.Newton(rtol=1e-13, atol=1e-13)
        Gamma = optimistix.root_find(residual, newton, start, max_steps=60, throw=False).value
        # Newton's method leaves the sphere by its tolerance.
        return Gamma / jnp.sqrt(jnp.sum(Gamma**2))

    return jax.vmap(one)(starts / jnp.sqrt(jnp.sum(starts**2, axis=1))[:, None])


def _sphere() -> np.ndarray:
    """Returns points that cover the sphere evenly, on a golden spiral."""
    height = 1 - (2 * np.arange(STARTS) + 1) / STARTS
    azimuth = np.pi * (3 - np.sqrt(5)) * np.arange(STARTS)
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=1)
