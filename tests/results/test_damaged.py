"""A file that has been damaged is refused in a sentence, and never gives other numbers than those that were saved."""

import io
import os
import random
import subprocess
import sys
import zipfile
from pathlib import Path

import h5py
import jax
import numpy as np
import pytest

import jaxball
from jaxball import load_run, simulate
from jaxball.files.results.files import CHECKSUM, RunError, load_attributes
from tests.results.test_stored_runs import STORED
from tests.support.sentences import refuses, said

TIMES = 31
DAMAGES = 120
KINDS = ("bytes", "zeros", "cut", "bit")


@pytest.fixture(scope="module")
def run():
    return simulate(jaxball.Disk(mass=1.0, inertia=0.5), np.linspace(0.0, 3.0, TIMES), jaxball.DiskState(phidot=-1.0))


def damaged(content, seed, kinds=KINDS):
    """The content with one thing done to it: bytes changed, zeroed or cut off, a bit turned."""
    choices, content = random.Random(seed), bytearray(content)
    start = choices.randrange(len(content))
    match choices.choice(kinds):
        case "bytes":
            for _ in range(choices.randrange(1, 200)):
                content[choices.randrange(len(content))] = choices.randrange(256)
        case "zeros":
            zeros = bytes(min(choices.randrange(1, 512), len(content) - start))
            content[start : start + len(zeros)] = zeros
        case "cut":
            del content[start:]
        case "bit":
            content[start] ^= 1 << choices.randrange(8)
    return bytes(content)


@pytest.mark.parametrize("suffix", [".nc", ".npz"])
def test_damage_is_told_and_never_gives_other_numbers(run, tmp_path, suffix):
    good, path = run.save(tmp_path / f"good{suffix}").read_bytes(), tmp_path / f"damaged{suffix}"
    told = 0
    for seed in range(DAMAGES):
        path.write_bytes(damaged(good, seed))
        if path.read_bytes() == good:  # zeros in place of zeros
            continue
        with pytest.raises(RunError, match="damaged"):  # in words that HDF5 has a part in
            load_run(path)
        told += 1
    assert told > 0.8 * DAMAGES


@pytest.mark.parametrize("stored", STORED, ids=lambda path: path.name)
def test_damage_of_a_file_without_a_checksum_raises_no_other_error(tmp_path, stored):
    """Its numbers may be others: nothing in such a file tells. HDF5 itself does not come back from all damage of its
    heaps, so that its files are only cut off here.
    """
    path, told, kinds = (
        tmp_path / stored.name,
        [],
        ("cut",) if stored.suffix == ".nc" else KINDS,
    )
    for seed in range(DAMAGES):
        path.write_bytes(damaged(stored.read_bytes(), seed, kinds))
        try:
            load_run(path)
        except RunError as error:
            told.append(str(error))
    assert len(told) > 0.5 * DAMAGES
    assert not any("\n" in sentence for sentence in told)


@pytest.mark.parametrize("suffix", [".nc", ".npz"])
def test_a_file_that_lost_its_checksum_has_changed(run, tmp_path, suffix):
    path = run.save(tmp_path / f"run{suffix}")
    assert CHECKSUM in load_attributes(path)
    os.truncate(path, path.stat().st_size - 16)  # the checksum alone, which nothing else reads
    with refuses(RunError, f"run{suffix}"):
        load_run(path)


def without_checksum(path, **changes):
    """Writes the arrays and attributes of a saved run again, as another program does, with changes."""
    with np.load(path) as data:
        content = {name: data[name] for name in data.files if name != CHECKSUM}
    np.savez(path.with_name("changed.npz"), **(content | changes))
    return path.with_name("changed.npz")


def test_a_state_for_each_time(run, tmp_path):
    path, z = run.save(tmp_path / "run.npz"), np.asarray(run.state.z)
    for changed, values, named in (
        ("time", np.linspace(0.0, 3.0, 17), "17 times"),
        ("z", z[:, None], "z"),
        ("steps", np.asarray(["1", "2"]), "steps"),
    ):
        with refuses(RunError, named):
            load_run(without_checksum(path, **{changed: values}))


def test_a_file_that_claims_more_than_it_has(run, tmp_path):
    """No memory is taken for a hundred thousand million times, of which a file of some kilobytes speaks."""
    many = 10**11
    path = run.save(tmp_path / "run.nc")
    os.truncate(path, path.stat().st_size - 16)
    with h5py.File(path, "r+") as file:
        del file.attrs[CHECKSUM], file["z"]
        file.create_dataset("z", (many,), dtype="f8", chunks=(1024,))
    with refuses(RunError, "run.nc"):
        load_run(path)

    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (many,)})
    path = without_checksum(run.save(tmp_path / "run.npz"), format=np.asarray(1))
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in (members | {"z.npy": header.getvalue()}).items():
            archive.writestr(name, content)
    with refuses(RunError, "changed.npz"):
        load_run(path)


def test_what_a_checksum_protects_others_read_as_before(run, tmp_path):
    """The digits behind a netCDF file and an archive are passed over by xarray and by NumPy."""
    import xarray

    with xarray.open_dataset(run.save(tmp_path / "run.nc"), engine="h5netcdf") as data:
        np.testing.assert_array_equal(data.z, run.state.z)
    with np.load(run.save(tmp_path / "run.npz")) as data:
        np.testing.assert_array_equal(data["z"], run.state.z)
    for path in (tmp_path / "run.nc", tmp_path / "run.npz"):
        assert jax.tree.all(jax.tree.map(np.array_equal, load_run(path).state, run.state))


FULL = """
import resource, sys
from pathlib import Path
import numpy, xarray
from jaxball.interface.output import OutputError, replacing
from jaxball.files.results.saving import write_netcdf

resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
dataset = xarray.Dataset({"z": ("time", numpy.arange(50_000.0))})
try:
    with replacing(Path("run.nc")) as beside:
        write_netcdf(dataset, beside)
except OutputError as error:
    sys.exit(str(error))
"""


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform == "win32", reason="Windows does not limit the size of files")
def test_a_full_disk_is_told_by_a_process_that_ends_in_order(tmp_path):
    """Files of at most 100 kB stand for the disk: both end a write midway. HDF5 would crash when the process ends."""
    (tmp_path / "run.nc").write_text("of another day")
    ended = subprocess.run([sys.executable, "-c", FULL], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (1, "")
    said(ended.stderr, "run.nc")
    assert [path.name for path in Path(tmp_path).iterdir()] == ["run.nc"]
    assert (tmp_path / "run.nc").read_text() == "of another day"
