"""A particle with the nonholonomic constraint ż = y ẋ, by two principles that do not agree.

The principle of Lagrange and d'Alembert constrains the variations; the vakonomic one constrains the curves
among which the action is stationary. Mechanics follows the first. Source: the appendix on nonholonomic
mechanics of Putkaradze & Rogers (2018), ``ssec_bates``, after Bates & Śniatycki (1993).
"""

from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.declare import OF_MASS, POSITIVE, number
from .state import AbstractClassicalSystem, ParticleState, VakonomicState


class ParticleLaws(NamedTuple):
    """The integrals of the particle by the principle of Lagrange and d'Alembert.

    - ``energy``: E = ½m (ẋ² + ẏ² + ż²), mass length²/time².
    - ``p_y``: mẏ. The constraint is not invariant under translation along y, yet p_y is constant, while p_x = mẋ and
      p_z = mż, along whose directions everything is invariant, are not.
    - ``p_xz``: mẋ √(1 + y²), the momentum in the plane of x and z.
    """

    energy: Float[Array, ""]
    p_y: Float[Array, ""]
    p_xz: Float[Array, ""]


class VakonomicLaws(NamedTuple):
    """The integrals of the vakonomic particle: Noether's, of l̃ = l + λ (ż − y ẋ), and the energy.

    - ``energy``: E = ½m (ẋ² + ẏ² + ż²), mass length²/time².
    - ``p_x``: ∂l̃/∂ẋ = mẋ − λy.
    - ``p_z``: ∂l̃/∂ż = mż + λ, the paper's c̃.
    """

    energy: Float[Array, ""]
    p_x: Float[Array, ""]
    p_z: Float[Array, ""]


class NonholonomicParticle(AbstractClassicalSystem[ParticleState]):
    """A free particle with ż = y ẋ by the principle of Lagrange and d'Alembert, ``eq_part_LdA``.

    **Arguments:**

    - ``mass``: m, the mass of the particle, which does not affect the motion, in units of mass.

    **Raises:** ``ValueError`` when ``mass`` is not a single number.

    **Example:**

    >>> from jaxball import simulate
    >>> from jaxball.physics.classical import NonholonomicParticle, ParticleState
    >>> run = simulate(NonholonomicParticle(), [0.0, 1.0, 2.0], ParticleState(xdot=1.0, ydot=1.0))
    >>> print(run.laws.p_y)  # constant, though the constraint changes with y
    [1. 1. 1.]
    """

    mass: Float[Array, ""] = eqx.field(converter=number(OF_MASS, POSITIVE), default=1.0, kw_only=True)

    title: ClassVar[str] = "nonholonomic particle"
    state_type: ClassVar[type[ParticleState]] = ParticleState

    def field(self, t: Float[Array, ""], state: ParticleState) -> ParticleState:
        """Evaluates ẍ = −y ẋ ẏ / (1 + y²), ÿ = 0 and ż = y ẋ."""
        y, xdot, ydot = state.y, state.xdot, state.ydot
        return ParticleState(
            x=xdot, y=ydot, z=state.zdot, xdot=-y * xdot * ydot / (1 + y**2), ydot=jnp.zeros_like(ydot)
        )

    def laws(self, t: Float[Array, ""], state: ParticleState) -> ParticleLaws:
        return ParticleLaws(
            energy=kinetic_energy(self.mass, state),
            p_y=self.mass * state.ydot,
            p_xz=self.mass * state.xdot * jnp.sqrt(1 + state.y**2),
        )

    def multiplier(self, t: Float[Array, ""], state: ParticleState) -> Float[Array, ""]:
        """Computes λ = m z̈, the force of the constraint along z; along x it is −λy."""
        return self.mass * state.xdot * state.ydot / (1 + state.y**2)

    def solution(self, t: Float[Array, ""], start: ParticleState, t0: Float[Array, ""]) -> ParticleState:
        """Returns the state at ``t`` of the motion with state ``start`` at ``t0``, in closed form, ``eq_part_LdA_x``.

        With y = y0 + ẏ τ the constraint leaves ẋ √(1 + y²) = A constant, so that x − x0 = A τ times the
        slope of arsinh between y0 and y, and z − z0 = A τ times that of √(1 + y²). Both slopes are written
        so that they are accurate, and have derivatives, for any ẏ, 0 included.
        """
        tau = t - t0
        y = start.y + start.ydot * tau
        root0, root = jnp.sqrt(1 + start.y**2), jnp.sqrt(1 + y**2)
        A = start.xdot * root0
        return ParticleState(
            x=start.x + A * tau * _slope_of_arsinh(start.y, y),
            y=y,
            z=start.z + A * tau * (start.y + y) / (root0 + root),
            xdot=A / root,
            ydot=start.ydot,
        )


class VakonomicParticle(AbstractClassicalSystem[VakonomicState]):
    """The particle with ż = y ẋ whose action is stationary among the curves that keep the constraint.

    Its multiplier λ has a rate, so a motion depends on one more number than that of a mechanical system: λ at the
    start.

    **Arguments:**

    - ``mass``: m, the mass of the particle, in units of mass.

    **Raises:** ``ValueError`` when ``mass`` is not a single number.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics.classical import VakonomicParticle, VakonomicState
    >>> particle, start = VakonomicParticle(), VakonomicState(xdot=1.0, multiplier=2.0)
    >>> float(particle.field(jnp.array(0.0), start).ydot)  # the multiplier bends the path: mÿ = −λẋ
    -2.0
    """

    mass: Float[Array, ""] = eqx.field(converter=number(OF_MASS, POSITIVE), default=1.0, kw_only=True)

    title: ClassVar[str] = "vakonomic particle"
    state_type: ClassVar[type[VakonomicState]] = VakonomicState

    def field(self, t: Float[Array, ""], state: VakonomicState) -> VakonomicState:
        """Solves mẍ = λ̇y + λẏ, mÿ = −λẋ, mz̈ = −λ̇ and ż = y ẋ for ẍ, ÿ and λ̇."""
        y, xdot, ydot = state.y, state.xdot, state.ydot
        pull = state.multiplier / self.mass
        xddot = ydot * (pull - y * xdot) / (1 + y**2)
        return VakonomicState(
            x=xdot,
            y=ydot,
            z=state.zdot,
            xdot=xddot,
            ydot=-pull * xdot,
            multiplier=-self.mass * (ydot * xdot + y * xddot),
        )

    def laws(self, t: Float[Array, ""], state: VakonomicState) -> VakonomicLaws:
        return VakonomicLaws(
            energy=kinetic_energy(self.mass, state),
            p_x=self.mass * state.xdot - state.multiplier * state.y,
            p_z=self.mass * state.zdot + state.multiplier,
        )


def kinetic_energy(mass: Float[Array, ""], state: ParticleState | VakonomicState) -> Float[Array, ""]:
    """Computes ½m (ẋ² + ẏ² + ż²)."""
    return 0.5 * mass * (state.xdot**2 + state.ydot**2 + state.zdot**2)


def _slope_of_arsinh(a: Float[Array, ""], b: Float[Array, ""]) -> Float[Array, ""]:
    """Computes (arsinh b − arsinh a) / (b − a), and its limit 1 / √(1 + a²) where b = a.

    arsinh is odd, so that a may be taken positive; then the difference is log(1 + (b − a) k) with a factor k without
    loss of accuracy.
    """
    sign = jnp.where(a < 0, -1.0, 1.0).astype(a.dtype)
    a, b = sign * a, sign * b
    root_a, root_b = jnp.sqrt(1 + a**2), jnp.sqrt(1 + b**2)
    k = (1 + (a + b) / (root_a + root_b)) / (a + root_a)
    u = (b - a) * k
    # Where b is near a both are 0, and their quotient is given by its series.
    near = jnp.abs(u) < 1e-3
    far_u = jnp.where(near, 1.0, u)
    series = 1 - u * (1 / 2 - u * (1 / 3 - u * (1 / 4 - u * (1 / 5 - u / 6))))
    return k * jnp.where(near, series, jnp.log1p(far_u) / far_u)
