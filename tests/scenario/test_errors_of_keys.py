"""What is wrong with a key of a scenario file is one sentence that names it."""

import numpy as np
import pytest

from jaxball import ScenarioError, load_scenario, read_scenario, write_scenario
from jaxball.files.scenario.sources import builtin_text
from tests.support.sentences import refuses

from .documents import BALL, DISK, TURNING, edited, with_motion, with_rail, with_schedule

TYPES = {
    "not TOML": ("format = ", "A scenario"),
    "a heading that counts": ("[[mechanisms]]\n[[mechanisms[0].joints[1].force]]\n", "A scenario"),
    "no format": (edited("format = 1\n", ""), "format"),
    "newer format": (edited("format = 1", "format = 2"), "format"),
    "another kind": (edited('"ball"', '"cube"'), "kind"),
    "a misspelt kind": (edited('"ball"', '"Bal"'), "kind"),
    "title not a text": ('title = ["a"]\n' + BALL, "title"),
    "text for a number": (edited("mass = 1.0", 'mass = "heavy"'), "body.mass"),
    "true for a number": (edited("mass = 1.0", "mass = true"), "body.mass"),
    "a number beyond floats": (edited("mass = 1.0", "mass = 1" + 400 * "0"), "body.mass"),
    "NaN": (edited("gravity = 1.0", "gravity = nan"), "body.gravity"),
    "infinity": (edited("gravity = 1.0", "gravity = -inf"), "body.gravity"),
    "wrong shape": (edited("[0.9, 1.0, 1.1]", "[0.9, 1.0]"), "body.inertia"),
    "ragged rows": (with_rail('{ kind = "spline", points = [[0, 0, 0.1], [0, 0.1]] }'), "masses[0].rail.points"),
    "table for a number": (edited("gravity = 1.0", "gravity = { g = 1.0 }"), "body.gravity"),
    "number for a table": (with_rail("1.0"), "masses[0].rail"),
    "table for masses": (edited("[[masses]]", "[masses]"), "masses"),
    "missing table": (edited("[time]\nstart = 0.0\nend = 2.0\nsaves = 5\n", ""), "time"),
}

KEYS = {
    "misspelt key": (edited("gravity", "gravty"), "body.gravty"),
    "key without letters": (edited("gravity = 1.0", 'gravity = 1.0\n"" = 1'), 'body.""'),
    "misspelt table": (edited("[time]", "[tme]"), "tme"),
    "misspelt nested key": (with_rail('{ kind = "circle", radus = 0.9 }'), "masses[0].rail.radus"),
    "a key of nothing": (edited("gravity = 1.0", "gravity = 1.0\nxyzzy = 1"), "body.xyzzy"),
    "a key of another kind": (
        with_rail('{ kind = "circle", radius = 0.9, semi_axes = [1, 1] }'),
        "masses[0].rail.semi_axes",
    ),
    "a key of no kind": (  # of which those of this one are listed alone
        with_rail('{ kind = "circle", radius = 0.9, xyzzy = 1 }'),
        "masses[0].rail.xyzzy",
    ),
    "missing key": (edited("gravity = 1.0\n", ""), "body.gravity"),
    "missing kind": (with_rail("{ radius = 0.9 }"), "masses[0].rail.kind"),
    "missing schedule": (edited(TURNING, ""), "masses[0].schedule"),
    "no motion": (with_motion(""), "masses[0]"),
    "two motions": (with_motion("position = [0, 0, 0]\nfree = { constant = [0, 0, 0] }"), "masses[0]"),
    "two rotations": (BALL + "[initial]\nversor = [1, 0, 0, 0]\naxis = [1, 0, 0]\nangle = 1", "initial"),
    "no saves": (edited("saves = 5\n", ""), "time"),
}

SHELLS = {
    "no mass": (edited("mass = 1.0", "mass = 0"), "body.mass"),
    "negative radius": (edited("radius = 1.0", "radius = -1.0"), "body.radius"),
    "impossible inertia": (edited("[0.9, 1.0, 1.1]", "[0.1, 0.2, 0.4]"), "body.inertia"),
    "offset outside": (edited("gravity = 1.0", "gravity = 1.0\noffset = [0.0, 0.0, -1.5]"), "body.offset"),
    "offset whose square is infinite": (
        edited("gravity = 1.0", "gravity = 1.0\noffset = [2e299, 0.0, 0.0]"),
        "body.offset",
    ),
    "disk's offset": (edited("gravity = 1.0", "gravity = 1.0\noffset = [0.0, 0.1, 0.0]", DISK), "body.offset"),
    "disk's force": (DISK + "[force]\nconstant = [0.0, 0.1, 0.0]", "force.constant"),
    "force without amplitudes": (
        BALL + "[force]\nfrequency = [1.0, 2.0]\namplitude = [[1.0, 0.0, 0.0]]",
        "force.amplitude",
    ),
    "force with a phase too many": (
        BALL + "[force]\nfrequency = [1.0]\namplitude = [[1.0, 0.0, 0.0]]\nphase = [1.0, 2.0]",
        "force.phase",
    ),
}

NUMBERS = {
    "versor too large to be squared": (BALL + "[initial]\nversor = [1e300, 0.0, 0.0, 0.0]", "initial.versor"),
    "position too far to be squared": (with_motion("position = [1e200, 0.0, 0.0]"), "masses[0].position"),
    "rail too large to be squared": (
        with_rail('{ kind = "ellipse", semi_axes = [1e200, 1e199] }'),
        # All squares overflow alike, so that any place will do: |(1e200 cos θ, 1e199 sin θ)| at this one.
        "masses[0].rail",
    ),
    "beside a disk's plane, too far to be rounded": (
        with_motion("free = { constant = [0.0, 1e305, 0.0] }", DISK),
        "masses[0].free",
    ),
    "start too far to be squared": (
        with_rail('{ kind = "tube", direction = [1, 0, 0] }')
        + '[actuation]\nform = "integrated"\n[initial]\ntheta = [1e200]\nthetadot = [0.0]',
        "initial.theta",
    ),
    "a span beyond floats": (edited("start = 0.0\nend = 2.0", "start = -1e308\nend = 1e308"), "time.end"),
    "times beyond floats": (edited("start = 0.0\nend = 2.0\nsaves = 5", "at = [-1e308, 1e308]"), "time.at"),
    "digits beyond Python's": (edited("mass = 1.0", "mass = 1" + 5000 * "0"), "A scenario"),
    "too many brackets": (edited("mass = 1.0", "mass = " + 5000 * "["), "A scenario"),
    "a text of two lines": (edited("mass = 1.0", 'mass = "a\\n\\"b\\""'), "body.mass"),
}

CASES = TYPES | KEYS | SHELLS | NUMBERS


@pytest.mark.parametrize(("text", "named"), CASES.values(), ids=CASES.keys())
def test_sentence(text, named):
    with refuses(ScenarioError, named):
        read_scenario(text)


def test_documents_are_good():
    for text in (
        BALL,
        DISK,
        with_motion("position = [0, 0, 0]"),
        with_schedule('{ kind = "pulse", theta = 0 }'),
    ):
        assert read_scenario(text).times.size == 5


@pytest.mark.parametrize("size", [1e-310, 1e-200, 3.0, 1e200, 1e308])
def test_an_axis_of_any_length_gives_the_same_versor(size):
    text = BALL + f"[initial]\naxis = [0.0, {size}, {size}]\nangle = 0.5"
    s = np.sin(0.25) / np.sqrt(2)
    np.testing.assert_allclose(read_scenario(text).state.q, [np.cos(0.25), 0.0, s, s], rtol=1e-13, atol=1e-300)


def test_no_such_file():
    with refuses(ScenarioError, "source"):
        load_scenario("bal")
    with refuses(ScenarioError, "name"):
        builtin_text("discus")


def test_file_that_is_not_text(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"\xff\xfe")
    with refuses(ScenarioError, "source"):
        load_scenario(tmp_path / "a.toml")


def test_the_name_of_the_file_stands_in_every_message(tmp_path):
    (tmp_path / "a.toml").write_text(edited("gravity", "gravty"))
    with refuses(ScenarioError, "body.gravty"):
        load_scenario(tmp_path / "a.toml")
    (tmp_path / "a.toml").write_text("")
    with refuses(ScenarioError, "format"):
        load_scenario(tmp_path / "a.toml")
    (tmp_path / "a.toml").write_bytes(b"\x00\x01")
    with refuses(ScenarioError, "a.toml"):
        load_scenario(tmp_path / "a.toml")
    with refuses(ScenarioError, "source"):
        load_scenario(tmp_path)


def test_files_as_editors_on_windows_write_them(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"\xef\xbb\xbf" + BALL.replace("\n", "\r\n").encode())
    read, wanted = load_scenario(tmp_path / "a.toml"), read_scenario(BALL)
    assert write_scenario(read) == write_scenario(wanted)
