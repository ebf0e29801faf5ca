"""What a study cannot be, each with a sentence that names the key or the row."""

import pytest

from jaxball.scenario import ScenarioError
from jaxball.sweep import StudyError, load_study, read_study
from tests.scenario.documents import DISK
from tests.sweep.studies import MASSES, study, study_text


def axis(line, path="body.mass"):
    return f'[[axes]]\npath = "{path}"\n{line}\n'


PATH = "Key `axes\\[0\\].path` must name a number of the scenario, but"
ZIPPED = '[[axes]]\nzip = [{ path = "body.radius", values = [1] }, { path = "body.gravty", values = [1] }]\n'


def design(line, count=8, kind="random"):
    return f'[[axes]]\ndesign = "{kind}"\ncount = {count}\nnumbers = {{ "body.mass" = {{ {line} }} }}\n'


@pytest.mark.parametrize(
    ("axes", "sentence"),
    [
        (axis("values = [1]", "body.mas"), f"{PATH} `body.mas` is not there; did you mean `body.mass`"),
        (
            axis("values = [1]", "body.offset[5]"),
            f"{PATH} `body.offset\\[5\\]` is not there; did you mean `body.offset",
        ),
        (axis("values = [1]", "masses[1].mass"), f"{PATH} `masses\\[1\\].mass` is not there; did you mean `masses"),
        (
            axis("values = [1]", "body.offset"),
            f"{PATH} `body.offset` is a list of 3 numbers; name one of them, such as",
        ),
        (axis("values = [1]", "body"), f"{PATH} `body` is a table; name a number in it, such as `body.mass`."),
        (axis("values = [1]", "masses"), f"{PATH} `masses` is a list of tables; name a number in it, such as `masses"),
        (
            axis("values = [1]", "time.saves"),
            "`axes\\[0\\].path` names `time.saves`, which must be the same in all rows",
        ),
        (axis("values = [1]", "kind"), f'{PATH} `kind` is "disk".'),
        (axis("values = [1]") + ZIPPED, "Key `axes\\[1\\].zip\\[1\\].path` must .* `body.gravty` is not there"),
        (
            design("uniform = [1, 2]").replace("mass", "mas"),
            "Key `axes\\[0\\].numbers` must .* `body.mas` is not there",
        ),
        (axis("values = []"), "Key `axes\\[0\\].values` must be a list of finite numbers, but it is \\[\\]"),
        (axis("values = [1, inf]"), "Key `axes\\[0\\].values` must be a list of finite numbers"),
        (axis("linear = { from = 1, to = 2, count = 0 }"), "`axes\\[0\\].linear.count` must be a whole number from 1"),
        (axis("linear = { form = 1, to = 2, count = 3 }"), "`axes\\[0\\].linear.form` is not known; did you mean"),
        (axis("log = { from = 0, to = 2, count = 3 }"), "`axes\\[0\\].log.from` must be a positive number"),
        (axis("values = [1]\nlinear = { from = 1, to = 2, count = 3 }"), "must have exactly one of the keys"),
        (axis("value = [1]"), "Key `axes\\[0\\].value` is not known; did you mean `values`?"),
        (MASSES + MASSES, "Key `body.mass` must be in one axis, but it is in two"),
        (design("gaussian = [1, 2]"), "gaussian` is not known"),
        (design("uniform = [2, 1]"), "uniform` must be two numbers, the smaller one first, but it is \\[2, 1\\]"),
        (design("normal = [2, 0]"), "normal` must be a number and a positive standard deviation"),
        (design("log-uniform = [0, 1]"), "log-uniform` must be two positive numbers"),
        (design("uniform = [1, 2]", count=6, kind="sobol"), "`axes\\[0\\].count` must be a power of two"),
        (design("uniform = [1, 2]", kind="halton"), '`axes\\[0\\].design` must be one of "random"'),
        ('[[axes]]\npoints = "none.csv"\n', "Key `points` must be a file that can be read"),
        ('[[axes]]\npoints = "empty.csv"\n', "must be a file with one row or more"),
        ('[[axes]]\npoints = "words.csv"\n', "Column `body.mass` of .* must contain only numbers"),
        (
            '[[axes]]\nzip = [{ path = "body.mass", values = [1] }, { path = "body.gravity", values = [1, 2] }]\n',
            "Key `axes\\[0\\].zip` must be axes with the same number of points, but it is axes with \\[1, 2\\]",
        ),
        ("axes = []\n", "Key `axes` must be a list of tables"),
        ("", "Key `axes` must be .* but it is missing"),
    ],
)
def test_axes(tmp_path, axes, sentence):
    (tmp_path / "empty.csv").write_text("body.mass\n")
    (tmp_path / "words.csv").write_text("body.mass\nheavy\n")
    with pytest.raises(ScenarioError, match=sentence):
        study(tmp_path, axes)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('"disk.toml"', '"dis"', 'Key `scenario` must be .* but it is "dis"'),
        ('"disk.toml"', "3", "Key `scenario` must be a table, a name or a file, but it is 3"),
        ("format = 1", "format = 1\nsave = 'all'", 'Key `save` must be one of "end", "times"'),
        ("format = 1", "format = 1\nchunk = 0", "Key `chunk` must be a whole number from 1"),
        ("format = 1", "format = ", "A study must be a TOML document"),
        ('"disk.toml"', '"heavy-top"\ncontact = true', "Key `contact` must be false for a heavy top"),
    ],
)
def test_settings(tmp_path, old, new, sentence):
    with pytest.raises(ScenarioError, match=sentence):
        read_study(study_text(tmp_path).replace(old, new), tmp_path)


def test_a_wrong_scenario_is_named_as_such(tmp_path):
    with pytest.raises(StudyError, match=r'scenario of the study, "disk.toml", is wrong: Key `body.mass` .* missing'):
        study(tmp_path, scenario=DISK.replace("mass = 1.0\n", "", 1))


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(StudyError, match=r'"none.toml" \(No such file or directory\)'):
        load_study("none.toml")


def test_a_row_that_no_body_can_have_names_itself(tmp_path):
    with pytest.raises(StudyError, match=r"Row 1: Key `body.mass` must be a positive number, but it is -2"):
        study(tmp_path, axis("values = [1, -2]")).scenario(1)


def test_a_wrong_path_in_a_large_scenario_gets_a_short_sentence(tmp_path):
    text = 'format = 1\nscenario = "six-tubes"\n[[axes]]\npath = "masses[7].mas"\nvalues = [1]\n'
    with pytest.raises(ScenarioError) as caught:
        read_study(text, tmp_path)
    sentence = str(caught.value)
    assert sentence.startswith(f"{PATH} ".replace("\\", ""))
    assert len(sentence) < 200
    assert sentence.count("masses[") == 4  # the wrong one, and three that may be meant
