"""Steady motions and their stability by the eigenvalues of the linearised equations."""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Complex

from ..interface.printing import Printed, shown
from ..interface.wording import all_of
from ..numerics import programs
from ..numerics.arrays import Numbers, to_array
from ..numerics.vectors import cross
from ..physics.body import Ball, System
from ..physics.phase_space import normal_of, phase_point
from ..physics.state import ReducedState, State
from ..physics.system import vector_field

STEADY = 1e-8  # the rate, in units of the largest eigenvalue, up to which a state counts as steady
NEUTRAL = 1e-7  # the real part, in the same units, that counts as zero
ZERO = 1e-5  # the size that counts as zero: a threefold zero is found as the cube root of the rounding error


class SteadyMotion(Printed):
    """A motion whose state is constant or turns about E3 at a constant rate, and its linear stability.

    - ``state``: the point of the phase space: a :class:`~jaxball.ReducedState`, the state of a disk, or a
      :class:`~jaxball.BallState` where a force acts or the ground is tilted or moves.
    - ``turning``: the rate at which Ω and Γ turn about E3 in the body, rad/time; nonzero only for a body of revolution.
    - ``residual``: the largest rate of change of the state apart from this turning.
    - ``steady``: whether that is zero up to rounding.
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
    steady: bool
    eigenvalues: Complex[np.ndarray, " n"]
    kind: str
    message: str

    def __repr__(self) -> str:
        eigenvalues = ", ".join(f"{value:.6g}" for value in self.eigenvalues)
        return f"Steady motion at {shown(self.state)}\n  {self.message}\n  eigenvalues {eigenvalues}"

    @property
    def stable(self) -> bool:
        """Whether the motion is spectrally stable: no eigenvalue has a positive real part."""
        return self.kind in ("centre", "sink")

    @property
    def growth(self) -> float:
        """The largest real part of an eigenvalue."""
        return float(self.eigenvalues[0].real)


def stability(system: System, state: State, *, turning: float = 0.0, t: Numbers = 0.0) -> SteadyMotion:
    """The linear stability of a steady motion of ``system``.

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
    >>> from jaxball.stability import stability
    >>> disk = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, Fixed((0.0, 0.0, 0.5)))])
    >>> stability(disk, DiskState()).message  # with its mass on top
    'The motion is unstable, a saddle: deviations grow as exp(0.308607 t).'
    """
    state = phase_point(system, state)
    rates, derivative, normal = _linearised(system, state, to_array(turning), to_array(t))
    eigenvalues = np.linalg.eigvals(_on_tangent(np.asarray(derivative), normal)).astype(complex)
    eigenvalues = eigenvalues[np.lexsort((-np.imag(eigenvalues), -np.real(eigenvalues).round(12)))]
    size = max(float(np.max(np.abs(eigenvalues))), math.sqrt(abs(float(system.gravity)) / float(system.radius)))
    residual = float(np.max(np.abs(rates)))
    steady = residual <= STEADY * size
    kind = kind_of(eigenvalues / size)
    return SteadyMotion(
        state, turning, residual, steady, eigenvalues, kind, _message(steady, residual, kind, eigenvalues)
    )


def require_prescribed(ball: Ball) -> None:
    """Raises a ``ValueError`` where something in the ball moves by a law or freely, or resistance acts."""
    if ball.coordinates:
        moving = all_of(ball.coordinates)
        raise ValueError(
            f"Argument `ball` must have nothing that moves by a law or freely, but {moving} do; hold these with a "
            "schedule, or see `periodic_motion`."
        )
    if not ball.is_reducible or ball.resistance is not None:
        raise ValueError(
            "Argument `ball` must roll on a level ground at rest, without force and resistance, but it has a `force`, "
            "a `ground` or a `resistance`; use `stability` for any steady motion, `periodic_motion` for one that "
            "repeats."
        )


@programs.filter_jit
def _linearised(system: System, state: State, turning, t):
    """The rates apart from the turning, their derivative, and the normal of the sphere of Γ; None if there is none."""
    prepared = system.prepare()
    x, unravel = ravel_pytree(state)

    def field(x):
        point = unravel(x)
        rates = ravel_pytree(vector_field(prepared, t, point))[0]
        if not isinstance(point, ReducedState):
            return rates
        axis = jnp.stack([jnp.zeros_like(turning), jnp.zeros_like(turning), turning])
        turned = jnp.zeros_like(x).at[:6].set(jnp.concatenate([cross(axis, point.Omega), cross(axis, point.Gamma)]))
        return rates - turned

    normal = normal_of(state)
    return field(x), jax.jacfwd(field)(x), None if normal is None else normal(x)


def _on_tangent(matrix: np.ndarray, normal: Array | None) -> np.ndarray:
    """``matrix`` on the vectors orthogonal to the normal of the sphere of Γ."""
    if normal is None:
        return matrix
    basis = np.linalg.svd(np.asarray(normal)[None])[2][1:]
    return basis @ matrix @ basis.T


def kind_of(eigenvalues: np.ndarray) -> str:
    """The kind, see :class:`SteadyMotion`, by eigenvalues in units of about the largest."""
    real = np.where(np.abs(eigenvalues) > ZERO, np.real(eigenvalues), 0.0)
    growing, falling = bool(np.any(real > NEUTRAL)), bool(np.any(real < -NEUTRAL))
    turning = bool(np.any((np.abs(real) <= NEUTRAL) & (np.abs(eigenvalues) > ZERO)))
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
