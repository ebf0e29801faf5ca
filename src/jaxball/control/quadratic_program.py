"""The quadratic program of a linear system over a horizon, solved by an interior-point method stage by stage.

``prediction`` solves one in each sample.

It is the elastic program, which always has a solution: each limit L G (ξ, δu) ≤ d may be exceeded by s ≥ 0 at the cost
``penalty`` s. Where the limits can be kept and the penalty exceeds their multipliers, nothing is exceeded. Steps are
those of Mehrotra's predictor and corrector; each is a linear quadratic regulator, whose recursion takes a time in
proportion to the horizon. Sources: Mehrotra, *SIAM J. Optim.* 2 (1992) 575; Rao, Wright & Rawlings, *J. Optim. Theory
Appl.* 99 (1998) 723.

Derivatives, in both modes, are those of the solution: of one more of these steps, from the solution, in which the
optimality conditions change (the implicit function theorem). They do not go through the iterations.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..numerics.linear import inverses

MOST_ITERATIONS = 40
TO_BOUNDARY = 0.995  # the share of the way to the nearest bound that a step may go
CLOSED_GAP = 1e-9  # of the cost, below which the gap between the program and its dual counts as closed
SLACK = 0.1  # at the start, in units of limits, beyond what is exceeded there
CENTRED_PRODUCTS = 1.0  # of the cost: the sum of the products of slacks and multipliers at the start
EXCEEDED = 1e-6  # in units of a limit, above which it counts as exceeded


class Stages(NamedTuple):
    """The stages of a program, H of them along the first axis.

    - ``A``, ``B``, ``c``: the flow, ξ⁺ = A ξ + B δu + c.
    - ``K``, ``k``: the regulator δu = −K ξ − k that has the least cost without limits.
    - ``M``: the cost of a stage is (ξ, δu)·M (ξ, δu), shape (n + m, n + m).
    - ``end``: the cost at the end is (ξ, 1)·end (ξ, 1).
    - ``G``, ``L``, ``d``: the limits of a stage, L G (ξ, δu) ≤ d, where G has few rows and L is that of all stages.
    - ``penalty``: of exceeding a limit by 1.
    """

    A: Float[Array, "H n n"]
    B: Float[Array, "H n m"]
    c: Float[Array, "H n"]
    K: Float[Array, "H m n"]
    k: Float[Array, "H m"]
    M: Float[Array, "n_plus_m n_plus_m"]
    end: Float[Array, "n_plus_one n_plus_one"]
    G: Float[Array, "H q n_plus_m"]
    L: Float[Array, "p q"]
    d: Float[Array, "H p"]
    penalty: Float[Array, ""]

    @property
    def n(self) -> int:
        """The number of deviations."""
        return self.A.shape[-1]

    def after(self, z: Float[Array, "H n_plus_m"]) -> Float[Array, " n"]:
        """Computes ξ at the end."""
        return self.A[-1] @ z[-1, : self.n] + self.B[-1] @ z[-1, self.n :] + self.c[-1]

    def rows(self, z: Float[Array, "H n_plus_m"]) -> Float[Array, "H p"]:
        """Computes L G (ξ, δu)."""
        return jnp.sum(self.G * z[:, None], axis=-1) @ self.L.T

    def pull_back(self, multipliers: Float[Array, "H p"]) -> Float[Array, "H n_plus_m"]:
        """Computes Gᵀ Lᵀ λ."""
        return jnp.sum(self.G * (multipliers @ self.L)[..., None], axis=1)

    def beyond(self, z: Float[Array, "H n_plus_m"]) -> Float[Array, "H p"]:
        """Computes L G (ξ, δu) − d."""
        return self.rows(z) - self.d

    def follow(self, plan: Float[Array, "H n_plus_m"] | None, xi: Float[Array, " n"]) -> Float[Array, "H n_plus_m"]:
        """Follows the flow of (ξ, δu) from ``xi``: of the regulator, or of a plan and what the regulator adds to it."""
        n = self.n

        def onward(xi: Array, stage: Any) -> Any:
            A, B, c, K, k, planned = stage
            u = -K @ xi - k if plan is None else planned[n:] - K @ (xi - planned[:n])
            return A @ xi + B @ u + c, jnp.concatenate([xi, u])

        return jax.lax.scan(onward, xi, (self.A, self.B, self.c, self.K, self.k, self.K if plan is None else plan))[1]

    def cost(self, z: Float[Array, "H n_plus_m"]) -> Float[Array, ""]:
        """Computes the cost, without the cost of exceeding limits."""
        end = jnp.append(self.after(z), 1.0)
        return jnp.sum((z @ self.M) * z) + end @ self.end @ end

    def gradient(self, z: Float[Array, "H n_plus_m"]) -> tuple[Float[Array, "H n_plus_m"], Float[Array, " n"]]:
        """Computes the gradient of the cost of each stage, and of the cost at the end."""
        n = self.n
        return 2 * z @ self.M, 2 * (self.end[:n, :n] @ self.after(z) + self.end[:n, n])


class Plan(NamedTuple):
    """The solution of a program.

    - ``z``: (ξ, δu) of each stage.
    - ``multipliers``: of the limits, from 0 to the penalty.
    - ``exceeded``: by how much each limit is; 0 where it is kept.
    - ``iterations``: how many; 0 where the regulator without limits keeps them.
    - ``closed``: whether the gap between the program and its dual is.
    """

    z: Float[Array, "H n_plus_m"]
    multipliers: Float[Array, "H p"]
    exceeded: Float[Array, "H p"]
    iterations: Int[Array, ""]
    closed: Bool[Array, ""]


class _Point(NamedTuple):
    """A point of the interior: each limit has the slack t = d − L G z + s > 0 and is exceeded by s > 0.

    Their multipliers λ and ν add up to the penalty.
    """

    z: Float[Array, "H n_plus_m"]
    t: Float[Array, "H p"]
    s: Float[Array, "H p"]
    λ: Float[Array, "H p"]
    ν: Float[Array, "H p"]

    @property
    def gap(self) -> Float[Array, ""]:
        """λ·t + ν·s."""
        return jnp.sum(self.λ * self.t) + jnp.sum(self.ν * self.s)


def solve_stages(stages: Stages, xi: Float[Array, " n"], guess: Plan | None = None) -> Plan:
    """Finds the plan from the deviation ``xi``; ``guess`` is one near it, such as the last one, shifted by a stage."""
    unlimited = stages.follow(None, xi)
    # The regulator without limits is the solution wherever it keeps them: no iteration, and the same numbers.
    feasible = jnp.max(stages.beyond(unlimited)) <= 0
    # Through the iterations there would be many steps to differentiate, and no derivatives in reverse mode.
    solution, count, closed = _iterate(*jax.lax.stop_gradient((stages, xi, unlimited, feasible, guess)))
    point = _differentiable(stages, xi, solution)
    z = jnp.where(feasible, unlimited, point.z)
    beyond = stages.beyond(z)
    exceeded = jnp.where(beyond > EXCEEDED, beyond, 0.0)
    return Plan(z, jnp.where(feasible, 0.0, point.λ), exceeded, count, closed)


def _iterate(
    stages: Stages, xi: Array, unlimited: Array, feasible: Bool[Array, ""], guess: Plan | None
) -> tuple[_Point, Int[Array, ""], Bool[Array, ""]]:
    """Iterates to the solution; also returns the number of iterations, and whether the gap is closed."""
    z = unlimited if guess is None else stages.follow(guess.z, xi)
    # The least cost without limits is never above that with limits, and a scale for the gap.
    cost = stages.cost(unlimited)
    point = _inside(stages, z, CENTRED_PRODUCTS * cost / stages.d.size, 0.0 if guess is None else guess.multipliers)

    def is_unfinished(carry: Any) -> Bool[Array, ""]:
        point, count = carry
        return ~feasible & (point.gap > CLOSED_GAP * cost) & (count < MOST_ITERATIONS)

    def step(carry: Any) -> Any:
        point, count = carry
        return _advance(stages, point), count + 1

    point, count = jax.lax.while_loop(is_unfinished, step, (point, jnp.asarray(0)))
    return point, count, feasible | (point.gap <= CLOSED_GAP * cost)


def _differentiable(stages: Stages, xi: Float[Array, " n"], solution: _Point) -> _Point:
    """Returns the solution with its derivatives by the stages and ``xi``: the change of a step that keeps to the
    conditions.
    """
    n, (z, t, s, λ, ν) = stages.n, solution
    # Slacks and multipliers are eliminated from the step; this weight of each limit is what remains of them.
    D = 1 / (t / λ + s / ν)
    factors = _factorise(stages, D)
    # By how much the flow, the slacks and the multipliers miss their conditions: 0, but not their derivatives.
    onward = jnp.einsum("hij,hj->hi", stages.A, z[:, :n]) + jnp.einsum("hij,hj->hi", stages.B, z[:, n:]) + stages.c
    missed = jnp.concatenate([(xi - z[0, :n])[None], onward[:-1] - z[1:, :n]])
    b = (s / ν) * (stages.penalty - λ - ν) - (stages.d - stages.rows(z) + s - t)

    def follow(before: Array, stage: Any) -> Any:
        K, closed, missed = stage
        now = before + missed
        return closed @ now, jnp.concatenate([now, -K @ now])

    end, moved = jax.lax.scan(follow, jnp.zeros_like(xi), (factors.K, factors.closed, missed))
    of_stages, of_end = stages.gradient(z)
    of_stages = of_stages + 2 * moved @ stages.M + stages.pull_back(λ + D * (b + stages.rows(moved)))
    dz = moved + _minimise(stages, factors, (of_stages, of_end + 2 * stages.end[:n, :n] @ end))
    dλ = D * (stages.rows(dz) + b)
    # The difference is 0, and has the derivatives of the step.
    change = jax.tree.map(lambda x: x - jax.lax.stop_gradient(x), (dz, dλ))
    return solution._replace(z=z + change[0], λ=λ + change[1])


def _inside(stages: Stages, z: Array, product: Array, multipliers: Array | float) -> _Point:
    """Returns a point of the interior at z, with multipliers near ``multipliers``, whose products with slacks are no
    less than ``product``, as far as the penalty allows.
    """
    beyond = stages.beyond(z)
    # Far enough from the boundary that a first step is not cut short; multipliers of the last plan are kept where
    # they allow it.
    s = jnp.maximum(beyond, 0.0) + SLACK
    t = s - beyond
    # Between 0 and the penalty, or the other multiplier, which is the rest, would not be positive.
    λ = jnp.minimum(jnp.maximum(multipliers, product / t), 0.5 * stages.penalty)
    return _Point(z, t, s, λ, stages.penalty - λ)


class _Factors(NamedTuple):
    """What the regulator of a step keeps: its gains, (R + Bᵀ P B)⁻¹, A − B K, and P at the end of the stage."""

    K: Float[Array, "H m n"]
    inverse: Float[Array, "H m m"]
    closed: Float[Array, "H n n"]
    P: Float[Array, "H n n"]


def _factorise(stages: Stages, weights: Float[Array, "H p"]) -> _Factors:
    """Factorises the quadratic cost ½ z·(2 M + Gᵀ Lᵀ diag(weights) L G) z."""
    n = stages.n
    # G has few rows and L many, hence products with LᵀDL, of the size of G's rows.
    within = jnp.sum(stages.L[None, :, :, None] * (weights[..., None] * stages.L[None])[:, :, None], axis=1)

    def step(P: Array, stage: Any) -> Any:
        A, B, G, within = stage
        hessian = 2 * stages.M + G.T @ (within @ G)
        PA, PB = P @ A, P @ B
        mixed = hessian[n:, :n] + B.T @ PA
        inverse = inverses((hessian[n:, n:] + B.T @ PB)[None])[0]
        K = inverse @ mixed
        before = hessian[:n, :n] + A.T @ PA - mixed.T @ K
        # Rounding would make the matrix less symmetric with each stage.
        return 0.5 * (before + before.T), _Factors(K, inverse, A - B @ K, P)

    return jax.lax.scan(step, 2 * stages.end[:n, :n], (stages.A, stages.B, stages.G, within), reverse=True)[1]


def _minimise(stages: Stages, factors: _Factors, gradient: tuple[Array, Array]) -> Array:
    """Finds the change of z with the least of the factorised cost, with these gradients, where ξ at first is fixed."""
    n, (of_stages, of_end) = stages.n, gradient

    def back(p: Array, stage: Any) -> Any:
        factors, B, g = stage
        k = factors.inverse @ (g[n:] + B.T @ p)
        return g[:n] - factors.K.T @ g[n:] + factors.closed.T @ p, k

    def onward(xi: Array, stage: Any) -> Any:
        factors, B, k = stage
        return factors.closed @ xi - B @ k, jnp.concatenate([xi, -factors.K @ xi - k])

    k = jax.lax.scan(back, of_end, (factors, stages.B, of_stages), reverse=True)[1]
    return jax.lax.scan(onward, jnp.zeros_like(of_end), (factors, stages.B, k))[1]


def _advance(stages: Stages, point: _Point) -> _Point:
    """Takes a step: one towards the solution, and one that corrects it to second order, from one factor."""
    z, t, s, λ, ν = point
    D = 1 / (t / λ + s / ν)
    factors = _factorise(stages, D)
    of_stages, of_end = stages.gradient(z)

    def direction(r1: Array, r2: Array) -> _Point:
        """Computes the change that makes λ t and ν s what these residuals ask for, to first order."""
        b = r1 / λ - r2 / ν
        dz = _minimise(stages, factors, (of_stages + stages.pull_back(λ + D * b), of_end))
        dλ = D * (stages.rows(dz) + b)
        return _Point(dz, (r1 - t * dλ) / λ, (r2 + s * dλ) / ν, dλ, -dλ)

    affine = direction(-t * λ, -s * ν)
    # Mehrotra's centring: the cube of the share of the gap that remains after the first step. There are two products
    # for each limit.
    target = (_move(point, affine, _longest(point, affine)).gap / point.gap) ** 3 * point.gap / (2 * t.size)
    # Products of the first step's changes are what it neglected.
    step = direction(target - t * λ - affine.t * affine.λ, target - s * ν - affine.s * affine.ν)
    # To the boundary would leave a slack or a multiplier of 0, from which steps no longer move.
    return _move(point, step, jnp.minimum(TO_BOUNDARY * _longest(point, step), 1.0))


def _move(point: _Point, step: _Point, length: Array) -> _Point:
    return jax.tree.map(lambda x, dx: x + length * dx, point, step)


def _longest(point: _Point, step: _Point) -> Float[Array, ""]:
    """Returns the longest step that leaves slacks and multipliers positive, at most 1 / ``TO_BOUNDARY``."""
    shares = [
        # The inner `where` keeps a division by 0 out of the branch that is not chosen.
        jnp.min(jnp.where(dx < 0, -x / jnp.where(dx < 0, dx, -1.0), jnp.inf))
        for x, dx in zip(point[1:], step[1:], strict=True)
    ]
    return jnp.minimum(jnp.min(jnp.stack(shares)), 1 / TO_BOUNDARY)
