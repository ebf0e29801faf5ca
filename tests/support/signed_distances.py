"""Functions that are zero on a ground and positive on one side of it, for tests."""

import jax.numpy as jnp


def inside_sphere(t, x, y, z, R):
    """The distance from a sphere of radius R about (0, 0, R), from within."""
    return R - jnp.sqrt(x**2 + y**2 + (z - R) ** 2)


def outside_sphere(t, x, y, z, R):
    """The same of a sphere whose highest point is the origin, from without."""
    return jnp.sqrt(x**2 + y**2 + (z + R) ** 2) - R


def inside_ellipsoid(t, x, y, z, axes):
    """Of an ellipsoid about the origin with these half axes; it is no distance."""
    return 1 - (x / axes[0]) ** 2 - (y / axes[1]) ** 2 - (z / axes[2]) ** 2


def outside_torus(t, x, y, z, radii):
    """The distance from a ring about e3 with the radius radii[0], whose tube has the radius radii[1]."""
    return jnp.sqrt((jnp.sqrt(x**2 + y**2) - radii[0]) ** 2 + z**2) - radii[1]
