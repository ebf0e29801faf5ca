"""A command loads early what it used last, and gets nothing else than what it would have read."""

import subprocess
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import programs
from jaxball.programs.store import current, folder_store as module
from jaxball.programs.store.folder import Folder
from jaxball.programs.store.folder_store import FolderStore

A, B = np.array([1.0, 2.0, 3.0]), np.array([0.3, -0.1, 0.7])


@pytest.fixture
def command(tmp_path):
    """Runs a function as a command with some arguments, in a process of its own; returns the store."""

    def run(function, *arguments):
        store = FolderStore(Folder(tmp_path / "programs"), arguments)
        with current.keep_within(store):
            store.begin()
            result = function()
            store.end()
        return result, store

    return run


cross = programs.jit(jnp.cross)


def test_the_programs_of_the_same_command_are_loaded_early(command, monkeypatch):
    first, store = command(lambda: cross(A, B), "simulate", "ball")
    assert len(store.folder.entries()) == 2  # the program, and the list
    read = []
    monkeypatch.setattr(FolderStore, "read", lambda store, key: read.append(key))
    second, _ = command(lambda: cross(A, B), "simulate", "ball")
    assert read == []
    assert np.asarray(first).tobytes() == np.asarray(second).tobytes()
    command(lambda: cross(A, B), "simulate", "disk")
    assert len(read) == 1


def test_what_is_expected_in_vain_does_no_harm(command, tmp_path):
    command(lambda: cross(A, B), "simulate")
    command(lambda: None, "simulate")
    for path in (tmp_path / "programs").iterdir():
        path.write_bytes(path.read_bytes()[:-1])
    result, store = command(lambda: cross(A, B), "simulate")
    np.testing.assert_allclose(result, np.cross(A, B), rtol=4e-16)
    assert len(store.folder.entries()) == 2


def test_nothing_is_kept_when_files_changed_since_they_were_looked_at(command, monkeypatch):
    def changing():
        monkeypatch.setattr(module, "sources", lambda: "other")
        return cross(A, B)

    result, store = command(changing)
    np.testing.assert_allclose(result, np.cross(A, B), rtol=4e-16)
    assert [entry.size for entry in store.folder.entries() if entry.size > 1000] == []


def test_a_library_without_files_shares_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "OWN", tmp_path)
    assert module.sources() != module.sources()


COMPILES = """
import sys, time
from pathlib import Path
import numpy as np
import jax.numpy as jnp
from jaxball.programs import native
from jaxball.programs.cache import current
from jaxball.programs.store.folder import Folder
from jaxball.programs.store.folder_store import FolderStore
from jaxball import programs

folder, made = Path(sys.argv[1]), native.Lowered.compile_natively

def slowly(*given):
    print("compiles", flush=True)
    time.sleep(2.0)
    return made(*given)

native.Lowered.compile_natively = slowly
cross = programs.jit(jnp.cross)
(folder / sys.argv[2]).touch()
while not all((folder / name).exists() for name in "ab"):
    time.sleep(0.01)
with current.keep_within(FolderStore(Folder(folder / "programs"))):
    print(np.asarray(cross(np.array([1.0, 2.0, 3.0]), np.array([0.3, -0.1, 0.7]))).tobytes().hex())
"""


@pytest.mark.thorough
def test_one_of_two_processes_compiles_and_the_other_loads(tmp_path):
    """Of those that need a program at the same time."""
    script = tmp_path / "compiles.py"
    script.write_text(COMPILES)
    processes = [
        subprocess.Popen([sys.executable, script, tmp_path, name], stdout=subprocess.PIPE, text=True) for name in "ab"
    ]
    said = [process.communicate(timeout=120)[0].split() for process in processes]
    assert [process.returncode for process in processes] == [0, 0]
    assert sorted(len(words) for words in said) == [1, 2]
    assert said[0][-1] == said[1][-1]


def test_a_program_is_identified_by_all_files_of_jaxball():
    """A program must not outlive a change of an equation of motion, which is in another room."""
    assert Path(jaxball.__file__).parent == module.OWN
