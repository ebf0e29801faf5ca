"""The contract of a mechanical system: what an implementer supplies, and what jaxball does with it.

A system is an :class:`AbstractSystem` of parameters with an :class:`AbstractState` that a solve advances. Ball and disk
(``body``), the ``classical`` systems and users' systems fulfil the same contract. In return they get
:func:`jaxball.simulate` with status, events, dense output and derivatives, ensembles, Lyapunov exponents, Poincaré
maps, checks of laws, data sets and figures, and clear messages about what is impossible.
"""

import abc
import functools
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from ..interface.arguments import a, describe, refusal, require_one
from ..interface.printing import Printed, is_array
from ..interface.status import Status
from ..numerics.arrays import AnyArray, Numbers, default_dtype, to_array
from ..numerics.kinks import kinks_seen
from ..programs.derivatives.differentiation import differentiate_where
from .conditions import Condition, ExplainedCondition, Problem, on_numbers, unit
from .hybrid import (
    NO_HISTORY,
    NONE,
    START,
    AbstractHistory,
    Accuracy,
    Assessment,
    GuardedStep,
    History,
    Record,
    Switches,
    Transition,
    at_zero,
)

AnyState = TypeVar("AnyState", bound="AbstractState")
AnySystem = TypeVar("AnySystem", bound="AbstractSystem")


class AbstractState(Printed):
    """The state that a solve advances: the arrays of an Equinox module, each a field.

    If every field has a default, these make the state from which a run starts if none is given.

    - ``unit_vector``: the name of the field that is a unit vector, if there is one. It must be one at the start,
      ``project`` and ``dae`` of :func:`jaxball.simulate` keep it one, and it counts one dimension less.
    - ``sized``: the names of fields whose length depends on the system; its ``require_state`` checks them.
    - ``attitude``: the name of the field that is an attitude, if there is one. Around a state it has three coordinates,
      a rotation vector, which ``turn`` and ``turn_to`` add and take.

    States near one have **local coordinates** around it, as many as there are directions in which they can differ:
    ``directions`` names them, ``retract`` goes from them to a state, and ``difference`` back.
    """

    unit_vector: ClassVar[str | None] = None
    sized: ClassVar[tuple[str, ...]] = ()
    attitude: ClassVar[str | None] = None

    def conditions(self) -> Iterator[Condition]:
        """Yields every condition that an initial state must meet; traceable. A state that is not finite meets none."""
        if self.unit_vector is not None:
            yield unit(f"state.{self.unit_vector}", getattr(self, self.unit_vector))
        for path, leaf in jax.tree_util.tree_leaves_with_path(self):
            yield Condition(jnp.all(jnp.isfinite(leaf)), "state" + jax.tree_util.keystr(path), leaf, "finite")

    def projected(self: AnyState) -> AnyState:
        """Returns the nearest valid state: with a unit vector of length 1."""
        if self.unit_vector is None:
            return self
        name, vector = self.unit_vector, getattr(self, self.unit_vector)
        length = jnp.sqrt(jnp.sum(vector * vector, axis=-1, keepdims=True))
        return eqx.tree_at(lambda state: getattr(state, name), self, vector / length)

    def reduce(self) -> "AbstractState":
        """Returns the part of the state on which the motion depends if nothing breaks the symmetries."""
        return self

    @property
    def directions(self) -> tuple[str, ...]:
        """The local coordinates around a state, by name: those of the attitude, then the numbers of other fields."""
        names = [] if self.attitude is None else [f"attitude[{k}]" for k in range(3)]
        for path, leaf in jax.tree_util.tree_leaves_with_path(self._without_attitude()):
            field = jax.tree_util.keystr(path).removeprefix(".")
            names += [f"{field}[{k}]" for k in range(np.size(leaf))] if np.ndim(leaf) else [field]
        return tuple(names)

    def retract(self: AnyState, xi: Numbers) -> AnyState:
        """Returns the state with local coordinates ``xi`` around this one, shape (directions,).

        The attitude is turned by the first three, a rotation vector in body axes; the rest are added.

        **Raises:** ``TypeError`` for a state with a unit vector that is no attitude.
        """
        xi, name = to_array(xi, "xi"), self.attitude
        flat, unravel = ravel_pytree(self._without_attitude())
        if name is None:
            return unravel(flat + xi)
        moved = unravel(flat + xi[3:])
        return eqx.tree_at(lambda s: getattr(s, name), moved, self.turn(xi[:3]), is_leaf=lambda x: x is None)

    def difference(self, other: Any) -> Float[Array, " directions"]:
        """Returns the local coordinates of ``other`` around this state: the inverse of :meth:`retract`.

        **Raises:** as :meth:`retract`.
        """
        flat, there = (ravel_pytree(state._without_attitude())[0] for state in (self, other))
        return there - flat if self.attitude is None else jnp.concatenate([self.turn_to(other), there - flat])

    def turn(self, rotation: Float[Array, "3"]) -> Float[Array, "..."]:
        """Returns the attitude, turned by a rotation vector in body axes."""
        raise NotImplementedError

    def turn_to(self, other: Any) -> Float[Array, "3"]:
        """Returns the rotation vector, in body axes, from this attitude to that of ``other``; no longer than π."""
        raise NotImplementedError

    def _without_attitude(self: AnyState) -> AnyState:
        name = self.attitude
        if name is not None:
            return eqx.tree_at(lambda state: getattr(state, name), self, None)
        if self.unit_vector is None:
            return self
        raise TypeError(
            f"Argument `state` must have an attitude where local coordinates around it are needed, but it is "
            f"{a(type(self).__name__)}, whose `{self.unit_vector}` is a unit vector; use a state with an attitude, "
            "such as a BallState."
        )


class NoLaws(NamedTuple):
    """The laws of a system that states none."""


class AbstractSystem(Printed, Generic[AnyState]):
    """Parameters of a mechanical system, the arrays of an Equinox module, with its equations of motion.

    An implementer supplies

    - ``state_type``: the class of its states, and ``other_state_types`` where it takes more;
    - ``field(t, state)``: the equations of motion.

    Everything else has a default, to be overridden where it does not fit:

    - ``title``: what it is called in sentences;
    - ``conditions``, ``start_conditions``, ``run_conditions``: which parameters, initial states and times are possible,
      so that an impossible run has the status ``IMPOSSIBLE`` and a sentence that says why;
    - ``laws``, ``law_rates``: what is conserved along every motion, or changes at a known rate;
    - ``prepare``: work to be done once per solve;
    - ``driving_kinks``, ``motion_kinks``: the times to which a solve steps, because the field is not smooth there;
    - ``to_packed``, ``from_packed``, ``field_of_packed``: other coordinates for a solve to advance, such as a momentum
      instead of a velocity;
    - ``projected``, ``always_projected``: the nearest state on the constraints, to which ``project`` of
      :func:`jaxball.simulate` moves the end of each step, and whether that is always done;
    - ``guards``, ``reset``, ``time_event``: for a hybrid system, what ends a mode, and the state that follows;
    - ``phase_point``: which part of a state the motion depends on;
    - ``is_confined``, ``time_of_leaving``, ``clearance``, ``breaches``, ``leaving_status``: for one with an inside.

    Methods are traced: they are written with ``jax.numpy``, for one state without a batch, and without branches on
    numbers.
    """

    title: ClassVar[str] = "system"
    state_type: ClassVar[Any]
    other_state_types: ClassVar[tuple[Any, ...]] = ()
    max_switches: ClassVar[int] = 64  # how many switches of a run are kept; all are counted
    leaving_status: ClassVar[Status] = Status.LEFT_SHELL  # of a run whose `clearance` falls to 0; others end it there

    @abc.abstractmethod
    def field(self, t: Float[Array, ""], state: AnyState) -> AnyState:
        """Computes ẋ = f(t, x), in the form of a state."""

    def describe(self) -> str:
        """Describes the system, for a sentence after "a"."""
        return self.title

    # What is possible.

    def conditions(self) -> Iterator[Condition]:
        """Yields every condition that the parameters must meet; traceable."""
        yield from on_numbers(self, "")

    def start_conditions(self, t: Float[Array, ""], state: AnyState) -> Iterator[Condition | ExplainedCondition]:
        """Yields every condition that an initial state must meet in addition to its own; traceable."""
        yield from ()

    def run_conditions(self, times: Float[AnyArray, " T"]) -> Iterator[Condition | ExplainedCondition]:
        """Yields every condition on what is prescribed over the ``times`` of a run; traceable."""
        yield from ()

    def default_state(self) -> AnyState:
        """Returns the state from which a run starts if none is given: the defaults of ``state_type``.

        **Raises:** ``ValueError`` where a state must be given.
        """
        default = default_of(self.state_type, default_dtype())
        if default is None:
            kind = self.state_type.__name__
            raise ValueError(f"Argument `state` must be given, because {a(kind)} has fields without a default.")
        return default

    def require_state(self, state: AnyState) -> None:
        """Refuses a state whose type or shapes do not fit this system. A batch may be given.

        **Raises:** ``TypeError`` for another kind, ``ValueError`` for a state of a size that does not fit.
        """
        kinds = (self.state_type, *self.other_state_types)
        if not isinstance(state, kinds):
            *others, last = (kind.__name__ for kind in kinds)
            must = a(f"{', '.join(others)} or {last}" if others else last)
            raise TypeError(
                f"Argument `state` must be {must} for {a(type(self).__name__)}, but it is {describe(state)}."
            )

    def numbers(self) -> Iterator[tuple[str, Array]]:
        """Yields the parameters by name, for sentences."""
        for path, leaf in jax.tree_util.tree_leaves_with_path(self):
            if is_array(leaf):
                yield jax.tree_util.keystr(path).removeprefix("."), leaf

    # What a solve advances.

    def prepare(self: AnySystem) -> AnySystem:
        """Returns the same system, ready to be evaluated many times: called once per solve, not once per step."""
        return self

    def to_packed(self, t: Float[Array, ""], state: AnyState) -> AnyState:
        """Returns the state with some fields replaced by what a solve advances instead; ``self`` is prepared."""
        return state

    def from_packed(self, t: Float[Array, ""], packed: AnyState) -> AnyState:
        """Inverts ``to_packed``."""
        return packed

    def field_of_packed(self, t: Float[Array, ""], packed: AnyState) -> AnyState:
        """Computes the rate of a packed state.

        **Raises:** ``TypeError`` when ``field`` returns anything but a state of the same kind.
        """
        rates = self.field(t, packed)
        if type(rates) is not type(packed):
            kind = type(packed).__name__
            raise TypeError(
                f"Method `field` of {type(self).__name__} must return {a(kind)}, whose fields are the rates of those "
                f"of the state, but it returns {describe(rates)}."
            )
        return rates

    def projected(self, t: Float[Array, ""], packed: AnyState) -> AnyState:
        """Returns the nearest packed state on the constraints at ``t``: by default, on the state's own constraints."""
        return packed.projected()

    @property
    def always_projected(self) -> bool:
        """Whether steps end on the constraints even where :func:`jaxball.simulate` is not asked to ``project``."""
        return False

    def motion_kinks(self) -> Float[Array, " kinks"]:
        """Returns the unsorted times of kinks at which the packed field is continuous. They need no derivatives."""
        return jnp.zeros((0,), dtype=default_dtype())

    def driving_kinks(self) -> Float[Array, " kinks"]:
        """Returns the unsorted times at which the field jumps or has a kink. A solve ends steps at them.

        By default, those at which the trace of ``field`` compares the time with something that depends on parameters
        alone, if there is a default state.
        """
        default = default_of(self.state_type, default_dtype())
        if default is None:
            return jnp.zeros((0,), dtype=default_dtype())
        return kinks_seen(self, type(self).field, default, method="driving_kinks")

    def kinks(self) -> Float[Array, " kinks"]:
        """Returns the unsorted times of all kinks."""
        return jnp.concatenate([self.motion_kinks(), self.driving_kinks()])

    # Modes that follow each other, of a hybrid system. Its state says in which mode it is, by an integer or a number
    # that only a reset changes, and by which `field` and `guards` choose.

    def guards(self, t: Float[Array, ""], state: AnyState) -> Float[Array, " k"]:
        """Returns functions that are positive while the mode lasts. Where one falls to zero, there is an event.

        They are smooth within a mode. A guard that does not apply in it is a positive constant. Where a state after a
        reset has a guard that is zero, that must grow.
        """
        return jnp.zeros((0,), dtype=default_dtype())

    def time_event(self, t: Float[Array, ""], state: AnyState) -> Float[Array, ""]:
        """Returns the time after ``t`` of an event that the state knows beforehand, such as the next tick of a clock.

        Infinite if there is none; a time that is not after ``t`` is none, either.
        """
        return jnp.full((), jnp.inf, dtype=default_dtype())

    def reset(self, t: Float[Array, ""], state: AnyState, which: Int[Array, ""]) -> AnyState:
        """Returns the state after an event, from the state before it.

        ``which`` is the index of the guard that fell to zero, the first one if several did, or the number of guards for
        a time event.
        """
        return state

    @property
    def is_hybrid(self) -> bool:
        """Whether it has modes that end: whether its class has guards or time events of its own."""
        kind = type(self)
        return kind.guards is not AbstractSystem.guards or kind.time_event is not AbstractSystem.time_event

    # The same in more detail. These are for systems whose events depend on how a solve takes its steps.

    def step_reference(self, t: Float[Array, ""], state: AnyState, accuracy: Accuracy) -> Any:
        """Returns what the guards within a step refer to, from the state at its start."""
        return ()

    def guards_in_step(self, t: Float[Array, ""], state: AnyState, reference: Any) -> Float[Array, " k"]:
        """Computes the guards within a step."""
        return self.guards(t, state)

    def guards_follow_motion(self, t: Float[Array, ""], packed: AnyState, reference: Any) -> bool:
        """Returns whether steps that follow the motion follow the guards, too, however long they are."""
        return False

    def kept_in_modes(self, packed: AnyState) -> tuple[Any, ...]:
        """Returns the last fields of a packed state that change at events alone, as far as that is known."""
        return ()

    def assess(self, step: GuardedStep, accuracy: Accuracy) -> Assessment:
        """Decides whether there is an event at the end of a step, and how long the next step may be."""
        timed = jnp.where(step.timed, step.guards.shape[0], NONE)
        return Assessment(jnp.where(step.has_fallen, step.zero, timed), jnp.full_like(step.end, jnp.inf))

    def transition(self, t: Float[Array, ""], state: AnyState, event: Int[Array, ""], accuracy: Accuracy) -> Transition:
        """Computes what happens at an event: the state is reset, or, at the ``START`` of a run, left as it is."""
        starts = event == START
        t, before, slope = at_zero(type(self).guards, self, t, state, event)
        system, t_of_reset, state_of_reset = differentiate_where(~starts, (self, t, before))
        after = system.reset(t_of_reset, state_of_reset, event)
        if jax.tree.structure(after) != jax.tree.structure(before):
            kind = type(self).__name__
            raise TypeError(
                f"Method `reset` of {kind} must return {a(type(state).__name__)}, the state after an event, but it "
                f"returns {describe(after)}."
            )
        after = jax.tree.map(lambda old, new: jnp.where(starts, old, jnp.asarray(new, old.dtype)), before, after)
        success, no = jnp.asarray(int(Status.SUCCESS)), jnp.asarray(False)
        return Transition(t, before, after, event, slope, ~starts, ~starts, no, success)

    # What a run shows.

    with_modes = property(lambda self: self, doc="The hybrid system that is solved in its place, where it has modes.")

    def start(self, t: Float[Array, ""], state: Any) -> AnyState:
        """Returns the state with which a solve starts, from the one that is given; ``self`` is not prepared."""
        return state

    @property
    def shown(self) -> "AbstractSystem":
        """The system of a trajectory, where it is a part of the system that is solved."""
        return self

    def state_to_show(self, state: AnyState) -> AbstractState:
        """Returns the part of a state, or of several, that a trajectory shows."""
        return state

    def history(self, times: Float[Array, " T"], states: AnyState, record: Record | None) -> AbstractHistory:
        """Returns the history of one run, from the states at its saved times and its switches; None without modes."""
        return NO_HISTORY if record is None else History(switches=Switches.of(record))

    # What is read off a state.

    def laws(self, t: Float[Array, ""], state: AnyState) -> Any:
        """Returns a named tuple of quantities that are conserved along every motion, or when its entries say so."""
        return NoLaws()

    def law_rates(self, t: Float[Array, ""], state: AnyState) -> Mapping[str, Float[Array, "..."]]:
        """Returns the rates of the ``laws`` that are balances, by name; the others are constant."""
        return {}

    def phase_point(self, state: AnyState) -> AbstractState:
        """Returns ``state`` as a point of the phase space: the part of it that the motion depends on."""
        return state.reduce()

    # Confinement, of a system that has an inside.

    def is_confined(self, times: Float[Array, " T"], state: AnyState) -> Bool[Array, ""]:
        """Returns whether everything is inside at the first of ``times``; ``self`` is prepared."""
        return jnp.asarray(True)

    def time_of_leaving(self, times: Float[Array, " T"], states: AnyState) -> Float[Array, ""] | None:
        """Finds when something first leaves; infinite if never, None without an inside. ``self`` is prepared.

        What ``clearance`` tells is left out.
        """
        return None

    def clearance(self, t: Float[Array, ""], state: AnyState) -> Float[Array, ""] | None:
        """Returns a number, positive while nothing leaves whose place only the state tells; None without such things.

        A solve watches it in every step. ``self`` is prepared.
        """
        return None

    def breaches(self, times: Any, state: AnyState | None, states: AnyState | None) -> Iterator[Problem]:
        """Yields a problem for everything that is not inside, in words, for numbers that are known.

        ``state`` is that at the first of ``times``, and ``states`` those at all of them, as far as they are given.
        """
        yield from ()


@functools.cache
def default_of(kind: type[AbstractState], dtype: Any) -> Any:
    """Returns the state of a kind that its defaults make, for ``dtype``; None where a field has none."""
    with jax.ensure_compile_time_eval():
        try:
            return kind()
        except TypeError:
            return None


def require_system(system: Any) -> None:
    """Raises a ``TypeError`` unless the argument ``system`` fulfils the contract."""
    if isinstance(system, AbstractSystem):
        if hasattr(type(system), "state_type"):
            return
        kind = type(system).__name__
        raise TypeError(
            f"Class {kind} must name the class of its states, as in `state_type = MyState`, but it does not."
        )
    inner = type(getattr(system, "system", None))
    remedy = f"its `system` is {a(inner.__name__)}" if issubclass(inner, AbstractSystem) else ""
    must = "a Ball, a Disk, one of jaxball.physics.classical or another AbstractSystem"
    raise refusal("system", must, system, remedy)


def require_state(system: Any, state: Any) -> None:
    """Refuses anything but a system, and a state that does not fit it.

    **Raises:** ``TypeError`` for other kinds, ``ValueError`` for a state of a size that does not fit.
    """
    require_system(system)
    # Not `system.require_state(state)`: what Equinox makes of a bound method costs some 50 microseconds.
    type(system).require_state(system, state)


def require_one_state(system: Any, state: Any) -> None:
    """Refuses anything but one state of the system, such as the states of a whole run.

    **Raises:** ``TypeError`` for other kinds, ``ValueError`` for a state of a size that does not fit and for a batch.
    """
    require_state(system, state)
    require_one("state", "state", state, shapes_of_state(type(state), default_dtype()))


@functools.cache
def shapes_of_state(kind: type[AbstractState], dtype: np.dtype) -> dict[str, tuple[int, ...]]:
    """Returns the shapes of the arrays of one state, where its kind has a default; (0,) of one that it may lack."""
    default = default_of(kind, dtype)
    values = {} if default is None else vars(default)
    has_shape = {name: value for name, value in values.items() if is_array(value) or name in kind.sized}
    return {name: np.shape(value) if is_array(value) else (0,) for name, value in has_shape.items()}


def vector_field(system: AbstractSystem, t: Float[Array, ""], state: AnyState) -> AnyState:
    """Computes ẋ = f(t, x) for the system and the kind of state given.

    **Arguments:**

    - ``system``: a body, a system of :mod:`jaxball.physics.classical`, or another :class:`~jaxball.AbstractSystem`.
    - ``t``: time. ``state``: of any kind that the system supports.

    **Raises:** ``TypeError`` when the system has no such state, ``ValueError`` for several states; use ``jax.vmap``.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Disk, DiskState
    >>> from jaxball.physics import vector_field
    >>> rates = vector_field(Disk(mass=1.0, inertia=0.5, radius=2.0), jnp.array(0.0), DiskState(phidot=-1.0))
    >>> float(rates.z)  # ż = −r φ̇
    2.0
    """
    require_one_state(system, state)
    return system.field(t, state)
