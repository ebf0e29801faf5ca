"""What every test of the figures shares: small runs, and a check that matplotlib is left as it was."""

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot

import jaxball

matplotlib.use("Agg")


@pytest.fixture(autouse=True)
def leaves_matplotlib_alone():
    """No setting is changed, and no figure stays open in pyplot."""
    before = matplotlib.rcParams.copy()
    yield
    assert matplotlib.rcParams == before
    assert pyplot.get_fignums() == []


@pytest.fixture(scope="session")
def bare_trajectory():
    """A ball without point masses, whose shell is off its centre, spun so fast that it leaves the plane."""
    ball = jaxball.Ball(mass=1.0, inertia=(0.9, 1.0, 1.1), offset=(0.0, 0.0, -0.4))
    times = np.linspace(0.0, 2.0, 41)
    return jaxball.simulate(ball, times, jaxball.BallState(Omega=(0.0, 4.0, 0.0)), rtol=1e-6, atol=1e-6)


@pytest.fixture(scope="session")
def failed_trajectory(ball_trajectory):
    """The paper's ball whose solve stopped between t = 6 and t = 7, and could not know what came after."""
    nan_after = jnp.where(ball_trajectory.times > 6.0, jnp.nan, 0.0)
    state = jax.tree.map(lambda leaf: leaf + nan_after[:, None], ball_trajectory.state)
    status = jnp.asarray(int(jaxball.Status.MAX_STEPS))
    return eqx.tree_at(lambda run: (run.state, run.status), ball_trajectory, (state, status))


@pytest.fixture(scope="session")
def hopeless_trajectory(ball_trajectory):
    """A trajectory without a finite state."""
    return eqx.tree_at(lambda run: run.state.q, ball_trajectory, jnp.full((21, 4), jnp.nan))


@pytest.fixture(scope="session")
def reduced_trajectory():
    """A ball of which Ω and Γ are known, and nothing else."""
    ball = jaxball.Ball(mass=1.0, inertia=(0.9, 1.0, 1.1))
    return jaxball.simulate(ball, np.array([0.0, 1.0]), jaxball.physics.ReducedState(), rtol=1e-6, atol=1e-6)


@pytest.fixture(scope="session")
def thrown_trajectory():
    """A homogeneous ball that is thrown with backspin: it bounces from t = 1 on, slides, and rolls at the end."""
    ball = jaxball.Ball(mass=1.0, inertia=(0.4, 0.4, 0.4))
    thrown = jaxball.physics.ReleasedState(jaxball.BallState(Omega=(0.0, -8.0, 0.0)), V=(2.0, 0.5, 0.0), height=0.5)
    contact = jaxball.Contact(friction=0.3, static_friction=0.35, restitution=0.6, slowest=0.05)
    times = np.linspace(0.0, 11.0, 111)
    return jaxball.simulate(ball, times, thrown, contact=contact, rtol=1e-8, atol=1e-8)
