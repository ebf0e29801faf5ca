"""A state and small deviations from it, advanced together: what chaos and stability are computed from."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, cast, runtime_checkable

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from ..physics.packing import Packing
from ..physics.rolling import AbstractRollingSystem
from ..physics.system import AbstractSystem
from ..programs.batches import fill_vectors
from .loop import by_tolerances, kinks_of, to_kinks
from .simulate import status_of
from .solvers.wrapping import AbstractWrappingController, AbstractWrappingSolver

Field = Callable[[Float[Array, ""], Float[Array, " size"], Any], Float[Array, " size"]]
Normal = Callable[[Float[Array, " size"]], Float[Array, " size"]]
Monitor = Callable[[Float[Array, ""], Float[Array, " size"], Any], Float[Array, ""]]
FIRST_STEP_SHARE = 1 / 64  # of the time to advance by; the step-size control corrects it within two or three steps


def tangent_field(field: Field) -> Callable[..., Float[Array, "rows size"]]:
    """Returns the function for the rates of x and of deviations δx from it: ẋ = f(t, x), δẋ = f′(t, x) δx.

    Row 0 of the matrix that it advances is x, and each of the others is a deviation. The products f′ δx come
    from forward-mode derivatives, and f′ is never formed.
    """

    def rates(t, rows, args):
        rate, tangent = jax.linearize(lambda x: field(t, x, args), rows[0])
        return jnp.concatenate([rate[None], fill_vectors(tangent, rows[1:])])

    return rates


def largest_row(rows: Float[Array, "rows size"]) -> Float[Array, ""]:
    """Computes the root mean square of the worst row: x and each deviation are kept to the tolerances, not
    their mean.
    """
    return jnp.sqrt(jnp.max(jnp.mean(rows**2, axis=1)))


def orthonormalise(vectors: Float[Array, "k size"]) -> tuple[Float[Array, "k size"], Float[Array, " k"]]:
    """Computes orthonormal rows that span the same subspaces, and the length of each row orthogonal to those before it.

    Modified Gram–Schmidt. For a few vectors it takes a tenth of the time of a library's QR factorisation, and the loss
    of orthogonality, the condition number times the rounding error, is negligible after a short interval.
    """
    rest, rows, lengths = vectors, [], []
    for _ in range(vectors.shape[0]):
        lengths.append(jnp.sqrt(jnp.sum(rest[0] ** 2)))
        rows.append(rest[0] / lengths[-1])
        rest = rest[1:] - jnp.sum(rest[1:] * rows[-1][None], axis=1)[:, None] * rows[-1][None]
    return jnp.stack(rows), jnp.stack(lengths)


def without_normal(
    vectors: Float[Array, "k size"], x: Float[Array, " size"], normal: Normal | None
) -> Float[Array, "k size"]:
    """Returns ``vectors`` without their components along the normal at ``x``."""
    if normal is None:
        return vectors
    n = normal(x)
    return vectors - (jnp.sum(vectors * n[None], axis=1) / jnp.sum(n**2))[:, None] * n[None]


def admissible(
    vectors: Float[Array, "k size"],
    t: Float[Array, ""],
    x: Float[Array, " size"],
    normal: Normal | None,
    flow: Any,
) -> Float[Array, "k size"]:
    """Returns ``vectors`` without their components along the normal, and along the gradients of constraints."""
    vectors = without_normal(vectors, x, normal)
    if flow.constraints is None:
        return vectors
    residuals = flow.constraints
    gradients = orthonormalise(jax.jacfwd(lambda x: residuals(t, x, flow.args))(x))[0]
    shares = jnp.sum(vectors[:, None, :] * gradients[None], axis=2)
    return vectors - jnp.sum(shares[:, :, None] * gradients[None], axis=1)


def generic_vectors(count: int, size: int) -> np.ndarray:
    """Returns fixed vectors that do not lie in a subspace which a symmetry of a flow could single out."""
    return np.random.default_rng(0).normal(size=(count, size))


@runtime_checkable
class Constrained(Protocol):
    """A system with constraints: the ``residuals`` that these keep at 0 along every motion, and how many there are."""

    @property
    def count_of_residuals(self) -> int: ...

    def residuals(self, t: Float[Array, ""], state: Any) -> Float[Array, " residuals"]: ...


def count_of_constraints(system: AbstractSystem) -> int:
    """Counts the numbers that constraints keep at 0 along every motion of a system."""
    return system.count_of_residuals if isinstance(system, Constrained) else 0


class Steps(NamedTuple):
    """How steps are made, and at most how many."""

    solver: diffrax.AbstractAdaptiveSolver
    rtol: Float[Array, ""]
    atol: Float[Array, ""]
    max_steps: int


class Advanced(NamedTuple):
    """The rows at the end, or where the solve failed, and how it ended.

    - ``reached``: the time of the rows.
    - ``steps``, ``accepted``: all steps, and those among them that were not repeated.
    - ``least``: the monitor's least value at the ends of steps, not at the start; infinite without a monitor.
    """

    rows: Float[Array, "rows size"]
    status: Int[Array, ""]
    reached: Float[Array, ""]
    steps: Int[Array, ""]
    accepted: Int[Array, ""]
    least: Float[Array, ""]


class Flow(NamedTuple):
    """ẋ = field(t, x, args), and what its steps have to regard.

    - ``kinks``: times at which the field jumps or has a kink.
    - ``monitor``: a function of (t, x, args) whose least value is wanted; of a rolling body, the normal force.
    - ``constraints``: a function of (t, x, args) to what stays 0, of an own system with constraints; None without.
    """

    field: Field
    args: Any
    kinks: Float[Array, " kinks"]
    monitor: Monitor | None = None
    constraints: Field | None = None

    @classmethod
    def of(cls, system: AbstractSystem, packing: Packing) -> "Flow":
        """Returns the flow of the packed states of ``system``."""
        parameters, unpack = ravel_pytree(packing)

        def field(t, x, parameters):
            return unpack(parameters).field(t, x)

        def normal_force(t, x, parameters):
            inner = unpack(parameters)
            return inner.system.plane_reaction(t, inner.unpack(t, x)).normal

        def residuals(t, x, parameters):
            inner = unpack(parameters)
            return inner.system.residuals(t, inner.unpack(t, x))

        rolls, is_constrained = isinstance(system, AbstractRollingSystem), count_of_constraints(system) > 0
        monitor, constraints = normal_force if rolls else None, residuals if is_constrained else None
        return cls(field, parameters, kinks_of(system), monitor, constraints)

    def monitor_value(self, t: Float[Array, ""], x: Float[Array, " size"]) -> Float[Array, ""]:
        """Returns the monitor's value; infinite without one."""
        return jnp.full_like(t, jnp.inf) if self.monitor is None else self.monitor(t, x, self.args)

    def advance(
        self,
        steps: Steps,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        rows: Float[Array, "rows size"],
        first_step: Float[Array, ""],
        alive: Bool[Array, ""],
    ) -> Advanced:
        """Advances x, the first of ``rows``, and the deviations δx from it, the others, from ``t0`` to ``t1``.

        δẋ = f′(t, x) δx is advanced with x under one control of the step. Where not ``alive``, nothing moves.
        """
        rates_of = tangent_field(self.field)

        @jax.jit
        def moving(t, rows, args):
            alive, inner = args
            # Rates of 0 let the steps of a row that has ended grow, so that rows that are computed together do not wait
            # for it.
            return jnp.where(alive, rates_of(t, rows, inner), 0.0)

        controller = to_kinks(by_tolerances(steps.rtol, steps.atol, steps.solver, largest_row), self.kinks)
        solver, monitor = steps.solver, self.monitor
        if monitor is not None:
            solver = Monitored(solver, lambda t, x, args: monitor(t, x, args[1]))
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(moving),
            solver,
            t0,
            t1,
            None,
            rows,
            (alive, self.args),
            saveat=diffrax.SaveAt(t1=True, solver_state=monitor is not None),
            stepsize_controller=StartWith(controller, jnp.minimum(first_step, t1 - t0)),
            adjoint=diffrax.ForwardMode(),
            max_steps=steps.max_steps,
            throw=False,
        )
        return Advanced(
            rows=cast(Array, solution.ys)[0],
            status=status_of(solution.result),
            reached=cast(Array, solution.ts)[0],
            steps=solution.stats["num_steps"],
            accepted=solution.stats["num_accepted_steps"],
            least=jnp.full_like(t0, jnp.inf) if monitor is None else cast(tuple, solution.solver_state)[1],
        )

    def orthonormalise(self, vectors: Float[Array, "k size"]) -> tuple[Float[Array, "k size"], Float[Array, " k"]]:
        """Computes orthonormal rows, and their lengths before, as :func:`orthonormalise` does."""
        return orthonormalise(vectors)


class StartWith(AbstractWrappingController):
    """``controller``, with a first step of the length ``first_step``.

    diffrax checks a first step that it is given itself, by a callback to Python, which no native program of rows holds.
    """

    controller: diffrax.AbstractAdaptiveStepSizeController  # pyright: ignore[reportIncompatibleVariableOverride]
    first_step: Float[Array, ""]

    def __init__(self, controller: diffrax.AbstractAdaptiveStepSizeController, first_step: Float[Array, ""]):
        self.controller, self.first_step = controller, first_step

    def init(self, terms, t0: Any, t1: Any, y0, dt0, args, func, error_order):
        return self.controller.init(terms, t0, t1, y0, self.first_step, args, func, error_order)


class Monitored(AbstractWrappingSolver):
    """``solver``, with the least value of ``of(t, x, args)`` at the ends of its steps, not at the start, in its state.

    It takes the same few operations in every step, which suits many solves side by side. It misses at most (step)² / 8
    times the second derivative between two ends.
    """

    solver: diffrax.AbstractSolver  # pyright: ignore[reportIncompatibleVariableOverride]
    of: Monitor

    def init(self, terms, t0, t1, y0, args):
        return self.solver.init(terms, t0, t1, y0, args), jnp.full((), jnp.inf, y0.dtype)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        inner, least = solver_state
        y1, y_error, dense, inner, result = self.solver.step(terms, t0, t1, y0, args, inner, made_jump)
        least = jnp.minimum(least, self.of(jnp.asarray(t1), y1[0], args))
        return y1, y_error, dense, (inner, least), result
