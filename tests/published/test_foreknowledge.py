"""Foretold errors: from what may be known alone, held against the truth out of sample."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin import figures
from bodyimage_kin.errors import (
    BodyImageKinError,
    InvalidArray,
    InvalidConfig,
    InvalidPosture,
    UnknownName,
)
from bodyimage_kin.estimators import Analytic, LeastSquares, PaperMLP
from bodyimage_kin.published import foreknowledge as fk
from bodyimage_kin.published.foreknowledge import Combination, leave_one_condition_out

UNTAUGHT = {
    "posture_distance": fk.MeanPostureDistance(),
    "posture_distance_seen": fk.MeanPostureDistance("seen"),
    "posture_distance_use": fk.MeanPostureDistance("use"),
    "excitation_deficit": fk.ExcitationDeficit(),
    "gaussian_process": fk.GaussianProcessPosterior(draws=4, most=60),
    "gaussian_process_radial": fk.GaussianProcessPosterior("radial", draws=4, most=60),
}
ALL = [*UNTAUGHT, "perturbed_arms", "calibrated_arm"]


def of(name, body):
    taught = {"perturbed_arms": fk.PerturbedArms(body, 2), "calibrated_arm": fk.CalibratedArm(body)}
    return (UNTAUGHT | taught)[name]


@pytest.fixture(scope="module")
def known(circle, touch):
    return fk.Known.of(circle, touch.q, LeastSquares(), seed=3, most=40)


def true_jacobians(body, known):
    return body.hand_image_jacobian(known.postures).numpy()


# What may be known --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ALL)
def test_nothing_but_the_experience_and_the_felt_touches_is_seen(name, body, circle, touch):
    def said(seen, felt):
        found = of(name, body).foresee(fk.Known.of(seen, felt["q"].values, LeastSquares(), seed=3, most=40))
        return found.error, found.by_posture

    def blind(recording, variables):
        return recording.assign({one: recording[one] * np.nan for one in variables})

    truth = [one for one in circle.variables if str(one).startswith("true_")]
    error, by_posture = said(circle, touch)
    hidden = blind(touch, [*truth, "hand_image", "reference_image"])
    for seen in (bk.experience(circle), blind(circle, truth)):
        again, again_by_posture = said(seen, hidden)
        assert again == error
        np.testing.assert_array_equal(again_by_posture, by_posture)


@pytest.mark.parametrize("name", ALL)
def test_the_same_seed_foretells_the_same_bits(name, body, circle, touch):
    one, other = (
        of(name, body).foresee(fk.Known.of(circle, touch.q.values, PaperMLP(steps=5), seed=2, most=20)) for _ in "ab"
    )
    assert one.error == other.error > 0
    np.testing.assert_array_equal(one.by_posture, other.by_posture)


def test_the_seed_draws_arms_and_functions(known, body):
    for name in ("gaussian_process", "perturbed_arms"):
        assert of(name, body).predict(dataclasses.replace(known, seed=4)) != of(name, body).predict(known)


def test_postures_are_spread_over_the_touch_motion_and_its_padding_left_out(circle, touch):
    padded = np.concatenate([touch.q.values, np.full((1, 7, 5), np.nan)], axis=1)
    one, other = (fk.Known.of(circle, q, LeastSquares(), most=11) for q in (touch.q.values, padded))
    torch.testing.assert_close(one.postures, other.postures, rtol=0, atol=0)
    np.testing.assert_array_equal(one.samples, np.linspace(0, touch.sizes["time"] - 1, 11).round())
    np.testing.assert_allclose(one.metric, bk.metrics.motion_metric(touch))
    np.testing.assert_array_equal(one.metric, other.metric)


# Predictors ---------------------------------------------------------------------------------------------------------


def test_distance_is_that_of_means(circle, touch):
    seen = circle.isel(time=slice(0, 2)).copy(deep=True)
    seen["q"][:] = 0.0
    seen["q"][0, 1, 0] = 2.0
    q = np.array([[1.0, 3.0, 0, 0, 0], [1.0, 5.0, 0, 0, 0], [1.0, 4.0, 0, 0, 0]])
    found = fk.MeanPostureDistance().foresee(fk.Known.of(seen, q, LeastSquares()))
    assert found.error == pytest.approx(4.0)
    np.testing.assert_allclose(found.by_posture, [3.0, 5.0, 4.0])


def test_excitation_deficit_is_a_half_for_the_same_motion(circle):
    seen = circle.copy(deep=True)
    seen["q"][:] = np.random.default_rng(0).normal(size=seen.q.shape).cumsum(1)
    known = fk.Known.of(seen, seen.q.values, LeastSquares())
    assert fk.ExcitationDeficit().predict(known) == pytest.approx(0.5, abs=1e-5)
    assert fk.ExcitationDeficit().predict(fk.Known.of(seen, 3.0 * seen.q.values, LeastSquares())) == pytest.approx(0.9)
    with pytest.raises(InvalidConfig, match="ExcitationDeficit foretells no error of single postures"):
        fk.ExcitationDeficit().predict_by_posture(known)


def test_the_posterior_shrinks_with_more_of_what_is_touched(body, touch):
    """An eye that saw the touches would leave the process less to be unsure of, the more of them it saw."""
    seen = touch.assign(hand_image=touch.true_hand_image)

    def said(share):
        part = seen.isel(time=slice(0, int(share * seen.sizes["time"])))
        known = fk.Known.of(part, touch.q.values, Analytic(body), most=30)
        drawn, _ = fk.GaussianProcessPosterior(draws=16, most=200).truths(known)
        return float(drawn.std(0).mean())

    assert said(1.0) < 0.7 * said(0.2)


def test_an_unperturbed_arm_foretells_the_very_error(body, known):
    exact = fk.PerturbedArms(body, arms=2, axis_spread=0.0, offset_spread=0.0)
    J, Jh = true_jacobians(body, known), known.estimated
    assert exact.predict(known) == pytest.approx(bk.metrics.pooled_relative_error(J, Jh, known.metric), rel=1e-9)
    by_posture = bk.metrics.relative_error(J, Jh, known.metric)
    np.testing.assert_allclose(exact.predict_by_posture(known), by_posture, rtol=1e-8)


def test_an_arm_calibrated_on_images_without_noise_foretells_the_very_error(body, known):
    J, Jh = true_jacobians(body, known), known.estimated
    wanted = bk.metrics.pooled_relative_error(J, Jh, known.metric)
    assert fk.CalibratedArm(body).predict(known) == pytest.approx(wanted, rel=1e-6)


def test_the_error_foretold_is_the_root_mean_square_over_arms(body, known):
    arms = fk.PerturbedArms(body, arms=3)
    true, estimated = arms.truths(known)
    each = [bk.metrics.pooled_relative_error(J, Jh, known.metric) for J, Jh in zip(true, estimated, strict=True)]
    assert np.ptp(each) > 0.01, "the arms differ"
    assert arms.predict(known) == pytest.approx(np.sqrt(np.mean(np.square(each))))
    J = true_jacobians(body, known)
    assert np.abs(true / np.abs(true).max() - J / np.abs(J).max()).max() > 0.02, "no arm is the true one"


def test_noise_that_is_declared_is_played(body, known):
    plain = fk.PerturbedArms(body, arms=2, axis_spread=0.0, offset_spread=0.0)
    noisy = dataclasses.replace(plain, image_noise=2e-3, encoder_noise=1e-2)
    assert abs(noisy.predict(known) - plain.predict(known)) > 1e-3


def test_arms_whose_hand_leaves_the_view_are_drawn_again(body, known, monkeypatch):
    monkeypatch.setattr(fk.arms, "_NEAREST", 1e3)
    with pytest.raises(InvalidConfig, match="give smaller spreads"):
        fk.PerturbedArms(body).predict(known)


def test_perfect_knowledge_has_no_error_to_foretell(body, known):
    assert fk.PerturbedArms(body, 2, 0.0, 0.0).predict(dataclasses.replace(known, estimator=Analytic(body))) < 1e-9


# What they are worth ------------------------------------------------------------------------------------------------


def test_r2_and_slope_by_hand():
    measured, predicted = [1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 2.0, 5.0]
    assert fk.r2(measured, predicted) == pytest.approx(1 - 2 / 5)
    # Predicted about their mean: -1.5, -.5, -.5, 2.5; measured: -1.5, -.5, .5, 1.5.
    assert fk.slope(measured, predicted) == pytest.approx((2.25 + 0.25 - 0.25 + 3.75) / 9.0)
    assert fk.r2([*measured, np.nan, 1.0], [*predicted, 1.0, np.nan]) == fk.r2(measured, predicted)
    assert np.isnan(fk.r2([1.0, 1.0], [1.0, 2.0]))
    assert np.isnan(fk.slope([1.0, 2.0], [1.0, 1.0]))


def test_a_condition_is_predicted_from_the_others_alone():
    rng = np.random.default_rng(0)
    x, y = np.exp(rng.normal(size=(2, 6, 4)))
    before = leave_one_condition_out(y, x[None])
    b, a = np.polyfit(np.log(x[1:]).ravel(), np.log(y[1:]).ravel(), 1)
    np.testing.assert_allclose(before[0], np.exp(a) * x[0] ** b)
    y[0] *= 100.0
    after = leave_one_condition_out(y, x[None])
    np.testing.assert_array_equal(after[0], before[0])
    assert (after[1:] != before[1:]).all()


def test_conditions_of_one_group_are_left_out_together():
    rng = np.random.default_rng(0)
    x, y = np.exp(rng.normal(size=(2, 5, 4)))
    before = leave_one_condition_out(y, x[None], groups=["a", "b", "a", "c", "d"])
    y[[0, 2]] *= 100.0
    after = leave_one_condition_out(y, x[None], groups=["a", "b", "a", "c", "d"])
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])


def test_who_knows_the_error_has_r2_one_and_slope_one_in_whatever_unit():
    measured = np.exp(np.random.default_rng(1).normal(size=(8, 5)))
    found = fk.evaluate(measured, {"power": 7.0 * measured**2, "itself": measured}, absolute=["itself"], resamples=50)
    for name in ("power", "itself"):
        one = found[name]
        assert [one.r2.estimate, one.slope.estimate, one.r2_log, one.r2_recordings] == pytest.approx([1.0] * 4)
        # Eight conditions have a value and no interval.
        assert np.isnan(one.r2.lower)
    assert found["itself"].raw_r2 == 1.0
    assert np.isnan(found["power"].raw_r2)


def test_who_knows_nothing_has_no_r2():
    rng = np.random.default_rng(2)
    measured = np.exp(rng.normal(size=(20, 6)) * 0.1 + rng.normal(size=(20, 1)))
    r2 = [fk.evaluate(measured, {"shuffled": measured[rng.permutation(20)]}, resamples=0) for _ in range(20)]
    assert np.mean([one["shuffled"].r2.estimate for one in r2]) < 0.05
    assert r2[0]["mean_of_others"].r2.estimate < 0.0


def test_the_interval_is_of_conditions_and_more_recordings_make_it_no_narrower():
    rng = np.random.default_rng(3)
    true = np.linspace(0.3, 0.8, 20)[:, None]
    # What is foretold is off by its own factor in each condition.
    foretold = true * np.exp(0.2 * rng.normal(size=(20, 1)))
    measured, predicted = (one * np.exp(0.05 * rng.normal(size=(20, 40))) for one in (true, foretold))
    many, few = (fk.evaluate(measured[:, :n], {"one": predicted[:, :n]})["one"] for n in (40, 4))
    assert many.r2.lower < many.r2.estimate < many.r2.upper
    assert (many.r2.units, many.r2.unit) == (20, "conditions")
    widths = [one.r2.upper - one.r2.lower for one in (many, few)]
    assert widths[0] > 0.1
    assert widths[0] == pytest.approx(widths[1], rel=0.4)
    assert few.r2_recordings < few.r2.estimate
    assert np.isnan(fk.evaluate(measured[:19], {"one": predicted[:19]})["one"].r2.lower)


def test_a_combination_weighs_what_helps():
    rng = np.random.default_rng(4)
    depth, noise, chance = np.exp(rng.normal(size=(3, 12, 5)))
    measured = depth * noise**0.5
    given = {"depth": depth, "noise": noise, "chance": chance}
    found = fk.evaluate(measured, given, {"both": Combination(("depth", "noise"), 0.0)}, resamples=0)
    assert found["both"].r2.estimate == pytest.approx(1.0)
    assert found["depth"].r2.estimate < 0.9
    stiff = fk.evaluate(measured, given, {"both": Combination(("depth", "noise"), 1e6)}, resamples=0)["both"]
    others = [np.exp(np.log(np.delete(measured, one, 0)).mean()) for one in range(12)]
    np.testing.assert_allclose(stiff.predicted[:, 0], others, rtol=1e-4)


def test_a_recording_that_failed_is_left_out():
    measured = np.exp(np.random.default_rng(5).normal(size=(6, 4)))
    predicted = measured.copy()
    predicted[2, 1] = np.nan
    measured[3] = np.nan
    one = fk.evaluate(measured, {"one": predicted}, resamples=0)["one"]
    assert one.r2.estimate == pytest.approx(1.0)
    assert np.isnan(one.predicted[2, 1])


def test_who_is_silent_on_a_condition_has_no_score():
    rng = np.random.default_rng(7)
    measured = np.exp(rng.normal(size=(6, 4, 30)))
    half = measured.copy()
    half[3:] = np.nan
    y, x = measured[..., 0], half[..., 0]
    found = fk.evaluate(y, {"half": x, "whole": y}, {"both": Combination(("half", "whole"))}, absolute=["half"])
    for one in (found["half"], found["both"]):
        scores = [one.r2.estimate, one.r2.lower, one.slope.estimate, one.r2_log, one.r2_recordings]
        assert np.isnan([*scores, one.raw_r2, one.raw_slope]).all()
    assert found["whole"].r2.estimate == pytest.approx(1.0)
    by_posture = fk.evaluate_by_posture(measured, half)
    assert np.isnan([by_posture.rank_correlation, by_posture.r2]).all()


def test_postures_are_scored_within_recordings():
    rng = np.random.default_rng(6)
    measured = np.exp(rng.normal(size=(5, 3, 40)))
    perfect = fk.evaluate_by_posture(measured, measured**3)
    assert (perfect.rank_correlation, perfect.r2) == pytest.approx((1.0, 1.0))
    # Knows each recording's mean error, and nothing of its postures.
    level = measured.mean(-1, keepdims=True) * np.exp(0.01 * rng.normal(size=measured.shape))
    assert fk.evaluate_by_posture(measured, level).rank_correlation == pytest.approx(0.0, abs=0.2)
    assert np.isnan(fk.evaluate_by_posture(measured, np.full_like(measured, np.nan)).r2)


# The whole ----------------------------------------------------------------------------------------------------------

SHOWN = [one for one in fk.CONDITIONS if one.name in ("kinematic, 3 cm", "kinematic, 8 cm", "one turn, 3 cm")]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """Three conditions, one recording each."""
    study = fk.grid(seeds=1, touch_duration=10.0, conditions=SHOWN)
    store = tmp_path_factory.mktemp("foreknowledge")
    return study.run(store, "in-process"), store


@pytest.fixture(scope="module")
def summary(done, body):
    return done[0], fk.judge(done[0], body, SHOWN)


def test_a_run_is_summed_up(summary):
    results, found = summary
    assert (results["failure"] == "").all()
    for estimator in fk.ESTIMATORS:
        one, values = found["estimators"][estimator], results.sel(estimator=estimator).isel(embodiment=0, seed=0)
        order = [condition.recording for condition in SHOWN]
        assert one["measured"] == pytest.approx(values["measured"].sel(recording=order).values, rel=1e-4)
        missing = {name for name, score in one["predictors"].items() if score.get("missing", 0)}
        assert missing == ({"perturbed_arms_rough"} if estimator == "rational_trig" else set())
        # Nothing is left to chance where images have no noise: the arm is found.
        calibrated = values["foreseen"].sel(predictor="calibrated_arm")
        np.testing.assert_allclose(calibrated, values["measured_touching"], rtol=0.05)
    page = fk.markdown(found)
    assert all(one["assumes"] in page for one in found["predictors"].values())


def test_what_is_foretold_and_measured_is_that_of_the_public_functions(done, body):
    results, store = done
    condition = SHOWN[0]
    seen = bk.study.recording_of(store, condition.recording, 0)
    touch = bk.study.recording_of(store, condition.recording, 0, "use")
    one = results.sel(recording=condition.recording, estimator="least_squares").isel(embodiment=0, seed=0)
    known = fk.Known.of(seen, touch.q.values, LeastSquares(), seed=0)
    for name in ("posture_distance", "excitation_deficit"):
        said = fk.predictors(body, bk.Noise(), "LeastSquares")[name].foresee(known)
        assert float(one["foreseen"].sel(predictor=name)) == said.error
    W = bk.metrics.motion_metric(touch, "true")
    q = body.touch_postures(range(body.skin.count))
    J, Jh = body.hand_image_jacobian(q).numpy(), known.learned.jacobian(q).numpy()
    assert float(one["measured"]) == pytest.approx(bk.metrics.pooled_relative_error(J, Jh, W), rel=1e-12)
    q = torch.from_numpy(touch["true_q"].values.reshape(-1, body.p)[known.samples])
    J, Jh = body.hand_image_jacobian(q).numpy(), known.learned.jacobian(q).numpy()
    assert float(one["measured_touching"]) == pytest.approx(bk.metrics.pooled_relative_error(J, Jh, W), rel=1e-12)


def test_who_refuses_is_never_crowned_and_its_first_words_are_shown(summary, body, monkeypatch):
    results, found = summary
    second = SHOWN[1]
    silent = results.copy(deep=True)
    silent["refused"] = silent["refused"].astype(object)
    at = {"recording": second.recording}
    silent["foreseen"].loc[at] = np.nan
    silent["refused"].loc[at] = "InvalidConfig: too dark"
    page = fk.markdown(fk.judge(silent, body, SHOWN))
    assert page.count(
        f"distance of mean postures refused first in {second.name}, seed 0: InvalidConfig: too dark"
    ) == len(fk.ESTIMATORS)
    assert "none spoke of every condition" not in page
    assert "R2 of at least" not in page
    for one in found["estimators"].values():
        for score in one["predictors"].values():
            monkeypatch.setitem(score["r2"], "estimate", None)
    assert fk.markdown(found).count("No predictor has an R2") == len(fk.ESTIMATORS)


def test_conditions_are_paired_by_seed_and_their_recordings_have_streams_of_their_own(done):
    _, store = done
    near, far, turn = (
        {role: bk.study.recording_of(store, one.recording, 0, role) for role in ("training", "use")} for one in SHOWN
    )
    xr.testing.assert_equal(near["use"], far["use"])
    assert not np.array_equal(near["training"].q, far["training"].q)
    assert near["use"].sizes != turn["training"].sizes


def test_several_distances_are_trials_of_one_recording(tmp_path):
    condition = next(one for one in fk.CONDITIONS if len(one.distances) > 1)
    kinematic = dataclasses.replace(condition, dynamics=False, noise=bk.Noise(), turns=0.2)
    study = dataclasses.replace(
        fk.grid(seeds=1, touch_duration=2.0, conditions=[kinematic]),
        scores=["relative_error"],
        estimators={"one": "LeastSquares"},
    )
    study.run(tmp_path / "s", "in-process")
    assert bk.study.recording_of(tmp_path / "s", kinematic.recording, 0).sizes["trial"] == len(condition.distances)


def test_what_failed_has_its_words(summary, body):
    results, _ = summary
    second = SHOWN[1]
    broken = results.copy(deep=True)
    broken["failure"] = broken["failure"].astype(object)
    at = {"recording": second.recording}
    broken["failure"].loc[at] = "ValueError: no light"
    for name in ("measured", "measured_touching", "measured_by_posture", "foreseen", "foreseen_by_posture"):
        broken[name].loc[at] = np.nan
    summed = fk.judge(broken, body, SHOWN)
    page = fk.markdown(summed)
    assert summed["failed"][0]["words"] == "ValueError: no light"
    assert f"- {second.recording}/least_squares, seed 0: ValueError: no light" in page
    assert summed["estimators"]["least_squares"]["measured"][1] is None
    broken["failure"][:] = "ValueError: no light"
    with pytest.raises(fk.NothingCame, match="no light"):
        fk.judge(broken, body, SHOWN)


def test_figures_show_the_numbers(summary):
    _, found = summary
    with figures.style():
        (predicted, bars) = figures.panels(1, 2)[1][0]
    figures.predicted_errors(found, "least_squares", "posture_distance", predicted)
    one = found["estimators"]["least_squares"]
    wanted = np.c_[one["predictors"]["posture_distance"]["predicted"], one["measured"]]
    drawn = np.concatenate([points.get_offsets() for points in predicted.collections])
    np.testing.assert_allclose(sorted(drawn.tolist()), sorted(wanted.tolist()))
    figures.r2_bars(found, "least_squares", bars)
    r2 = [score["r2"]["estimate"] for score in one["predictors"].values()]
    assert [bar.get_width() for bar in bars.patches] == pytest.approx(r2)
    assert bars.get_xlim()[0] == -1
    with pytest.raises(UnknownName, match="no estimator 'least_sqares'; did you mean 'least_squares'"):
        figures.predicted_errors(found, "least_sqares", "posture_distance", predicted)
    with pytest.raises(UnknownName, match="no predictor 'nobody'"):
        figures.predicted_errors(found, "least_squares", "nobody", predicted)


def test_all_predictors_say_what_they_assume(body):
    for name, one in fk.predictors(body, bk.Noise(), "LeastSquares").items():
        assert one.assumes, name
    assert len({one.name for one in fk.CONDITIONS}) == len(fk.CONDITIONS)


@pytest.mark.parametrize(
    ("call", "error", "match"),
    [
        (lambda b, c, t: fk.Known.of(c, np.zeros((4, 3)), LeastSquares()), InvalidPosture, "last axis must have 5"),
        (lambda b, c, t: fk.Known.of(c, np.zeros((4, 5)), LeastSquares()), InvalidPosture, "record a motion"),
        (lambda b, c, t: fk.Known.of(c, np.zeros(5), LeastSquares()), InvalidPosture, "in order"),
        (lambda b, c, t: fk.Known.of(c, t.q.values, "LeastSquares"), InvalidConfig, "an estimator"),
        (lambda b, c, t: fk.Known.of(c, t.q.values, LeastSquares(), most=0), InvalidConfig, "most=0"),
        (lambda b, c, t: fk.MeanPostureDistance("inch"), InvalidConfig, "'radian', 'seen'"),
        (lambda b, c, t: fk.GaussianProcessPosterior(draws=0), InvalidConfig, "draws=0"),
        (lambda b, c, t: fk.GaussianProcessPosterior("cubic"), InvalidConfig, "kernel='cubic'"),
        (lambda b, c, t: fk.PerturbedArms(b, arms=0), InvalidConfig, "arms=0"),
        (lambda b, c, t: fk.PerturbedArms(b, offset_spread=-1.0), InvalidConfig, "offset_spread=-1.0"),
        (lambda b, c, t: Combination(()), InvalidConfig, "names of predictors"),
        (lambda b, c, t: Combination(("a",), -1.0), InvalidConfig, "penalty=-1.0"),
        (lambda b, c, t: fk.evaluate(np.ones((4, 2)), {"a": np.ones((4, 3))}), InvalidArray, "'a' has shape"),
        (lambda b, c, t: fk.evaluate(np.ones((2, 2)), {"a": np.ones((2, 2))}), InvalidArray, "at least 3"),
        (
            lambda b, c, t: fk.evaluate(np.ones((4, 2)), {"a": np.ones((4, 2))}, {"c": Combination(("b",))}),
            UnknownName,
            "no predictor 'b'",
        ),
        (lambda b, c, t: fk.r2([1.0], [1.0, 2.0]), InvalidArray, "must be the same"),
        (lambda b, c, t: fk.grid(seeds=0), InvalidConfig, "seeds"),
        (lambda b, c, t: fk.grid(touch_duration=0.0), InvalidConfig, "touch_duration=0"),
    ],
)
@pytest.mark.usefixtures("unchecked")
def test_what_is_wrong_is_named(call, error, match, body, circle, touch):
    with pytest.raises(error, match=match):
        call(body, circle, touch)
    assert issubclass(error, BodyImageKinError)
