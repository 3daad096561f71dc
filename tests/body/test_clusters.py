"""What was felt at once: clusters by single linkage, the same as a library of graphs finds."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse
import scipy.spatial

from bodyimage_kin.body.clusters import clusters, middle, touched_place

RNG = np.random.default_rng(0)
PLACES = RNG.uniform(0.0, 0.1, (200, 3)) * [1.0, 1.0, 0.1]


@pytest.mark.parametrize("count", [0, 1, 2, 5, 30, 150])
def test_clusters_are_the_connected_components_the_largest_first(count):
    active = RNG.permutation(200)[:count]
    found = clusters(PLACES, np.concatenate([active, active[:2]]))
    assert sorted(np.concatenate([*found, []]).tolist()) == sorted(active.tolist())
    assert [(-len(one), one[0]) for one in found] == sorted((-len(one), one[0]) for one in found)
    if count:
        taxels = np.sort(active)
        near = scipy.spatial.distance.cdist(PLACES[taxels], PLACES[taxels]) < 0.015
        number, label = scipy.sparse.csgraph.connected_components(near.astype(float))
        assert len(found) == number
        assert {tuple(one) for one in found} == {tuple(taxels[label == one]) for one in range(number)}


def test_a_touch_in_two_places_as_large_is_in_none_and_a_place_has_a_middle():
    line = np.arange(12)[:, None] * [0.01, 0.0, 0.0]
    assert touched_place(line, np.array([0, 1, 8, 9])) is None
    assert touched_place(line, np.array([-1, -1])) is None
    members = touched_place(line, np.array([-1, 1, 8, 9, 10]))
    np.testing.assert_array_equal(members, [8, 9, 10])
    assert middle(line[members]) == 1
