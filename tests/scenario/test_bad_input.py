"""Files that are made to be too large, too deep or misleading end in a few sentences, and never in a trace."""

import tomllib

import pytest

from jaxball import ScenarioError, read_scenario
from jaxball.cli import main
from jaxball.files.scenario import read_document
from jaxball.files.scenario.errors import all_problems
from tests.scenario.documents import BALL, DISK
from tests.support.sentences import refuses, said

MANY = 100_000


@pytest.mark.parametrize(
    "text",
    [
        f"[{'.'.join(['a'] * 10_000)}]\nb = 1\n",
        f"a = {'[' * 300}1{']' * 300}\n",
        "\n".join(f"[[{'.'.join(['a'] * k)}]]" for k in range(1, 200)),
    ],
    ids=["a heading", "lists", "tables in lists"],
)
def test_a_document_that_is_nested_deeply(text):
    with refuses(ScenarioError, "A scenario"):
        read_scenario(DISK + text)


@pytest.mark.parametrize("place", ["", "body"])
def test_the_first_of_many_unknown_keys_are_told_and_the_others_counted(place):
    document = tomllib.loads(DISK)
    (document[place] if place else document).update({f"mystery_{k}": k for k in range(MANY)})
    with all_problems() as problems:
        read_document(document)
    path = f"{place}." if place else ""
    assert len(problems) == 11
    for k, problem in enumerate(problems):
        said(str(problem), f"{path}mystery_{k}")
    said(str(problems[-1]), f"{MANY - 11:,}")


def test_the_first_of_many_problems_are_told_by_a_command(tmp_path, capsys):
    (tmp_path / "many.toml").write_text(DISK + '[[masses]]\nmass = "heavy"\n' * 50)
    for command in ("validate", "simulate"):
        assert main([command, str(tmp_path / "many.toml")]) == 2
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 11
        said(lines[0], "masses[1]")
        said(lines[-1])


def test_a_number_that_overflows_says_so():
    for text, named in {
        "mass = 1e400": "body.mass",
        "gravity = -1e999": ("body.gravity"),
    }.items():
        key = text.split(" ")[0]
        lines = [line for line in BALL.splitlines() if not line.startswith(f"{key} =")]
        lines.insert(lines.index("[body]") + 1, text)
        with refuses(ScenarioError, named):
            read_scenario("\n".join(lines))


EXITS = (
    DISK + '[[masses]]\nmass = 0.1\nrail = { kind = "exits_at_once:Rail" }\nschedule = { kind = "pulse", value = 1 }\n'
)


@pytest.mark.parametrize("code", ["0", "3", ""])
def test_a_module_that_ends_the_program(tmp_path, monkeypatch, capsys, code):
    (tmp_path / "exits_at_once.py").write_text(f"import sys\nsys.exit({code})\n")
    (tmp_path / "exits.toml").write_text(EXITS)
    monkeypatch.chdir(tmp_path)
    for command in (["validate", "exits.toml"], ["simulate", "exits.toml", "--out", "run.npz"]):
        assert main(command) == 2
        said(capsys.readouterr().err, "exits_at_once:Rail", "SystemExit")
    assert not (tmp_path / "run.npz").exists()


STEERING = "\x1b[31mred\x07\u202ederutrot\nfake: all is well"


def test_nothing_of_a_file_steers_the_terminal(tmp_path, capsys):
    def quoted(text):
        return text.encode("unicode_escape").decode().replace("\\x", "\\u00")

    (tmp_path / "title.toml").write_text(f'title = "{quoted(STEERING)}"\n' + DISK)
    assert main(["validate", str(tmp_path / "title.toml")]) == 0
    assert read_scenario((tmp_path / "title.toml").read_text()).title == STEERING
    shown = capsys.readouterr().out
    assert r'"\x1b[31mred\x07\u202ederutrot fake: all is well"' in shown
    assert len(shown.splitlines()) == 1

    (tmp_path / "key.toml").write_text(f'"{quoted(STEERING)}" = 1\n' + DISK)
    assert main(["validate", str(tmp_path / "key.toml")]) == 2
    shown = capsys.readouterr().err
    assert not any(character in shown for character in "\x1b\x07\u202e")
    assert len(shown.splitlines()) == 1


def test_a_name_of_python_in_a_file_leads_to_that_of_files():
    robot = '[[mechanisms]]\njoints = [{{ kind = "hinge", axis = [0, 1, 0], {} = 1 }}]\nmasses = []\n'
    with all_problems() as problems:
        read_scenario(DISK + robot.format("drive"))
    sentence = (
        "Key `mechanisms[0].joints[0].drive` is not known; in a file it is one of `schedule`, `force`, `accelerated`."
    )
    assert sentence in map(str, problems)
