"""Methods with an explicit first stage and one coefficient on the diagonal of all others."""

import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from .flat import FlatProblem
from .tableau import Tableau


def diagonally_implicit(c: list[float], A: list[list[float]]) -> Tableau:
    """The tableau of the implicit stages; their ``A`` is lower triangular with one number on the diagonal.

    A⁻¹ then has one eigenvalue and no basis of eigenvectors. Stages serve in the place of modes: on a
    linear problem, the iteration is exact after as many passes as there are stages.
    """
    matrix = np.asarray(A)
    identity = np.eye(len(c))
    return Tableau(
        c=np.asarray(c),
        b=matrix[-1],
        A=matrix,
        A_inverse=np.linalg.inv(matrix),
        expansion=identity,
        eigenvalues=1 / matrix[:1, 0],
        to_modes=identity,
        from_modes=identity,
    )


def first_slope(
    problem: FlatProblem, t0: Float[Array, ""], known: Bool[Array, ""], f: Float[Array, " n"]
) -> Float[Array, " n"]:
    """h f at the start of a step: from the last stage of the step before, where it is ``known``.

    That value satisfies the stage's equation. Evaluated anew in a stiff problem, f would multiply the error of
    the stage by the large eigenvalues (Hosea & Shampine 1996, section 4).
    """
    return jax.lax.cond(known, lambda: problem.control.astype(f.dtype) * f, lambda: problem.slope(t0, problem.x0))
