"""The equations that the stages of one step satisfy, and the iterations that solve them: Newton's and a fixed-point."""

import abc
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, PyTree

from ...numerics.linear import complex_inverses, inverses, solutions
from ...programs.batches import fill_vectors
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
        """Computes K for given Z."""
        return jax.vmap(lambda t, z: self.slope(t, self.x0 + z))(self.times, Z)

    def right_side(self, K: Float[Array, "s n"]) -> Float[Array, "s n"]:
        """Computes A K + known: Z for given K where there is no mass matrix."""
        return self.with_known(combine(self.tableau.A, K))

    def with_known(self, AK: Float[Array, "s n"]) -> Float[Array, "s n"]:
        """Returns ``AK`` plus ``known``."""
        return AK if self.known is None else AK + self.known

    def without_known(self, Z: Float[Array, "s n"]) -> Float[Array, "s n"]:
        """Returns ``Z`` minus ``known``."""
        return Z if self.known is None else Z - self.known

    def mass_times(self, Z: Float[Array, "s n"]) -> Float[Array, "s n"]:
        """Computes M Z of all stages."""
        return Z if self.mass is None else self.mass.times(Z)

    def mass_matrix(self) -> Float[Array, "n n"]:
        """Returns the mass matrix M."""
        return jnp.eye(self.x0.size, dtype=self.x0.dtype) if self.mass is None else self.mass.matrix

    def residual(self, Z: Float[Array, "s n"]) -> Float[Array, "s n"]:
        """Computes M Z − A K(Z) − known, which is zero at the solution."""
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

    def forget(self, when: Bool[Array, ""] | bool) -> "Memory":
        """Forgets what does not hold after a jump."""
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
        """Returns the memory before the first step."""

    @abc.abstractmethod
    def iterate(self, equations: StageEquations, guess: Float[Array, "s n"], memory: Memory) -> Stages:
        """Computes the stages, from a ``guess`` of the slopes K and the memory that the step before left."""

    @abc.abstractmethod
    def tangents(
        self, equations: StageEquations, stages: Stages, changes: StageEquations
    ) -> tuple[Float[Array, "s n"], Float[Array, "s n"]]:
        """Computes the changes of Z and K, to first order, when the equations change."""

    def solve(self, equations: StageEquations, guess: Float[Array, "s n"], memory: Memory) -> Stages:
        """Solves by :meth:`iterate`, whose derivatives come from the implicit function theorem."""
        return _solve(self, equations, guess, memory)

    def size(self, equations: StageEquations, change: Float[Array, "s n"]) -> Float[Array, ""]:
        """Computes the norm of changes of the stages, in units of the tolerance: the root mean square of the norms of
        each stage.
        """
        weight = 1 / (self.atol + self.rtol * jnp.abs(equations.x0))  # which is the same in all iterations
        sizes = jax.vmap(lambda row: self.norm(equations.unravel(row * weight)))(change)
        return optx.rms_norm(sizes) if len(change) > 1 else sizes[0]

    def rounding(self, equations: StageEquations) -> Float[Array, ""]:
        """Computes the norm of changes by rounding, in units of the tolerance."""
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
    changes = eqx.tree_at(lambda s: (s.Z, s.K), zero, changes)
    if stages.f0 is not None:  # by which errors are estimated
        _, of_f0 = eqx.filter_jvp(lambda e: e.slope(e.t0, e.x0), (equations,), (tangents[1],))
        changes = eqx.tree_at(lambda s: s.f0, changes, of_f0)
    return stages, changes


def combine(matrix: np.ndarray, X: Float[Array, "s n"]) -> Float[Array, "m n"]:
    """Computes ``matrix @ X``, as a sum: within a loop on a CPU, a library call costs more than a product
    this small.
    """
    return jnp.sum(jnp.asarray(matrix, dtype=X.dtype)[:, :, None] * X[None], axis=1)


# The rate of the last step is trusted on this one down to here.
LEAST_GUESS = 1e-2


class Iterate(NamedTuple):
    """The state of an iteration."""

    x: PyTree[Array]
    change: Float[Array, ""]  # the norm of the last change, in units of the tolerance
    rate: Float[Array, ""]  # by which factor a change is smaller than the one before
    passes: Int[Array, ""]
    converged: Bool[Array, ""]
    hopeless: Bool[Array, ""]


def iterate(
    update: Callable[[PyTree[Array]], tuple[PyTree[Array], Float[Array, ""]]],
    start: PyTree[Array],
    rate: Float[Array, ""],
    *,
    limit: float,
    floor: Float[Array, ""],
    max_steps: int,
) -> Iterate:
    """Repeats ``update``, which returns the next iterate and the norm of its change.

    Hairer & Wanner (1996), section IV.8: with the rate Θ = |Δₖ|/|Δₖ₋₁| the remaining error is about Θ/(1 − Θ) |Δₖ|; the
    iteration ends when that is below ``limit`` or the change is below ``floor``, the level of rounding, and it is given
    up when the rate is too slow to get there in ``max_steps``. Before there are two changes, ``rate`` is used as the
    rate. A change of NaN ends it at once.
    """

    root = jnp.sqrt(rate)
    fourth = jnp.sqrt(root)
    # ϑ^0.8 to a hundredth of its logarithm, by roots: a library's power costs more than a small step.
    guessed = jnp.maximum(root * fourth * jnp.sqrt(jnp.sqrt(fourth)), LEAST_GUESS)
    # The remaining error over the change, where there is only a guess.
    share = guessed / jnp.maximum(1 - guessed, 1e-3)

    def body(state: Iterate) -> Iterate:
        x, change = update(state.x)
        first = state.passes == 0
        # The first change is judged by the rate of the step before, as radau5 does: often it is the only one that is
        # needed.
        rate = jnp.where(first, guessed, change / state.change)
        left = max_steps - 1 - state.passes
        remaining = change * jnp.where(first, share, change / jnp.maximum(state.change - change, 1e-3 * state.change))
        converged = (remaining <= limit) & (rate < 1) | (change <= floor)
        too_slow = (rate >= 1) | (remaining * _power(rate, left, max_steps) > limit)
        hopeless = ~converged & (~jnp.isfinite(change) | ~first & too_slow | (left == 0))
        return Iterate(x, change, rate, state.passes + 1, converged, hopeless)

    start = Iterate(start, jnp.ones_like(floor), rate, jnp.asarray(0), jnp.asarray(False), jnp.asarray(False))
    return jax.lax.while_loop(lambda state: ~state.converged & ~state.hopeless, body, start)


def _power(base: Float[Array, ""], exponent: Int[Array, ""], largest: int) -> Float[Array, ""]:
    """Computes ``base`` to a whole number from 0 to ``largest``, by products: a library's power costs more than a small
    step.
    """
    power, square = jnp.ones_like(base), base
    for bit in range(largest.bit_length()):
        power = jnp.where((exponent >> bit) & 1 == 1, power * square, power)
        square = square * square
    return power


LONGEST_SERIES = 100


class FixedPoint(AbstractStageIteration):
    """For problems that are not stiff: K ← h f(tᵢ, x₀ + A K), all stages at once.

    It converges if h‖∂f/∂x‖ ‖A‖ < 1, the faster the more stages there are, because A integrates.

    **Arguments:**

    - ``kappa``: the iteration ends when the remaining error is this fraction of the tolerance.
    - ``max_steps``: the most iterations before the step is retried with half the length.
    - ``rtol``, ``atol``, ``norm``: by default those of the step-size controller.

    **Raises:** ``TypeError`` for a problem with a mass matrix.
    """

    kappa: float = 1e-4
    max_steps: int = 25
    rtol: Any = FROM_CONTROLLER
    atol: Any = FROM_CONTROLLER
    norm: Any = FROM_CONTROLLER

    def start(self, tableau: Tableau, x0: Float[Array, " n"]) -> Memory:
        return Memory(jnp.ones((), x0.dtype))

    def iterate(self, equations: StageEquations, guess: Float[Array, "s n"], memory: Memory) -> Stages:
        if equations.mass is not None:
            raise TypeError(
                "Argument `root_finder` must be a SimplifiedNewton where there is a mass matrix, "
                "but it is a FixedPoint."
            )

        def update(K):
            new = equations.slopes(equations.right_side(K))
            return new, self.size(equations, new - K)

        end = iterate(
            update, guess, memory.rate, limit=self.kappa, floor=self.rounding(equations), max_steps=self.max_steps
        )
        Z = equations.right_side(end.x)
        return Stages(Z, end.x, end.converged, jnp.asarray(False), Memory(end.rate))

    def tangents(self, equations, stages, changes):
        """Computes the tangents of the iteration's limit, K = slopes(A K), by the same iteration, to rounding."""
        _, change = eqx.filter_jvp(lambda e: e.slopes(e.right_side(stages.K)), (equations,), (changes,))
        _, slopes = jax.linearize(equations.slopes, stages.Z)
        A = equations.tableau.A
        # The series of the iteration, which converges where the iteration did, has no derivatives of its own; as a
        # linear solve it has those of the solution, in both modes.
        K = jax.lax.custom_linear_solve(lambda K: K - slopes(combine(A, K)), change, _series, transpose_solve=_series)
        return changes.with_known(combine(A, K)), K


def _series(linear, y: Float[Array, "s n"]) -> Float[Array, "s n"]:
    def is_unfinished(carry):
        x, change, count = carry
        return (jnp.max(jnp.abs(change)) > jnp.finfo(y.dtype).eps * jnp.max(jnp.abs(x))) & (count < LONGEST_SERIES)

    def add(carry):
        x, _, count = carry
        change = y - linear(x)
        return x + change, change, count + 1

    return jax.lax.while_loop(is_unfinished, add, (y, y, 0))[0]


class SimplifiedNewton(AbstractStageIteration):
    """For stiff problems, and for any with a mass matrix.

    With the Jacobian h∂g/∂x at the start of the step in place of those of the stages, their s·n equations decouple into
    the modes of A⁻¹: (λM − h∂g/∂x) ΔW = …, a complex system of n equations for each pair of conjugate eigenvalues λ and
    one for the real eigenvalue (Hairer & Wanner 1996, section IV.8, eq. (8.5)).

    **Arguments:**

    - ``kappa``: the iteration ends when the remaining error is this fraction of the tolerance.
    - ``max_steps``: the most iterations before the step is retried with half the length.
    - ``rtol``, ``atol``, ``norm``: by default those of the step-size controller.
    - ``reuse``: the matrices of the last step are reused while the step length relative to theirs is between this and
      its inverse, and the iteration converges well with them; 1 recomputes them at every step. By default it is 0.8
      with the tolerances of a step-size controller, which shortens a step whose iteration fails, and 1 with explicit
      tolerances, as needed for steps of constant length, where a failure would end the solve.
    - ``slowest``: matrices with which an iteration reduced the error by less than this factor are not reused.
    """

    kappa: float
    max_steps: int
    rtol: Any
    atol: Any
    norm: Any
    reuse: float
    slowest: float

    def __init__(
        self,
        kappa: float = 1e-2,
        max_steps: int = 15,
        rtol: Any = FROM_CONTROLLER,
        atol: Any = FROM_CONTROLLER,
        norm: Any = FROM_CONTROLLER,
        reuse: float | None = None,
        slowest: float = 0.1,
    ):
        self.kappa, self.max_steps = kappa, max_steps
        self.rtol, self.atol, self.norm = rtol, atol, norm
        self.reuse = (0.8 if rtol is FROM_CONTROLLER else 1.0) if reuse is None else reuse
        self.slowest = slowest

    def start(self, tableau: Tableau, x0: Float[Array, " n"]) -> Memory:
        zero = jnp.zeros((len(tableau.modes.eigenvalues), x0.size, x0.size), x0.dtype)
        imaginary = zero if np.any(np.imag(tableau.eigenvalues)) else None
        return Memory(jnp.ones((), x0.dtype), zero, imaginary, jnp.ones((), x0.dtype))

    def iterate(self, equations: StageEquations, guess: Float[Array, "s n"], memory: Memory) -> Stages:
        tableau, modes = equations.tableau, equations.tableau.modes
        matrices = self._matrices(equations, memory)

        def update(Z):
            right = combine(modes.weighted, -equations.residual(Z))
            change = solutions(matrices.inverses, right)
            if matrices.imaginary is not None:
                partners = jnp.stack([right[place] for place in modes.partner.tolist()])
                # Complex products in real numbers, part by part, as ``Modes`` says.
                change = change + solutions(matrices.imaginary, partners)
            change = combine(modes.to_stages, change)
            return Z + change, self.size(equations, change)

        end = iterate(
            update,
            equations.right_side(guess),
            memory.rate,
            limit=self.kappa,
            floor=self.rounding(equations),
            max_steps=self.max_steps,
        )
        K = combine(tableau.A_inverse, equations.without_known(end.x))
        smooth = matrices.inverses[0] if tableau.eigenvalues[0].imag == 0 else None
        memory = Memory(end.rate, matrices.inverses, matrices.imaginary, matrices.control)
        return Stages(end.x, K, end.converged, matrices.singular, memory, smooth, matrices.f0)

    def _matrices(self, equations: StageEquations, memory: Memory) -> "_Matrices":
        """Returns the matrices of the step before, if these are good enough, or new ones."""
        tableau, x0 = equations.tableau, equations.x0
        control, remembered, made_for = equations.control.astype(x0.dtype), memory.inverses, memory.control
        imaginary, eigenvalues = memory.imaginary, tableau.modes.eigenvalues
        assert remembered is not None
        assert made_for is not None

        def renew():
            f0, J = value_and_jacobian(lambda x: equations.slope(equations.t0, x), x0)
            M = equations.mass_matrix()[None]
            real, other = (
                jnp.asarray(x, x0.dtype)[:, None, None] * M for x in (np.real(eigenvalues), np.imag(eigenvalues))
            )
            if imaginary is None:
                new, other = inverses(real - J[None]), None
            else:
                new, other = complex_inverses(real - J[None], other)
            singular = jnp.all(jnp.isfinite(J)) & ~jnp.all(jnp.isfinite(new))
            # f₀ where the old matrices would come with one, because both branches of a condition return the same form.
            return _Matrices(new, other, control, None if equations.f0 is None else f0, singular)

        def keep():
            return _Matrices(remembered, imaginary, made_for, equations.f0, jnp.asarray(False))

        # Known when the program is made, so that no condition is compiled.
        if self.reuse >= 1:
            return renew()
        ratio = control / made_for
        near = (ratio * self.reuse < 1) & (ratio > self.reuse)
        return jax.lax.cond(near & (memory.rate < self.slowest), keep, renew)

    def tangents(self, equations, stages, changes):
        """Solves one linear system of s·n equations with a separate Jacobian for each stage exactly."""
        tableau, (s, n) = equations.tableau, stages.Z.shape
        _, residual = eqx.filter_jvp(lambda e: e.residual(stages.Z), (equations,), (changes,))
        J = jax.vmap(lambda t, x: value_and_jacobian(lambda x: equations.slope(t, x), x)[1])(
            equations.times, equations.x0[None] + stages.Z
        )
        A, eye = jnp.asarray(tableau.A, dtype=J.dtype), jnp.eye(s, dtype=J.dtype)
        matrix = eye[:, None, :, None] * equations.mass_matrix()[None, :, None, :]
        matrix = matrix - A[:, None, :, None] * jnp.transpose(J, (1, 0, 2))[None]
        Z = jnp.linalg.solve(matrix.reshape(s * n, s * n), -residual.reshape(s * n)).reshape(s, n)
        return Z, combine(tableau.A_inverse, changes.without_known(Z))


class _Matrices(NamedTuple):
    """The parts of (λM − h∂g/∂x)⁻¹ for the modes, its step length h, h g(t₀, x₀), and whether one is singular."""

    inverses: Float[Array, "k n n"]
    imaginary: Float[Array, "k n n"] | None
    control: Float[Array, ""]
    f0: Float[Array, " n"] | None
    singular: Bool[Array, ""]


def value_and_jacobian(f: Callable, x: Float[Array, " n"]) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """Computes f(x) and ∂f/∂x by forward mode; parts that do not depend on the direction are computed once."""
    value, tangent = jax.linearize(f, x)
    return value, fill_vectors(tangent, jnp.eye(x.size, dtype=x.dtype)).T
