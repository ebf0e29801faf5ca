"""The rolling bodies, a ball or a disk with point masses inside, as mechanical systems."""

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..interface.printing import is_array
from ..interface.wording import all_of, number_of
from ..numerics.arrays import AnyArray, Numbers, default_dtype, join_arrays, namespace_of, to_array
from ..numerics.declare import OF_INERTIA, POSITIVE, number
from .conditions import Condition, ExplainedCondition, Problem, all_hold, on_numbers, real_inertia
from .dynamics.coupling import mass_conditions
from .dynamics.dry_friction import TurningMode
from .dynamics.equations import accelerations, solvable_friction
from .dynamics.footing import rates, surface_under
from .dynamics.load import load
from .dynamics.locked import field_of_locked, from_locked, reaction, to_locked
from .dynamics.parameters import BodyParameters, PointMass
from .dynamics.sticking import has_stops, range_conditions, sticking_slots
from .feedback import AbstractLaw, FollowSchedules
from .forces.force import shapes_of_motion
from .limits.breaches import breaches, in_plane, wild_masses
from .limits.confinement import clearance, is_confined, is_off_plane, time_of_leaving
from .mechanisms import Accelerated
from .own_states import require_own
from .prescribed.motion import Driven
from .prescribed.recorded import coverages, is_recorded
from .prescribed.schedules import AbstractSchedule
from .rolling import AbstractRollingSystem, Reaction
from .state import BallState, DiskState, ReducedState, RotationState, State
from .system import AbstractSystem

AnyBody = TypeVar("AnyBody", bound="AbstractBody")


class AbstractBody(BodyParameters, AbstractRollingSystem[Any]):
    """What a ball and a disk share as systems.

    A solve advances the locked angular velocity W instead of Ω; the module ``locked`` explains why.
    """

    __init__ = BodyParameters.__init__  # type checkers would derive another one from the fields

    def describe(self) -> str:
        parts = [number_of(self.n_masses, "point mass", "point masses")] if self.n_masses else []
        parts += [number_of(len(self.mechanisms), "mechanism")] if self.mechanisms else []
        return f"{self.title} with {all_of(parts) if parts else 'no point masses'}"

    def conditions(self) -> Iterator[Condition]:
        yield from on_numbers(self, "")
        if not self.planar:
            yield real_inertia(self.inertia)
        yield Condition(
            (self.offset**2).sum() <= self.radius**2,
            "offset",
            self.offset,
            "a point inside the shell, closer to the centre than the radius",
        )
        if self.planar:
            flat = ~is_off_plane(self, self.offset)
            yield Condition(flat, "offset", self.offset, "in the plane of a disk, E1 and E3, with second entry 0")
        for group, indices in zip(self.groups, self.order, strict=True):
            names = tuple(f"masses[{index}].mass" for index in indices)
            holds = (group.mass > 0) & namespace_of(group.mass).isfinite(group.mass)
            yield Condition(holds, names, group.mass, "a positive number")
        for index, mechanism in enumerate(self.mechanisms):
            yield from mechanism.conditions(f"mechanisms[{index}]")
        if self.ground is not None:
            yield from self.ground.conditions(self.planar)
        if self.resistance is not None:
            yield from self.resistance.conditions()
        if self.force is not None:
            yield from self.force.conditions("force")

    def start_conditions(self, t: Float[Array, ""], state: Any) -> Iterator[Condition | ExplainedCondition]:
        if any(group.free for group in self.mechanism_groups):
            yield from mass_conditions(self.prepare(), t, state)
        if has_stops(self):
            yield from range_conditions(self, sticking_slots(self), state.theta)
        if self.ground is not None:
            under = surface_under(self, t, state)
            yield from (self.ground if under is None else under).start_conditions(t, self.radius, state)
        if self._is_dry:
            yield from solvable_friction(self.prepare(), t, state)

    def run_conditions(self, times: Float[AnyArray, " T"]) -> Iterator[ExplainedCondition]:
        if any(map(is_recorded, jax.tree.leaves(self, is_leaf=is_recorded))):
            yield from coverages(self.arguments, times)

    def default_state(self) -> State:
        if not self.driven and not self.mechanism_order and not self.driven_ground and self.own_states is None:
            return AbstractSystem.default_state(self)  # without what is looked up below, which takes microseconds
        by_law = [self.coordinates[slot] for slot in self.accelerated]
        if by_law:
            raise ValueError(
                f"Argument `state` must be given, because it holds the angles of {all_of(by_law)}, which a law drives; "
                f"pass {self.state_type.__name__}(theta=..., thetadot=...)."
            )
        return self.upright_state()

    def upright_state(self) -> State:
        """Returns the state at rest and upright at the origin, with all coordinates and states of one's own 0."""
        zeros = np.zeros(len(self.coordinates))
        return self.state_type(theta=zeros, thetadot=zeros, own=np.zeros(self.n_own) if self.n_own else None)

    def require_state(self, state: Any) -> None:
        AbstractSystem.require_state(self, state)
        theta, thetadot = state.theta, state.thetadot
        count = len(self.driven) + len(self.joints) + len(self.driven_ground)
        if theta.shape[-1] != count or thetadot.shape[-1] != count:
            named = self.joints or self.driven_ground
            which = f"those of {all_of(self.coordinates)}" if named else "one for each driven mass"
            raise ValueError(
                f"Argument `state` must have {count} entries in theta and in thetadot, {which}, "
                f"but it has {theta.shape[-1]} and {thetadot.shape[-1]}."
            )
        require_own(self.own_states, state)

    def numbers(self) -> Iterator[tuple[str, Array]]:
        for (argument, *path), leaf in jax.tree_util.tree_leaves_with_path(self.arguments):
            if is_array(leaf):
                yield argument.key + jax.tree_util.keystr(tuple(path)), leaf

    def prepare(self: AnyBody) -> AnyBody:
        """Returns the same body with splines solved and frames converted to matrices: once per solve, not once per
        step.
        """
        groups = tuple(
            eqx.tree_at(lambda g: g.motion, group, eqx.filter_vmap(lambda motion: motion.prepare())(group.motion))
            for group in self.groups
        )
        mechanisms = tuple(eqx.filter_vmap(lambda m: m.prepare())(group) for group in self.mechanism_groups)
        law, ground = (None if part is None else part.prepare() for part in (self.law, self.ground))
        return eqx.tree_at(
            lambda body: (body.groups, body.mechanism_groups, body.law, body.ground),
            self,
            (groups, mechanisms, law, ground),
            is_leaf=lambda x: x is None,
        )

    @property
    def sticking(self) -> tuple[str, ...]:
        """The joints that dry friction may hold at rest, by name."""
        if not self.mechanism_groups:
            return ()  # without what is looked up below, which takes microseconds
        return tuple(self.coordinates[slot] for slot in sticking_slots(self))

    @property
    def is_held(self) -> bool:
        """Whether exact dry resistance may hold it at rest."""
        return self.resistance is not None and self.resistance.holds

    @property
    def is_hybrid(self) -> bool:
        """Whether joints stick and slip, or dry resistance holds the body, so that a run has modes."""
        return bool(self.sticking) or self.is_held

    def motion_kinks(self) -> Float[Array, " kinks"]:
        """Returns those of :meth:`kinks_of_paths`; none with dry friction."""
        return join_arrays([]) if self._is_dry else self.kinks_of_paths()

    def driving_kinks(self) -> Float[Array, " kinks"]:
        """Returns the unsorted times at which a law, a force or the ground's motion jumps or has a kink.

        Dry friction is proportional to the normal force, which jumps with prescribed accelerations.
        """
        # Kinks do not depend on the numbers of a state: any of the right shape will do to trace a user's law.
        state, count = self.upright_state(), len(self.coordinates)
        times = [] if self.law is None else [self.law.kinks_with(state)]
        times += [] if self.own_states is None else [self.own_states.kinks_with(state)]
        times += [] if self.force is None else [self.force.kinks_with(shapes_of_motion(count, self.n_own))]
        times += [] if self.ground is None else [self.ground.kinks()]
        times += [
            jnp.ravel(eqx.filter_vmap(lambda mechanism: mechanism.driving_kinks(state))(group))
            for group in self.mechanism_groups
        ]
        return join_arrays([*times, self.kinks_of_paths()] if self._is_dry else times)

    @property
    def _is_dry(self) -> bool:
        return self.resistance is not None and self.resistance.is_dry

    def kinks_of_paths(self) -> Float[Array, " kinks"]:
        """Returns the unsorted times at which χ̈ of a prescribed motion jumps or has a kink."""
        motions = [group.motion for group in self.groups if not isinstance(group.motion, Driven)]
        times = [eqx.filter_vmap(lambda motion: motion.kinks())(motion) for motion in motions]
        groups = self.mechanism_groups
        times += [eqx.filter_vmap(lambda mechanism: mechanism.motion_kinks())(group) for group in groups]
        return join_arrays([*map(jnp.ravel, times)])

    def to_packed(self, t: Float[Array, ""], state: Any) -> Any:
        return to_locked(self, t, state)

    def from_packed(self, t: Float[Array, ""], packed: Any) -> Any:
        return from_locked(self, t, packed)

    def field(self, t: Float[Array, ""], state: Any, mode: TurningMode | None = None) -> Any:
        """Evaluates ``rolling_ball_ode_f``, ``uncon_ball_eqns_explicit_full`` or ``uncon_ball_eqns_explicit``, by the
        state.

        Of a disk ``eq_rdisk_dynamics``: φ̈ is −Ω̇₂ of the ball's equation. The ``mode`` of exact dry resistance follows
        from the state if it is None.
        """
        acting = load(self, t, state)
        moves = accelerations(self, t, state, acting, mode)
        return rates(self, t, state, moves.Omegadot, moves.angles, acting.footing)

    def field_of_packed(self, t: Float[Array, ""], packed: Any) -> Any:
        return field_of_locked(self, t, packed)

    def plane_reaction(self, t: Float[Array, ""], state: Any) -> Reaction:
        return reaction(self, t, state)

    @property
    def weight(self) -> Float[Array, "*batch"]:
        return self.total_mass * self.gravity

    def is_confined(self, times: Float[Array, " T"], state: Any) -> Bool[Array, ""]:
        return is_confined(self, times, state, self.kinks_of_paths()) & all_hold(in_plane(self, times))

    def time_of_leaving(self, times: Float[Array, " T"], states: Any) -> Float[Array, ""]:
        return time_of_leaving(self, times, states.theta, self.kinks_of_paths())

    def clearance(self, t: Float[Array, ""], state: Any) -> Float[Array, ""] | None:
        return clearance(self, t, state.theta)

    def breaches(self, times: Float[np.ndarray, " T"], state: Any | None, states: Any | None) -> Iterator[Problem]:
        theta = states.theta if states is not None else None if state is None else state.theta[None]
        yield from breaches(self, times, None if theta is None else np.asarray(theta))
        if state is not None:
            yield from wild_masses(self, times[0], state)

    def with_masses(self: AnyBody, masses: Sequence[PointMass], law: AbstractLaw | None = None) -> AnyBody:
        """Returns the same body with other point masses, and the law that drives them.

        **Arguments:**

        - ``masses``: the point masses, any number of them.
        - ``law``: the feedback law of those that are :class:`~jaxball.Driven`, or None.

        **Example:**

        >>> from jaxball import Disk, Fixed, PointMass
        >>> empty = Disk(mass=1.0, inertia=0.5)
        >>> empty.with_masses([PointMass(0.5, Fixed((0.0, 0.0, -0.5)))]).n_masses
        1
        """
        return type(self)(**{**self.arguments, "masses": masses, "law": law})

    def with_integrated_angles(
        self: AnyBody, t0: Numbers = 0.0, state: State | None = None
    ) -> tuple[AnyBody, dict[str, Array]]:
        """Returns the same system in the paper's own form, where the state contains θ and θ̇ of everything that has a
        schedule.

        **Arguments:**

        - ``t0``: the time of the state.
        - ``state``: a state of the system at that time, needed only if some of its joints are free; their θ and θ̇ are
          kept.

        **Returns:** the system with its :class:`~jaxball.OnRail` masses replaced by driven ones that follow θ̈(t) of
        their schedules, as do joints, and angles of a :class:`~jaxball.physics.TiltingPlane`, with schedules; and the
        entries ``theta`` and ``thetadot`` of its state at ``t0``.

        **Raises:** ``ValueError`` when the system already has a feedback law, and when it has free joints but no state
        is given.

        **Example:**

        >>> from jaxball import Circle, ConstantRate, Disk, DiskState, OnRail, PointMass
        >>> mass = PointMass(0.5, OnRail(Circle(0.9), ConstantRate(0.0, rate=2.0)))
        >>> driven, angles = Disk(mass=1.0, inertia=0.5, masses=[mass]).with_integrated_angles(t0=1.0)
        >>> DiskState(**angles)
        DiskState(phi=0.0, phidot=0.0, z=0.0, theta=(2.0,), thetadot=(2.0,))
        """
        if self.accelerated:
            driven = all_of([self.coordinates[slot] for slot in self.accelerated])
            raise ValueError(f"The body must have no feedback law, but one drives {driven}.")
        masses, mechanisms, schedules = [], [], []
        for item in self.point_masses:
            if item.schedule is not None:
                schedules.append(item.schedule)
                item = item.follow_law()
            masses.append(item)
        for mechanism in self.mechanisms:
            drives = list(mechanism.drives)
            for a, drive in enumerate(drives):
                if isinstance(drive, AbstractSchedule):
                    schedules.append(drive)
                    drives[a] = Accelerated()
            mechanisms.append(mechanism.with_drives(drives))
        ground = self.ground
        if ground is not None:
            schedules += ground.schedules
            ground = ground.follow_law()
        law = FollowSchedules(tuple(schedules)) if schedules else None
        parts = {"masses": masses, "law": law, "mechanisms": mechanisms, "ground": ground}
        driven = type(self)(**{**self.arguments, **parts})
        free_angles = _free_angles(self, state)
        rates = [schedule.derivatives(to_array(t0)) for schedule in schedules]
        accelerated = driven.accelerated
        # The values are those of the schedules, then of the free joints; a state has them in the order of coordinates.
        places = [*accelerated, *(slot for slot in range(len(driven.coordinates)) if slot not in accelerated)]
        angles = {}
        for order, name in enumerate(("theta", "thetadot")):
            values = jnp.concatenate([to_array([rate[order] for rate in rates]), free_angles[name]])
            angles[name] = values[np.argsort(places)] if free_angles[name].size else values
        return driven, angles


class Ball(AbstractBody):
    """A ball with point masses inside, rolling without slipping on a horizontal plane (section 2).

    **Arguments:**

    - ``mass``: m_0, the mass of the shell with its static internal structure, in units of mass.
    - ``inertia``: the principal moments (d1, d2, d3) about the shell's own centre of mass, none more than the sum of
      the other two, mass length², shape (3,).
    - ``radius``: r, the radius of the shell, length.
    - ``offset``: χ_0 = ζ_0, from the geometric centre to the shell's centre of mass, body axes, length, shape (3,).
    - ``gravity``: g, the acceleration of gravity, length/time².
    - ``force``: Fe(t) at the geometric centre, a :class:`~jaxball.FunctionWrench` if it depends on the motion, or None.
    - ``masses``: the point masses, any number of them.
    - ``law``: the feedback law that drives the :class:`~jaxball.Driven` masses and :class:`~jaxball.Accelerated`
      joints, if there are any.
    - ``mechanisms``: joints with masses, such as a :class:`~jaxball.Mechanism`, any number of them.
    - ``ground``: a :class:`~jaxball.Ground`, if the plane is tilted or moves, or a surface such as a
      :class:`~jaxball.HeightField`; None for a level plane at rest.
    - ``resistance``: a :class:`~jaxball.Resistance` to rolling, another :class:`~jaxball.physics.AbstractResistance`,
      or None.
    - ``own_states``: states of your own beside the body, an :class:`~jaxball.physics.OwnStates`, or None.

    Any consistent units will do; the paper rescales so that m = r = g = 1.

    **Raises:** ``ValueError`` when a shape is wrong, when there are driven masses but no law, or a law but nothing
    that it drives. Values are not checked here, so that they may be traced; see :func:`jaxball.problems`.

    **Example:**

    >>> from jaxball import Ball, Circle, OnRail, PointMass, Pulse
    >>> ball = Ball(mass=1.0, inertia=(0.9, 1.0, 1.1), masses=[PointMass(0.5, OnRail(Circle(0.9), Pulse(0.8)))])
    >>> ball
    Ball(mass=1.0, inertia=(0.9, 1.0, 1.1), radius=1.0, offset=(0.0, 0.0, 0.0), gravity=1.0)
      masses[0]: PointMass(mass=0.5, motion=OnRail(rail=Circle(radius=0.9), schedule=Pulse(theta=0.8)))
    >>> float(ball.total_mass)
    1.5
    """

    __init__ = BodyParameters.__init__

    title: ClassVar[str] = "ball"
    state_type: ClassVar[Any] = BallState
    other_state_types: ClassVar[tuple[Any, ...]] = (RotationState, ReducedState)

    def require_state(self, state: Any) -> None:
        AbstractBody.require_state(self, state)
        if isinstance(state, ReducedState) and not self.is_reducible:
            what = "external force" if self.ground is None else "`ground` that is tilted or moves"
            raise ValueError(
                f"Argument `system` must have no {what} in the reduced system, because its direction in the body is "
                "not known from (Omega, Gamma); use a BallState."
            )

    @property
    def is_reducible(self) -> bool:
        """Whether (Ω, Γ) and the coordinates determine their own rates: no force and no ground has a direction."""
        return self.force is None and self.ground is None

    def phase_point(self, state: Any) -> BallState | ReducedState:
        """Returns (Ω, Γ), unless a force acts or the ground is tilted or moves, which they cannot express."""
        return state.reduce() if self.is_reducible else state.in_space()


class Disk(AbstractBody):
    """A disk with point masses in its plane, rolling on a line: the ball's planar case (section 3.3).

    On a surface it rolls along a curve, the section of the surface by the plane of e1 and e3.

    **Arguments:**

    - ``inertia``: the only moment d2, about the shell's own centre of mass, mass length².
    - ``offset``: χ_0, from the geometric centre to the shell's centre of mass, in the plane of E1 and E3, length, shape
      (3,). The rails and the free motions of the masses are in this plane as well.
    - ``mass``, ``radius``, ``gravity``, ``force``, ``masses``, ``law``, ``mechanisms``, ``ground``, ``resistance`` and
      ``own_states``: as for a :class:`Ball`; no turntable, and a surface must be symmetric about
      the plane of e1 and e3.

    **Raises:** as for :class:`Ball`.

    **Example:**

    >>> from jaxball import Disk, Fixed, PointMass
    >>> Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, Fixed((0.0, 0.0, -0.5)))])
    Disk(mass=1.0, inertia=0.5, radius=1.0, offset=(0.0, 0.0, 0.0), gravity=1.0)
      masses[0]: PointMass(mass=0.5, motion=Fixed(position=(0.0, 0.0, -0.5)))
    """

    __init__ = BodyParameters.__init__

    inertia: Float[Array, "*group"] = eqx.field(converter=number(OF_INERTIA, POSITIVE))

    planar: ClassVar[bool] = True
    title: ClassVar[str] = "disk"
    state_type: ClassVar[Any] = DiskState

    def embed(self) -> Ball:
        """Returns the disk as a ball with three equal moments that rolls in the plane of e1 and e3."""
        arguments: dict[str, Any] = {**self.arguments, "inertia": jnp.stack([self.inertia] * 3)}
        return Ball(**arguments)


System = Ball | Disk | AbstractBody  # which may be a ConvexBody


def _free_angles(system: System, state: State | None) -> dict[str, Array]:
    """Returns θ and θ̇ of a state of the system, if it has any."""
    if not system.coordinates:
        return dict.fromkeys(("theta", "thetadot"), jnp.zeros((0,), default_dtype()))
    if state is None:
        raise ValueError(
            f"Argument `state` must be given, because it holds the angles of {all_of(system.coordinates)}, which are "
            "free."
        )
    system.require_state(state)
    return {"theta": state.theta, "thetadot": state.thetadot}
