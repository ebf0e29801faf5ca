"""The states of a ball and of a disk, with their kinematics: the rates of a state, given its angular acceleration.

Times, lengths and masses are in the same consistent units as the parameters.
"""

import abc
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, cast

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..numerics import versor
from ..numerics.declare import number, number_or_none
from ..numerics.linear import product
from ..numerics.vectors import cross, dot, hat, sine_cosine
from .conditions import UNIT, Condition
from .system import AbstractState, AnyState

EMPTY = ()
Angles = tuple[Float[Array, " driven"], Float[Array, " driven"]]
AnyBodyState = TypeVar("AnyBodyState", bound="AbstractBodyState")
Rates = tuple[Float[Array, " driven"], Float[Array, " driven"], Float[Array, " driven"]]


class AbstractBodyState(AbstractState):
    """What the states of rolling bodies share: Ω, Γ = Λ⁻¹e3, θ, θ̇ of the masses that a feedback law drives, and states
    of a user's own.
    """

    if TYPE_CHECKING:  # to a type checker, fields declared here would come before `q` among the arguments
        theta, thetadot, own = cast(Array, None), cast(Array, None), cast(Array | None, None)
    else:
        theta: eqx.AbstractVar[Float[Array, "*batch driven"]]
        thetadot: eqx.AbstractVar[Float[Array, "*batch driven"]]
        own: eqx.AbstractVar[Float[Array, "*batch own"] | None]

    sized = ("theta", "thetadot", "own")
    rotation_rate: ClassVar[str] = "Omega"  # the field with the angular velocity

    def with_Omega(self: AnyState, Omega: Float[Array, "*batch 3"]) -> AnyState:
        """Returns the state with another Ω."""
        return eqx.tree_at(lambda state: state.Omega, self, Omega)  # pyright: ignore

    def rates(
        self: AnyBodyState,
        r: Float[Array, ""],
        Omegadot: Float[Array, "3"],
        angles: Rates,
        own: Float[Array, " own"] | None,
    ) -> AnyBodyState:
        """Computes ẋ where Ω̇ is known, and θ, θ̇, θ̈: the kinematics of rolling, for a body of radius r.

        ``own`` are the rates of states of one's own, if there are any.

        **Raises:** ``ValueError`` for several states.
        """
        several = self.theta.shape[:-1]
        if several:  # the formulas take the first axis for that of a vector
            raise ValueError(
                f"Argument `state` must be one state, but its arrays have leading axes of shape {several}; take "
                "jax.vmap over them."
            )
        rest: dict[str, Any] = {"theta": angles[1], "thetadot": angles[2], "own": own}
        return type(self)(**self.rolling(r, Omegadot), **rest)

    @abc.abstractmethod
    def rolling(self, r: Float[Array, ""], Omegadot: Float[Array, "3"]) -> dict[str, Array]:
        """Computes the rates of the fields for the attitude, the rotation and the place."""


class BallState(AbstractBodyState):
    """x = (θ, θ̇, q, Ω, z) of ``rolling_ball_ode_f``; at rest and upright at the origin by default.

    **Arguments:**

    - ``q``: the orientation, a versor with its real part first, shape (4,).
    - ``Omega``: Ω, body axes, rad/time, shape (3,).
    - ``z``: the path of the geometric centre, length, shape (2,).
    - ``theta``: θ of each :class:`~jaxball.Driven` mass, rad on a closed rail and length in a tube, shape (driven,);
      empty where every motion is prescribed.
    - ``thetadot``: θ̇ of each of them, shape (driven,).
    - ``own``: the values of the body's :class:`~jaxball.physics.OwnStates`, shape (own,); None where it has none.

    **Example:**

    >>> from jaxball import BallState
    >>> BallState(Omega=(0.0, 1.0, 0.0), z=(2.0, 0.0))
    BallState(q=(1.0, 0.0, 0.0, 0.0), Omega=(0.0, 1.0, 0.0), z=(2.0, 0.0), theta=(), thetadot=())
    """

    q: Float[Array, "*batch 4"] = eqx.field(converter=number(), default=(1.0, 0.0, 0.0, 0.0))
    Omega: Float[Array, "*batch 3"] = eqx.field(converter=number(), default=(0.0, 0.0, 0.0))
    z: Float[Array, "*batch 2"] = eqx.field(converter=number(), default=(0.0, 0.0))
    theta: Float[Array, "*batch driven"] = eqx.field(converter=number(), default=EMPTY)
    thetadot: Float[Array, "*batch driven"] = eqx.field(converter=number(), default=EMPTY)
    own: Float[Array, "*batch own"] | None = eqx.field(converter=number_or_none(), default=None)

    unit_vector, attitude = "q", "q"

    @property
    def Lambda(self) -> Float[Array, "*batch 3 3"]:
        """The rotation matrix Λ from body to space."""
        return versor.rotation_matrix(self.q)

    @property
    def Gamma(self) -> Float[Array, "*batch 3"]:
        """Γ = Λ⁻¹ e3."""
        return versor.vertical_in_body(self.q)

    def rolling(self, r: Float[Array, ""], Omegadot: Float[Array, "3"]) -> dict[str, Array]:
        """Computes the rates by q̇ = ½ q Ω♯ and the rolling constraint."""
        qdot, zdot = versor.derivative(self.q, self.Omega), rolling_velocity(self.Lambda, self.Omega, r)
        return {"q": qdot, "Omega": Omegadot, "z": zdot}

    def in_space(self) -> "BallState":
        """Returns the state itself; see :meth:`DiskState.in_space`."""
        return self

    def turn(self, rotation: Float[Array, "3"]) -> Float[Array, "4"]:
        return versor.product(self.q, versor.exponential(rotation))

    def turn_to(self, other: Any) -> Float[Array, "3"]:
        return versor.logarithm(versor.product(versor.conjugate(self.q), other.q))

    def reduce(self) -> "ReducedState":
        """Returns (Ω, Γ), without position and heading."""
        return ReducedState(self.Omega, self.Gamma, self.theta, self.thetadot, self.own)


class RotationState(AbstractBodyState):
    """The state with the rotation matrix Λ in place of the versor, ``uncon_ball_eqns_explicit_full``.

    **Arguments:**

    - ``Lambda``: Λ, from body to space, shape (3, 3).
    - ``Omega``: Ω, body axes, rad/time, shape (3,).
    - ``z``: the path of the geometric centre, length, shape (2,).
    - ``theta``: θ of each driven mass, rad on a closed rail and length in a tube, shape (driven,); empty if there are
      none.
    - ``thetadot``: θ̇ of each of them, shape (driven,).
    - ``own``: the values of the body's :class:`~jaxball.physics.OwnStates`, shape (own,); None where it has none.

    **Example:**

    >>> from jaxball.physics import RotationState
    >>> RotationState(Omega=(0.0, 1.0, 0.0)).in_space().q
    Array([1., 0., 0., 0.], dtype=float64)
    """

    Lambda: Float[Array, "*batch 3 3"] = eqx.field(
        converter=number(), default=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    )
    Omega: Float[Array, "*batch 3"] = eqx.field(converter=number(), default=(0.0, 0.0, 0.0))
    z: Float[Array, "*batch 2"] = eqx.field(converter=number(), default=(0.0, 0.0))
    theta: Float[Array, "*batch driven"] = eqx.field(converter=number(), default=EMPTY)
    thetadot: Float[Array, "*batch driven"] = eqx.field(converter=number(), default=EMPTY)
    own: Float[Array, "*batch own"] | None = eqx.field(converter=number_or_none(), default=None)

    attitude = "Lambda"

    @property
    def Gamma(self) -> Float[Array, "*batch 3"]:
        """Γ = Λ⁻¹ e3."""
        return self.Lambda[..., 2, :]

    def rolling(self, r: Float[Array, ""], Omegadot: Float[Array, "3"]) -> dict[str, Array]:
        """Computes the rates by Λ̇ = Λ Ω̂ and the rolling constraint."""
        Lambdadot = product(self.Lambda, hat(self.Omega))
        return {"Lambda": Lambdadot, "Omega": Omegadot, "z": rolling_velocity(self.Lambda, self.Omega, r)}

    def conditions(self) -> Iterator[Condition]:
        R = self.Lambda
        excess = jnp.sum(R[:, :, None] * R[:, None, :], axis=0) - jnp.eye(3, dtype=R.dtype)
        right_handed = dot(cross(R[0], R[1]), R[2]) > 0
        holds = (jnp.max(jnp.abs(excess)) < UNIT) & right_handed
        yield Condition(holds, "state.Lambda", R, "a rotation matrix")
        yield from super().conditions()

    def projected(self) -> "RotationState":
        """Returns the state with Λ orthogonal, up to second order in its distance from a rotation."""
        R = self.Lambda
        gram = jnp.sum(R[..., :, :, None] * R[..., :, None, :], axis=-3)
        nearer = 1.5 * R - 0.5 * jnp.sum(R[..., :, :, None] * gram[..., None, :, :], axis=-2)
        return eqx.tree_at(lambda state: state.Lambda, self, nearer)

    def in_space(self) -> BallState:
        """Returns the same state with a versor."""
        q = versor.from_rotation_matrix(self.Lambda)
        return BallState(q, self.Omega, self.z, self.theta, self.thetadot, self.own)

    def turn(self, rotation: Float[Array, "3"]) -> Float[Array, "3 3"]:
        return product(self.Lambda, versor.rotation_matrix(versor.exponential(rotation)))

    def turn_to(self, other: Any) -> Float[Array, "3"]:
        return versor.logarithm(versor.from_rotation_matrix(product(self.Lambda.T, other.Lambda)))

    def reduce(self) -> "ReducedState":
        """Returns (Ω, Γ), without position and heading."""
        return ReducedState(self.Omega, self.Gamma, self.theta, self.thetadot, self.own)


class ReducedState(AbstractBodyState):
    """The state (Ω, Γ) reduced by the symmetry of the plane, ``uncon_ball_eqns_explicit``.

    **Arguments:**

    - ``Omega``: Ω, body axes, rad/time, shape (3,).
    - ``Gamma``: Γ = Λ⁻¹ e3, a unit vector, shape (3,).
    - ``theta``: θ of each driven mass, rad on a closed rail and length in a tube, shape (driven,); empty if there are
      none.
    - ``thetadot``: θ̇ of each of them, shape (driven,).
    - ``own``: the values of the body's :class:`~jaxball.physics.OwnStates`, shape (own,); None where it has none.

    **Example:**

    >>> from jaxball.physics import ReducedState
    >>> ReducedState(Omega=(0.0, 0.0, 2.0))  # spinning about the vertical
    ReducedState(Omega=(0.0, 0.0, 2.0), Gamma=(0.0, 0.0, 1.0), theta=(), thetadot=())
    """

    Omega: Float[Array, "*batch 3"] = eqx.field(converter=number(), default=(0.0, 0.0, 0.0))
    Gamma: Float[Array, "*batch 3"] = eqx.field(converter=number(), default=(0.0, 0.0, 1.0))
    theta: Float[Array, "*batch driven"] = eqx.field(converter=number(), default=EMPTY)
    thetadot: Float[Array, "*batch driven"] = eqx.field(converter=number(), default=EMPTY)
    own: Float[Array, "*batch own"] | None = eqx.field(converter=number_or_none(), default=None)

    unit_vector = "Gamma"

    def rolling(self, r: Float[Array, ""], Omegadot: Float[Array, "3"]) -> dict[str, Array]:
        """Computes the rates by Γ̇ = Γ × Ω."""
        return {"Omega": Omegadot, "Gamma": cross(self.Gamma, self.Omega)}


class DiskState(AbstractBodyState):
    """x = (θ, θ̇, φ, φ̇) of ``eq_rdisk_dynamics``, and z, which follows from φ by ``eq_disk_GC``.

    φ is counted anticlockwise from e1 to E1, so a disk with φ̇ > 0 rolls towards −e1.

    **Arguments:**

    - ``phi``: φ, rad.
    - ``phidot``: φ̇, rad/time.
    - ``z``: the position of the centre on the line, length.
    - ``theta``: θ of each driven mass, rad on a closed rail and length in a tube, shape (driven,); empty if there are
      none.
    - ``thetadot``: θ̇ of each of them, shape (driven,).
    - ``own``: the values of the body's :class:`~jaxball.physics.OwnStates`, shape (own,); None where it has none.

    **Example:**

    >>> from jaxball import DiskState
    >>> DiskState(phidot=-1.0).in_space().Omega  # the same motion as that of a ball, towards e1
    Array([0., 1., 0.], dtype=float64)
    """

    rotation_rate: ClassVar[str] = "phidot"

    phi: Float[Array, "*batch"] = eqx.field(converter=number(), default=0.0)
    phidot: Float[Array, "*batch"] = eqx.field(converter=number(), default=0.0)
    z: Float[Array, "*batch"] = eqx.field(converter=number(), default=0.0)
    theta: Float[Array, "*batch driven"] = eqx.field(converter=number(), default=EMPTY)
    thetadot: Float[Array, "*batch driven"] = eqx.field(converter=number(), default=EMPTY)
    own: Float[Array, "*batch own"] | None = eqx.field(converter=number_or_none(), default=None)

    @property
    def Lambda(self) -> Float[Array, "*batch 3 3"]:
        """The rotation matrix Λ from body to space."""
        s, c = sine_cosine(self.phi)
        zero, unit = jnp.zeros_like(c), jnp.ones_like(c)
        rows = ([c, zero, -s], [zero, unit, zero], [s, zero, c])
        return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)

    @property
    def Gamma(self) -> Float[Array, "*batch 3"]:
        """Γ = Λ⁻¹ e3."""
        s, c = sine_cosine(self.phi)
        return jnp.stack([s, jnp.zeros_like(c), c], axis=-1)

    @property
    def Omega(self) -> Float[Array, "*batch 3"]:
        """Ω = −φ̇ E2."""
        zero = jnp.zeros_like(self.phidot)
        return jnp.stack([zero, -self.phidot, zero], axis=-1)

    def with_Omega(self, Omega: Float[Array, "*batch 3"]) -> "DiskState":
        """Returns the state with φ̇ = −Ω₂."""
        return eqx.tree_at(lambda state: state.phidot, self, -Omega[..., 1])

    def rolling(self, r: Float[Array, ""], Omegadot: Float[Array, "3"]) -> dict[str, Array]:
        """Computes the rates by φ̈ = −Ω̇₂ and ż = −r φ̇ of ``eq_disk_GC``."""
        return {"phi": self.phidot, "phidot": -Omegadot[1], "z": -r * self.phidot}

    def in_space(self) -> BallState:
        """Returns the same motion as the motion of a ball: rotation by −φ about E2, Ω = −φ̇ E2, z = (z, 0)."""
        zero = jnp.zeros_like(self.phi)
        half = self.phi / 2
        return BallState(
            q=jnp.stack([jnp.cos(half), zero, -jnp.sin(half), zero], axis=-1),
            Omega=jnp.stack([zero, -self.phidot, zero], axis=-1),
            z=jnp.stack([self.z, zero], axis=-1),
            theta=self.theta,
            thetadot=self.thetadot,
            own=self.own,
        )


PlacedState = BallState | RotationState | DiskState  # which has the position of the body
State = PlacedState | ReducedState


def rolling_velocity(Lambda: Float[Array, "3 3"], Omega: Float[Array, "3"], r: Float[Array, ""]) -> Float[Array, "2"]:
    """Computes ż = (ΛΩ × r e3)₁₂, the rolling constraint at the geometric centre."""
    omega1 = dot(Lambda[0], Omega)
    omega2 = dot(Lambda[1], Omega)
    return jnp.stack([r * omega2, -r * omega1])
