"""Laws of the map scores."""

import numpy as np
import pytest

from bodyimage_kin import metrics
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
    fit = metrics.procrustes(TRUE, 0.7 * rotated(TRUE, angle) + [3, -1])
    assert fit.disparity == pytest.approx(0, abs=1e-12)
    assert fit.scale == pytest.approx(0.7)
    np.testing.assert_allclose(fit.rotation, rotated(np.eye(2), angle).T, atol=1e-12)


def test_procrustes_does_not_reflect():
    fit = metrics.procrustes(TRUE, MIRRORED)
    assert fit.disparity == pytest.approx(1)
    assert fit.scale == pytest.approx(0, abs=1e-12)
    assert metrics.procrustes([[0.0], [1.0]], [[0.0], [-1.0]]).disparity == 1


def test_procrustes_by_hand():
    # A stretched cross: A rows (+-1, 0), (0, +-1); B the same with y halved. B'A = diag(2, 1), |A|^2 = 4, |B|^2 = 2.5.
    A = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    fit = metrics.procrustes(A, A * [1, 0.5])
    assert fit.scale == pytest.approx(3 / 4)
    assert fit.disparity == pytest.approx(1 - 9 / 10)
    mirrored = metrics.procrustes(A, A * [1, -0.5])
    assert mirrored.scale == pytest.approx(1 / 4)
    assert mirrored.disparity == pytest.approx(1 - 1 / 10)
    np.testing.assert_allclose(mirrored.rotation, np.eye(2), atol=1e-12)


def test_procrustes_is_the_least_squares_fit():
    rng = np.random.default_rng(1)
    A, B, weights = rng.normal(size=(30, 3)), rng.normal(size=(30, 3)), rng.integers(1, 5, size=30)
    fit = metrics.procrustes(A, B, weights)
    assert np.linalg.det(fit.rotation) == pytest.approx(1)
    A, B = (a - np.average(a, axis=0, weights=weights) for a in (A, B))
    left = np.average(((B - fit.scale * A @ fit.rotation.T) ** 2).sum(-1), weights=weights)
    assert left / np.average((B**2).sum(-1), weights=weights) == pytest.approx(fit.disparity)


def test_undefined_is_nan():
    collapsed = metrics.procrustes(TRUE, 0 * TRUE + 0.1)
    assert np.isnan(collapsed.disparity)
    assert collapsed.scale == 0
    assert np.isnan(metrics.procrustes(0 * TRUE, TRUE).scale)
    assert np.isnan(metrics.procrustes(TRUE, TRUE * np.nan).disparity)
    assert np.isnan(metrics.span(TRUE, 0 * TRUE)).all()
    assert np.isnan(metrics.span(TRUE, TRUE, np.zeros((21, 21), bool))).all()


def test_scores_of_a_shrunken_map():
    found = metrics.scores(0.5 * TRUE, TRUE)
    np.testing.assert_allclose(found.pop("span"), [0.5, 0.5])
    assert found == pytest.approx({"topological_error": 0, "folded_cells": 0, "disparity": 0, "scale": 0.5}, abs=1e-12)


def test_bad_inputs_are_named():
    with pytest.raises(InvalidArray, match=r"\(rows, columns, 2\)"):
        metrics.topological_error(np.zeros((3, 3, 3)))
    with pytest.raises(InvalidArray, match="weights have shape"):
        metrics.span(TRUE, TRUE, np.ones(441))
    with pytest.raises(InvalidArray, match="not negative"):
        metrics.span(TRUE, TRUE, -np.ones((21, 21)))


LANDMARKS = {"left_eye": 105, "right_eye": 115, "nose": 215, "mouth": 325}  # rows 5, 5, 10, 15; columns 0, 10, 5, 10


def test_landmark_relations_are_those_of_the_truth():
    found = metrics.landmark_relations(TRUE, LANDMARKS)
    assert all(found.values())
    assert "left_eye above nose" in found
    assert "left_eye left of right_eye" in found
    assert not {"left_eye above right_eye", "right_eye above left_eye", "nose above left_eye"} & set(found)
    assert found == metrics.landmark_relations(TRUE, LANDMARKS, true=TRUE + 1e-12)
    assert found == metrics.landmark_relations(TRUE, dict(reversed(LANDMARKS.items())))


def test_landmark_relations_that_a_map_loses():
    mirrored = metrics.landmark_relations(MIRRORED, LANDMARKS)
    assert not any(kept for relation, kept in mirrored.items() if "left of" in relation)
    assert all(kept for relation, kept in mirrored.items() if "above" in relation)
    assert not any(metrics.landmark_relations(0 * TRUE, LANDMARKS).values())
    assert not any(metrics.landmark_relations(np.nan * TRUE, LANDMARKS).values())
    with pytest.raises(InvalidArray, match="'nose' is taxel 441"):
        metrics.landmark_relations(TRUE, {"nose": 441})


def test_permuted_labels_return_to_chance():
    found = [metrics.permuted(TRUE, seed) for seed in range(100)]
    assert all(set(map(tuple, places.reshape(-1, 2))) == set(map(tuple, TRUE.reshape(-1, 2))) for places in found)
    # A little below 320: places of one line tie, and a tie is in order.
    assert np.mean([metrics.topological_error(places) for places in found]) == pytest.approx(312, abs=8)
    assert np.abs(np.mean([metrics.span(places, TRUE) for places in found])) < 0.02
    assert np.mean([metrics.procrustes(TRUE, places).disparity for places in found]) > 0.98
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
