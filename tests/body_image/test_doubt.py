"""Doubt carried on to hands and maps: exact where all is linear, and about right where the truth is known."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.errors import InvalidArray, InvalidConfig

E = bk.estimators


@pytest.fixture(scope="module")
def learned(circle):
    return E.Ridge(penalty=1e-4).fit(bk.experience(circle))


@pytest.fixture(scope="module")
def felt(touch):
    return bk.experience(touch)


@pytest.fixture(scope="module")
def hands(felt, learned):
    return bk.integrate_draws(felt, learned.draws(300))


def test_of_a_constant_jacobian_the_doubt_about_the_hand_is_known_exactly(felt, learned, hands):
    # The sum of J dq since the reset is J (q - q_reset).
    q = felt.q.values[0]
    reset = np.maximum.accumulate(np.where(felt.at_reference.values[0], np.arange(len(q)), 0))
    sd = np.sqrt(np.einsum("tii->ti", learned.displacement_covariance(q, q - q[reset]).numpy()))
    found = hands.values[:, 0].std(axis=0, ddof=1)
    moved = sd[:, 0] > 1e-3 * sd[:, 0].max()
    np.testing.assert_allclose(found[moved] / sd[moved], 1.0, atol=0.25)
    assert found[felt.at_reference.values[0]].max() < 1e-12
    assert hands.attrs["units"] == "m"


def test_each_draw_is_one_function_all_along(felt, learned, hands):
    for index, one in enumerate(learned.draws(300)[:2]):
        np.testing.assert_array_equal(hands.values[index], bk.integrate(felt, one).values)


def test_every_taxel_has_a_mean_and_a_covariance(felt, hands):
    settings = {"gamma_final": 1.0, "alpha": "per_visit", "posture_grid": (3, 3)}
    maps = bk.BodyImageDraws.learn(felt, hands[:40], seed=2, **settings)
    assert maps.mean.shape == (21, 21, 2)
    assert maps.covariance.shape == (21, 21, 2, 2)
    flat = maps.tactile_maps.reshape(40, 441, 2)
    np.testing.assert_allclose(maps.mean.reshape(441, 2), flat.mean(0), atol=1e-15)
    np.testing.assert_allclose(maps.covariance.reshape(441, 2, 2)[7], np.cov(flat[:, 7].T), rtol=1e-9)
    assert np.linalg.eigvalsh(maps.covariance).min() > -1e-15
    assert maps.posture_mean.shape == (3, 3, 2)
    assert maps.posture_covariance.shape == (3, 3, 2, 2)
    # Each map is the one that this hand teaches, and all began at the same.
    own = bk.BodyImage.learn(felt, hands[3], seed=2, image_range=maps.draws[3].config["image_range"], **settings)
    np.testing.assert_array_equal(own.tactile_map, maps.draws[3].tactile_map)
    np.testing.assert_array_equal(own.postures, maps.draws[3].postures)
    assert len({one.history["tactile_maps"][0].tobytes() for one in maps.draws}) == 1
    assert (maps.touch_counts == own.touch_counts).all()


def test_a_map_is_doubted_where_the_touches_are_far_from_the_reset(body, felt, hands):
    maps = bk.BodyImageDraws.learn(felt, hands[:60], gamma=1.0, alpha="per_visit")
    doubt = np.sqrt(np.einsum("tii->t", maps.covariance.reshape(441, 2, 2)))
    touched = maps.touch_counts > 0
    q = body.touch_postures(range(441)).numpy()
    away = np.linalg.norm(q - q[body.skin.reference], axis=1)
    assert np.corrcoef(doubt[touched], away[touched])[0, 1] > 0.3


def test_a_doubt_that_is_right_covers_the_truth_as_often_as_it_says(felt, learned):
    """Where the truth is one more draw, it is in the region of level so often: no taxel twice, one a truth."""
    trues, draws = learned.draws(120, seed=5), learned.draws(150, seed=6)
    settings = {
        "gamma": 1.0,
        "alpha": "per_visit",
        "posture_grid": (2, 2),
        "snapshots": (),
        "initial_map": np.zeros((21, 21, 2)),
    }
    maps = bk.BodyImageDraws.learn(felt, bk.integrate_draws(felt, draws), **settings)
    true = bk.BodyImageDraws.learn(felt, bk.integrate_draws(felt, trues), **settings).tactile_maps.reshape(120, 441, 2)
    taxel = int(np.argmax(np.where(maps.touch_counts > 0, np.einsum("tii->t", maps.covariance.reshape(441, 2, 2)), 0)))
    mean, covariance = (values.reshape(441, *values.shape[2:])[taxel] for values in (maps.mean, maps.covariance))
    held = metrics.coverage(true[:, taxel], np.tile(mean, (120, 1)), np.tile(covariance, (120, 1, 1)))
    assert (held.lower <= held.levels).all()
    assert (held.levels <= held.upper).all()
    steps = metrics.coverage(true[:, taxel], np.tile(mean, (120, 1)), np.tile(covariance / 9, (120, 1, 1)))
    assert (steps.upper < steps.levels).all()


def test_bodies_drawn_from_a_calibration_are_carried_on_too(body, felt, circle):
    seen = bk.calibration.Observed(bk.experience(circle).isel(time=slice(None, None, 10)), noise={"images": 2e-4})
    fit = bk.calibrate(body, seen, free=["axes", "offsets"], folds=2)
    draws = [E.Analytic(one).fit(felt) for one in fit.draws(4, seed=1)]
    maps = bk.BodyImageDraws.learn(felt, bk.integrate_draws(felt, draws, method="midpoint"), posture_grid=(2, 2))
    assert np.isfinite(maps.covariance).all()
    assert np.einsum("ijkk->", maps.covariance) > 0


@pytest.mark.usefixtures("unchecked")
def test_what_is_no_draws_is_refused(felt, learned, hands):
    with pytest.raises(InvalidConfig, match="one function; give several"):
        bk.integrate_draws(felt, learned)
    with pytest.raises(InvalidConfig, match="1 draws tell no spread"):
        bk.integrate_draws(felt, learned.draws(1))
    with pytest.raises(InvalidArray, match="hands have dimensions"):
        bk.BodyImageDraws.learn(felt, hands[0])
    with pytest.raises(InvalidArray, match="hands have shape"):
        bk.BodyImageDraws.learn(felt, torch.zeros(1, 1, 4, 2))
