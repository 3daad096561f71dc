"""Recordings on disk: whole and exact, or not at all."""

import numpy as np
import pytest
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.recordings import check, schema


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


def test_what_is_missing_or_misshapen_is_named(circle):
    for name in schema.FELT:
        with pytest.raises(InvalidRecording, match=f"no variable '{name}'"):
            check(circle.drop_vars(name))
    with pytest.raises(InvalidRecording, match="'q' has dimensions"):
        check(circle.assign(q=circle.q.transpose("time", "trial", "joint")))
    with pytest.raises(InvalidRecording, match="no samples"):
        check(circle.isel(time=slice(0, 0)))
    with pytest.raises(InvalidRecording, match="an experience has no truth"):
        check(bk.experience(circle), truth=True)
