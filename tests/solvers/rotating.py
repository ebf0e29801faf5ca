"""A nonlinear oscillation of two variables with a closed form, autonomous or not, and the same with a third that is
algebraic.

In polar coordinates ṙ = r(1 − r²) and φ̇ = ω(1 + at) + r². So 1/r² − 1 decays as exp(−2t), and φ is
ω(t + at²/2) + t − ln(r/r₀), because ∫r² dt is that of 1 − ṙ/r.
"""

import jax.numpy as jnp

START = 0.5


def field(t, x, args):
    """The vector field in Cartesian coordinates; ``args`` are ω and a."""
    u, v = x
    r2 = u**2 + v**2
    growth, turn = 1 - r2, args[0] * (1 + args[1] * t) + r2
    return jnp.stack([growth * u - turn * v, growth * v + turn * u])


def exact(t, args):
    """The solution from (½, 0) at t = 0."""
    r = 1 / jnp.sqrt(1 + (1 / START**2 - 1) * jnp.exp(-2 * t))
    phi = args[0] * (t + args[1] * t**2 / 2) + t - jnp.log(r / START)
    return jnp.stack([r * jnp.cos(phi), r * jnp.sin(phi)])


def field_with_algebraic(t, x, args):
    """M ẋ of (w, u, v), where w + w³/10 = 1 + u determines w, and w + w³/10 − u stands for 1 in the other equations."""
    w, u, v = x
    r2 = u**2 + v**2
    one = w + w**3 / 10 - u
    growth, turn = one - r2, args[0] * (1 + args[1] * t) + r2
    return jnp.stack([one - 1, growth * u - turn * v, growth * v + turn * u])


def exact_with_algebraic(t, args):
    """(w, u, v); the cubic w³ + pw = q is solved by hyperbolic functions (Cardano's formula)."""
    u, v = exact(t, args)
    p, q = 10.0, 10 * (1 + u)
    w = 2 * jnp.sqrt(p / 3) * jnp.sinh(jnp.arcsinh(1.5 * q / p * jnp.sqrt(3 / p)) / 3)
    return jnp.stack([w, u, v])
