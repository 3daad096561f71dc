"""The look is one, leaves nothing behind, and gives the same bytes every time."""

from functools import partial

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

from bodyimage_kin import figures
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.figures import _saving as saving

PATH = np.cumsum(np.random.default_rng(0).normal(0, 1e-3, (60, 2)), 0)


@figures.style()
def figure():
    made, grid = figures.panels(width=figures.SINGLE_COLUMN, height=2.0)
    grid[0, 0].plot(
        np.linspace(0, 1, 50), np.random.default_rng(0).random(50), label="truth", **figures.looks("ab")["a"]
    )
    grid[0, 0].set_xlabel("time [s]")
    figures.legend(made)
    return made


def test_style_leaves_no_setting_behind():
    before = dict(mpl.rcParams)
    with figures.style():
        assert mpl.rcParams["svg.hashsalt"]
        assert mpl.rcParams["font.size"] == 8
    assert dict(mpl.rcParams) == before


def test_style_does_not_depend_on_the_users_settings(tmp_path):
    plain = figures.save(figure(), tmp_path, "plain")
    with mpl.rc_context({"lines.linewidth": 9, "font.size": 20, "axes.grid": True}):
        other = figures.save(figure(), tmp_path, "other")
    assert [path.read_bytes() for path in plain] == [path.read_bytes() for path in other]


def test_saved_files_are_byte_identical_and_dateless(tmp_path):
    one = figure()
    first, second, again = (
        figures.save(one, tmp_path, "a"),
        figures.save(one, tmp_path, "b"),
        figures.save(figure(), tmp_path, "c"),
    )
    for kind in range(3):
        assert first[kind].read_bytes() == second[kind].read_bytes() == again[kind].read_bytes()
    svg = first[0].read_text()
    assert "<dc:date>" not in svg
    assert ">time [s]<" in svg, "text stays text"
    kinds = ("svg", "png", "csv")
    assert {path.name for path in tmp_path.iterdir()} == {f"{name}.{kind}" for name in "abc" for kind in kinds}


def test_rounding_changes_paths_only():
    svg = b'<path d="M 1.23456 -2.5 L 10.999999 0.0001"/><g transform="scale(0.123456)"/><text x="1.23456"/>'
    assert saving._rounded(svg) == b'<path d="M 1.23 -2.5 L 11 0"/><g transform="scale(0.123456)"/><text x="1.23456"/>'


def test_names_are_told_apart_without_colour():
    names = ["truth", "PaperMLP", "least_squares", "Analytic", "direct", "one", "two", "a", "b", "c", "d"]
    drawn = figures.looks(names)
    assert len({str(kind["linestyle"]) + kind["marker"] for kind in drawn.values()}) == len(names)
    assert len({kind["color"] for kind in drawn.values()}) == len(names)
    assert drawn["PaperMLP"] == figures.looks(["paper_mlp"])["paper_mlp"]
    with pytest.raises(InvalidConfig, match="another figure"):
        figures.looks([f"name {index}" for index in range(7)])


@pytest.mark.parametrize("name", ["../up", "a/b", "", ".hidden", "a\nb", '"'])
def test_save_refuses_names_that_are_not_file_names(tmp_path, name):
    with pytest.raises(InvalidConfig, match="plain file name"):
        figures.save(figure(), tmp_path, name)


def test_a_drawing_takes_the_axes_it_is_given_and_returns_them():
    with mpl.rc_context({"font.size": 13}):
        mine, axes = plt.subplots()
        assert figures.trajectories(PATH, {}, axes) is axes
        assert axes.xaxis.label.get_fontsize() == 13, "in the user's own look"
        assert not mine.legends, "the legend is the user's"
    plt.close(mine)


def test_without_axes_it_gets_a_figure_that_pyplot_shows():
    before = plt.get_fignums()
    axes = figures.trajectories(PATH, {"paper_mlp": PATH})
    assert [plt.figure(number) for number in plt.get_fignums() if number not in before] == [axes.figure]
    assert [text.get_text() for text in axes.figure.legends[0].get_texts()] == ["truth", "paper's network"]
    assert axes.xaxis.label.get_fontsize() == 8, "in ours"
    plt.close(axes.figure)
    with pytest.raises(InvalidConfig, match="another figure"):
        figures.trajectories(PATH, {f"name {index}": PATH for index in range(7)})
    assert plt.get_fignums() == before, "what fails leaves no figure"


def test_panels_are_lettered_before_their_titles():
    with figures.style():
        made, grid = figures.panels(1, 2)
        grid[0, 0].set_title("seen")
        figures.letters(grid[0])
    assert [axes.get_title("left") for axes in made.axes] == ["(a) seen", "(b)"]
    assert not any(axes.get_title() for axes in made.axes)
    with pytest.raises(InvalidConfig, match="rows"):
        figures.panels(0, 2)


def test_a_legend_lists_every_label_once():
    with figures.style():
        made, grid = figures.panels(1, 2)
        for axes in grid[0]:
            axes.plot([0, 1], [0, 1], label="line")
            axes.barh([0], [1], label="bar")
            axes.plot([0, 1], [1, 0], label="_: unlisted")
        figures.legend(made)
    assert [text.get_text() for text in made.legends[0].get_texts()] == ["bar", "line"]


def test_pictures_in_a_row_fill_the_width_of_their_figure():
    def draw(width, axes):
        axes.set(xlim=(0, width), ylim=(0, 1), aspect="equal", xticks=[], yticks=[])

    made = figures.row(partial(draw, 1), partial(draw, 2), pictures=True, height=9)
    made.draw_without_rendering()
    width, height = made.get_size_inches()
    left, right = (axes.get_position() for axes in made.axes)
    assert left.height == pytest.approx(right.height, rel=0.02)
    assert right.width == pytest.approx(2 * left.width, rel=0.02)
    assert (left.width + right.width) > 0.95
    assert height == pytest.approx(width / 3, rel=0.1)
    assert [axes.get_title("left") for axes in made.axes] == ["(a)", "(b)"]
