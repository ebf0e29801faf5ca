"""Mass matrices, constant over a step and possibly singular, and the problems M ẋ = g(t, x) with one."""

import abc
from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Float, PyTree

from ...interface.compat import is_traced
from ...numerics.linear import inverse, product
from ...numerics.vectors import apply

VectorField = Callable[[Any, Any, Any], Any]


class Mass(eqx.Module):
    """A mass matrix over the flattened state, and where it is singular.

    ``residuals`` projects on the equations without a derivative, the null space of Mᵀ, and
    ``variables`` on the algebraic variables, the null space of M.
    """

    matrix: Float[Array, "n n"]
    residuals: Float[Array, "n n"]
    variables: Float[Array, "n n"]

    def times(self, Z: Float[Array, "s n"]) -> Float[Array, "s n"]:
        """Computes M Zᵢ for each of the s rows."""
        return product(Z, self.matrix.T)

    def rates(self, g: Float[Array, " n"]) -> Float[Array, " n"]:
        """Solves M v = g for the v without an algebraic part, or does so for the nearest g for which there is one."""
        # MᵀM is regular except on the algebraic variables, where the projection makes it so and gives the rate 0.
        matrix = product(self.matrix.T, self.matrix) + self.variables
        return apply(inverse(matrix), apply(self.matrix.T, g))

    def without_algebraic(self, x: Float[Array, " n"]) -> Float[Array, " n"]:
        """Returns ``x`` with its algebraic part taken off."""
        return x - apply(self.variables, x)


class AbstractMassTerm(diffrax.AbstractTerm):
    """M ẋ = g(t, x), for the solvers that support a mass matrix: ``RadauIIA``, ``NDF``, ``Trapezoidal``, ``TRBDF2``.

    Another solver would silently integrate ẋ = g, so ``prod``, which it calls, refuses.
    """

    @abc.abstractmethod
    def at_step(self, t: Any, y: PyTree[Array], args: Any) -> tuple[VectorField, Mass]:
        """Returns the vector field g and the mass matrix for the step that starts at ``t``, ``y``."""

    def vf(self, t, y, args):
        g, _ = self.at_step(t, y, args)
        return g(t, y, args)

    def contr(self, t0, t1, **kwargs):
        return t1 - t0

    def prod(self, vf, control):
        raise TypeError(
            "Argument `solver` must support mass matrices if the term is a MassMatrixTerm, M ẋ = g(t, x), but it does "
            "not; use RadauIIA, NDF, Trapezoidal or TRBDF2 of jaxball.simulation.solvers, or, where M is regular, an "
            "ODETerm for ẋ = M⁻¹ g."
        )


class MassMatrixTerm(AbstractMassTerm):
    """M ẋ = g(t, x) with a constant matrix M, which may be singular if the index is 1.

    **Arguments:**

    - ``vector_field``: g(t, x, args), of the structure of x.
    - ``mass``: M. Either its diagonal, of the structure of x with leaves that broadcast to those of x, or
      an (n, n) array over the flattened x of n entries. Zero on the diagonal is exactly zero; in a
      full matrix, singular values below n ε times the largest are.

    Index 1 means that g, restricted to the equations without a derivative, determines the algebraic
    variables: Hairer & Wanner (1996), section VI.1. Initial values must satisfy these equations;
    :func:`~jaxball.simulation.solvers.consistent_initial_values` finds such values.

    **Raises:** ``ValueError`` if a full matrix is not known when the term is made, as under a transformation of JAX:
    its rank determines the problem.
    """

    vector_field: VectorField
    mass: PyTree[Any]
    null_spaces: tuple[Any, Any] | None

    def __init__(self, vector_field: VectorField, mass: PyTree[ArrayLike]):
        self.vector_field = vector_field
        self.mass = jax.tree.map(lambda x: x if isinstance(x, jax.Array) else np.asarray(x, dtype=float), mass)
        self.null_spaces = _null_spaces(self.mass) if _may_be_full(self.mass) else None

    def at_step(self, t, y, args):
        x, _ = ravel_pytree(y)
        return self.vector_field, _mass(self.mass, self.null_spaces, y, x)


class SwitchingMassMatrixTerm(AbstractMassTerm):
    """M ẋ = g(t, x), in a form that is chosen at the start of each step.

    For problems that can be written as an index-1 problem in several ways, none of which always keeps index 1. A
    versor's |q|² = 1, for example, determines q₀ only where q₀ ≠ 0; but it always determines the largest component.

    **Arguments:**

    - ``vector_field``: g(t, x, args, choice).
    - ``mass``: the diagonal of M for a choice, of the structure of x with leaves that broadcast.
    - ``choose``: the choice for a step that starts at t and x: choose(t, x, args), any PyTree of arrays.
    """

    vector_field: Callable[[Any, Any, Any, Any], Any]
    mass: Callable[[Any], Any]
    choose: Callable[[Any, Any, Any], Any]

    def at_step(self, t, y, args):
        choice = self.choose(t, y, args)
        x, _ = ravel_pytree(y)
        return lambda t, y, args: self.vector_field(t, y, args, choice), _mass(self.mass(choice), None, y, x)


def mass_term(term: diffrax.AbstractTerm) -> AbstractMassTerm | None:
    """Returns the term with a mass matrix that ``term`` is or wraps; None for an ordinary differential equation."""
    inner = unwrap(term)
    return inner if isinstance(inner, AbstractMassTerm) else None


def unwrap(term: diffrax.AbstractTerm) -> diffrax.AbstractTerm:
    """Returns the term inside wrappers.

    diffrax wraps terms to give them a direction of time; other wrappers declare that they are ``transparent``.
    """
    while hasattr(term, "direction") or getattr(term, "transparent", False):
        term = term.term  # pyright: ignore[reportAttributeAccessIssue]
    return term


def _mass(mass: PyTree, null_spaces: tuple[Any, Any] | None, y: PyTree[Array], x: Float[Array, " n"]) -> Mass:
    if null_spaces is not None:
        if mass.shape != (x.size, x.size):
            raise ValueError(
                f"Argument `mass` must have the shape of the state or be a matrix over its {x.size} entries, "
                f"but its shape is {mass.shape}."
            )
        return Mass(*(jnp.asarray(part, x.dtype) for part in (mass, *null_spaces)))
    diagonal = jax.tree.map(lambda m, leaf: jnp.broadcast_to(m, leaf.shape).astype(leaf.dtype), mass, y)
    diagonal, _ = ravel_pytree(diagonal)
    algebraic = jnp.diag((diagonal == 0).astype(x.dtype))
    return Mass(jnp.diag(diagonal), algebraic, algebraic)


def _may_be_full(mass: PyTree) -> bool:
    return (
        not isinstance(mass, (tuple, list, dict)) and getattr(mass, "ndim", 0) == 2 and mass.shape[0] == mass.shape[1]
    )


def _null_spaces(mass: Any) -> tuple[np.ndarray, np.ndarray]:
    if is_traced(mass):
        raise ValueError(
            "Argument `mass` must be known when the term is made if it is a full matrix, but it is traced by JAX; "
            "make it of NumPy arrays outside the transformation, or give a diagonal."
        )
    left, sizes, right = np.linalg.svd(np.asarray(mass))
    null = sizes <= len(sizes) * np.finfo(sizes.dtype).eps * max(sizes)
    return left[:, null] @ left[:, null].T, right[null].T @ right[null]
