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
