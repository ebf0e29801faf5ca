"""The laws that compare runs: solvers, forms of the equations, tolerances."""

import itertools
from collections.abc import Callable
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from ...files.scenario.solvers import SOLVERS
from ...interface.status import SolveError
from ...physics.body import Disk
from ...physics.classical import NonholonomicParticle
from ...physics.contact.released import ReleasedState
from ...physics.dae import WITH_UNIT
from ...physics.dynamics.footing import in_space
from ...simulation.deviations import generic_vectors
from ...simulation.global_error import estimate_error, slope_of_end
from ...simulation.solvers import Gauss, RadauIIA
from ...simulation.trajectory import Trajectory
from .case import Case, flat
from .report import Row

TOLERANCE_FACTORS = (1e4, 1e2, 1.0)  # of the run's tolerance
TIGHTER = 1e-2  # the ratio of two tolerances that are compared
LARGEST_RATIO = 0.3  # of errors, when the tolerance is divided by 100; the error falls as h^p
SATURATED = 1e-1
INTERPOLATION_FACTOR = 100  # the reference's interpolation error over its tolerance
LOOSEST = 1e-2

SHARE_UNEXPLAINED = 0.5  # of the error, by which an estimate of it may be off

WIDTH = 3e-5  # to each side, relative to 1 + |x|, of the runs whose difference is compared with a derivative
UNRESOLVED = 0.1  # of the change by a difference twice as wide, as Richardson's combination leaves less

SLOW_COMPARISONS = ("estimate", "derivative", "solvers", "dae", "embedding")  # each compiles a program of its own


def compare_saved(case: Case) -> Row:
    """Compares the given trajectory, up to the time that it reached, with the run solved again."""
    saved_run = case.given
    if saved_run is None:
        return Row("saved", reason="a scenario was given, not a run")
    if not np.array_equal(saved_run.times, case.run.times):
        return Row("saved", note="its times are not those of its scenario")
    mask = np.isfinite(flat(saved_run.state)).all(axis=1)
    distances = case.distance(saved_run.state, case.run.state)[mask]
    note = "" if mask.all() else f"up to t = {float(saved_run.reached):.6g}, which it reached"
    return Row("saved", float(np.max(distances, initial=0.0)), 2 * case.expected, note=note)


def error(case: Case) -> Row:
    """Returns the row of the error of the run at the saved times."""
    if not case.reference.ok:
        return Row("error", note=f"the run at a tolerance of 1e-13 failed: {case.reference.message}")
    return Row("error", float(np.max(case.errors)), case.expected)


def convergence(case: Case) -> Row:
    """Returns the row of the largest ratio of the errors at one tolerance and at a hundred times that tolerance.

    A ratio says something where the larger error is small against the motion, and the smaller one is not below what the
    reference resolves. Without any such pair, the law holds if the reference resolves less than the motion and the run
    agrees with it that far; otherwise the law is not resolved, which does not count as holding.
    """
    tolerances = [case.tolerance * factor for factor in TOLERANCE_FACTORS]
    tolerances = [tolerance for tolerance in tolerances if tolerance <= LOOSEST]
    if len(tolerances) < 2:  # of a run at a loose tolerance, compared with a tighter one
        tolerances = [case.tolerance, case.tolerance * TIGHTER]
    errors = [_error_at(case, tolerance) for tolerance in tolerances]
    floor = INTERPOLATION_FACTOR * case.finest * float(np.max(case.growth))
    # Not `<`, so that NaN is a ratio, and fails.
    ratios = [
        fine / coarse for coarse, fine in itertools.pairwise(errors) if not coarse >= SATURATED and not fine <= floor
    ]
    pairs = zip(errors, tolerances, strict=True)
    note = "errors " + ", ".join(f"{value:.0e} at {tolerance:.0e}" for value, tolerance in pairs)
    if not ratios and not errors[-1] <= floor < SATURATED:
        why = f"no error is between {SATURATED:g}, where it is as large as the motion, and {floor:.0e}, which the "
        return Row("convergence", note=f"not resolved: {why}reference resolves; {note}")
    # Without a ratio nothing was found against convergence.
    return Row("convergence", float(np.max([0.0, *ratios])), LARGEST_RATIO, note=note)


def estimate(case: Case) -> Row:
    """Returns the row of the error as it is estimated from saved time to saved time, less the error against the
    reference.

    Half of the error is allowed, as the estimate is to first order, and what the reference does not resolve.
    """
    if not case.reference.ok:
        return Row("estimate", note=f"the run at a tolerance of 1e-13 failed: {case.reference.message}")
    largest = float(np.max(case.errors))
    if largest >= SATURATED:
        return Row("estimate", reason=f"the error, {largest:.0e}, is as large as the motion")
    if np.any(case.jumps):
        return Row("estimate", reason="a saved time is that of an impact, from which no solve can start as the run did")
    try:
        estimated = flat(estimate_error(case.run)) / case.weights[None]
    except SolveError as failure:
        return Row("estimate", note=str(failure))
    measured = (flat(case.run.state) - flat(case.reference.state)) / case.weights[None]
    expected = SHARE_UNEXPLAINED * largest + INTERPOLATION_FACTOR * case.finest * float(np.max(case.growth))
    note = f"the estimated error is {np.max(np.abs(estimated)):.1e}, against the reference it is {largest:.1e}"
    return Row("estimate", float(np.max(np.abs(estimated - measured))), expected, note=note)


def derivative(case: Case) -> Row:
    """Returns the row of the derivative of the run's end along a generic direction, less differences of nearby runs.

    It is solved at the run's tolerances, by Dopri8 with ``estimate``'s program. An error of each step, which is up to
    the tolerance times the size that the direction has by then, grows like any deviation. What differences do not
    resolve is allowed as well.
    """
    if case.scenario.system.is_hybrid or case.scenario.may_slip:
        return Row("derivative", reason="it has modes, and nearby runs may be in others")
    direction = generic_vectors(1, case.weights.size)[0]
    tolerances = case.scenario.rtol, case.scenario.atol
    slope = slope_of_end(case.run, direction / np.linalg.norm(direction) * case.weights, WIDTH, tolerances)
    along, true, spread = (x / case.weights for x in slope)
    if not np.isfinite(true).all():
        return Row("derivative", reason="a run from a nearby state fails")
    size, unresolved = max(1.0, float(np.max(np.abs(true)))), UNRESOLVED * float(np.max(spread))
    if unresolved >= SATURATED * size:
        return Row("derivative", reason="runs from nearby states differ too much for differences to tell")
    note = f"along a direction that grows {size:.3g}-fold"
    return Row("derivative", float(np.max(np.abs(along - true))), case.expected * size + unresolved, note=note)


def solvers(case: Case) -> Row:
    """Compares with Dopri8 or Gauss's method of order 16, whichever is of a different family than the scenario's
    solver.
    """
    # Of another family, because methods that are made alike may err alike.
    explicit = isinstance(SOLVERS[case.scenario.solver](), diffrax.AbstractERK)
    other = Gauss(stages=8) if explicit else diffrax.Dopri8()
    return _agreement("solvers", case, case.other(other), type(other).__name__)


def dae(case: Case) -> Row:
    """Compares with the paper's form in which |q|² = 1 determines one component of q, by Radau IIA of order 13."""
    if not case.scenario.may_slip and case.state.unit_vector is None:
        return Row("dae", reason=f"it is for {WITH_UNIT}, in which a component of a unit vector is algebraic")
    if case.scenario.system.is_hybrid or case.scenario.may_slip:
        return Row("dae", reason="it has modes, which have no differential-algebraic form")
    return _agreement("dae", case, case.other(RadauIIA(stages=7), dae=True), "RadauIIA")


def embedding(case: Case) -> Row:
    """Compares the disk with a ball with rails in the plane of E1 and E3 and three equal moments."""
    system, state = case.scenario.system, case.state
    if not isinstance(system, Disk):
        return Row("embedding", reason="it is for disks")
    if isinstance(state, ReleasedState):
        start: Any = ReleasedState(in_space(system, state.body), state.V, state.height)
    else:
        start = in_space(system, state)
    embedded = case.other(diffrax.Dopri8(), system=system.embed(), state=start)
    if not embedded.ok:
        return Row("embedding", note=f"the run of the ball failed: {embedded.message}")
    # Relative to 1 + |x|, for each part of the state.
    states = jax.vmap(lambda x: in_space(system, x))(case.run.state)
    pairs = zip(jax.tree.leaves(states), jax.tree.leaves(embedded.state), strict=True)
    moments = ~case.jumps
    parts = [np.abs(np.asarray(x) - np.asarray(y))[moments] / (1 + np.max(np.abs(y), initial=0.0)) for x, y in pairs]
    return Row("embedding", max(float(np.max(part, initial=0.0)) for part in parts), 2 * case.expected)


def closed_form(case: Case) -> Row:
    """Compares with ``eq_part_LdA_x`` of the nonholonomic particle."""
    system, start = case.scenario.system, case.state
    if not isinstance(system, NonholonomicParticle):
        return Row("closed-form", reason="the motion is not known in closed form")
    times = jnp.asarray(case.scenario.times)
    exact = jax.jit(jax.vmap(lambda t: system.solution(t, start, times[0])))(times)  # pyright: ignore[reportArgumentType]
    return Row("closed-form", float(np.max(case.distance(case.run.state, exact))), case.expected)


CHECKS: dict[str, Callable[[Case], Row]] = {
    "saved": compare_saved,
    "error": error,
    "convergence": convergence,
    "estimate": estimate,
    "derivative": derivative,
    "solvers": solvers,
    "dae": dae,
    "embedding": embedding,
    "closed-form": closed_form,
}


def _agreement(law: str, case: Case, other: Trajectory[Any, Any], name: str) -> Row:
    """Returns the row of two runs at the same tolerance, each with its own error."""
    if not other.ok:
        return Row(law, note=f"the run by {name} failed: {other.message}")
    return Row(law, float(np.max(case.distance(case.run.state, other.state))), 2 * case.expected, note=f"with {name}")


def _error_at(case: Case, tolerance: float) -> float:
    if tolerance == case.tolerance:
        return float(np.max(case.errors))
    factor = tolerance / case.tolerance
    scenario = case.scenario
    run = scenario.simulate(rtol=factor * scenario.rtol, atol=factor * scenario.atol, dense=True)
    return float(np.max(case.distance(run.state, case.reference.state)))
