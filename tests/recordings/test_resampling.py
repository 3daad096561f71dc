"""Streams on a clock of their own: what lies between samples is on a line, and nothing is made up across a pause."""

from __future__ import annotations

import numpy as np
import pytest

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig, InvalidRecording
from bodyimage_kin.recordings import resample

TIME = np.array([0.0, 0.1, 0.25, 0.3, 0.4, 1.5, 1.6])


def stream(**changes):
    q = np.stack([2.0 * TIME, 1.0 - TIME], axis=1)
    image = np.stack([10.0 * TIME, -5.0 * TIME], axis=1)
    image[3] = np.nan
    given = {
        "q": q, "hand_image": image, "joints": ["elbow", "wrist"], "unit": "px", "time": TIME,
        "touched": [3, -1, 4, 4, 5, 6, 6], "at_reference": TIME == 0.0, "block": np.arange(7) // 4,
    }  # fmt: skip
    return bk.recording(**(given | changes))


def test_values_lie_on_the_lines_between_samples():
    found = resample(stream(), 0.05)
    t = found["time"].values
    np.testing.assert_allclose(t, 0.05 * np.arange(33), atol=1e-12)
    assert found.attrs["sampling"] == 0.05
    assert found["q"].attrs == {"units": "rad"}
    near = (t <= 0.4 + 1e-9) | (t >= 1.5 - 1e-9)
    np.testing.assert_allclose(found["q"].values[0, near], np.stack([2 * t, 1 - t], axis=1)[near], atol=1e-9)
    # Across the pause of 1.1 s nothing is known, nor beside the sample in which the hand was unseen.
    assert np.isnan(found["q"].values[0, ~near]).all()
    seen = np.isfinite(found["hand_image"].values[0]).all(-1)
    np.testing.assert_array_equal(seen, near & ~((t > 0.25 + 1e-9) & (t < 0.4 - 1e-9)))
    np.testing.assert_allclose(found["hand_image"].values[0, seen, 0], 10 * t[seen], atol=1e-9)


def test_touches_and_marks_are_those_of_the_last_sample():
    found = resample(stream(), 0.05)
    touched = found["touched"].values[0, :, 0]
    assert touched[:10].tolist() == [3, 3, -1, -1, -1, 4, 4, 4, 5, -1]
    assert touched[-3:].tolist() == [6, 6, 6]
    assert (touched[9:30] == -1).all()
    assert found["at_reference"].values[0, :3].tolist() == [True, True, False]
    assert found["block"].values[0, :9].tolist() == [0] * 8 + [1]
    assert (found["block"].values[0, 9:30] == -1).all()


def test_a_longer_pause_is_bridged_on_request_alone():
    found = resample(stream(), 0.05, largest_gap=2.0)
    assert np.isfinite(found["q"].values).all()
    np.testing.assert_allclose(found["q"].values[0, :, 0], 2 * found["time"].values, atol=1e-9)


def test_samples_that_are_on_the_clock_keep_their_bits():
    even = stream(time=0.1 * np.arange(7))
    found = resample(even, 0.1)
    np.testing.assert_array_equal(found["q"], even["q"])
    np.testing.assert_array_equal(found["touched"], even["touched"])


def test_what_has_no_time_is_refused():
    with pytest.raises(InvalidRecording, match="scattered recording has no order"):
        resample(stream(time=None, order="scattered"), 0.1)
    with pytest.raises(InvalidRecording, match="does not say its times in seconds"):
        resample(stream(time=None), 0.1)
    with pytest.raises(InvalidConfig, match="sampling=0"):
        resample(stream(), 0.0)
    with pytest.raises(InvalidRecording, match="makes 16,000,001 samples of 7"):
        resample(stream(), 1e-7)


def test_a_table_is_resampled_trial_by_trial(tmp_path):
    rows = ["t,run,a,b,u,v"]
    for run, begin in ((1, 0.0), (2, 50.0)):
        for t in TIME[:5] * (1 + 0.1 * run):
            rows.append(f"{begin + t},{run},{2 * t},{1 - t},{10 * t},{-5 * t}")
    (tmp_path / "table.csv").write_text("\n".join(rows))
    columns = {"q": ["a", "b"], "hand_image": ["u", "v"], "time": "t", "trial": "run"}
    uneven = bk.read_recording(tmp_path / "table.csv", columns)
    assert "sampling" not in uneven.attrs
    found = bk.read_recording(tmp_path / "table.csv", columns, sampling=0.05)
    assert found.attrs["sampling"] == 0.05
    assert found.sizes["trial"] == 2
    assert np.isfinite(found["q"].values[..., 0]).sum(1).tolist() == [9, 10]
    t = 0.05 * np.arange(10)
    np.testing.assert_allclose(found["q"].values[1, :, 0], 2 * t, atol=1e-9)
    np.testing.assert_allclose(found["hand_image"].values[0, :9, 0], 10 * t[:9], atol=1e-9)
    with pytest.raises(InvalidConfig, match="no column of time"):
        bk.read_recording(tmp_path / "table.csv", {k: v for k, v in columns.items() if k != "time"}, order="stream",
                          sampling=0.05)  # fmt: skip


def test_trials_of_equal_steps_say_their_sampling(tmp_path):
    rows = ["t,run,a,u,v"] + [f"{t},{run},{t * run},{t},{t}" for run in (1, 2) for t in np.round(0.1 * np.arange(5), 3)]
    (tmp_path / "table.csv").write_text("\n".join(rows))
    found = bk.read_recording(
        tmp_path / "table.csv", {"q": ["a"], "hand_image": ["u", "v"], "time": "t", "trial": "run"}
    )
    assert found.attrs["sampling"] == pytest.approx(0.1)
