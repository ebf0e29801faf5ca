"""What a trace is made for, which JAX's caches must know from the first trace on."""

from tests.support.scripts import printed_by

SCRIPT = """
import jax
import jaxball

traces = []


@jax.jit
def end(radius):
    traces.append(radius)
    ball = jaxball.Ball(mass=1.0, inertia=(0.3, 0.35, 0.4), radius=radius)
    return jaxball.simulate(ball, [0.0, 0.1], jaxball.BallState(), rtol=1e-4, atol=1e-4).state.z[-1]


end(1.0), end(1.0)
print(len(traces))
"""


def test_a_function_that_uses_jaxball_first_is_traced_once():
    assert printed_by("-c", SCRIPT).split() == ["1"]
