"""What is wrong with a key of a scenario file is one sentence that names it."""

import numpy as np
import pytest

from jaxball.scenario import ScenarioError, builtin_text, load_scenario, read_scenario, write_scenario
from jaxball.scenario.motions import RAILS

from .documents import BALL, DISK, TURNING, edited, with_motion, with_rail, with_schedule

RAIL_KINDS = ", ".join(f'"{kind}"' for kind in RAILS)
TYPES = {
    "not TOML": (
        "format = ",
        "A scenario must be a TOML document, but it is not: Invalid value (at end of document).",
    ),
    "a heading that counts": (
        "[[mechanisms]]\n[[mechanisms[0].joints[1].force]]\n",
        "A scenario must be a TOML document, but it is not: Expected ']]' at the end of an array declaration (at line "
        "2, column 13); a heading has no index: [[mechanisms.joints.force]] belongs to the last [[mechanisms]] "
        "before it.",
    ),
    "no format": (
        edited("format = 1\n", ""),
        "Key `format` must be 1, but it is missing.",
    ),
    "newer format": (
        edited("format = 1", "format = 2"),
        "Key `format` must be 1, but it is 2.",
    ),
    "another kind": (
        edited('"ball"', '"cube"'),
        'Key `kind` must be one of "ball", "disk", "convex-body", "free-rigid-body", "heavy-top", "suslov", '
        '"rolling-ellipsoid", "nonholonomic-particle", "vakonomic-particle", "chaplygin-sleigh", "knife-edge", '
        '"rolling-coin", "snakeboard", "roller-racer", but it is "cube".',
    ),
    "a misspelt kind": (
        edited('"ball"', '"Bal"'),
        'Key `kind` cannot be "Bal"; did you mean "ball"?',
    ),
    "title not a text": (
        'title = ["a"]\n' + BALL,
        "Key `title` must be a text, but it is ['a'].",
    ),
    "text for a number": (
        edited("mass = 1.0", 'mass = "heavy"'),
        'Key `body.mass` must be a positive number, but it is "heavy".',
    ),
    "true for a number": (
        edited("mass = 1.0", "mass = true"),
        "Key `body.mass` must be a positive number, but it is true.",
    ),
    "a number beyond floats": (
        edited("mass = 1.0", "mass = 1" + 400 * "0"),
        "Key `body.mass` must be a positive number, but it is 1" + 56 * "0" + "....",
    ),
    "NaN": (
        edited("gravity = 1.0", "gravity = nan"),
        "Key `body.gravity` must be a finite number, but it is nan.",
    ),
    "infinity": (
        edited("gravity = 1.0", "gravity = -inf"),
        "Key `body.gravity` must be a finite number, but it is -inf, and the largest number is 1.8e308.",
    ),
    "wrong shape": (
        edited("[0.9, 1.0, 1.1]", "[0.9, 1.0]"),
        "Key `body.inertia` must be a list of 3 positive numbers, but it is [0.9, 1.0].",
    ),
    "ragged rows": (
        with_rail('{ kind = "spline", points = [[0, 0, 0.1], [0, 0.1]] }'),
        "Key `masses[0].rail.points` must be a list of rows of 3 finite numbers, but it is [[0, 0, 0.1], [0, 0.1]].",
    ),
    "table for a number": (
        edited("gravity = 1.0", "gravity = { g = 1.0 }"),
        "Key `body.gravity` must be a finite number, but it is a table.",
    ),
    "number for a table": (
        with_rail("1.0"),
        "Key `masses[0].rail` must be a table, but it is 1.0.",
    ),
    "table for masses": (
        edited("[[masses]]", "[masses]"),
        "Key `masses` must be a list of tables, each under the heading [[masses]], but it is a table.",
    ),
    "missing table": (
        edited("[time]\nstart = 0.0\nend = 2.0\nsaves = 5\n", ""),
        "Key `time` must be a table, but it is missing.",
    ),
}

KEYS = {
    "misspelt key": (
        edited("gravity", "gravty"),
        "Key `body.gravty` is not known; did you mean `gravity`?",
    ),
    "key without letters": (
        edited("gravity = 1.0", 'gravity = 1.0\n"" = 1'),
        'Key `body.""` is not known; the keys here are gravity, inertia, mass, offset, radius.',
    ),
    "misspelt table": (
        edited("[time]", "[tme]"),
        "Key `tme` is not known; did you mean `time`?",
    ),
    "misspelt nested key": (
        with_rail('{ kind = "circle", radus = 0.9 }'),
        "Key `masses[0].rail.radus` is not known; did you mean `radius`?",
    ),
    "a key of nothing": (
        edited("gravity = 1.0", "gravity = 1.0\nxyzzy = 1"),
        "Key `body.xyzzy` is not known; the keys here are gravity, inertia, mass, offset, radius.",
    ),
    "a key of another kind": (
        with_rail('{ kind = "circle", radius = 0.9, semi_axes = [1, 1] }'),
        "Key `masses[0].rail.semi_axes` is not known; the keys here are centre, frame, radius.",
    ),
    "a key of no kind": (  # of which those of this one are listed alone
        with_rail('{ kind = "circle", radius = 0.9, xyzzy = 1 }'),
        "Key `masses[0].rail.xyzzy` is not known; the keys here are centre, frame, radius.",
    ),
    "missing key": (
        edited("gravity = 1.0\n", ""),
        "Key `body.gravity` must be a finite number, but it is missing.",
    ),
    "missing kind": (
        with_rail("{ radius = 0.9 }"),
        f"Key `masses[0].rail.kind` must be one of {RAIL_KINDS}, but it is missing.",
    ),
    "missing schedule": (
        edited(TURNING, ""),
        "Key `masses[0].schedule` must be a table, but it is missing.",
    ),
    "no motion": (
        with_motion(""),
        "Key `masses[0]` must have exactly one of the keys `rail`, `position`, `free`, but it has none of them.",
    ),
    "two motions": (
        with_motion("position = [0, 0, 0]\nfree = { constant = [0, 0, 0] }"),
        "Key `masses[0]` must have exactly one of the keys `rail`, `position`, `free`, but it has `position` "
        "and `free`.",
    ),
    "two rotations": (
        BALL + "[initial]\nversor = [1, 0, 0, 0]\naxis = [1, 0, 0]\nangle = 1",
        "Key `initial` must have exactly one of the keys `versor`, `axis`, but it has `versor` and `axis`.",
    ),
    "no saves": (
        edited("saves = 5\n", ""),
        "Key `time` must have exactly one of the keys `saves`, `step`, `at`, but it has none of them.",
    ),
}

SHELLS = {
    "no mass": (
        edited("mass = 1.0", "mass = 0"),
        "Key `body.mass` must be a positive number, but it is 0.",
    ),
    "negative radius": (
        edited("radius = 1.0", "radius = -1.0"),
        "Key `body.radius` must be a positive number, but it is -1.0.",
    ),
    "impossible inertia": (
        edited("[0.9, 1.0, 1.1]", "[0.1, 0.2, 0.4]"),
        "Key `body.inertia` must be three moments of which none exceeds the sum of the other two, as "
        "in every "
        "real body, but it is [0.1, 0.2, 0.4].",
    ),
    "offset outside": (
        edited("gravity = 1.0", "gravity = 1.0\noffset = [0.0, 0.0, -1.5]"),
        "Key `body.offset` must be a point inside the shell, closer to the centre than the radius, but it is "
        "[0.0, 0.0, -1.5].",
    ),
    "offset whose square is infinite": (
        edited("gravity = 1.0", "gravity = 1.0\noffset = [2e299, 0.0, 0.0]"),
        "Key `body.offset` must be a point inside the shell, closer to the centre than the radius, but it is "
        "[2e+299, 0.0, 0.0].",
    ),
    "disk's offset": (
        edited("gravity = 1.0", "gravity = 1.0\noffset = [0.0, 0.1, 0.0]", DISK),
        "Key `body.offset` must be in the plane of a disk, E1 and E3, with second entry 0, but it is [0.0, 0.1, 0.0].",
    ),
    "disk's force": (
        DISK + "[force]\nconstant = [0.0, 0.1, 0.0]",
        "Key `force.constant` must be in the plane of a disk, E1 and E3, with second entry 0, but it is "
        "[0.0, 0.1, 0.0].",
    ),
    "force without amplitudes": (
        BALL + "[force]\nfrequency = [1.0, 2.0]\namplitude = [[1.0, 0.0, 0.0]]",
        "Key `force.amplitude` must be as long as `frequency`, which has 2 entries, but it is one of 1.",
    ),
    "force with a phase too many": (
        BALL + "[force]\nfrequency = [1.0]\namplitude = [[1.0, 0.0, 0.0]]\nphase = [1.0, 2.0]",
        "Key `force.phase` must be as long as `frequency`, which has 1 entry, but it is one of 2.",
    ),
}

NUMBERS = {
    "versor too large to be squared": (
        BALL + "[initial]\nversor = [1e300, 0.0, 0.0, 0.0]",
        "Key `initial.versor` must be a versor, whose four numbers have squares that add up to 1, but it is "
        "[1e+300, 0.0, 0.0, 0.0].",
    ),
    "position too far to be squared": (
        with_motion("position = [1e200, 0.0, 0.0]"),
        "Key `masses[0].position` must be a point inside the shell of radius 1, but it is [1e+200, 0.0, 0.0].",
    ),
    "rail too large to be squared": (
        with_rail('{ kind = "ellipse", semi_axes = [1e200, 1e199] }'),
        # All squares overflow alike, so that any place will do: |(1e200 cos θ, 1e199 sin θ)| at this one.
        "Key `masses[0].rail` must be a curve inside the shell of radius 1, but it is 9.93778e+199 from the centre at "
        "theta = 6.17101.",
    ),
    "beside a disk's plane, too far to be rounded": (
        with_motion("free = { constant = [0.0, 1e305, 0.0] }", DISK),
        "Key `masses[0].free` must lie in the plane of a disk, E1 and E3, but it passes [0.0, 1e+305, 0.0].",
    ),
    "start too far to be squared": (
        with_rail('{ kind = "tube", direction = [1, 0, 0] }')
        + '[actuation]\nform = "integrated"\n[initial]\ntheta = [1e200]\nthetadot = [0.0]',
        "Key `initial.theta` must be angles at which each mass is inside the shell of radius 1, but it is [1e+200], "
        "which puts mass 0 at the distance 1e+200 from the centre.",
    ),
    "a span beyond floats": (
        edited("start = 0.0\nend = 2.0", "start = -1e308\nend = 1e308"),
        "Key `time.end` must be times whose differences are finite numbers, but it is from -1e+308 to 1e+308.",
    ),
    "times beyond floats": (
        edited("start = 0.0\nend = 2.0\nsaves = 5", "at = [-1e308, 1e308]"),
        "Key `time.at` must be times whose differences are finite numbers, but it is from -1e+308 to 1e+308.",
    ),
    "digits beyond Python's": (
        edited("mass = 1.0", "mass = 1" + 5000 * "0"),
        "A scenario must be a TOML document, but it is not: it has a number of too many digits.",
    ),
    "too many brackets": (
        edited("mass = 1.0", "mass = " + 5000 * "["),
        "A scenario must be a TOML document, but it is not: it is nested too deeply.",
    ),
    "a text of two lines": (
        edited("mass = 1.0", 'mass = "a\\n\\"b\\""'),
        'Key `body.mass` must be a positive number, but it is "a\\n\\"b\\"".',
    ),
}

CASES = TYPES | KEYS | SHELLS | NUMBERS


@pytest.mark.parametrize(("text", "sentence"), CASES.values(), ids=CASES.keys())
def test_sentence(text, sentence):
    with pytest.raises(ScenarioError) as caught:
        read_scenario(text)
    assert str(caught.value) == sentence


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
    with pytest.raises(ScenarioError, match=r'name of a built-in one, but it is "bal" \(.*\); did you mean "ball"\?$'):
        load_scenario("bal")
    with pytest.raises(
        ScenarioError, match=r'the name of a built-in scenario, but it is "discus"; did you mean "disk"\?$'
    ):
        builtin_text("discus")


def test_file_that_is_not_text(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ScenarioError, match=r"\(it is not UTF-8 text\)\.$"):
        load_scenario(tmp_path / "a.toml")


def test_the_name_of_the_file_stands_in_every_message(tmp_path):
    (tmp_path / "a.toml").write_text(edited("gravity", "gravty"))
    with pytest.raises(ScenarioError, match=r"^\S+/a\.toml: Key `body\.gravty` is not known; did you mean"):
        load_scenario(tmp_path / "a.toml")
    (tmp_path / "a.toml").write_text("")
    with pytest.raises(ScenarioError, match=r"^\S+/a\.toml: Key `format` must be 1, but it is missing\.$"):
        load_scenario(tmp_path / "a.toml")
    (tmp_path / "a.toml").write_bytes(b"\x00\x01")
    with pytest.raises(ScenarioError, match=r"^\S+/a\.toml: A scenario must be a TOML document, but it is not: "):
        load_scenario(tmp_path / "a.toml")
    with pytest.raises(ScenarioError, match=rf'it is "{tmp_path}" \(Is a directory\)\.$'):
        load_scenario(tmp_path)


def test_files_as_editors_on_windows_write_them(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"\xef\xbb\xbf" + BALL.replace("\n", "\r\n").encode())
    read, wanted = load_scenario(tmp_path / "a.toml"), read_scenario(BALL)
    assert write_scenario(read) == write_scenario(wanted)
