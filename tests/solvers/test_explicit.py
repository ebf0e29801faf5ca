"""The rule by which steps of explicit methods are pulled back, against JAX's derivatives of diffrax's own steps."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.programs.derivatives.reverse_rules import with_rule
from jaxball.simulation.solvers import Projected
from jaxball.simulation.solvers.explicit import depends_on_arguments_alone, with_stages_pulled_back
from jaxball.simulation.solvers.wrapping import ProjectedSteps

TERMS = diffrax.ODETerm(lambda t, y, args: jnp.sin(args[0] * y[::-1] + t) * args[1] - y * t)
Y, SLOPE = jnp.array([0.3, -1.2]), jnp.array([0.7, 0.1])
ARGS = jnp.array(1.3), jnp.array([0.4, 0.9])
METHODS = [diffrax.Dopri8(), diffrax.Tsit5(), diffrax.Bosh3(), diffrax.Ralston(), diffrax.Midpoint()]


def carried_out(function, pull, operands):
    def forward(operands, varies):
        results = function(operands)
        return results, (operands, results)

    return with_rule(function, forward, pull)(operands)


def results(solver, t0, t1, y, slope, args, fresh):
    state = solver.init(TERMS, t0, t1, y, args)
    state = None if state is None else (fresh, slope)
    y1, error, info, state, _ = solver.step(TERMS, t0, t1, y, args, state, False)
    return y1, error, info["k"], None if state is None else state[1]


def cotangents(like):
    random = np.random.default_rng(0)
    return jax.tree.map(lambda x: jnp.asarray(random.normal(size=x.shape)), like)


@pytest.mark.long
@pytest.mark.parametrize("fresh", [False, True])
@pytest.mark.parametrize("solver", METHODS, ids=lambda solver: type(solver).__name__)
def test_all_cotangents_are_those_of_the_step(solver, fresh):
    def pulled(solver):
        given = jnp.asarray(0.2), jnp.asarray(0.7), Y, SLOPE, ARGS
        found, pull = jax.vjp(lambda *given: results(solver, *given, jnp.asarray(fresh)), *given)
        return found, pull(cotangents(found))

    own, theirs = jax.jit(pulled, static_argnums=0)(with_stages_pulled_back(solver, carried_out)), pulled(solver)
    for one, other in zip(jax.tree.leaves(own), jax.tree.leaves(theirs), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-14)  # sums of up to 14 stages


def test_what_does_not_vary_is_left_out():
    """The derivative with respect to the time is not computed where times do not vary: here there is none."""

    @jax.custom_jvp
    def without_derivative(t):
        return t

    @without_derivative.defjvp
    def _(primals, tangents):
        raise AssertionError("The time does not vary.")

    terms = diffrax.ODETerm(lambda t, y, args: args * y * without_derivative(t))
    solver = with_stages_pulled_back(diffrax.Tsit5(), carried_out)

    def end(y):
        return jnp.sum(solver.step(terms, jnp.asarray(0.0), jnp.asarray(0.1), y, 2.0, (False, SLOPE), False)[0])

    assert np.all(np.isfinite(jax.grad(end)(Y)))


@pytest.mark.thorough
def test_solvers_that_wrap_a_method_and_others():
    projected = Projected(diffrax.Tsit5(), lambda y: y / jnp.sqrt(jnp.sum(y**2)))
    at_times = ProjectedSteps(diffrax.Tsit5(), lambda t, y, args: y / jnp.sqrt(jnp.sum(y**2)) * (1 + t * args[0]))

    def end(solver, y, args):
        return solver.step(TERMS, jnp.asarray(0.0), jnp.asarray(0.1), y, args, (jnp.asarray(True), SLOPE), False)[0]

    np.testing.assert_allclose(jnp.sum(end(at_times, Y, ARGS) ** 2), (1 + 0.1 * 1.3) ** 2, rtol=1e-14)
    for solver in (projected, at_times):
        own = with_stages_pulled_back(solver, carried_out)
        pulled = [jax.tree.leaves(jax.jacrev(lambda *at, s=s: end(s, *at), (0, 1))(Y, ARGS)) for s in (own, solver)]
        for one, other in zip(*pulled, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-15)
    implicit = diffrax.Kvaerno3()
    assert with_stages_pulled_back(implicit, carried_out) is implicit


def test_fields_of_more_than_their_arguments_are_told():
    def alone(p, within):
        terms = diffrax.ODETerm(lambda t, y, args: (p if within else args) * y)
        return depends_on_arguments_alone(terms, jnp.asarray(0.0), Y, p)

    told = []
    jax.jit(lambda p: told.extend([alone(p, False), alone(p, True)]))(2.0)
    assert told == [True, False]
