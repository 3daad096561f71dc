"""Scores without a truth: what was hidden judges, noise is taken off, stretches are resampled, bodies are in doubt."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.calibration import Prior, calibrate
from bodyimage_kin.errors import InvalidConfig, InvalidRecording
from bodyimage_kin.estimators import Analytic, Broyden, Estimator, LeastSquares, RationalTrig, TrigRidge


def scattered(body, noise=0.0, repeats=1, seed=0, rows=120):
    """Postures in front of the face in no order, each seen ``repeats`` times."""
    rng = np.random.default_rng(seed)
    q = body.touch_postures(np.arange(0, 441, 441 // rows)[:rows], distance=0.03).numpy()
    q = np.repeat(q, repeats, axis=0)
    image = body.hand_image(torch.from_numpy(q)).numpy()
    image = image + noise * rng.standard_normal(image.shape)
    repeat = np.repeat(np.arange(len(q) // repeats), repeats)
    return bk.recording(
        q=q, hand_image=image, joints=list(body.joints), order="scattered", unit="m", repeat=repeat,
        block=np.arange(len(q)) * 6 // len(q),
    )  # fmt: skip


def test_the_truth_errs_by_nothing_and_a_constant_by_something(body):
    rows = bk.score({"truth": Analytic(body), "constant": LeastSquares()}, None, scattered(body))
    assert rows.pair_error_relative.sel(estimator="truth") < 1e-9
    assert rows.pair_error_relative.sel(estimator="constant") > 0.05
    assert rows.pair_error.attrs["units"] == "m"
    assert rows.pair_error_relative.attrs["units"] == "1"


def test_one_estimator_or_its_name_has_the_scores_that_it_has_among_others(body):
    exp = scattered(body)
    among = bk.score({"a": LeastSquares(), "b": TrigRidge()}, None, exp).sel(estimator="a")
    for alone in (bk.score(LeastSquares(), None, exp), bk.score("LeastSquares", None, exp)):
        assert float(alone.pair_error) == float(among.pair_error)
        assert "estimator" not in alone.dims


class Witness(Estimator):
    """Learns as least squares, and remembers what it was shown."""

    def __init__(self):
        self.shown = []

    def fit(self, exp, seed=0):
        self.shown.append(np.isfinite(exp["hand_image"].values).all(-1))
        return LeastSquares().fit(exp, seed)


def test_what_is_foretold_was_never_shown(circle):
    witness = Witness()
    bk.score({"witness": witness}, None, circle)
    seen = np.isfinite(circle["hand_image"].values).all(-1)
    hidden = [seen & ~shown for shown in witness.shown]
    assert len(hidden) == 5
    assert all(one.any() for one in hidden)
    np.testing.assert_array_equal(np.sum(hidden, axis=0), seen)


def test_noise_is_told_by_repeats_and_taken_off(body):
    noise = 5e-4
    rows = bk.score(Analytic(body), None, scattered(body, noise=noise, repeats=4))
    assert float(rows.noise_floor) == pytest.approx(noise * 2**0.5, rel=0.15)
    assert float(rows.pair_error) == pytest.approx(2 * noise, rel=0.15)
    assert float(rows.pair_error_corrected) < 0.5 * float(rows.pair_error)
    assert float(rows.pair_error_relative_corrected) < 0.5 * float(rows.pair_error_relative)


def test_stated_noise_counts_before_repeats(body):
    rows = bk.score(Analytic(body), None, scattered(body, noise=5e-4, repeats=2), noise=1e-9)
    assert float(rows.pair_error_corrected) == pytest.approx(float(rows.pair_error))


def test_without_repeats_the_floor_is_unknown_and_said_so(body):
    rows = bk.score(LeastSquares(), None, scattered(body).drop_vars("repeat"))
    assert np.isnan(rows.noise_floor)
    assert np.isnan(rows.pair_error_corrected)
    assert float(rows.pair_error) > 0


def test_intervals_hold_the_error_and_widen_with_fewer_stretches(circle):
    exp = bk.experience(circle)
    rows = bk.score({"one": LeastSquares(), "other": RationalTrig()}, None, exp)
    assert (rows.pair_error_relative_lower <= rows.pair_error_relative).all()
    assert (rows.pair_error_relative <= rows.pair_error_relative_upper).all()
    assert rows.attrs["stretches"] == metrics.held_out.RUNS


@pytest.mark.parametrize("order", ["stream", "scattered"])
def test_stretches_are_parts_of_blocks_and_each_sample_and_pair_is_of_one(body, circle, order):
    exp = bk.experience(circle) if order == "stream" else scattered(body)
    parts = metrics.hold_out_folds(exp)
    where = {}
    for index, part in enumerate(parts):
        assert len(part.run) == len(part.q) == len(part.image)
        assert len(part.run_of_pair) == len(part.hidden.dr)
        assert set(part.run_of_pair) <= set(part.run)
        for run in part.run:
            assert where.setdefault(run, index) == index, "a stretch lies in two folds"
    assert len(where) >= metrics.held_out.RUNS
    if order == "stream":
        # The first end of a pair is the sample whose stretch it bears.
        part = parts[0]
        stretch = {tuple(q): run for q, run in zip(part.q.tolist(), part.run, strict=True)}
        assert [stretch[tuple(q)] for q in part.hidden.q.tolist()] == part.run_of_pair.tolist()


def test_pairs_of_scattered_postures_bear_the_stretch_of_an_end(body):
    for part in metrics.hold_out_folds(scattered(body)):
        starts = (part.hidden.q - part.hidden.dq / 2).numpy()
        near = np.abs(part.q[None] - starts[:, None]).max(-1).argmin(1)
        np.testing.assert_array_equal(part.run[near], part.run_of_pair)


def test_the_order_of_scattered_rows_counts_for_nothing(body):
    exp = scattered(body, noise=1e-4)
    shuffled = exp.isel(time=np.random.default_rng(3).permutation(exp.sizes["time"])).assign_coords(time=exp.time)
    one, other = (bk.score(LeastSquares(), None, each) for each in (exp, shuffled))
    assert float(one.pair_error) == float(other.pair_error)
    np.testing.assert_array_equal(one.by_fold, other.by_fold)


def test_images_are_judged_too_where_they_are_learned(body):
    rows = bk.score({"field": LeastSquares(), "image": TrigRidge()}, None, scattered(body))
    assert np.isnan(rows.image_error.sel(estimator="field"))
    assert 0 < rows.image_error_relative.sel(estimator="image") < 0.2


def test_who_cannot_learn_is_named_and_the_others_are_scored(body):
    rows = bk.score({"online": Broyden(), "sound": LeastSquares()}, None, scattered(body))
    assert "stream" in str(rows.failure.sel(estimator="online").item())
    assert np.isnan(rows.pair_error.sel(estimator="online"))
    assert np.isfinite(rows.pair_error.sel(estimator="sound"))


def test_no_truth_reaches_a_score(body, circle):
    blind = circle.assign(
        {name: circle[name] * 0 + 7.0 for name in circle if str(name) in ("true_q", "true_hand_image")}
    )
    one, other = (bk.score(LeastSquares(), None, each) for each in (circle, blind))
    assert float(one.pair_error) == float(other.pair_error)


def test_the_share_of_directions_moved_is_said(body, circle):
    rows = bk.score(LeastSquares(), None, circle)
    assert 0.3 < float(rows.moved_share) < 0.9
    assert float(rows.local_spectrum[0]) == 1.0
    assert (np.diff(rows.local_spectrum) <= 0).all()


def test_what_was_learned_is_judged_on_another_recording(body, circle):
    learned = LeastSquares().fit(bk.experience(circle))
    own, other = bk.score(learned, None, circle), bk.score(learned, None, circle, use=scattered(body))
    assert (own.attrs["held_out"], other.attrs["held_out"]) == ("False", "True")
    assert float(own.pair_error_relative) < float(other.pair_error_relative)


# Against a body that is itself in doubt ------------------------------------------------------------------------------


def test_a_calibrated_body_lends_its_doubt_to_every_score(body, circle):
    learned = LeastSquares().fit(bk.experience(circle))
    exp = bk.experience(bk.simulate(body, bk.motions.Circle(turns=1.0), seed=1, noise=bk.Noise(image=2e-4)))
    wide, narrow = (
        calibrate(body, exp, prior=Prior(axes=axes, offsets=offsets), free=["axes", "offsets"], folds=2)
        for axes, offsets in ((0.05, 5e-3), (1e-6, 1e-7))
    )
    probes = [bk.probes.Training(), bk.probes.Face()]
    sure, unsure = (bk.score(learned, one, circle, probes=probes, draws=6) for one in (narrow, wide))
    true = bk.score(learned, body, circle, probes=probes)
    assert (sure.relative_error_sd < 1e-4).all()
    assert (unsure.relative_error_sd > 10 * sure.relative_error_sd).all()
    np.testing.assert_allclose(sure.relative_error, true.relative_error, rtol=1e-3)
    assert (unsure.halves_apart > 10 * sure.halves_apart).all()
    assert "6 bodies" in unsure.attrs["truth"]
    # Out of sight the body is less known than in sight.
    assert unsure.relative_error_sd[1] / unsure.relative_error[1] > 0


def test_moved_directions_are_better_known_than_all(body, circle):
    learned = RationalTrig().fit(bk.experience(circle))
    found = bk.score(
        learned, body, circle, probes=[bk.probes.Training()], scores=["relative_error", "relative_error_moved"]
    )
    assert float(found.relative_error_moved) < float(found.relative_error[0])


@pytest.mark.parametrize(
    ("call", "error", "match"),
    [
        (lambda exp: bk.score({}, None, exp), InvalidConfig, "at least one"),
        (lambda exp: bk.score({"a": LeastSquares()}, None, exp, folds=1), InvalidConfig, "folds=1"),
        (lambda exp: bk.score(LeastSquares(), None, exp, noise=-1.0), InvalidConfig, "noise"),
        (lambda exp: bk.score(LeastSquares(), None, exp.drop_vars("hand_image")), InvalidRecording, "hand_image"),
    ],
)
@pytest.mark.usefixtures("unchecked")
def test_mistakes_are_named(circle, call, error, match):
    with pytest.raises(error, match=match):
        call(bk.experience(circle))


# In studies ----------------------------------------------------------------------------------------------------------

HELD_OUT = ["pair_error", "pair_error_relative", "image_error", "image_error_relative"]


def lacking(results):
    return json.loads(results.attrs["left_out"])


@pytest.fixture(scope="module")
def of_recordings(body, tmp_path_factory):
    """Two recordings as seeds and one without blocks, of nobody's body."""
    mine = [scattered(body, seed=seed, noise=1e-4) for seed in (0, 1)]
    study = bk.Study(
        None, recordings={"mine": mine, "repeated": scattered(body, noise=5e-4, repeats=4)},
        estimators={"flat": LeastSquares(), "trig": TrigRidge()}, seeds=2,
    )  # fmt: skip
    return study, mine, study.run(tmp_path_factory.mktemp("recordings"), "in-process")


def test_a_study_of_recordings_has_the_scores_of_each_estimator_alone(of_recordings):
    _, mine, results = of_recordings
    assert (results["failure"] == "").all()
    for seed, recording in enumerate(mine):
        alone = bk.score({"flat": LeastSquares(), "trig": TrigRidge()}, None, recording)
        found = results.sel(recording="mine", seed=seed).squeeze("embodiment")
        for name in HELD_OUT:
            np.testing.assert_array_equal(found[name].values, alone[name].values, name)
    # Each seed has a recording of its own.
    assert (results["pair_error"].sel(recording="mine").diff("seed") != 0).all()
    assert results["pair_error"].attrs["units"] == "m"


def test_a_study_says_what_its_recordings_cannot_give(of_recordings):
    found = lacking(of_recordings[2])
    assert found["relative_error"] == {
        "there is no body": [f"unknown/{a}/{b}" for a in ("mine", "repeated") for b in ("flat", "trig")]
    }
    ((why, places),) = found["image_error"].items()
    assert "no hand image" in why
    assert set(places) == {"unknown/mine/flat", "unknown/repeated/flat"}
    ((why, places),) = found["pair_error_relative_corrected"].items()
    assert "repeat" in why
    assert set(places) == {"unknown/mine/flat", "unknown/mine/trig"}
    corrected = of_recordings[2].sel(recording="repeated")
    assert (corrected["pair_error_relative_corrected"] < corrected["pair_error_relative"]).all()


def test_a_single_block_is_left_out_and_said_and_its_other_scores_stay(body, tmp_path):
    whole = scattered(body)
    whole["block"][:] = 0
    study = bk.Study(None, {"mine": whole}, [LeastSquares()], seeds=1, scores=["pair_error", "fit_seconds"])
    results = study.run(tmp_path, "in-process")
    assert (results["failure"] == "").all()
    assert "single block" in next(iter(lacking(results)["pair_error"]))
    assert np.isfinite(results["fit_seconds"]).all()
    assert np.isnan(results["pair_error"]).all()


def test_a_fold_without_which_nothing_can_be_learned_is_named(body, tmp_path):
    study = bk.Study(None, {"mine": scattered(body)}, {"shy": Shy()}, seeds=1, scores=["pair_error"])
    results = study.run(tmp_path, "in-process")
    assert next(iter(lacking(results)["pair_error"])) == "without fold 0 of 5: too little"


@dataclass(frozen=True)
class Shy(Estimator):
    """Learns from all of a recording alone."""

    def fit(self, exp, seed=0):
        if not np.isfinite(exp["hand_image"].values).all():
            raise InvalidRecording("too little")
        return LeastSquares().fit(exp, seed)


def test_studies_of_motions_are_the_same_as_before():
    study = bk.Study("infant", {"near": bk.motions.Circle()}, [LeastSquares()], seeds=1)
    assert not set(study.scores) & set(HELD_OUT)
    assert set(bk.Study("infant", {"near": "Circle"}, ["LeastSquares"], scores=["pair_error"]).scores) == {"pair_error"}


def test_the_page_orders_by_what_was_hidden_and_says_what_is_left_out(of_recordings, tmp_path):
    page = bk.report.write(of_recordings[2], tmp_path / "report.html").read_text()
    assert "hidden from it" in page
    assert "held against the true one" not in page
    assert "there is no body" in page
    assert "What could not be computed" in page
