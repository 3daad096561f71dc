"""Maps in a study: what the public functions give, the same bits whoever works, and nothing when nobody asks."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin.recordings.motions import Circle, FaceTour, RandomTouch
from bodyimage_kin.study import Simulation, Study, recording_of, scores, scoring
from bodyimage_kin.study.maps import true_map
from bodyimage_kin.study.random_streams import stream

ASKED = ("relative_error_use", "trajectory_rmse", *scores.MAP_SCORES)


def small(**changes):
    """A study of maps that takes seconds."""
    asked = {
        "embodiments": {"infant": "infant"},
        "recordings": {
            "still": Simulation(Circle(turns=0.5), RandomTouch(duration=20.0), FaceTour(speed=0.2), dynamics=False)
        },
        "estimators": {"flat": "LeastSquares", "truth": "Analytic", "seer": "odd_estimators:Seer"},
        "seeds": 2,
        "probes": ["on_face"],
        "scores": ASKED,
        "first_maps": 2,
    }
    return Study(**asked | changes)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A small study of maps, its results and its store."""
    store = tmp_path_factory.mktemp("maps") / "run"
    study = small()
    return study, study.run(store, "in-process"), store


def by_hand(store, seed, body, first_maps):
    """The maps of least squares and of direct sight by the public functions alone, and the true hand image."""
    training, touch = (recording_of(store, "still", seed, role) for role in ("training", "use"))
    learned = bk.estimators.LeastSquares().fit(bk.experience(training))
    felt = bk.experience(touch)
    hand = bk.integrate(felt, learned)
    som_seed, *seeds = stream(0, f"infant/still/{seed}/first maps", 1 + first_maps)
    q = felt["q"].values[0][felt["touched"].values[0, :, 0] >= 0]
    seen = training["hand_image"].values.reshape(-1, 2)
    settings = {
        "posture_som": bk.body_image.PostureSOM.fit(q, (8, 8), som_seed),
        "image_range": np.stack([seen.min(0), seen.max(0)], axis=1),
    }
    pairs = [
        [bk.BodyImage.learn(felt, image, seed=one, **settings) for image in (hand, touch["true_hand_image"])]
        for one in seeds
    ]
    return pairs, hand.values, touch["true_hand_image"].values


def rms(difference):
    return np.sqrt((difference**2).sum(-1).mean())


def test_scores_of_maps_are_those_of_the_public_functions(done, body):
    _, results, store = done
    for seed in (0, 1):
        one = results.sel(seed=seed, estimator="flat").squeeze()
        pairs, hand, image = by_hand(store, seed, body, 2)
        assert float(one["touch_trajectory_rmse"]) == pytest.approx(rms(hand - image), rel=1e-12)
        wanted = {
            "map_error": [rms(a.tactile_map - b.tactile_map) / extent(b.tactile_map) for a, b in pairs],
            "posture_map_error": [rms(a.posture_map - b.posture_map) / extent(b.posture_map) for a, b in pairs],
            "map_error_to_truth": [rms(a.tactile_map - true_map(body)) for a, _ in pairs],
            "direct_map_error_to_truth": [rms(b.tactile_map - true_map(body)) for _, b in pairs],
            "map_span": [bk.metrics.span(a.tactile_map, true_map(body)) for a, _ in pairs],
            "map_topological_error": [bk.metrics.topological_error(a.tactile_map) for a, _ in pairs],
            "map_folded_cells": [bk.metrics.folded_cells(a.tactile_map) for a, _ in pairs],
            "map_disparity": [bk.metrics.procrustes(a.tactile_map, true_map(body)).disparity for a, _ in pairs],
        }
        for name, values in wanted.items():
            np.testing.assert_allclose(one[name].values, np.mean(values, axis=0), rtol=1e-12, err_msg=name)
    # Initial weights are averaged within a recording, and they do differ.
    assert wanted["map_error"][0] != wanted["map_error"][1]


def extent(places):
    return rms(places - places.mean((0, 1)))


def test_the_kernels_own_share_is_out_of_the_maps_error(done):
    results = done[1].squeeze()
    seer = results.sel(estimator="seer")
    # Whoever knows where the hand is has the map of direct sight, and that is far from the true taxels.
    assert float(seer["touch_trajectory_rmse"].max()) < 1e-3
    assert float(seer["map_error"].max()) < 0.02
    np.testing.assert_allclose(seer["map_error_to_truth"], results["direct_map_error_to_truth"], rtol=0.02)
    assert float(results["direct_map_error_to_truth"].min()) > 0.01
    assert (results["map_error"].sel(estimator="truth") < results["map_error"].sel(estimator="flat")).all()


def test_no_bit_of_a_map_depends_on_the_workers(done, tmp_path):
    study, results, _ = done
    found = study.run(tmp_path, workers=2)
    xr.testing.assert_identical(found, results)


def test_the_same_first_maps_come_first(done, tmp_path):
    one = small(first_maps=1, estimators={"flat": "LeastSquares"}, seeds=[1]).run(tmp_path, "in-process").squeeze()
    pairs, _, _ = by_hand(tmp_path, 1, None, 1)
    wanted = rms(pairs[0][0].tactile_map - pairs[0][1].tactile_map) / extent(pairs[0][1].tactile_map)
    assert float(one["map_error"]) == pytest.approx(wanted, rel=1e-12)
    assert float(one["map_error"]) != float(done[1]["map_error"].sel(estimator="flat", seed=1).squeeze())


def test_maps_cost_nothing_when_nobody_asks(done, tmp_path, monkeypatch):
    def learn(*_, **__):
        raise AssertionError("a map is learned")

    monkeypatch.setattr(bk.BodyImage, "learn", learn)
    without = small(scores=scoring.default_scores(), estimators={"flat": "LeastSquares"}, seeds=1)
    found = without.run(tmp_path, "in-process")
    assert set(found["failure"].values.ravel()) == {""}
    assert not set(scores.MAP_SCORES) & set(found)
    assert not [name for name in found if "map" in str(name)]
    assert "map_error" not in json.loads(found.attrs["config"])["scores"]
    np.testing.assert_array_equal(
        found["relative_error_use"].sel(seed=0), done[1]["relative_error_use"].sel(seed=0, estimator=["flat"])
    )


def test_the_page_shows_how_the_error_travels(done, tmp_path):
    page = bk.report.write(done[1], tmp_path / "report.html").read_text()
    text = re.sub(r"data:[^\"]*", "", page)
    assert "nan" not in text.lower().split()
    section = text[text.index('<h2 id="maps">') : text.index('<h2 id="origin">')]
    assert section.count("<figure id=") == 1
    assert "means over 2 first maps" in section
    assert "direct sight</td>" in section
    # The truth itself, and what integrates as it does, are left out of correlations by choice, and the page says so.
    assert "Left out, being the truth itself: truth, seer" in section
    assert "goes from" in section


def test_the_page_says_when_the_topological_error_flatters_all(done, tmp_path):
    flat = done[1].assign(map_topological_error=done[1]["map_topological_error"] * 0.0)
    assert "flattering measure" in bk.report.write(flat, tmp_path / "report.html").read_text()


def test_what_explodes_is_a_failure_and_no_score(tmp_path):
    wild = {
        "sum": "odd_estimators:Explosive",
        "square": {"LeastSquares": {"scale": 1e160}},
        "lost": "odd_estimators:Lost",
    }
    found = small(estimators=wild, seeds=1, first_maps=1).run(tmp_path, "in-process").squeeze()
    said = [one.item() for one in found["failure"]]
    assert said[0].startswith("WrongResult: the integrated tour is not finite in")
    assert said[1].startswith("WrongResult: jacobian at probe 'on_face' is too large to be scored in")
    assert said[2].startswith("WrongResult: the integrated touching is not finite in")
    assert np.isnan(found["trajectory_rmse"]).all()
    assert np.isnan(found["map_error"]).all()


def test_a_recording_without_touches_says_so(tmp_path):
    short = Simulation(Circle(turns=0.5), RandomTouch(duration=0.2, silence=1.0), dynamics=False)
    found = small(recordings={"still": short}, seeds=1).run(tmp_path, "in-process")
    assert "let it touch for longer" in found["failure"].values.ravel()[0]
