"""Figures of errors show the numbers they are given, each kind told apart without colour."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import to_rgb

from bodyimage_kin import figures
from bodyimage_kin.errors import InvalidArray, InvalidConfig

PARTS = ("scale", "mean_excited", "mean_unexcited", "variation")
BAR = dict(zip(PARTS, (0.4, 0.1, 0.05, 0.25), strict=True))
DOSES = np.linspace(0, 1, 9)
TIME = np.arange(60) * 0.1


@pytest.fixture
def axes():
    with figures.style():
        return figures.panels(width=4, height=3)[1][0, 0]


def legend(axes):
    figures.legend(axes.figure)
    return [text.get_text() for text in axes.figure.legends[0].get_texts()]


def means(values, probes=("on_circle", "on_face")):
    mean = xr.DataArray(values, {"estimator": ["a", "truth", "wild"], "probe": list(probes)}, ("estimator", "probe"))
    return xr.Dataset({"median": mean, "lower": 0.9 * mean, "upper": 1.2 * mean})


def test_estimators_are_ranked_with_their_intervals(axes):
    figures.errors(means([[0.1, 0.5], [0.0, 0.0], [0.2, 3e4]]), axes)
    assert [label.get_text() for label in axes.get_yticklabels()] == ["wild", "a", "truth"]
    assert legend(axes) == ["on the circle", "on the face"]
    face = axes.containers[1]
    np.testing.assert_allclose(face.lines[0].get_xdata(), [3e4, 0.5, 0.0])
    np.testing.assert_allclose(np.array(face.lines[2][0].get_segments())[1, :, 0], [0.45, 0.6])
    assert axes.get_xscale() == "log"
    left, right = axes.get_xlim()
    assert left < 1e-3 < 30 < right < 100
    # What is beyond the axis is an open mark at its edge, and the panel says so.
    opened = [one for one in axes.get_lines() if one.get_markerfacecolor() == "white" and len(one.get_xdata())]
    assert [one.get_xydata().tolist() for one in opened] == [[[1e-3, 2.0]], [[30.0, 0.0], [1e-3, 2.0]]]
    assert [text.get_text() for text in axes.texts] == ["open: below 0.001 or above 30"]
    shown = figures.values(axes.figure)
    assert shown["relative error"].max() == 3e4, "the table has the numbers themselves"


def test_estimators_without_a_number_come_last(axes):
    figures.errors(means([[0.1, np.nan], [0.2, 0.4], [0.3, 0.2]]), axes, ranked_at="on_face")
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a", "truth", "wild"]
    assert not axes.texts
    with pytest.raises(InvalidConfig, match="ranked_at='nowhere'"):
        figures.errors(means(np.ones((3, 2))), axes, ranked_at="nowhere")
    with pytest.raises(InvalidConfig, match="told apart"):
        figures.errors(means(np.ones((3, 7)), range(7)), axes)


def test_bars_are_stacked_to_the_squared_error(axes):
    figures.attribution({"least_squares": BAR, "PaperMLP": BAR}, axes)
    bars = [patch for patch in axes.patches if abs(patch.get_y() + patch.get_height() / 2) < 1e-9]
    assert [bar.get_width() for bar in bars] == pytest.approx(list(BAR.values()))
    assert [bar.get_x() for bar in bars] == pytest.approx([0, 0.4, 0.5, 0.55])
    assert [text.get_text() for text in axes.texts] == ["0.80", "0.80"]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["least squares", "paper's network"]
    assert axes.get_xlabel() == "squared relative error"
    assert legend(axes)[-1] == "Jacobian of zeros"
    colours = [bar.get_facecolor() for bar in bars]
    greys = sorted(np.dot(to_rgb(colour), [0.299, 0.587, 0.114]) for colour in colours)
    assert min(np.diff(greys)) > 0.12, "told apart in grey, at any size"
    assert not any(bar.get_hatch() for bar in bars)


def test_one_bar_of_four_decades_leaves_the_others_their_room(axes):
    wild = {part: 1e4 * share for part, share in BAR.items()}
    figures.attribution({"a": BAR, "b": {part: 0.5 * share for part, share in BAR.items()}, "wild": wild}, axes)
    assert axes.get_xlim()[1] < 3
    assert axes.texts[2].get_text().startswith("8e+03")
    assert axes.texts[2].get_position()[0] <= axes.get_xlim()[1]
    shown = figures.values(axes.figure)
    assert shown["squared relative error"].max() == pytest.approx(4000)


def test_small_errors_fill_their_panel(axes):
    figures.attribution({"a": {part: 0.01 * share for part, share in BAR.items()}}, axes)
    assert axes.get_xlim()[1] == pytest.approx(1.18 * 0.008)
    assert "Jacobian of zeros" not in legend(axes)


def test_error_by_distance_has_medians_quartiles_and_the_zero_jacobian(axes):
    # Lopsided in every bin, so that its quartiles are not as far from the median.
    skewed = 0.1 + (TIME * 5 % 1 + np.floor(TIME * 5)) ** 4
    errors = {"least_squares": np.stack([skewed, skewed]), "other": TIME + 1, "absent": np.full(60, np.nan)}
    figures.error_by_distance(TIME, errors, axes, named=["least_squares", "absent"], xlabel="distance [cm]")
    assert (axes.get_xlabel(), axes.get_yscale()) == ("distance [cm]", "log")
    (drawn,) = axes.containers
    np.testing.assert_allclose(drawn.lines[0].get_ydata(), np.median(skewed.reshape(5, 12), axis=1))
    bars = np.array(drawn.lines[2][0].get_segments())[..., 1]
    np.testing.assert_allclose(bars, np.quantile(skewed.reshape(5, 12), [0.25, 0.75], axis=1).T)
    grey = next(line for line in axes.get_lines() if line.get_label() == "_: other")
    np.testing.assert_allclose(grey.get_ydata(), np.median((1 + TIME).reshape(5, 12), axis=1))
    assert "Jacobian of zeros" in [text.get_text() for text in axes.texts]
    assert legend(axes) == ["least squares", "others"]


def test_a_chain_has_a_point_a_cell(axes):
    x = {"LeastSquares": [0.5, 0.6], "ridge": [0.4, np.nan], "other": [0.2, 0.0]}
    y = {"LeastSquares": [18.0, 20.0], "ridge": [15.0, 16.0], "other": [9.0, 8.0]}
    figures.score_chain(x, y, axes, named=["LeastSquares", "ridge"], xlabel="Jacobian", ylabel="path [mm]")
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("Jacobian", "path [mm]")
    grey, squares, ridge = (line.get_xydata() for line in axes.get_lines()[:3])
    assert squares == pytest.approx(np.array([[0.5, 18.0], [0.6, 20.0]]))
    assert np.isfinite(ridge).all(1).sum() == 1
    # A logarithmic axis has no place for zero.
    assert np.isfinite(grey).all(1).tolist() == [True, False]
    assert {axes.get_xscale(), axes.get_yscale()} == {"log"}
    assert legend(axes) == ["least squares", "ridge regression", "others"]
    assert set(figures.values(axes.figure)["series"]) == {"least squares", "ridge regression", "other"}


def test_power_is_a_line_a_measure_over_its_doses(axes):
    power = {"relative_error": DOSES, "span": DOSES**2}
    figures.dose_response(60 * DOSES, power, axes, xlabel="angle [deg]")
    curves = {line.get_label(): line for line in axes.get_lines()}
    assert curves["relative error"].get_xydata() == pytest.approx(np.c_[60 * DOSES, DOSES])
    assert curves["span"].get_xydata() == pytest.approx(np.c_[60 * DOSES, DOSES**2])
    assert (axes.get_xlabel(), axes.get_xscale()) == ("angle [deg]", "linear")
    assert legend(axes) == ["relative error", "span", "false alarms, 0.05"]
    assert any(np.allclose(line.get_ydata(), 0.05) for line in axes.get_lines())
    assert curves["span"].get_marker() != curves["relative error"].get_marker()


def test_doses_of_decades_and_the_mildest_first(axes):
    figures.dose_response(np.geomspace(1, 0.01, 9), {"span": DOSES}, axes)
    assert axes.get_xscale() == "log"
    assert axes.get_xlim()[0] > axes.get_xlim()[1], "the worst is at the right"


def test_many_measures_are_told_apart(axes):
    names = [f"measure_{index}" for index in range(10)]
    figures.dose_response(DOSES, dict.fromkeys(names, DOSES), axes)
    looks = {(line.get_color(), line.get_marker()) for line in axes.get_lines()[:10]}
    assert len(looks) == 10
    with pytest.raises(InvalidConfig, match="tell"):
        figures.dose_response(DOSES, dict.fromkeys([*names, "one_more"], DOSES), axes)


@pytest.mark.parametrize(
    ("call", "error", "match"),
    [
        (lambda ax: figures.attribution({}, ax), InvalidConfig, "empty"),
        (lambda ax: figures.attribution({"a": BAR, "b": {"scale": 1.0}}, ax), InvalidConfig, "variation"),
        (lambda ax: figures.attribution({"b": BAR | {"scale": -0.1}}, ax), InvalidArray, "negative"),
        (lambda ax: figures.attribution({"b": BAR | {"scale": np.nan}}, ax), InvalidArray, "not a number"),
        (lambda ax: figures.dose_response(DOSES, {}, ax), InvalidConfig, "empty"),
        (lambda ax: figures.dose_response(DOSES, {"span": DOSES[1:]}, ax), InvalidArray, "shape"),
        (lambda ax: figures.dose_response(DOSES, {"span": 2 * DOSES}, ax), InvalidArray, "probability"),
        (lambda ax: figures.score_chain({}, {}, ax), InvalidConfig, "empty"),
        (lambda ax: figures.score_chain({"b": [1.0]}, {"d": [1.0]}, ax), InvalidArray, "same estimators"),
        (lambda ax: figures.score_chain({"b": [1.0]}, {"b": [1.0, 2.0]}, ax), InvalidArray, "shape"),
        (lambda ax: figures.error_by_distance(TIME, {"a": TIME[1:]}, ax), InvalidArray, "'a'"),
        (lambda ax: figures.error_by_distance(TIME, {"a": TIME}, ax, bins=0), InvalidConfig, "bins"),
    ],
)
def test_what_cannot_be_drawn_is_refused(axes, call, error, match):
    with pytest.raises(error, match=match):
        call(axes)


def test_panels_that_share_an_axis_hide_nothing_of_each_other():
    _, grid = figures.panels(1, 2, height=2.0, sharex=True)
    figures.errors(means([[0.02, 4.0], [0.3, 0.3], [0.3, 0.3]]), grid[0, 0])
    figures.errors(means([[0.4, 0.5], [0.4, 0.5], [0.4, 0.5]]), grid[0, 1])
    least, most = grid[0, 0].get_xlim()
    assert least < 0.02
    assert most > 4.0
