"""A progress meter is told how far a solve has come, and changes nothing of it."""

import diffrax
import jax
import numpy as np
import pytest

import jaxball

DISK = jaxball.Disk(mass=1.0, inertia=0.5, offset=(0.1, 0.0, -0.2))
TIMES = np.array([0.0, 10.0])


@pytest.mark.thorough
def test_a_text_meter(capfd):
    watched = jaxball.simulate(DISK, TIMES, progress=diffrax.TextProgressMeter(minimum_increase=0.3))
    jax.effects_barrier()
    lines = capfd.readouterr().out.split()
    parts = [float(line.rstrip("%")) for line in lines]
    assert parts[0] == 0
    assert parts[-1] == 100
    assert len(parts) > 2
    assert parts == sorted(parts)
    unwatched = jaxball.simulate(DISK, TIMES)
    np.testing.assert_allclose(watched.state.z, unwatched.state.z, atol=1e-13)
