"""What Gauss methods keep by themselves, and what projection does for the others."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.simulation import solvers
from tests.solvers.fixed_steps import FIXED_POINT, NEWTON, observed_order
from tests.solvers.solving import solve

EPS = np.finfo(float).eps
END = 10.0
# Ends of steps if their number is a multiple of 40, and times within steps.
ENDS = np.linspace(0, END, 41)
WITHIN = np.concatenate([[0], ENDS[1:-1] + 0.0037, [END]])


def first_angle(t):
    return 2 * t + jnp.sin(3 * t)


def second_angle(t):
    return 0.5 * t + 1.5 * jnp.sin(2 * t)


def orientation(t):
    """exp(ak/2) exp(bi/2): turned by a about the fixed z axis, then by b about the body's x axis."""
    a, b = first_angle(t) / 2, second_angle(t) / 2
    ca, sa, cb, sb = jnp.cos(a), jnp.sin(a), jnp.cos(b), jnp.sin(b)
    return jnp.stack([ca * cb, ca * sb, sa * sb, sa * cb])


def kinematics(t, q, args):
    """q̇ = ½ q Ω with the body's angular velocity Ω = (ḃ, ȧ sin b, ȧ cos b), which makes ``orientation``."""
    da, db, b = jax.grad(first_angle)(t), jax.grad(second_angle)(t), second_angle(t)
    x, y, z = db, da * jnp.sin(b), da * jnp.cos(b)
    w, i, j, k = q
    return jnp.stack([-x * i - y * j - z * k, x * w + z * j - y * k, y * w - z * i + x * k, z * w + y * i - x * j]) / 2


def normalised(q):
    return q / jnp.sqrt(jnp.sum(q**2))


@eqx.filter_jit
def run(solver, times, steps, y0):
    """The solution at ``times``, by equal steps from the first to the last."""
    start, end = times[0], times[-1]
    options = {"saveat": diffrax.SaveAt(ts=times), "max_steps": 2000}
    return solve(kinematics, solver, y0, end, start=start, step=(end - start) / steps, **options).ys


def turn(solver, steps, times=ENDS, start=None):
    """q at ``times``, by so many steps."""
    start = orientation(0.0) if start is None else start
    return np.asarray(run(solver, jnp.asarray(times), jnp.asarray(steps, float), jnp.asarray(start, float)))


def off_the_sphere(q):
    """The largest distance of |q| from 1."""
    return np.max(np.abs(np.linalg.norm(q, axis=-1) - 1))


def errors(solver, steps, times=ENDS):
    """The largest errors of q at ``times``, for several numbers of steps."""
    truth = np.asarray(jax.vmap(orientation)(jnp.asarray(times)))
    return [np.max(np.linalg.norm(turn(solver, n, times) - truth, axis=1)) for n in steps]


GAUSS = [
    pytest.param(solvers.Gauss(2, root_finder=NEWTON), id="2 stages"),
    pytest.param(solvers.Gauss(8, root_finder=FIXED_POINT), id="8 stages, fixed-point iteration"),
]


@pytest.mark.thorough
@pytest.mark.parametrize("solver", GAUSS)
@pytest.mark.parametrize("steps", [40, 80, 400])
def test_gauss_keeps_the_norm_at_any_step_size(solver, steps):
    assert off_the_sphere(turn(solver, steps)) < 6 * EPS * steps


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("solver", "loss"),
    [(solvers.RadauIIA(3, root_finder=NEWTON), 1e-4), (diffrax.Tsit5(), 1e-5)],
    ids=["Radau IIA, 3 stages", "Tsit5"],
)
def test_other_methods_lose_it(solver, loss):
    assert off_the_sphere(turn(solver, 40)) > loss


@pytest.mark.thorough
def test_gauss_keeps_the_norm_of_a_wrong_solution():
    """So it is the method that keeps it, and not its accuracy."""
    solver = solvers.Gauss(2, root_finder=NEWTON)
    assert errors(solver, [40])[0] > 5e-3
    assert off_the_sphere(turn(solver, 40)) < 6 * EPS * 40


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("solver", "returns"),
    [
        (solvers.Gauss(2, root_finder=NEWTON), True),
        (solvers.Gauss(8, root_finder=FIXED_POINT), True),
        (solvers.RadauIIA(3, root_finder=NEWTON), False),
    ],
    ids=["Gauss, 2 stages", "Gauss, 8 stages", "Radau IIA, 3 stages"],
)
def test_symmetric_methods_return_to_the_start(solver, returns):
    """There and back again in the same steps undoes the errors of the way there."""
    steps = 80
    there = turn(solver, steps)[-1]
    back = turn(solver, steps, ENDS[::-1], there)[-1]
    distance = np.max(np.abs(back - orientation(0.0)))
    assert distance < 4 * EPS * steps if returns else distance > 1e-5


PROJECTED = [
    pytest.param(diffrax.Tsit5(), id="Tsit5"),
    pytest.param(solvers.RadauIIA(3, root_finder=NEWTON), id="Radau IIA, 3 stages"),
]


@pytest.mark.thorough
@pytest.mark.parametrize("solver", PROJECTED)
def test_projection_keeps_the_order(solver):
    projected, steps = solvers.Projected(solver, normalised), np.array([320, 480, 640])
    after = errors(projected, steps)
    assert observed_order(1 / steps, after) > 4.8
    assert after[-1] < 1.1 * errors(solver, steps)[-1]


@pytest.mark.thorough
@pytest.mark.parametrize("solver", PROJECTED)
def test_projected_dense_output_is_on_the_sphere_and_keeps_its_order(solver):
    projected, steps = solvers.Projected(solver, normalised), np.array([320, 480, 640])
    assert off_the_sphere(turn(projected, 320, WITHIN)) <= 2 * EPS
    assert off_the_sphere(turn(solver, 320, WITHIN)) > 1e-9
    assert observed_order(1 / steps, errors(projected, steps, WITHIN)) > 3.7


@pytest.mark.thorough
def test_projection_goes_with_step_size_control():
    solver, saveat = solvers.Projected(solvers.RadauIIA(3), normalised), diffrax.SaveAt(steps=True, dense=True)
    solution = solve(kinematics, solver, orientation(0.0), END, 1e-8, saveat=saveat, max_steps=1000)
    q = np.asarray(solution.ys)[np.isfinite(np.asarray(solution.ts))]
    assert off_the_sphere(q) <= 2 * EPS
    np.testing.assert_allclose(q[-1], orientation(END), rtol=0, atol=1e-6)
    at, later = 3.21, 7.65
    assert off_the_sphere(solution.evaluate(at)) <= 2 * EPS
    np.testing.assert_allclose(
        solution.evaluate(at, later), solution.evaluate(later) - solution.evaluate(at), rtol=0, atol=1e-15
    )
    np.testing.assert_allclose(solution.evaluate(at, later), orientation(later) - orientation(at), rtol=0, atol=1e-5)
