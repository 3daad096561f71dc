"""Laws of scores of neighbourhoods."""

import numpy as np
import pytest

from bodyimage_kin import metrics
from bodyimage_kin.errors import InvalidArray, InvalidConfig

GRID = np.stack(np.meshgrid(np.arange(9.0), np.arange(7.0)), axis=-1)


def ranks(points):
    """Rank of every other point by distance from each, 1 the nearest; loops alone."""
    n = len(points)
    found = np.zeros((n, n), dtype=int)
    for i in range(n):
        away = [float(np.sqrt(((points[i] - points[j]) ** 2).sum())) for j in range(n)]
        order = sorted((j for j in range(n) if j != i), key=away.__getitem__)
        for rank, j in enumerate(order, 1):
            found[i, j] = rank
    return found


def by_definition(map, true, k):
    """Share kept, trustworthiness and continuity as Venna and Kaski (2001) write them."""
    n, in_map, in_truth = len(map), ranks(map), ranks(true)
    kept, strangers, lost = 0, 0, 0
    for i in range(n):
        for j in range(n):
            if i == j:
                continue
            kept += in_map[i, j] <= k and in_truth[i, j] <= k
            strangers += in_truth[i, j] - k if in_map[i, j] <= k < in_truth[i, j] else 0
            lost += in_map[i, j] - k if in_truth[i, j] <= k < in_map[i, j] else 0
    scale = 2 / (n * k * (2 * n - 3 * k - 1))
    return kept / (n * k), 1 - scale * strangers, 1 - scale * lost


def three(map, true, k=6):
    return tuple(f(map, true, k) for f in (metrics.neighbours_kept, metrics.trustworthiness, metrics.continuity))


@pytest.mark.parametrize(("n", "k"), [(13, 6), (40, 6), (40, 1), (41, 20), (25, 3)])
def test_scores_are_those_of_the_definition(n, k):
    rng = np.random.default_rng(n * k)
    true = rng.normal(size=(n, 3))
    for noise in (0.1, 1.0, 10.0):
        map = true[:, :2] + noise * rng.normal(size=(n, 2))
        assert three(map, true, k) == pytest.approx(by_definition(map, true, k), abs=1e-12)


def test_a_similarity_keeps_everything_of_a_grid_ties_and_all():
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    for k in range(1, 12):
        assert three(0.013 * GRID @ turn + 5, GRID, k) == pytest.approx((1, 1, 1), abs=1e-12)
    assert three(GRID * [-1, 1], GRID) == pytest.approx((1, 1, 1))


def test_chance_and_collapse():
    rng = np.random.default_rng(0)
    true = rng.normal(size=(200, 3))
    shuffled = [three(metrics.permuted(true, seed), true) for seed in range(20)]
    assert np.mean(shuffled, axis=0) == pytest.approx([6 / 199, 0.5, 0.5], abs=0.02)
    # Everything in one place: all tie for the k places, so the map says no more than chance.
    kept, trusted, continued = three(np.zeros((200, 2)), true)
    assert kept == pytest.approx(6 / 199)
    assert trusted == pytest.approx(0.5, abs=0.02)
    assert continued == 1, "nobody is nearer in the map than a neighbour that all others tie with"


def test_a_fold_brings_strangers_in_and_a_tear_takes_neighbours_away():
    line = np.linspace(0, 1, 80)[:, None]
    folded = np.abs(line - 0.5)
    torn = line + 10 * (line > 0.5)
    swapped = np.where(line > 0.5, line - 0.5, line + 0.5)
    assert metrics.trustworthiness(folded, line) < 0.8 < 0.95 < metrics.continuity(folded, line)
    assert metrics.trustworthiness(torn, line) > 0.99
    assert metrics.continuity(swapped, line) < 0.99
    assert three(folded, line)[1:] == pytest.approx(three(line, folded)[:0:-1], abs=1e-3), "the roles exchanged"


def test_neither_scale_nor_place_nor_unit_counts():
    rng = np.random.default_rng(1)
    true, map = rng.normal(size=(2, 50, 2))
    assert three(map, true) == pytest.approx(three(1e-9 * map + 3e-9, 1e6 * true))
    order = rng.permutation(50)
    assert three(map[order], true[order]) == pytest.approx(three(map, true))


def test_taxels_without_a_place_are_left_out():
    rng = np.random.default_rng(2)
    true, map = rng.normal(size=(2, 50, 2))
    there = three(map[5:], true[5:])
    map[:3], true[3:5] = np.nan, np.inf
    assert three(map, true) == there
    assert three(map.reshape(10, 5, 2), true.reshape(10, 5, 2)) == there


def test_too_few_taxels_have_no_neighbourhood():
    rng = np.random.default_rng(3)
    true, map = rng.normal(size=(2, 12, 2))
    assert np.isnan(three(map[:6], true[:6])).all()
    kept, trusted, continued = three(map, true)
    assert np.isfinite(kept)
    assert np.isnan([trusted, continued]).all()
    assert np.isnan(three(np.nan * map, true)).all()


def test_bad_inputs_are_named():
    with pytest.raises(InvalidArray, match=r"map has shape \(3, 2\) but true \(4, 2\)"):
        metrics.neighbours_kept(np.zeros((3, 2)), np.zeros((4, 2)))
    with pytest.raises(InvalidConfig, match="k=0: give a whole number"):
        metrics.trustworthiness(GRID, GRID, 0)
