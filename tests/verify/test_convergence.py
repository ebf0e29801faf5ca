"""The row that says whether errors fall with the tolerance: where it holds, where it fails, where it cannot tell."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

import jaxball
from jaxball import load_scenario
from jaxball.analysis.verify import check_laws, comparisons
from jaxball.analysis.verify.case import Case


class Weather(jaxball.physics.AbstractState):
    """x, y, z."""

    x: Float[Array, "*batch"] = eqx.field(converter=jnp.asarray, default=1.0)
    y: Float[Array, "*batch"] = eqx.field(converter=jnp.asarray, default=1.0)
    z: Float[Array, "*batch"] = eqx.field(converter=jnp.asarray, default=20.0)


class Lorenz(jaxball.AbstractSystem[Weather]):
    """The equations of E. N. Lorenz, 1963, where deviations grow as exp(0.9 t)."""

    title: ClassVar[str] = "Lorenz system"
    state_type: ClassVar[type[Weather]] = Weather

    def field(self, t, state):
        x, y, z = state.x, state.y, state.z
        return Weather(10.0 * (y - x), x * (28.0 - z) - y, x * y - 8.0 / 3.0 * z)


@pytest.mark.thorough
@pytest.mark.parametrize(("end", "resolved"), [(2.0, True), (40.0, False)])
def test_a_chaotic_run_that_is_too_long_is_not_resolved(end, resolved):
    """Errors of 1e-8 have grown to the size of the motion by t = 20, and those of the reference by t = 35."""
    row = check_laws(Lorenz(), [0.0, end], rtol=1e-8, atol=1e-8, laws=["convergence"])["convergence"]
    assert row.ok is resolved
    assert ("not resolved" in row.verdict) is not resolved
    assert ("FAILS" in row.verdict) is not resolved


@pytest.mark.thorough
@pytest.mark.parametrize("tolerance", [1e-3, 0.01])
def test_a_loose_run_is_compared_with_a_tighter_one(tolerance):
    row = check_laws(Lorenz(), [0.0, 1.0], rtol=tolerance, atol=tolerance, laws=["convergence"])["convergence"]
    assert row.ok
    assert row.residual > 0
    assert f"at {tolerance / 100:.0e}" in row.note


@pytest.mark.parametrize(
    ("errors", "growth", "ok", "residual"),
    [
        ((1e-3, 2e-5, 2e-7), 1.0, True, 0.02),
        ((1e-3, 9e-4, 8e-4), 1.0, False, 0.9),  # a result that does not converge
        ((1e-3, 1e-5, 2e-2), 1.0, False, 2e3),  # the run itself is wrong
        ((1.0, 1.0, 0.8), 1.0, False, None),  # all as large as the motion
        ((1.0, 1.0, 1e-2), 1.0, False, None),  # nothing to compare the last with
        ((1e-2, 1e-4, 1e-6), 1e12, False, None),  # the reference is no better than 10
        ((1e-12, 1e-12, 1e-12), 1.0, True, 0.0),  # all that the reference resolves
        ((np.nan, np.nan, np.nan), 1.0, False, np.nan),
    ],
)
def test_what_errors_say(monkeypatch, errors, growth, ok, residual):
    class Pretended(Case):
        tolerance, growth = 1e-10, None

    Pretended.growth = np.array([growth])
    in_order = iter(errors)
    monkeypatch.setattr(comparisons, "_error_at", lambda case, tolerance: next(in_order))
    row = comparisons.convergence(Pretended(load_scenario("disk")))
    assert row.ok is ok
    if residual is None:
        assert row.residual is None
        assert "FAILS: not resolved" in row.verdict
    else:
        np.testing.assert_allclose(row.residual, residual)
