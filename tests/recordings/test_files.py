"""Recordings on disk: whole and exact, or not at all."""

import contextlib
import re

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidRecording


@pytest.mark.parametrize("fixture", ["circle", "tour", "touch"])
@pytest.mark.parametrize("truth", [True, False])
def test_a_recording_comes_back_as_it_was(tmp_path, request, fixture, truth):
    rec = request.getfixturevalue(fixture)
    rec = rec if truth else bk.experience(rec)
    bk.write_recording(rec, tmp_path / "rec.nc")
    again = bk.read_recording(str(tmp_path / "rec.nc"))
    assert again.identical(rec)
    for name in rec.variables:
        assert again[name].dtype.kind == rec[name].dtype.kind
        assert again[name].dtype == rec[name].dtype or rec[name].dtype.kind in "UOT"
        assert again[name].attrs == rec[name].attrs
    assert {name: type(value) for name, value in again.attrs.items()}.keys() == rec.attrs.keys()
    assert [file.name for file in tmp_path.iterdir()] == ["rec.nc"]
    bk.estimators.LeastSquares().fit(again) if fixture == "circle" else None


def test_writing_again_replaces_the_file(tmp_path, circle, tour):
    file = tmp_path / "rec.nc"
    bk.write_recording(circle, file)
    bk.write_recording(tour, file)
    assert bk.read_recording(file).identical(tour)


def test_an_interrupted_write_leaves_nothing_and_spoils_nothing(tmp_path, circle, tour, monkeypatch):
    def interrupted(self, path, **_):
        path.write_bytes(b"half")
        raise KeyboardInterrupt

    kept = tmp_path / "kept.nc"
    bk.write_recording(circle, kept)
    monkeypatch.setattr(xr.Dataset, "to_netcdf", interrupted)
    for file in (kept, tmp_path / "new.nc"):
        with pytest.raises(KeyboardInterrupt):
            bk.write_recording(tour, file)
    assert [file.name for file in tmp_path.iterdir()] == ["kept.nc"]
    assert bk.read_recording(kept).identical(circle)


def test_a_place_that_cannot_be_written_to_is_named(tmp_path, circle):
    with pytest.raises(InvalidRecording, match=r"cannot write recording .*missing"):
        bk.write_recording(circle, tmp_path / "missing" / "rec.nc")
    with pytest.raises(InvalidRecording, match="has no variable 'q'"):
        bk.write_recording(circle.drop_vars("q"), tmp_path / "rec.nc")
    assert not list(tmp_path.iterdir())


def test_files_that_are_no_recordings_are_refused(tmp_path, circle):
    with pytest.raises(InvalidRecording, match="there is no recording at"):
        bk.read_recording(tmp_path / "missing.nc")
    with pytest.raises(InvalidRecording, match="there is no recording at"):
        bk.read_recording(tmp_path)
    (tmp_path / "text.nc").write_text("not a recording")
    with pytest.raises(InvalidRecording, match="is no NetCDF recording"):
        bk.read_recording(tmp_path / "text.nc")
    (tmp_path / "empty.nc").touch()
    with pytest.raises(InvalidRecording, match="is no NetCDF recording"):
        bk.read_recording(tmp_path / "empty.nc")
    bk.write_recording(circle, tmp_path / "whole.nc")
    data = (tmp_path / "whole.nc").read_bytes()
    (tmp_path / "cut.nc").write_bytes(data[: len(data) // 2])
    with pytest.raises(InvalidRecording, match="is no NetCDF recording"):
        bk.read_recording(tmp_path / "cut.nc")
    xr.Dataset({"x": ("time", np.zeros(3))}).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    with pytest.raises(InvalidRecording, match="has no variable 'q'"):
        bk.read_recording(tmp_path / "other.nc")


# Attributes -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "value",
    [
        True, False, None, {"a": 1}, {}, ["x"], [1], [1.5], [], ["a", "b"], [1, 2], [[1.0], None], "a\0b", "", "json:1",
        "json:{", "caf\u00e9", "\ud800", 3, -1.5, float("inf"), 2**70, {"deep": [{"b": None}, True]},
    ],
)  # fmt: skip
def test_any_attribute_comes_back_the_same(tmp_path, circle, value):
    rec = circle.assign_attrs(mine=value)
    rec.q.attrs["mine"] = value
    rec.time.attrs["mine"] = value
    bk.write_recording(rec, tmp_path / "rec.nc")
    again = bk.read_recording(tmp_path / "rec.nc")
    for found in (again.attrs["mine"], again.q.attrs["mine"], again.time.attrs["mine"]):
        assert type(found) is type(value)
        assert found == value
    assert rec.attrs["mine"] is value
    del rec.q.attrs["mine"], rec.time.attrs["mine"]


def test_arrays_and_numbers_of_numpy_come_back_as_plain_values(tmp_path, circle):
    given = {"one": np.float64(2.5), "two": np.int32(3), "yes": np.bool_(True), "list": np.array([1.5]), "pair": (1, 2)}
    bk.write_recording(circle.assign_attrs(given, row=np.array([1.5, 2.5])), tmp_path / "rec.nc")
    found = bk.read_recording(tmp_path / "rec.nc").attrs
    assert {name: found[name] for name in given} == {"one": 2.5, "two": 3, "yes": True, "list": [1.5], "pair": [1, 2]}
    np.testing.assert_array_equal(found["row"], [1.5, 2.5])


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("mine", {1, 2}, "attribute 'mine' is set; give text, numbers, lists or tables"),
        ("mine", {"a": 1j}, "attribute 'mine' is dict"),
        ("mine", {1: 2}, "attribute 'mine' is dict"),
        ("mine", "x" * 100_000, "attribute 'mine' has more than 60000 bytes"),
        (3, "x", "no file can hold an attribute named 3"),
        ("_FillValue", 1.0, "no file can hold an attribute named '_FillValue'"),
        ("CLASS", "x", "no file can hold an attribute named 'CLASS'"),
        ("a\0b", "x", "no file can hold an attribute named"),
        ("", "x", "no file can hold an attribute named ''"),
    ],
)
def test_an_attribute_that_no_file_can_hold_is_named(tmp_path, circle, name, value, message):
    with pytest.raises(InvalidRecording, match=re.escape(message)):
        bk.write_recording(circle.assign_attrs({name: value}), tmp_path / "rec.nc")
    assert not list(tmp_path.iterdir())


# What is in a file ----------------------------------------------------------------------------------------------------


def test_what_no_recording_has_is_neither_written_nor_loaded(tmp_path, circle):
    with pytest.raises(InvalidRecording, match="a recording has no variable 'mine'; write it without"):
        bk.write_recording(circle.assign(mine=circle.q * 2), tmp_path / "rec.nc")
    spoilt = circle.assign(mine=("other", np.zeros(10))).assign_coords(place=("time", np.zeros(circle.sizes["time"])))
    spoilt.to_netcdf(tmp_path / "rec.nc", engine="h5netcdf")
    again = bk.read_recording(tmp_path / "rec.nc")
    assert set(again.variables) == set(circle.variables)
    assert set(again.dims) == set(circle.dims)
    assert again.q.identical(circle.q)


@pytest.mark.parametrize("dtype", ["float32", "float16", "int16"])
def test_a_file_of_other_numbers_is_read_as_the_schema_has_them(tmp_path, circle, dtype):
    other = circle.assign(q=(circle.q * 10).round().astype(dtype), touched=circle.touched.astype("int8"))
    other.to_netcdf(tmp_path / "rec.nc", engine="h5netcdf")
    again = bk.read_recording(tmp_path / "rec.nc")
    assert (again.q.dtype, again.touched.dtype) == (np.float64, np.int64)
    np.testing.assert_array_equal(again.q, (circle.q * 10).round())
    # What was read is written as it is now, not as the file had it.
    again.q.values[:] = circle.q.values
    bk.write_recording(again, tmp_path / "rec.nc")
    np.testing.assert_array_equal(bk.read_recording(tmp_path / "rec.nc").q, circle.q)


def test_a_scattered_file_without_blocks_is_read_in_contiguous_fifths(tmp_path, circle):
    bk.write_recording(circle.assign_attrs(order="scattered"), tmp_path / "rec.nc")
    block = bk.read_recording(tmp_path / "rec.nc").block.values[0]
    assert (np.diff(block) >= 0).all()
    assert np.bincount(block).tolist() == [len(part) for part in np.array_split(block, 5)]


def test_text_where_numbers_are_meant_is_refused(tmp_path, circle):
    circle.assign(q=circle.q.astype(str)).to_netcdf(tmp_path / "rec.nc", engine="h5netcdf")
    with pytest.raises(InvalidRecording, match="variable 'q'"):
        bk.read_recording(tmp_path / "rec.nc")


@pytest.mark.parametrize("chunks", [None, (1, 1000, 5)])
def test_a_tiny_file_that_unpacks_to_gigabytes_is_refused_before_it_is_read(tmp_path, chunks, monkeypatch):
    file = tmp_path / "bomb.nc"
    with h5py.File(file, "w") as bomb:
        shape = (1, 200_000_000, 5)
        bomb.create_dataset("q", shape, "f4", chunks=chunks, compression=chunks and "gzip", fillvalue=1.0)
        bomb.create_dataset("hand_image", (1, 1, 2), "f8")
    assert file.stat().st_size < 100_000
    monkeypatch.setattr(xr, "open_dataset", lambda *_, **__: pytest.fail("it was read"))
    with pytest.raises(
        InvalidRecording, match=r"claims to hold more than 1024 MiB \(variable 'q': 1 x 200000000 x 5\)"
    ):
        bk.read_recording(file)


def test_a_chunk_larger_than_what_it_holds_is_bounded_too(tmp_path):
    file = tmp_path / "chunk.nc"
    with h5py.File(file, "w") as bomb:
        bomb.create_dataset("q", (1, 2, 5), "f8", maxshape=(None, None, 5), chunks=(1, 40_000_000, 5))
    with pytest.raises(InvalidRecording, match="claims to hold more"):
        bk.read_recording(file)


def test_what_a_file_does_not_hold_itself_is_refused(tmp_path, circle):
    for name, link in {"q": h5py.ExternalLink("other.nc", "/q"), "mine": h5py.SoftLink("/hand_image")}.items():
        file = tmp_path / f"{name}.nc"
        bk.write_recording(circle, file)
        with h5py.File(file, "a") as changed:
            if name in changed:
                del changed[name]
            changed[name] = link
        with pytest.raises(InvalidRecording, match=f"'{name}' points elsewhere"):
            bk.read_recording(file)
    (tmp_path / "raw").write_bytes(bytes(80))
    with h5py.File(tmp_path / "raw.nc", "w") as changed:
        changed.create_dataset("q", (1, 2, 5), "f8", external=[(str(tmp_path / "raw"), 0, 80)])
    with pytest.raises(InvalidRecording, match="'q' is kept in other files"):
        bk.read_recording(tmp_path / "raw.nc")
    with h5py.File(tmp_path / "group.nc", "w") as changed:
        changed.create_group("q")
    with pytest.raises(InvalidRecording, match="'q' is no variable"):
        bk.read_recording(tmp_path / "group.nc")


@given(st.binary(max_size=300), st.integers(0, 2**31))
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_damaged_file_is_a_typed_error_or_a_recording(tmp_path, circle, noise, seed):
    file = tmp_path / "rec.nc"
    if not (tmp_path / "whole.nc").exists():
        bk.write_recording(circle, tmp_path / "whole.nc")
    data = bytearray((tmp_path / "whole.nc").read_bytes())
    start = seed % len(data)
    data[start : start + len(noise)] = noise
    file.write_bytes(bytes(data))
    with contextlib.suppress(InvalidRecording):
        bk.read_recording(file)
