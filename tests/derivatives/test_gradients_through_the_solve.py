"""Derivatives of the final state, forward and reverse, against differences of tightly converged runs.

The parameters are numbers of every kind: masses, radii, the pulse of each mass with the times of its
kinks, the initial state and the force. A difference over four points with step h errs by h⁴ times a
fifth derivative and by rounding over h: some 1e-9 at h = 1e-3 for runs at tolerance 1e-13.
"""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

import jaxball
from tests.support.differences import jacobian
from tests.support.paper import BALL_DIRECTIONS

TIMES = np.array([0.0, 2.0])
H = 1e-3
BOUND = 1e-9

SEPARATE = {"start": (0.05, 0.12, 0.2), "hold": (0.35, 0.45, 0.55), "end": (0.65, 0.75, 0.85)}
SHARED = {"start": (0.1, 0.1, 0.1), "hold": (0.4, 0.4, 0.4), "end": (0.7, 0.7, 0.7)}


def parameters(kinks):
    """Every number that is differentiated, by name."""
    found = {
        "masses": (1.0, 0.8, 1.2, 0.9),
        "radii": (0.95, 0.9, 0.85),
        "theta": (0.0, 2.0369, 0.7044),
        "height": (1.0, -1.5, 2.0),
        "q": (0.9, 0.2, -0.1, 0.3),
        "Omega": (0.1, -0.2, 0.3),
        "push": (0.1, -0.05, 0.02),
        **kinks,
    }
    return {name: jnp.asarray(values) for name, values in found.items()}


def run(p, tolerance, adjoint):
    """The state at the end, as one vector; ``q`` is a versor whatever its four numbers are."""
    masses = [
        jaxball.PointMass(
            p["masses"][k + 1],
            jaxball.OnRail(
                jaxball.Circle(p["radii"][k], frame=jaxball.SphericalFrame(*BALL_DIRECTIONS[k])),
                jaxball.Pulse(p["theta"][k], p["height"][k], 0.0, p["start"][k], p["hold"][k], p["end"][k]),
            ),
        )
        for k in range(3)
    ]
    ball = jaxball.Ball(
        mass=p["masses"][0],
        inertia=(0.9, 1.0, 1.1),
        offset=(0.0, 0.0, -0.05),
        force=jaxball.physics.HarmonicForce(p["push"]),
        masses=masses,
    )
    state = jaxball.BallState(jaxball.numerics.versor.normalize(p["q"]), p["Omega"])
    solved = jaxball.simulate(ball, TIMES, state, rtol=tolerance, atol=tolerance, adjoint=adjoint)
    return jnp.concatenate([solved.state.q[-1], solved.state.Omega[-1], solved.state.z[-1]])


_, unpack = ravel_pytree(parameters(SEPARATE))
WEIGHTS = jnp.asarray(np.random.default_rng(61).normal(size=9))


@jaxball.jit
def forward(x):
    return jax.jacfwd(lambda x: run(unpack(x), 1e-11, diffrax.ForwardMode()))(x)


@jaxball.jit
def reverse(x):
    return jax.grad(lambda x: jnp.dot(WEIGHTS, run(unpack(x), 1e-11, None)))(x)


@jaxball.jit
def differences(x, h):
    """The Jacobian by the five-point formula, all runs in one batch."""
    steps = h * jnp.eye(x.size)
    shifted = x[None, None] + jnp.asarray([-2.0, -1.0, 1.0, 2.0])[:, None, None] * steps[None]
    runs = jax.vmap(jax.vmap(lambda x: run(unpack(x), 1e-13, diffrax.ForwardMode())))(shifted)
    weights = jnp.asarray([1.0, -8.0, 8.0, -1.0]) / (12 * h)
    return jnp.tensordot(weights, runs, axes=1).T


def numbers(kinks):
    return ravel_pytree(parameters(kinks))[0]


def worst(found, expected):
    """The largest difference for each named parameter."""
    largest = np.max(np.abs(np.atleast_2d(np.asarray(found) - expected)), axis=0)
    return {name: float(jnp.max(values)) for name, values in unpack(jnp.asarray(largest)).items()}


@pytest.fixture(scope="module")
def separate():
    """Where every mass has kinks of its own: the numbers and the Jacobian by differences."""
    x = numbers(SEPARATE)
    return x, np.asarray(differences(x, H))


@pytest.fixture(scope="module")
def shared():
    """Where the masses have their kinks together, as in the paper.

    When one kink passes another, a higher derivative of the run jumps; a smaller step keeps that small.
    """
    x = numbers(SHARED)
    return x, np.asarray(differences(x, H / 5))


@pytest.mark.long
def test_forward_mode(separate):
    x, expected = separate
    errors = worst(forward(x), expected)
    assert max(errors.values()) < BOUND, errors


@pytest.mark.long
def test_reverse_mode(separate):
    x, expected = separate
    errors = worst(reverse(x), np.asarray(WEIGHTS) @ expected)
    assert max(errors.values()) < BOUND, errors


@pytest.mark.thorough
def test_the_times_of_the_kinks_matter(separate):
    """A derivative of zero would pass unseen if the truth were zero."""
    sizes = worst(separate[1], 0.0)
    assert min(sizes[name] for name in ("start", "hold", "end", "masses", "radii", "push")) > 0.01, sizes


@pytest.mark.long
def test_kinks_that_masses_share(shared):
    """Each mass has its own derivative where several jump at once, because the field does not jump."""
    x, expected = shared
    for found, truth in ((forward(x), expected), (reverse(x), np.asarray(WEIGHTS) @ expected)):
        errors = worst(found, truth)
        assert max(errors.values()) < BOUND, errors


def switched(t, p):
    """A force that is switched on at the time ``p[0]``, with the strength ``p[1]``."""
    return jnp.where(t >= p[0], p[1], 0.0) * jnp.asarray([1.0, 0.5, 0.0])


def end_of_switched_run(p, adjoint=None):
    ball = jaxball.Ball(
        mass=1.0,
        inertia=(0.4, 0.5, 0.6),
        offset=(0.1, 0.0, -0.2),
        force=jaxball.FunctionForce(switched, p, kink_times=p[:1]),
    )
    return jaxball.simulate(ball, TIMES, adjoint=adjoint).state.z[-1]


@pytest.mark.slow
def test_the_time_at_which_a_force_jumps():
    """The field does jump here, and the derivative comes from the step that ends there."""
    p = jnp.asarray([0.7, 0.3])
    run = jaxball.jit(end_of_switched_run)
    expected = jacobian(run, p, H)
    forward_mode = jaxball.jit(jax.jacfwd(lambda p: end_of_switched_run(p, diffrax.ForwardMode())))(p)
    reverse_mode = jaxball.jit(jax.jacrev(end_of_switched_run))(p)
    assert np.max(np.abs(expected[:, 0])) > 0.1
    np.testing.assert_allclose(forward_mode, expected, atol=1e-7)
    np.testing.assert_allclose(reverse_mode, expected, atol=1e-7)
