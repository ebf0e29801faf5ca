"""A view in a browser, from file://: it runs without an error or a request, and shows the run's numbers."""

import base64
import io
import re

import numpy as np
import pytest
from PIL import Image
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

import jaxball
from jaxball import BallState, plot
from jaxball.plot.style import ColourScale
from jaxball.plot.view.page import View, view_document
from tests.plot.test_view_page import HOSTILE
from tests.support.browser import chromium, needs_chromium, pose
from tests.support.colour_vision import contrast

pytestmark = needs_chromium


@pytest.fixture(scope="module")
def opened(browser, ball_trajectory, tmp_path_factory):
    path = tmp_path_factory.mktemp("view") / "run.html"
    ball_trajectory.view(path, title=HOSTILE, friction=0.3)
    browser.get(path.as_uri())
    return browser


@pytest.fixture
def page(opened):
    """The page at its first time, seen from the ground."""
    yield opened
    choose(opened, "Ground")
    go_to(opened, 0.0)


def picture(page):
    """The pixels of the scene once it is drawn."""
    text = page.execute_async_script(
        "const done = arguments[0], canvas = document.getElementById('scene');"
        "requestAnimationFrame(() => requestAnimationFrame(() => done(canvas.toDataURL())));"
    )
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(text.partition(",")[2]))).convert("RGBA"), dtype=int)


def shown_names(page):
    return [one.text for one in page.find_elements(By.CSS_SELECTOR, "#labels span") if one.is_displayed()]


def go_to(page, t):
    page.execute_script("jaxball.goTo(arguments[0])", t)


def time(page):
    return page.execute_script("return jaxball.time()")


@pytest.mark.thorough
def test_nothing_fails_and_nothing_is_asked_for(page):
    go_to(page, 7.0)
    assert page.get_log("browser") == []
    assert page.execute_script("return performance.getEntriesByType('resource').length") == 0


@pytest.mark.thorough
def test_a_hostile_title_is_shown_as_it_is(page):
    assert page.execute_script("return document.getElementById('title').textContent") == HOSTILE
    assert page.title.startswith('</script><img src=x onerror="window.hacked = 1"><!-- <script>')
    assert page.execute_script("return window.hacked") is None
    assert page.find_elements(By.TAG_NAME, "img") == []


@pytest.mark.thorough
def test_a_script_that_is_not_jaxballs_does_not_run(page):
    """The negative control of the policy: with another, the element would run."""
    page.execute_script(
        "const s = document.createElement('script'); s.textContent = 'window.hacked = 1'; document.body.append(s)"
    )
    assert page.execute_script("return window.hacked") is None
    assert "violates the following Content Security Policy" in page.get_log("browser")[0]["message"]


@pytest.mark.thorough
def test_the_scene_shows_the_pose_of_the_run(page, ball_trajectory):
    seen = ball_trajectory.observables
    for k in (0, 7, 20):
        go_to(page, float(ball_trajectory.times[k]))
        pose = page.execute_script("return jaxball.pose()")
        assert pose["time"] == float(ball_trajectory.times[k])
        np.testing.assert_allclose(pose["centre"], seen.geometric_centre[k], atol=1e-6)
        np.testing.assert_allclose(pose["masses"], seen.mass_positions_body[k], atol=1e-6)
        np.testing.assert_allclose(pose["centreOfMass"], seen.centre_of_mass_body[k], atol=1e-6)
        q = np.roll(pose["quaternion"], 1)  # the scalar first, as the state has it, up to the sign
        np.testing.assert_allclose(abs(q @ np.asarray(ball_trajectory.state.q[k])), 1.0, atol=1e-12)


@pytest.mark.thorough
def test_the_scene_is_drawn_and_moves(page):
    first = picture(page)
    assert len(np.unique(first.reshape(-1, 4), axis=0)) > 200
    go_to(page, 9.0)
    second = picture(page)
    assert 0.005 < np.mean(np.any(first != second, axis=-1)) < 0.9
    go_to(page, 0.0)
    np.testing.assert_array_equal(picture(page), first)


@pytest.mark.long
@pytest.mark.parametrize(("frame", "layer"), [("Follow", "Contact point"), ("Body frame", "Axes of the body")])
def test_a_frame_keeps_in_place_what_is_at_rest_in_it(page, frame, layer):
    """On a level plane the contact point is straight below the centre; the body's axes turn with the body."""

    def where(t):
        """The pixels that the layer covers."""
        go_to(page, t)
        before = picture(page)
        choose(page, layer)
        covered = np.any(picture(page) != before, axis=-1)
        choose(page, layer)
        return covered

    def shared():
        start, later = where(0.0), where(9.0)
        return np.sum(start & later) / np.sum(start | later)

    assert shared() < 0.3
    choose(page, frame)
    assert shared() > 0.5  # masses and rails are in front of it now and then


def choose(page, text):
    page.find_element(By.XPATH, f"//label[contains(., '{text}')]/input").click()


@pytest.mark.thorough
def test_graphs_follow_and_lead_the_time(page):
    plots = page.find_elements(By.CSS_SELECTOR, ".plot > canvas")
    assert len(plots) == 5
    places = []
    for t in (0.0, 5.0, 20.0):
        go_to(page, t)
        places.append([float(plot.get_attribute("data-cursor")) for plot in plots])
    start, quarter, end = np.asarray(places)
    assert np.all(end - start > 100)
    np.testing.assert_allclose(quarter, start + (end - start) / 4, atol=1e-6)
    plot = plots[1]
    across = start[1] + 0.6 * (end[1] - start[1]) - plot.size["width"] / 2  # from the middle: t = 12
    ActionChains(page).move_to_element_with_offset(plot, round(across), 0).click().perform()
    assert time(page) == 12.0
    ActionChains(page).click_and_hold(plot).move_by_offset(400, 0).release().perform()
    assert time(page) == 20.0


@pytest.mark.thorough
def test_coloured_numbers_can_be_read_on_light_and_dark(page):
    """The contrast that WCAG asks for, AA, of every text beside a graph and in the scene."""
    for _ in range(2):
        paper = colour_of(page, "body", "background-color")
        texts = page.find_elements(By.CSS_SELECTOR, ".plot figcaption span, #labels span, #masses li, #units")
        assert len(texts) > 10
        for text in texts:
            colour = page.execute_script("return getComputedStyle(arguments[0]).color", text)
            assert contrast(hex_of(colour), paper) >= 4.5, text.text
        page.find_element(By.ID, "theme").click()


def colour_of(page, selector, name):
    script = "return getComputedStyle(document.querySelector(arguments[0])).getPropertyValue(arguments[1])"
    return hex_of(page.execute_script(script, selector, name))


def hex_of(text):
    return "#" + "".join(f"{int(part):02x}" for part in re.findall(r"\d+", text)[:3])


@pytest.mark.thorough
def test_axes_and_arrows_have_names(page):
    go_to(page, 7.0)
    assert {"N", "N + f", "m₁", "m₂", "m₃"} <= set(shown_names(page))
    assert any(name.endswith(" f") for name in shown_names(page))
    for layer, names in (("Axes of space", {"e₁", "e₂", "e₃"}), ("Axes of the body", {"E₁", "E₂", "E₃"})):
        assert not names & set(shown_names(page))
        choose(page, layer)
        assert names <= set(shown_names(page))
        choose(page, layer)


@pytest.mark.thorough
def test_graphs_and_the_scene_have_roles_and_keys(page):
    graph = page.find_elements(By.CSS_SELECTOR, ".plot > canvas")[1]
    assert (graph.get_attribute("role"), graph.get_attribute("tabindex")) == ("slider", "0")
    graph.send_keys(Keys.ARROW_RIGHT)
    assert time(page) == 1.0
    assert graph.get_attribute("aria-valuenow") == "1"
    assert graph.get_attribute("aria-valuetext").startswith("t = 1: Ω₁ ")
    graph.send_keys(Keys.END)
    assert time(page) == 20.0
    scene = page.find_element(By.ID, "scene")
    before = picture(page)
    scene.send_keys(Keys.ARROW_LEFT)
    assert time(page) == 20.0
    assert np.any(picture(page) != before)
    scene.send_keys(Keys.HOME)
    np.testing.assert_array_equal(picture(page), before)


@pytest.mark.thorough
def test_keys_step_and_play(page):
    body = page.find_element(By.TAG_NAME, "body")
    body.send_keys(Keys.ARROW_RIGHT * 3, Keys.ARROW_LEFT)
    assert time(page) == 2.0
    page.execute_script("document.getElementById('speed').value = 16; speed.dispatchEvent(new Event('change'))")
    body.send_keys(" ")
    moved = "const done = arguments[0]; const f = () => jaxball.time() > 2 ? done(true) : setTimeout(f, 20); f()"
    assert page.execute_async_script(moved)
    assert "playing" in page.find_element(By.ID, "play").get_attribute("class") or time(page) == 20.0
    go_to(page, 3.0)
    assert "playing" not in page.find_element(By.ID, "play").get_attribute("class")


@pytest.mark.long
def test_layers_and_theme_change_what_is_seen(page):
    go_to(page, 7.0)
    before = picture(page)
    for box in page.find_elements(By.CSS_SELECTOR, "#layers input"):
        names = shown_names(page)
        box.click()
        hidden = np.any(picture(page) != before) or shown_names(page) != names  # names are texts over the canvas
        assert hidden, box.find_element(By.XPATH, "..").text
        box.click()
    np.testing.assert_array_equal(picture(page), before)
    dark = page.execute_script("return document.documentElement.dataset.theme")
    page.find_element(By.ID, "theme").click()
    assert page.execute_script("return document.documentElement.dataset.theme") != dark
    assert np.any(picture(page) != before)
    page.find_element(By.ID, "theme").click()
    np.testing.assert_array_equal(picture(page), before)


@pytest.mark.long
def test_the_slider_is_a_time(browser, tmp_path):
    """Saved times that crowd at the start: half of them are in a hundredth of the time."""
    times = np.concatenate([np.linspace(0.0, 0.1, 11), np.linspace(1.0, 10.0, 10)])
    ball = jaxball.Ball(mass=1.0, inertia=(0.4, 0.4, 0.4))
    run = jaxball.simulate(ball, times, BallState(Omega=(0.0, 1.0, 0.0)), rtol=1e-6, atol=1e-6)
    browser.get(run.view(tmp_path / "run.html").save(tmp_path / "run.html").as_uri())
    go_to(browser, 5.0)
    place = "const s = document.getElementById('slider'); return (s.value - s.min) / (s.max - s.min)"
    np.testing.assert_allclose(browser.execute_script(place), 0.5, atol=1e-9)
    browser.execute_script("slider.value = 8; slider.dispatchEvent(new Event('input'))")
    assert time(browser) == 8.0


@pytest.mark.long
def test_a_frame_that_grows_sees_all_beside_its_settings(browser, disk_trajectory, tmp_path):
    """The settings open when there is room for them, and the disk at its start is left of them."""
    browser.get(disk_trajectory.view(tmp_path / "disk.html").save(tmp_path / "disk.html").as_uri())
    browser.set_window_size(700, 900)
    browser.refresh()
    go_to(browser, 0.0)
    browser.set_window_size(1100, 900)
    assert browser.execute_async_script(
        "const done = arguments[0];"
        "const f = () => settings.open ? setTimeout(() => done(true), 100) : setTimeout(f, 20); f()"
    )
    right = browser.execute_script("return document.getElementById('settings').getBoundingClientRect().left")
    assert len(shown_names(browser)) > 4
    for name in browser.find_elements(By.CSS_SELECTOR, "#labels span"):
        if name.is_displayed():
            assert name.rect["x"] + name.rect["width"] < right, name.text
    browser.set_window_size(1000, 900)


@pytest.mark.long
def test_less_motion_is_shown_in_steps(browser, ball_trajectory, tmp_path):
    browser.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-reduced-motion", "value": "reduce"}]}
    )
    browser.get(ball_trajectory.view(tmp_path / "run.html").save(tmp_path / "run.html").as_uri())
    frames = browser.execute_async_script(
        "const done = arguments[0], seen = new Set(); document.getElementById('speed').value = 4;"
        "speed.dispatchEvent(new Event('change')); play.click();"
        "const end = performance.now() + 1600;"
        "const f = () => { seen.add(jaxball.time());"
        "performance.now() < end ? requestAnimationFrame(f) : done([...seen]) };"
        "f()"
    )
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    assert 2 <= len(frames) <= 5  # two a second, where each of the seven times would be shown


@pytest.mark.long
def test_a_failed_run_says_so(browser, failed_trajectory, tmp_path):
    browser.get(failed_trajectory.view(tmp_path / "failed.html").save(tmp_path / "failed.html").as_uri())
    status = browser.find_element(By.ID, "status")
    assert status.text == failed_trajectory.message
    assert status.get_attribute("class") == "failed"
    go_to(browser, 20.0)
    assert time(browser) == 6.0
    assert browser.get_log("browser") == []


@pytest.mark.long
def test_a_body_that_flies_is_over_the_plane_and_its_mode_is_named(browser, thrown_trajectory, tmp_path):
    """At t = ½ it has fallen by ⅛ from ½."""
    browser.get(thrown_trajectory.view().save(tmp_path / "thrown.html").as_uri())
    clock = browser.find_element(By.ID, "clock")
    for t, mode, height in ((0.5, "flight", 0.375), (6.0, "sliding", 0.0), (11.0, "rolling", 0.0)):
        go_to(browser, t)
        assert clock.text.endswith(f", {mode}")
        centre = browser.execute_script("return jaxball.pose().centre")
        np.testing.assert_allclose(centre[2], height, atol=1e-6)
    friction, height = browser.find_elements(By.CSS_SELECTOR, ".plot")[3:5]
    assert "μₛ = 0.35" in friction.text
    assert "Height" in height.text
    assert [item.text for item in browser.find_elements(By.CSS_SELECTOR, "#masses li")] == ["flight", "sliding"]
    assert browser.get_log("browser") == []


@pytest.mark.thorough
def test_a_notebook_runs_it_in_a_frame(browser, ball_trajectory, tmp_path):
    notebook = tmp_path / "notebook.html"
    notebook.write_text(f"<!doctype html><meta charset=utf-8>{ball_trajectory.view()._repr_html_()}", encoding="utf-8")
    browser.get(notebook.as_uri())
    browser.switch_to.frame(browser.find_element(By.TAG_NAME, "iframe"))
    go_to(browser, 7.0)
    assert time(browser) == 7.0
    assert len(np.unique(picture(browser).reshape(-1, 4), axis=0)) > 200
    browser.switch_to.default_content()
    assert browser.get_log("browser") == []


@pytest.fixture(scope="module")
def others():
    """Two runs of another ball, at times of their own."""
    ball = jaxball.Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), radius=0.5)
    times = {HOSTILE: np.linspace(0.0, 4.0, 9), "row 4": np.linspace(0.0, 3.0, 5)}
    return {
        name: jaxball.simulate(ball, at, BallState(Omega=(0.0, rate, 0.1)), rtol=1e-6, atol=1e-6)
        for rate, (name, at) in enumerate(times.items(), start=1)
    }


@pytest.fixture
def several(browser, ball_trajectory, others, tmp_path):
    """Three bodies on one plane, coloured by a number whose name is no HTML."""
    runs = {"row 3": ball_trajectory, **others}
    wanted = np.array([[0.0, 0.0], [2.0, 1.0]])
    scale = ColourScale(HOSTILE, [1.0, 2.0, 4.0])
    discs = [(np.array([3.0, -1.5]), 1.0)]
    plot.write_view(runs, tmp_path / "runs.html", wanted=wanted, discs=discs, scale=scale)
    browser.get((tmp_path / "runs.html").as_uri())
    return browser


@pytest.mark.long
def test_each_body_has_the_pose_of_its_run_at_its_own_time(several, ball_trajectory, others):
    """The last time of a body stays when the clock goes on; the smaller balls are on the plane of the first."""
    assert several.execute_script("return jaxball.bodies()") == ["row 3", HOSTILE, "row 4"]
    expected = {0.0: (0, 0, 0), 3.0: (3, 6, 4), 4.0: (4, 8, 4), 20.0: (20, 8, 4)}
    for t, rows in expected.items():
        go_to(several, t)
        for body, (k, run) in enumerate(zip(rows, [ball_trajectory, *others.values()], strict=True)):
            found, centre = pose(several, body), np.asarray(run.observables.geometric_centre[k])
            assert found["time"] == float(run.times[k])
            lower = [0.0, 0.0, 0.0 if body == 0 else -0.5]
            np.testing.assert_allclose(found["centre"], centre + lower, atol=1e-6)
            q, versor = np.roll(found["quaternion"], 1), np.asarray(run.state.q[k])
            np.testing.assert_allclose(abs(q @ versor), np.linalg.norm(versor), atol=1e-12)
    assert several.get_log("browser") == []


@pytest.mark.long
def test_names_of_runs_and_numbers_are_text(several):
    names = [button.text.replace("\n", " ") for button in several.find_elements(By.CSS_SELECTOR, "#names button")]
    assert [names[0], names[2]] == ["row 3 1", "row 4 4"]
    assert several.execute_script("return document.querySelector('#scale p').textContent") == HOSTILE
    ends = [end.text for end in several.find_elements(By.CSS_SELECTOR, "#scale .ends span")]
    assert ends == ["1", "4"]
    assert several.execute_script("return window.hacked") is None
    assert several.find_elements(By.TAG_NAME, "img") == []
    assert several.execute_script("return performance.getEntriesByType('resource').length") == 0


@pytest.mark.long
def test_the_body_of_the_pressed_button_is_followed(several):
    choose(several, "Follow")
    go_to(several, 2.0)
    buttons = several.find_elements(By.CSS_SELECTOR, "#names button")
    seen = []
    for body, button in enumerate(buttons):
        button.click()
        assert [one.get_attribute("aria-pressed") for one in buttons] == [str(body == k).lower() for k in range(3)]
        assert several.execute_script("return jaxball.pose()") == pose(several, body)
        seen.append(picture(several))
    for k in range(3):
        assert np.mean(np.any(seen[k] != seen[k - 1], axis=-1)) > 0.02


@pytest.mark.long
def test_the_momentum_the_wanted_path_and_obstacles_are_switched(several):
    go_to(several, 2.0)
    momentum = "Angular momentum Π about the contact point"
    for text, count in ((momentum, 30), ("Target path", 20), ("Obstacles", 500)):
        before = picture(several)
        choose(several, text)
        assert np.sum(np.any(picture(several) != before, axis=-1)) > count
        choose(several, text)
        np.testing.assert_array_equal(picture(several), before)


@pytest.mark.long
def test_a_run_that_was_thinned_says_so(browser, ball_trajectory, tmp_path):
    document = view_document(ball_trajectory, room=0.0)
    browser.get(View(document).save(tmp_path / "thin.html").as_uri())
    assert browser.find_element(By.ID, "note").text.startswith("Shown are 2 of the 21 saved times, evenly spaced")
    go_to(browser, 3.0)
    assert time(browser) == 0.0
    browser.get(ball_trajectory.view().save(tmp_path / "all.html").as_uri())
    assert not browser.find_element(By.ID, "note").is_displayed()


@pytest.mark.thorough
def test_without_webgl_the_graphs_are_shown_and_a_sentence(ball_trajectory, tmp_path):
    path = tmp_path / "run.html"
    ball_trajectory.view(path)
    with chromium("--disable-3d-apis") as page:
        page.get(path.as_uri())
        assert page.find_element(By.ID, "apology").text.startswith("This browser has no WebGL, which the scene needs;")
        assert not page.find_element(By.ID, "scene").is_displayed()
        plots = page.find_elements(By.CSS_SELECTOR, ".plot > canvas")
        go_to(page, 0.0)
        start = [float(plot.get_attribute("data-cursor")) for plot in plots]
        go_to(page, 20.0)
        assert all(float(plot.get_attribute("data-cursor")) > x + 100 for plot, x in zip(plots, start, strict=True))
        ActionChains(page).move_to_element(plots[1]).click().perform()
        assert 4.0 < time(page) < 10.0  # the axis is on the left
        errors = [one["message"] for one in page.get_log("browser")]
        assert all("WebGL context" in message for message in errors)
