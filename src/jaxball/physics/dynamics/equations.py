"""The equations of motion of the rolling ball and disk: their accelerations.

With these, a state knows its rates (``state``). A solve advances the equations of ``locked``, which are equivalent.
Labels are those of the equations in Putkaradze & Rogers (2018).
"""

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...interface.arguments import require_value
from ...numerics.linear import product
from ...numerics.vectors import add, apply, convert, cross, dot, on_diagonal, outer, root, symmetric
from ...programs.derivatives.differentiation import without_derivatives
from ..conditions import Condition
from ..state import Rates, ReducedState, State
from .coupling import (
    FactoredInertia,
    Inertia,
    Joints,
    Linkage,
    along,
    inertia,
    join_coordinates,
    joint_forces,
    linkages,
    with_free_joints,
)
from .dry_friction import Rows, Turning, TurningMode, mode_of, pressing_force, resist
from .footing import ContactAxes, arm_of, contact_normal, rate_of_carrier
from .load import Load, accelerations_in_turning_axes, load
from .moments import Moments, VelocityMoments, moments, velocity_moments
from .parameters import BodyParameters
from .sticking import has_directions, of_sticking, release_joints, sticking_joints, with_directions

SOLVABLE = (
    "so small, or the masses so nearly above the contact point, that friction at the start adds less to the normal "
    "force than this force itself (Painlevé's paradox)"
)


class Lever(NamedTuple):
    """The place of the contact in a body: its normal Γ, the ``arm`` from it to the geometric centre over r, Γ of a
    sphere, and the ``square`` of that, None for 1.

    ``moment`` is Σ m s, without what of it is along Γ, which adds nothing to the normal force.
    """

    Gamma: Float[Array, "3"]
    arm: Float[Array, "3"]
    square: Float[Array, ""] | None
    moment: Float[Array, "3"]

    @classmethod
    def of(cls, system: BodyParameters, Gamma: Float[Array, "3"], body_moments: VelocityMoments) -> "Lever":
        """Computes it for a body with the normal Γ."""
        if system.shape is None:
            return cls(Gamma, Gamma, None, body_moments.p)
        arm = arm_of(system, Gamma)
        return cls(Gamma, arm, dot(arm, arm), body_moments.M * system.radius * arm + body_moments.p)

    def inertia_about_contact(self, body_moments: VelocityMoments, r: Float[Array, ""]) -> Float[Array, "3 3"]:
        """Computes B."""
        return inertia_about_contact(body_moments, r, self.arm, self.square)

    def normal(self, free: list[Linkage], Omegadot: Float[Array, "3"], thetaddot: Joints) -> Float[Array, ""]:
        """Computes what Ω̇ and θ̈ of free joints add to the normal force: (Σ m s × Γ)·Ω̇ + Σ Γ·p_a θ̈_a."""
        normal = dot(cross(self.moment, self.Gamma), Omegadot)
        for link, rate in zip(free, thetaddot, strict=True):
            normal = normal + jnp.sum(rate * jnp.sum(link.weights * self.Gamma[None, None], axis=-1))
        return normal


class Accelerations(NamedTuple):
    """Ω̇ in body axes, with θ, θ̇ and θ̈ of all that a state's ``theta`` holds.

    ``body_moments`` are all moments, ``dry`` is the torque of dry friction in body axes, and ``holding`` the friction
    in joints that stick, among those of :func:`~jaxball.physics.dynamics.sticking.sticking_slots`; None without such
    joints.
    """

    Omegadot: Float[Array, "3"]
    angles: Rates
    body_moments: Moments
    dry: Float[Array, "3"] | None
    holding: Float[Array, " sticking"] | None


class Equations(NamedTuple):
    """The equations for Ω̇ and for θ̈ of free joints at a state, which are linear with the matrix of ``coupling``.

    ``angles`` and ``body_moments`` hold no acceleration of a free joint, nor does ``apparent``, Ω × (Ω × p + 2ṗ) + p̈.
    In ``matrix`` the joints that stick are ``held``; in ``inertia`` none is.
    """

    Omega: Float[Array, "3"]
    Gamma: Float[Array, "3"]
    lever: Lever
    angles: Rates
    links: list[Linkage]
    body_moments: Moments
    apparent: Float[Array, "3"]
    inertia: Inertia
    held: list[Bool[Array, "_ _"] | None]
    matrix: FactoredInertia

    @property
    def free(self) -> list[Linkage]:
        """The mechanisms that have free joints."""
        return with_free_joints(self.links)

    def solve(
        self, r: Float[Array, ""], t: Float[Array, ""], state: State, acting: Load
    ) -> tuple[Float[Array, "3"], Joints]:
        """Solves for Ω̇ and θ̈ of the body of radius ``r`` under a load."""
        Omega, body_moments = self.Omega, self.body_moments
        turning = (
            cross(Omega, apply(body_moments.J, Omega) + body_moments.l)
            + apply(body_moments.Jdot, Omega)
            + body_moments.ldot
        )
        inertial = turning + cross(r * self.lever.arm, self.apparent)
        efforts = self.without_held(self.efforts(t, state, acting))
        return self.matrix.solve(acting.about_contact(body_moments, r) - inertial, efforts)

    def without_held(self, efforts: Joints) -> Joints:
        """Sets the efforts of joints that stick to 0, so that they have no accelerations."""
        return [
            effort if which is None else jnp.where(which, 0.0, effort)
            for effort, which in zip(efforts, self.held, strict=True)
        ]

    def efforts(self, t: Float[Array, ""], state: State, acting: Load) -> Joints:
        """Computes Q of the free joints, without the friction that holds those that stick, less their
        inertial efforts.
        """
        forces = joint_forces(t, state, self.links)
        return [Q - _inertial_efforts(link, acting, self.Omega) for link, Q in zip(self.free, forces, strict=True)]

    def holding(
        self, t: Float[Array, ""], state: State, acting: Load, Omegadot: Float[Array, "3"], thetaddot: Joints
    ) -> Joints:
        """Computes the friction in joints that stick: the effort that these accelerations need and Q lacks."""
        return self.lacking(self.efforts(t, state, acting), Omegadot, thetaddot)

    def lacking(self, efforts: Joints, Omegadot: Float[Array, "3"], thetaddot: Joints) -> Joints:
        """Computes what these efforts lack of those that these accelerations need."""
        _, needed = self.inertia.times(Omegadot, thetaddot)
        return [x - y for x, y in zip(needed, efforts, strict=True)]

    def reaction_without_motion(self, acting: Load) -> Float[Array, "3"]:
        """Computes the reaction R̃ of the plane as it would be if Ω̇ and θ̈ were 0."""
        return add(self.apparent + self.body_moments.M * acting.weight, convert(jnp.negative, acting.force))

    def complete(self, thetaddot: Joints) -> Moments:
        """Completes the moments with the accelerations of free joints: p̈ + Σ p_a θ̈_a and ℓ̇ + Σ ℓ_a θ̈_a."""
        pddot, ldot = self.body_moments.pddot, self.body_moments.ldot
        for link, rate in zip(self.free, thetaddot, strict=True):
            momenta = link.m[..., None] * along(link.partial, rate)
            pddot = pddot + jnp.sum(momenta, axis=(0, 1))
            ldot = ldot + jnp.sum(cross(link.chi, momenta), axis=(0, 1))
        return dataclasses.replace(self.body_moments, pddot=pddot, ldot=ldot)


def equations(
    system: BodyParameters, t: Float[Array, ""], state: State, Gamma: Float[Array, "3"] | None = None
) -> Equations:
    """Builds the equations at a state, whatever acts; with Γ for the normal of the contact, if it is given."""
    r, Omega, Gamma = system.radius, state.Omega, contact_normal(system, t, state) if Gamma is None else Gamma
    angles = angles_in_state(system, t, state)
    links = linkages(system, t, angles)
    body_moments = moments(system, t, angles, links)
    apparent = accelerations_in_turning_axes(Omega, body_moments.p, body_moments.pdot, body_moments.pddot)
    lever = Lever.of(system, Gamma, body_moments)
    whole = inertia(lever.inertia_about_contact(body_moments, r), r, lever.arm, links)
    which = [sticking_joints(link.group) for link in with_free_joints(links)]
    return Equations(
        Omega, Gamma, lever, angles, links, body_moments, apparent, whole, which, whole.holding(which).factorise()
    )


def accelerations(
    system: BodyParameters,
    t: Float[Array, ""],
    state: State,
    acting: Load | None = None,
    mode: TurningMode | None = None,
) -> Accelerations:
    """Computes Ω̇ and θ̈ at a state, where the load is ``acting``, and the body in a ``mode`` of turning.

    With the free joints' accelerations left out of p̈ and ℓ̇, the equations for Ω̇ and for the free θ̈ are linear with
    the matrix of ``coupling``, in which joints that stick are held. Dry friction at the contact, proportional to a
    normal force that is linear in Ω̇ and θ̈ as well, adds one solution with the same factors.
    """
    acting = load(system, t, state) if acting is None else acting
    # A solve has put in the directions; from a state alone they are found here.
    if not has_directions(system):
        system = with_directions(system, _directions(*without_derivatives((system, t, state, acting))))
    r, motion_equations = system.radius, equations(system, t, state)
    Gamma, lever, free = motion_equations.Gamma, motion_equations.lever, motion_equations.free
    Omegadot, thetaddot = motion_equations.solve(r, t, state, acting)
    resistance, dry = system.resistance, None
    if resistance is not None and not resistance.holds:
        dry = resistance.dry_torque(system.height_of_centre(Gamma), acting.resisted, Gamma)
    if resistance is not None and resistance.holds:
        axes = _contact_axes(system, t, state)
        turns = _turning(system, motion_equations, acting, Omegadot, thetaddot, axes, rate_of_carrier(system, t, state))
        # A solve knows the mode; from a state alone it is found here.
        if mode is None:
            mode = mode_of(resistance, turns, apply(axes, acting.resisted), system.planar)
        dry = apply(axes.T, resist(turns, mode).amounts)
        change, joint_changes, _ = _dry_friction(lever, free, motion_equations.matrix, dry)
        Omegadot = Omegadot + change
        thetaddot = [x + y for x, y in zip(thetaddot, joint_changes, strict=True)]
    elif dry is not None:
        change, joint_changes, slope = _dry_friction(lever, free, motion_equations.matrix, dry)
        # N = N(without dry friction) + N times what a unit of N changes.
        N = pressing_force(_normal_force(motion_equations, acting, Omegadot, thetaddot), 1 - slope)
        Omegadot = Omegadot + N * change
        thetaddot = [x + N * y for x, y in zip(thetaddot, joint_changes, strict=True)]
        dry = N * dry
    theta, thetadot, driven_thetaddot = motion_equations.angles
    angles = theta, thetadot, join_coordinates(driven_thetaddot, motion_equations.links, thetaddot)
    holding = None
    if any(which is not None for which in motion_equations.held):
        holding = of_sticking(system, motion_equations.holding(t, state, acting, Omegadot, thetaddot))
    return Accelerations(Omegadot, angles, motion_equations.complete(thetaddot), dry, holding)


@jax.jit
def turning(system: BodyParameters, t: Float[Array, ""], state: State) -> Turning:
    """Computes how a body would turn over its ground without dry friction, and how a torque at its contact changes
    that, along the axes of the contact.
    """
    motion_equations, acting = equations(system, t, state), load(system, t, state)
    solved = motion_equations.solve(system.radius, t, state, acting)
    axes = _contact_axes(system, t, state)
    return _turning(system, motion_equations, acting, *solved, axes, rate_of_carrier(system, t, state))


def _turning(
    system: BodyParameters,
    motion_equations: Equations,
    acting: Load,
    Omegadot: Float[Array, "3"],
    thetaddot: Joints,
    axes: Float[Array, "3 3"],
    carried: Float[Array, "3"] | None,
) -> Turning:
    lever, free = motion_equations.lever, motion_equations.free
    changes = jax.vmap(lambda torque: _dry_friction(lever, free, motion_equations.matrix, torque))(axes)
    normal = _normal_force(motion_equations, acting, Omegadot, thetaddot)
    rate = apply(axes, add(Omegadot, carried))
    return Turning(Rows(rate, product(axes, changes[0].T), normal, changes[2]), system.height_of_centre(lever.Gamma))


def _contact_axes(system: BodyParameters, t: Float[Array, ""], state: State) -> Float[Array, "3 3"]:
    """Returns the axes of the contact in body axes, as rows; any of a body that has no direction in space."""
    if not isinstance(state, ReducedState):
        return ContactAxes.of(system, t, state).rows
    up = state.Gamma
    # The axis that is most nearly along the plane, so that its projection on it is not short.
    axis = jnp.where(jnp.arange(3) == jnp.argmin(jnp.abs(up)), 1.0, 0.0).astype(up.dtype)
    along = axis - dot(axis, up) * up
    first = along / root(dot(along, along))
    return jnp.stack([first, cross(up, first), up])


def _normal_force(
    motion_equations: Equations, acting: Load, Omegadot: Float[Array, "3"], thetaddot: Joints
) -> Float[Array, ""]:
    """Computes the normal force without dry friction."""
    lever = motion_equations.lever
    resting = dot(lever.Gamma, motion_equations.reaction_without_motion(acting))
    return resting + lever.normal(motion_equations.free, Omegadot, thetaddot)


def holding_friction(
    system: BodyParameters,
    t: Float[Array, ""],
    state: State,
    acting: Load | None = None,
    mode: TurningMode | None = None,
) -> Float[Array, " sticking"]:
    """Computes the friction that holds the joints that stick, of a body whose joints have directions."""
    holding = accelerations(system, t, state, acting, mode).holding
    assert holding is not None
    return holding


def _directions(system: BodyParameters, t: Float[Array, ""], state: State, acting: Load) -> Float[Array, " sticking"]:
    """Finds the directions in which joints with friction slip, as far as a state tells."""
    return release_joints(system, t, state, lambda system: holding_friction(system, t, state, acting))


def solvable_friction(system: BodyParameters, t: Float[Array, ""], state: State) -> Iterator[Condition]:
    """Yields the condition on dry friction that there is a normal force with it: that a unit of N adds less than itself
    to N.

    It adds more where much of the mass is far ahead of the contact point and friction is great. ``system`` is prepared.
    """
    if system.resistance is None or not system.resistance.is_dry:
        return
    r, Omega, Gamma = system.radius, state.Omega, contact_normal(system, t, state)
    links = linkages(system, t, (state.theta, state.thetadot, state.thetadot))  # no rates are used
    body_moments = velocity_moments(system, t, (state.theta, state.thetadot), links)
    lever = Lever.of(system, Gamma, body_moments)
    matrix = inertia(lever.inertia_about_contact(body_moments, r), r, lever.arm, links).factorise()
    dry = system.resistance.dry_torque(system.height_of_centre(Gamma), Omega, Gamma)
    assert dry is not None
    *_, slope = _dry_friction(lever, with_free_joints(links), matrix, dry)
    # NaN is reported by other conditions.
    yield Condition(~(slope >= 1), "resistance.dry", getattr(system.resistance, "dry", dry), SOLVABLE)


def _dry_friction(
    lever: Lever, free: list[Linkage], matrix: FactoredInertia, dry: Float[Array, "3"]
) -> tuple[Float[Array, "3"], Joints, Float[Array, ""]]:
    """Computes the Ω̇ and free θ̈ due to the torque ``dry`` of a unit of normal force, and the normal force that these
    add.
    """
    still = [jnp.zeros(link.slots.shape, dtype=dry.dtype) for link in free]
    change, joint_changes = matrix.solve(dry, still)
    return change, joint_changes, lever.normal(free, change, joint_changes)


def _inertial_efforts(link: Linkage, acting: Load, Omega: Float[Array, "3"]) -> Float[Array, "mechanisms free"]:
    """Computes h_a = Σ m χ_a·(Ω × (Ω × χ + 2χ̇) + β + γ), where β is χ̈ without the accelerations of free joints."""
    turning = jnp.broadcast_to(Omega, link.chi.shape)
    apparent = accelerations_in_turning_axes(turning, link.chi, link.chidot, link.chiddot)
    return link.along(apparent + acting.weight[None, None])


def inertia_about_contact(
    body_moments: VelocityMoments,
    r: Float[Array, ""],
    arm: Float[Array, "3"],
    square: Float[Array, ""] | None = None,
) -> Float[Array, "3 3"]:
    """Computes B = 𝕀 − Σ m ŝ², the inertia about the contact point, with s = rΓ + χ. Symmetric positive definite.

    ``arm`` is Γ, or what a body that is no sphere has in its place, with its ``square``.
    """
    v = _factor_of_dyads(body_moments.M, body_moments.p, r, arm)
    diagonal = body_moments.M * r**2 * (1.0 if square is None else square) + 2 * r * dot(arm, body_moments.p)
    return symmetric(body_moments.J + on_diagonal(diagonal) - outer(arm, v) - outer(v, arm))


def inertia_about_contact_rate(
    body_moments: VelocityMoments, r: Float[Array, ""], lever: Lever, armdot: Float[Array, "3"]
) -> Float[Array, "3 3"]:
    """Computes Ḃ, by the rule of products."""
    arm, p, pdot = lever.arm, body_moments.p, body_moments.pdot
    v, vdot = _factor_of_dyads(body_moments.M, p, r, arm), _factor_of_dyads(body_moments.M, pdot, r, armdot)
    diagonal = 2 * r * (dot(armdot, p) + dot(arm, pdot))
    if lever.square is not None:
        diagonal = diagonal + 2 * body_moments.M * r**2 * dot(arm, armdot)
    mixed = outer(armdot, v) + outer(arm, vdot)
    return symmetric(body_moments.Jdot + on_diagonal(diagonal) - mixed - mixed.T)


def _factor_of_dyads(
    M: Float[Array, ""], p: Float[Array, "3"], r: Float[Array, ""], arm: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Computes v = rp + ½Mr²Γ: with it, B is J − Γvᵀ − vΓᵀ, but for its diagonal."""
    return r * p + 0.5 * M * r**2 * arm


def angles_in_state(system: BodyParameters, t: Float[Array, ""], state: State) -> Rates:
    """Returns θ, θ̇ and θ̈ of all coordinates in a state's ``theta``: θ̈ = u(t, state) if a law drives them, else 0."""
    if system.law is None:
        return state.theta, state.thetadot, jnp.zeros_like(state.theta)
    driven = system.accelerated
    thetaddot = system.law.among(driven, t, state)
    require_value("law", thetaddot, (len(driven),))
    if len(driven) < len(system.coordinates):
        places = np.full(len(system.coordinates), -1)
        places[np.asarray(driven)] = np.arange(len(driven))
        thetaddot = jnp.where(places >= 0, thetaddot[np.maximum(places, 0)], 0.0)
    return state.theta, state.thetadot, thetaddot
