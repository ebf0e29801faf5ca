"""The settings of XLA change no number: values and derivatives in a process with them and in one without."""

import os

import numpy as np
import pytest

from tests.support.scripts import printed_by

# The times are few and early, because rounding moves step sizes, and those move the ends of long runs.
COMPUTE = """
import sys
from jaxball.programs import cpu
assert sys.argv[2] == "without" or cpu.prepare()
import diffrax, jax, jax.numpy as jnp, numpy as np
jax.config.update("jax_enable_x64", True)
from jaxball import BallState, contact_extremes, paper, simulate
from jaxball.simulation.ensemble import simulate_ensemble
from jaxball.simulation.ensemble.reductions import CONTACT
leaves, structure = jax.tree.flatten(paper.ball())
p, times = jnp.array([1.0, 1.0, 1.0]), jnp.array([0.0, 0.3, 0.6])
fine = dict(rtol=1e-12, atol=1e-12)
def ball(p):
    return structure.unflatten([leaf * p[k % 3] for k, leaf in enumerate(leaves)])
def end(p, **options):
    run = simulate(ball(p), times, **fine, **options)
    return jnp.concatenate([part[-1] for part in (run.state.q, run.state.Omega, run.state.z)]), run
def with_contact(p):
    last, run = end(p, dense=True)
    contact = contact_extremes(run)
    return jnp.concatenate(
        [last, jnp.stack([contact.least_normal_force, contact.friction_needed, contact.largest_friction])]
    )
def ensemble(p):
    states = jax.vmap(lambda W: BallState(Omega=W))(jnp.linspace(0.0, 0.2, 6).reshape(2, 3))
    many = simulate_ensemble(ball(p), times, states, reductions=CONTACT, in_axes=(None, 0), **fine)
    return jnp.concatenate(
        [many.trajectory.state.z[:, -1].ravel(), *(many.reductions[name] for name in CONTACT)]
    )
value, pullback = jax.jit(lambda p: jax.vjp(with_contact, p))(p)
results = {"run": value, "reverse": jax.vmap(pullback)(jnp.eye(value.size))[0]}
results["forward"] = jax.jit(jax.jacfwd(lambda p: end(p, adjoint=diffrax.ForwardMode())[0]))(p)
results["ensemble"], results["of the ensemble"] = jax.jvp(ensemble, (p,), (jnp.array([0.3, -0.2, 0.1]),))
np.savez(sys.argv[1], **results)
"""


@pytest.mark.slow
def test_values_and_derivatives_are_the_same_without_the_settings(tmp_path):
    """To 1e-10 of the largest: steps that rounding moves differ by the tolerance, 1e-12, which a run magnifies."""
    environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    found = {}
    for settings in ("with", "without"):
        printed_by("-c", COMPUTE, str(tmp_path / f"{settings}.npz"), settings, env=environment)
        found[settings] = np.load(tmp_path / f"{settings}.npz")
    for name, wanted in found["without"].items():
        assert np.all(np.isfinite(wanted)), name
        assert np.any(wanted != 0), name
        np.testing.assert_allclose(found["with"][name], wanted, atol=1e-10 * np.max(np.abs(wanted)), err_msg=name)
    both = found["without"]
    np.testing.assert_allclose(both["reverse"][: len(both["forward"])], both["forward"], rtol=1e-8, atol=1e-9)
