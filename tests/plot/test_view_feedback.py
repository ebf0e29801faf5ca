"""What a view shows of a run under feedback: the motion that is held, and the estimate with its ellipse."""

import base64
import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from jaxball.control.estimation.estimate import Belief, Followed, LoopEstimate
from jaxball.control.history import FeedbackHistory
from jaxball.physics.hybrid import NO_HISTORY
from jaxball.plot.view.feedback import half_axes
from tests.support.browser import SOFTWARE, chromium, needs_chromium

DIRECTIONS = ("attitude[0]", "attitude[1]", "attitude[2]", "Omega[0]", "Omega[1]", "Omega[2]", "z[0]", "z[1]")


@pytest.fixture(scope="module")
def run(ball_trajectory):
    """The paper's ball, as if it had drifted from a motion beside it, and somebody thought that it was elsewhere."""
    states, count = ball_trajectory.state, len(ball_trajectory.times)
    nominal = dataclasses.replace(states, z=states.z + jnp.array([[0.3, 0.0]]), q=jnp.roll(states.q, 1, axis=0))
    thought = dataclasses.replace(states, z=states.z.at[:-1].add(0.1).at[-1].set(jnp.nan))
    P = jnp.zeros((count, 8, 8)).at[:, 6:, 6:].set(jnp.array([[0.04, 0.018], [0.018, 0.01]]))
    P = P.at[-1].set(jnp.nan)
    zero = jnp.zeros(count)
    times = jnp.asarray(ball_trajectory.times)
    followed = Followed(Belief(thought, zero[:, None][:, :0], P), zero, zero.astype(int))
    estimate = LoopEstimate(times, DIRECTIONS, (), followed)
    return dataclasses.replace(
        ball_trajectory, history=FeedbackHistory(NO_HISTORY, nominal, zero[:, None], estimate, ("u",))
    )


def arrays(document, name):
    told = document["arrays"][document["bodies"][0]["arrays"][name]]
    return np.frombuffer(base64.b64decode(told["data"]), dtype=told["type"]).reshape(told["shape"])


@pytest.mark.thorough
def test_the_ghost_is_the_motion_and_the_estimate_lies_on_the_plane(run):
    """To the millionth of a radius to which positions are packed."""
    document = run.view().document
    z = np.asarray(run.history.nominal.z)
    np.testing.assert_allclose(arrays(document, "nominal_centre")[:, :2], z, rtol=0, atol=2e-6)
    turned = Rotation.from_quat(arrays(document, "nominal_quaternion")).as_matrix()
    np.testing.assert_allclose(turned, run.history.nominal.Lambda, rtol=0, atol=1e-5)
    place, below = arrays(document, "estimate"), arrays(document, "centre")[:, 2] - float(run.system.radius)
    np.testing.assert_allclose(place[:-1, :2], np.asarray(run.state.z)[:-1] + 0.1, rtol=0, atol=2e-6)
    np.testing.assert_allclose(place[:, 2], below, rtol=0, atol=2e-6)
    np.testing.assert_array_equal(place[-1], place[-2])  # where nothing is read any more


def test_the_half_axes_are_those_of_the_ellipse_of_95_percent():
    """Points of the ellipse have ξ·P⁻¹ξ = χ²; of a line, it is the normal distribution's interval."""
    P = np.array([[[0.04, 0.018], [0.018, 0.01]]])
    axes = half_axes(P)[0]
    angles = np.linspace(0.0, 2 * np.pi, 7)
    points = np.cos(angles)[:, None] * axes[0] + np.sin(angles)[:, None] * axes[1]
    found = np.einsum("ki,ij,kj->k", points[:, :2], np.linalg.inv(P[0]), points[:, :2])
    np.testing.assert_allclose(found, chi2.ppf(0.95, 2), rtol=1e-9)
    np.testing.assert_allclose(half_axes(np.array([[[0.25]]]))[0], [[0.5 * 1.959963984540054, 0, 0], [0, 0, 0]])


@pytest.mark.thorough
def test_graphs_show_deviations_and_innovations_with_their_bounds(run):
    """Deviations are those of the history. Bounds are the quantiles of as many squared normal numbers as are read."""
    estimate = dataclasses.replace(
        run.history.estimate,
        filtered=run.history.estimate.filtered._replace(read=jnp.arange(len(run.times)) % 3),
    )
    document = dataclasses.replace(run, history=dataclasses.replace(run.history, estimate=estimate)).view().document
    titles = [one["title"] for one in document["plots"]]
    assert titles[-2 - len(run.system.mechanisms) - 1 :][:2] == ["Deviation", "Innovation, 95 %"]
    deviation = next(one for one in document["plots"] if one["title"] == "Deviation")
    assert [line["name"] for line in deviation["series"]] == ["|δφ|", "|δΩ|", "|δz|"]
    assert deviation["series"][2]["columns"] == [6, 7]
    shown = np.linalg.norm(arrays(document, "deviation")[:, 6:], axis=1)
    np.testing.assert_allclose(shown, 0.3, rtol=1e-6)  # of float32
    upper, lower = arrays(document, "innovation")[:, 1:].T
    assert np.isnan(upper[0])
    expected = [chi2.ppf(p, [1, 2]) for p in (0.975, 0.025)]
    np.testing.assert_allclose([upper[1:3], lower[1:3]], expected, rtol=1e-6)


def test_other_runs_have_neither(ball_trajectory):
    assert "nominal_centre" not in ball_trajectory.view().document["bodies"][0]["arrays"]


@pytest.mark.long
@needs_chromium
def test_the_browser_shows_both(run, tmp_path):
    """The scene's numbers at a saved time, and no message of the browser."""
    path = tmp_path / "held.html"
    run.view(path)
    with chromium(*SOFTWARE) as browser:
        browser.get(path.as_uri())
        browser.execute_script("jaxball.goTo(5.0)")
        pose = browser.execute_script("return jaxball.pose()")
        layers = browser.execute_script("return document.getElementById('layers').textContent")
        assert not browser.get_log("browser")
    state = jax.tree.map(lambda leaf: np.asarray(leaf)[5], run.history.nominal)
    np.testing.assert_allclose(pose["ghost"][:2], state.z, rtol=0, atol=2e-6)
    np.testing.assert_allclose(pose["estimate"][:2], np.asarray(run.state.z)[5] + 0.1, rtol=0, atol=2e-6)
    axes = half_axes(np.asarray(run.history.estimate.covariance)[5:6, 6:, 6:])[0]
    np.testing.assert_allclose(np.reshape(pose["ellipse"], (2, 4))[:, :3], axes, rtol=0, atol=2e-6)
    assert "Motion that is held" in layers
    assert "Estimate, 95 % ellipse" in layers
