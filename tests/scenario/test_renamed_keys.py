"""Keys by their old names: an injected table of names, because no key has been renamed since 0.1."""

import re
import warnings

import numpy as np
import pytest

from jaxball import load_run, read_scenario, save, write_scenario
from jaxball.results.files import CHECKSUM
from jaxball.scenario import ScenarioError, builtin_text
from jaxball.scenario.renamed import RENAMED, NewName, with_new_keys
from jaxball.scenario.sources import scenario_document
from jaxball.sweep import read_study
from tests.scenario.documents import DISK

OLD = {
    "contact.stiction": NewName("static_friction", "0.2"),
    "masses.rail.breadth": NewName("radius", "0.3"),
    "shell": NewName("body", "0.2"),
}


def shot(key):
    """The text of a draw shot with a static friction of its own, under this key."""
    return builtin_text("draw-shot").replace("friction = 0.2", f"friction = 0.2\n{key} = 0.3", 1)


@pytest.fixture
def renamed(monkeypatch):
    for old, new in OLD.items():
        monkeypatch.setitem(RENAMED, old, new)


def test_no_key_has_another_name_yet():
    """A key that gets one is added to the table; this test then compares it with the page of keys instead."""
    assert RENAMED == {}
    with pytest.raises(ScenarioError, match=r"Key `contact\.stiction` is not known"):
        read_scenario(shot("stiction"))


@pytest.mark.usefixtures("renamed")
def test_an_old_key_is_read_as_the_new_one_with_a_warning_at_the_line_of_the_user():
    words = "Key `contact.stiction` is called `static_friction` since jaxball 0.2; it is read as that, but rename it."
    with pytest.warns(FutureWarning, match=re.escape(words)) as caught:
        scenario = read_scenario(shot("stiction"))
    assert "/src/jaxball/" not in caught[0].filename
    assert scenario.contact is not None
    assert float(scenario.contact.static_friction) == 0.3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        written = write_scenario(scenario)
        assert float(read_scenario(written).contact.static_friction) == 0.3
    assert "static_friction = 0.3" in written


@pytest.mark.usefixtures("renamed")
def test_both_names_at_once_are_refused():
    text = shot("stiction").replace("stiction = 0.3", "stiction = 0.3\nstatic_friction = 0.3")
    with pytest.raises(ScenarioError, match=r"`contact\.stiction` must be left out where `static_friction` is given"):
        read_scenario(text)


@pytest.mark.usefixtures("renamed")
def test_tables_and_keys_in_lists_have_new_names():
    old = {"shell": {"mass": 1.0}, "masses": [{"rail": {"breadth": 0.5}}, {"breadth": 3.0}], "title": "shell"}
    new = {"body": {"mass": 1.0}, "masses": [{"rail": {"radius": 0.5}}, {"breadth": 3.0}], "title": "shell"}
    with pytest.warns(FutureWarning) as caught:
        assert with_new_keys(old) == new
    assert [re.findall("`(.*?)`", str(warning.message)) for warning in caught] == [
        ["shell", "body"],
        ["masses.rail.breadth", "radius"],
    ]


@pytest.mark.usefixtures("renamed")
def test_studies_name_them_too(tmp_path):
    """In the scenario that they hold or name, and in the paths of their axes."""
    axis = '[[axes]]\npath = "shell.mass"\nvalues = [1.0, 2.0]\n'
    (tmp_path / "disk.toml").write_text(DISK.replace("[body]", "[shell]").replace("body =", "shell ="))
    with pytest.warns(FutureWarning, match="Key `shell` is called `body`"):
        study = read_study(f'format = 1\nscenario = "disk.toml"\n{axis}', tmp_path)
    assert study.paths == ("body.mass",)
    paths = {"path": "masses[3].rail.breadth", "other": "masses[3].rail.breadth"}
    with pytest.warns(FutureWarning):
        assert with_new_keys(paths) == {**paths, "path": "masses[3].rail.radius"}
    assert with_new_keys({"path": "masses[3].rail.breadths"}) == {"path": "masses[3].rail.breadths"}
    with pytest.warns(FutureWarning):
        assert "body" in scenario_document("disk.toml", tmp_path, ScenarioError)


@pytest.mark.thorough
@pytest.mark.usefixtures("renamed")
def test_a_saved_run_of_an_older_scenario_is_read(tmp_path):
    scenario = read_scenario(shot("static_friction"))
    run = scenario.simulate()
    with np.load(save(run, tmp_path / "run.npz", scenario)) as saved:
        content = {name: saved[name] for name in saved if name != CHECKSUM}
    older = {
        name: np.asarray(str(value).replace("static_friction", "stiction"))
        for name, value in content.items()
        if value.dtype.kind == "U" and "static_friction" in str(value)
    }
    assert len(older) == 1
    np.savez(tmp_path / "older.npz", **content | older)
    with pytest.warns(FutureWarning, match="stiction"):
        again = load_run(tmp_path / "older.npz")
    np.testing.assert_array_equal(again.state.z, run.state.z)
