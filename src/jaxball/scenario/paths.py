"""How numbers are called, in scenarios and in what is written: by their paths, counted from 0."""

import numpy as np


def entries(name: str, shape: tuple[int, ...]) -> dict[str, tuple[int, ...]]:
    """The index of each number of an array by the number's path: ``{"z[0]": (0,), "z[1]": (1,)}``.

    A single number, of shape (), is called as the array is.
    """
    return {name + "".join(f"[{k}]" for k in index): index for index in np.ndindex(shape)}
