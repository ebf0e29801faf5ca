"""Parts of sentences have their grammar right."""

import traceback

import pytest

from jaxball import ScenarioError
from jaxball.cli import main
from jaxball.files.scenario.values import Choice, Integer, Numbers
from jaxball.interface.wording import (
    all_of,
    did_you_mean,
    duration,
    heading,
    no_attribute,
    number_of,
    one_of,
    pip_install,
    plain,
    tell_numbers_apart,
)
from tests.support.sentences import refuses, said


def test_numbers_of_things():
    assert [number_of(n, "point mass", "point masses") for n in (0, 1, 2)] == [
        "0 point masses",
        "1 point mass",
        "2 point masses",
    ]
    assert number_of(12000, "row") == "12,000 rows"


def test_enumerations():
    assert (one_of(["a"]), one_of(["a", "b", "c"])) == ("a", "one of a, b, c")
    assert (all_of(["a"]), all_of(["a", "b"]), all_of(["a", "b", "c"])) == ("a", "a and b", "a, b and c")


def test_what_a_value_must_be():
    assert [kind.words for kind in (Integer(1, 1), Integer(1, 2), Choice(("a",)), Numbers((1,)), Numbers((2,)))] == [
        "1",
        "a whole number from 1 to 2",
        '"a"',
        "a list of 1 finite number",
        "a list of 2 finite numbers",
    ]


def test_names_that_were_perhaps_meant():
    names = ("dopri5", "Radau5", "tr-bdf2")
    assert did_you_mean("dopri", names) == '; did you mean "dopri5"?'
    assert did_you_mean("RADAU", names, "", "`") == "; did you mean `Radau5`?"
    assert did_you_mean("euler", names) == "."
    assert did_you_mean("euler", names, "see there") == "; see there."
    with refuses(ScenarioError, "a"):
        Choice(names).read("tr-bdf", "a")


def test_a_package_that_is_not_installed(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "zarr" else name)
    assert main(["sweep", "study.toml", "--out", str(tmp_path / "s.zarr")]) == 2
    said(capsys.readouterr().err, "A sweep")


@pytest.mark.parametrize(
    ("source", "command"),
    [
        (None, "pip install 'jaxball[sweep]'"),
        ('{"url": "https://example.org/jaxball.whl", "archive_info": {}}', "pip install 'jaxball[sweep]'"),
        ('{"url": "file:///home/me/jaxball", "dir_info": {}}', "pip install '.[sweep]' in jaxball's folder"),
        (
            '{"url": "file:///home/me/jaxball", "dir_info": {"editable": true}}',
            "pip install -e '.[sweep]' in jaxball's folder",
        ),
    ],
)
def test_how_to_install_more_is_how_jaxball_was_installed(monkeypatch, source, command):
    class Distribution:
        read_text = staticmethod({"direct_url.json": source}.get)

    monkeypatch.setattr("importlib.metadata.distribution", {"jaxball": Distribution}.get)
    assert pip_install("sweep") == command


def test_numbers_that_differ_are_written_with_as_many_digits_as_that_takes():
    assert tell_numbers_apart(0.0, 2.0, 0.0, 1.999999) == ["0", "2", "0", "1.999999"]
    assert tell_numbers_apart(0.0, 2.0, 0.0, 2.0) == ["0", "2", "0", "2"]
    assert tell_numbers_apart(1.0, 1.0 + 2**-52) == ["1", "1.0000000000000002"]


def test_python_adds_nothing_to_a_sentence_about_an_attribute():
    class Run:
        state = 0

        def __getattr__(self, name):
            raise no_attribute(type(self), name, {"stats": "steps"})

    with pytest.raises(AttributeError) as caught:
        _ = Run().stats
    shown = "".join(traceback.format_exception(caught.value)).splitlines()[-1]
    assert shown == "AttributeError: A Run has no attribute `stats`; it is `steps`."


def test_what_would_steer_a_terminal_is_spelled():
    assert plain("\x1b[31mred\x9b1m\r\u202e\u2066") == r"\x1b[31mred\x9b1m\r\u202e\u2066"
    assert plain("Grüße, 球\tμ = 0.3\nnext") == "Grüße, 球\tμ = 0.3\nnext"
    assert heading(" two\n lines\x07 ") == r"two lines\x07"


def test_durations():
    assert [duration(x) for x in (0.12, 42.0, 300.0, 11520.0)] == ["0.12 s", "42 s", "5 min", "3.2 h"]
