"""Order of convergence, of the solution at the ends of steps and between them, on problems with a closed form."""

import diffrax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.simulation import solvers
from jaxball.simulation.solvers.interpolation import CubicHermite
from tests.solvers import rotating
from tests.solvers.fixed_steps import NEWTON, march, observed_order

ODE = diffrax.ODETerm(rotating.field)
DAE = solvers.MassMatrixTerm(rotating.field_with_algebraic, np.array([0.0, 1.0, 1.0]))
AUTONOMOUS, DRIVEN = 0.0, 0.5
SLOW, FAST = 3.0, 30.0

TRAPEZOIDAL, TR_BDF2 = solvers.Trapezoidal(root_finder=NEWTON), solvers.TRBDF2(root_finder=NEWTON)


def radau(stages):
    return solvers.RadauIIA(stages, root_finder=NEWTON)


def gauss(stages):
    return solvers.Gauss(stages, root_finder=NEWTON)


def runs(solver, steps, args, term=ODE, exact=rotating.exact, components=slice(None)):
    """The lengths of steps and the errors of runs over [0, 1]."""
    return [1 / n for n in steps], [march(solver, term, exact, 1.0, n, args, components) for n in steps]


# Methods, their order p, an angular velocity and numbers of steps for which errors lie between 1e-13 and 1e-3.
AT_ENDS = [
    pytest.param(radau(3), 5, SLOW, (16, 32, 64), id="Radau IIA, 3 stages", marks=pytest.mark.slow),
    pytest.param(radau(5), 9, FAST, (48, 64, 80), id="Radau IIA, 5 stages"),
    pytest.param(radau(7), 13, FAST, (20, 24, 32), id="Radau IIA, 7 stages", marks=pytest.mark.slow),
    pytest.param(gauss(2), 4, SLOW, (16, 32, 64), id="Gauss, 2 stages", marks=pytest.mark.slow),
    pytest.param(gauss(3), 6, SLOW, (12, 24, 48), id="Gauss, 3 stages", marks=pytest.mark.slow),
    pytest.param(gauss(4), 8, FAST, (48, 64, 96), id="Gauss, 4 stages"),
    pytest.param(gauss(5), 10, FAST, (32, 48, 64), id="Gauss, 5 stages", marks=pytest.mark.slow),
    pytest.param(gauss(6), 12, FAST, (20, 24, 32), id="Gauss, 6 stages", marks=pytest.mark.slow),
    pytest.param(gauss(7), 14, FAST, (16, 20, 24), id="Gauss, 7 stages", marks=pytest.mark.slow),
    pytest.param(gauss(8), 16, FAST, (12, 14, 16), id="Gauss, 8 stages", marks=pytest.mark.slow),
    pytest.param(TRAPEZOIDAL, 2, SLOW, (32, 64, 128), id="trapezoidal rule"),
    pytest.param(TR_BDF2, 2, SLOW, (32, 64, 128), id="TR-BDF2"),
]


@pytest.mark.thorough
@pytest.mark.parametrize(("solver", "order", "omega", "steps"), AT_ENDS)
@pytest.mark.parametrize("drive", [AUTONOMOUS, DRIVEN])
def test_error_at_the_end_has_the_order_of_the_method(solver, order, omega, steps, drive):
    lengths, errors = runs(solver, steps, (omega, drive))
    assert solver.order(ODE) == order
    assert observed_order(lengths, [e.end for e in errors]) == pytest.approx(order, abs=0.35)


@pytest.mark.parametrize("drive", [AUTONOMOUS, DRIVEN])
def test_local_error_of_gauss_with_12_stages_has_order_25(drive):
    """An error above rounding needs more than one revolution a step: then a run of many steps is not asymptotic."""
    solver, omega = gauss(12), 100.0
    lengths = np.array([5.5, 6.0, 6.5, 7.0, 7.5]) / omega
    errors = [march(solver, ODE, rotating.exact, h, 1, (omega, drive)).end for h in lengths]
    assert max(errors) < 1e-8
    assert observed_order(lengths, errors) == pytest.approx(2 * 12 + 1, abs=0.9)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("solver", "steps"),
    [
        pytest.param(radau(5), (16, 32, 48), id="Radau IIA, 5 stages"),
        pytest.param(gauss(4), (16, 32, 64), id="Gauss, 4 stages"),
        pytest.param(gauss(8), (5, 6, 8), id="Gauss, 8 stages", marks=pytest.mark.slow),
    ],
)
def test_collocation_polynomial_has_order_s_plus_1_throughout_a_step(solver, steps):
    lengths, errors = runs(solver, steps, (SLOW, DRIVEN))
    assert observed_order(lengths, [e.dense for e in errors]) == pytest.approx(solver.stages + 1, abs=0.25)


@pytest.mark.parametrize("solver", [TRAPEZOIDAL, TR_BDF2], ids=["trapezoidal rule", "TR-BDF2"])
def test_hermite_cubic_is_as_accurate_between_the_steps_as_at_their_ends(solver):
    lengths, errors = runs(solver, (32, 64, 128), (SLOW, DRIVEN))
    assert observed_order(lengths, [e.dense for e in errors]) == pytest.approx(2, abs=0.1)
    assert max(e.dense / e.end for e in errors) < 1.5


def test_hermite_cubic_is_the_cubic_with_its_values_and_slopes():
    cubic = np.polynomial.Polynomial([0.3, -1.2, 2.0, 0.7])
    t0, t1 = 0.4, 1.9
    ends = jnp.array([t0, t1])
    y, k = jnp.asarray(cubic(ends)), jnp.asarray(cubic.deriv()(ends)) * (t1 - t0)
    between = CubicHermite(t0=ends[0], t1=ends[1], y0=y[0], y1=y[1], k0=k[0], k1=k[1])
    for t in np.linspace(t0, t1, 7):
        np.testing.assert_allclose(between.evaluate(jnp.asarray(t)), cubic(t), rtol=1e-14)
    np.testing.assert_allclose(between.evaluate(ends[0], jnp.asarray(1.1)), cubic(1.1) - cubic(t0), rtol=1e-14)


@pytest.mark.thorough
@pytest.mark.parametrize("components", [[0], [1, 2]], ids=["algebraic", "differential"])
@pytest.mark.parametrize("solver", [TRAPEZOIDAL, TR_BDF2], ids=["trapezoidal rule", "TR-BDF2"])
def test_methods_of_order_two_have_it_in_algebraic_variables_too(solver, components):
    lengths, errors = runs(solver, (400, 600, 800), (10.0, DRIVEN), DAE, rotating.exact_with_algebraic, components)
    assert observed_order(lengths, [e.end for e in errors]) == pytest.approx(2, abs=0.1)


@pytest.mark.thorough
@pytest.mark.parametrize("components", [[0], [1, 2]], ids=["algebraic", "differential"])
def test_radau_has_the_same_order_in_algebraic_variables(components):
    stages, steps = 5, (20, 24, 32)
    args = (10.0, DRIVEN)
    lengths, errors = runs(radau(stages), steps, args, DAE, rotating.exact_with_algebraic, components)
    assert observed_order(lengths, [e.end for e in errors]) == pytest.approx(2 * stages - 1, abs=0.35)
