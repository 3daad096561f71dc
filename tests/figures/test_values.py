"""Whatever a figure shows is in its table and under the pointer, where it is drawn."""

import re

import numpy as np
import pytest

from bodyimage_kin import figures


@pytest.fixture
def figure():
    with figures.style():
        made, grid = figures.panels(1, 3, width=6, height=2)
        first, second, third = grid[0]
        first.plot([0, 1, np.nan], [2.0, 3.0, 4.0], label="line")
        first.plot([0, 1], [5, 6], label="_: unlisted")
        first.plot([0, 1], [7, 8])
        first.axhline(1.0)
        first.set(xlabel="time [s]", ylabel="error", title="left")
        second.barh([0, 1], [0.5, 0.25], label="part")
        second.barh([0, 1], [0.1, 0.2], left=[0.5, 0.25], label="rest")
        second.set_yticks([0, 1], ["one", "two"])
        second.errorbar([0.3], [1], xerr=[[0.1], [0.2]], label="mean", linestyle="", marker="o")
        third.imshow(np.arange(6.0).reshape(2, 3), label="height")
    return made


def test_the_table_has_every_value_once(figure):
    rows = figures.values(figure)
    assert list(rows.columns) == ["panel", "series", "x_axis", "x", "y_axis", "y", "lower", "upper", "value"]
    assert rows["series"].value_counts().to_dict() == {
        "line": 2,
        "unlisted": 2,
        "part": 2,
        "rest": 2,
        "mean": 1,
        "height": 6,
    }
    line = rows[rows["series"] == "line"]
    assert (line["x"].tolist(), line["y"].tolist(), set(line["panel"])) == ([0, 1], [2, 3], {"left"})
    rest = rows[rows["series"] == "rest"]
    assert (rest["x"].tolist(), rest["y"].tolist()) == ([0.1, 0.2], ["one", "two"]), "a share, wherever it is stacked"
    mean = rows[rows["series"] == "mean"].iloc[0]
    assert (mean["x"], mean["y"], mean["lower"], mean["upper"]) == pytest.approx((0.3, 1, 0.2, 0.5)) or mean[
        "y"
    ] == "two"
    cells = rows[rows["series"] == "height"]
    assert cells["value"].tolist() == [0, 1, 2, 3, 4, 5]
    assert cells["x"].tolist() == [0, 1, 2] * 2


def test_shared_axes_name_their_columns():
    with figures.style():
        made, grid = figures.panels()
        figures.velocities([0, 1], [[0.0, 1], [2, 3]], {}, grid[0, 0])
    rows = figures.values(made)
    assert list(rows.columns) == ["series", "time [s]", "x velocity [mm/s]"]
    assert len(figures.values(figures.panels()[0])) == 0


def test_the_pointer_finds_each_value_where_it_is_drawn(figure):
    svg = figures.svg(figure)
    targets = re.findall(
        r'<rect x="([\d.-]+)" y="([\d.-]+)" width="([\d.]+)" height="([\d.]+)"><title>(.*?)</title></rect>', svg
    )
    assert len(targets) == len(figures.values(figure))
    by_text = {text: [float(number) for number in box] for *box, text in targets}
    x, y, width, height = by_text["line: time [s] 1, error 3"]
    where = figure.axes[0].transData.transform((1, 3))
    figure.set_dpi(72)
    where = figure.axes[0].transData.transform((1, 3))
    assert (x + width / 2, 2 * 72 - (y + height / 2)) == pytest.approx(where, abs=0.1)
    x, y, width, height = by_text["part: x 0.5, y one"]
    left, right = (figure.axes[1].transData.transform((end, 0))[0] for end in (0, 0.5))
    assert (x, x + width) == pytest.approx((left, right), abs=0.1)


def test_long_paths_have_few_targets_and_all_values():
    with figures.style():
        made, grid = figures.panels()
        grid[0, 0].plot(np.arange(5000), np.arange(5000), label="path")
    assert 100 < figures.svg(made).count("<title>path") <= 151
    assert len(figures.values(made)) == 5000


def test_titles_are_escaped():
    with figures.style():
        made, grid = figures.panels()
        grid[0, 0].plot([0], [0], "o", label="<script>alert('x')</script> & \"q\"")
    svg = figures.svg(made)
    assert "<script" not in svg
    assert "&lt;script&gt;" in svg
