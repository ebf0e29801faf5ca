"""The folder gives back what was put there or nothing, whatever happened to it; raises nothing, and prints nothing."""

import errno
import os
import threading

import pytest

from jaxball.programs.store import folder as module
from jaxball.programs.store.folder import Folder

KEY, OTHER = "0" * 40, "f" * 40
CONTENT = bytes(range(256)) * 50


@pytest.fixture
def place(tmp_path):
    return tmp_path / "a" / "programs"


@pytest.fixture
def folder(place):
    folder = Folder(place)
    folder.write(KEY, CONTENT)
    return folder


def test_what_was_written_is_read_in_a_private_folder(folder, place):
    assert folder.read(KEY) == CONTENT
    assert folder.read(OTHER) is None
    assert place.stat().st_mode & 0o777 == 0o700
    assert (place / f"{KEY}.program").stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content[:-1],
        lambda content: b"",
        lambda content: content[: len(content) // 2],
        lambda content: content + b"0",
        lambda content: content[:100] + bytes([content[100] ^ 1]) + content[101:],
        lambda content: bytes([content[0] ^ 1]) + content[1:],
        lambda content: b"\x80\x05N." + content,
    ],
    ids=["truncated", "empty", "half", "longer", "a bit of the content", "a bit of the head", "foreign"],
)
def test_a_damaged_program_is_not_there(folder, place, damage):
    path = place / f"{KEY}.program"
    path.write_bytes(damage(path.read_bytes()))
    assert folder.read(KEY) is None
    assert not path.exists()


def test_a_program_under_the_name_of_another_is_not_there(folder, place):
    (place / f"{KEY}.program").rename(place / f"{OTHER}.program")
    assert folder.read(OTHER) is None


def test_a_program_that_others_can_write_is_not_there(folder, place):
    (place / f"{KEY}.program").chmod(0o620)
    assert folder.read(KEY) is None


def test_a_link_is_not_followed(folder, place, tmp_path):
    (place / f"{KEY}.program").rename(tmp_path / "elsewhere")
    (place / f"{KEY}.program").symlink_to(tmp_path / "elsewhere")
    assert folder.read(KEY) is None


@pytest.mark.parametrize("mode", [0o720, 0o702, 0o777])
def test_a_folder_that_others_can_write_is_refused(folder, place, mode):
    place.chmod(mode)
    assert folder.objection() == "can be written by others"
    assert folder.read(KEY) is None
    folder.write(OTHER, CONTENT)
    assert [entry.path.stem for entry in folder.entries()] == [KEY]


def test_a_folder_that_others_can_read_is_not_refused(folder, place):
    place.chmod(0o755)
    assert folder.objection() is None
    assert folder.read(KEY) == CONTENT


def test_a_folder_of_another_user_is_refused(folder, monkeypatch):
    own = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: own + 1)
    assert folder.objection() == "belongs to another user"
    assert folder.read(KEY) is None
    folder.write(OTHER, CONTENT)
    assert len(folder.entries()) == 1


def test_a_file_in_the_place_of_the_folder_is_left_alone(tmp_path):
    path = tmp_path / "programs"
    path.write_text("precious")
    folder = Folder(path)
    assert folder.objection() == "is a file"
    folder.write(KEY, CONTENT)
    assert (folder.read(KEY), folder.entries(), path.read_text()) == (None, [], "precious")


@pytest.mark.parametrize("reason", [errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EDQUOT])
def test_what_cannot_be_written_is_not_there_and_leaves_nothing(folder, place, monkeypatch, reason):
    def refuse(key, content):
        raise OSError(reason, os.strerror(reason))

    with monkeypatch.context() as patched:
        patched.setattr(module, "_head", refuse)
        folder.write(OTHER, CONTENT)
    assert [path.name for path in place.iterdir()] == [f"{KEY}.program"]
    assert folder.read(KEY) == CONTENT


def test_ctrl_c_leaves_nothing_half_written(folder, place, monkeypatch):
    def interrupt(key, content):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "_head", interrupt)
    with pytest.raises(KeyboardInterrupt):
        folder.write(OTHER, CONTENT)
    assert [path.name for path in place.iterdir()] == [f"{KEY}.program"]


def test_the_programs_used_longest_ago_make_room(tmp_path):
    folder = Folder(tmp_path / "programs", limit=5 * (len(CONTENT) + 100))
    keys = [f"{number:040x}" for number in range(5)]
    for age, key in enumerate(keys):
        folder.write(key, CONTENT)
        os.utime(folder.path / f"{key}.program", (age, age))
    folder.read(keys[0])  # is now the last that was used
    folder.write(OTHER, CONTENT)
    assert {entry.path.stem for entry in folder.entries()} == {keys[0], *keys[3:], OTHER}
    folder.write("a" * 40, b"0" * (folder.limit + 1))
    assert folder.read("a" * 40) is None


def test_what_was_left_half_written_goes_in_time(folder, place):
    old, new, foreign = place / ".part-old.program", place / ".part-new.program", place / "mine.txt"
    for path in (old, new, foreign):
        path.write_text("")
    os.utime(old, (0, 0))
    folder.write(OTHER, CONTENT)
    assert (old.exists(), new.exists()) == (False, True)
    assert {entry.path.stem for entry in folder.clear()} == {KEY, OTHER}
    assert list(place.iterdir()) == [foreign]


def test_many_may_write_and_read_at_once(place):
    seen = []

    def work(number):
        folder = Folder(place, limit=3 * len(CONTENT))  # so that they remove each other's as well
        for turn in range(30):
            key = f"{(number + turn) % 5:040x}"
            folder.write(key, key.encode() + CONTENT)
            seen.append(folder.read(key) in (None, key.encode() + CONTENT))

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(seen) == 120
    assert all(seen)
    assert not [path for path in place.iterdir() if path.name.startswith(".part-")]
