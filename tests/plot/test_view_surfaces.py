"""A surface in a browser: it is drawn, moves with the ground, and carries the trace and the forces."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import BallState, FunctionSchedule, HeightField, simulate
from jaxball.physics import TiltingPlane
from tests.plot.test_surfaces import TIMES, marble, swing, waves
from tests.plot.test_view_browser import go_to, picture
from tests.support.browser import needs_chromium

pytestmark = needs_chromium

GROUNDS = {
    "plate": TiltingPlane(about_e1=FunctionSchedule(swing)),
    "waves": HeightField(waves, jnp.array(0.1)),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", GROUNDS)
def test_a_moving_surface_is_drawn(browser, tmp_path, name):
    """Nothing fails, the ball is where the run has it, and what is drawn changes with the time and comes back."""
    run = simulate(marble(GROUNDS[name]), TIMES, BallState(z=(0.1, 0.1)), rtol=1e-6, atol=1e-6)
    path = tmp_path / "run.html"
    run.view(path)
    browser.get(path.as_uri())
    first = picture(browser)
    assert len(np.unique(first.reshape(-1, 4), axis=0)) > 200
    go_to(browser, float(TIMES[20]))
    pose = browser.execute_script("return jaxball.pose()")
    np.testing.assert_allclose(pose["centre"], np.asarray(run.observables.geometric_centre)[20], atol=1e-6)
    assert 0.02 < np.mean(np.any(first != picture(browser), axis=-1)) < 0.9
    go_to(browser, float(TIMES[0]))
    np.testing.assert_array_equal(picture(browser), first)
    assert browser.get_log("browser") == []
