"""Runs beside solves of diffrax, modules of equinox and flax, and samplers of blackjax, against closed forms."""

import blackjax
import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import linen

from jaxball import Disk, DiskState, Ground, simulate

pytestmark = pytest.mark.thorough
DISK = Disk(mass=1.0, inertia=0.5)


def rolled(speed):
    """z = 2 v."""
    return simulate(DISK, [0.0, 2.0], DiskState(phidot=-speed)).state.z[-1]


def decayed(rate):
    """e^(−2 k), by diffrax."""
    term = diffrax.ODETerm(lambda t, y, k: -k * y)
    solution = diffrax.diffeqsolve(
        term,
        diffrax.Dopri5(),
        0.0,
        2.0,
        0.1,
        jnp.ones_like(rate),
        args=rate,
        stepsize_controller=diffrax.PIDController(rtol=1e-10, atol=1e-10),
    )
    return solution.ys[0]


@pytest.mark.long
def test_a_solve_of_diffrax_in_the_same_program():
    """The disk rolls with what has decayed: z = 2 e^(−2 k)."""
    rates = jnp.array([0.3, 0.7])
    places, slopes = jax.jit(jax.vmap(jax.value_and_grad(lambda k: rolled(decayed(k)))))(rates)
    np.testing.assert_allclose(places, 2.0 * jnp.exp(-2.0 * rates), rtol=1e-8)
    np.testing.assert_allclose(slopes, -4.0 * jnp.exp(-2.0 * rates), rtol=1e-7)


class Launcher(eqx.Module):
    weight: jax.Array
    bias: jax.Array
    power: int = eqx.field(static=True)

    def __call__(self, x):
        return self.weight * x**self.power + self.bias


def test_a_run_in_the_loss_of_an_equinox_module():
    """Of z = 2 (w x² + b) for places x, the mean of (z − 1)² has the slopes 4 ⟨(z − 1) (x², 1)⟩."""
    launcher, x = Launcher(jnp.asarray(0.4), jnp.asarray(0.1), power=2), jnp.array([0.5, 1.0, 1.5])

    @eqx.filter_jit
    @eqx.filter_value_and_grad
    def loss(launcher):
        return jnp.mean((jax.vmap(lambda x: rolled(launcher(x)))(x) - 1.0) ** 2)

    value, slopes = loss(launcher)
    missed = 2.0 * launcher(x) - 1.0
    np.testing.assert_allclose(value, jnp.mean(missed**2), rtol=1e-12)
    np.testing.assert_allclose(slopes.weight, 4.0 * jnp.mean(missed * x**2), rtol=1e-12)
    np.testing.assert_allclose(slopes.bias, 4.0 * jnp.mean(missed), rtol=1e-12)


def test_a_run_in_the_loss_of_a_flax_module():
    """Of z = 2 (w x + b), the mean of (z − 1)² has the slopes 4 ⟨(z − 1) (x, 1)⟩."""
    module, x = linen.Dense(1, param_dtype=jnp.float64), jnp.array([0.5, 1.0, 1.5])
    parameters = {"params": {"kernel": jnp.array([[0.4]]), "bias": jnp.array([0.2])}}

    @jax.jit
    @jax.value_and_grad
    def loss(parameters):
        speeds = module.apply(parameters, x[:, None])[:, 0]
        return jnp.mean((jax.vmap(rolled)(speeds) - 1.0) ** 2)

    value, slopes = loss(parameters)
    missed = 2.0 * (0.4 * x + 0.2) - 1.0
    np.testing.assert_allclose(value, jnp.mean(missed**2), rtol=1e-12)
    np.testing.assert_allclose(slopes["params"]["kernel"], [[4.0 * jnp.mean(missed * x)]], rtol=1e-12)
    np.testing.assert_allclose(slopes["params"]["bias"], [4.0 * jnp.mean(missed)], rtol=1e-12)


def test_blackjax_samples_the_posterior_of_a_slope():
    """A measured place z = ½ t² g sin α/(1 + k) leaves sin α a Gaussian; a state outside has no probability.

    500 correlated draws know the mean to some tenths of the width, and the width to some hundredths.
    """
    noise, measured, per_sine = 0.05, 1.9, 0.5 * 2.0**2 * 9.81 / 1.5

    def log_density(sine):
        inside = jnp.abs(sine) < 1.0
        disk = Disk(mass=1.0, inertia=0.5, gravity=9.81, ground=Ground(jnp.arcsin(jnp.where(inside, sine, 0.0))))
        z = simulate(disk, [0.0, 2.0], DiskState(), max_steps=64).state.z[-1]
        return jnp.where(inside, -0.5 * ((z - measured) / noise) ** 2, -jnp.inf)

    width = noise / per_sine
    kernel = blackjax.nuts(log_density, step_size=width, inverse_mass_matrix=jnp.ones(1))

    @jax.jit
    def draw(state, key):
        state, _ = kernel.step(key, state)
        return state, state.position

    draws = jax.lax.scan(draw, kernel.init(jnp.asarray(0.14)), jax.random.split(jax.random.key(0), 600))[1][100:]
    assert abs(jnp.mean(draws) - measured / per_sine) < 0.3 * width
    assert abs(jnp.std(draws) / width - 1) < 0.2
    assert jax.grad(log_density)(1.5) == 0.0
