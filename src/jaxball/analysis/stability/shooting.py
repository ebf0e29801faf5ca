"""Newton's method for periodic motions, with the derivative of the return map."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from ... import programs
from ...interface.status import Status
from ...numerics.linear import least_squares, product
from ...physics.contact.released import ReleasedState
from ...physics.grounds.ground import Ground
from ...physics.packing import Packing
from ...physics.state import AbstractBodyState, BallState, DiskState
from ...physics.system import AbstractSystem, vector_field
from ...physics.validity import possible_start
from ...simulation.arguments import DEFAULT_SOLVER
from ...simulation.deviations import FIRST_STEP_SHARE, Flow, Steps
from ...simulation.deviations_with_modes import FlowWithModes, normal_of, projected

TURN = 2 * np.pi
CLOSED_RESIDUAL = 100.0  # the residual, in units of the tolerance, up to which a motion counts as closed
# The least weight of the step against the residual; families of motions have no derivative along them.
LEAST_DAMPING = 1e-7
BOLDEST = 0.25  # the largest step of the period, as a share of it, and of the state, as a share of its size


class Search(NamedTuple):
    """The settings of the search for a motion.

    - ``forced``: whether the equations depend on time, so that the period is given.
    - ``angles``: which components of the state are angles, whose whole turns change nothing.
    - ``iterations``: the most Newton steps.
    - ``max_steps``: the most steps of a solve over one period.
    - ``t``, ``rtol``, ``atol``: the time at the start, and the tolerances of the solves.
    """

    forced: bool
    angles: tuple[bool, ...]
    iterations: int
    max_steps: int
    t: Float[Array, ""]
    rtol: Float[Array, ""]
    atol: Float[Array, ""]


class Return(NamedTuple):
    """The result of a solve over one period.

    - ``turns``: the whole turns that each component gains; zero except for angles.
    - ``gain``: what each gains in addition; zero for those that need not return.
    - ``arrived``: the vector after the period, of a system with modes; else None.
    - ``monodromy``: the derivative of the state after the period with respect to that at the start.
    - ``before``, ``after``: the state's rates of change at the start and at the end.
    - ``status``, ``reached``: how the solve ended.
    - ``least_normal_force``: over the period; infinite for a system that does not roll.
    """

    turns: Float[Array, " size"]
    gain: Float[Array, " size"]
    arrived: Float[Array, " size"] | None
    monodromy: Float[Array, "size size"]
    before: Float[Array, " size"]
    after: Float[Array, " size"]
    status: Int[Array, ""]
    reached: Float[Array, ""]
    least_normal_force: Float[Array, ""]

    @property
    def residual(self) -> Float[Array, ""]:
        return jnp.max(jnp.abs(self.gain))


class Shot(NamedTuple):
    """The result of Newton's method: state, period, what the motion gains, and the number of steps.

    ``closed`` says whether it returns to within 100 times the tolerance.
    """

    state: Any
    period: Float[Array, ""]
    returned: Return
    iterations: Int[Array, ""]
    closed: Bool[Array, ""]


def shoot(
    search: Search,
    system: AbstractSystem,
    state: Any,
    period: Float[Array, ""],
    turns: Float[Array, " size"] | None,
) -> Shot:
    """Finds the motion near ``state`` that returns after about ``period``; traceable.

    ``turns`` are the whole turns that components gain; by default the nearest to the result of the first solve.
    """
    x, unravel = ravel_pytree(state)
    # The normal of the sphere |Γ| = 1, off which the equations mean nothing.
    normal = normal_of(state)
    # Nothing can be solved from NaN, or over no time.
    possible = jnp.all(jnp.isfinite(x)) & (period > 0)
    if not system.is_hybrid:  # a run says itself whether it can start
        possible &= possible_start(system, system.prepare(), jnp.stack([search.t, search.t + period]), state)
    nothing = jnp.zeros_like(x)

    def limit(x):
        return search.atol + search.rtol * jnp.max(jnp.abs(x))

    def going(carry):
        x, _, returned, count = carry
        # The first pass only follows the guess for a period, by a step of 0.
        away = (count == 0) | (returned.residual > limit(x))
        return away & (count <= search.iterations) & (returned.status == Status.SUCCESS)

    def body(carry):
        x, period, returned, count = carry
        # Steps are orthogonal to the sphere's normal, off which a state has no meaning, and to the motion itself, of
        # which any point would do.
        held = jnp.stack([nothing if normal is None else normal(x), nothing if search.forced else returned.before])
        change, longer = _newton(returned, held, search.forced)
        # The linearisation holds near the motion only: longer steps are cut to a share of the state and of the
        # period.
        bold = jnp.max(jnp.abs(change)) / (BOLDEST * (1 + jnp.max(jnp.abs(x))))
        share = 1 / jnp.maximum(jnp.maximum(bold, jnp.abs(longer) / (BOLDEST * period)), 1.0)
        state, period = projected(unravel(x + share * change)), period + share * longer
        # Turns are counted once and kept: counted again, they would make the residual jump while Newton's method
        # converges.
        has_turns = (count > 0) | (turns is not None)
        return (
            ravel_pytree(state)[0],
            period,
            _follow_period(search, system, state, period, returned.turns, has_turns),
            count + 1,
        )

    start = jnp.where(possible, Status.SUCCESS, Status.IMPOSSIBLE)
    # Nothing is known at first, so the first step is zero.
    first = Return(
        turns=nothing if turns is None else turns,
        gain=nothing,
        arrived=nothing if system.is_hybrid else None,
        monodromy=jnp.zeros((x.size, x.size), x.dtype),
        before=nothing,
        after=nothing,
        status=start,
        reached=search.t,
        least_normal_force=jnp.full_like(period, jnp.inf),
    )
    x, period, returned, count = jax.lax.while_loop(going, body, (x, period, first, jnp.zeros_like(start)))
    closed = (returned.status == Status.SUCCESS) & (returned.residual <= CLOSED_RESIDUAL * limit(x))
    if returned.arrived is not None:
        # What a mode holds is exactly 0 after a run, and rounding after a step of Newton's method.
        x = jnp.where(closed & jnp.asarray(returning(system, state)), returned.arrived - TURN * returned.turns, x)
    # The first pass is no step of Newton's method.
    return Shot(unravel(x), period, returned, count - 1, closed)


def _newton(
    returned: Return, held: Float[Array, "held size"], forced: bool
) -> tuple[Float[Array, " size"], Float[Array, ""]]:
    """Computes the changes of the state and of the period.

    With M the derivative of the return P(x), they are to solve (M − 1) δx + ẋ δT = x − P(x), with δx orthogonal to the
    rows that are ``held``. Where the motion belongs to a family, or the system has an integral, this is singular at the
    motion, and nearly so close to it. So the step is that of Levenberg and Marquardt, damped by the residual, which
    converges as fast as Newton's to motions that are not isolated (Yamashita and Fukushima 2001).
    """
    count, size = held.shape
    square = jnp.concatenate([returned.monodromy - jnp.eye(size, dtype=held.dtype), held])
    nothing = jnp.zeros((count,), held.dtype)
    column = jnp.concatenate([jnp.zeros_like(returned.after) if forced else returned.after, nothing])
    damping = jnp.maximum(returned.residual, LEAST_DAMPING) * jnp.eye(size + 1, dtype=held.dtype)
    matrix = jnp.concatenate([jnp.concatenate([square, column[:, None]], axis=1), damping])
    right_side = jnp.concatenate([-returned.gain, nothing, jnp.zeros((size + 1,), held.dtype)])
    change = least_squares(matrix, right_side)
    return change[:-1], change[-1]


class _Covered(NamedTuple):
    """A period of the motion from a state; all as in :class:`Return`, but with whole turns, and for all components.

    ``before`` is None with modes: a start may be one that no mode keeps, such as one with a slip that ends at once.
    """

    arrived: Float[Array, " size"]
    monodromy: Float[Array, "size size"]
    before: Float[Array, " size"] | None
    after: Float[Array, " size"]
    status: Int[Array, ""]
    reached: Float[Array, ""]
    least_normal_force: Float[Array, ""]


def _cover_along_field(search: Search, system: AbstractSystem, state: Any, period: Float[Array, ""]) -> _Covered:
    """Covers a period of a smooth system, with the variational equations."""
    prepared, (x, unravel) = system.prepare(), ravel_pytree(state)
    packing, end = Packing.of(prepared, state), search.t + period

    def pack(x):
        return packing.pack(search.t, unravel(x))

    def unpack(y):
        return ravel_pytree(packing.unpack(end, y))[0]

    y, into = pack(x), jax.jacfwd(pack)(x)
    flow, steps = Flow.of(system, packing), Steps(DEFAULT_SOLVER, search.rtol, search.atol, search.max_steps)
    from_rows, possible = jnp.concatenate([y[None], into.T]), jnp.asarray(True)
    solution = flow.advance(steps, search.t, end, from_rows, FIRST_STEP_SHARE * period, possible)
    rows = solution.rows
    arrived, out = unpack(rows[0]), jax.jacfwd(unpack)(rows[0])
    return _Covered(
        arrived=arrived,
        monodromy=product(out, rows[1:].T),
        before=ravel_pytree(vector_field(prepared, search.t, state))[0],
        # At the end of the period, because dP/dT is the rate there.
        after=ravel_pytree(vector_field(prepared, end, unravel(arrived)))[0],
        status=solution.status,
        reached=solution.reached,
        least_normal_force=jnp.minimum(flow.monitor_value(search.t, y), solution.least),
    )


def _cover_by_run(search: Search, system: AbstractSystem, state: Any, period: Float[Array, ""]) -> _Covered:
    """Covers a period of a system with modes, by a run and its derivatives."""
    x, steps = ravel_pytree(state)[0], Steps(DEFAULT_SOLVER, search.rtol, search.atol, search.max_steps)
    rows, flow = jnp.concatenate([x[None], jnp.eye(x.size, dtype=x.dtype)]), FlowWithModes.of(system, state)
    columns, run = flow.run_with_deviations(steps, search.t, search.t + period, rows)
    return _Covered(run.x, columns.T, None, run.rate, run.status, run.reached, run.least)


def _follow_period(
    search: Search, system: AbstractSystem, state: Any, period: Float[Array, ""], turns, has_turns
) -> Return:
    """Follows the motion from ``state`` over a period; whole turns are counted unless they are ``has_turns``."""
    cover, x = _cover_by_run if system.is_hybrid else _cover_along_field, ravel_pytree(state)[0]
    arrived, monodromy, before, after, status, reached, least = cover(search, system, state, period)

    # q and −q are the same orientation.
    spinor = jnp.asarray(_mark_components(state, ".q"))
    sign = jnp.where(spinor & (jnp.sum(jnp.where(spinor, x * arrived, 0.0)) < 0), -1.0, 1.0)
    arrived, after, monodromy = sign * arrived, sign * after, sign[:, None] * monodromy
    counted = jnp.where(jnp.asarray(search.angles), jnp.round((arrived - x) / TURN), 0.0)
    turns = jnp.where(has_turns, turns, counted)

    back = jnp.asarray(returning(system, state))
    return Return(
        turns=turns,
        gain=jnp.where(back, arrived - x - TURN * turns, 0.0),
        arrived=arrived if system.is_hybrid else None,
        # Components that need not return have rows of M − 1 that are 0, and set no condition.
        monodromy=jnp.where(back[:, None], monodromy, jnp.eye(x.size, dtype=x.dtype)),
        before=after if before is None else before,
        after=jnp.where(back, after, 0.0),
        status=status,
        reached=reached,
        least_normal_force=least,
    )


def returning(system: AbstractSystem, state: Any) -> Bool[np.ndarray, " size"]:
    """Returns which components of ``state`` must return: all except the position, where nothing depends on it."""
    ground = getattr(system.shown, "ground", None)
    placed = isinstance(_body_of(state), BallState | DiskState) and (
        ground is None or (isinstance(ground, Ground) and ground.turntable is None)
    )
    return ~_mark_components(state, ".z") if placed else _mark_components(state)


def countable(state: Any) -> Bool[np.ndarray, " size"]:
    """Returns which components of ``state`` may be angles that gain whole turns: φ of a disk, and the coordinates θ."""
    is_body = isinstance(_body_of(state), AbstractBodyState)
    return _mark_components(state, ".phi", ".theta") if is_body else ~_mark_components(state)


def _body_of(state: Any) -> Any:
    """Returns the state of the body, where one is released; any other state as it is."""
    return state.body if isinstance(state, ReleasedState) else state


def _mark_components(state: Any, *names: str) -> Bool[np.ndarray, " size"]:
    """Marks the components that belong to the fields of these names, or to any where none is given."""
    leaves = [
        (jax.tree_util.keystr(path).removeprefix(".body"), np.size(leaf))
        for path, leaf in jax.tree_util.tree_leaves_with_path(state)
    ]
    return np.concatenate([np.full(size, not names or name in names) for name, size in leaves])


@programs.filter_jit
def rates_at(
    system: AbstractSystem, state: Any, times: Float[Array, " n"], states: Float[Array, "m size"]
) -> Float[Array, "n m numbers"]:
    """Computes the rates of ``states``, packed as ``state`` is, at ``times``; with modes, all that tells when they end,
    too.
    """
    prepared, unravel = system.prepare(), ravel_pytree(state)[1]

    def rate(t, x):
        return ravel_pytree(vector_field(prepared, t, unravel(x)))[0]

    numbers = FlowWithModes.of(system, state).signs if system.is_hybrid else rate
    return jax.vmap(lambda t: jax.vmap(lambda x: numbers(t, x))(states))(times)
