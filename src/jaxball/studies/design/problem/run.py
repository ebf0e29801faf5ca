"""A simulated candidate, the argument of objectives and constraints."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ....files.scenario.scenario import Scenario
from ....interface.compat import current_trace
from ....physics.body import System
from ....physics.dynamics.coupling import join_coordinates, joint_forces, linkages
from ....physics.dynamics.equations import accelerations, angles_in_state
from ....physics.dynamics.footing import has_end, surface_under
from ....physics.dynamics.load import accelerations_of_masses, load
from ....physics.dynamics.moments import along_rails, kinematics, point_mass_values, rail_tangents
from ....physics.grounds import AbstractSurface
from ....physics.mechanisms import Mechanism, Slider
from ....physics.observables import Observables, observe
from ....physics.prescribed.motion import Kinematics, rail_of
from ....physics.prescribed.rails import AbstractRail
from ....physics.state import BallState, DiskState
from ....programs.batches import map_rows
from ....simulation.simulate import simulate
from ....simulation.trajectory import times_looked_at
from .space import Candidate, DesignError

RAIL_SAMPLES = 48


class Solve(NamedTuple):
    """How candidates are simulated; ``adjoint`` None stands for reverse mode.

    **Arguments:**

    - ``solver``, ``rtol``, ``atol``, ``max_steps``, ``max_step``: as for :func:`jaxball.simulate`.
    """

    solver: diffrax.AbstractAdaptiveSolver
    rtol: float
    atol: float
    max_steps: int
    adjoint: diffrax.AbstractAdjoint | None = None
    max_step: float | None = None

    @classmethod
    def of(cls, scenario: Scenario, adjoint: diffrax.AbstractAdjoint | None = None) -> "Solve":
        """Returns the solver, the tolerances and the limits of steps that the scenario states."""
        stated = {name: value for name, value in scenario.settings.items() if name in cls._fields}
        return cls(**stated, adjoint=adjoint)


class OnRails(NamedTuple):
    """Masses along their rails at times t: θ, θ̇, θ̈ and the unit tangent; zero for masses on no rail."""

    theta: Float[Array, "t n"]
    thetadot: Float[Array, "t n"]
    thetaddot: Float[Array, "t n"]
    tangent: Float[Array, "t n 3"]


class Curves(NamedTuple):
    """Closed rails sampled all the way around: ``points`` ζ(θ), ``speed`` |ζ′(θ)|, and the masses that they carry."""

    masses: tuple[int, ...]
    points: Float[Array, "rails samples 3"]
    speed: Float[Array, "rails samples"]


Compute = TypeVar("Compute", bound=Callable[["Run"], Any])


def _once(compute: Compute) -> Compute:
    """Makes a method whose result a run keeps, so that all requirements that ask for it share what is compiled."""

    @functools.wraps(compute)
    def keep(run: "Run") -> Any:
        results, trace = vars(run).setdefault("_results", {}), current_trace()
        # What is made within a trace, such as that of a function of a user's requirement, means nothing outside of it.
        if results.get(compute, (None,))[0] != trace:
            results[compute] = trace, compute(run)
        return results[compute][1]

    return cast(Compute, keep)


class Run(eqx.Module):
    """The run of a system, at times t. Quantities are computed only when used, and once.

    - ``system``, ``times``, ``state``: the body, times of shape (t,), and the states then.
    - ``status``: the number of a :class:`~jaxball.Status`.
    - ``rail_samples``: the number of points on closed rails.
    - ``may_slip``: whether there is a law of contact. A state alone does not say how such a body moves, so that it has
      been ``seen`` in the run.
    """

    system: System
    times: Float[Array, " t"]
    state: BallState | DiskState
    status: Int[Array, ""]
    rail_samples: int = eqx.field(static=True, default=RAIL_SAMPLES)
    may_slip: bool = eqx.field(static=True, default=False)
    seen: Observables | None = None

    @property
    def _times(self) -> Float[Array, " t"]:
        # What jumps at the end of a run is evaluated just before it.
        return times_looked_at(self.system, self.times, self.times[-1:])

    @property
    @_once
    def z(self) -> Float[Array, "t 2"]:
        """The path of the geometric centre, along e1 and e2; for a disk it lies on the first axis.

        On a surface it is that of the centre in space, not of the coordinates on the ground.
        """
        return self._each(locate_centre)[:, :2] if has_end(self.system) else self.state.in_space().z

    @property
    def length(self) -> Float[Array, ""]:
        """The unit of lengths, r."""
        return self.system.radius

    @property
    def weight(self) -> Float[Array, ""]:
        """M g."""
        return self.system.total_mass * jnp.abs(self.system.gravity)

    @property
    def time_unit(self) -> Float[Array, ""]:
        """The unit of times, √(r/g)."""
        return jnp.sqrt(self.length / jnp.abs(self.system.gravity))

    def _each(self, function: Callable[[System, Any, Any], Any]) -> Any:
        """Evaluates a function of the prepared system, a time and the state then, at all times."""
        # Rotation matrices of rails and the like are computed once, not for each time.
        prepared = self.system.prepare()
        return map_rows(lambda t, x: function(prepared, t, x), self._times, self.state)

    @property
    @_once
    def observables(self) -> Observables:
        """Positions, energies and forces."""
        return self._each(observe) if self.seen is None else self.seen

    def _require_rolling(self, what: str) -> None:
        if self.may_slip:
            raise DesignError(
                f"Key `contact` must be left out here, because {what} are computed only for bodies that always roll, "
                "and an objective or a constraint of this design needs them."
            )

    @property
    @_once
    def masses(self) -> Kinematics:
        """χ, χ̇ and χ̈ of the masses, each of shape (t, n, 3)."""
        if any(mechanism.free for mechanism in self.system.mechanisms):
            self._require_rolling("accelerations of masses that swing freely")
        return self._each(lambda system, t, x: kinematics(system, t, accelerations(system, t, x).angles))

    @property
    @_once
    def forces(self) -> Float[Array, "t n 3"]:
        """m (a + γ), the force that each mass needs from what carries it, in body axes; γ is gΓ on a level plane."""
        self._require_rolling("forces on masses")
        m = point_mass_values(self.system)

        def one(system, t, x):
            motion, acting = accelerations(system, t, x), load(system, t, x)
            masses = kinematics(system, t, motion.angles)
            a = accelerations_of_masses(system.radius, masses, x.Omega, motion.Omegadot, acting.arm.along)
            return m[:, None] * (a + acting.weight[None])

        return self._each(one)

    @property
    def forces_along(self) -> Float[Array, "t n"]:
        """F·τ, the force on each mass along its rail."""
        # Across its tangent a rail carries the mass; only the force along it needs an actuator.
        return jnp.sum(self.forces[:, : self.system.n_masses] * self.on_rails.tangent, axis=-1)

    @property
    @_once
    def joint_efforts(self) -> Float[Array, "t joints"]:
        """Q of every joint of the mechanisms; where all are free, computed without the motion's accelerations.

        What holds a joint that sticks, or moves one with a schedule, follows from accelerations of the whole motion.
        """
        system = self.system
        moved = any(mechanism.n_joints > len(mechanism.free) for mechanism in system.mechanisms)
        if self.may_slip or system.sticking or moved:
            return self.observables.joint_efforts

        def one(system, t, x):
            # Forces of free joints depend on positions and rates only; the third place, for accelerations, is not
            # used.
            links = linkages(system, t, (x.theta, x.thetadot, x.thetadot))
            return join_coordinates(x.theta, links, joint_forces(t, x, links))[len(system.driven) :]

        return self._each(one)

    @property
    def effort_units(self) -> Float[Array, " joints"]:
        """The units of joint efforts: M g for the force of a slider, M g r for the torque of any other."""
        every = (
            item.joints if isinstance(item, Mechanism) else (None,) * item.n_joints for item in self.system.mechanisms
        )
        slides = [isinstance(joint, Slider) for joints in every for joint in joints]
        return self.weight * jnp.where(np.asarray(slides, dtype=bool), 1.0, self.length)

    @property
    @_once
    def on_rails(self) -> OnRails:
        """θ and its rates."""

        def one(system, t, x):
            along = along_rails(system, t, angles_in_state(system, t, x))
            return OnRails(*along, rail_tangents(system, along.theta))

        return self._each(one)

    @property
    @_once
    def plate_accelerations(self) -> Float[Array, "t angles"]:
        """θ̈ of the angles of a plate, those with schedules and then those that a law drives; no columns elsewhere."""

        def one(system, t, x):
            ground = system.ground
            schedules, count = ((), 0) if ground is None else (ground.schedules, len(ground.driven))
            parts = [schedule.derivatives(t)[2][None] for schedule in schedules]
            if count:
                assert system.law is not None
                parts.append(system.law.among(system.accelerated, t, x)[-count:])
            return jnp.concatenate(parts) if parts else jnp.zeros_like(t, shape=(0,))

        return self._each(one)

    @property
    @_once
    def ground_left(self) -> Float[Array, "t 2"]:
        """The ``fit`` and the ``reach`` of a surface under the body, both 0 where it cannot go on; 1 on a plane."""

        def measure(surface: AbstractSurface, t: Any, r: Any, z: Any) -> Float[Array, "2"]:
            return jnp.stack([surface.fit(t, r, z), surface.way_to_edge(t, z)])

        return self._each(functools.partial(_of_surface, measure, jnp.ones(2)))

    def ground_to_spare(self, fit: Float[Array, ""], reach: Float[Array, ""]) -> Float[Array, "t 2"]:
        """Computes what ``ground_left`` has above these two, as far as it is small, with second derivatives."""

        def spare(surface: AbstractSurface, t: Any, r: Any, z: Any) -> Float[Array, "2"]:
            return jnp.stack([surface.spare(t, r, z, fit), surface.way_to_edge(t, z) - reach])

        return self._each(functools.partial(_of_surface, spare, 1 - jnp.stack([fit, reach])))

    @property
    @_once
    def curves(self) -> Curves:
        """The closed rails."""
        masses, points, speed = [], [], []
        for group, indices in zip(self.system.groups, self.system.order, strict=True):
            rail = rail_of(group.motion)
            if rail is None or rail.period is None:
                continue
            theta = jnp.linspace(0.0, rail.period, self.rail_samples, endpoint=False, dtype=group.mass.dtype)

            def one(rail: AbstractRail, theta=theta):
                zeta, tangent, _ = jax.vmap(rail.prepare().derivatives)(theta)
                return zeta, jnp.sqrt(jnp.sum(tangent**2, axis=-1))

            zeta, rates = eqx.filter_vmap(one)(rail)
            masses += indices
            points.append(zeta)
            speed.append(rates)
        if not masses:
            nothing = jnp.zeros_like(self.system.mass, shape=(0, self.rail_samples, 3))
            return Curves((), nothing, nothing[..., 0])
        return Curves(tuple(masses), jnp.concatenate(points), jnp.concatenate(speed))


def run_of(candidate: Candidate, solve: Solve, rail_samples: int = RAIL_SAMPLES) -> Run:
    """Simulates the run of a candidate; NaN at times that the solve did not reach.

    **Arguments:**

    - ``candidate``: what to simulate.
    - ``solve``: how.
    - ``rail_samples``: the number of points on closed rails.
    """
    system, state, times, contact = candidate
    # A search may pass through bodies that do not contain their masses.
    trajectory = simulate(system, times, state, contact=contact, **solve._asdict(), inside=False)
    seen = None if contact is None else trajectory.observables
    return Run(system, times, trajectory.state, trajectory.status, rail_samples, contact is not None, seen)


def locate_centre(system: System, t: Float[Array, ""], state: BallState | DiskState) -> Float[Array, " d"]:
    """Locates the geometric centre: z1 and z2 on a plane, and c in space on a surface, shape (3,); traceable."""
    surface = surface_under(system, t, state)
    return state.in_space().z if surface is None else surface.place_of_centre(t, system.radius, state.z)


def _of_surface(
    function: Callable[..., Any], on_plane: Any, system: System, t: Float[Array, ""], state: BallState | DiskState
) -> Any:
    surface = surface_under(system, t, state)
    return on_plane if surface is None else function(surface, t, system.radius, state.z)
