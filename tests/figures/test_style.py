"""The look is one, leaves nothing behind, and gives the same bytes every time."""

import matplotlib as mpl
import numpy as np
import pytest

from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.figures import style as look


@look.style()
def figure():
    made = look.new_figure(look.SINGLE_COLUMN, 2.0)
    axes = made.subplots()
    axes.plot(np.linspace(0, 1, 50), np.random.default_rng(0).random(50), label="truth", **look.appearances("ab")["a"])
    axes.set_xlabel("time [s]")
    axes.legend()
    return made


def test_style_leaves_no_setting_behind():
    before = dict(mpl.rcParams)
    with look.style():
        assert mpl.rcParams["svg.hashsalt"]
        assert mpl.rcParams["font.size"] == 8
    assert dict(mpl.rcParams) == before


def test_style_does_not_depend_on_the_users_settings(tmp_path):
    plain = look.save(figure(), tmp_path, "plain")
    with mpl.rc_context({"lines.linewidth": 9, "font.size": 20, "axes.grid": True}):
        other = look.save(figure(), tmp_path, "other")
    assert [path.read_bytes() for path in plain] == [path.read_bytes() for path in other]


def test_saved_files_are_byte_identical_and_dateless(tmp_path):
    one = figure()
    first, second, again = (
        look.save(one, tmp_path, "a"),
        look.save(one, tmp_path, "b"),
        look.save(figure(), tmp_path, "c"),
    )
    for kind in range(2):
        assert first[kind].read_bytes() == second[kind].read_bytes() == again[kind].read_bytes()
    svg = first[0].read_text()
    assert "<dc:date>" not in svg
    assert ">time [s]<" in svg, "text stays text"
    assert {path.name for path in tmp_path.iterdir()} == {f"{name}.{kind}" for name in "abc" for kind in ("svg", "png")}


def test_rounding_changes_paths_only():
    svg = b'<path d="M 1.23456 -2.5 L 10.999999 0.0001"/><g transform="scale(0.123456)"/><text x="1.23456"/>'
    assert look._rounded(svg) == b'<path d="M 1.23 -2.5 L 11 0"/><g transform="scale(0.123456)"/><text x="1.23456"/>'


def test_names_are_told_apart_without_colour():
    names = ["truth", "PaperMLP", "least_squares", "Analytic", "direct", "one", "two"]
    drawn = look.appearances(names)
    assert len({str(kind["linestyle"]) + kind["marker"] for kind in drawn.values()}) == len(names)
    assert len({kind["color"] for kind in drawn.values()}) == len(names)
    assert drawn["PaperMLP"]["color"] == look.COLOURS["paper_mlp"]
    assert look.label("LeastSquares") == "least squares"
    assert look.label("an_unknown") == "an unknown"
    with pytest.raises(InvalidConfig, match="another figure"):
        look.appearances([f"name {index}" for index in range(7)])


@pytest.mark.parametrize("name", ["../up", "a/b", "", ".hidden"])
def test_save_refuses_names_that_are_not_file_names(tmp_path, name):
    with pytest.raises(InvalidConfig, match="plain file name"):
        look.save(figure(), tmp_path, name)
