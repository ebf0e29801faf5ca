"""The body released from the rolling constraint: it may slip on the plane and leave it.

The velocity V of the geometric centre and its height over that of rolling are then part of the state. With the slip
velocity v_s = V − rω × e3 − u, whose third component is that of V, in place of V,

- the accelerations of all masses are those of the rolling body on a plane that has the acceleration v̇_s besides its
  own, so that Ω̇ and θ̈ of free joints follow from the equations of rolling with γ + Λ⁻¹v̇_s for γ;
- the reaction R of the plane does work only on v_s, and follows from Newton's law for the whole.

So everything is the sum of the rolling motion, with its reaction R₀, and a part linear in v̇_s:

    R = R₀ + D⁻¹ v̇_s        v̇_s = D (R − R₀)

The Delassus operator D is A 𝓜⁻¹Aᵀ, where 𝓜 is the inertia in the velocities (Ω, Λ⁻¹V), free joints eliminated, and
v_s + u is A = Λ[ rΓ̂, 1 ] times these. In the velocities (Ω, Λ⁻¹v_s), that inertia has the one of ``coupling`` as its
first block, whose Schur complement is Λ⁻¹D⁻¹Λ. Hence no factors other than those of rolling are needed.
"""

from typing import NamedTuple, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...interface.arguments import require
from ...interface.printing import Printed
from ...numerics.arrays import numbers
from ...numerics.vectors import apply, cross, dot, inverse
from ..body import AbstractBody
from ..coupling import Joints, join_coordinates
from ..dynamics import equations
from ..energy import kinetic_energy, potential_energy
from ..load import in_three, load, place, table_under
from ..moments import kinematics, point_mass_values, principal_inertia
from ..motion import Kinematics
from ..reaction import reaction_in_body
from ..state import DiskState, PlacedState, centre_velocity


class ReleasedState(Printed):
    """The state of a body that need not roll: it may slip on the plane or be above it.

    **Arguments:**

    - ``body``: orientation, Ω, position and joints, as for a body that rolls: a :class:`~jaxball.BallState`, a
      :class:`~jaxball.RotationState` or a :class:`~jaxball.DiskState`.
    - ``V``: the velocity of the geometric centre, space axes, length/time, shape (3,); for a disk its second entry is
      0.
    - ``height``: of the geometric centre above that of rolling, length.

    **Example:**

    >>> from jaxball import BallState, ReleasedState
    >>> ReleasedState(BallState(Omega=(0.0, -5.0, 0.0)), V=(2.0, 0.0, 0.0))  # with backspin
    ReleasedState(body=BallState(Omega=(0.0, -5.0, 0.0)), V=(2.0, 0.0, 0.0), height=0.0)
    """

    body: PlacedState
    V: Float[Array, "*batch 3"] = eqx.field(converter=numbers("V", (3,), batch=True), default=(0.0, 0.0, 0.0))
    height: Float[Array, "*batch"] = eqx.field(converter=numbers("height", batch=True), default=0.0)

    def __check_init__(self):
        require(
            "body",
            self.body,
            get_args(PlacedState),
            "a BallState, a RotationState or a DiskState, which have a position",
        )


def released(system: AbstractBody, t: Float[Array, ""], state: PlacedState) -> ReleasedState:
    """A state of rolling, as that of a body that need not roll."""
    V = in_three(centre_velocity(state.Lambda, state.Omega, system.radius, system.drift(t, state)))
    return ReleasedState(state, V, jnp.zeros_like(system.radius))


@jax.jit
def slip_velocity(system: AbstractBody, t: Float[Array, ""], state: ReleasedState) -> Float[Array, "3"]:
    """v_s = V − rω × e3 − u, of the body's lowest point relative to the plane, space axes.

    The third component is the rate at which the body leaves the plane.
    """
    body = state.body
    slip = state.V - in_three(centre_velocity(body.Lambda, body.Omega, system.radius, system.drift(t, body)))
    # A disk does not slip sideways. Rounding there would be divided by the slip speed in derivatives of σ.
    return slip.at[1].set(0.0) if system.planar else slip


class Motion(NamedTuple):
    """Ω̇ in body axes and θ̈ of all that a state's ``theta`` holds, with the reaction R of the plane, space axes.

    It may have a leading axis, of several motions.
    """

    Omegadot: Float[Array, "*rows 3"]
    thetaddot: Float[Array, "*rows coordinates"]
    reaction: Float[Array, "*rows 3"]


class Response(NamedTuple):
    """The response of a released body to the reaction of the plane, in which all formulas of this module are linear.

    ``rolling`` is the motion with v̇_s = 0 and without dry rolling friction, and its reaction R₀. ``yielding`` is what a
    unit of v̇_s along each space axis adds, one row for each, so that its reactions are D⁻¹; ``delassus`` is
    the Delassus operator D. ``rubbing`` is what the dry torque of a unit of normal force adds while v̇_s = 0, None
    without dry friction. ``convected`` is u̇. Where dry friction is exact, ``twisting`` is what a unit of torque at the
    contact along each space axis adds while v̇_s = 0; ``rubbing`` is None there, as long as no mode of turning is known.
    """

    rolling: Motion
    yielding: Motion
    delassus: Float[Array, "3 3"]
    rubbing: Motion | None
    convected: Float[Array, "3"]
    twisting: Motion | None = None

    @property
    def free(self) -> Float[Array, "3"]:
        """v̇_free, the slip acceleration without any force of the plane, space axes: −D R₀."""
        return -apply(self.delassus, self.rolling.reaction)

    def slip_acceleration(self, R: Float[Array, "3"], N: Float[Array, ""]) -> Float[Array, "3"]:
        """v̇_s under a reaction, space axes; ``N`` is the normal force with which dry rolling friction is computed."""
        rest = R - self.rolling.reaction
        return apply(self.delassus, rest if self.rubbing is None else rest - N * self.rubbing.reaction)

    def reaction(self, slip_acceleration: Float[Array, "3"], N: Float[Array, ""]) -> Float[Array, "3"]:
        """R with a given v̇_s: the inverse of :meth:`slip_acceleration`."""
        R = self.rolling.reaction + combined(slip_acceleration, self.yielding.reaction)
        return R if self.rubbing is None else R + N * self.rubbing.reaction

    def accelerations(
        self, slip_acceleration: Float[Array, "3"], N: Float[Array, ""]
    ) -> tuple[Float[Array, "3"], Float[Array, " coordinates"]]:
        """Ω̇ in body axes and θ̈ of all that a state's ``theta`` holds."""
        found = []
        for part in ("Omegadot", "thetaddot"):
            value = getattr(self.rolling, part) + combined(slip_acceleration, getattr(self.yielding, part))
            found.append(value if self.rubbing is None else value + N * getattr(self.rubbing, part))
        return found[0], found[1]


@jax.jit
def response(
    system: AbstractBody, t: Float[Array, ""], state: ReleasedState, touching: Bool[Array, ""] | None = None
) -> Response:
    """The response of the body to each reaction of the plane.

    ``touching`` is False in flight, where the plane does not resist the body's turning; True if not given. A disk is
    held upright by a constraint that takes up all forces along e2, none of which belong to the reaction.
    """
    body, r = state.body, system.radius
    Lambda, slip = body.Lambda, slip_velocity(system, t, state)
    acting = load(system, t, body, slip, touching, state.height)
    found = equations(system, t, body)
    lever = found.at.M * r * found.Gamma + found.at.p
    p = [link.weights for link in found.free]
    still = jnp.zeros_like(body.theta)

    def motion(
        Omegadot: Float[Array, "3"], thetaddot: Float[Array, " coordinates"], force: Float[Array, "3"]
    ) -> Motion:
        force = apply(Lambda, force)
        if system.planar:
            force, Omegadot = force.at[1].set(0.0), jnp.zeros_like(Omegadot).at[1].set(Omegadot[1])
        return Motion(Omegadot, thetaddot, force)

    def change(torque: Float[Array, "3"], efforts: Joints, force: Float[Array, "3"]) -> Motion:
        Omegadot, thetaddot = found.matrix.solve(torque, efforts)
        for weights, rate in zip(p, thetaddot, strict=True):
            force = force + jnp.sum(rate[..., None] * weights, axis=(0, 1))
        return motion(Omegadot, join_coordinates(still, found.links, thetaddot), force + cross(Omegadot, lever))

    def yielding(axis: Float[Array, "3"]) -> Motion:
        efforts = [-jnp.sum(weights * axis[None, None], axis=-1) for weights in p]
        return change(cross(axis, lever), efforts, found.at.M * axis)

    Omegadot, thetaddot = found.solve(r, t, body, acting)
    R = reaction_in_body(found.complete(thetaddot), r, acting, found.Omega, Omegadot)
    resistance = system.resistance
    is_exact = resistance is not None and resistance.holds
    dry = None if resistance is None or is_exact else resistance.dry_torque(r, found.Omega, found.Gamma)
    idle = [jnp.zeros(link.slots.shape, dtype=Lambda.dtype) for link in found.free]
    of_slip = jax.vmap(yielding)(Lambda)
    if system.planar:
        of_slip = of_slip._replace(reaction=of_slip.reaction.at[1, 1].set(found.at.M))
    table = table_under(system, t, body, slip)
    return Response(
        rolling=motion(Omegadot, join_coordinates(found.angles[2], found.links, thetaddot), R),
        yielding=of_slip,
        delassus=inverse(of_slip.reaction),
        rubbing=None if dry is None else change(dry, idle, jnp.zeros_like(dry)),
        convected=jnp.zeros_like(slip) if table is None else in_three(table.acceleration),
        twisting=jax.vmap(lambda axis: change(axis, idle, jnp.zeros_like(axis)))(Lambda) if is_exact else None,
    )


def rates(
    system: AbstractBody,
    state: ReleasedState,
    found: Response,
    slip_acceleration: Float[Array, "3"],
    N: Float[Array, ""],
) -> ReleasedState:
    """ẋ with the slip acceleration v̇_s in space axes, where ``N`` is the normal force of dry rolling friction.

    V̇ = rω̇ × e3 + v̇_s + u̇.
    """
    body, r = state.body, system.radius
    Omegadot, thetaddot = found.accelerations(slip_acceleration, N)
    turning = in_three(centre_velocity(body.Lambda, Omegadot, r, None))
    moved = body.rates(r, Omegadot, (body.theta, body.thetadot, thetaddot))
    return ReleasedState(
        body=_placed(moved, state.V), V=turning + slip_acceleration + found.convected, height=state.V[2]
    )


def with_slip(
    system: AbstractBody,
    state: ReleasedState,
    found: Response,
    before: Float[Array, "3"],
    after: Float[Array, "3"],
) -> ReleasedState:
    """The state with another slip velocity, after an impulse of the plane; space axes.

    ``before`` is the slip velocity that it has, and ``found`` its response.
    """
    body, change = state.body, after - before
    Omega = combined(change, found.yielding.Omegadot)
    thetadot = combined(change, found.yielding.thetaddot)
    V = state.V + in_three(centre_velocity(body.Lambda, Omega, system.radius, None)) + change
    moved = eqx.tree_at(lambda x: x.thetadot, body.with_Omega(body.Omega + Omega), body.thetadot + thetadot)
    return ReleasedState(moved, V, state.height)


def released_energy(system: AbstractBody, t: Float[Array, ""], state: ReleasedState) -> Float[Array, ""]:
    """T + V of the body, mass length²/time², relative to the moving axes; 0 at rest in a centre at the origin."""
    body, r = state.body, system.radius
    points = kinematics(system, t, (body.theta, body.thetadot, body.thetadot))  # θ̈ is not used
    still = jnp.zeros((1, 3), dtype=state.V.dtype)
    masses = Kinematics(
        jnp.concatenate([system.offset[None], points.chi]), jnp.concatenate([still, points.chidot]), points.chiddot
    )
    m = jnp.concatenate([system.mass[None], point_mass_values(system)])
    lowest = state.V - in_three(centre_velocity(body.Lambda, body.Omega, r, None))
    up = jnp.zeros_like(state.V).at[2].set(1.0) if system.ground is None else system.ground.up()
    centre = in_three(place(body)).at[2].set(state.height)
    T = kinetic_energy(m, principal_inertia(system), r, masses, body.Omega, body.Gamma, apply(body.Lambda.T, lowest))
    return T + potential_energy(m, system.gravity, masses, apply(body.Lambda.T, up), dot(up, centre))


def combined(amounts: Float[Array, "3"], rows: Float[Array, "3 n"]) -> Float[Array, " n"]:
    """The sum of rows, each times its amount."""
    return jnp.sum(amounts[:, None] * rows, axis=0)


def _placed(body: PlacedState, at: Float[Array, "3"]) -> PlacedState:
    """The state, or its rates, with another place or velocity of the geometric centre."""
    return eqx.tree_at(lambda x: x.z, body, at[0] if isinstance(body, DiskState) else at[:2])
