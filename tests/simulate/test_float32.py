"""In float32 the default tolerances cannot be met, and the refusal says what to do."""

import pytest

from tests.support.scripts import printed_by
from tests.support.sentences import said

pytestmark = pytest.mark.any_precision

PROGRAM = """
import jax
import jaxball
assert not jax.config.jax_enable_x64, "importing jaxball must not switch float64 on"
ball = jaxball.Ball(mass=1.0, inertia=(0.5, 0.6, 0.7), offset=(0.1, 0.0, -0.1))
run = jaxball.simulate(ball, [0.0, 1.0], rtol=1e-4, atol=1e-4)
assert run.ok and run.state.z.dtype == "float32", run
# The determinant of its moments is beyond the range of float32; the run once succeeded, with a constant Omega.
heavy = jaxball.Ball(mass=1e14, inertia=(5e13, 6e13, 7e13), offset=(0.1, 0.0, -0.1))
assert jaxball.simulate(heavy, [0.0, 1.0], rtol=1e-4, atol=1e-4).status == jaxball.Status.IMPOSSIBLE
try:
    jaxball.simulate(ball, [0.0, 1.0])
except jaxball.simulation.PrecisionError as refused:
    print(refused)
"""


@pytest.fixture(scope="module")
def sentence():
    return printed_by("-c", PROGRAM)


@pytest.mark.thorough
def test_the_refusal_names_the_line_that_fixes_it(sentence):
    assert 'jax.config.update("jax_enable_x64", True)' in sentence
    assert "float32" in sentence
    said(sentence, "rtol")  # and not with digits that float32 does not have
