"""Maps over skins that are no grid: distances along a graph, several winners, intensities, a kernel that narrows."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.spatial
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin.body_image import BodyImage, PostureSOM, activation, expected_map, hebbian_map
from bodyimage_kin.errors import InvalidArray, InvalidConfig, InvalidRecording

STEPS, TAXELS = 60, 14
RNG = np.random.default_rng(0)
PLACES = np.concatenate([RNG.uniform(0.0, 0.05, (TAXELS, 2)), np.zeros((TAXELS, 1))], axis=1)
SKIN = bk.Skin.points(PLACES, np.tile([0.0, 0.0, 1.0], (TAXELS, 1)), link="l")
SOM = PostureSOM(RNG.normal(size=(2, 2, 2)), np.ones(2))
SETTINGS = {"posture_grid": (2, 2), "posture_som": SOM, "image_range": [[0.0, 1.0], [0.0, 1.0]], "snapshots": (0, 20)}


def recording(contacts: int = 3, intensity: bool = False) -> tuple[xr.Dataset, np.ndarray]:
    rng = np.random.default_rng(1)
    touched = np.stack([rng.permutation(TAXELS)[:contacts] for _ in range(STEPS)])
    touched[rng.random(touched.shape) < 0.3] = -1
    sample = ("trial", "time")
    felt = {"q": ((*sample, "joint"), rng.normal(size=(1, STEPS, 2))), "touched": ((*sample, "contact"), touched[None])}
    if intensity:
        felt["intensity"] = ((*sample, "contact"), rng.uniform(0.1, 5.0, (1, STEPS, contacts)))
    return xr.Dataset(felt), rng.random((1, STEPS, 2))


def walked(first, touched, intensity, targets, distances, gamma=40.0, end=1.0, kernel="squared"):
    """``w_i += alpha max_c(s_c h(d_ic)) (target - w_i)``, taxel by taxel; the map after every step."""
    weights, kept = first.copy(), [first.copy()]
    for step, (active, target) in enumerate(zip(touched, targets, strict=True)):
        share = step / (STEPS - 1)
        rate, width = 0.3 * (0.02 / 0.3) ** share, gamma * (end / gamma) ** share
        felt = np.flatnonzero(active >= 0)
        for taxel in range(len(weights) if len(felt) else 0):
            most = max(intensity[step, c] for c in felt)
            pulls = []
            for contact in felt:
                d = distances[active[contact], taxel]
                d = d * d if kernel == "squared" else d
                pulls.append(intensity[step, contact] / most * math.exp(-d / width))
            weights[taxel] += rate * max(pulls) * (target - weights[taxel])
        kept.append(weights.copy())
    return np.array(kept)


@pytest.mark.parametrize("kernel", ["squared", "plain"])
@pytest.mark.parametrize("intensity", [False, True])
@pytest.mark.parametrize("contacts", [1, 3])
def test_a_map_over_any_skin_learns_as_its_formula_says(contacts, intensity, kernel):
    exp, hand = recording(contacts, intensity)
    found = BodyImage.learn(exp, hand, skin=SKIN.distances, kernel=kernel, **SETTINGS)
    strength = exp["intensity"].values[0] if intensity else np.ones((STEPS, contacts))
    expected = walked(
        found.history["tactile_maps"][0], exp["touched"].values[0], strength, hand[0], SKIN.distances, kernel=kernel
    )
    for step, one in zip(found.history["steps"], found.history["tactile_maps"], strict=True):
        np.testing.assert_allclose(one, expected[step], rtol=1e-10)
    assert found.tactile_map.shape == (TAXELS, 2)
    counts = np.bincount(exp["touched"].values[exp["touched"].values >= 0], minlength=TAXELS)
    np.testing.assert_array_equal(found.touch_counts, counts)


def test_on_the_distances_of_a_grid_a_map_is_that_of_the_grid():
    exp, hand = recording(1)
    places = np.stack(np.divmod(np.arange(TAXELS), 7), 1)
    distances = scipy.spatial.distance.cdist(places, places)
    grid = BodyImage.learn(exp, hand, skin=(2, 7), silence=0.2, **SETTINGS)
    same = BodyImage.learn(exp, hand, skin=distances, gamma_final=40.0, silence=0.2, **SETTINGS)
    np.testing.assert_allclose(same.tactile_map, grid.tactile_map.reshape(-1, 2), rtol=1e-12)
    np.testing.assert_array_equal(same.touch_counts, grid.touch_counts)
    taxels = exp["touched"].values[..., 0]
    np.testing.assert_allclose(
        expected_map(PLACES, taxels, distances, 3.0), expected_map(PLACES, taxels, (2, 7), 3.0).reshape(-1, 3)
    )
    np.testing.assert_allclose(activation(5, distances, 3.0), activation(5, (2, 7), 3.0).ravel())
    one, other = (hebbian_map(exp, hand, skin=skin, cells=4) for skin in (distances, (2, 7)))
    np.testing.assert_allclose(one.weights, other.weights)


def test_of_a_skin_the_single_largest_cluster_wins_and_a_touch_without_one_teaches_nothing():
    line = np.arange(10)[:, None] * [0.01, 0.0, 0.0]
    skin = bk.Skin.points(line, np.tile([0.0, 0.0, 1.0], (10, 1)), link="l")
    touched = np.array([[0, 1, 9], [0, 1, -1], [0, 5, -1], [9, 0, 1], [-1, -1, 4]])
    sample = ("trial", "time")
    rng = np.random.default_rng(2)
    variables = {
        "q": ((*sample, "joint"), rng.normal(size=(1, 5, 2))),
        "touched": ((*sample, "contact"), touched[None]),
    }
    exp, hand = xr.Dataset(variables), rng.random((1, 5, 2))
    maps = {
        rule: BodyImage.learn(exp, hand, skin=skin, winners=rule, **SETTINGS | {"snapshots": range(5)})
        for rule in ("first", "all", "largest", "middle", None)
    }
    counts = {rule: one.touch_counts.tolist() for rule, one in maps.items()}
    assert counts["largest"] == counts[None] == [3, 3, 0, 0, 1, 0, 0, 0, 0, 0]
    assert counts["all"] == [4, 3, 0, 0, 1, 1, 0, 0, 0, 2]
    assert counts["first"] == [3, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    # Of two that are as near to the middle, the first.
    assert counts["middle"] == [3, 0, 0, 0, 1, 0, 0, 0, 0, 0]
    history = maps["largest"].history["tactile_maps"]
    np.testing.assert_array_equal(history[2], history[3])
    assert (history[3] != history[4]).any()


def test_a_hand_that_covers_many_taxels_draws_the_map_together_unless_their_middle_wins():
    line = np.arange(15)[:, None] * [0.01, 0.0, 0.0]
    skin = bk.Skin.points(line, np.tile([0.0, 0.0, 1.0], (15, 1)), link="l")
    middle = np.random.default_rng(0).integers(3, 12, 400)
    touched = middle[:, None] + np.arange(-3, 4)
    q = np.random.default_rng(1).normal(size=(400, 2))
    exp = bk.recording(q=q, touched=touched, joints=["a", "b"], order="scattered")
    hand = np.stack([line[middle, 0], np.zeros(400)], axis=1)[None]
    spans = []
    for rule in ("largest", "middle"):
        found = BodyImage.learn(exp, hand, skin=skin, winners=rule, steps=4000, **SETTINGS | {"snapshots": ()})
        spans.append(np.ptp(found.tactile_map[3:12, 0]) / 0.08)
    assert spans[0] < 0.7
    assert spans[1] > 0.9
    np.testing.assert_array_equal(np.flatnonzero(found.touch_counts), np.unique(middle))


def test_so_many_samples_are_drawn_as_from_a_set():
    exp, hand = recording(1)
    maps = [BodyImage.learn(exp, hand, skin=SKIN.distances, steps=500, seed=seed, **SETTINGS) for seed in (0, 0, 1)]
    assert maps[0].history["steps"][-1] == 500
    np.testing.assert_array_equal(maps[0].tactile_map, maps[1].tactile_map)
    assert (maps[0].touch_counts != maps[2].touch_counts).any()
    touches = (exp["touched"].values >= 0).mean()
    assert maps[0].touch_counts.sum() == pytest.approx(500 * touches, rel=0.15)


def test_what_does_not_fit_is_refused():
    exp, hand = recording(1)
    for skin, error, match in (
        (np.ones((3, 4)), InvalidArray, "must be"),
        (-SKIN.distances, InvalidArray, "not negative"),
        (np.triu(SKIN.distances), InvalidArray, "symmetric"),
        (SKIN.distances[:5, :5], InvalidRecording, "the skin ends at 4"),
    ):
        with pytest.raises(error, match=match):
            BodyImage.learn(exp, hand, skin=skin, **SETTINGS)
    for settings, match in (
        ({"skin": (2, 7), "winners": "all"}, "a grid has one winner"),
        ({"skin": SKIN.distances, "winners": "largest"}, "give a Skin in place of distances"),
        ({"skin": SKIN.distances, "winners": "middle"}, "give a Skin in place of distances"),
        ({"skin": SKIN, "winners": "most"}, "winners='most'"),
        ({"skin": SKIN, "steps": 0}, "steps=0"),
    ):
        with pytest.raises(InvalidConfig, match=match):
            BodyImage.learn(exp, hand, **settings, **SETTINGS)
