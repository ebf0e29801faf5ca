"""How long the steps of a solve are."""

from collections.abc import Callable

import diffrax
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float, PyTree

from ..physics.system import AbstractSystem
from ..solvers import StepToKinks
from ..solvers.multistep import AbstractMultistep, AbstractMultistepController


def by_tolerances(
    rtol: Float[Array, ""],
    atol: Float[Array, ""],
    solver: diffrax.AbstractSolver | None = None,
    norm: Callable[[PyTree], Float[Array, ""]] = optx.rms_norm,
) -> diffrax.PIDController | AbstractMultistepController:
    """Steps by the tolerances only, with the controller that ``solver`` needs. A step below 1e-30 ends the solve."""
    if isinstance(solver, AbstractMultistep):
        return solver.controller_cls(rtol, atol, norm, dtmin=1e-30)
    return diffrax.PIDController(rtol=rtol, atol=atol, norm=norm, dtmin=1e-30, force_dtmin=False)


def to_kinks(
    controller: diffrax.AbstractAdaptiveStepSizeController, kinks: Float[Array, " kinks"]
) -> diffrax.AbstractAdaptiveStepSizeController:
    """The same, with steps that end at kinks."""
    return StepToKinks(controller, kinks) if kinks.size else controller


def kinks_of(system: AbstractSystem) -> Float[Array, " kinks"]:
    """The kinks of motions and of what drives.

    At the kinks of motions the field is continuous, so that moving the end of a step there moves nothing, and they
    have no derivatives. One that coincides with a kink of what drives is left out, which would share its derivative.
    """
    smooth, driving = jax.lax.stop_gradient(system.motion_kinks()), system.driving_kinks()
    shared = jnp.any(smooth[:, None] == jax.lax.stop_gradient(driving)[None], axis=1)
    return jnp.concatenate([jnp.where(shared, jnp.inf, smooth), driving])
