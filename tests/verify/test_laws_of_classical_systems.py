"""The laws of classical systems, and runs compared with motions that are known."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import simulate
from jaxball.analysis.verify import check_laws
from jaxball.analysis.verify.samples import GAUSS, drift
from jaxball.physics import classical
from tests.support.sentences import said

TIMES = np.linspace(0.0, 1.0, 11)
START = classical.ParticleState(x=1.0, y=1.0, z=0.0, xdot=1.0, ydot=1.0)


@functools.cache
def particle():
    return check_laws(classical.NonholonomicParticle(), TIMES, START, quick=True)


@pytest.mark.thorough
def test_a_particle_keeps_its_laws_and_its_closed_form():
    report = particle()
    assert report.ok
    assert [row.law for row in report.rows if row.applies] == [
        "energy", "p_y", "p_xz", "error", "convergence", "closed-form",
    ]  # fmt: skip


@pytest.mark.thorough
def test_the_growth_of_deviations_is_at_most_that_of_the_closed_form():
    """The largest derivative of the state at any of the times with respect to one at the start, by the exact flow."""
    system = classical.NonholonomicParticle()
    start = jnp.asarray([1.0, 1.0, 0.0, 1.0, 1.0])

    @jax.jit
    def flow(x):
        at = jax.vmap(lambda t: system.solution(t, classical.ParticleState(*x), jnp.asarray(0.0)))(jnp.asarray(TIMES))
        return jnp.stack(jax.tree.leaves(at), axis=1)

    jacobian = np.asarray(jax.jacfwd(flow)(start))
    bound = np.max(np.linalg.norm(jacobian, axis=(1, 2))) * np.sqrt(5)
    assert 1 < particle().trust.growth < 3 * bound


@pytest.mark.thorough
def test_lagranges_integral_applies_to_symmetric_tops_only():
    start = classical.RigidBodyState(Omega=[0.3, 0.2, 2.0])
    for inertia, chi, applies in (
        ((1.2, 1.2, 0.5), (0.0, 0.0, 0.8), True),
        ((1.2, 1.1, 0.5), (0.0, 0.0, 0.8), False),
        ((0.5, 1.2, 1.2), (-0.8, 0.0, 0.0), True),
    ):
        report = check_laws(
            classical.HeavyTop(inertia=inertia, chi=chi), TIMES, start, laws=["axial_momentum", "energy"]
        )
        assert report.ok
        assert report["axial_momentum"].applies is applies
        assert (report["axial_momentum"].residual > 1e-4) is not applies


def test_a_law_of_rolling_asked_for_is_a_row_with_the_reason():
    report = check_laws(
        classical.NonholonomicParticle(), TIMES, classical.ParticleState(xdot=1.0), laws=["routh", "p_y"]
    )
    assert report.ok
    said(report["routh"].reason)
    assert report["p_y"].applies


@pytest.mark.parametrize("wrong", [0.0, 1e-3])
def test_the_drift_is_the_change_without_the_integral_of_the_rate(wrong):
    """sin t over three steps of a unit each, with the rate cos t + ``wrong``."""
    ends = np.arange(4.0)
    nodes = ends[:-1, None] + (1 + GAUSS[0][None]) / 2
    A, rate = np.sin(ends), np.cos(nodes) + wrong
    residuals = drift(A[:-1, None], A[1:, None], rate[:, :, None], np.diff(ends))
    np.testing.assert_allclose(residuals, wrong * ends[1:], atol=1e-14)


def test_residuals_over_time_are_changes_of_what_is_conserved():
    """At the end of the run, where a step ends; as multiples of what the tolerances explain."""
    system, settings = classical.NonholonomicParticle(), {"rtol": 1e-5, "atol": 1e-5}
    report = check_laws(system, TIMES, START, laws=["energy", "error"], **settings)
    energy = np.asarray(simulate(system, TIMES, START, **settings).laws.energy)
    assert report.times[-1] == pytest.approx(TIMES[-1])
    assert set(report.residuals) == {"energy"}
    found = report.residuals["energy"] * report["energy"].expected
    assert 0 < found.max() == pytest.approx(report["energy"].residual)
    np.testing.assert_allclose(found[-1], abs(energy[-1] - energy[0]), rtol=1e-6)
    assert "residuals" not in report.as_dict()["rows"][0]
