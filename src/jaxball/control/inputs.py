"""The inputs of a robot, which feedback sets: efforts of joints, and accelerations of masses and of a plate's angles.

A sampled system finds its inputs and their limits here; it and an environment hold values of them over a sample, and
closed loops replay those of a whole run. Feedback and optimal control use the same parts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..interface.arguments import refusal
from ..interface.compat import is_traced
from ..interface.wording import did_you_mean
from ..numerics.arrays import default_dtype
from ..physics.body import System
from ..physics.feedback import AbstractLaw, FollowSchedules
from ..physics.grounds import TiltingPlane
from ..physics.grounds.ground import AbstractGround
from ..physics.mechanisms import AbstractJointForce, AbstractMechanism, Accelerated, Drive, JointForces, Motor
from ..physics.prescribed.schedules import AbstractSchedule, PiecewiseAcceleration
from ..physics.prescribed.signals import PiecewiseSignal

ANGLES = ("about_e1", "about_e2")  # of a TiltingPlane


class GivenAccelerations(AbstractLaw):
    """θ̈ = u, given numbers."""

    u: Float[Array, " driven"]

    def __call__(self, t, state):
        return self.u


class Place(NamedTuple):
    """Where an input acts, and what it sets there.

    - ``mechanism``: the index of the mechanism on which it acts; None for an input on a mass or on the ground.
    - ``number``: the index of the joint in the mechanism, of the mass, or of the angle.
    - ``is_effort``: whether it sets the effort of a joint; otherwise it sets an acceleration.
    - ``angle``: the name of the angle of the ground on which it acts; None for other inputs.
    """

    mechanism: int | None
    number: int
    is_effort: bool
    angle: str | None = None

    @property
    def name(self) -> str:
        """As in ``coordinates`` of a body."""
        if self.angle is not None:
            return f"ground.{self.angle}"
        on_mass = self.mechanism is None
        return f"masses[{self.number}]" if on_mass else f"mechanisms[{self.mechanism}].joints[{self.number}]"


def places_of(system: System, names: Sequence[str] | None) -> tuple[Place, ...]:
    """Returns the inputs with these names, in their order; all that something moves where no names are passed.

    **Raises:** ``TypeError`` for anything but a ball or a disk, or names; ``ValueError`` for a name that is not known,
    one that occurs twice, and where nothing moves any mass or joint.
    """
    if not isinstance(system, System):
        raise refusal("system", "a Ball or a Disk", system)
    places = {place.name: place for place in _places(system)}
    if names is None:
        chosen = tuple(place for place in places.values() if _is_moved(system, place))
        if not chosen:
            remedy = (
                f"name some of {', '.join(places)} in `inputs`" if places else "it has no joints or masses on rails"
            )
            raise ValueError(
                "Argument `system` must have inputs, masses or joints that schedules, laws or motors move, "
                f"but nothing moves any; {remedy}."
            )
        return chosen
    if isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise refusal("inputs", "a list of names, such as mechanisms[0].joints[0]", names)
    for k, name in enumerate(names):
        if name not in places:
            there = f"the inputs are {', '.join(places)}" if places else "the body has no inputs"
            raise ValueError(
                f"Argument `inputs[{k}]` must be an input of this {system.title}, but it is {name!r}"
                f"{did_you_mean(name, tuple(places), there)}"
            )
    if not names or len(set(names)) < len(names):
        twice = next((name for name in names if list(names).count(name) > 1), None)
        what = f"{twice!r} occurs twice" if names else "it is empty"
        raise ValueError(f"Argument `inputs` must name one input or more, each once, but {what}.")
    chosen = tuple(places[name] for name in names)
    # A law computes all its accelerations together; what it drove and is no input would have nothing to drive it.
    missing = [place.name for place in _places(system) if _is_driven(system, place) and place not in chosen]
    if system.law is not None and missing:
        raise ValueError(
            "Argument `inputs` must name all that the feedback law drives, because inputs take its place, but it lacks "
            f"{', '.join(missing)}."
        )
    return chosen


def with_inputs(system: System, places: Sequence[Place]) -> System:
    """Returns the system with θ and θ̇ of every input in its state, and every input 0.

    What a schedule, a law or a :class:`~jaxball.Motor` did is gone, but for the limits of motors; other forces on the
    joints stay.
    """
    motors = {place.name: motor_of(system, place) for place in places}
    limits = {name: motor.limit for name, motor in motors.items() if motor is not None}
    return _hold(_free_inputs(system, places), places, jnp.zeros(len(places)), limits)


def _free_inputs(system: System, places: Sequence[Place]) -> System:
    freed = {place.number for place in places if place.mechanism is None and place.angle is None}
    masses = [
        item.follow_law() if index in freed and item.schedule is not None else item
        for index, item in enumerate(system.point_masses)
    ]
    mechanisms = list(system.mechanisms)
    for place in places:
        if place.mechanism is not None and place.is_effort:
            mechanism = mechanisms[place.mechanism]
            mechanisms[place.mechanism] = _drive_joint(
                mechanism, place.number, drive_without_motors(mechanism.drives[place.number])
            )
    accelerations = sum(not place.is_effort for place in places)
    law = GivenAccelerations(jnp.zeros(accelerations)) if accelerations else None
    tilted = {place.angle: Accelerated() for place in places if place.angle is not None}
    parts = {"masses": masses, "mechanisms": mechanisms, "law": law, "ground": _with_angles(system.ground, tilted)}
    return type(system)(**{**system.arguments, **parts})


def _with_angles(ground: AbstractGround | None, angles: Mapping[str, Accelerated]) -> AbstractGround | None:
    """Returns the same ground with other drives of its angles."""
    if not angles:
        return ground
    assert isinstance(ground, TiltingPlane)
    return replace(ground, **angles)


def hold_inputs(system: System, places: Sequence[Place], u: Float[Array, " m"]) -> System:
    """Holds the inputs of a system that :func:`with_inputs` made, which no motor limits any more; traceable."""
    # A closed loop clips its inputs at the limits already, so that motors need not.
    return _hold(system, places, u, {})


def _hold(system: System, places: Sequence[Place], u: Float[Array, " m"], limits: Mapping[str, Array | None]) -> System:
    values = {place.name: u[k] for k, place in enumerate(places)}
    names = [system.coordinates[slot] for slot in system.accelerated]
    law = GivenAccelerations(jnp.stack([values[name] for name in names])) if names else None
    return _drive_motors(system, places, values, limits, law)


def _drive_motors(
    system: System,
    places: Sequence[Place],
    signals: Mapping[str, Any],
    limits: Mapping[str, Array | None],
    law: AbstractLaw | None,
) -> System:
    """Gives the system motors that follow ``signals`` within ``limits``, by the names of inputs, and another law."""
    mechanisms = list(system.mechanisms)
    for place in places:
        if place.mechanism is not None and place.is_effort:
            mechanism, motor = mechanisms[place.mechanism], Motor(signals[place.name], limits.get(place.name))
            passive_drive = drive_without_motors(mechanism.drives[place.number])
            mechanisms[place.mechanism] = _drive_joint(
                mechanism, place.number, motor if passive_drive is None else passive_drive + motor
            )
    return type(system)(**{**system.arguments, "mechanisms": mechanisms, "law": law})


def replay_inputs(
    system: System,
    places: Sequence[Place],
    limits: Float[Array, " m"],
    times: Float[Array, " samples_and_end"],
    u: Float[Array, "samples m"],
) -> System:
    """Makes the inputs follow ``u``, each row from one of ``times`` to the next, by motors with ``limits``."""
    values = {place.name: u[:, k] for k, place in enumerate(places)}
    zero, names = jnp.zeros_like(times[0]), [system.coordinates[slot] for slot in system.accelerated]
    # Only θ̈ is taken from these schedules, by the law; θ and θ̇ are in the state, and those at the start do not
    # matter.
    schedules = [PiecewiseAcceleration(zero, times, values[name][:, None], zero) for name in names]
    law = FollowSchedules(tuple(schedules)) if schedules else None
    signals = {name: PiecewiseSignal(times, row) for name, row in values.items()}
    # An infinite limit is none. A traced one may be finite, and is always passed on.
    limited = {place.name: limits[k] for k, place in enumerate(places) if is_traced(limits) or np.isfinite(limits[k])}
    return _drive_motors(system, places, signals, limited, law)


def limits_of(system: System, places: Sequence[Place]) -> Float[Array, " m"]:
    """Returns the limits of the motors of inputs, infinite where there are none."""
    motors = [motor_of(system, place) for place in places]
    infinite = jnp.full((), jnp.inf, default_dtype())
    return jnp.stack([infinite if motor is None or motor.limit is None else motor.limit for motor in motors])


def motor_of(system: System, place: Place) -> Motor | None:
    """Returns the motor of an input, if it has one.

    **Raises:** ``ValueError`` for a joint with several.
    """
    if place.mechanism is None:
        return None
    drive = system.mechanisms[place.mechanism].drives[place.number]
    motors = [term for term in _terms(drive) if isinstance(term, Motor)]
    if len(motors) > 1:
        raise ValueError(
            f"Argument `run` must have one Motor on a joint that is an input, but {place.name} has {len(motors)}; "
            "combine them into one."
        )
    return motors[0] if motors else None


def drive_without_motors(drive: Drive) -> AbstractJointForce | None:
    """Returns what remains of the drive of a joint whose effort becomes an input: forces other than motors."""
    terms = [term for term in _terms(drive) if not isinstance(term, Motor)]
    if not terms:
        return None
    return terms[0] if len(terms) == 1 else JointForces(tuple(terms))


def _terms(drive: Drive) -> tuple[AbstractJointForce, ...]:
    if isinstance(drive, JointForces):
        return drive.terms
    return (drive,) if isinstance(drive, AbstractJointForce) else ()


def _places(system: System) -> list[Place]:
    """Lists all possible inputs: masses first, then joints."""
    masses = [Place(None, index, False) for index in system.on_rails]
    joints = [
        Place(i, a, not isinstance(drive, Accelerated))
        for i, mechanism in enumerate(system.mechanisms)
        for a, drive in enumerate(mechanism.drives)
    ]
    plate = system.ground if isinstance(system.ground, TiltingPlane) else None
    angles = [] if plate is None else [name for name in ANGLES if getattr(plate, name) is not None]
    return [*masses, *joints, *(Place(None, k, False, name) for k, name in enumerate(angles))]


def _is_moved(system: System, place: Place) -> bool:
    """Returns whether a schedule, a law or a motor moves an input."""
    if place.mechanism is None or not place.is_effort:
        return True
    drive = system.mechanisms[place.mechanism].drives[place.number]
    return isinstance(drive, AbstractSchedule) or motor_of(system, place) is not None


def _is_driven(system: System, place: Place) -> bool:
    """Returns whether the feedback law drives an input."""
    return place.name in [system.coordinates[slot] for slot in system.accelerated]


def _drive_joint(mechanism: AbstractMechanism, joint: int, drive: Drive) -> AbstractMechanism:
    drives = list(mechanism.drives)
    drives[joint] = drive
    return mechanism.with_drives(drives)
