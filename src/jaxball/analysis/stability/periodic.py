"""Periodic motions of any system, their stability, and charts of it over two parameters."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Complex, Float

from ... import programs
from ...interface.arguments import require_callable, traceable
from ...interface.printing import Printed, format_value
from ...interface.status import Status
from ...numerics.arrays import Numbers, to_array, to_numpy
from ...physics.contact.law import Contact
from ...physics.contact.released import ReleasedState
from ...physics.packing import phase_point
from ...physics.system import AbstractState, AbstractSystem
from ...simulation.arguments import check_steps, check_tolerances
from ...simulation.deviations import generic_vectors
from ...simulation.deviations_with_modes import dimension, normal_of, point_of_run, rounding
from ...simulation.grid import grid_of
from .shooting import TURN, Search, Shot, countable, rates_at, returning, shoot
from .steady import kind_of

if TYPE_CHECKING:
    import xarray

PERIODIC_TOLERANCE = 1e-11
SAME_RATES = 1e-9  # up to which, relative to the largest, rates of change count as the same
# Irregular, so that no harmonic of the forcing has the same value at all of them.
SHARES = np.array([0.0, 0.137, 0.381, 0.733])  # of the period: times at which the equations are compared
BESIDE = 0.01  # the distance of a state at which the equations are compared as well
STANDING = 1e-8  # the change over a period at the initial rate, up to which a state counts as steady


class PeriodicMotion(Printed):
    """A motion that repeats after a period, and its linear stability.

    - ``state``: its initial point in the phase space; with a law of contact a :class:`~jaxball.physics.ReleasedState`.
    - ``period``: T.
    - ``turns``: the whole turns that angles gain in a period: φ of a disk, and each coordinate θ.
    - ``residual``: the largest difference between the state after a period, less whole turns, and that at the start.
    - ``ok``: whether that is zero up to the errors of the solve.
    - ``multipliers``: the eigenvalues of the derivative of the return, on the tangent of |Γ| = 1, the largest first.
      Where the equations do not depend on time, a shift along the motion has the multiplier 1, which is left out.
    - ``exponents``: log(multiplier) / T, in 1/time, in the same order; their imaginary parts are known up to 2π/T.
    - ``kind``: by the exponents, as for :class:`SteadyMotion`; "unknown" if no motion was found.
    - ``least_normal_force``: over the period; infinite for a system that does not roll, or may leave its ground.
    - ``iterations``: the number of Newton steps.
    - ``message``: a sentence that says all this.
    """

    state: AbstractState | ReleasedState
    period: float
    turns: tuple[int, ...]
    residual: float
    ok: bool
    multipliers: Complex[np.ndarray, " n"]
    exponents: Complex[np.ndarray, " n"]
    kind: str
    least_normal_force: float
    iterations: int
    message: str

    def __repr__(self) -> str:
        multipliers = ", ".join(f"{value:.6g}" for value in self.multipliers)
        turns = f" and turns {self.turns}" if any(self.turns) else ""
        return (
            f"Periodic motion of period {self.period:.8g}{turns} from {format_value(self.state)}\n"
            f"  {self.message}\n  multipliers {multipliers}"
        )

    @property
    def stable(self) -> bool:
        """Whether the motion is spectrally stable: no multiplier is larger than 1."""
        return self.kind in ("centre", "sink")

    @property
    def growth(self) -> float:
        """The largest real part of an exponent."""
        return float(self.exponents[0].real)


def periodic_motion(
    system: AbstractSystem,
    state: AbstractState | ReleasedState,
    period: Numbers,
    *,
    contact: Contact | None = None,
    turns: Numbers | None = None,
    t: Numbers = 0.0,
    rtol: Numbers = PERIODIC_TOLERANCE,
    atol: Numbers = PERIODIC_TOLERANCE,
    iterations: int = 20,
    max_steps: int = 4096,
) -> PeriodicMotion:
    """Finds the periodic motion near a state, and its Floquet multipliers.

    Newton's method finds the state that returns after a period, up to whole turns of angles; position and heading need
    not return where nothing depends on them. The derivative of the return map, the monodromy matrix, comes from the
    variational equations, solved along with the motion under the same step-size control. Its eigenvalues, the
    multipliers, are the factors by which deviations change in each period.

    Where the equations do not depend on time, the period is found as well. Where they do, as for masses with a schedule
    or on a shaken plane, the period is fixed, and must be one of the forcing.

    Of a system with modes, as with a law of contact, exact dry resistance, joints that stick, or contacts and dry
    friction of a :class:`~jaxball.physics.classical.LagrangianSystem`, the return map is a run, and its derivative that
    of the run, through all events (``simulation.deviations_with_modes``). What a mode holds has no deviations, and
    multipliers of 0. With a law of contact states are :class:`~jaxball.physics.ReleasedState`, also of a body that
    rolls, and a ball has to return with its heading. A period must not begin at an event, such as an impact.

    A family of motions, such as those of all speeds without resistance, has further multipliers of 1, as do integrals
    of motion; the member of the family nearest to the state is found.

    **Arguments:**

    - ``system``: a body, or a system of :mod:`jaxball.physics.classical`.
    - ``state``: near the motion, of any kind.
    - ``period``: T, or a value near it where the equations do not depend on time.
    - ``contact``: a :class:`~jaxball.Contact`, as for :func:`jaxball.simulate`.
    - ``turns``: the whole turns that angles gain in a period, as in :class:`PeriodicMotion`, shape (angles,); by
      default the nearest to what they gain from ``state``.
    - ``t``: the time of the start.
    - ``rtol``, ``atol``: tolerances of the solves, for the state and for deviations of size 1.
    - ``iterations``: the most Newton steps.
    - ``max_steps``: the most steps in the solve of a period.

    **Raises:** ``ValueError`` for a period that is not positive or not one of the forcing, and for ``turns`` without
    one entry for each angle, or for coordinates that are not angles; ``TypeError`` for a state of another kind of
    system, and :class:`~jaxball.simulation.PrecisionError` when float32 cannot reach the tolerances.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> from jaxball import Disk, DiskState
    >>> from jaxball.analysis.stability import periodic_motion
    >>> low = Disk(mass=1.0, inertia=0.36, offset=(0.0, 0.0, -0.2))
    >>> rolling = periodic_motion(low, DiskState(phidot=1.2), period=5.5)
    >>> rolling.turns, rolling.message
    ((1,), 'The motion is spectrally stable, a centre: its multipliers are all of size 1.')
    """
    rtol, atol = map(to_array, check_tolerances(rtol, atol))
    length, start = float(to_numpy(period, "period")), float(to_numpy(t, "t"))
    system, point = point_of_run(system, state, contact, to_array(start))
    if not (np.isfinite(length) and length > 0):
        raise ValueError(f"Argument `period` must be a positive time, but it is {length:g}.")
    forced, angles = equations_of(system, point, start, length)
    counts = None if turns is None else to_array(_counts(turns, point, angles))
    search = Search(forced, angles, check_steps(iterations), check_steps(max_steps), to_array(start), rtol, atol)
    shot = _shoot(search, system, point, to_array(length), counts)
    return _motion(jax.tree.map(np.asarray, shot), system, search, turns is not None)


_shoot = programs.filter_jit(shoot)


def equations_of(system: AbstractSystem, state: Any, t: float, period: float) -> tuple[bool, tuple[bool, ...]]:
    """Finds whether the equations depend on time, and which components of a state are angles.

    They are compared at the state and at one near it, because at a steady state the forcing may not show.

    **Raises:** ``ValueError`` where they depend on time, but not with this period.
    """
    x = np.asarray(ravel_pytree(state)[0])
    candidates = countable(state)
    # A steady state may be one at which neither the forcing nor an angle shows.
    beside = x + BESIDE * generic_vectors(1, x.size)
    turned = [beside + TURN * np.eye(x.size)[k] for k in np.flatnonzero(candidates)]
    # A period later again: a forcing with another period shows there.
    times = np.concatenate([t + period * SHARES, t + period * (1 + SHARES)])
    rates = np.asarray(rates_at(system, state, to_array(times), to_array(np.concatenate([x[None], beside, *turned]))))
    # Where nothing moves all rates are 0, and equal.
    same = SAME_RATES * max(float(np.max(np.abs(rates))), 1e-300)
    here, later = np.split(rates[:, :2], 2)
    forced = bool(np.max(np.abs(here - here[0])) > same)
    if forced and np.max(np.abs(later - here)) > same:
        raise ValueError(
            "Argument `period` must be one of the forcing where the equations depend on time, such as "
            f"2 pi over its angular frequency, but after {period:.10g} the rates of change differ."
        )
    angles = candidates.copy()
    angles[candidates] = [bool(np.max(np.abs(rates[:, 2 + k] - rates[:, 1])) <= same) for k in range(len(turned))]
    return forced, tuple(angles.tolist())


def _counts(turns: Numbers, state: Any, angles: tuple[bool, ...]) -> Float[np.ndarray, " size"]:
    """Returns ``turns`` of all components of a state."""
    chosen, candidates = to_numpy(turns, "turns"), countable(state)
    if chosen.shape != (np.sum(candidates),) or np.any(chosen != np.round(chosen)):
        raise ValueError(
            f"Argument `turns` must be {np.sum(candidates)} whole numbers, one for each angle of the state, but it is "
            f"{chosen.tolist()}."
        )
    counts = np.zeros(candidates.size)
    counts[candidates] = chosen
    wrong = np.flatnonzero(counts[candidates] * ~np.array(angles)[candidates])
    if wrong.size:
        raise ValueError(
            "Argument `turns` must be 0 for a coordinate whose whole turns change the equations, as with a spring, "
            f"but turns[{wrong[0]}] is {chosen[wrong[0]]:g}."
        )
    return counts


def multipliers_of(
    shot: Shot, system: AbstractSystem, forced: bool
) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, " n"]]:
    """Computes the multipliers of a closed motion, the largest first, and its exponents."""
    state, returned, period = shot.state, shot.returned, float(shot.period)
    x, back, normal = to_array(ravel_pytree(state)[0]), returning(system, state), normal_of(state)
    apart = [] if normal is None else [np.asarray(normal(x))[back]]
    # A deviation along the motion is a shift of time, which has the multiplier 1 unless the equations depend on time.
    # At a steady state there is no such direction.
    along = np.asarray(returned.before)[back]
    if not forced and np.max(np.abs(along)) * period > STANDING:
        apart.append(along / np.linalg.norm(along))
    # Deviations along the motion return unchanged, so the multipliers of the others are found separately.
    basis = np.linalg.svd(np.stack(apart))[2][len(apart) :] if apart else np.eye(int(np.sum(back)))
    matrix = np.asarray(returned.monodromy)[np.ix_(back, back)]
    multipliers = np.linalg.eigvals(basis @ matrix @ basis.T).astype(complex)
    if system.is_hybrid:  # what a mode holds has no deviations, whose multiplier is 0, and not rounding
        multipliers[np.abs(multipliers) <= rounding(matrix.dtype) * np.linalg.norm(matrix)] = 0.0
    # Rounded, so that the two of a complex pair compare as equal in size, and the sign of the imaginary part decides.
    order = np.lexsort((-np.imag(multipliers), -np.abs(multipliers).round(12)))
    multipliers = multipliers[order]
    # A multiplier of 0 decays at once: its exponent is −∞.
    with np.errstate(divide="ignore"):
        return multipliers, np.log(np.abs(multipliers)) / period + 1j * (np.angle(multipliers) / period)


def _motion(shot: Shot, system: AbstractSystem, search: Search, counted: bool) -> PeriodicMotion:
    returned, period, closed = shot.returned, float(shot.period), bool(shot.closed)
    if closed:
        multipliers, exponents = multipliers_of(shot, system, search.forced)
        # For the kind it is enough that these fall.
        finite = np.where(np.isfinite(exponents), exponents, -1 / period)
        # In units of the largest, but of a turn per period at least: where all exponents are nearly 0, rounding must
        # not decide.
        kind = kind_of(finite / max(float(np.max(np.abs(finite), initial=0.0)), TURN / period))
        message = _message(kind, multipliers, exponents)
        if not search.forced and np.max(np.abs(returned.before)) * period <= STANDING:
            message += " Its state does not change, so its period means nothing; see `steady_motion`."
        if returned.least_normal_force <= 0:
            message += f" The normal force falls to {float(returned.least_normal_force):.3g} on the way."
    else:
        unknown = np.full(dimension(shot.state), np.nan + 0j)
        multipliers, exponents, kind, message = unknown, unknown, "unknown", _failure(shot, search, counted)
    turns = tuple(int(turn) for turn in np.asarray(returned.turns)[countable(shot.state)])
    residual = float(np.max(np.abs(returned.gain)))
    force = float(returned.least_normal_force)
    state = jax.tree.map(to_array, shot.state)
    return PeriodicMotion(
        state, period, turns, residual, closed, multipliers, exponents, kind, force, int(shot.iterations), message
    )


def _message(kind: str, multipliers: np.ndarray, exponents: np.ndarray) -> str:
    if kind in ("centre", "sink"):
        sizes = "all of size 1" if kind == "centre" else "none larger than 1"
        return f"The motion is spectrally stable, a {kind}: its multipliers are {sizes}."
    largest, growth = multipliers[0], exponents[0].real
    how = "" if abs(largest.imag) > 1e-9 * abs(largest) or largest.real > 0 else ", changing sign each period"
    return f"The motion is unstable, a {kind}: deviations grow as exp({growth:.6g} t){how}."


def _failure(shot: Shot, search: Search, counted: bool) -> str:
    returned, period = shot.returned, float(shot.period)
    status, start = int(returned.status), float(search.t)
    if status != Status.SUCCESS:
        return Status(status).sentence(float(returned.reached), start + period, alone=True)
    missed = float(np.max(np.abs(returned.gain)))
    more = np.round(np.where(search.angles, returned.gain, 0.0) / TURN)[countable(shot.state)]
    turning = f" It gains {tuple(int(k) for k in more)} turns in addition to `turns`." if counted and any(more) else ""
    return (
        f"No periodic motion was found near the state: after {int(shot.iterations)} steps of Newton's method it fails "
        f"to close by {missed:.3g} after the period {period:.6g}.{turning} Start from a state and a period closer to "
        "one, such as those of a run that has settled."
    )


Make = Callable[[Float[Array, ""], Float[Array, ""]], tuple[AbstractSystem, AbstractState, Float[Array, ""]]]


def floquet_chart(
    make: Make,
    parameters: Mapping[str, Numbers],
    *,
    t: Numbers = 0.0,
    rtol: Numbers = PERIODIC_TOLERANCE,
    atol: Numbers = PERIODIC_TOLERANCE,
    iterations: int = 20,
    max_steps: int = 4096,
    chunk: int = 128,
    workers: int | None = None,
    progress: Callable[[int, int], Any] | None = None,
) -> "xarray.Dataset":
    """Computes the stability of a periodic motion at each pair of values of two parameters.

    **Arguments:**

    - ``make``: a function of both parameters that returns a system, and a state and a period near the motion, as for
      :func:`periodic_motion`; traced, so it must not branch on them.
    - ``parameters``: two names with the values of each, of shapes (n,) and (m,).
    - ``t``, ``rtol``, ``atol``, ``iterations``, ``max_steps``: as for :func:`periodic_motion`.
    - ``chunk``: how many cells are solved between two calls of ``progress``.
    - ``workers``: how many threads solve them; by default the number of this process's cores.
    - ``progress``: called with the number of cells done and the number of all, after each chunk.

    **Returns:** a data set over both parameters with

    - ``growth``: the largest real part of an exponent, in 1/time; NaN where no motion was found;
    - ``multiplier``: the size of the largest multiplier, and ``angle``, its argument from 0 to π: 0 where deviations
      keep their sign in a period, π where they change it;
    - ``period``, ``residual``, ``least_normal_force``: as in :class:`PeriodicMotion`;
    - ``closed``: whether a motion was found;
    - ``status``: the number of a :class:`~jaxball.Status`, 0 where the last solve reached its end.

    **Raises:** as :func:`periodic_motion`, and ``ValueError`` unless there are two parameters, each with a row of
    numbers.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> import jax.numpy as jnp
    >>> from jaxball import Disk, DiskState, Ground, HarmonicSeries, Oscillating
    >>> from jaxball.analysis.stability import floquet_chart
    >>> def shaken(amplitude, frequency):
    ...     motion = Oscillating(HarmonicSeries(jnp.zeros(3), amplitude * jnp.eye(3)[2:], frequency[None]))
    ...     disk = Disk(mass=1.0, inertia=0.36, offset=(0.0, 0.0, -0.2), ground=Ground(motion=motion))
    ...     return disk, DiskState(), 2 * jnp.pi / frequency
    >>> chart = floquet_chart(shaken, {"amplitude": [0.05, 0.3], "frequency": [0.7, 0.894]})  # it rocks at 0.447
    >>> (chart["growth"] > 1e-6).values.tolist()
    [[False, True], [False, True]]
    """
    grid = grid_of(parameters)
    require_callable("make", make, "first", "second")
    rtol, atol = map(to_array, check_tolerances(rtol, atol))
    cells, start = grid.cells, to_array(t)
    forced, angles = _equations(make, cells, float(start))
    search = Search(forced, angles, check_steps(iterations), check_steps(max_steps), start, rtol, atol)
    shots = grid.map(lambda cell: _solve(make, search, cell), chunk, workers, progress)
    system = make(*to_array(cells[0]))[0]
    growth, multiplier = np.full(len(cells), np.nan), np.full(len(cells), complex(np.nan))
    # Without a closed motion its multipliers mean nothing.
    for k in np.flatnonzero(shots.closed):
        shot = jax.tree.map(lambda leaf, k=k: leaf[k], shots)
        (multiplier[k], *_), (exponent, *_) = multipliers_of(shot, system, forced)
        growth[k] = exponent.real
    return grid.dataset(
        {
            "growth": (growth, "largest growth rate of deviations", "1/time"),
            "multiplier": (np.abs(multiplier), "size of the largest multiplier", ""),
            "angle": (np.abs(np.angle(multiplier)), "argument of the largest multiplier", "rad"),
            "period": (shots.period, "period", "time"),
            # The part that is not closed; whole turns are taken off already.
            "residual": (np.max(np.abs(shots.returned.gain), axis=1), "distance from the start after a period", ""),
            "least_normal_force": (shots.returned.least_normal_force, "least normal force", "mass length/time^2"),
            "closed": (shots.closed, "whether a periodic motion was found", ""),
            "status": (shots.returned.status, "how the last solve ended", ""),
        }
    )


@programs.filter_jit
def _solve(make: Make, search: Search, cell: Float[Array, "2"]) -> Shot:
    with traceable("make", make):
        system, state, period = make(cell[0], cell[1])
    return shoot(search, system, phase_point(system, state), jnp.asarray(period), None)


def _equations(make: Make, cells: Float[np.ndarray, "cells 2"], t: float) -> tuple[bool, tuple[bool, ...]]:
    """Finds whether the equations depend on time, and which components are angles, judged by the first cell and the
    last.
    """
    kinds = []
    # Over the whole chart: equations that are steady in one corner may be forced in the other.
    for cell in cells[[0, -1]]:
        system, state, period = make(*to_array(cell))
        kinds.append(equations_of(system, phase_point(system, state), t, float(period)))
    angles = np.all([angles for _, angles in kinds], axis=0)
    return any(forced for forced, _ in kinds), tuple(angles.tolist())
