"""The gallery: what it says of examples agrees with their files, and thumbnails show what their words say."""

import dataclasses
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from jaxball import load_scenario
from jaxball.files.scenario import builtin_scenarios

pytest.importorskip("sphinx")  # of the extra `docs`

ROOT = Path(__file__).parents[2]
SHORT = 32  # letters of a name in a list, at most


@pytest.fixture
def extensions(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    import extensions
    import extensions.cards
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


def test_every_entry_is_in_one_group(extensions):
    entries = extensions.gallery.scenarios() + extensions.gallery.examples()
    listed = [name for names in extensions.cards.GROUPS.values() for name in names]
    assert sorted(listed) == sorted(entry.name for entry in entries)


def test_every_robot_has_a_small_picture_with_words(extensions):
    """Also those whose pages a short gallery does not make; ``python -m docs.extensions.cards NAME`` draws it."""
    cards = extensions.cards
    entries = extensions.gallery.scenarios() + extensions.gallery.examples()
    names = {entry.name for entry in entries if not entry.robot}
    assert {path.stem for path in cards.CARDS.glob("*.webp")} == names
    assert set(cards.read_words()) == names
    assert {*builtin_scenarios()} <= names
    for name in names:
        path = cards.CARDS / f"{name}.webp"
        assert path.stat().st_size < cards.LARGEST
        with Image.open(path) as picture:
            width, height = picture.size
            tones = np.asarray(picture.convert("L"))
        assert width <= cards.WIDEST
        assert height <= cards.HIGHEST
        assert np.mean(tones < 200) > 0.002, f"{name} is blank"
        assert len(cards.read_words()[name].split()) > 3


def test_a_card_is_cut_to_what_it_shows_and_refused_where_it_is_large(extensions, tmp_path, monkeypatch):
    cards = extensions.cards
    monkeypatch.setattr(cards, "CARDS", tmp_path / "cards")
    monkeypatch.setattr(cards, "WORDS", tmp_path / "cards" / "words.json")
    picture = np.full((800, 1200, 3), 255, dtype=np.uint8)
    picture[100:700, 300:600] = 0  # twice as high as wide
    Image.fromarray(picture).save(tmp_path / "large.png")
    cards.write_card(tmp_path / "large.png", "A black rectangle on white", "rectangle")
    with Image.open(tmp_path / "cards" / "rectangle.webp") as small:
        assert small.size == (cards.HIGHEST // 2, cards.HIGHEST)
    assert cards.read_words() == {"rectangle": "A black rectangle on white"}
    noise = np.random.default_rng(0).integers(0, 255, picture.shape, dtype=np.uint8)
    Image.fromarray(noise).save(tmp_path / "noise.png")
    with pytest.raises(ValueError, match="must be smaller than 15000 bytes"):
        cards.write_card(tmp_path / "noise.png", "Noise", "noise")


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
@pytest.mark.parametrize(
    ("name", "first", "last"),
    [
        ("slipping-ball", "the configuration in the body, ", ", the slip speed and the contact force"),
        ("draw-shot", "the path on the plane, ", ", the slip speed and the contact force"),
        ("chaplygin-sleigh", "the positions, the angles, ", " and the constraint forces"),
    ],
)
def test_panels_are_named_in_the_words_of_an_overview(name, first, last, extensions, tmp_path):
    """Of a run with units and without, and of a system from its own Lagrangian."""
    run = load_scenario(name).simulate(throw=True)
    extensions.thumbnails.write_overview(run, "A title", tmp_path)
    words = (tmp_path / "overview.txt").read_text()
    assert words.startswith(f"Panels of the run: {first}")
    assert words.endswith(last)
