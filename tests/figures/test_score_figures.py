"""Figures of scores show the numbers they are given, each kind told apart without colour."""

import numpy as np
import pytest

from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.figures import score_figures, style

PARTS = ("scale", "mean_excited", "mean_unexcited", "variation")
BAR = dict(zip(PARTS, (0.4, 0.1, 0.05, 0.25), strict=True))
DOSES = np.linspace(0, 1, 9)
GRID = np.stack(np.meshgrid(np.linspace(-0.03, 0.03, 4), np.linspace(-0.02, 0.02, 3)), -1)
CHAIN = {
    "Jacobian": {"LeastSquares": [0.5, 0.6], "ridge": [0.4, np.nan], "other": [0.2, 0.0]},
    "path [mm]": {"LeastSquares": [18.0, 20.0], "ridge": [15.0, 16.0], "other": [9.0, 8.0]},
    "map": {"LeastSquares": [0.9, 1.0], "ridge": [0.7, 0.6], "other": [0.4, 0.5]},
}
MADE = {
    "attribution": lambda: score_figures.attribution_bars(
        {"on_face": {"least_squares": BAR, "PaperMLP": BAR}, "in_front": {"least_squares": BAR}}
    ),
    "dose": lambda: score_figures.dose_response(
        {"rotated": 60 * DOSES, "noise": np.geomspace(0.01, 1, 9)},
        {"rotated": {"relative_error": DOSES, "span": DOSES**2}, "noise": {"span": DOSES**3}},
        dose_labels={"rotated": "angle [deg]"},
    ),
    "bar": lambda: score_figures.attribution_bars({"on_face": {"least_squares": BAR}}),
    "chain": lambda: score_figures.score_chain(CHAIN, named=["LeastSquares", "ridge"]),
    "posture_map": lambda: score_figures.posture_map({"paper_mlp": 0.5 * GRID, "direct": GRID}, GRID),
}


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


@pytest.mark.parametrize("name", MADE)
def test_figures_are_reproducible_small_and_whole(tmp_path, name):
    figure = MADE[name]()
    first, anew = (style.save(made, tmp_path, f"{name}{i}") for i, made in enumerate([figure, MADE[name]()]))
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in anew]
    assert first[0].stat().st_size < 200_000
    drawn = figure.get_tightbbox().get_points()
    assert (drawn >= -0.02).all(), "something is cut off"
    assert (drawn <= figure.get_size_inches() + 0.02).all(), "something is cut off"


def test_bars_are_stacked_to_the_squared_error():
    face, front = MADE["attribution"]().axes
    bars = [patch for patch in face.patches if abs(patch.get_y() + patch.get_height() / 2) < 1e-9]
    assert [stack.get_label() for stack in face.containers[:4]] == list(PARTS)
    assert [bar.get_width() for bar in bars] == pytest.approx(list(BAR.values()))
    assert [bar.get_x() for bar in bars] == pytest.approx([0, 0.4, 0.5, 0.55])
    assert [text.get_text() for text in face.texts] == ["0.80", "0.80"]
    assert len(front.patches) == len(PARTS), "an estimator that was not run has no bar"
    assert face.get_xlim() == front.get_xlim()
    assert [label.get_text() for label in face.get_yticklabels()] == ["least squares", "paper's network"]
    assert face.get_xlabel() == "squared relative error"
    assert legend(face.figure)[-1] == "zero Jacobian"
    looks = {(bar.get_facecolor(), bar.get_hatch()) for bar in bars}
    greys = sorted(np.dot(colour[:3], [0.299, 0.587, 0.114]) for colour, _ in looks)
    assert min(np.diff(greys)) > 0.05, "told apart in grey"


def test_a_single_bar_has_room_under_its_legend():
    figure = MADE["bar"]()
    figure.draw_without_rendering()
    (axes,) = figure.axes
    assert axes.get_window_extent().height > 0.3 * figure.dpi
    assert not figure.legends[0].get_window_extent().overlaps(axes.get_window_extent())


def test_a_chain_has_a_panel_a_link_and_a_point_a_cell():
    first, second = MADE["chain"]().axes
    assert (first.get_xlabel(), first.get_ylabel(), second.get_ylabel()) == ("Jacobian", "path [mm]", "map")
    assert second.get_xlabel() == "path [mm]"
    grey, squares, ridge = (line.get_xydata() for line in first.get_lines())
    assert squares == pytest.approx(np.array([[0.5, 18.0], [0.6, 20.0]]))
    assert np.isfinite(ridge).all(1).sum() == 1
    # A logarithmic axis has no place for zero.
    assert np.isfinite(grey).all(1).tolist() == [True, False]
    assert {axes.get_xscale() for axes in (first, second)} == {"log"}
    assert legend(first.figure) == ["least squares", "ridge regression", "others"]


def test_power_is_a_line_a_measure_over_its_own_doses():
    rotated, noise = MADE["dose"]().axes
    curves = {line.get_label(): line.get_xydata() for line in rotated.get_lines()}
    assert curves["relative error"] == pytest.approx(np.c_[60 * DOSES, DOSES])
    assert curves["span"] == pytest.approx(np.c_[60 * DOSES, DOSES**2])
    assert (rotated.get_xlabel(), noise.get_xlabel()) == ("angle [deg]", "dose")
    assert (rotated.get_xscale(), noise.get_xscale()) == ("linear", "log")
    assert legend(rotated.figure) == ["relative error", "span", "false alarms, 0.05"]
    assert any(np.allclose(line.get_ydata(), 0.05) for line in noise.get_lines())
    styles = [line.get_linestyle() for line in rotated.get_lines()[:2]]
    assert styles[0] != styles[1] or rotated.get_lines()[0].get_marker() != rotated.get_lines()[1].get_marker()
    milder_first = score_figures.dose_response([0.9, 0.5, 0.1], {"scale": {"span": [0.1, 0.5, 1.0]}}).axes[0]
    assert milder_first.get_xlim()[0] > milder_first.get_xlim()[1], "the worst is at the right"
    shared = score_figures.dose_response(DOSES, {"scaled": {"span": DOSES}})
    assert shared.axes[0].get_lines()[0].get_xdata() == pytest.approx(DOSES)


def test_many_measures_are_told_apart():
    names = [f"measure_{index}" for index in range(10)]
    (axes,) = score_figures.dose_response(DOSES, {"scaled": dict.fromkeys(names, DOSES)}).axes
    looks = {(line.get_color(), line.get_marker()) for line in axes.get_lines()[:10]}
    assert len(looks) == 10
    with pytest.raises(InvalidConfig, match="tell"):
        score_figures.dose_response(DOSES, {"scaled": dict.fromkeys([*names, "one_more"], DOSES)})


def test_each_unit_is_tied_to_where_its_posture_truly_is():
    learned, sight = MADE["posture_map"]().axes
    ties = next(line for line in learned.get_lines() if line.get_label() == "error").get_xydata().reshape(-1, 3, 2)
    assert ties[:, 0] == pytest.approx(1000 * GRID.reshape(-1, 2))
    assert ties[:, 1] == pytest.approx(500 * GRID.reshape(-1, 2))
    assert [axes.get_title() for axes in (learned, sight)] == ["paper's network", "direct sight"]
    assert learned.get_ylim()[0] > learned.get_ylim()[1], "y runs down"
    assert (learned.get_xlabel(), learned.get_ylabel()) == ("x [mm]", "y [mm]")
    hidden = GRID.copy()
    hidden[0, 0] = np.nan
    assert score_figures.posture_map({"direct": GRID}, hidden).axes


@pytest.mark.parametrize(
    ("call", "error", "match"),
    [
        (lambda: score_figures.attribution_bars({}), InvalidConfig, "empty"),
        (lambda: score_figures.attribution_bars({"a": {"b": {"scale": 1.0}}}), InvalidConfig, "variation"),
        (lambda: score_figures.attribution_bars({"a": {"b": BAR | {"scale": -0.1}}}), InvalidArray, "negative"),
        (lambda: score_figures.dose_response(DOSES, {}), InvalidConfig, "empty"),
        (lambda: score_figures.dose_response({"a": DOSES}, {"b": {"span": DOSES}}), InvalidConfig, "no doses"),
        (lambda: score_figures.dose_response(DOSES, {"b": {"span": DOSES[1:]}}), InvalidArray, "shape"),
        (lambda: score_figures.dose_response(DOSES, {"b": {"span": 2 * DOSES}}), InvalidArray, "probability"),
        (lambda: score_figures.score_chain({"a": {"b": [1.0]}}), InvalidConfig, "at least two"),
        (lambda: score_figures.score_chain({"a": {"b": [1.0]}, "c": {"d": [1.0]}}), InvalidArray, "every axis"),
        (lambda: score_figures.score_chain({"a": {"b": [1.0]}, "c": {"b": [1.0, 2.0]}}), InvalidArray, "shape"),
        (lambda: score_figures.posture_map({}, GRID), InvalidConfig, "empty"),
        (lambda: score_figures.posture_map({"direct": GRID[1:]}, GRID), InvalidArray, "shape"),
        (lambda: score_figures.posture_map({"direct": GRID}, np.nan * GRID), InvalidArray, "finite"),
    ],
)
def test_what_cannot_be_drawn_is_refused(call, error, match):
    with pytest.raises(error, match=match):
        call()
