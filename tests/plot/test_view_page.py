"""The page of a view: one file, in which no text of a run is anything but text, and which replaces only its like."""

import base64
import hashlib
import html
import json
import re

import pytest

from jaxball import plot
from jaxball.files.results import OutputError
from jaxball.plot.view.page import in_element, page
from tests.support.pages import document_in, elements
from tests.support.sentences import refuses

HOSTILE = '</script><img src=x onerror="window.hacked = 1"><!-- <script> \u2028\u2029 \' " \\ & {{program}} $&'


@pytest.fixture(scope="module")
def view(ball_trajectory):
    return ball_trajectory.view(title=HOSTILE)


def test_a_title_stays_text(view):
    """The same elements as with another title, and the title itself in the dictionary alone."""
    tags, texts = elements(view.html)
    plain, _ = elements(page(view.document | {"title": "plain"}))
    assert tags == plain
    assert "img" not in {tag for tag, _ in tags}
    assert document_in(view.html)["title"] == HOSTILE
    assert texts["title", None] == "jaxball"
    inside = re.search(r'<script type="application/json" id="run">(.*?)</script>', view.html, re.DOTALL)
    assert not set("<>&\u2028\u2029") & set(inside[1])


def test_json_in_an_element_is_the_same_json():
    assert json.loads(in_element({"a": HOSTILE, "b": [1.5, None]})) == {"a": HOSTILE, "b": [1.5, None]}


def test_only_the_program_of_jaxball_may_run_and_nothing_is_asked_for(view):
    tags, texts = elements(view.html)
    (policy,) = [found["content"] for tag, found in tags if "http-equiv" in found]
    allowed = dict(part.strip().split(" ", 1) for part in policy.split(";"))
    digest = base64.b64encode(hashlib.sha256(texts["script", None].encode()).digest()).decode()
    assert allowed == {
        "default-src": "'none'",
        "script-src": f"'sha256-{digest}'",
        "style-src": "'unsafe-inline'",
        "img-src": "data:",
    }
    assert not [found for _, found in tags if {"src", "srcset", "action"} & set(found)]
    assert [found["href"] for _, found in tags if "href" in found] == ["data:,"]
    assert "The MIT License" in view.html


def test_a_notebook_shows_the_page_itself(view):
    (frame,) = elements(view._repr_html_())[0]
    assert frame[0] == "iframe"
    assert frame[1]["srcdoc"] == view.html
    assert frame[1]["sandbox"] == "allow-scripts"
    assert html.escape(HOSTILE) not in repr(view)
    assert repr(view).endswith(f"21 times, {len(view.html.encode()) / 1e6:.2f} MB")


def test_a_view_is_written_and_replaced(ball_trajectory, view, tmp_path):
    path = tmp_path / "run.html"
    assert plot.write_view(ball_trajectory, str(path), HOSTILE) == path
    assert path.read_text(encoding="utf-8") == view.html
    other = ball_trajectory.view(path, title="another")
    assert document_in(path.read_text(encoding="utf-8"))["title"] == "another" == other.document["title"]
    assert list(tmp_path.iterdir()) == [path]


def test_nothing_else_is_written_over(view, tmp_path):
    notes = tmp_path / "notes.html"
    for content in (b"<!doctype html>\n<title>my notes</title>", b"", view.html.encode()[1:]):
        notes.write_bytes(content)
        with refuses(OutputError, "path"):
            view.save(notes)
        assert notes.read_bytes() == content
    (tmp_path / "folder.html").mkdir()
    for name in ("folder.html", "none/run.html", "run.pdf"):
        with refuses(OutputError, "path", name.partition("/")[0]):
            view.save(tmp_path / name)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.html", "notes.html"]
