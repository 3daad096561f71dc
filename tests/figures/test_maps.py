"""Maps show where taxels and postures are thought to be, beside the truth, on a grid or on any graph."""

import numpy as np
import pytest

from bodyimage_kin import figures
from bodyimage_kin.body.graph import grid_edges
from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.figures._chart import flatten

GRID = np.stack(np.meshgrid(np.linspace(-0.03, 0.03, 7), np.linspace(-0.02, 0.02, 5)), -1)
STEPS = [0, 100, 200]
RIGHT_UP = np.array([[1.0, 0, 0], [0, 0, 1]])


@pytest.fixture
def axes():
    with figures.style():
        return figures.panels(width=4, height=3)[1][0, 0]


def line(axes, name):
    return next(found for found in axes.get_lines() if found.get_label() == name)


def dots(axes):
    return axes.patches[0].get_path().vertices[::2]


def edges_drawn(artist):
    return artist.get_xydata().reshape(-1, 3, 2)[:, :2]


def test_a_map_marks_the_taxels_next_to_a_landmark_and_has_the_truth_behind(axes):
    figures.tactile_map(0.5 * GRID, axes, true=GRID, landmarks={"nose": 17, "mouth": 31})
    np.testing.assert_allclose(dots(axes), GRID.reshape(-1, 2) * 500)
    np.testing.assert_allclose(line(axes, "nose").get_xydata(), GRID[1:4, 2:5].reshape(-1, 2) * 500)
    np.testing.assert_allclose(line(axes, "mouth").get_xydata(), GRID[3:, 2:5].reshape(-1, 2) * 500)
    assert axes.yaxis_inverted()
    assert axes.get_aspect() == 1
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    assert left < -30 < 30 < right, "the truth is in sight"
    assert top < -20 < 20 < bottom
    with pytest.raises(InvalidConfig, match="landmark 'nose' is taxel 35"):
        figures.tactile_map(GRID, axes, landmarks={"nose": 35})


def test_a_skin_that_is_no_grid_has_its_own_graph(axes):
    places = np.random.default_rng(0).normal(size=(6, 2))
    neighbours = [[0, 1], [1, 2], [2, 0], [3, 4]]
    figures.tactile_map(places, axes, true=2 * places, neighbours=neighbours, landmarks={"tip": 3}, unit="px")
    behind, learned = axes.get_lines()[0], axes.get_lines()[2]
    np.testing.assert_allclose(edges_drawn(behind), 2 * places[np.array(neighbours)])
    np.testing.assert_allclose(edges_drawn(learned), places[np.array(neighbours)])
    np.testing.assert_allclose(line(axes, "tip").get_xydata(), places[[3, 4]])
    assert axes.get_xlabel() == "x [px]"
    figures.tactile_map(np.c_[places, places, places][:, :4], axes, names=("a", "b", "c", "d"))


def test_each_unit_is_tied_to_where_its_posture_truly_is(axes):
    figures.posture_map(0.5 * GRID, GRID, axes, name="paper_mlp")
    ties = edges_drawn(line(axes, "from true to learned"))
    np.testing.assert_allclose(ties[:, 0], 1000 * GRID.reshape(-1, 2))
    np.testing.assert_allclose(ties[:, 1], 500 * GRID.reshape(-1, 2))
    np.testing.assert_allclose(line(axes, "paper's network").get_xydata(), 500 * GRID.reshape(-1, 2))
    assert axes.yaxis_inverted()
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [mm]", "y [mm]")
    hidden = GRID.copy()
    hidden[0, 0] = np.nan
    figures.posture_map(GRID, hidden, axes)


def test_learning_shows_mean_and_deviation_and_what_to_read_them_against(axes):
    figures.learning(STEPS, {"direct": [[9, 5, 1], [7, 3, 1]]}, axes, ylabel="error [taxels]", level=(20, "chance"))
    (bars,) = axes.containers
    np.testing.assert_allclose(bars.lines[0].get_ydata(), [8, 4, 1])
    ends = np.array(bars.lines[2][0].get_segments())[..., 1]
    np.testing.assert_allclose(ends, [[8 - 2**0.5, 8 + 2**0.5], [4 - 2**0.5, 4 + 2**0.5], [1, 1]])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("learning steps", "error [taxels]")
    assert [text.get_text() for text in axes.texts] == ["chance"]
    assert axes.get_ylim()[0] == 0
    assert axes.get_ylim()[1] >= 20, "the level is in sight"


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda ax: figures.tactile_map(GRID, ax, true=GRID[1:]), "true"),
        (lambda ax: figures.tactile_map(GRID[..., 0], ax), "places"),
        (lambda ax: figures.tactile_map(GRID[0], ax, neighbours=[[1, 2, 3]]), "neighbours"),
        (lambda ax: figures.posture_map(GRID[1:], GRID, ax), "shape"),
        (lambda ax: figures.posture_map(GRID, np.nan * GRID, ax), "finite"),
        (lambda ax: figures.learning(STEPS, {"a": [[1.0, 2.0]]}, ax), "'a'"),
    ],
)
def test_arrays_that_do_not_fit_are_named(axes, make, what):
    with pytest.raises(InvalidArray, match=what):
        make(axes)


# A skin laid flat -----------------------------------------------------------------------------------------------------


def test_what_is_flat_stays_as_it_is():
    x, z = np.meshgrid(np.linspace(0, 0.06, 7), np.linspace(0, 0.04, 5))
    sheet = np.stack([x, np.full_like(x, 0.3), z], -1).reshape(-1, 3)
    flat = flatten(sheet, grid_edges(5, 7), RIGHT_UP)
    np.testing.assert_allclose(flat, sheet[:, [0, 2]] - [0.03, 0.02], atol=1.5e-3)


def test_a_bent_sheet_is_unrolled_to_its_own_lengths():
    along, up = np.meshgrid(np.linspace(-1.4, 1.4, 29), np.linspace(-0.5, 0.5, 11))
    sheet = np.stack([np.sin(along), np.cos(along), up], -1).reshape(-1, 3)
    flat = flatten(sheet, grid_edges(11, 29), RIGHT_UP).reshape(11, 29, 2)
    assert np.ptp(flat[5, :, 0]) == pytest.approx(2.8, rel=0.02)
    assert np.ptp(flat[:, 14, 1]) == pytest.approx(1.0, rel=0.03)
    assert (np.diff(flat[5, :, 0]) > 0).all(), "right stays right"
    assert (np.diff(flat[:, 14, 1]) > 0).all(), "up stays up"


def test_pieces_that_nothing_joins_are_laid_side_by_side():
    x, z = (one.ravel() for one in np.meshgrid(np.linspace(0, 1, 4), np.linspace(0, 1, 3)))
    piece = np.stack([x, 0 * x, z], -1)
    edges = grid_edges(3, 4)
    flat = flatten(np.concatenate([piece + np.array([5, 0, 0]), piece]), np.concatenate([edges, edges + 12]), RIGHT_UP)
    assert flat[12:, 0].max() < flat[:12, 0].min(), "in their order from left to right"
    alone = flatten(piece[:2], np.empty((0, 2), dtype=int), RIGHT_UP)
    assert np.ptp(alone[:, 0]) > 0
