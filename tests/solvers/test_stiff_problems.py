"""The standard stiff problems against published end states, at a loose and a tight tolerance.

Equations and end states are those of :mod:`comparison.problems`, which names their sources and whose own tests
compare the end states with the published ones and with collocation in 32 digits. Errors are relative, the largest
of all components. The bounds are 3 to 10 times what was measured.
"""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import pytest
from comparison.problems import ALL

from jaxball.simulation.solvers import (
    NDF,
    TRBDF2,
    Gauss,
    MassMatrixTerm,
    RadauIIA,
    SimplifiedNewton,
    Trapezoidal,
    explain,
)
from jaxball.simulation.solvers.multistep import controller_class
from tests.solvers import solving

ODES = ("robertson", "van-der-pol", "van-der-pol-scaled", "hires", "orego")
# Every problem as one of as many equations, most of them ẋ = 0, so that one program solves them all.
SIZE = max(len(ALL[name].initial) for name in ODES)

SOLVERS = {
    "radau 3": RadauIIA(3),
    "radau 5": RadauIIA(5),
    "radau 7": RadauIIA(7),
    "gauss 8": Gauss(8, root_finder=SimplifiedNewton()),
    "tr-bdf2": TRBDF2(),
    "trapezoidal": Trapezoidal(),
    "ndf": NDF(),
    "bdf": NDF(kappa="bdf"),
}

# Solvers of high order: at this tolerance, the error of a problem …
LOOSE = 1e-5
LOOSE_BOUNDS = {
    "robertson": 1e-6,
    "robertson-dae": 1e-6,
    "van-der-pol": 5e-6,
    "van-der-pol-scaled": 5e-6,
    "hires": 1e-5,
    "orego": 4e-5,
}
# … and at the tight tolerance of a solver, the error of any problem.
TIGHT = {"radau 3": 1e-8, "radau 5": 1e-10, "radau 7": 1e-11, "gauss 8": 1e-10}
TIGHT_BOUNDS = {"radau 3": 3e-9, "radau 5": 3e-10, "radau 7": 5e-11, "gauss 8": 5e-11}
# Solvers of order 2: the error is proportional to the tolerance to the power 2/3, with these factors.
FACTORS = {"robertson": 2.0, "van-der-pol": 6.0, "van-der-pol-scaled": 6.0, "hires": 15.0, "orego": 40.0}
# Solvers of variable order up to 5: the error is nearly proportional to the tolerance, which is that of a step.
MULTISTEP_FACTORS = {
    "robertson": 100.0,
    "robertson-dae": 100.0,
    "van-der-pol": 100.0,
    "van-der-pol-scaled": 150.0,
    "hires": 100.0,
    "orego": 500.0,
}

# Without damping of stiff components, |R(∞)| = 1, Robertson's problem takes 1e5 steps and more.
UNDAMPED = (("gauss 8", "robertson"), ("trapezoidal", "robertson"))
HIGH_ORDER = [(solver, name) for solver in TIGHT for name in ODES if (solver, name) not in UNDAMPED]
SECOND_ORDER = [
    (solver, name) for solver in ("tr-bdf2", "trapezoidal") for name in ODES if (solver, name) not in UNDAMPED
]


def rates(name):
    """The rates as a function of the state."""
    problem = ALL[name]
    g = problem.right_hand_side(problem.pieces[0])
    f = conserving(problem) if name.startswith("robertson") else lambda x: g(0.0, x, (), jnp)
    n = len(problem.initial)
    return lambda x: jnp.stack(f(list(x[:n])))


def conserving(problem):
    """Robertson's rates with a sum of exactly zero, in the compiled program too.

    XLA makes fused multiply-adds of the products, each in its own way, after which the rates sum to the rounding of
    the largest. At t = 1e11 the sum of the concentrations then drifts as fast as the solution does to 1e-8.
    """

    def f(x):
        g = problem.right_hand_side(problem.pieces[0])(0.0, x, (), jnp)
        _, B, C = problem.rates(0.0, x, (), jnp)
        return [-(B + C), *g[1:]]

    return f


def padded(name):
    f = rates(name)
    return lambda x: jnp.zeros_like(x).at[: len(ALL[name].initial)].set(f(x))


def field(t, x, index):
    return jax.lax.switch(index, [padded(name) for name in ODES], x)


def dae():
    """Robertson's problem with the conservation of mass in the place of the third rate."""
    problem = ALL["robertson-dae"]
    return MassMatrixTerm(lambda t, x, _: rates(problem.name)(x), np.asarray(problem.mass(problem.pieces[0])))


def ode():
    """Any of the other problems, by its index."""
    return diffrax.ODETerm(field)


@functools.cache
def program(solver, make_term=ode):
    @jax.jit
    def run(index, x0, end, rtol, atol):
        # The norm is one that components at rest do not change.
        controller = controller_class(SOLVERS[solver])(rtol=rtol, atol=atol, norm=optimistix.max_norm)
        options = {"stepsize_controller": controller, "max_steps": 20_000, "throw": False}
        solution = solving.solve(make_term(), SOLVERS[solver], x0, end, args=index, **options)
        return solution.ys[0], solution.result

    return run


def solve(solver, name, rtol):
    """The state at the end, and how the solve ended."""
    problem = ALL[name]
    x0 = np.zeros(SIZE)
    x0[: len(problem.initial)] = problem.initial
    x, result = program(solver)(ODES.index(name), x0, *numbers(problem, rtol))
    return x[: len(problem.initial)], explain(result)


def numbers(problem, rtol):
    return map(jnp.asarray, (problem.end, rtol, rtol * problem.atol_over_rtol))


def error(solver, name, rtol):
    x, sentence = solve(solver, name, rtol)
    assert not sentence
    return ALL[name].error(x)


@pytest.mark.long
@pytest.mark.parametrize(("solver", "name"), HIGH_ORDER)
def test_end_state_at_a_loose_tolerance(solver, name):
    assert error(solver, name, LOOSE) < LOOSE_BOUNDS[name]


@pytest.mark.thorough
@pytest.mark.parametrize(("solver", "name"), HIGH_ORDER)
def test_end_state_at_a_tight_tolerance(solver, name):
    assert error(solver, name, TIGHT[solver]) < TIGHT_BOUNDS[solver]


@pytest.mark.long
@pytest.mark.parametrize("rtol", [1e-5, 1e-7])
@pytest.mark.parametrize(("solver", "name"), SECOND_ORDER)
def test_end_state_by_methods_of_order_two(solver, name, rtol):
    assert error(solver, name, rtol) < FACTORS[name] * rtol ** (2 / 3)


@pytest.mark.long
@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("solver", ["ndf", "bdf"])
@pytest.mark.parametrize("name", ODES)
def test_end_state_by_methods_of_variable_order(solver, name, rtol):
    assert error(solver, name, rtol) < MULTISTEP_FACTORS[name] * rtol


@pytest.mark.thorough
@pytest.mark.parametrize(("solver", "name"), UNDAMPED)
def test_methods_that_damp_nothing_say_so(solver, name):
    """They are A-stable and not L-stable; what they give up at is no success."""
    _, sentence = solve(solver, name, LOOSE)
    assert "has taken all its steps" in sentence


@pytest.mark.long
@pytest.mark.parametrize("solver", ["radau 3", "radau 5", "radau 7", "ndf"])
def test_robertsons_algebraic_equation(solver):
    problem = ALL["robertson-dae"]
    bounds = {rtol: rtol * MULTISTEP_FACTORS[problem.name] for rtol in (LOOSE, 1e-7)}
    if solver in TIGHT:
        bounds = {LOOSE: LOOSE_BOUNDS[problem.name], TIGHT[solver]: TIGHT_BOUNDS[solver]}
    for rtol, bound in bounds.items():
        x, result = program(solver, dae)(0, np.asarray(problem.initial), *numbers(problem, rtol))
        assert not explain(result)
        assert problem.error(x) < bound
        # It is linear, and so holds to the rounding of Newton's last system: 7e-15 was seen.
        assert abs(problem.constraint(list(map(float, x)))) < 5e-14
