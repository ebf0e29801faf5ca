"""Ensembles of bodies that slip, stick, fly and bounce: each run errs in proportion to its own tolerance."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.simulation.ensemble import simulate_ensemble
from tests.contact.test_convergence import BODIES, FINEST, TOLERANCES, require_close, simulated


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "law"), BODIES)
def test_errors_are_in_proportion_to_the_tolerance(kind, law):
    case, tolerances = kind(), np.array(TOLERANCES)
    states = jax.tree.map(lambda leaf: jnp.stack([leaf] * len(tolerances)), case.state)
    settings = {"contact": law, "rtol": tolerances, "atol": tolerances, "max_steps": 2000, "in_axes": (None, 0)}
    runs = simulate_ensemble(case.body, [0.0, case.end], states, **settings)
    fine = simulated(case, law, FINEST)
    for row, tolerance in enumerate(tolerances):
        require_close(runs[row], fine, tolerance)
