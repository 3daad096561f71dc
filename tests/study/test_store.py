"""The store knows its own: what is damaged or of something else is set aside, computed again, and stops nothing."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin.cli import study as commands
from bodyimage_kin.cli.status import status_command
from bodyimage_kin.errors import OutputRefused
from bodyimage_kin.recordings.motions import Circle, RandomTouch
from bodyimage_kin.study import Simulation, Study, read_study, recording_of
from bodyimage_kin.study.kept import SetAside
from bodyimage_kin.study.parts import Part, parts_in
from bodyimage_kin.study.results import MISSING
from bodyimage_kin.study.store import fingerprint, said

STILL = Simulation(Circle(turns=0.5), RandomTouch(duration=4.0), dynamics=False)


def small(**changes):
    asked = {"estimators": {"flat": "LeastSquares", "paper": {"PaperMLP": {"steps": 5}}}, "seeds": 4, "block": 2}
    return Study("infant", {"still": STILL}, probes=["on_face"], **asked | changes)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    store = tmp_path_factory.mktemp("store") / "run"
    return small(), small().run(store, "in-process"), store


@pytest.fixture
def copy(done, tmp_path):
    return Path(shutil.copytree(done[2], tmp_path / "copy"))


def same(found, wanted):
    xr.testing.assert_identical(found.drop_vars("fit_seconds"), wanted.drop_vars("fit_seconds"))


def cell(store, row="flat", block=0):
    """The file of a cell; small cells may share it."""
    for path in sorted(Path(store).glob("cells/infant/still/*.parts")):
        for part in parts_in(path):
            if (part.identity["estimator"], part.identity["block"]) == (row, block):
                return path
    raise AssertionError(f"no {row}, block {block}")


def test_a_part_is_read_as_it_was_written(tmp_path):
    arrays = {
        "f": np.array([[1.5, np.nan], [-0.0, 1e-308]]),
        "i": np.arange(3),
        "b": np.array([True, False]),
        "u": np.arange(2, dtype=np.uint8),
        "f4": np.float32([1.1]),
        "t": np.array(["", "é\n\0"]),
        "none": np.empty((2, 0)),
        "turned": np.arange(6.0).reshape(2, 3).T,
    }
    part = Part({"a": 1}, arrays, {"said": ["é", None, 1.5]})
    (tmp_path / "x.parts").write_bytes(part.pack() + Part({"b": 2}).pack())
    found, other = parts_in(tmp_path / "x.parts")
    assert (found.identity, other.identity) == ({"a": 1}, {"b": 2})
    assert found.pack() + other.pack() == (tmp_path / "x.parts").read_bytes()
    assert found.notes == part.notes
    assert list(found.arrays) == list(arrays)
    for name, values in arrays.items():
        assert found.arrays[name].dtype == values.dtype or name == "t", name
        np.testing.assert_array_equal(found.arrays[name], values)


def test_a_recording_comes_back_the_same(done):
    seen = recording_of(done[2], "still", 3)
    again = bk.simulate(
        bk.load_embodiment("infant"), Circle(turns=0.5), json.loads(seen.attrs["config"])["seed"], dynamics=False
    )
    xr.testing.assert_identical(seen, again)
    assert fingerprint(seen) == fingerprint(again)
    assert fingerprint(seen.assign_attrs(x=1)) != fingerprint(seen)
    assert fingerprint(seen.assign(q=seen["q"] + 1e-12)) != fingerprint(seen)


FOREIGN = {
    "of another study's row": lambda store: Part({"estimator": "other", "block": 0}).pack(),
    "of no row at all": lambda store: Part({"estimator": [], "block": {}}).pack(),
    "recordings": lambda store: (store / "recordings/infant/still/block0.parts").read_bytes(),
    "results": None,
    "of nothing": lambda store: b"",
    "text": lambda store: b"not a part\n",
    "cut": lambda store: cell(store).read_bytes()[:-20],
    "longer": lambda store: cell(store).read_bytes() + b"more",
    "of another version": lambda store: cell(store).read_bytes().replace(b"part 2", b"part 1"),
    "without scores": lambda store: Part(next(parts_in(cell(store))).identity).pack(),
}


@pytest.mark.parametrize("what", FOREIGN)
def test_a_file_of_something_else_is_set_aside_and_computed_again(what, done, copy):
    study, results, _ = done
    path = cell(copy)
    if FOREIGN[what] is None:
        results.drop_attrs().to_netcdf(path, engine="h5netcdf")
    else:
        path.write_bytes(FOREIGN[what](copy))
    with pytest.warns(SetAside, match="computed again"):
        found = study.run(copy, "in-process")
    same(found, results)
    assert path.with_name(f"{path.name}.damaged").exists()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        same(read_study(copy), results)


def test_a_cell_under_the_name_of_another_is_still_what_it_says(done, copy):
    study, results, _ = done
    shutil.copy(cell(copy, "paper"), cell(copy))
    assert (read_study(copy)["failure"].sel(estimator="flat") == MISSING).sum() == 2
    same(study.run(copy, "in-process"), results)


def test_a_cell_of_another_config_or_seed_is_another_cell(done, copy, tmp_path):
    study, results, _ = done
    other = small(seeds=[7, 8, 2, 3]).run(tmp_path / "other", "in-process")
    assert not np.array_equal(other["relative_error"].isel(seed=0), results["relative_error"].isel(seed=0))
    shutil.copy(cell(tmp_path / "other"), cell(copy))
    with pytest.warns(SetAside, match="seeds"):
        same(study.run(copy, "in-process"), results)
    small(excitation_cut=0.2).run(tmp_path / "cut", "in-process")
    shutil.copy(cell(tmp_path / "cut"), cell(copy))
    with pytest.warns(SetAside, match="config"):
        same(study.run(copy, "in-process"), results)


def test_what_is_sound_in_a_damaged_file_is_kept(done, copy):
    study, results, _ = done
    paths = list(copy.glob("cells/infant/still/*.parts"))
    together = b"".join(path.read_bytes() for path in paths)
    for path in paths:
        path.unlink()
    shared = paths[0].with_name("shared.parts")
    shared.write_bytes(together)
    same(read_study(copy), results)
    second = together.index(b"bodyimage_kin part", 1)
    data = bytearray(together)
    data[second + 200] ^= 1
    shared.write_bytes(bytes(data))
    with pytest.warns(SetAside, match="checksum is wrong; it counts as missing"):
        found = read_study(copy)
    assert (found["failure"] == MISSING).sum() == 2
    assert shared.read_bytes() == bytes(data)
    begun = []
    with pytest.warns(SetAside, match="checksum is wrong; it is set aside"):
        same(study.run(copy, "in-process", progress=lambda done, total: begun.append(total)), results)
    assert max(begun) == 2  # the recordings, which are there, and one cell
    assert shared.with_name("shared.parts.damaged").read_bytes() == bytes(data)


@pytest.mark.parametrize("which", ["recordings", "facts"])
def test_damaged_recordings_are_made_again_for_the_rows_that_need_them(which, done, copy):
    study, results, _ = done
    path = copy / "recordings/infant/still/block0.parts"
    data = bytearray(path.read_bytes())
    data[-100 if which == "recordings" else 300] ^= 1
    path.write_bytes(bytes(data))
    cell(copy, "paper").unlink()
    with pytest.warns(SetAside, match="checksum"):
        same(study.run(copy, "in-process"), results)


@pytest.mark.slow
def test_no_flipped_bit_hangs_a_reader_or_changes_a_score(done, copy):
    _, results, _ = done
    path, rng = cell(copy), np.random.default_rng(0)
    sound = path.read_bytes()
    for _ in range(150):
        data = bytearray(sound)
        data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        path.write_bytes(bytes(data))
        begin = time.monotonic()
        with pytest.warns(SetAside):
            found = read_study(copy)
        assert time.monotonic() - begin < 2.0
        gone = (found["failure"] == MISSING).squeeze().sel(estimator="flat")
        assert gone.values.tolist() == [True, True, False, False]
        same(found.sel(seed=[2, 3]).drop_attrs(), results.sel(seed=[2, 3]).drop_attrs())


def test_a_read_only_store_is_read_and_nothing_is_written(done, copy, tmp_path, capsys):
    cell(copy).write_bytes(b"x")
    before = {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in copy.rglob("*") if path.is_file()}
    for path in (*copy.rglob("*"), copy):
        path.chmod(0o555 if path.is_dir() else 0o444)
    try:
        # Root writes everywhere: what is renamed or made shows itself below.
        with pytest.warns(SetAside):
            assert status_command(copy) == 0
        assert "infant/still/flat: 2 of 4 done, 2 to do" in capsys.readouterr().out
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SetAside)
            commands.report_command(copy, into=tmp_path / "page")
    finally:
        for path in (copy, *copy.rglob("*")):
            path.chmod(0o755 if path.is_dir() else 0o644)
    assert (tmp_path / "page/report.html").exists()
    after = {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in copy.rglob("*") if path.is_file()}
    assert after == before


def test_a_folder_that_is_deleted_under_a_run_ends_it(tmp_path):
    store = tmp_path / "run"

    def delete(done, total):
        if done == 1 and store.exists():
            shutil.rmtree(store)

    with pytest.raises(OutputRefused, match="the folder was deleted"):
        small().run(store, "in-process", progress=delete)
    assert not store.exists()


def test_a_full_disk_is_one_line_and_what_is_there_is_whole(done, tmp_path, monkeypatch):
    from bodyimage_kin import _files

    real, written = os.fsync, []

    def full(descriptor):
        written.append(descriptor)
        if len(written) > 4:
            raise OSError(28, "No space left on device")
        real(descriptor)

    monkeypatch.setattr(_files.os, "fsync", full)
    with pytest.raises(OutputRefused, match="No space left on device; what is finished is kept"):
        small().run(tmp_path, "in-process")
    monkeypatch.undo()
    assert not list(tmp_path.rglob("*.tmp"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        same(small().run(tmp_path, "in-process"), done[1])


def test_labels_change_what_names_are_called_and_nothing_else(done, copy, tmp_path):
    study, results, _ = done
    begun = []
    found = replace(study, labels={"flat": "One matrix & no more"}).run(
        copy, "in-process", progress=lambda done, total: begun.append(total)
    )
    assert max(begun) == 0
    same(found.drop_attrs(), results.drop_attrs())
    assert json.loads(read_study(copy).attrs["config"])["labels"] == {"flat": "One matrix & no more"}
    assert "One matrix &amp; no more" in bk.report.write(found, tmp_path / "page.html").read_text()
    study.run(copy, "in-process")
    assert "labels" not in json.loads(read_study(copy).attrs["config"])


LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
from bodyimage_kin.cli import main
sys.exit(main(["study", {file!r}, "--out", {out!r}, "--workers", "1"]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="files are limited as on a full disk, which Windows cannot")
def test_workers_that_cannot_write_end_the_command_in_one_line(done, tmp_path):
    done[0].to_toml(tmp_path / "study.toml")
    script = LIMITED.format(file=str(tmp_path / "study.toml"), out=str(tmp_path / "out"))
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert found.returncode == 2, found.stderr
    assert found.stderr.splitlines()[-1].startswith("bodyimage-kin: cannot write '")
    assert found.stderr.endswith("File too large; what is finished is kept, run the study again\n")
    assert "Traceback" not in found.stderr
    assert not list((tmp_path / "out").rglob("*.tmp"))
    same(done[0].run(tmp_path / "out", "in-process"), done[1])


def test_what_a_killed_writer_leaves_is_swept_by_the_next_run(done, copy):
    old, new = (copy / f"cells/infant/still/.flat.block{number}.parts.tmp" for number in (0, 1))
    for path in (old, new):
        path.write_bytes(b"half")
    os.utime(old, (time.time() - 60,) * 2)
    done[0].run(copy, "in-process")
    assert not old.exists()
    assert new.exists()  # perhaps another driver is at it


def test_an_errors_words_never_break_a_store():
    class Odd(Exception):
        def __str__(self):
            raise RuntimeError

    for problem, wanted in (
        (ValueError("a\0b\nc"), "ValueError: ab c"),
        (ValueError("\ud800x"), "ValueError: \\ud800x"),
        (KeyError("a"), "KeyError: 'a'"),
        (ValueError(), "ValueError"),
        (Odd(), "Odd"),
    ):
        assert said(problem) == wanted
    assert len(said(ValueError("é" * 5_000_000))) < 2100
    json.dumps(said(ValueError("\udfff"))).encode()


SCRIPT = """
import sys, bodyimage_kin as bk
sys.path.insert(0, {tests!r})
bk.Study.from_toml({file!r}).run({out!r}, workers=2)
"""


@pytest.mark.slow
def test_a_driver_killed_at_any_moment_is_resumed_to_the_bit(done, tmp_path):
    study = small(seeds=12)
    study.to_toml(tmp_path / "study.toml")
    wanted = study.run(tmp_path / "whole", "in-process")
    script = SCRIPT.format(
        tests=str(Path(__file__).parents[1]), file=str(tmp_path / "study.toml"), out=str(tmp_path / "out")
    )
    rng, finished = np.random.default_rng(1), 0
    for _ in range(20):
        process = subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.DEVNULL)
        try:
            process.wait(float(rng.uniform(2.0, 14.0)))
            finished += 1
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    found = study.run(tmp_path / "out", "in-process")
    same(found, wanted)
    assert replace(study, seeds=3).seeds == (0, 1, 2)
