"""What objects show in a notebook."""

import xml.etree.ElementTree

import numpy as np
import pytest

from jaxball import Ball, BallState, Disk, DiskState, simulate
from jaxball.interface.html import SIZE, as_html, sketch_of
from jaxball.scenario import load_scenario
from jaxball.sweep import Study
from jaxball.sweep.axes import Listed

ROLLING = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4))


def parse(html):
    return xml.etree.ElementTree.fromstring(html)


def test_text_is_escaped_and_its_headline_is_bold():
    page = parse(as_html("a < b & c\n  <script>"))
    assert page.find("pre/b").text == "a < b & c"
    assert "".join(page.itertext()) == "a < b & c\n  <script>"


def test_the_path_of_a_ball_is_beside_its_text():
    run = simulate(ROLLING, [0.0, 1.0, 2.0], BallState(Omega=(0.0, 1.0, 0.0)))
    page = parse(run._repr_html_())
    assert "".join(page.find("pre").itertext()) == repr(run)
    points = page.find("svg/polyline").get("points").split()
    assert len(points) == 3
    x = [float(point.split(",")[0]) for point in points]
    assert x[1] - x[0] == pytest.approx(x[2] - x[1], abs=0.1)  # it rolls evenly


def test_a_path_keeps_its_proportions():
    turn = np.linspace(0.0, 2 * np.pi, 1000)
    drawn = parse(sketch_of(np.stack([3 * np.cos(turn), np.sin(turn)], axis=1), "an ellipse"))
    points = np.array([[float(x) for x in point.split(",")] for point in drawn.find("polyline").get("points").split()])
    assert len(points) <= 500
    assert np.divide(*np.ptp(points, axis=0)) == pytest.approx(3.0, rel=0.01)
    assert int(drawn.get("width")) == SIZE


def test_a_ball_at_rest_has_no_path():
    assert "<svg" not in simulate(ROLLING, [0.0, 1.0], BallState())._repr_html_()
    assert sketch_of(np.full((3, 2), np.nan), "nothing") == ""


def test_a_batch_and_other_objects_show_their_text():
    disk = Disk(mass=1.0, inertia=0.5)
    study = Study("speeds", {}, (Listed("state.phidot", (0.0, 1.0, 2.0)),))
    for thing in (disk, DiskState(), load_scenario("ball"), study):
        assert "".join(parse(thing._repr_html_()).itertext()).strip() == repr(thing).strip()
    assert repr(study) == "Study 'speeds': 3 rows\n  state.phidot: 3 points"
