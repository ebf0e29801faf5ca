"""Arrays with nothing in them yet, which a program fills before it reads them.

A ``reversible_loop`` makes them where it is traced; the compiler knows the function by its name.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

NAME = "jaxball_uninitialised"  # of a function of StableHLO whose results are not computed


def empty_array(shape: tuple[int, ...], dtype: np.dtype) -> Array:
    """Makes an array of any numbers; zeros where XLA compiles the program. Natively it costs no time, however large it
    is.
    """

    def zeros() -> Array:
        return jnp.zeros(shape, dtype)

    zeros.__name__ = NAME
    return jax.jit(zeros)()
