"""Laws of the maps that make up a body image."""

import json

import numpy as np
import pytest
import torch
import xarray as xr

from bodyimage_kin.body_image import (
    BodyImage,
    PostureSOM,
    activation,
    expected_map,
    hebbian_map,
)
from bodyimage_kin.errors import InvalidArray, InvalidConfig, InvalidRecording

GRID = (21, 21)
DIMS = ("trial", "time", "axis")
PLACES = np.stack(np.meshgrid(np.arange(21.0), np.arange(21.0)), axis=-1).reshape(-1, 2) * 0.005


def experience(taxels, q=None, seen=None):
    taxels = np.atleast_2d(np.asarray(taxels))
    q = np.random.default_rng(0).normal(size=(*taxels.shape, 3)) if q is None else q
    seen = np.full((*taxels.shape, 2), np.nan) if seen is None else seen
    touched = (("trial", "time", "contact"), taxels[..., None])
    return xr.Dataset({"q": (("trial", "time", "joint"), q), "touched": touched, "hand_image": (DIMS, seen)})


@pytest.fixture(scope="module")
def sight():
    """Uniform touches seen perfectly."""
    taxels = np.random.default_rng(1).integers(0, 441, 8000)
    return experience(taxels), PLACES[taxels][None]


def small(exp, hand, **settings):
    chosen = {"skin": (2, 2), "posture_grid": (2, 2), "silence": 0.0, "image_range": np.array([[0.0, 1.0]] * 2)}
    return BodyImage.learn(exp, hand, **{**chosen, **settings})


@pytest.mark.parametrize(("kernel", "diagonal"), [("squared", np.exp(-1.0)), ("plain", np.exp(-np.sqrt(2.0) / 2.0))])
def test_two_steps_by_hand(kernel, diagonal):
    # gamma = 2: a neighbour is at d = 1, the diagonal one at d = sqrt 2; alpha = 0.1.
    beside = np.exp(-0.5)
    body = small(
        experience([0, 3]), np.array([[[1.0, 2.0], [3.0, 4.0]]]),
        kernel=kernel, gamma=2.0, alpha="constant", initial_map=np.zeros((2, 2, 2)), snapshots=(0, 1),
    )  # fmt: skip
    first = 0.1 * np.array([1.0, beside, beside, diagonal])
    second = 0.1 * np.array([diagonal, beside, beside, 1.0])
    x = first * 1.0 + second * (3.0 - first * 1.0)
    y = first * 2.0 + second * (4.0 - first * 2.0)
    np.testing.assert_array_equal(body.history["steps"], [0, 1, 2])
    np.testing.assert_array_equal(body.history["tactile_maps"][0], 0.0)
    np.testing.assert_allclose(body.history["tactile_maps"][1, ..., 1].ravel(), first * 2.0, rtol=1e-15)
    np.testing.assert_allclose(body.tactile_map.reshape(4, 2), np.stack([x, y], axis=-1), rtol=1e-15)
    np.testing.assert_array_equal(body.touch_counts, [1, 0, 0, 1])


def test_learning_rates_by_hand():
    # A kernel this narrow leaves all but the winner alone.
    taxels, hand = [0, 0, 0], np.full((1, 3, 2), 1.0)
    start = {"initial_map": np.zeros((2, 2, 2)), "gamma": 1e-3}

    def remaining(alpha):
        return 1.0 - small(experience(taxels), hand, alpha=alpha, **start).tactile_map[0, 0, 0]

    assert remaining("constant") == pytest.approx(0.9**3)
    assert remaining("geometric") == pytest.approx(0.7 * (1 - np.sqrt(0.3 * 0.02)) * 0.98)
    varied = np.array([[[1.0] * 2, [4.0] * 2, [7.0] * 2]])
    mean = small(experience(taxels), varied, alpha="per_visit", **start).tactile_map[0, 0]
    np.testing.assert_allclose(mean, 4.0)


def test_annealing_by_hand():
    body = small(
        experience([0, 0, 0]), np.ones((1, 3, 2)), alpha="constant", gamma=4.0, gamma_final=1.0,
        initial_map=np.zeros((2, 2, 2)), snapshots=range(3),
    )  # fmt: skip
    remaining = np.cumprod([1.0, *(1 - 0.1 * np.exp(-1 / gamma) for gamma in (4.0, 2.0, 1.0))])
    np.testing.assert_allclose(1 - body.history["tactile_maps"][:, 0, 1, 0], remaining, rtol=1e-14)


def test_the_kernel_alone_shrinks_the_map_and_perfect_sight_learns_that_map(sight):
    exp, hand = sight
    for kernel, slope, extent in (("squared", 0.734, 0.67), ("plain", 0.0774, 0.075)):
        every = expected_map(PLACES, np.arange(441), kernel=kernel).reshape(-1, 2)
        learned = BodyImage.learn(exp, hand, kernel=kernel, silence=0.0).tactile_map.reshape(-1, 2)
        for axis in range(2):
            assert np.polyfit(PLACES[:, axis], every[:, axis], 1)[0] == pytest.approx(slope, rel=2e-3)
            assert np.ptp(every[:, axis]) / np.ptp(PLACES[:, axis]) == pytest.approx(extent, rel=1e-2)
            assert np.polyfit(PLACES[:, axis], learned[:, axis], 1)[0] == pytest.approx(slope, rel=0.1)


def test_expected_map_is_the_kernel_average():
    rng = np.random.default_rng(0)
    places, taxels = rng.normal(size=(6, 3)), np.array([0, 4, 4, -1, 5])
    for kernel in ("squared", "plain"):
        result = expected_map(places, taxels, (2, 3), 1.5, kernel).reshape(-1, 3)
        for unit in range(6):
            pull = np.array([activation(t, (2, 3), 1.5, kernel).ravel()[unit] for t in (0, 4, 4, 5)])
            np.testing.assert_allclose(result[unit], pull @ places[[0, 4, 4, 5]] / pull.sum(), rtol=1e-13)
    assert np.isnan(expected_map(places, [-1], (2, 3))).all()
    places[1] = np.nan
    assert np.isfinite(expected_map(places, taxels, (2, 3))).all(), "an untouched taxel's place plays no part"


def test_activation_by_hand():
    rows, columns = np.mgrid[:3, :4]
    squared = (rows - 1) ** 2 + (columns - 2) ** 2
    np.testing.assert_allclose(activation(6, (3, 4), 5.0), np.exp(-squared / 5.0), rtol=1e-15)
    np.testing.assert_allclose(activation(6, (3, 4), 5.0, "plain"), np.exp(-np.sqrt(squared) / 5.0), rtol=1e-15)


def test_silence_skips_its_share_of_touches(sight):
    exp, hand = sight
    counts = [BodyImage.learn(exp, hand, seed=seed, silence=0.2).touch_counts.sum() for seed in range(3)]
    # Binomial(8000, 0.8): a standard deviation is 36.
    assert all(abs(count - 6400) < 150 for count in counts)
    assert len(set(counts)) == 3
    nothing = BodyImage.learn(exp, hand, silence=1.0)
    assert nothing.touch_counts.sum() == 0
    np.testing.assert_array_equal(nothing.history["tactile_maps"], nothing.history["tactile_maps"][:1].repeat(7, 0))


def test_silent_taxels_do_not_learn_while_others_do():
    exp, hand = experience(np.zeros(4000, int)), np.ones((1, 4000, 2))
    start = {"initial_map": np.zeros((2, 2, 2)), "alpha": "constant", "snapshots": range(4000)}
    body = small(exp, hand, silence=0.2, silence_mode="taxel", **start)
    assert body.touch_counts.sum() == 4000
    moved = (np.diff(body.history["tactile_maps"][:60, ..., 0], axis=0) > 0).reshape(-1, 4)
    assert 0.7 < moved.mean() < 0.9
    assert not (moved == moved[:, :1]).all(), "each taxel is silent by itself"


def test_no_touch_and_no_estimate_teach_nothing_but_count():
    taxels = np.array([[0, -1, 3, 1, 2]])
    hand = np.random.default_rng(0).random((1, 5, 2))
    hand[0, 2, 0] = np.nan
    body = small(experience(taxels), hand, snapshots=range(6))
    maps = body.history["tactile_maps"]
    same = [np.array_equal(maps[i], maps[i + 1]) for i in range(5)]
    assert same == [False, True, True, False, False]
    np.testing.assert_array_equal(body.history["steps"], range(6))
    maps = body.history["posture_maps"]
    same = [np.array_equal(maps[i], maps[i + 1]) for i in range(5)]
    assert same == [False, True, True, False, False]
    np.testing.assert_array_equal(body.touch_counts, [1, 1, 1, 0])


def test_padded_samples_are_no_steps_and_change_nothing():
    rng = np.random.default_rng(0)
    taxels, q, hand = rng.integers(0, 4, (1, 9)), rng.normal(size=(1, 9, 3)), rng.random((1, 9, 2))
    short = small(experience(taxels, q), hand)
    taxels, hand = np.pad(taxels, ((0, 1), (2, 3)), constant_values=-1), np.pad(hand, ((0, 1), (2, 3), (0, 0)))
    q = np.pad(q, ((0, 1), (2, 3), (0, 0)), constant_values=np.nan)
    padded = small(experience(taxels, q), hand)
    np.testing.assert_array_equal(padded.history["steps"], [0, 9])
    np.testing.assert_array_equal(padded.tactile_map, short.tactile_map)
    np.testing.assert_array_equal(padded.posture_map, short.posture_map)


def test_the_seed_decides_everything(sight):
    exp, hand = (part[:, :500] if isinstance(part, np.ndarray) else part.isel(time=slice(500)) for part in sight)
    one, same, other = (BodyImage.learn(exp, hand, seed=seed, silence=0.2) for seed in (4, 4, 5))
    for name in ("tactile_map", "postures", "posture_map", "touch_counts"):
        np.testing.assert_array_equal(getattr(one, name), getattr(same, name))
        assert not np.array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_array_equal(one.history["steps"], [0, 500])


def test_initial_weights_alone_can_vary(sight):
    exp, hand = (part[:, :500] if isinstance(part, np.ndarray) else part.isel(time=slice(500)) for part in sight)
    one = BodyImage.learn(exp, hand)
    other = BodyImage.learn(exp, hand, initial_map=np.zeros((21, 21, 2)))
    np.testing.assert_array_equal(one.touch_counts, other.touch_counts)
    np.testing.assert_array_equal(one.posture_map, other.posture_map)
    assert not np.array_equal(one.tactile_map, other.tactile_map)


def test_initial_weights_span_the_experienced_range_else_the_estimated():
    taxels, hand = np.zeros((1, 50), int), np.random.default_rng(0).random((1, 50, 2))
    seen = np.full((1, 50, 2), np.nan)

    def bounds(exp, **settings):
        start = BodyImage.learn(exp, hand, **settings).history["tactile_maps"][0].reshape(-1, 2)
        return np.stack([start.min(0), start.max(0)], axis=1)

    estimated = np.stack([hand[0].min(0), hand[0].max(0)], axis=1)
    np.testing.assert_allclose(bounds(experience(taxels, seen=seen)), estimated, atol=0.02)
    seen[0, :2] = [[5.0, -3.0], [7.0, -2.0]]
    np.testing.assert_allclose(bounds(experience(taxels, seen=seen)), [[5, 7], [-3, -2]], atol=0.03)
    given = np.array([[2.0, 3.0], [8.0, 9.0]])
    np.testing.assert_allclose(bounds(experience(taxels, seen=seen), image_range=given), given, atol=0.02)


def test_three_image_axes():
    hand = np.random.default_rng(0).random((1, 20, 3))
    exp = experience(np.arange(20) % 4)
    body = BodyImage.learn(exp.drop_vars("hand_image"), hand, skin=(2, 2), posture_grid=(3, 2))
    assert body.tactile_map.shape == (2, 2, 3)
    assert body.posture_map.shape == (3, 2, 3)
    assert body.postures.shape == (3, 2, 3)
    assert hebbian_map(exp, hand, skin=(2, 2), cells=4).cells.shape == (64, 3)


def test_a_data_array_in_any_order_is_as_good_as_an_array(sight):
    exp, hand = sight[0].isel(time=slice(300)), sight[1][:, :300]
    turned = xr.DataArray(hand, dims=DIMS).transpose("axis", "time", "trial")
    np.testing.assert_array_equal(BodyImage.learn(exp, turned).tactile_map, BodyImage.learn(exp, hand).tactile_map)


def test_config_tells_every_setting():
    body = small(experience([0, 1]), np.random.default_rng(0).random((1, 2, 2)))
    config = json.loads(json.dumps(body.config))
    assert config["gamma"] == 40.0
    assert config["gamma_posture"] == pytest.approx(5.8, abs=0.01)
    assert config["skin"] == [2, 2]
    assert config["image_range"] == [[0.0, 1.0], [0.0, 1.0]]


def test_posture_som_represents_postures_and_ignores_units_of_joints():
    rng = np.random.default_rng(0)
    centres = np.array([[0.0, 0.0], [1.0, 50.0], [1.0, -50.0], [-1.0, 0.0]])
    q = centres[rng.integers(0, 4, 400)] + rng.normal(size=(400, 2)) * [0.01, 0.5]
    som = PostureSOM.fit(q, (4, 4))
    error = np.abs(som.postures.reshape(-1, 2)[som.winners(q)] - q) / som.scale
    assert error.mean() < 0.1
    scaled = PostureSOM.fit(q * [1.0, 1e-3], (4, 4))
    np.testing.assert_allclose(scaled.postures, som.postures * [1.0, 1e-3], rtol=1e-6, atol=1e-9)
    distance = (((q[:, None] - som.postures.reshape(-1, 2)) / som.scale) ** 2).sum(-1)
    np.testing.assert_array_equal(som.winners(q), distance.argmin(1))
    still = PostureSOM.fit(np.ones((10, 2)), (1, 1))
    np.testing.assert_allclose(still.postures, 1.0)


def test_the_posture_som_is_of_touching_postures_alone():
    taxels = np.where(np.arange(400) % 2 == 0, np.random.default_rng(2).integers(0, 4, 400), -1)
    q = np.random.default_rng(3).uniform(-0.1, 0.1, (1, 400, 3))
    far = q.copy()
    far[0, taxels < 0] += 100.0
    body, other = (small(experience(taxels, one), np.zeros((1, 400, 2))) for one in (q, far))
    np.testing.assert_array_equal(body.postures, other.postures)
    assert np.abs(other.postures).max() < 0.1


def test_posture_map_is_learned_by_the_winning_posture(sight):
    exp, hand = sight[0].isel(time=slice(400)), sight[1][:, :400]
    som = PostureSOM.fit(exp.q.values[0], (3, 3))
    body = BodyImage.learn(
        exp, hand, posture_grid=(3, 3), posture_som=som, gamma_posture=1e-3, alpha="per_visit", silence=0.0
    )
    winners = som.winners(exp.q.values[0])
    for unit in np.unique(winners):
        np.testing.assert_allclose(body.posture_map.reshape(-1, 2)[unit], hand[0, winners == unit].mean(0), rtol=1e-10)


def test_hebbian_weights_by_hand():
    exp, hand = experience([0, 0, 3, -1]), np.array([[[0.1, 0.1], [0.9, 0.1], [1.0, 1.0], [0.1, 0.9]]])
    settings = {"skin": (2, 2), "cells": 2, "silence": 0.0, "image_range": np.array([[0.0, 1.0]] * 2), "alpha": 0.5}
    alone = hebbian_map(exp, hand, gamma=None, **settings)
    np.testing.assert_allclose(alone.cells, [[0.25, 0.25], [0.25, 0.75], [0.75, 0.25], [0.75, 0.75]])
    expected = np.zeros((4, 4))
    expected[0, [0, 2]], expected[3, 3] = 0.5, 0.5
    np.testing.assert_allclose(alone.weights, expected)
    np.testing.assert_allclose(alone.tactile_map[0, 0], [0.5, 0.25])
    np.testing.assert_allclose(alone.tactile_map[1, 1], [0.75, 0.75])
    assert np.isnan(alone.tactile_map[0, 1]).all()
    spread = hebbian_map(exp, hand, gamma=2.0, **settings)
    np.testing.assert_allclose(spread.weights[1], 0.5 * np.exp(-0.5) * np.array([1, 0, 1, 1]))


def test_hebbian_map_with_fine_cells_is_the_kernel_average(sight):
    exp, hand = sight
    fine = hebbian_map(exp, hand, cells=21, kernel="squared", silence=0.0)
    expected = expected_map(PLACES, exp.touched.values[..., 0], kernel="squared")
    # Cells of 21 over the range hold one column of taxels each; their centres are squeezed by 20/21.
    middle = PLACES.mean(axis=0)
    np.testing.assert_allclose(fine.tactile_map - middle, (expected - middle) * 20 / 21, atol=1e-12)


def test_hebbian_map_ignores_what_lies_outside_or_was_silent(sight):
    exp, hand = sight
    half = hebbian_map(exp, hand, gamma=None, silence=0.0, image_range=np.array([[0.0, 0.05], [0.0, 1.0]]))
    assert half.weights.sum() == pytest.approx(0.1 * (hand[..., 0] <= 0.05).sum())
    noticed = hebbian_map(exp, hand, gamma=None, alpha=1.0, seed=3).weights.sum(axis=1)
    np.testing.assert_allclose(noticed, BodyImage.learn(exp, hand, seed=3).touch_counts)


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"kernel": "round"}, InvalidConfig, "kernel='round'.*squared, plain"),
        ({"alpha": "fast"}, InvalidConfig, "alpha='fast'.*geometric, constant, per_visit"),
        ({"silence_mode": "all"}, InvalidConfig, "silence_mode='all'.*touch, taxel"),
        ({"silence": 1.5}, InvalidConfig, "silence=1.5"),
        ({"gamma": 0}, InvalidConfig, "gamma=0"),
        ({"gamma_final": -1.0}, InvalidConfig, "gamma_final"),
        ({"skin": (2, 0)}, InvalidConfig, "skin columns"),
        ({"skin": 4}, InvalidConfig, "rows, columns"),
        ({"skin": (1, 3)}, InvalidRecording, "taxel 3 was touched"),
        ({"trial": 1}, InvalidConfig, "trial=1.*below 1"),
        ({"seed": -1}, InvalidConfig, "seed"),
        ({"snapshots": (-5,)}, InvalidConfig, "snapshots"),
        ({"initial_map": np.zeros((2, 3, 2))}, InvalidArray, r"initial_map has shape \(2, 3, 2\)"),
        ({"image_range": np.zeros((3, 2))}, InvalidArray, "image_range"),
        ({"image_range": np.array([[1.0, 0.0], [0.0, 1.0]])}, InvalidArray, "in order"),
    ],
)
def test_refuses_settings(settings, error, message):
    with pytest.raises(error, match=message):
        small(experience([0, 3]), np.zeros((1, 2, 2)), **settings)


def test_refuses_recordings_and_arrays():
    exp, hand = experience([0, 3]), np.zeros((1, 2, 2))
    for wrong in (hand[0], hand[:, :1], hand.astype(int), xr.DataArray(hand, dims=("trial", "time", "x"))):
        with pytest.raises(InvalidArray, match="hand"):
            small(exp, wrong)
    with pytest.raises(InvalidRecording, match="no variable 'touched'"):
        small(exp.drop_vars("touched"), hand)
    with pytest.raises(InvalidRecording, match="no touches"):
        small(experience([-1, -1]), hand)
    with pytest.raises(InvalidRecording, match="give image_range"):
        small(exp, hand * np.nan, image_range=None)
    with pytest.raises(InvalidRecording, match="nothing to associate"):
        hebbian_map(exp, hand * np.nan, skin=(2, 2))
    with pytest.raises(InvalidConfig, match="cells"):
        hebbian_map(exp, hand, skin=(2, 2), cells=(1, 2, 3))
    with pytest.raises(InvalidConfig, match="taxel=4"):
        activation(4, (2, 2))
    with pytest.raises(InvalidArray, match="taxels must be whole"):
        expected_map(np.zeros((4, 2)), [4], (2, 2))
    with pytest.raises(InvalidArray, match="true_positions"):
        expected_map(np.zeros((5, 2)), [0], (2, 2))
    with pytest.raises(InvalidArray, match="NaN"):
        PostureSOM.fit(np.full((3, 2), np.nan))
    with pytest.raises(InvalidArray, match="3 joints, the posture map 2"):
        PostureSOM.fit(np.random.default_rng(0).random((5, 2)), (2, 2)).winners(np.zeros((1, 3)))


def test_a_trial_is_learned_as_if_it_were_alone():
    rng = np.random.default_rng(0)
    exp, hand = experience(rng.integers(0, 4, (2, 9)), rng.normal(size=(2, 9, 3))), rng.random((2, 9, 2))
    second, alone = small(exp, hand, trial=1), small(exp.isel(trial=[1]), hand[1:])
    for name in ("tactile_map", "postures", "posture_map", "touch_counts"):
        np.testing.assert_array_equal(getattr(second, name), getattr(alone, name))


@pytest.mark.parametrize("threads", [1, 2])
def test_many_maps_are_each_as_if_learned_alone(sight, threads):
    exp, hand = sight
    other = experience(np.random.default_rng(5).integers(0, 441, 500))
    hands = [hand, PLACES[other["touched"].values[..., 0]]]
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        found = BodyImage.learn_many([exp, other], hands, [3, 4], silence=0.2)
    finally:
        torch.set_num_threads(before)
    for learned, given, seen, seed in zip(found, [exp, other], hands, [3, 4], strict=True):
        alone = BodyImage.learn(given, seen, seed=seed, silence=0.2)
        np.testing.assert_array_equal(learned.tactile_map, alone.tactile_map)
        np.testing.assert_array_equal(learned.posture_map, alone.posture_map)
    with pytest.raises(InvalidConfig, match="give one each"):
        BodyImage.learn_many([exp], hands, [3, 4])
