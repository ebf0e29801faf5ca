"""Linear equations whose solutions everybody knows."""

import jax.numpy as jnp


def rotation(t, y, z):
    """ẏ = z y in real and imaginary parts."""
    return jnp.stack([z[0] * y[0] - z[1] * y[1], z[1] * y[0] + z[0] * y[1]])


def oscillator(t, y, args):
    """ÿ = −y for a state in two parts."""
    return {"y": y["v"], "v": -y["y"]}
