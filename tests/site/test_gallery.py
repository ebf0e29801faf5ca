"""The gallery: what it says of examples agrees with their files, and thumbnails show what their words say."""

import dataclasses
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from jaxball.scenario import load_scenario

pytest.importorskip("sphinx")  # of the extra `docs`

ROOT = Path(__file__).parents[2]
SHORT = 32  # letters of a name in a list, at most


@pytest.fixture
def extensions(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    import extensions
    import extensions.gallery
    import extensions.thumbnails

    yield extensions
    for name in [name for name in sys.modules if name.partition(".")[0] == "extensions"]:
        del sys.modules[name]


def test_every_example_has_a_short_name_and_its_pictures_are_described(extensions):
    told = extensions.gallery.EXAMPLES
    files = [path for path in sorted((ROOT / "examples").iterdir()) if path.suffix in (".py", ".toml")]
    assert sorted(told) == [path.name for path in files]
    for path in files:
        written = re.findall(r'savefig\("(.*)"', path.read_text())
        if told[path.name].long:
            assert all((ROOT / "docs" / "figures" / name).exists() for name in told[path.name].pictures)
        else:
            assert sorted(told[path.name].pictures) == sorted(written)


def test_names_are_short_and_every_entry_has_a_robot(extensions):
    entries = extensions.gallery.scenarios() + extensions.gallery.examples()
    names = {entry.name for entry in entries}
    assert len({entry.short for entry in entries}) == len(entries)
    assert max(len(entry.short) for entry in entries) <= SHORT
    for entry in entries:
        assert entry.robot in names or (not entry.robot and entry.make is not None), entry.name


@pytest.mark.long
@pytest.mark.parametrize("name", ["bowling-ball", "disk", "heavy-top", "vakonomic-particle"])
def test_a_thumbnail_is_filled_by_what_it_shows(name, extensions, tmp_path):
    """A body that rolled far is not a dot at the end of its path."""
    scenario = load_scenario(name)
    scenario = dataclasses.replace(scenario, times=np.linspace(scenario.times[0], scenario.times[-1], 201))
    extensions.thumbnails.write_thumbnail(scenario, scenario.simulate(throw=True), tmp_path)
    with Image.open(tmp_path / "thumbnail.png") as picture:
        dark = np.asarray(picture.convert("L")) < 200
    down, across = (np.flatnonzero(dark.any(axis=axis)) for axis in (1, 0))
    assert np.ptp(down) > 0.6 * dark.shape[0]
    assert np.ptp(across) > 0.3 * dark.shape[1]
    words = (tmp_path / "thumbnail.txt").read_text()
    assert words.split()[0].lower() == scenario.system.describe().split()[0]


@pytest.mark.long
def test_panels_are_named_in_the_words_of_an_overview(extensions, tmp_path):
    run = load_scenario("slipping-ball").simulate(throw=True)
    extensions.thumbnails.write_overview(run, "A title", tmp_path)
    words = (tmp_path / "overview.txt").read_text()
    assert words.startswith("Panels of the run: the configuration in the body, ")
    assert words.endswith(", friction over the normal force, the slip speed and the contact force")
