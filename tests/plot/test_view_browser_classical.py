"""Views of rigid bodies and particles in a browser: no error, no request, a scene with the numbers of the run."""

import numpy as np
import pytest
from selenium.webdriver.common.by import By

import jaxball
from jaxball import plot
from jaxball.physics.classical import (
    ChaplyginSleigh,
    HeavyTop,
    LagrangianState,
    NonholonomicParticle,
    ParticleState,
    RigidBodyState,
)
from tests.plot.test_view_browser import (
    choose,
    go_to,
    picture,
    shown_names,
)
from tests.support.browser import needs_chromium, pose

pytestmark = needs_chromium
TIMES = np.linspace(0.0, 4.0, 41)


@pytest.fixture(scope="module")
def top_run():
    start = RigidBodyState(q=(np.cos(0.3), np.sin(0.3), 0.0, 0.0), Omega=(0.4, 0.1, 3.0))
    top = HeavyTop(inertia=(1.2, 1.2, 0.5), chi=(0.1, 0.0, 0.6))
    return jaxball.simulate(top, TIMES, start, rtol=1e-8, atol=1e-8)


@pytest.fixture(scope="module")
def particle_run():
    start = ParticleState(y=1.0, xdot=1.0, ydot=1.0)
    return jaxball.simulate(NonholonomicParticle(), TIMES, start, rtol=1e-8, atol=1e-8)


def check_scene(page):
    """It is drawn, moves, comes back, and every layer is seen; there was no error and no request."""
    go_to(page, 0.0)
    first = picture(page)
    assert len(np.unique(first.reshape(-1, 4), axis=0)) > 100
    go_to(page, 2.0)
    second = picture(page)
    assert np.mean(np.any(first != second, axis=-1)) > 0.002
    for box in page.find_elements(By.CSS_SELECTOR, "#layers input"):
        names = shown_names(page)
        box.click()
        assert np.any(picture(page) != second) or shown_names(page) != names, box.find_element(By.XPATH, "..").text
        box.click()
    np.testing.assert_array_equal(picture(page), second)
    page.find_element(By.ID, "theme").click()
    assert np.any(picture(page) != second)
    assert page.get_log("browser") == []
    assert page.execute_script("return performance.getEntriesByType('resource').length") == 0


@pytest.mark.long
def test_a_top_has_the_pose_of_its_state(browser, top_run, tmp_path):
    plot.write_view({"a": top_run, "b": top_run}, tmp_path / "tops.html")
    browser.get((tmp_path / "tops.html").as_uri())
    for k in (0, 17, 40):
        go_to(browser, float(TIMES[k]))
        for body in range(2):
            q = np.roll(pose(browser, body)["quaternion"], 1)
            np.testing.assert_allclose(abs(q @ np.asarray(top_run.state.q[k])), 1.0, atol=1e-6)
    assert pose(browser, 0)["centre"] == [0.0, 0.0, 0.0]
    np.testing.assert_allclose(pose(browser)["centreOfMass"], [0.1, 0.0, 0.6], atol=1e-6)
    assert [item.text for item in browser.find_elements(By.CSS_SELECTOR, "#masses li")] == ["E₁", "E₂", "E₃"]
    check_scene(browser)


@pytest.mark.long
def test_in_its_frame_a_top_is_at_rest(browser, top_run, tmp_path):
    """Of what moves, only that the body carries is left: its axes cover the same pixels at all times."""
    browser.get(top_run.view(tmp_path / "top.html").save(tmp_path / "top.html").as_uri())
    for text in ("ω", "Angular momentum L", "Trace of the axis", "Axes of space"):
        choose(browser, text)
    go_to(browser, 0.0)
    in_space = picture(browser)
    go_to(browser, 2.0)
    assert np.any(picture(browser) != in_space)
    choose(browser, "Body frame")
    there = picture(browser)
    go_to(browser, 0.0)
    # The light is at rest in the scene, and so are small differences of rounding at edges.
    assert np.mean(np.any(np.abs(picture(browser) - there) > 64, axis=-1)) < 1e-3


@pytest.mark.long
def test_a_particle_is_where_its_state_is(browser, particle_run, tmp_path):
    browser.get(particle_run.view(tmp_path / "particle.html").save(tmp_path / "particle.html").as_uri())
    state = particle_run.state
    for k in (0, 17, 40):
        go_to(browser, float(TIMES[k]))
        np.testing.assert_allclose(pose(browser)["centre"], [state.x[k], state.y[k], state.z[k]], atol=1e-6)
    check_scene(browser)


@pytest.mark.long
def test_a_picture_by_a_function_is_drawn(browser, tmp_path):
    start = LagrangianState([0.0, 0.0, 0.2], [np.cos(0.2), np.sin(0.2), 1.0])
    sleigh = jaxball.simulate(ChaplyginSleigh(inertia=0.4, ahead=0.5), TIMES, start)

    def blade(t, q):
        return [np.stack([q[:2], q[:2] + np.stack([np.cos(q[2]), np.sin(q[2])])]), q[:2][None]]

    browser.get(sleigh.view(picture=blade).save(tmp_path / "sleigh.html").as_uri())
    check_scene(browser)


@pytest.mark.thorough
@pytest.mark.parametrize(("width", "open_"), [(770, False), (960, True)])
def test_in_a_narrow_frame_the_settings_start_closed(browser, particle_run, tmp_path, width, open_):
    notebook = tmp_path / "notebook.html"
    frame = particle_run.view()._repr_html_().replace("width: 100%", f"width: {width}px")
    notebook.write_text(f"<!doctype html><meta charset=utf-8><body style='margin: 0'>{frame}", encoding="utf-8")
    browser.get(notebook.as_uri())
    browser.switch_to.frame(browser.find_element(By.TAG_NAME, "iframe"))
    assert browser.execute_script("return innerWidth") == width
    settled = "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(() => done(settings.open)))"
    assert browser.execute_async_script(settled) is open_
    browser.switch_to.default_content()
