"""The contributions of each node of a collocation method, and of the end, to its equations, with derivatives.

Inequalities enter by complementary pairs: slack > 0, multiplier > 0, and slack · multiplier = µ, the conditions of an
interior point with the barrier µ, as functions of one free number s = slack − multiplier. They hold whatever s is (Chen
& Harker 1993, Kanzow 1996), so that Newton's method need not keep anything positive, and may start where an inequality
is violated.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .problem import AbstractControlProblem


def slack(s: Float[Array, " k"], barrier: Float[Array, ""]) -> Float[Array, " k"]:
    """(√(s² + 4 µ) + s) / 2."""
    return (jnp.sqrt(s**2 + 4 * barrier) + s) / 2


def multiplier(s: Float[Array, " k"], barrier: Float[Array, ""]) -> Float[Array, " k"]:
    """(√(s² + 4 µ) − s) / 2."""
    return slack(-s, barrier)


Vary = Callable[[Any, Float[Array, ""]], AbstractControlProblem]


class Term(NamedTuple):
    """Some terms of the equations F, with their derivatives by their own unknowns and by λ.

    - ``cost``: the contribution of a node to the mean of the running cost; 0 at the end.
    """

    cost: np.ndarray
    value: np.ndarray
    jacobian: np.ndarray
    by_parameter: np.ndarray


class Sizes(NamedTuple):
    """How many states, controls, end conditions and inequalities there are."""

    states: int
    controls: int
    conditions: int
    inequalities: int


def sizes(vary: Vary, problem: Any) -> Sizes:
    """Of vary(problem, λ)."""

    def parts(problem):
        at = vary(problem, jnp.zeros(()))
        u = jnp.zeros_like(at.initial, shape=(at.controls,))
        return at.initial, u, at.conditions(at.initial), at.inequalities(at.start, at.initial, u)

    return Sizes(*(part.size for part in jax.eval_shape(parts, problem)))


@functools.partial(jax.jit, static_argnums=(0, 1))
def at_nodes(vary: Vary, shape: Sizes, problem: Any, parameter, barrier, times, weights, steps, local) -> Term:
    """The derivatives of the Lagrangian by x, u and the costate of each node, and its complementarity.

    The Lagrangian of a node is w (cost − σ·g) + h λ·rate, with the inequalities g ≥ 0 and their multipliers σ, which
    are functions of the node's last unknowns s; these are found from w (slack(s) − g) = 0.
    """
    n, free = shape.states, 2 * shape.states + shape.controls

    def one(t, weight, h, local):
        def equations(local, parameter):
            at, s = vary(problem, parameter), local[free:]

            def lagrangian(local):
                x, u, costate = local[:n], local[n:-n], local[-n:]
                cost, g = weight * at.cost(t, x, u), at.inequalities(t, x, u)
                pushed = weight * jnp.sum(multiplier(s, barrier) * g)
                return cost - pushed + h * jnp.sum(costate * at.rate(t, x, u)), (cost, g)

            gradient, (cost, g) = jax.grad(lagrangian, has_aux=True)(local[:free])
            return jnp.concatenate([gradient, weight * (slack(s, barrier) - g)]), cost

        return _term(equations, local, parameter)

    return jax.vmap(one)(times, weights, steps, local)


@functools.partial(jax.jit, static_argnums=(0, 1))
def at_end(vary: Vary, shape: Sizes, problem: Any, parameter, local) -> Term:
    """The derivatives of the end conditions' term of the Lagrangian by x and the multipliers at the end."""
    n = shape.states

    def equations(local, parameter):
        def lagrangian(local):
            at, x, multipliers = vary(problem, parameter), local[:n], local[n:]
            return jnp.sum(multipliers * at.conditions(x)) - at.softness * jnp.sum(multipliers**2) / 2

        return jax.grad(lagrangian)(local), jnp.zeros_like(parameter)

    return _term(equations, local, parameter)


@functools.partial(jax.jit, static_argnums=0)
def initial(vary: Vary, problem: Any, parameter: Float[Array, ""]):
    """The initial state, and its derivative with respect to λ."""
    return jax.jvp(lambda parameter: vary(problem, parameter).initial, (parameter,), (jnp.ones_like(parameter),))


def _term(
    equations: Callable[..., tuple[Float[Array, " k"], Float[Array, ""]]],
    local: Float[Array, " k"],
    parameter: Float[Array, ""],
) -> Term:
    def with_itself(local, parameter):
        value, cost = equations(local, parameter)
        return value, (cost, value)

    # One derivative of one trace, because these programs take longer to compile than to run.
    (jacobian, by_parameter), (cost, value) = jax.jacfwd(with_itself, argnums=(0, 1), has_aux=True)(local, parameter)
    return Term(cost, value, jacobian, by_parameter)
