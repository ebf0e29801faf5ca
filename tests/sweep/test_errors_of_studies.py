"""What a study cannot be, each with a sentence that names the key or the row."""

import pytest

from jaxball import ScenarioError
from jaxball.studies.sweep import StudyError, load_study, read_study
from tests.scenario.documents import DISK
from tests.support.sentences import refuses
from tests.sweep.studies import MASSES, study, study_text


def axis(line, path="body.mass"):
    return f'[[axes]]\npath = "{path}"\n{line}\n'


ZIPPED = '[[axes]]\nzip = [{ path = "body.radius", values = [1] }, { path = "body.gravty", values = [1] }]\n'


def design(line, count=8, kind="random"):
    return f'[[axes]]\ndesign = "{kind}"\ncount = {count}\nnumbers = {{ "body.mass" = {{ {line} }} }}\n'


@pytest.mark.parametrize(
    ("axes", "named"),
    [
        (axis("values = [1]", "body.mas"), "axes[0].path"),
        (
            axis("values = [1]", "body.offset[5]"),
            "axes[0].path",
        ),
        (axis("values = [1]", "masses[1].mass"), "axes[0].path"),
        (
            axis("values = [1]", "body.offset"),
            "axes[0].path",
        ),
        (axis("values = [1]", "body"), "axes[0].path"),
        (axis("values = [1]", "masses"), "axes[0].path"),
        (axis("values = [1]", "time.saves"), "axes[0].path"),
        (axis("values = [1]", "kind"), "axes[0].path"),
        (axis("values = [1]") + ZIPPED, "axes[1].zip[1].path"),
        (design("uniform = [1, 2]").replace("mass", "mas"), "axes[0].numbers"),
        (axis("values = []"), "axes[0].values"),
        (axis("values = [1, inf]"), "axes[0].values"),
        (axis("linear = { from = 1, to = 2, count = 0 }"), "axes[0].linear.count"),
        (axis("linear = { form = 1, to = 2, count = 3 }"), "axes[0].linear.form"),
        (axis("log = { from = 0, to = 2, count = 3 }"), "axes[0].log.from"),
        (axis("values = [1]\nlinear = { from = 1, to = 2, count = 3 }"), "axes[0]"),
        (axis("value = [1]"), "axes[0].value"),
        (MASSES + MASSES, "body.mass"),
        (design("gaussian = [1, 2]"), 'axes[0].numbers."body.mass".gaussian'),
        (design("uniform = [2, 1]"), 'axes[0].numbers."body.mass".uniform'),
        (design("normal = [2, 0]"), 'axes[0].numbers."body.mass".normal'),
        (design("log-uniform = [0, 1]"), 'axes[0].numbers."body.mass".log-uniform'),
        (design("uniform = [1, 2]", count=6, kind="sobol"), "axes[0].count"),
        (design("uniform = [1, 2]", kind="halton"), "axes[0].design"),
        ('[[axes]]\npoints = "none.csv"\n', "points"),
        ('[[axes]]\npoints = "empty.csv"\n', "axes[0].points"),
        ('[[axes]]\npoints = "words.csv"\n', "body.mass"),
        (
            '[[axes]]\nzip = [{ path = "body.mass", values = [1] }, { path = "body.gravity", values = [1, 2] }]\n',
            "axes[0].zip",
        ),
        ("axes = []\n", "axes"),
        ("", "axes"),
    ],
)
def test_axes(tmp_path, axes, named):
    (tmp_path / "empty.csv").write_text("body.mass\n")
    (tmp_path / "words.csv").write_text("body.mass\nheavy\n")
    with refuses(ScenarioError, named):
        study(tmp_path, axes)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('"disk.toml"', '"dis"', "scenario"),
        ('"disk.toml"', "3", "scenario"),
        ("format = 1", "format = 1\nsave = 'all'", "save"),
        ("format = 1", "format = 1\nchunk = 0", "chunk"),
        ("format = 1", "format = ", "A study"),
        ('"disk.toml"', '"heavy-top"\ncontact = true', "contact"),
    ],
)
def test_settings(tmp_path, old, new, named):
    with refuses(ScenarioError, named):
        read_study(study_text(tmp_path).replace(old, new), tmp_path)


def test_a_wrong_scenario_is_named_as_such(tmp_path):
    with refuses(StudyError, "body.mass"):
        study(tmp_path, scenario=DISK.replace("mass = 1.0\n", "", 1))


def test_a_file_that_is_not_there(tmp_path):
    with refuses(StudyError, "source"):
        load_study("none.toml")


def test_a_row_that_no_body_can_have_names_itself(tmp_path):
    with refuses(StudyError, "body.mass"):
        study(tmp_path, axis("values = [1, -2]")).scenario(1)


def test_a_wrong_path_in_a_large_scenario_gets_a_short_sentence(tmp_path):
    text = 'format = 1\nscenario = "six-tubes"\n[[axes]]\npath = "masses[7].mas"\nvalues = [1]\n'
    with refuses(ScenarioError, "axes[0].path", "masses[7].mas") as refused:
        read_study(text, tmp_path)
    sentence = str(refused.value)
    assert len(sentence) < 200
    assert sentence.count("masses[") == 4  # the wrong one, and three that may be meant
