"""Paths of the hand are drawn as they are seen, in the unit of the image, whatever the eye."""

import numpy as np
import pytest
import xarray
from matplotlib.colors import to_rgb

import bodyimage_kin as bk
from bodyimage_kin import figures
from bodyimage_kin.errors import InvalidArray, InvalidConfig, InvalidRecording

RNG = np.random.default_rng(0)
PATH = np.cumsum(RNG.normal(0, 1e-3, (60, 2)), 0)
TIME = np.arange(60) * 0.1
LANDMARKS = {"left_eye": (0.01, -0.01), "mouth": (0.0, 0.03)}


@pytest.fixture
def axes():
    with figures.style():
        return figures.panels()[1][0, 0]


def line(axes, name):
    return next(found for found in axes.get_lines() if found.get_label() == name)


@pytest.mark.parametrize("axis", [0, 1])
def test_velocities_are_in_millimetres_and_truth_is_black(axes, axis):
    figures.velocities(TIME, PATH, {"PaperMLP": PATH * 2, "analytic": PATH}, axes, axis=axis)
    np.testing.assert_allclose(line(axes, "truth").get_ydata(), PATH[:, axis] * 1000)
    np.testing.assert_allclose(line(axes, "paper's network").get_ydata(), PATH[:, axis] * 2000)
    assert to_rgb(line(axes, "truth").get_color()) == (0, 0, 0)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time [s]", f"{'xy'[axis]} velocity [mm/s]")


def test_labelled_arrays_do_as_well(axes):
    figures.velocities(xarray.DataArray(TIME), xarray.DataArray(PATH, dims=("time", "axis")), {}, axes)
    figures.velocities([0, 1], [[0, 1], [2, 3]], {}, axes)


def test_trajectories_are_drawn_as_seen(axes):
    figures.trajectories(PATH, {"paper_mlp": PATH * 0.5}, axes, landmarks=LANDMARKS)
    assert axes.yaxis_inverted()
    assert axes.get_aspect() == 1
    np.testing.assert_allclose(line(axes, "truth").get_xydata(), PATH * 1000)
    np.testing.assert_allclose(line(axes, "mouth").get_xydata(), [[0, 30]])
    assert line(axes, "mouth").get_marker() != line(axes, "left eye").get_marker()
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [mm]", "y [mm]")


@pytest.mark.parametrize(
    ("m", "unit", "names", "labels", "factor"),
    [
        (2, "px", ("u", "v"), ("u [px]", "v [px]"), 1),
        (3, "m", ("x", "y", "z"), ("x [mm]", "y [mm]"), 1000),
        (4, "px", ("left u", "left v", "right u", "right v"), ("left u [px]", "left v [px]"), 1),
    ],
)
def test_axes_say_the_unit_of_the_image_and_what_is_left_out(axes, m, unit, names, labels, factor):
    path = RNG.normal(size=(20, m))
    figures.trajectories(None, {"mine": path}, axes, unit=unit, names=names)
    np.testing.assert_allclose(line(axes, "mine").get_xydata(), factor * path[:, :2])
    assert (axes.get_xlabel(), axes.get_ylabel()) == labels
    assert bool(axes.yaxis_inverted()) == (m != 3), "in space y is up"
    said = [text.get_text() for text in axes.texts]
    assert said == ([] if m == 2 else [f"the first 2 of {m} coordinates"])


@pytest.mark.parametrize(
    ("make", "error", "what"),
    [
        (lambda ax: figures.velocities(TIME, PATH[:-1], {}, ax), InvalidArray, "'truth' has shape"),
        (lambda ax: figures.velocities(TIME, PATH, {"a": PATH[:, :1]}, ax), InvalidArray, "'a' has shape"),
        (lambda ax: figures.velocities(TIME, PATH, {}, ax, axis=2), InvalidConfig, "axis=2"),
        (lambda ax: figures.trajectories(PATH, {"a": "path"}, ax), InvalidArray, "'a' holds"),
        (lambda ax: figures.trajectories(PATH, {"a": PATH}, ax, names="xyz"), InvalidArray, "has shape"),
        (lambda ax: figures.recording(xarray.Dataset(), [ax] * 3), InvalidRecording, "no recording"),
    ],
)
def test_what_does_not_fit_is_named(axes, make, error, what):
    with pytest.raises(error, match=what):
        make(axes)


# Recordings -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def circle(body):
    return bk.simulate(body, bk.motions.Circle(turns=0.5), seed=0, trials=2, dynamics=False)


def three():
    with figures.style():
        return figures.panels(1, 3)[1][0]


def test_a_recording_shows_what_was_seen_felt_and_touched(circle):
    seen, felt, touched = figures.recording(circle, three())
    image = circle["hand_image"].values[0] * 1000
    np.testing.assert_allclose(line(seen, "_: hand in the image").get_xydata(), image)
    assert (seen.get_xlabel(), felt.get_ylabel()) == ("x [mm]", "joint value [rad]")
    for index, name in enumerate(circle["joint"].values):
        np.testing.assert_allclose(line(felt, str(name).replace("_", " ")).get_ydata(), circle["q"].values[0, :, index])
    assert "first of 2 trials" in [text.get_text() for text in seen.texts]
    assert "nothing touched" in [text.get_text() for text in touched.texts]
    assert [axes.get_title("left")[:3] for axes in (seen, felt, touched)] == ["(a)", "(b)", "(c)"]


def test_a_recording_in_pixels_says_so(circle):
    pixels = circle.copy(deep=True)
    pixels["hand_image"].attrs["units"] = "px"
    seen = figures.recording(pixels, three())[0]
    assert seen.get_xlabel() == "x [px]"
    np.testing.assert_allclose(line(seen, "_: hand in the image").get_xydata(), circle["hand_image"].values[0])


def test_a_scattered_recording_is_dots_over_their_numbers(circle):
    scattered = circle.isel(trial=[0]).assign_attrs(order="scattered")
    _, felt, _ = figures.recording(scattered, three())
    first = felt.get_lines()[0]
    assert (first.get_linestyle(), first.get_marker()) == ("None", ".")
    assert felt.get_xlabel() == "number of the posture"


def test_touches_are_dots_and_a_hand_unseen_is_told(body):
    touch = bk.simulate(body, bk.motions.RandomTouch(duration=3.0), seed=0, dynamics=False)
    seen, _, touched = figures.recording(touch, three())
    assert "the hand was not seen" in [text.get_text() for text in seen.texts]
    taxels = touch["touched"].values[0]
    dots = touched.patches[0].get_path().vertices[::2]
    np.testing.assert_array_equal(dots[:, 1], taxels[taxels >= 0])
    assert touched.get_title("left") == f"(c) touched: {len(set(taxels[taxels >= 0]))} taxels"
    two = touch.isel(contact=[0, 0]).copy(deep=True)
    two["touched"][..., 1] = np.where(two["touched"][..., 0] >= 0, 7, -1)
    dots = figures.recording(two, three())[2].patches[0].get_path().vertices[::2]
    assert len(dots) == 2 * (taxels >= 0).sum(), "all contacts of a sample"
    with pytest.raises(InvalidArray, match="three axes"):
        figures.recording(touch, three()[:2])
