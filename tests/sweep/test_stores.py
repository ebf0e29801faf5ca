"""Stores: whole whatever the order, the workers and the ends of runs; and never another study's."""

import concurrent.futures
import io
import itertools
import json
import os
import shutil
import signal

import numpy as np
import pytest
import xarray

from jaxball.cli import main
from jaxball.studies.sweep import StoreError, StudyError, executors, open_store, run
from jaxball.studies.sweep.outputs import outputs_of
from jaxball.studies.sweep.store import Store
from tests.support.sentences import refuses, said
from tests.sweep.studies import GRAVITIES, MASSES, files, pretend, study

SMALL = "chunk = 4"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The files of a study that nothing interrupted."""
    folder = tmp_path_factory.mktemp("whole")
    outcome = study(folder, settings=SMALL).run(folder / "s.zarr", engine=pretend)
    assert outcome[2:] == (15, 15, True, False)
    return files(outcome.store)


def interrupting(batch, wanted):
    """An engine during which Ctrl-C is pressed."""
    os.kill(os.getpid(), signal.SIGINT)
    return pretend(batch, wanted)


def failing(batch, wanted):
    """An engine on a disk that fills up."""
    if batch.system.mass[0] > 1:
        raise OSError(28, "No space left on device")
    return pretend(batch, wanted)


def test_shards_in_any_order_make_the_same_files(tmp_path, whole):
    found = study(tmp_path, settings=SMALL)
    for part in (3, 1, 2):
        outcome = found.run(tmp_path / "s.zarr", engine=pretend, shard=(part, 3))
        assert outcome.finished == (part == 2)
        assert outcome.table.exists() == (part == 2)
    assert files(outcome.store) == whole


def test_an_executor_of_ones_own_makes_the_same_files(tmp_path, whole):
    with concurrent.futures.ThreadPoolExecutor(3) as pool:
        outcome = study(tmp_path, settings=SMALL).run(tmp_path / "s.zarr", engine=pretend, executor=pool)
        assert pool.submit(int).result() == 0
    assert files(outcome.store) == whole


def test_ctrl_c_stops_at_the_end_of_a_chunk(tmp_path, whole):
    found, store = study(tmp_path, settings=SMALL), tmp_path / "s.zarr"
    outcome = found.run(store, engine=interrupting)
    assert outcome[2:] == (15, 4, False, True)
    assert "4 of 15 rows are done (26.7 %)\n  4 SUCCESS" in open_store(store).describe()
    with xarray.open_zarr(store) as data:
        assert list(data["status"].values) == [0] * 4 + [-1] * 11
        assert np.all(np.isnan(data["phi"].values[4:]))
    assert found.run(store, engine=pretend).finished
    assert files(store) == whole
    before = {path: path.stat().st_mtime_ns for path in store.rglob("*")}
    assert found.run(store, engine=failing).finished  # nothing is computed again
    assert before == {path: path.stat().st_mtime_ns for path in store.rglob("*")}


def test_a_disk_that_fills_up_leaves_what_was_done(tmp_path, whole, monkeypatch):
    found, store = study(tmp_path, settings=SMALL), tmp_path / "s.zarr"
    flush, calls = os.fsync, []

    def full(descriptor):
        calls.append(descriptor)
        if len(calls) > 60:
            raise OSError(28, "No space left on device")
        flush(descriptor)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with refuses(StoreError, "s.zarr"):
            found.run(store, engine=pretend)
    assert open_store(store).describe().startswith(("4 of 15", "8 of 15"))
    assert found.run(store, engine=pretend).finished
    assert files(store) == whole


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"axes": MASSES}, "axes"),
        ({"scenario": "kinder"}, "scenario"),
        ({"settings": "chunk = 5"}, "settings"),
    ],
)
def test_the_store_of_another_study_is_refused_and_left(tmp_path, changes, what):
    first = study(tmp_path, settings=SMALL).run(tmp_path / "s.zarr", engine=pretend)
    before = files(first.store)
    if "scenario" in changes:
        changes = {"scenario": (tmp_path / "disk.toml").read_text().replace("radius = 0.9", "radius = 0.8")}
    other = study(tmp_path, **{"settings": SMALL, **changes})
    with refuses(StoreError, what):
        other.run(first.store, engine=pretend)
    assert files(first.store) == before


def test_points_are_known_by_what_their_file_holds(tmp_path):
    axes, texts = '[[axes]]\npoints = "points.csv"\n', ("body.mass\n1.0\n2.0\n", "body.mass\n1.0\n2.5\n")
    for name, text in zip(("here", "there", "changed"), (texts[0], *texts), strict=True):
        (tmp_path / name).mkdir()
        (tmp_path / name / "points.csv").write_text(text)
    store = tmp_path / "s.zarr"
    for name in ("here", "there"):
        assert study(tmp_path / name, axes).run(store, engine=pretend).finished
    with refuses(StoreError, "s.zarr"):
        study(tmp_path / "changed", axes).run(store, engine=pretend)


def test_the_store_of_another_version_is_refused(tmp_path, monkeypatch):
    found = study(tmp_path, settings=SMALL)
    found.run(tmp_path / "s.zarr", engine=pretend)
    with monkeypatch.context() as patch:
        patch.setattr("importlib.metadata.version", lambda name: "9" if name == "diffrax" else "0")
        with refuses(StoreError, "diffrax_version"):
            found.run(tmp_path / "s.zarr", engine=pretend)


@pytest.mark.parametrize("content", [None, "", "{}", '{"attributes": {"title": "mine"}}', "[1]"])
def test_what_is_no_store_is_refused_and_left(tmp_path, content):
    place = tmp_path / "s.zarr"
    place.mkdir()
    (place / "precious").write_text("precious")
    if content is not None:
        (place / "zarr.json").write_text(content)
    before = sorted(place.rglob("*"))
    with refuses(StoreError, "s.zarr"):
        study(tmp_path).run(place, engine=pretend)
    assert sorted(place.rglob("*")) == before


def test_a_table_of_something_else_is_refused_and_left(tmp_path):
    (tmp_path / "s.parquet").write_text("precious")
    with refuses(StoreError, "s.parquet"):
        study(tmp_path).run(tmp_path / "s.zarr", engine=pretend)
    assert (tmp_path / "s.parquet").read_text() == "precious"
    assert not (tmp_path / "s.zarr").exists()


def test_a_folder_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "none" / "s.zarr", tmp_path / "file" / "s.zarr"):
        with refuses(StoreError, "out"):
            study(tmp_path).run(place, engine=pretend)
    with refuses(StoreError, "out"):
        study(tmp_path).run(tmp_path / "s.nc", engine=pretend)


CHANGES = {
    "removed": lambda path: path.unlink(),
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "longer": lambda path: path.write_bytes(path.read_bytes() + b"0"),
    "empty": lambda path: path.write_bytes(b""),
}


def each_with_a_change(files):
    """Every file, by its name, with one of the changes in turn."""
    pairs = zip(files.items(), itertools.cycle(CHANGES), strict=False)
    return [pytest.param(CHANGES[kind], path, id=f"{kind}-{name}") for (name, path), kind in pairs]


OF_ROWS = ("row", "body.mass", "body.gravity", "status", "steps", "rejected", "reached", "phi", "phidot", "z", "time")


@pytest.mark.thorough
@pytest.mark.parametrize(("change", "name"), each_with_a_change({name: name for name in OF_ROWS}))
def test_rows_whose_files_something_else_changed_are_named_and_computed_again(tmp_path, name, change):
    found = study(tmp_path, settings='chunk = 4\nsave = "times"')
    outcome = found.run(tmp_path / "s.zarr", engine=pretend)
    before = files(outcome.store)
    (path,) = [path for path in (outcome.store / name / "c" / "2").rglob("*") if path.is_file()] or [
        outcome.store / name / "c" / "2"
    ]
    change(path)
    stored = open_store(outcome.store)
    for read in (stored.describe, stored.dataset, stored.grid):
        with refuses(StoreError, path):
            read()
    told = io.StringIO()
    assert found.run(outcome.store, engine=pretend, stream=told).finished
    assert told.getvalue().startswith(f'Something has changed "{path}"; 4 rows are computed again.\n11 of 15 rows')
    assert files(outcome.store) == before


@pytest.mark.thorough
@pytest.mark.parametrize("name", OF_ROWS)
def test_numbers_that_something_else_changed_are_found_by_their_checksum(tmp_path, name):
    found = study(tmp_path, settings='chunk = 4\nsave = "times"')
    store = found.run(tmp_path / "s.zarr", engine=pretend).store
    before = files(store)
    path = next(path for path in (store / name / "c").rglob("*") if path.is_file())
    content = path.read_bytes()
    path.write_bytes(bytes([content[0] ^ 1]) + content[1:])
    for read in (open_store(store).describe, lambda: open_store(store).scenarios([0])):
        with refuses(StoreError, path):
            read()
    with pytest.raises(ValueError, match="checksum"):  # which any reader of Zarr finds
        open_store(store).dataset().load()
    assert found.run(store, engine=pretend).finished
    assert files(store) == before


def test_a_store_of_another_layout_is_refused(tmp_path):
    store = study(tmp_path, settings=SMALL).run(tmp_path / "s.zarr", engine=pretend).store
    about = json.loads((store / "zarr.json").read_text())
    about["attributes"]["layout"] = "4"
    (store / "zarr.json").write_text(json.dumps(about))
    stored = open_store(store)
    for read in (stored.describe, stored.dataset, lambda: study(tmp_path, settings=SMALL).run(store, engine=pretend)):
        with refuses(StoreError, "s.zarr"):
            read()


def test_a_figure_is_not_drawn_of_numbers_that_something_else_changed(tmp_path, capsys, command_line):
    store = study(tmp_path, settings=SMALL).run(tmp_path / "s.zarr", engine=pretend).store
    path = store / "phi" / "c" / "2"
    path.write_bytes(b"\1" + path.read_bytes()[1:])
    assert main(["sweep", "plot", str(store), "--out", str(tmp_path / "figures")]) == 2
    said(capsys.readouterr().err, path)


def test_several_files_that_something_else_changed_are_counted(tmp_path):
    found = study(tmp_path, settings=SMALL)
    outcome = found.run(tmp_path / "s.zarr", engine=pretend)
    before = files(outcome.store)
    for name, chunk in (("phi", 0), ("z", 0), ("phi", 3)):
        (outcome.store / name / "c" / str(chunk)).unlink()
    told = io.StringIO()
    assert found.run(outcome.store, engine=pretend, stream=told).finished
    assert 'phi/c/0" and 2 other files; 7 rows are computed again.\n8 of 15 rows' in told.getvalue()
    assert files(outcome.store) == before


def test_what_is_the_same_for_all_rows_is_written_again(tmp_path):
    found = study(tmp_path, settings=SMALL)
    outcome = found.run(tmp_path / "s.zarr", engine=pretend)
    before = files(outcome.store)
    (outcome.store / "axes" / "body.mass" / "c" / "0").write_bytes(b"short")
    with refuses(StoreError, "axes/body.mass/c/0"):
        open_store(outcome.store).grid()
    told = io.StringIO()
    assert found.run(outcome.store, engine=failing, stream=told).finished  # nothing is computed again
    assert told.getvalue().endswith('axes/body.mass/c/0"; it is written again.\n')
    assert files(outcome.store) == before


ONCE = {
    "the numbers of an axis, which begin with 0": "axes/time.start/c/0",
    "the labels of a dimension": "save/c/0",
    "what an array says of itself": "phi/zarr.json",
    "what a group says of itself": "axes/zarr.json",
}


@pytest.mark.thorough
@pytest.mark.parametrize(("change", "name"), each_with_a_change(ONCE))
def test_no_file_of_a_store_is_lost_in_silence(tmp_path, name, change):
    found = study(tmp_path, '[[axes]]\npath = "time.start"\nvalues = [0.0]\n', 'save = "times"')
    outcome = found.run(tmp_path / "s.zarr", engine=pretend)
    before, path, grid = files(outcome.store), outcome.store / name, open_store(outcome.store).grid().load()
    change(path)
    if path.name == "zarr.json":  # of which the store's own has a copy, by which it is read
        assert open_store(outcome.store).grid().load().identical(grid)
    else:
        with refuses(StoreError, path):
            open_store(outcome.store).grid()
    told = io.StringIO()
    assert found.run(outcome.store, engine=failing, stream=told).finished  # nothing is computed again
    assert told.getvalue().endswith(f'{path}"; it is written again.\n')
    assert files(outcome.store) == before


def test_a_store_without_metadata_of_its_arrays_is_named_and_completed(tmp_path):
    found = study(tmp_path, settings=SMALL)
    outcome = found.run(tmp_path / "s.zarr", engine=pretend)
    before, path = files(outcome.store), outcome.store / "zarr.json"
    about = json.loads(path.read_text())
    del about["consolidated_metadata"]
    path.write_text(json.dumps(about))
    with refuses(StoreError, "zarr.json"):
        open_store(outcome.store).describe()
    assert found.run(outcome.store, engine=failing).finished  # nothing is computed again
    assert files(outcome.store) == before


@pytest.mark.parametrize("name", ["phi/c/0", "axes/body.mass/c/0"])
def test_a_folder_in_the_place_of_a_file_is_left(tmp_path, name):
    found = study(tmp_path, settings=SMALL)
    path = found.run(tmp_path / "s.zarr", engine=pretend).store / name
    path.unlink()
    path.mkdir()
    (path / "precious").write_text("")
    with refuses(StoreError, path):
        found.run(tmp_path / "s.zarr", engine=pretend)
    assert (path / "precious").exists()


def test_a_file_that_changes_before_the_table_is_written_is_named(tmp_path):
    found = study(tmp_path, settings=SMALL)
    outcome = found.run(tmp_path / "s.zarr", engine=pretend)
    (outcome.store / "phi" / "c" / "2").write_bytes(b"short")
    with refuses(StoreError, "phi/c/2"):
        Store(outcome.store, found, outputs_of(found, found.template())).read("phi", 2)


def test_rows_with_another_number_of_save_times_are_named(tmp_path):
    axes = '[[axes]]\npath = "time.end"\nvalues = [2.0, 3.0]\n'
    scenario = study_scenario(tmp_path).replace("saves = 5", "step = 0.5")
    with refuses(StudyError, "time.saves"):
        study(tmp_path, axes, 'save = "times"', scenario=scenario).run(tmp_path / "s.zarr", engine=pretend)


def study_scenario(folder):
    study(folder, MASSES + GRAVITIES)
    return (folder / "disk.toml").read_text()


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"workers": 0}, "workers"),
        ({"shard": (0, 3)}, "shard"),
        ({"shard": (4, 3)}, "shard"),
    ],
)
def test_arguments(tmp_path, options, named):
    with refuses(ValueError, named):
        study(tmp_path).run(tmp_path / "s.zarr", engine=pretend, **options)


def test_a_worker_that_is_killed_is_told(tmp_path):
    class Broken:
        def submit(self, function, task):
            future = concurrent.futures.Future()
            future.set_exception(concurrent.futures.BrokenExecutor())
            return future

    with refuses(executors.WorkerError, "A worker"):
        study(tmp_path).run(tmp_path / "s.zarr", executor=Broken(), engine=run.solve_in_lanes)


def test_a_removed_store_is_made_again_beside_its_table(tmp_path, whole):
    """The same command computes what it did before; the table of another study is neither used nor replaced."""
    one, other = study(tmp_path, settings=SMALL), study(tmp_path, axes=GRAVITIES, settings=SMALL)
    store = one.run(tmp_path / "s.zarr", engine=pretend).store
    shutil.rmtree(store)
    table = (tmp_path / "s.parquet").read_bytes()
    with refuses(StoreError, "s.parquet"):
        other.run(store, engine=pretend)
    assert not store.exists()
    assert (tmp_path / "s.parquet").read_bytes() == table
    assert one.run(store, engine=pretend).finished
    assert files(store) == whole
