"""The equations that the stages of one step satisfy, and the contract of an iteration that solves them."""

import abc
from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from .mass import Mass
from .tableau import Tableau

# The placeholder for the settings of the step-size controller, as diffrax uses it in its own solvers.
FROM_CONTROLLER = diffrax.ImplicitEuler().root_finder.rtol  # pyright: ignore[reportAttributeAccessIssue]


class StageEquations(eqx.Module):
    """M Zᵢ = Σⱼ aᵢⱼ Kⱼ + known with Kⱼ = h g(tⱼ, x₀ + Zⱼ), for the increments Zᵢ = Xᵢ − x₀ of the s stages.

    ``slope(t, x)`` is h g(t, x) and ``control`` is h. ``known`` is the contribution of stages solved before; none for
    collocation methods. ``f0`` is h g(t₀, x₀), if the step before provided it.
    """

    tableau: Tableau = eqx.field(static=True)
    slope: Callable[[Float[Array, ""], Float[Array, " n"]], Float[Array, " n"]]
    t0: Float[Array, ""]
    times: Float[Array, " s"]
    x0: Float[Array, " n"]
    control: Float[Array, ""]
    unravel: Callable[[Float[Array, " n"]], PyTree[Array]] = eqx.field(static=True)
    mass: Mass | None = None
    known: Float[Array, "s n"] | None = None
    f0: Float[Array, " n"] | None = None

    def slopes(self, Z: Float[Array, "s n"]) -> Float[Array, "s n"]:
        """K for given Z."""
        return jax.vmap(lambda t, z: self.slope(t, self.x0 + z))(self.times, Z)

    def right_side(self, K: Float[Array, "s n"]) -> Float[Array, "s n"]:
        """A K + known: Z for given K where there is no mass matrix."""
        return self.with_known(combine(self.tableau.A, K))

    def with_known(self, AK: Float[Array, "s n"]) -> Float[Array, "s n"]:
        """``AK`` plus ``known``."""
        return AK if self.known is None else AK + self.known

    def without_known(self, Z: Float[Array, "s n"]) -> Float[Array, "s n"]:
        """``Z`` minus ``known``."""
        return Z if self.known is None else Z - self.known

    def mass_times(self, Z: Float[Array, "s n"]) -> Float[Array, "s n"]:
        """M Z of all stages."""
        return Z if self.mass is None else self.mass.times(Z)

    def mass_matrix(self) -> Float[Array, "n n"]:
        """M."""
        return jnp.eye(self.x0.size, dtype=self.x0.dtype) if self.mass is None else self.mass.matrix

    def residual(self, Z: Float[Array, "s n"]) -> Float[Array, "s n"]:
        """M Z − A K(Z) − known, which is zero at the solution."""
        return self.mass_times(Z) - self.right_side(self.slopes(Z))


class Memory(eqx.Module):
    """The state that the iteration of one step passes to the next.

    ``rate``: the ratio of the last change to the one before; 1 if nothing is known.
    ``inverses``: of the matrices λM − h∂g/∂x for the k modes, made for the step length ``control``, where there are
    any; ``imaginary``: the imaginary parts, where they have some.
    """

    rate: Float[Array, ""]
    inverses: Float[Array, "k n n"] | None = None
    imaginary: Float[Array, "k n n"] | None = None
    control: Float[Array, ""] | None = None

    def forgotten(self, when: Bool[Array, ""] | bool) -> "Memory":
        """The memory after a jump."""
        return eqx.tree_at(lambda m: m.rate, self, jnp.where(when, 1.0, self.rate))


class Stages(eqx.Module):
    """The stages of a step, solved or given up.

    ``K`` are the slopes at the nodes of the polynomial through x₀ and the stages, in units of 1/h.
    ``singular`` says that the iteration met a singular matrix. For the error estimate, ``smooth`` is
    (γM − h∂g/∂x)⁻¹ and ``f0`` is h g(t₀, x₀), where the iteration has them.
    """

    Z: Float[Array, "s n"]
    K: Float[Array, "s n"]
    converged: Bool[Array, ""]
    singular: Bool[Array, ""]
    memory: Memory
    smooth: Float[Array, "n n"] | None = None
    f0: Float[Array, " n"] | None = None


class AbstractStageIteration(eqx.Module):
    """The method for solving the equations of the stages. It takes the place of diffrax's root finder.

    ``rtol``, ``atol`` and ``norm`` define what is small; diffrax puts those of its step-size controller here.
    """

    max_steps: eqx.AbstractVar[int]
    rtol: eqx.AbstractVar[Any]
    atol: eqx.AbstractVar[Any]
    norm: eqx.AbstractVar[Any]

    @abc.abstractmethod
    def start(self, tableau: Tableau, x0: Float[Array, " n"]) -> Memory:
        """The memory before the first step."""

    @abc.abstractmethod
    def iterate(self, equations: StageEquations, guess: Float[Array, "s n"], memory: Memory) -> Stages:
        """The stages, from a ``guess`` of the slopes K and what the step before left."""

    @abc.abstractmethod
    def tangents(
        self, equations: StageEquations, stages: Stages, changes: StageEquations
    ) -> tuple[Float[Array, "s n"], Float[Array, "s n"]]:
        """The changes of Z and K, to first order, when the equations change."""

    def solve(self, equations: StageEquations, guess: Float[Array, "s n"], memory: Memory) -> Stages:
        """:meth:`iterate`, whose derivatives come from the implicit function theorem."""
        return _solve(self, equations, guess, memory)

    def size(self, equations: StageEquations, change: Float[Array, "s n"]) -> Float[Array, ""]:
        """The norm of changes of the stages, in units of the tolerance."""
        weight = 1 / (self.atol + self.rtol * jnp.abs(equations.x0))  # which is the same in all iterations
        return self.norm(jax.vmap(lambda row: equations.unravel(row * weight))(change))

    def rounding(self, equations: StageEquations) -> Float[Array, ""]:
        """The norm of changes by rounding, in units of the tolerance."""
        x0 = equations.x0
        return self.size(equations, 4 * jnp.finfo(x0.dtype).eps * x0[None])


@eqx.filter_custom_jvp
def _solve(iteration, equations, guess, memory):
    return iteration.iterate(equations, guess, memory)


@_solve.def_jvp
def _solve_jvp(primals, tangents):
    iteration, equations, guess, memory = primals
    stages = _solve(iteration, equations, guess, memory)
    changes = iteration.tangents(equations, stages, tangents[1])
    zero = jax.tree.map(lambda leaf: jnp.zeros_like(leaf) if eqx.is_inexact_array(leaf) else None, stages)
    return stages, eqx.tree_at(lambda s: (s.Z, s.K), zero, changes)


def combine(matrix: np.ndarray, X: Float[Array, "s n"]) -> Float[Array, "m n"]:
    """``matrix @ X``, as a sum: within a loop on a CPU, a library call costs more than a product this small."""
    return jnp.sum(jnp.asarray(matrix, dtype=X.dtype)[:, :, None] * X[None], axis=1)
