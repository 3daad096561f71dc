"""Recordings from arrays, lists and data frames: what fits becomes the schema, what does not is named."""

import re

import numpy as np
import pandas as pd
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidRecording, UnknownName
from bodyimage_kin.recordings import check, first_taxel

JOINTS = ["shoulder", "elbow"]
Q = np.linspace(0.0, 1.0, 24).reshape(12, 2)
IMAGE = np.stack([100.0 + 50.0 * Q.sum(1), 80.0 * np.cos(Q[:, 0])], axis=1)


def make(q=Q, hand_image=IMAGE, **settings):
    return bk.recording(**{"q": q, "hand_image": hand_image, "joints": JOINTS, "unit": "px", **settings})


# What fits ------------------------------------------------------------------------------------------------------------


def test_arrays_become_a_stream_that_is_learned_from(tmp_path):
    recording = make(sampling=0.1, encoder_noise=1e-3, origin="bench")
    assert recording.q.dims == ("trial", "time", "joint")
    np.testing.assert_array_equal(recording.q[0], Q)
    np.testing.assert_array_equal(recording.hand_image[0], IMAGE)
    assert recording.joint.values.tolist() == JOINTS
    assert recording.axis.values.tolist() == ["x", "y"]
    assert recording.hand_image.attrs == {"units": "px"}
    assert recording.q.attrs == {"units": "rad"}
    np.testing.assert_allclose(recording.time, 0.1 * np.arange(12))
    wanted = {"order": "stream", "sampling": 0.1, "encoder_noise": 1e-3, "origin": "bench"}
    assert wanted.items() <= recording.attrs.items()
    assert "block" not in recording
    assert check(recording) is recording
    bk.write_recording(recording, tmp_path / "mine.nc")
    assert bk.read_recording(tmp_path / "mine.nc").identical(recording)
    with pytest.warns(bk.errors.DataWarning, match="hardly move along"):
        assert bk.estimators.LeastSquares().fit(bk.experience(recording)).m == 2


@pytest.mark.parametrize("kind", ["list", "whole", "tensor", "float32", "frame", "columns"])
def test_whatever_they_come_in_the_recording_is_the_same(kind):
    q, image = np.arange(24.0).reshape(12, 2), 3.0 * np.arange(24.0).reshape(12, 2)
    wanted = make(q, image)
    settings = {}
    given = {
        "list": lambda a: a.tolist(),
        "whole": lambda a: a.astype(int),
        "tensor": torch.from_numpy,
        "float32": lambda a: a.astype(np.float32),
        "frame": lambda a: pd.DataFrame(a, columns=JOINTS if a is q else ["x", "y"]),
        "columns": lambda a: pd.DataFrame(a[:, ::-1], columns=JOINTS[::-1] if a is q else ["y", "x"])[
            JOINTS if a is q else ["x", "y"]
        ],
    }[kind]
    if kind in ("frame", "columns"):
        settings["joints"] = None
    assert make(given(q), given(image), **settings).identical(wanted)


def test_a_frame_names_joints_and_axes():
    frame = pd.DataFrame(np.hstack([Q, IMAGE]), columns=["elbow", "shoulder", "u", "v"])
    found = bk.recording(frame[["elbow", "shoulder"]], frame[["u", "v"]], unit="px", joints=["shoulder", "elbow"])
    assert found.joint.values.tolist() == ["shoulder", "elbow"]
    np.testing.assert_array_equal(found.q[0], Q[:, ::-1])
    assert found.axis.values.tolist() == ["u", "v"]
    with pytest.raises(UnknownName, match="no column of q 'elbw'; did you mean 'elbow'"):
        bk.recording(frame[["elbow"]], frame[["u", "v"]], unit="px", joints=["elbw"])


def test_trials_of_unlike_length_are_padded():
    given = {
        "q": [Q, Q[:5]],
        "hand_image": [IMAGE, IMAGE[:5]],
        "touched": [[[1, 2]] * 12, [3, None, [], -1, [4]]],
        "at_reference": [np.arange(12) == 0, np.arange(5) == 0],
        "repeat": [np.arange(12), np.arange(5)],
        "hand_offset": [0.0, 0.1, 0.2],
    }
    recording = make(**given, sampling=0.5)
    assert recording.sizes["trial"] == 2
    assert np.isnan(recording.q.values[1, 5:]).all()
    assert np.isnan(recording.hand_offset.values[1, 5:]).all()
    assert recording.hand_offset.values[1, 4].tolist() == [0.0, 0.1, 0.2]
    assert recording.touched.values[0, 0].tolist() == [1, 2]
    assert first_taxel(recording)[1].tolist() == [3, -1, -1, -1, 4, *[-1] * 7]
    assert recording.repeat.values[1, 5:].tolist() == [-1] * 7
    assert not recording.at_reference.values[1, 5:].any()
    assert make(np.stack([Q, Q]), np.stack([IMAGE, IMAGE])).sizes["trial"] == 2


def test_touches_may_be_one_or_several_with_an_intensity():
    one = make(hand_image=None, unit=None, touched=np.arange(12))
    assert one.touched.shape == (1, 12, 1)
    assert "hand_image" not in one
    assert "axis" not in one.dims
    several = make(touched=[[5], [6, 7, 8]] * 6, intensity=[[0.5], [1.0, 2.0, 3.0]] * 6)
    assert several.touched.values[0, :2].tolist() == [[5, -1, -1], [6, 7, 8]]
    np.testing.assert_array_equal(several.intensity.values[0, 0], [0.5, np.nan, np.nan])
    series = make(touched=pd.Series([[5], [6, 7, 8]] * 6))
    assert series.touched.identical(several.touched)


def test_a_scattered_recording_is_one_trial_in_contiguous_fifths():
    recording = make(order="scattered")
    assert recording.attrs["order"] == "scattered"
    assert recording.block.values[0].tolist() == [0, 0, 0, 1, 1, 2, 2, 2, 3, 3, 4, 4]
    assert recording.time.values.tolist() == list(range(12))
    assert recording.time.attrs == {}
    given = make(order="scattered", block=np.arange(12) % 3)
    assert given.block.values[0].tolist() == [0, 1, 2] * 4
    assert make(Q[:2], IMAGE[:2], order="scattered").block.values[0].tolist() == [0, 1]


def test_a_tracker_alone_and_a_simulators_truth():
    place = np.hstack([Q, Q[:, :1]])
    recording = bk.recording(Q, hand_position=place, joints=JOINTS, true_q=Q + 0.1, true_touched=np.arange(12))
    assert recording.hand_position.attrs == {"units": "m"}
    assert recording.space.values.tolist() == ["x", "y", "z"]
    assert recording.true_q.attrs == {"units": "rad"}
    assert set(bk.experience(recording).data_vars) == {"q", "hand_position"}


def test_dates_become_seconds():
    dates = pd.date_range("2024-05-01", periods=12, freq="250ms")
    np.testing.assert_allclose(make(time=dates).time, 0.25 * np.arange(12))
    np.testing.assert_allclose(make(time=dates - dates[0]).time, 0.25 * np.arange(12))
    assert make(time=np.arange(12) * 0.2).time.attrs == {"units": "s"}
    assert make().time.attrs == {}


def test_a_prismatic_joint_moves_in_metres():
    assert make(joint_units="m").q.attrs == {"units": "m"}
    assert make(joint_units=["rad", "m"]).q.attrs == {"units": "rad m"}


# What does not --------------------------------------------------------------------------------------------------------

HOLE = Q.copy()
HOLE[3, 1] = np.nan


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"hand_image": None}, "nothing is observed beside q; give one of hand_image, touched, hand_position"),
        ({"hand_image": IMAGE[:9]}, "hand_image has 9 rows, q has 12; give one a posture"),
        ({"hand_image": IMAGE[:, 0]}, "hand_image has shape (12,); give a row a sample"),
        ({"hand_image": IMAGE.astype(str)}, "hand_image holds <U"),
        ({"hand_image": IMAGE > 0}, "hand_image holds bool"),
        ({"hand_image": np.full((12, 2), np.inf)}, "'hand_image' is infinite"),
        ({"unit": None}, "unit: say what the hand image is in"),
        ({"unit": 3}, "unit=3"),
        ({"axes": ["u"]}, "axes: ['u'] do not name the 2 coordinates"),
        ({"joints": None}, "joints: name the joints of q"),
        ({"joints": ["shoulder"]}, "q has 2 columns, but there are 1 of joints"),
        ({"joints": ["elbow", "elbow"]}, "joint 'elbow' is there 2 times"),
        ({"joints": "ab"}, "joints: 'ab' are no names"),
        ({"joints": [1, 2]}, "joints: [1, 2] are no names"),
        ({"q": Q[:, 0]}, "q has shape (12,)"),
        ({"q": Q[:0]}, "q has no rows"),
        ({"q": "mine"}, "q holds <U4, not numbers"),
        ({"q": [Q, Q]}, "hand_image has 12 trials, q has 2"),
        ({"q": [Q, Q], "hand_image": [IMAGE, IMAGE[:3]]}, "hand_image has 3 rows in trial 1, q has 12"),
        ({"order": "random"}, "order='random': give one of 'stream', 'scattered'"),
        ({"order": "scattered", "sampling": 0.1}, "a scattered recording has no time"),
        ({"order": "scattered", "q": HOLE}, "q is not finite in row 3"),
        ({"order": "scattered", "q": [Q, Q], "hand_image": [IMAGE, IMAGE]}, "a scattered recording is one trial"),
        ({"sampling": 0.0}, "sampling=0.0: give a number above 0"),
        ({"sampling": 0.1, "time": np.arange(12)}, "give sampling or time, not both"),
        ({"time": np.arange(11)}, "time has shape (11,)"),
        ({"time": np.arange(12)[::-1]}, "time does not go forward from sample 0 to 1"),
        ({"time": ["noon"] * 12}, "time holds <U4"),
        ({"touched": [[0.5]] * 12}, "touched, sample 0: variable 'touched' holds numbers that are not whole"),
        ({"touched": ["nose"] * 12}, "touched, sample 0"),
        ({"touched": np.full(12, -3)}, "'touched' holds -3"),
        ({"touched": [1] * 11}, "touched has 11 rows"),
        ({"intensity": np.ones(12)}, "intensity: give one for each of 'touched'"),
        ({"touched": [1, None] * 6, "intensity": np.ones(12)}, "intensity, sample 1: there is one where no taxel"),
        ({"hand_position": Q}, "hand_position has 2 columns, but there are 3 of space"),
        ({"at_reference": np.full(12, 0.5)}, "'at_reference' holds float64; give true or false"),
        ({"reference_image": [1.0, 2.0, 3.0]}, "columns, but there are"),
        ({"block": np.arange(12) / 2}, "'block' holds numbers that are not whole"),
        ({"joint_units": "deg"}, "joint_units='deg': give one of 'rad', 'm'"),
        ({"joint_units": ["rad"]}, "joint_units: 1 units for 2 joints"),
        ({"encoder_noise": -1.0}, "encoder_noise=-1.0"),
    ],
)
def test_what_does_not_fit_is_named_in_one_line(settings, message):
    with pytest.raises(InvalidRecording, match=re.escape(message)) as caught:
        make(**settings)
    assert "\n" not in str(caught.value)


def test_an_argument_that_is_not_there_is_named():
    with pytest.raises(UnknownName, match=r"no argument of recording.. 'hand_imag'; did you mean 'hand_image'"):
        make(hand_imag=IMAGE)
