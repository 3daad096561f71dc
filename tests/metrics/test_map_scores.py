"""Laws of the map scores."""

import numpy as np
import pytest
import torch

from bodyimage_kin import metrics
from bodyimage_kin.body.cameras import Tracker, VirtualScreen
from bodyimage_kin.errors import InvalidArray

ROWS, COLUMNS = np.mgrid[0:21, 0:21]
TRUE = 0.005 * np.stack([COLUMNS, ROWS], axis=-1)
MIRRORED = TRUE * [-1, 1]


def rotated(points, angle):
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def test_topological_error_at_its_ends():
    assert metrics.topological_error(TRUE) == 0
    assert metrics.topological_error(-TRUE) == 440
    assert metrics.topological_error(np.zeros_like(TRUE)) == 0


def test_topological_error_by_chance_is_about_320():
    rng = np.random.default_rng(0)
    found = [metrics.topological_error(rng.uniform(size=(21, 21, 2))) for _ in range(200)]
    assert np.mean(found) == pytest.approx(320, abs=3)


def test_a_taxel_counts_once():
    places = np.array([[[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0], [2.0, 1.0]]])  # top left: wrong right and below
    assert metrics.topological_error(places) == 1
    places[0, 1, 1] = 3.0  # now the top right one is above nothing
    assert metrics.topological_error(places) == 2


def test_a_missing_taxel_cannot_lower_the_topological_error():
    places = TRUE.copy()
    places[5, 5] = np.nan
    assert metrics.topological_error(places) == 3  # itself, the one to its left, the one above
    assert metrics.folded_cells(places) == 4


def test_folded_cells():
    assert metrics.folded_cells(TRUE) == 0
    assert metrics.folded_cells(rotated(TRUE, 2.0) * 0.1 - 3) == 0
    assert metrics.folded_cells(MIRRORED) == 400
    assert metrics.folded_cells(0 * TRUE) == 400
    places = TRUE.copy()
    # Past its lower right neighbour: the cell there turns over, the two beside it become reflex, the upper left one
    # only stretches.
    places[10, 10] += 0.006
    assert metrics.folded_cells(places) == 3


def test_span_is_the_slope_per_axis_and_does_not_see_the_place():
    np.testing.assert_allclose(metrics.span(TRUE * [0.3, 0.6] + 1, TRUE), [0.3, 0.6])
    np.testing.assert_allclose(metrics.span(0 * TRUE + 0.1, TRUE), [0, 0])
    np.testing.assert_allclose(metrics.span(MIRRORED, TRUE), [-1, 1])


def test_span_weighted_by_hand():
    true, places = [[0.0], [1.0], [2.0]], [[0.0], [1.0], [5.0]]
    # Means 4/3 and 3 under weights 1, 0, 2: covariance 2/3 * 10/3 ... slope = 5/2 through the two points left.
    np.testing.assert_allclose(metrics.span(places, true, [1, 0, 2]), [2.5])
    np.testing.assert_allclose(metrics.span(places, true, np.array([True, True, False])), [1])
    # Repeating a taxel is the same as doubling its weight.
    twice = metrics.span([*places, places[2]], [*true, true[2]])
    np.testing.assert_allclose(metrics.span(places, true, [1, 1, 2]), twice)


@pytest.mark.parametrize("angle", [0.0, 0.5, -2.5])
def test_procrustes_finds_a_similarity(angle):
    fit = metrics.procrustes(0.7 * rotated(TRUE, angle) + [3, -1], TRUE)
    assert fit.disparity == pytest.approx(0, abs=1e-12)
    assert fit.scale == pytest.approx(0.7)
    np.testing.assert_allclose(fit.rotation, rotated(np.eye(2), angle).T, atol=1e-12)


def test_procrustes_does_not_reflect():
    fit = metrics.procrustes(MIRRORED, TRUE)
    assert fit.disparity == pytest.approx(1)
    assert fit.scale == pytest.approx(0, abs=1e-12)
    assert metrics.procrustes([[0.0], [-1.0]], [[0.0], [1.0]]).disparity == 1


def test_procrustes_by_hand():
    # A stretched cross: A rows (+-1, 0), (0, +-1); B the same with y halved. B'A = diag(2, 1), |A|^2 = 4, |B|^2 = 2.5.
    A = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    fit = metrics.procrustes(A * [1, 0.5], A)
    assert fit.scale == pytest.approx(3 / 4)
    assert fit.disparity == pytest.approx(1 - 9 / 10)
    mirrored = metrics.procrustes(A * [1, -0.5], A)
    assert mirrored.scale == pytest.approx(1 / 4)
    assert mirrored.disparity == pytest.approx(1 - 1 / 10)
    np.testing.assert_allclose(mirrored.rotation, np.eye(2), atol=1e-12)


def test_procrustes_is_the_least_squares_fit():
    rng = np.random.default_rng(1)
    A, B, weights = rng.normal(size=(30, 3)), rng.normal(size=(30, 3)), rng.integers(1, 5, size=30)
    fit = metrics.procrustes(B, A, weights)
    assert np.linalg.det(fit.rotation) == pytest.approx(1)
    A, B = (a - np.average(a, axis=0, weights=weights) for a in (A, B))
    left = np.average(((B - fit.scale * A @ fit.rotation.T) ** 2).sum(-1), weights=weights)
    assert left / np.average((B**2).sum(-1), weights=weights) == pytest.approx(fit.disparity)


def test_undefined_is_nan():
    collapsed = metrics.procrustes(0 * TRUE + 0.1, TRUE)
    assert np.isnan(collapsed.disparity)
    assert collapsed.scale == 0
    assert np.isnan(metrics.procrustes(TRUE, 0 * TRUE).scale)
    assert np.isnan(metrics.procrustes(TRUE * np.nan, TRUE).disparity)
    assert np.isnan(metrics.span(TRUE, 0 * TRUE)).all()
    assert np.isnan(metrics.span(TRUE, TRUE, np.zeros((21, 21), bool))).all()


def test_scores_of_a_shrunken_map():
    found = metrics.scores(0.5 * TRUE, TRUE)
    np.testing.assert_allclose(found.pop("span"), [0.5, 0.5])
    kept = dict.fromkeys(("neighbours_kept", "trustworthiness", "continuity"), 1)
    of_grid = {"topological_error": 0, "folded_cells": 0}
    assert found == pytest.approx({**of_grid, **kept, "disparity": 0, "scale": 0.5}, abs=1e-12)


@pytest.mark.parametrize("m", [1, 2, 3, 4])
def test_scores_of_any_skin_and_any_image(m):
    rng = np.random.default_rng(m)
    true = rng.normal(size=(60, m))
    map = 0.4 * true @ np.linalg.qr(rng.normal(size=(m, m)))[0] + rng.normal(size=m)
    if np.linalg.det(np.linalg.lstsq(true - true.mean(0), map - map.mean(0))[0]) < 0:
        map[:, 0] = 2 * map[:, 0].mean() - map[:, 0]
    found = metrics.scores(map, true)
    assert found.pop("span").shape == (m,)
    kept = dict.fromkeys(("neighbours_kept", "trustworthiness", "continuity"), 1)
    assert found == pytest.approx({**kept, "disparity": 0, "scale": 0.4}, abs=1e-9)
    # A mirrored map keeps every neighbour and no shape.
    mirrored = metrics.scores(map * ([-1] + [1] * (m - 1)), true)
    assert mirrored["neighbours_kept"] == 1
    assert mirrored["disparity"] > (0.05 if m > 1 else 0.99)
    with pytest.raises(InvalidArray, match=r"of grids, \(rows, columns, 2\): of other skins ask for neighbours_kept"):
        metrics.topological_error(map)
    with pytest.raises(InvalidArray, match="of grids"):
        metrics.folded_cells(map)


def test_scores_of_taught_taxels_alone():
    rng = np.random.default_rng(0)
    true, taught = rng.normal(size=(60, 2)), rng.uniform(size=60) < 0.7
    map = np.where(taught[:, None], true, rng.normal(size=(60, 2)))
    assert metrics.scores(map, true)["neighbours_kept"] < 0.8
    found = metrics.scores(map, true, taught)
    assert (found["neighbours_kept"], found["trustworthiness"], found["disparity"]) == pytest.approx((1, 1, 0))


def test_error_in_space_undoes_the_projection():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(40, 3)) * [0.05, 0.05, 0.02] + [0, 0, 0.1]
    screen = VirtualScreen(0.04)
    aside = rng.normal(size=(40, 3)) * [0.01, 0.01, 0]
    moved = screen.project(torch.from_numpy(points + aside)).numpy()
    # Exact across the axis, however far off: a plane at one depth is seen to scale.
    np.testing.assert_allclose(metrics.error_in_space(moved, points, screen), np.linalg.norm(aside, axis=-1))
    # Along the line of sight nothing is seen.
    there = metrics.error_in_space(screen.project(torch.from_numpy(2 * points)).numpy(), points, screen)
    np.testing.assert_allclose(there, 0, atol=1e-15)
    moved[3] = np.nan
    points[4, 2] = -1
    found = metrics.error_in_space(moved.reshape(8, 5, 2), points.reshape(8, 5, 3), screen)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found)), [3, 4])
    with pytest.raises(InvalidArray, match=r"give \(\*taxels, 2\) \[m\]"):
        metrics.error_in_space(moved, points[:, :2], screen)


def test_error_in_space_of_a_tracker_is_the_distance():
    rng = np.random.default_rng(0)
    points, map = rng.normal(size=(2, 7, 3))
    np.testing.assert_allclose(metrics.error_in_space(map, points, Tracker()), np.linalg.norm(map - points, axis=-1))


def test_shuffled_touches_are_the_same_touches_at_other_times():
    rng = np.random.default_rng(0)
    touched = np.full((2, 300, 3), -1)
    contact = rng.uniform(size=(2, 300)) < 0.6
    touched[contact, 0] = rng.integers(0, 50, contact.sum())
    touched[contact & (rng.uniform(size=(2, 300)) < 0.3), 1] = 7
    before = touched.copy()
    found = metrics.shuffled_touches(touched, seed=1)
    np.testing.assert_array_equal(touched, before)
    np.testing.assert_array_equal((found >= 0).any(-1), contact)
    assert sorted(map(tuple, found.reshape(-1, 3).tolist())) == sorted(map(tuple, touched.reshape(-1, 3).tolist()))
    assert (found == touched)[contact].all(-1).mean() < 0.1
    np.testing.assert_array_equal(found, metrics.shuffled_touches(touched, seed=1))
    assert not np.array_equal(found, metrics.shuffled_touches(touched, seed=2))
    for wrong in (1.0 * touched, touched >= 0, np.int64(3)):
        with pytest.raises(InvalidArray, match="touched"):
            metrics.shuffled_touches(wrong, seed=0)


def test_bad_inputs_are_named():
    with pytest.raises(InvalidArray, match=r"\(rows, columns, 2\)"):
        metrics.topological_error(np.zeros((3, 3, 3)))
    with pytest.raises(InvalidArray, match="weights have shape"):
        metrics.span(TRUE, TRUE, np.ones(441))
    with pytest.raises(InvalidArray, match="not negative"):
        metrics.span(TRUE, TRUE, -np.ones((21, 21)))


def test_permuted_labels_return_to_chance():
    found = [metrics.permuted(TRUE, seed) for seed in range(100)]
    assert all(set(map(tuple, places.reshape(-1, 2))) == set(map(tuple, TRUE.reshape(-1, 2))) for places in found)
    # A little below 320: places of one line tie, and a tie is in order.
    assert np.mean([metrics.topological_error(places) for places in found]) == pytest.approx(312, abs=8)
    assert np.abs(np.mean([metrics.span(places, TRUE) for places in found])) < 0.02
    assert np.mean([metrics.procrustes(places, TRUE).disparity for places in found]) > 0.98
    np.testing.assert_array_equal(metrics.permuted(TRUE, 3), found[3])


def test_quantization_error_by_hand():
    units = [[[0.0, 0.0], [3.0, 4.0]]]
    assert metrics.quantization_error(units, [[0.0, 0.0], [3.0, 5.0], [np.nan, 0.0]]) == 0.5
    assert metrics.quantization_error(1e8 + TRUE, 1e8 + TRUE.reshape(-1, 2)) == 0
    assert np.isnan(metrics.quantization_error(units, np.full((2, 2), np.nan)))


def test_topographic_error_by_hand():
    line = np.array([[[0.0], [1.0], [2.0], [0.4]]])
    # 0.1: units 0 and 3, apart; 1.1: 1 and 3, apart; 1.9: 2 and 1; 0.5: 3 and then 0 or 1, equally near, so 0: apart.
    assert metrics.topographic_error(line, [[0.1], [1.9]]) == 0.5
    assert metrics.topographic_error(line, [[0.1], [1.9], [1.1], [0.75]]) == 0.75


def test_diagonal_units_are_neighbours():
    square = np.array([[[0.0], [9.0]], [[9.0], [1.0]]])
    assert metrics.topographic_error(square, [[0.4]]) == 0


def test_topographic_error_at_its_ends():
    samples = np.random.default_rng(0).uniform(0, 0.1, size=(5000, 2))
    assert metrics.topographic_error(TRUE, samples) == 0
    assert metrics.topographic_error(metrics.permuted(TRUE, 0), samples) > 0.9
    assert metrics.topographic_error(0 * TRUE, samples) == 0
    assert np.isnan(metrics.topographic_error([[[0.0]]], [[1.0]]))
    with pytest.raises(InvalidArray, match=r"\(rows, columns, d\)"):
        metrics.topographic_error(TRUE, samples[:, :1])
