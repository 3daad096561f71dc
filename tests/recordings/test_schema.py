"""Laws of the schema: what is a recording, what is felt of it, and how it meets a body."""

import dataclasses
import re

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import bodyimage_kin as bk
from bodyimage_kin.body.cameras import Tracker
from bodyimage_kin.errors import InvalidRecording, UnknownName
from bodyimage_kin.estimators import nulls
from bodyimage_kin.recordings import align, canonical_order, check, first_taxel, schema

SAMPLE = ("trial", "time")


def least(count=6, p=2, **variables):
    """The least that is a recording: postures and a hand image."""
    q = np.linspace(0.0, 1.0, count * p).reshape(1, count, p)
    given_ = {"q": q, "hand_image": 2.0 * q[..., :2], **variables}
    return xr.Dataset({name: (schema.VARIABLES[name], values) for name, values in given_.items()})


# What is a recording --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("hand_image", np.zeros((1, 6, 4))),
        ("touched", np.zeros((1, 6, 3), dtype=np.int64)),
        ("hand_position", np.zeros((1, 6, 3))),
    ],
)
def test_postures_and_one_observation_are_enough(name, values):
    recording = least(**{name: values})
    recording = recording.drop_vars([other for other in schema.OBSERVATIONS if other != name and other in recording])
    assert check(recording) is recording
    with pytest.raises(InvalidRecording, match="no observation beside 'q'; give one of hand_image, touched"):
        check(recording.drop_vars(name))
    with pytest.raises(InvalidRecording, match="no variable 'q'"):
        check(recording.drop_vars("q"))


def test_what_is_misshapen_is_named(circle):
    for name, dims in schema.VARIABLES.items():
        if name in circle and len(dims) > 1:
            turned = circle.assign({name: circle[name].transpose(*dims[::-1])})
            with pytest.raises(InvalidRecording, match=f"'{name}' has dimensions"):
                check(turned)
    with pytest.raises(InvalidRecording, match="no samples"):
        check(circle.isel(time=slice(0, 0)))
    with pytest.raises(InvalidRecording, match="no 'joint' of variable 'q'"):
        check(circle.isel(joint=[]))
    with pytest.raises(InvalidRecording, match="no 'axis' of variable 'hand_image'"):
        check(circle.isel(axis=[]))
    for order in ("loose", 3, None, np.array([1, 2])):
        with pytest.raises(InvalidRecording, match=r"order=.*: give one of 'stream', 'scattered'"):
            check(circle.assign_attrs(order=order))
        with pytest.raises(InvalidRecording, match="order"):
            bk.estimators.LeastSquares().fit(circle.assign_attrs(order=order))
    for name in schema.COORDINATES:
        if name in circle.coords:
            wide = circle.assign_coords({name: (("other", name), circle[name].values[None])})
            with pytest.raises(InvalidRecording, match=f"coordinate '{name}' has dimensions"):
                check(wide)


@pytest.mark.parametrize("unit", ["deg", "degrees", "rad deg rad rad rad", "mm", 3, None])
def test_joint_values_in_degrees_are_not_taken_for_radians(circle, unit):
    spoilt = circle.copy(deep=True)
    spoilt.q.attrs["units"] = unit
    for use in (check, bk.experience, bk.estimators.LeastSquares().fit):
        with pytest.raises(InvalidRecording, match=r"the unit of 'q'=.*: give radians and metres"):
            use(spoilt)
    spoilt.q.attrs["units"] = "rad m rad rad rad"
    assert check(spoilt) is spoilt


@pytest.mark.usefixtures("unchecked")
def test_a_recording_is_a_dataset():
    with pytest.raises(InvalidRecording, match=r"is an xarray\.Dataset, not dict"):
        check({"q": 1})


@pytest.mark.parametrize("dtype", ["float32", "float16", ">f8", "int64", "uint8", "int16"])
def test_numbers_of_any_kind_are_those_of_the_schema(dtype):
    q = np.arange(12.0).reshape(1, 6, 2)
    given_ = least(q=q.astype(dtype), touched=np.ones((1, 6, 1), dtype=dtype), at_reference=np.ones((1, 6), dtype))
    found = check(given_)
    assert found.q.dtype == np.dtype(np.float64)
    assert found.touched.dtype == np.dtype(np.int64)
    assert found.at_reference.dtype == bool
    np.testing.assert_array_equal(found.q, q)
    assert bk.experience(given_).q.dtype == np.float64


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("q", np.ones((1, 6, 2), dtype=bool), "variable 'q' holds bool"),
        ("q", np.full((1, 6, 2), "1.0"), "variable 'q' holds <U3"),
        ("hand_image", np.ones((1, 6, 2), dtype=complex), "variable 'hand_image' holds complex128"),
        ("q", np.array([[[1.0, None]] * 6], dtype=object), "variable 'q' is no array of numbers"),
        ("hand_image", np.full((1, 6, 2), np.inf), "variable 'hand_image' is infinite at [0, 0, 0]"),
        ("touched", np.full((1, 6, 1), 0.5), "variable 'touched' holds numbers that are not whole"),
        ("touched", np.full((1, 6, 1), -2), "variable 'touched' holds -2; give whole numbers from 0, -1 for none"),
        ("touched", np.ones((1, 6, 1), dtype=bool), "variable 'touched' holds bool"),
        ("at_reference", np.full((1, 6), 2), "variable 'at_reference' holds int64; give true or false"),
        ("at_reference", np.full((1, 6), "yes"), "variable 'at_reference' holds <U3"),
    ],
)
def test_what_is_no_number_is_refused(name, values, message):
    with pytest.raises(InvalidRecording, match=re.escape(message)):
        check(least(**{name: values}))


def test_taxels_that_are_missing_are_none():
    assert check(least(touched=np.array([[[3.0], [np.nan]] * 3]))).touched.values[0, :2, 0].tolist() == [3, -1]


def test_time_goes_forward_in_a_stream():
    recording = least().assign_coords(time=[0.0, 0.1, 0.3, 0.2, 0.4, 0.5])
    with pytest.raises(InvalidRecording, match=r"time does not go forward from sample 2 to 3 \(0\.3, 0\.2\)"):
        check(recording)
    check(recording.assign_attrs(order="scattered"))
    with pytest.raises(InvalidRecording, match="'time' holds datetime64"):
        check(recording.assign_coords(time=np.datetime64("2020-01-01", "ns") + np.arange(6)))


# What is felt ---------------------------------------------------------------------------------------------------------


def test_an_experience_has_nothing_that_is_named_true(circle):
    spoilt = circle.assign(true_mood=("true_axis", [1.0, 2.0]), mine=("true_axis", [1.0, 2.0]))
    spoilt = spoilt.assign_coords(true_time=("time", circle.time.values)).assign_attrs(true_seed=3, seed=4)
    spoilt.q.attrs["true_noise"] = 0.1
    spoilt.time.attrs["true_clock"] = 1
    exp = bk.experience(spoilt)
    names = [*exp.variables, *exp.dims, *exp.attrs, *(name for one in exp.variables.values() for name in one.attrs)]
    assert not [name for name in names if str(name).startswith("true")]
    assert exp.attrs["seed"] == 4
    assert exp.time.attrs == {"units": "s"}
    # The recording itself is as it was.
    assert spoilt.q.attrs["true_noise"] == 0.1
    assert spoilt.attrs["true_seed"] == 3
    assert "true_axis" in spoilt.dims


def test_the_first_taxel_is_the_first_that_is_touched():
    touched = np.array([[[4, 7], [9, -1], [-1, -1], [-1, 3]]])
    recording = least(count=4, touched=touched, true_touched=touched + 1)
    assert first_taxel(recording).tolist() == [[4, 9, -1, 3]]
    assert first_taxel(recording, truth=True).tolist() == [[5, 10, 0, 0]]
    for truth, name in ((False, "touched"), (True, "true_touched")):
        with pytest.raises(InvalidRecording, match=f"no variable '{name}'"):
            first_taxel(least(), truth)


# A body ---------------------------------------------------------------------------------------------------------------


def test_joints_are_put_in_the_order_of_the_body_by_name(body, circle):
    assert align(circle, body) is circle
    order = [3, 0, 4, 1, 2]
    turned = circle.isel(joint=order)
    assert align(turned, body).identical(circle)
    assert not np.array_equal(turned.q, circle.q)
    np.testing.assert_array_equal(align(turned, body).true_q, circle.true_q)


def test_joints_that_do_not_fit_are_named(body, circle):
    names = list(body.joints)
    with pytest.raises(InvalidRecording, match="lacks joint 'left_elbow' of embodiment 'infant'"):
        align(circle.drop_sel(joint="left_elbow"), body)
    with pytest.raises(InvalidRecording, match="lacks joints 'left_elbow', 'left_wrist'"):
        align(circle.drop_sel(joint=["left_elbow", "left_wrist"]), body)
    with pytest.raises(UnknownName, match="no felt joint 'left_elbw'; did you mean 'left_elbow'"):
        align(circle.assign_coords(joint=[*names[:3], "left_elbw", names[4]]), body)
    with pytest.raises(InvalidRecording, match="joint 'left_elbow' is there 2 times; name each joint once"):
        align(circle.assign_coords(joint=[*names[:4], "left_elbow"]), body)
    with pytest.raises(InvalidRecording, match="does not name its joints"):
        align(circle.drop_vars("joint"), body)


def test_the_image_of_another_camera_is_refused(body, circle):
    pixels = circle.copy()
    pixels.hand_image.attrs = {"units": "px"}
    with pytest.raises(InvalidRecording, match="2 coordinates in px, the camera of embodiment 'infant' 2 in m"):
        align(pixels, body)
    with pytest.raises(InvalidRecording, match="1 coordinates in m"):
        align(circle.isel(axis=[0]), body)


def test_axes_and_units_are_those_of_the_camera(body):
    tracker = dataclasses.replace(body.camera, model=Tracker())
    seen = bk.simulate(dataclasses.replace(body, camera=tracker), bk.motions.Circle(turns=0.1), dynamics=False)
    assert seen.axis.values.tolist() == ["x", "y", "z"]
    assert seen.hand_image.shape[-1] == 3
    assert seen.hand_image.attrs == {"units": "m"}


# Rows in no order -----------------------------------------------------------------------------------------------------


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_the_canonical_order_forgets_how_rows_were_written_down(seed, tied):
    rng = np.random.default_rng(seed)
    q = rng.integers(0, 3, (1, 12, 2)) if tied else rng.standard_normal((1, 12, 2))
    image = rng.standard_normal((1, 12, 2))
    image[0, 3] = np.nan
    one = least(count=12, q=q, hand_image=image, block=np.arange(12)[None] // 4).assign_attrs(order="scattered")
    other = one.isel(time=rng.permutation(12))
    first, second = (recording.isel(time=canonical_order(recording)) for recording in (one, other))
    assert first.identical(second)
    keys = [tuple(row) for row in first.q.values[0]]
    assert keys == sorted(keys)


def test_a_stream_has_an_order_already():
    with pytest.raises(InvalidRecording, match="a stream is ordered in time"):
        canonical_order(least())


def test_joints_in_another_order_are_refused_before_anything_is_learned(body, circle):
    turned = bk.experience(circle.isel(joint=[1, 0, 2, 3, 4]))
    for spec in (bk.estimators.Analytic(body), bk.estimators.SelfCalibration(body), nulls.Rotated(body)):
        with pytest.raises(InvalidRecording, match=r"stand in another order .* recordings\.align\(recording, body\)"):
            spec.fit(turned)
    for ask in (bk.probes.Training().postures, lambda body, seen: bk.probes.distances(body, seen, [[0.0] * 5])):
        with pytest.raises(InvalidRecording, match="stand in another order"):
            ask(body, turned)
    learned = bk.estimators.Analytic(body).fit(align(turned, body))
    np.testing.assert_array_equal(learned.jacobian(circle.q.values[0]), body.hand_image_jacobian(circle.q.values[0]))
