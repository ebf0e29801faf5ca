"""The standard stiff problems against published end states, at a loose and a tight tolerance.

Equations and end states are those of :mod:`jaxball.bench.problems`, which names their sources and whose own tests
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

from jaxball.bench.problems import ALL
from jaxball.solvers import Gauss, MassMatrixTerm, RadauIIA, SimplifiedNewton, Trapezoidal, TRBDF2, explain

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
}

# rtol, and by how much the error may be larger
LOOSE, TIGHT = 1e-5, {"radau 3": 1e-8, "radau 5": 1e-10, "radau 7": 1e-11, "gauss 8": 1e-10}
COLLOCATION = [(solver, name) for solver in TIGHT for name in ODES if (solver, name) != ("gauss 8", "robertson")]
LOW_ORDER = [(solver, name) for solver in ("tr-bdf2", "trapezoidal") for name in ODES]
LOW_ORDER.remove(("trapezoidal", "robertson"))


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


def controller(rtol, atol):
    return diffrax.PIDController(rtol=rtol, atol=atol, norm=optimistix.max_norm)


@functools.cache
def program(solver):
    @jax.jit
    def run(index, x0, end, rtol, atol):
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            SOLVERS[solver],
            0.0,
            end,
            None,
            x0,
            args=index,
            stepsize_controller=controller(rtol, atol),
            max_steps=20_000,
            adjoint=diffrax.ForwardMode(),
            throw=False,
        )
        return solution.ys[0], solution.result

    return run


def error(solver, name, rtol):
    problem = ALL[name]
    n = len(problem.initial)
    x0 = np.zeros(SIZE)
    x0[:n] = problem.initial
    atol = rtol * problem.atol_over_rtol
    x, result = program(solver)(ODES.index(name), x0, *map(jnp.asarray, (problem.end, rtol, atol)))
    assert not explain(result)
    return problem.error(x[:n])


if __name__ == "__main__":
    import time
    for s in SOLVERS:
        for n in ODES:
            if (s,n) in COLLOCATION+LOW_ORDER:
                for tol in (1e-4,1e-5,1e-6, TIGHT.get(s,1e-7)):
                    t=time.time(); e=error(s,n,tol); print(s,n,tol,f"{e:.1e} ratio {e/tol:.1e} {time.time()-t:.1f}s",flush=True)
