"""Derivatives of the final state through every method, against each other and against differences.

The problem is a predator's and its prey's with a season. The numbers differentiated are three of its parameters and the
initial state. As a differential-algebraic equation, the product of predators and prey is an algebraic variable.
"""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.simulation.solvers import (
    NDF,
    TRBDF2,
    Gauss,
    MassMatrixTerm,
    RadauIIA,
    SimplifiedNewton,
    TailError,
    Trapezoidal,
)
from jaxball.simulation.solvers.multistep import controller_class
from tests.solvers.solving import solve

P = np.array([1.1, 0.4, 0.7, 2.0, 1.0])
WEIGHTS = np.array([0.3, -0.7])
# For differences over seven points, which err by h⁶ times a seventh derivative and by rounding over h: some 1e-11.
H = 2e-3

# With tolerances, and bounds on the error of the derivatives, whose largest is 14.
SOLVERS = {
    "radau 3": (RadauIIA(3), 1e-9, 2e-9),
    "radau 5, dae": (RadauIIA(5), 1e-10, 1e-10),
    "radau 7": (RadauIIA(7), 1e-11, 1e-10),
    "radau 7, tail": (RadauIIA(7, error=TailError()), 1e-11, 1e-10),
    "gauss 8": (Gauss(8), 1e-11, 1e-10),
    "gauss 8, newton": (Gauss(8, root_finder=SimplifiedNewton()), 1e-11, 1e-10),
    "trapezoidal": (Trapezoidal(), 1e-8, 5e-5),
    "tr-bdf2": (TRBDF2(), 1e-8, 5e-5),
    "ndf": (NDF(), 1e-10, 3e-7),
    "ndf, dae": (NDF(), 1e-10, 3e-7),
    "bdf": (NDF(kappa="bdf"), 1e-10, 3e-7),
}
SLOW = ("radau 3", "radau 7", "radau 7, tail", "gauss 8, newton", "trapezoidal", "tr-bdf2", "ndf", "bdf")
# The shortest and the longest step. Forward and reverse mode round, and so choose steps, each in its own way.
CHOSEN, FIXED = (1e-12, np.inf), (0.05, 0.05)
CHECKPOINT, DIRECT = diffrax.RecursiveCheckpointAdjoint(), diffrax.DirectAdjoint()
REVERSE = [("radau 5, dae", DIRECT), ("gauss 8", CHECKPOINT)]
REVERSE_SLOW = [
    ("radau 3", CHECKPOINT),
    ("tr-bdf2", DIRECT),
    ("radau 3", DIRECT),
    ("radau 5, dae", CHECKPOINT),
    ("radau 7", CHECKPOINT),
    ("gauss 8", DIRECT),
    ("gauss 8, newton", CHECKPOINT),
    ("trapezoidal", CHECKPOINT),
    ("trapezoidal", DIRECT),
    ("tr-bdf2", CHECKPOINT),
    ("ndf, dae", CHECKPOINT),
    ("ndf", CHECKPOINT),
    ("bdf", CHECKPOINT),
]


def ode(t, x, p):
    prey, predators = x
    return jnp.stack(
        [
            p[0] * prey - p[1] * prey * predators,
            prey * predators - p[2] * predators + 0.1 * jnp.sin(t),
        ]
    )


def dae(t, x, p):
    prey, predators, product = x
    return jnp.stack(
        [
            p[0] * prey - p[1] * product,
            product - p[2] * predators + 0.1 * jnp.sin(t),
            product - prey * predators,
        ]
    )


def end(solver, tolerance, adjoint, p, steps=CHOSEN, *, algebraic=False):
    """The final state without the algebraic variable."""
    x0, term = p[3:], diffrax.ODETerm(ode)
    if algebraic:
        x0, term = jnp.append(x0, x0[0] * x0[1]), MassMatrixTerm(dae, np.array([1.0, 1.0, 0.0]))
    # A method of variable order does not keep a step whose error is too large.
    bounds = {"dtmax": steps[1]} if isinstance(solver, NDF) else {"dtmin": steps[0], "dtmax": steps[1]}
    controller = controller_class(solver)(tolerance, tolerance, **bounds)
    return solve(term, solver, x0, 3.0, args=p, stepsize_controller=controller, adjoint=adjoint).ys[0, :2]


def run(name, adjoint):
    solver, tolerance, _ = SOLVERS[name]
    return functools.partial(end, solver, tolerance, adjoint, algebraic="dae" in name)


@functools.cache
def differences():
    """The Jacobian, all runs in one batch by an explicit method at 1e-13."""
    points = jnp.asarray([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])
    weights = jnp.asarray([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / (60.0 * H)
    one = functools.partial(end, diffrax.Dopri8(), 1e-13, diffrax.ForwardMode())
    shifted = P[None, None] + points[:, None, None] * H * jnp.eye(len(P))[None]
    return np.asarray(jnp.tensordot(weights, jax.jit(jax.vmap(jax.vmap(one)))(shifted), axes=1).T)


@functools.cache
def jacobian(name):
    """By forward mode."""
    return jax.jit(jax.jacfwd(run(name, diffrax.ForwardMode())))


def gradient(name, adjoint, steps):
    """Of a weighted sum, by reverse mode."""
    through = run(name, adjoint)
    return np.asarray(jax.jit(jax.grad(lambda p, steps: jnp.sum(WEIGHTS * through(p, steps))))(P, steps))


@pytest.mark.long
@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow if n in SLOW else ()) for n in SOLVERS])
def test_forward_mode(name):
    _, _, bound = SOLVERS[name]
    np.testing.assert_allclose(jacobian(name)(P, CHOSEN), differences(), rtol=0, atol=bound)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "adjoint"), REVERSE + [pytest.param(*case, marks=pytest.mark.slow) for case in REVERSE_SLOW]
)
def test_reverse_mode_is_the_transpose(name, adjoint):
    """The same linear map, evaluated from the other side.

    Not the same to rounding where the method chooses its steps: in forward mode they are those of the derivatives, too,
    so that two runs are compared that err by 1e-10 in each of their 330 and 410 steps.
    """
    forward = np.asarray(jacobian(name)(P, FIXED))
    bound = 7e-8 if isinstance(SOLVERS[name][0], NDF) else 1e-13
    np.testing.assert_allclose(gradient(name, adjoint, FIXED), WEIGHTS @ forward, rtol=0, atol=bound)


@pytest.mark.parametrize("name", ["gauss 8", pytest.param("radau 7", marks=pytest.mark.slow)])
def test_backsolve(name):
    """Not the transpose: the adjoint equation, solved as accurately as the equation."""
    solver, _, bound = SOLVERS[name]
    found = gradient(name, diffrax.BacksolveAdjoint(solver=solver), CHOSEN)
    np.testing.assert_allclose(found, WEIGHTS @ differences(), rtol=0, atol=bound)
