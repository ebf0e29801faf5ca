"""The body released from the rolling constraint: it may slip on its ground and leave it.

The velocity V of the geometric centre and its height over that of rolling are then part of the state. The slip velocity
v_s = V − rω × n − w has its components in the contact axes, along two tangents of the ground and along its normal n,
where w is the velocity of the ground's matter. On a plane these are the axes of space, n is e3, and w that of a
turntable. With v_s in place of V,

- the accelerations of all masses are those of the rolling body on a plane that has the acceleration v̇_s besides its
  own, so that Ω̇ and θ̈ of free joints follow from the equations of rolling with γ + Λ⁻¹v̇_s for γ;
- the reaction R of the ground does work only on v_s, and follows from Newton's law for the whole.

So everything is the sum of the rolling motion, with its reaction R₀, and a part linear in v̇_s:

    R = R₀ + D⁻¹ v̇_s        v̇_s = D (R − R₀)

The Delassus operator D is A 𝓜⁻¹Aᵀ, where 𝓜 is the inertia in the velocities (Ω, Λ⁻¹V), free joints eliminated, and
v_s + w is A = Λ[ rΓ̂, 1 ] times these. In the velocities (Ω, Λ⁻¹v_s), that inertia has the one of ``coupling`` as its
first block, whose Schur complement is Λ⁻¹D⁻¹Λ. Hence no factors other than those of rolling are needed.

On a surface the contact axes turn, and Λ⁻¹ is from these axes to those of the body. The rate v̇_s is that of the
components, so that its third one is the second derivative of the height, with what the curvature adds to it.
"""

from functools import partial
from typing import NamedTuple, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...interface.arguments import require
from ...interface.printing import Printed
from ...numerics.declare import number
from ...numerics.linear import product
from ...numerics.vectors import add, apply, convert, cross, dot, inverse
from ..body import AbstractBody
from ..dynamics.coupling import Joints, join_coordinates
from ..dynamics.dry_friction import Law, Rows, TurningLaw
from ..dynamics.equations import equations
from ..dynamics.footing import (
    arm_of,
    footing,
    footing_of_released,
    locate_surface,
    place_of_centre,
    velocity_by_turning,
    velocity_of_centre,
)
from ..dynamics.load import Load, kinetic_energy, load, potential_energy
from ..dynamics.locked import reaction_in_body
from ..dynamics.moments import kinematics, point_mass_values, principal_inertia
from ..dynamics.sticking import of_sticking
from ..grounds import Footing
from ..grounds.ground import AT_REST
from ..prescribed.motion import Kinematics
from ..state import DiskState, PlacedState


class ReleasedState(Printed):
    """The state of a body that need not roll: it may slip on the ground or be above it.

    **Arguments:**

    - ``body``: orientation, Ω, position and joints, as for a body that rolls: a :class:`~jaxball.BallState`, a
      :class:`~jaxball.physics.RotationState` or a :class:`~jaxball.DiskState`.
    - ``V``: the velocity of the geometric centre, space axes, length/time, shape (3,); for a disk its second entry is
      0.
    - ``height``: of the geometric centre above that of rolling, length; over a surface, along the normal at ``z``.

    **Example:**

    >>> from jaxball import BallState
    >>> from jaxball.physics import ReleasedState
    >>> ReleasedState(BallState(Omega=(0.0, -5.0, 0.0)), V=(2.0, 0.0, 0.0))  # with backspin
    ReleasedState(body=BallState(Omega=(0.0, -5.0, 0.0)), V=(2.0, 0.0, 0.0), height=0.0)
    """

    body: PlacedState
    V: Float[Array, "*batch 3"] = eqx.field(converter=number(), default=(0.0, 0.0, 0.0))
    height: Float[Array, "*batch"] = eqx.field(converter=number(), default=0.0)

    def __check_init__(self):
        require(
            "body",
            self.body,
            get_args(PlacedState),
            "a BallState, a RotationState or a DiskState, which have a position",
        )


def release(system: AbstractBody, t: Float[Array, ""], state: PlacedState) -> ReleasedState:
    """Returns a state of rolling as the state of a body that need not roll."""
    return ReleasedState(state, rolling_contact(system, t, state)[0], jnp.zeros_like(system.radius))


def rolling_contact(system: AbstractBody, t: Float[Array, ""], body: PlacedState) -> tuple[Float[Array, "3"], Footing]:
    """Computes w + r ω × n, which V is without slip, space axes, and of the footing the contact axes and w."""
    surface = locate_surface(system, t, body)
    if surface is None:
        under = footing(system, t, body)
    else:
        touch = surface.touch_at(t, body.z)
        under = Footing(axes=touch.axes, velocity=touch.w)
    return velocity_of_centre(system, body, under), under


@jax.jit
def slip_velocity(system: AbstractBody, t: Float[Array, ""], state: ReleasedState) -> Float[Array, "3"]:
    """Computes v_s = V − w − rω × n, the velocity of the body's lowest point relative to the ground, in the contact
    axes.

    The third component is the rate at which the body leaves the ground.
    """
    rolling, under = rolling_contact(system, t, state.body)
    slip = under.to_axes(state.V - rolling)
    # A disk does not slip sideways. Rounding there would be divided by the slip speed in derivatives of σ.
    return slip.at[1].set(0.0) if system.planar else slip


def with_rise(
    system: AbstractBody, t: Float[Array, ""], state: ReleasedState, rate: Float[Array, ""]
) -> Float[Array, "3"]:
    """Returns V of a body that leaves its ground at this rate, and slips as before."""
    rolling, under = rolling_contact(system, t, state.body)
    if under.normal is None:
        return state.V.at[2].set(rate if system.shape is None else rolling[2] + rate)
    return state.V + (rate - dot(under.normal, state.V - rolling)) * under.normal


class Motion(NamedTuple):
    """Ω̇ in body axes and θ̈ of all that a state's ``theta`` holds, with the reaction R of the ground, contact axes.

    ``holding`` is the friction in joints that stick, as in ``Accelerations``; None without such joints. It may have a
    leading axis, of several motions.
    """

    Omegadot: Float[Array, "*rows 3"]
    thetaddot: Float[Array, "*rows coordinates"]
    reaction: Float[Array, "*rows 3"]
    holding: Float[Array, "*rows sticking"] | None = None


class Turned(NamedTuple):
    """Exact dry friction against the turning of a released body: contact ``axes``, and the rows of a law for ω.

    ``carried`` is the rate of ω relative to the ground while Ω is constant, contact axes; None on a plane. ``given`` is
    what the mode of turning gives. ``pivot`` is the radius of a limit surface, None without: then sliding friction acts
    against ω₃, in a row of its own.
    """

    axes: Float[Array, "3 3"]
    carried: Float[Array, "3"] | None
    given: TurningLaw
    pivot: Float[Array, ""] | None = None


class Response(NamedTuple):
    """The response of a released body to the reaction of the ground, in which all formulas of this module are linear.

    ``rolling`` is the motion with v̇_s = 0 and without dry rolling friction, and its reaction R₀. ``yielding`` is what a
    unit of v̇_s along each contact axis adds, one row for each, so that its reactions are D⁻¹. ``rubbing`` is what the
    dry torque of a unit of normal force adds while v̇_s = 0, None without dry friction or where it is exact. Then
    ``twisting`` is what a unit of torque at the contact along each contact axis adds; it counts as soon as a mode of
    turning is known, ``turned``. The amounts of all these are v̇_s, and N or the torque.

    ``convected`` is V̇ without v̇_s and r ω̇ × n, space axes, as the ``footing`` says. ``rise`` is the rate of the
    height, None where it is V₃. ``own`` are the rates of states of one's own. ``pushed`` is what given efforts on
    joints add while v̇_s = 0; None if none are given.
    """

    rolling: Motion
    yielding: Motion
    rubbing: Motion | None
    convected: Float[Array, "3"]
    footing: Footing = AT_REST
    rise: Float[Array, ""] | None = None
    twisting: Motion | None = None
    turned: Turned | None = None
    own: Float[Array, " own"] | None = None
    pushed: Motion | None = None

    @property
    def delassus(self) -> Float[Array, "3 3"]:
        """The Delassus operator D."""
        return inverse(self.yielding.reaction)

    @property
    def free(self) -> Float[Array, "3"]:
        """v̇_free, the slip acceleration without any force of the ground, contact axes: −D R₀."""
        return -apply(self.delassus, self.rolling.reaction)

    def with_turning(self, given: TurningLaw) -> "Response":
        """Returns the response in another mode of turning."""
        assert self.turned is not None
        return self._replace(turned=self.turned._replace(given=given))

    @property
    def pivot(self) -> Float[Array, ""] | None:
        """The radius of a limit surface, None without."""
        return None if self.turned is None else self.turned.pivot

    def with_pivoting(self, held: Bool[Array, ""] | bool, rate: Float[Array, ""] | float = 0.0) -> "Response":
        """Returns the response of a body whose ω₃ over the ground has this rate where it is ``held``, else friction."""
        assert self.turned is not None
        law = self.turned.given
        value = law.value.at[2].set(jnp.where(held, rate, 0.0))
        return self.with_turning(law._replace(solved=law.solved.at[2].set(held), value=value))

    def rows(self) -> Rows:
        """Returns the rows of the law: of the reaction and v̇_s, and of a mode of turning."""
        R, by = self.rolling.reaction, self.each("reaction")
        if self.turned is None:
            return Rows(R, by.T, R[2], by[:, 2])
        axes, carried, *_ = self.turned
        rate, rates = apply(axes, self.rolling.Omegadot), product(self.each("Omegadot"), axes.T)
        rest = jnp.concatenate([R, add(rate, carried)])
        return Rows(rest, jnp.concatenate([by, rates], axis=1).T, R[2], by[:, 2])

    def law(self, slips: Bool[Array, "3"]) -> Law:
        """Solves for what the mode does not give, where the reaction is given along some contact axes, v̇_s along the
        others.
        """
        solved, value = slips, jnp.zeros_like(self.rolling.reaction)
        if self.turned is not None:
            turning = self.turned.given
            solved, value = jnp.concatenate([solved, turning.solved]), jnp.concatenate([value, turning.value])
        return Law.of(self.rows(), solved, value)

    def push(self, force: Float[Array, "3"]) -> Float[Array, " rows"]:
        """Returns what a unit of N gives: this force along the contact axes, and what the mode of turning has."""
        return force if self.turned is None else jnp.concatenate([force, self.turned.given.push])

    def amounts(self, slip_acceleration: Float[Array, "3"], N: Float[Array, ""]) -> Float[Array, " amounts"]:
        """Computes the amounts where v̇_s and N are given; of a limit surface ``with_pivoting`` gives the rest."""
        if self.turned is None:
            return slip_acceleration if self.rubbing is None else jnp.append(slip_acceleration, N)
        law = self.law(jnp.zeros(3, bool))
        slipping = law._replace(value=law.value.at[:3].set(slip_acceleration))
        base, unit = slipping.amounts(self.push(jnp.zeros_like(slip_acceleration)))
        return base + N * unit

    def jump(self, slip: Float[Array, "3"]) -> Float[Array, " amounts"]:
        """Computes the amounts of an impulse that changes the slip velocity, where nothing else acts.

        What changes ω₃ as well ``with_pivoting`` gives.
        """
        if self.turned is None:
            return self.amounts(slip, jnp.zeros_like(slip[0]))
        law = self.law(jnp.zeros(3, bool))
        rows = law.rows._replace(rest=jnp.zeros_like(law.value))
        value = jnp.zeros_like(law.value) if self.pivot is None else law.value.at[3:5].set(0.0)
        still = law._replace(rows=rows, value=value.at[:3].set(slip))
        return still.amounts(jnp.zeros_like(law.value))[0]

    def each(self, name: str) -> Float[Array, "amounts ..."]:
        """Returns a part of the motion that a unit of each amount adds."""
        more = self.rubbing if self.turned is None else self.twisting
        by_slip = getattr(self.yielding, name)
        return by_slip if more is None else jnp.concatenate([by_slip, getattr(more, name)])

    def part(self, name: str, amounts: Float[Array, " amounts"]) -> Array:
        """Computes ``Omegadot``, ``thetaddot``, the ``reaction`` or ``holding``, friction in the joints that stick."""
        return getattr(self.rolling, name) + combine_rows(amounts, self.each(name))


@partial(jax.jit, static_argnames="pivots")
def response(
    system: AbstractBody,
    t: Float[Array, ""],
    state: ReleasedState,
    touching: Bool[Array, ""] | None = None,
    efforts: Joints | None = None,
    pivots: bool = False,
) -> Response:
    """Computes the response of the body to each reaction of the ground.

    ``touching`` is False in flight, where the ground does not resist the body's turning; True if not given. ``pivots``
    says that a limit surface twists it, as exact resistance does. A disk is held upright by a constraint that takes up
    all forces along e2, none of which belong to the reaction.
    """
    body, r, touches = state.body, system.radius, True if touching is None else touching
    under = footing_of_released(system, t, body, state.V, state.height, touches)
    acting, slip = load_of_released(system, t, state, touching, under)
    Lambda = under.rows(body.Lambda)  # from body axes to contact axes
    dynamics = equations(system, t, body, acting.Gamma)
    # Σ m s: an angular acceleration gives all masses together the change of momentum Ω̇ × Σ m s.
    lever = dynamics.body_moments.M * r * dynamics.lever.arm + dynamics.body_moments.p
    p = [link.weights for link in dynamics.free]
    still = jnp.zeros_like(body.theta)

    def motion(
        Omegadot: Float[Array, "3"], thetaddot: Float[Array, " coordinates"], force: Float[Array, "3"], holding: Joints
    ) -> Motion:
        force = apply(Lambda, force)
        if system.planar:
            force, Omegadot = force.at[1].set(0.0), jnp.zeros_like(Omegadot).at[1].set(Omegadot[1])
        sticks = any(which is not None for which in dynamics.held)
        return Motion(Omegadot, thetaddot, force, of_sticking(system, holding) if sticks else None)

    def change(torque: Float[Array, "3"], efforts: Joints, force: Float[Array, "3"]) -> Motion:
        # What something adds to the motion, by the factors of rolling; and by Newton's law for the whole, the reaction
        # that goes with it.
        Omegadot, thetaddot = dynamics.matrix.solve(torque, dynamics.without_held(efforts))
        for weights, rate in zip(p, thetaddot, strict=True):
            force = force + jnp.sum(rate[..., None] * weights, axis=(0, 1))
        force = force + cross(Omegadot, lever)
        holding = dynamics.lacking(efforts, Omegadot, thetaddot)
        return motion(Omegadot, join_coordinates(still, dynamics.links, thetaddot), force, holding)

    def yielding(axis: Float[Array, "3"]) -> Motion:
        # On a ground that is accelerated by v̇_s, each mass has the inertial force −m v̇_s.
        efforts = [-jnp.sum(weights * axis[None, None], axis=-1) for weights in p]
        return change(cross(axis, lever), efforts, dynamics.body_moments.M * axis)

    def twist(torques: Float[Array, "rows 3"]) -> Motion:
        idle = [jnp.zeros(link.slots.shape, dtype=Lambda.dtype) for link in dynamics.free]
        return jax.vmap(lambda torque: change(torque, idle, jnp.zeros_like(torque)))(torques)

    Omegadot, thetaddot = dynamics.solve(r, t, body, acting)
    R = reaction_in_body(dynamics.complete(thetaddot), r, acting, dynamics.Omega, Omegadot)
    resistance, height = system.resistance, system.height_of_centre(dynamics.Gamma)
    # Exact resistance depends on a mode that is not known here: it acts by ``twisting``.
    is_exact = resistance is not None and resistance.holds
    dry = None if resistance is None or is_exact else resistance.dry_torque(height, acting.resisted, dynamics.Gamma)
    of_slip = jax.vmap(yielding)(Lambda)
    # No force acts on a disk along e2: without an entry there, the matrix would have no inverse. Nothing moves along
    # it, so any mass will do.
    if system.planar:
        of_slip = of_slip._replace(reaction=of_slip.reaction.at[1, 1].set(dynamics.body_moments.M))
    coordinates = join_coordinates(dynamics.angles[2], dynamics.links, thetaddot)
    return Response(
        rolling=motion(Omegadot, coordinates, R, dynamics.holding(t, body, acting, Omegadot, thetaddot)),
        yielding=of_slip,
        rubbing=None if dry is None else twist(dry[None]),
        convected=_compute_convected_rate(system, body, acting, slip),
        footing=under,
        rise=None if under.axes is None and system.shape is None else slip_velocity(system, t, state)[2],
        twisting=twist(Lambda) if is_exact or pivots else None,
        own=system.own_rates(t, body),
        pushed=None if efforts is None else change(jnp.zeros_like(Omegadot), efforts, jnp.zeros_like(R)),
    )


def _compute_convected_rate(
    system: AbstractBody, body: PlacedState, acting: Load, slip: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Computes the rate of V = w + r ω × n + v_s, in axes that may turn, without ω̇ and v̇_s."""
    under = acting.footing
    moved = convert(lambda rate: apply(body.Lambda, system.radius * cross(body.Omega, rate)), acting.arm.rate)
    turned = convert(lambda turning: cross(turning, slip), under.turning)
    rate = add(under.acceleration, moved, turned)
    return jnp.zeros_like(slip) if rate is None else rate


def load_of_released(
    system: AbstractBody,
    t: Float[Array, ""],
    state: ReleasedState,
    touching: Bool[Array, ""] | None,
    under: Footing,
) -> tuple[Load, Float[Array, "3"]]:
    """Computes the load on a body that may slip or fly, and its slip velocity in space axes."""
    slip = state.V - velocity_of_centre(system, state.body, under)
    if system.planar:
        slip = slip.at[1].set(0.0)
    return load(system, t, state.body, slip, touching, state.height, under), slip


def rates(
    system: AbstractBody,
    state: ReleasedState,
    body_response: Response,
    amounts: Float[Array, " amounts"],
) -> ReleasedState:
    """Computes ẋ with the amounts of the response, of which the first are the slip acceleration v̇_s in contact axes.

    V̇ = rω̇ × n + v̇_s + ``convected``.
    """
    body = state.body
    Omegadot, thetaddot = (body_response.part(name, amounts) for name in ("Omegadot", "thetaddot"))
    moved = body.rates(system.radius, Omegadot, (body.theta, body.thetadot, thetaddot), body_response.own)
    under = body_response.footing
    turned = velocity_by_turning(system, body.Lambda, Omegadot, under)
    V = turned + under.to_space(amounts[:3]) + body_response.convected
    rise = state.V[2] if body_response.rise is None else body_response.rise
    place = under.coordinate_rates
    if place is None:
        place = state.V[0] if isinstance(body, DiskState) else state.V[:2]
    return ReleasedState(eqx.tree_at(lambda x: x.z, moved, place), V, rise)


def with_slip(
    system: AbstractBody,
    state: ReleasedState,
    body_response: Response,
    before: Float[Array, "3"],
    after: Float[Array, "3"],
) -> ReleasedState:
    """Returns the state with another slip velocity, after an impulse of the ground; contact axes.

    ``before`` is the slip velocity that it has, and ``body_response`` its response.
    """
    change = after - before
    amounts = body_response.jump(change)
    Omega, thetadot = (combine_rows(amounts, body_response.each(name)) for name in ("Omegadot", "thetaddot"))
    return with_velocities(system, state, body_response, Omega, thetadot, change)


def with_velocities(
    system: AbstractBody,
    state: ReleasedState,
    body_response: Response,
    Omega: Float[Array, "3"],
    thetadot: Float[Array, " coordinates"],
    change: Float[Array, "3"],
) -> ReleasedState:
    """Returns the state after changes of Ω, θ̇ and of the slip velocity, contact axes."""
    body = state.body
    under = body_response.footing
    V = state.V + velocity_by_turning(system, body.Lambda, Omega, under) + under.to_space(change)
    moved = eqx.tree_at(lambda x: x.thetadot, body.with_Omega(body.Omega + Omega), body.thetadot + thetadot)
    return ReleasedState(moved, V, state.height)


def energy_of_released(system: AbstractBody, t: Float[Array, ""], state: ReleasedState) -> Float[Array, ""]:
    """Computes T + V of the body, mass length²/time², relative to the moving axes; 0 at rest in a centre at
    the origin.
    """
    body, r = state.body, system.radius
    points = kinematics(system, t, (body.theta, body.thetadot, body.thetadot))  # θ̈ is not used
    still = jnp.zeros((1, 3), dtype=state.V.dtype)
    masses = Kinematics(
        jnp.concatenate([system.offset[None], points.chi]), jnp.concatenate([still, points.chidot]), points.chiddot
    )
    m = jnp.concatenate([system.mass[None], point_mass_values(system)])
    # What every mass has besides the velocity of rolling on a plane at rest.
    lowest = state.V - velocity_by_turning(system, body.Lambda, body.Omega)
    up = system.up
    centre = position(system, t, state)
    arm, relative = arm_of(system, body.Gamma), apply(body.Lambda.T, lowest)
    T = kinetic_energy(m, principal_inertia(system), r, masses, body.Omega, arm, relative)
    return T + potential_energy(m, system.gravity, masses, apply(body.Lambda.T, up), dot(up, centre))


def position(system: AbstractBody, t: Float[Array, ""], state: ReleasedState) -> Float[Array, "3"]:
    """Returns the place of the geometric centre, space axes; a plane is at the height −r."""
    body, surface = state.body, locate_surface(system, t, state.body)
    if surface is None:
        return place_of_centre(system, body, AT_REST, state.height)
    return surface.place_of_centre(t, system.radius + state.height, body.z)


def combine_rows(amounts: Float[Array, " amounts"], rows: Float[Array, "amounts n"]) -> Float[Array, " n"]:
    """Computes the sum of rows, each times its amount."""
    return jnp.sum(amounts[:, None] * rows, axis=0)
