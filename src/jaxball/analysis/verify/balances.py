"""The laws that are checked along one run: balances, integrals and the contact, and whether each of them applies."""

from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...files.scenario.scenario import Scenario
from ...physics.body import AbstractBody
from ...physics.classical import HeavyTop
from ...physics.contact.history import ContactHistory
from ...physics.contact.modes import Mode
from ...physics.dynamics.moments import Moments
from ...physics.grounds import AbstractSurface
from ...physics.grounds.ground import Ground
from ...physics.prescribed.motion import Fixed
from ...physics.prescribed.schedules import AbstractSchedule
from ...physics.rolling import AbstractRollingSystem
from ...simulation.extremes import contact_extremes
from ...simulation.trajectory import always_rolls
from .case import SAFETY, Case
from .laws import BALANCES
from .report import Row

ZERO_RELATIVE = 1e-9  # relative to the scale
MASSES_MOVE = "masses move"
PLANAR = "a disk rolls in a plane, where it is zero"
NO_TURNTABLE = "the ground has no turntable"
NO_VERSOR = "a disk's state has no versor"
OF_CONTACT = ("energy", "momentum", "chaplygin", "jellett-rate", "jellett", "norm")  # with a law of contact
OF_CONVEX = ("energy", "momentum", "norm", "rolling")
MEANINGLESS = (MASSES_MOVE, PLANAR, NO_VERSOR, NO_TURNTABLE)  # reasons for which there is no quantity that could change


def why_not_chaplygin(system: AbstractBody, body_moments: Moments) -> str:
    """Says why ΛΠ is not constant; empty where it is, for p = 0 at all times and no force or resistance on level
    ground.
    """
    if reason := _what_acts(system):
        return reason
    distance = float(np.max(np.linalg.norm(body_moments.p, axis=-1) / np.asarray(body_moments.M)))
    if distance > ZERO_RELATIVE * float(system.radius):
        return f"the centre of mass is up to {distance:.3g} from the geometric centre"
    return ""


def why_not_moving_energy(system: AbstractBody) -> str:
    """Says why there is no balance of the moving energy; empty where there is, on a level turntable."""
    if not isinstance(system.ground, Ground) or system.ground.turntable is None:
        return NO_TURNTABLE
    if system.ground.motion is not None or system.ground.belt is not None or float(system.ground.angle) != 0:
        return "the ground is tilted or moves"
    return ""


def why_not_routh(system: AbstractBody, body_moments: Moments, axis: Float[np.ndarray, "steps nodes 3"]) -> str:
    """Says why the integrals of Jellett and Routh are not constant; empty where they are.

    They are constant where no force acts, no mass moves, and the ball with its masses is a body of revolution about the
    axis through the geometric centre and the centre of mass: with d1 = d2 and every mass on E3, or so in other axes.
    """
    if system.planar:
        return PLANAR
    if reason := _what_acts(system):
        return reason
    J, p = np.asarray(body_moments.J), np.asarray(body_moments.p)
    moved = max(np.ptp(J, axis=(0, 1)).max(), np.ptp(p, axis=(0, 1)).max() * float(system.radius))
    # Two equal masses that circle the axis opposite each other change neither J nor p.
    if moved > ZERO_RELATIVE * np.max(np.abs(J)) or np.max(np.abs(body_moments.l)) > 0:
        return MASSES_MOVE
    J, p = J[0, 0], p[0, 0]
    # Steiner: about the centre of mass, where a body of revolution shows that it is one.
    about_centre_of_mass = J - (p @ p * np.eye(3) - np.outer(p, p)) / float(body_moments.M[0, 0])
    return why_no_revolution(about_centre_of_mass, axis[0, 0])


def _what_acts(system: AbstractBody) -> str:
    """Says what acts on a body besides a level plane at rest; empty if nothing does."""
    if system.force is not None:
        return "a force acts"
    if isinstance(system.ground, AbstractSurface):
        return "the ground is no plane"
    if system.ground is not None:
        return "the ground is tilted or moves"
    return "resistance acts" if system.resistance is not None else ""


def why_no_revolution(J: Float[np.ndarray, "3 3"], axis: Float[np.ndarray, "3"]) -> str:
    """Says why a body with the moments of inertia ``J`` is not a body of revolution about ``axis``; empty
    where it is.
    """
    scale = float(np.max(np.abs(J)))
    along = J @ axis
    if np.max(np.abs(along - (axis @ along) * axis)) > ZERO_RELATIVE * scale:
        return f"the axis {_text(axis)} is not a principal one"
    # The axis's own eigenvalue is lifted above the others, which are then the two moments across it.
    across = np.sort(np.linalg.eigvalsh(J + 10 * scale * np.outer(axis, axis)))[:2]
    if across[1] - across[0] > ZERO_RELATIVE * scale:
        return f"the moments across the axis {_text(axis)} differ, {across[0]:.4g} and {across[1]:.4g}"
    return ""


def _text(axis: Float[np.ndarray, "3"]) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in axis) + ")"


def balance(name: str, case: Case) -> Row:
    """Returns the row of a balance or an integral.

    Where the law holds exactly, its residual consists of the solver's errors alone. Each step adds an error of about
    the tolerance, which does not grow, because the law holds along the exact motion through the perturbed state as
    well. So the expected residual is the number of steps × the change of the quantity for a change of the state by its
    tolerance × a safety factor of 10.
    """
    reason = _why_unknown(name, case) or _why_not(name, case)
    if reason in MEANINGLESS or name not in case.samples.drifts:
        return Row(name, reason=reason)
    drift = case.samples.drifts[name]
    expected = SAFETY * case.steps * drift.sensitivity
    return Row(name, drift.residual, expected, reason=reason, residuals=drift.residuals)


def contact(case: Case) -> Row:
    """Returns the row of the normal force, as a fraction of the weight, with the friction that rolling needs."""
    if not always_rolls(case.run):
        return Row("contact", reason=f"the body has {case.run.history.described}")
    extremes = contact_extremes(case.run)
    least, (first, second) = float(extremes.margin), extremes.when
    note = f"the least N is {least:.4g} of the weight, {first}"
    if np.isfinite(extremes.friction_needed):
        note += f"; rolling needs the friction |f|/N = {float(extremes.friction_needed):.4g}, {second}"
    return Row("contact", least, 0.0, note=note, at_least=True)


def laws_along(scenario: Scenario) -> dict[str, Callable[[Case], Row]]:
    """Returns the laws that are checked along a run of this system, by name."""
    if not isinstance(scenario.system, AbstractBody):
        start = jnp.asarray(scenario.times[0]), scenario.state
        names = eqx.filter_eval_shape(type(scenario.system).laws, scenario.system, *start)._fields
        balances = {name: partial(balance, name) for name in names}
        return balances | ({"contact": contact} if isinstance(scenario.system, AbstractRollingSystem) else {})
    balances = {name: partial(balance, name) for name in BALANCES}
    return balances | {"contact": law_of_contact if scenario.may_slip else contact}


def law_of_contact(case: Case) -> Row:
    """Returns the row of N ≥ 0 and |f| ≤ μN at the saved times, with the kinetic coefficient of a slip; over the
    weight.
    """
    run, seen, law = case.run, case.run.observables, case.scenario.contact
    assert law is not None
    assert isinstance(run.history, ContactHistory)
    N, f = np.asarray(seen.normal_force), np.linalg.norm(np.asarray(seen.friction), axis=1)
    mode, slip = np.asarray(run.history.mode), np.linalg.norm(np.asarray(run.history.slip)[:, :2], axis=1)
    sliding = np.asarray(jax.vmap(law.coefficient)(jnp.asarray(slip)))
    # In flight there is no friction to allow.
    mu = np.where(mode == Mode.SLIDING, sliding, np.where(mode == Mode.FLIGHT, 0.0, float(law.static_friction)))
    system = case.scenario.system
    assert isinstance(system, AbstractBody)
    # A fraction of the weight; without gravity, there is none.
    unit = float(system.total_mass) * abs(float(system.gravity)) or 1.0
    above = np.maximum(-N, f - mu * np.maximum(N, 0.0))
    on_ground = mode != Mode.FLIGHT
    lowest = f"{float(np.min(N[on_ground])) / unit:.4g} of the weight" if on_ground.any() else "in flight throughout"
    expected = SAFETY * case.steps * case.tolerance
    return Row("contact", float(np.max(above)) / unit, expected, note=f"the least N on the ground: {lowest}")


def _why_unknown(name: str, case: Case) -> str:
    """Says why a law has no balance here: some are known only for bodies that roll, some only for balls and disks."""
    system = case.scenario.system
    of_convex = not isinstance(system, AbstractBody) or system.shape is None or name in OF_CONVEX
    if case.scenario.may_slip and not (of_convex and name in OF_CONTACT):
        return f"the body has {case.run.history.described}"
    return "" if of_convex else "the body is no ball"


def _why_not(name: str, case: Case) -> str:
    system, samples = case.scenario.system, case.samples
    if not isinstance(system, AbstractBody):
        return _why_not_classical(name, case)
    if case.scenario.may_slip and name == "energy":
        return _why_not_energy_with_contact(case)
    if system.shape is not None:
        return ""
    assert samples.moments is not None
    assert samples.axis is not None
    if name == "moving-energy":
        return why_not_moving_energy(system)
    if name == "chaplygin":
        return why_not_chaplygin(system, samples.moments)
    if name in ("jellett", "routh"):
        return why_not_routh(system, samples.moments, samples.axis)
    if name == "jellett-rate" and isinstance(system.ground, AbstractSurface):
        return "the ground is no plane"
    if system.planar:
        return {"norm": NO_VERSOR, "jellett-rate": PLANAR}.get(name, "")
    return ""


def _why_not_energy_with_contact(case: Case) -> str:
    """Says why the energy of a body with a law of contact has no balance; the other laws hold through impacts."""
    system, history = case.scenario.system, case.run.history
    assert isinstance(system, AbstractBody)
    assert isinstance(history, ContactHistory)
    strikes = bool(np.any(np.asarray(history.switches.lost) != 0))
    moved = any(not isinstance(group.motion, Fixed) for group in system.groups) or bool(system.accelerated)
    scheduled = any(isinstance(drive, AbstractSchedule) for m in system.mechanisms for drive in m.drives)
    if strikes and (moved or scheduled or case.samples.ground_moves):
        return "what is moved by schedules or a law does work in impacts"
    return ""


def _why_not_classical(name: str, case: Case) -> str:
    system = case.scenario.system
    if not isinstance(system, HeavyTop) or name != "axial_momentum":
        return ""
    chi = np.asarray(system.chi)
    length = np.linalg.norm(chi)
    return "" if length == 0 else why_no_revolution(np.diag(np.asarray(system.inertia)), chi / length)
