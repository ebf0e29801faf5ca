"""Derivatives of where the paper's ball comes to, against thirty digits."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import paper, simulate

# z1(20) and its derivatives with respect to the masses m0 to m3, the inertia d1 to d3 and the offset of the shell's
# centre of mass: the variational equations of the paper's fifteen by heyoka 7.13 in 119 bits at the tolerance 1e-33
# (`peers.heyoka_gradient.exact` in benchmarks).
EXACT = """
    -3.992343542457705391158837916497
    -0.2530154875721698785158331100872
    -7.568504763335182950734933573905
    17.78267290092303848074571809506
    -9.487457295608414536326785073767
    2.346101538017322349944881782768
    -0.1013702046476689043539168906376
    -2.258015030886538343005945258425
    -10.80123555807212580693985940584
    -9.463751716736937276380151264372
    3.105432196191240929336409450078
"""


def place(p, adjoint):
    ball = paper.ball()
    moved = eqx.tree_at(lambda b: (b.mass, b.groups[0].mass, b.inertia, b.offset), ball, (p[0], p[1:4], p[4:7], p[7:]))
    return simulate(moved, (0.0, 20.0), rtol=1e-12, atol=1e-12, max_steps=256, adjoint=adjoint).state.z[-1, 0]


@pytest.mark.thorough
@pytest.mark.parametrize("mode", ["reverse", pytest.param("forward", marks=pytest.mark.slow)])
def test_derivatives_of_the_papers_ball(mode):
    ball = paper.ball()
    p = jnp.concatenate([ball.mass[None], ball.groups[0].mass, ball.inertia, ball.offset])
    if mode == "reverse":
        value, derivatives = jax.jit(jax.value_and_grad(lambda p: place(p, None)))(p)
    else:
        forward = diffrax.ForwardMode()
        value, derivatives = jax.jit(lambda p: (place(p, forward), jax.jacfwd(lambda p: place(p, forward))(p)))(p)
    exact = np.array(EXACT.split(), dtype=float)
    np.testing.assert_allclose(value, exact[0], rtol=1e-11)
    np.testing.assert_allclose(derivatives, exact[1:], rtol=1e-9)
