"""Problems A1 to A5, B1 to B5, C1, D1 to D5 and E2 of DETEST, on [0, 20], and what Shampine and Gordon's code needs.

Hull, Enright, Fellen & Sedgwick, *Comparing numerical methods for ordinary differential equations*, SIAM Journal on
Numerical Analysis 9 (1972) 603–637. ``EVALUATIONS`` were counted in runs of Shampine and Gordon's published code, ODE
with DE and STEP, in the translation to C by J. Burkardt, with equal absolute and relative tolerances of 1e-6 and 1e-10.
"""

import jax
import jax.numpy as jnp
import numpy as np

SIZE = 10
END = 20.0


def kepler(t, y):
    """Two bodies."""
    r3 = (y[0] ** 2 + y[1] ** 2) ** 1.5
    return [y[2], y[3], -y[0] / r3, -y[1] / r3]


def torus(t, y):
    """B4."""
    r = jnp.sqrt(y[0] ** 2 + y[1] ** 2)
    return [-y[1] - y[0] * y[2] / r, y[0] - y[1] * y[2] / r, y[0] / r]


FIELDS = {
    "A1": lambda t, y: [-y[0]],
    "A2": lambda t, y: [-(y[0] ** 3) / 2],
    "A3": lambda t, y: [y[0] * jnp.cos(t)],
    "A4": lambda t, y: [y[0] / 4 * (1 - y[0] / 20)],
    "A5": lambda t, y: [(y[0] - t) / (y[0] + t)],
    "B1": lambda t, y: [2 * (y[0] - y[0] * y[1]), -(y[1] - y[0] * y[1])],
    "B2": lambda t, y: [-y[0] + y[1], y[0] - 2 * y[1] + y[2], y[1] - y[2]],
    "B3": lambda t, y: [-y[0], y[0] - y[1] ** 2, y[1] ** 2],
    "B4": torus,
    "B5": lambda t, y: [y[1] * y[2], -y[0] * y[2], -0.51 * y[0] * y[1]],
    "C1": lambda t, y: [-y[0], *(y[i - 1] - y[i] for i in range(1, 9)), y[8]],
    **{f"D{i}": kepler for i in range(1, 6)},
    "E2": lambda t, y: [y[1], (1 - y[0] ** 2) * y[1] - y[0]],
}
STARTS = {
    **{name: [1.0] for name in ("A1", "A2", "A3", "A4")},
    "A5": [4.0],
    "B1": [1.0, 3.0],
    "B2": [2.0, 0.0, 1.0],
    "B3": [1.0, 0.0, 0.0],
    "B4": [3.0, 0.0, 0.0],
    "B5": [0.0, 1.0, 1.0],
    "C1": [1.0, *[0.0] * 9],
    **{f"D{i + 1}": [1 - e, 0.0, 0.0, np.sqrt((1 + e) / (1 - e))] for i, e in enumerate((0.1, 0.3, 0.5, 0.7, 0.9))},
    "E2": [2.0, 0.0],
}
NAMES = tuple(FIELDS)
EVALUATIONS = {
    1e-6: [105, 119, 294, 71, 95, 534, 167, 137, 331, 337, 157, 269, 394, 504, 693, 1029, 662],
    1e-10: [221, 237, 535, 147, 195, 1121, 327, 281, 541, 605, 313, 621, 843, 1084, 1473, 2181, 1362],
}


def field(t, y, index):
    """The field of a problem by its index, with zeros for components that it has not."""

    def padded(function):
        def rates(t, y):
            values = jnp.stack(function(t, y))
            return jnp.concatenate([values, jnp.zeros(SIZE - len(values))])

        return rates

    different = list(dict.fromkeys(FIELDS.values()))
    which = jnp.asarray([different.index(function) for function in FIELDS.values()])[index]
    return jax.lax.switch(which, [padded(function) for function in different], t, y)


def start(name):
    """The initial state, with zeros behind it."""
    return np.array([*STARTS[name], *[0.0] * (SIZE - len(STARTS[name]))])
