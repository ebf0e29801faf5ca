"""Commands give the same with programs that were kept, or none; ``jaxball cache`` shows and clears them."""

import os
import subprocess
import sys

import numpy as np
import pytest

import jaxball
from jaxball.cli import main
from jaxball.programs.store import current
from jaxball.programs.store.current import LIST, XLA
from jaxball.programs.store.folder import Folder
from tests.scenario.documents import DISK


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXBALL_CACHE_DIR", str(tmp_path / "programs"))
    monkeypatch.delenv("JAXBALL_NO_CACHE")
    return tmp_path / "programs"


def command(*arguments, folder, program="import sys; from jaxball.cli import main; sys.exit(main())", **variables):
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        cwd=folder,
        env={**os.environ, "EQX_ON_ERROR": "nan", **variables},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


SOLVES = {
    "fails": "[solve]\nmax_steps = 3\n",
    "calls LAPACK": "[solve]\nsolver = 'kvaerno3'\nrtol = 1e-5\natol = 1e-5\n",
}


@pytest.mark.long
@pytest.mark.parametrize("solve", SOLVES.values(), ids=SOLVES)
def test_a_command_that_finds_its_programs_says_and_writes_the_same(tmp_path, place, solve):
    (tmp_path / "run.toml").write_text(DISK + solve)
    first = command("simulate", "run.toml", "--out", "run.npz", folder=tmp_path)
    kept = {path.name for path in place.iterdir()}
    assert kept
    (tmp_path / "run.npz").rename(tmp_path / "first.npz")
    assert command("simulate", "run.toml", "--out", "run.npz", folder=tmp_path) == first
    assert {path.name for path in place.iterdir()} == kept
    with np.load(tmp_path / "first.npz") as one, np.load(tmp_path / "run.npz") as other:
        assert set(one) == set(other)
        for name in one:
            if one[name].dtype.kind == "f":
                assert one[name].tobytes() == other[name].tobytes(), name


@pytest.mark.thorough
@pytest.mark.parametrize("off", [{"option": "--no-cache"}, {"mode": 0o777}], ids=["option", "others can write"])
def test_a_command_without_a_cache_leaves_nothing(tmp_path, place, off):
    if "mode" in off:
        place.mkdir()
        place.chmod(off["mode"])
    arguments = [off["option"]] if "option" in off else []
    (tmp_path / "run.toml").write_text(DISK)
    code, _, stderr = command("validate", "run.toml", *arguments, folder=tmp_path)
    assert (code, stderr) == (0, "")
    assert not place.exists() or not list(place.iterdir())


def test_the_command_shows_and_clears(place, capsys):
    assert main(["cache"]) == 0
    assert (
        capsys.readouterr().out == f"Compiled programs in {place}\n  0 files, 0.0 MB of at most 512.0 MB\n"
        "  0 programs: 0 compiled natively, 0 by XLA\n  in use\n"
    )
    place.mkdir(mode=0o700)
    (place / f"{'0' * 40}.program").write_bytes(bytes(2_500_000))
    (place / "mine.txt").write_text("")
    assert main(["cache"]) == 0
    assert "  1 file, 2.5 MB of at most 512.0 MB\n" in capsys.readouterr().out
    assert main(["cache", "--clear"]) == 0
    assert capsys.readouterr().out == "1 file, 2.5 MB removed\n"
    assert [path.name for path in place.iterdir()] == ["mine.txt"]


@pytest.mark.thorough
def test_the_command_counts_the_programs_of_each_compiler(tmp_path, place, capsys, monkeypatch):
    (tmp_path / "run.toml").write_text(DISK)
    counts = []
    for name in ("native", "xla"):
        monkeypatch.setenv("JAXBALL_COMPILER", name)
        assert main(["validate", str(tmp_path / "run.toml")]) == 0
        counts.append(jaxball.programs.cache.contents())
    assert counts[0].native > 0
    assert counts[1].native == counts[0].native
    assert counts[1].xla > counts[0].xla
    capsys.readouterr()
    main(["cache"])
    programs = counts[1].native + counts[1].xla
    line = f"  {programs} programs: {counts[1].native} compiled natively, {counts[1].xla} by XLA\n"
    assert line in capsys.readouterr().out


def test_the_command_says_why_programs_are_not_kept(place, capsys, monkeypatch):
    place.mkdir()
    place.chmod(0o757)
    main(["cache"])
    assert f'  not in use: The folder "{place}" can be written by others.\n' in capsys.readouterr().out
    monkeypatch.setenv("JAXBALL_NO_CACHE", "1")
    main(["cache"])
    assert "  not in use: The variable JAXBALL_NO_CACHE is set.\n" in capsys.readouterr().out


def test_neither_the_command_nor_the_library_imports_jax(tmp_path):
    program = "import sys, jaxball.programs.cache; from jaxball.cli import main; main(['cache'])\n"
    program += "assert 'jax' not in sys.modules"
    program += "\njaxball.programs.cache.enable('programs')\nassert 'jax' not in sys.modules\nprint('done')"
    code, stdout, stderr = command(folder=tmp_path, program=program, JAXBALL_CACHE_DIR=str(tmp_path))
    assert (code, stderr) == (0, "")
    assert stdout.endswith("done\n")


def test_a_command_called_from_python_leaves_the_library_as_it_was(place, tmp_path):
    (tmp_path / "run.toml").write_text(DISK)
    assert main(["validate", str(tmp_path / "run.toml")]) == 0
    assert current.store() is None


KEPT = """
import jax, jax.numpy as jnp
from jaxball import programs
from jaxball.programs import cache
from jaxball.programs.native import compiler
jax.config.update("jax_enable_x64", True)
{first}
with compiler("{compiler}"):
    programs.jit(jnp.cross)(jnp.ones(3), jnp.arange(3.0))
print(cache.contents().native, cache.contents().xla)
"""


@pytest.mark.thorough
def test_python_keeps_native_programs_unless_it_is_told_not_to(tmp_path):
    """Those of XLA alone where one asks for them: XLA complains on stderr when it loads one."""

    def kept(folder, first="", compiler="native", **environment):
        program = KEPT.format(first=first, compiler=compiler)
        variables = {"JAXBALL_NO_CACHE": "", "JAXBALL_CACHE_DIR": str(tmp_path / folder)} | environment
        code, stdout, stderr = command(folder=tmp_path, program=program, **variables)
        assert (code, stderr) == (0, "")
        return tuple(map(int, stdout.split()))

    native, xla = kept("kept")
    assert (native > 0, xla) == (True, 0)
    assert kept("kept") == (native, 0)  # found, and not written again
    assert kept("disabled", "cache.disable()") == (0, 0)
    assert kept("variable", JAXBALL_NO_CACHE="1") == (0, 0)
    assert kept("by_xla", compiler="xla") == (0, 0)
    assert kept("asked", "cache.enable()", compiler="xla")[1] > 0


@pytest.mark.thorough
def test_a_command_keeps_programs_of_xla_too_and_a_list_of_what_it_loads_early(tmp_path, place):
    """Also where the library has found the user's folder before, and kept native programs there."""
    (tmp_path / "run.toml").write_text(DISK)
    program = "import sys; from jaxball.programs.store import current; assert current.store(); "
    program += "from jaxball.cli import main; sys.exit(main(['simulate', 'run.toml', '--quiet']))"
    assert command(folder=tmp_path, program=program, JAXBALL_COMPILER="xla") == (0, "", "")
    folder = Folder(place)
    assert folder.count(LIST) == 1
    assert folder.count(XLA) > 0


def test_the_library_keeps_programs_where_it_is_told_to(place, monkeypatch):
    try:
        assert jaxball.programs.cache.enable()
        assert current.store().folder.path == place
        assert jaxball.programs.cache.enable(place / "elsewhere")
        assert current.store().folder.path == place / "elsewhere"
    finally:
        jaxball.programs.cache.disable()
    assert current.store() is None
    monkeypatch.setenv("JAXBALL_NO_CACHE", "1")
    assert not jaxball.programs.cache.enable()
    assert current.store() is None


def test_the_folder_is_the_users_own(monkeypatch, tmp_path):
    pytest.importorskip("platformdirs")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("JAXBALL_CACHE_DIR", raising=False)
    if sys.platform.startswith("linux"):
        assert jaxball.programs.cache.contents().folder == tmp_path / "jaxball" / "programs"
    assert not list(tmp_path.iterdir())
