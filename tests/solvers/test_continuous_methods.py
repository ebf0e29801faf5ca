"""States within a step of an explicit method: their order, their ends, and where the field is evaluated for them."""

from typing import ClassVar

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.simulation.solvers import Gauss, Projected
from jaxball.simulation.solvers.dense.continuous import DenseOutput, continuous
from tests.solvers import rotating
from tests.solvers.fixed_steps import march, observed_order

ODE = diffrax.ODETerm(rotating.field)
ARGS = (3.0, 0.5)


class Classical(diffrax.AbstractERK):
    """The method of Kutta of order 4, with the slope at the end as fifth stage, and an error that estimates nothing."""

    tableau: ClassVar = diffrax.ButcherTableau(
        c=np.array([0.5, 0.5, 1.0, 1.0]),
        a_lower=tuple(np.array(row) for row in ([0.5], [0, 0.5], [0, 0, 1.0], [1 / 6, 1 / 3, 1 / 3, 1 / 6])),
        b_sol=np.array([1 / 6, 1 / 3, 1 / 3, 1 / 6, 0]),
        b_error=np.array([0, 0, 0, 1.0, -1.0]),
    )
    interpolation_cls: ClassVar = diffrax.ThirdOrderHermitePolynomialInterpolation.from_k

    def order(self, terms):
        return 4


# Methods, the order of the local error within a step, and lengths of steps; diffrax's own have 6, 5 and 4.
METHODS = [
    pytest.param(diffrax.Dopri8(), 8, (0.16, 0.08), id="Dopri8"),
    pytest.param(diffrax.Tsit5(), 6, (0.08, 0.02), id="Tsit5"),
    pytest.param(Classical(), 5, (0.04, 0.01), id="a method of one's own, of order 4"),
]


@pytest.mark.thorough
@pytest.mark.parametrize(("solver", "order", "lengths"), METHODS)
def test_orders_of_local_errors(solver, order, lengths):
    lengths = np.geomspace(*lengths, 4)
    errors = [march(solver, ODE, rotating.exact, h, 1, ARGS) for h in lengths]
    assert observed_order(lengths, [e.dense for e in errors]) > order - 0.3


def one_step(solver, asked=True, field=rotating.field, h=0.2):
    """The dense output of a step, where it ends, and the slopes there."""
    term, t0, t1, y0 = diffrax.ODETerm(field), jnp.asarray(0.1), jnp.asarray(0.1 + h), jnp.array([0.3, -0.4])
    state = solver.init(term, t0, t1, y0, jnp.array(ARGS))
    y1, _, info, _, _ = solver.step(term, t0, t1, y0, jnp.array(ARGS), state, False)
    output = DenseOutput.of(solver)
    info = output.info(info, term, t0, t1, jnp.array(ARGS), jnp.asarray(asked))
    return output.interpolation(t0=t0, t1=t1, **info), (t0, y0), (t1, y1)


@pytest.mark.parametrize("solver", [diffrax.Dopri8(), diffrax.Tsit5(), Classical()], ids=lambda s: type(s).__name__)
def test_values_and_slopes_at_the_ends_are_those_of_the_step(solver):
    curve, *ends = jax.jit(lambda: one_step(solver))()
    for t, y in ends:
        y_there, slope = jax.jvp(curve.evaluate, (t,), (jnp.ones_like(t),))
        np.testing.assert_allclose(y_there, y, rtol=0, atol=1e-15)
        np.testing.assert_allclose(slope, rotating.field(t, y, ARGS), rtol=0, atol=2e-13)


def test_a_step_in_which_nothing_is_asked_for_has_its_ends():
    line, *ends = jax.jit(lambda: one_step(diffrax.Dopri8(), asked=False))()
    for t, y in ends:
        np.testing.assert_allclose(line.evaluate(t), y, rtol=0, atol=1e-15)


@pytest.mark.thorough
def test_the_field_is_evaluated_within_the_step_alone():
    times = []

    def field(t, x, args):
        jax.debug.callback(lambda t: times.append(float(t)), t)
        return rotating.field(t, x, args)

    counts = []
    for asked in (True, False):
        times.clear()
        _, (t0, _), (t1, _) = one_step(diffrax.Dopri8(), asked, field)
        jax.effects_barrier()
        counts.append(len(times))
        assert min(times) >= t0
        assert max(times) <= t1
    assert counts[0] - counts[1] == len(continuous(diffrax.Dopri8()).nodes)


def test_what_needs_no_better_polynomial_keeps_its_own():
    for solver in (diffrax.Bosh3(), diffrax.Heun(), diffrax.Kvaerno5(), Gauss(4)):
        assert DenseOutput.of(solver)[:2] == (None, solver.interpolation_cls)


@pytest.mark.parametrize("kind", [diffrax.Dopri8, diffrax.Dopri5, diffrax.Tsit5, diffrax.Bosh3, diffrax.Heun])
def test_a_sketch_is_the_own_interpolation_of_a_method(kind):
    solver, rng = kind(), np.random.default_rng(3)
    y0, k = jnp.asarray(rng.normal(size=3)), jnp.asarray(rng.normal(size=(kind.tableau.num_stages, 3)))
    info = {"y0": y0, "y1": y0 + jnp.asarray(kind.tableau.b_sol) @ k, "k": k}
    own = solver.interpolation_cls(t0=jnp.asarray(2.0), t1=jnp.asarray(2.5), **info)
    times = jnp.asarray([2.0, 2.07, 2.3, 2.5])
    sketch = DenseOutput.of(solver).sketch(info, own, times)
    # Its powers come from Vandermonde's equations for ten places, whose condition number is 4e6.
    np.testing.assert_allclose(sketch, jax.vmap(own.evaluate)(times), rtol=0, atol=1e-8)


def test_what_is_projected_is_so_within_steps_too():
    solver = Projected(diffrax.Dopri8(), lambda y: y / jnp.sqrt(jnp.sum(y**2)))
    curve, _, (t1, y1) = one_step(solver)
    np.testing.assert_allclose(curve.evaluate(t1), y1, rtol=0, atol=1e-15)
    np.testing.assert_allclose(jnp.sum(curve.evaluate(t1 - 0.1) ** 2), 1.0, rtol=0, atol=1e-15)
