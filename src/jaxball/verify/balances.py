"""The laws that are checked along one run: balances, integrals and the contact."""

from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..classical import HeavyTop
from ..physics.body import AbstractBody
from ..physics.state import DiskState
from ..scenario import Scenario
from ..simulation.extremes import contact_extremes
from .case import SAFETY, Case
from .laws import BALANCES
from .report import Row
from .symmetry import (
    MASSES_MOVE,
    NO_TURNTABLE,
    PLANAR,
    why_no_revolution,
    why_not_chaplygin,
    why_not_moving_energy,
    why_not_routh,
)

NO_VERSOR = "a disk's state has no versor"
MEANINGLESS = (MASSES_MOVE, PLANAR, NO_VERSOR, NO_TURNTABLE)  # reasons for which there is no quantity that could change


def balance(name: str, case: Case) -> Row:
    """The row of a balance or an integral.

    Where the law holds exactly, its residual consists of the solver's errors alone. Each step adds an error of about
    the tolerance, which does not grow, because the law holds along the exact motion through the perturbed state as
    well. So the expected residual is the number of steps × the change of the quantity for a change of the state by its
    tolerance × a safety factor of 10.
    """
    reason = _why_not(name, case)
    if reason in MEANINGLESS:
        return Row(name, reason=reason)
    drift = case.samples.drifts[name]
    expected = SAFETY * case.steps * drift.sensitivity
    return Row(name, drift.residual, expected, reason=reason, residuals=drift.residuals)


def contact(case: Case) -> Row:
    """The row of the normal force, as a fraction of the weight, with the friction that rolling needs."""
    extremes = contact_extremes(case.run)
    least, (first, second) = float(extremes.margin), extremes.when
    note = f"the least N is {least:.4g} of the weight, {first}"
    if np.isfinite(extremes.friction_needed):
        note += f"; rolling needs the friction |f|/N = {float(extremes.friction_needed):.4g}, {second}"
    return Row("contact", least, 0.0, note=note, at_least=True)


def laws_along(scenario: Scenario) -> dict[str, Callable[[Case], Row]]:
    """The laws that are checked along a run of this system, by name."""
    if not isinstance(scenario.system, AbstractBody):
        start = jnp.asarray(scenario.times[0]), scenario.state
        names = eqx.filter_eval_shape(type(scenario.system).laws, scenario.system, *start)._fields
        return {name: partial(balance, name) for name in names}
    return {**{name: partial(balance, name) for name in BALANCES}, "contact": contact}


def _why_not(name: str, case: Case) -> str:
    system, samples = case.scenario.system, case.samples
    if not isinstance(system, AbstractBody):
        return _why_not_classical(name, case)
    assert samples.moments is not None
    assert samples.axis is not None
    if name == "moving-energy":
        return why_not_moving_energy(system)
    if name == "chaplygin":
        return why_not_chaplygin(system, samples.moments)
    if name in ("jellett", "routh"):
        return why_not_routh(system, samples.moments, samples.axis)
    if isinstance(case.state, DiskState):
        return {"norm": NO_VERSOR, "jellett-rate": PLANAR}.get(name, "")
    return ""


def _why_not_classical(name: str, case: Case) -> str:
    system = case.scenario.system
    if not isinstance(system, HeavyTop) or name != "axial_momentum":
        return ""
    chi = np.asarray(system.chi)
    length = np.linalg.norm(chi)
    return "" if length == 0 else why_no_revolution(np.diag(np.asarray(system.inertia)), chi / length)
