"""Foretold errors: from what may be known alone, held against the truth out of sample."""

from __future__ import annotations

import dataclasses
from concurrent.futures import Executor, Future

import numpy as np
import pytest
import torch
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin.errors import (
    BodyImageKinError,
    InvalidArray,
    InvalidConfig,
    InvalidPosture,
    OutputRefused,
    UnknownName,
)
from bodyimage_kin.estimators import Analytic, LeastSquares, PaperMLP
from bodyimage_kin.figures import foreknowledge_figures
from bodyimage_kin.published import foreknowledge as fk
from bodyimage_kin.published.foreknowledge import cell as cell_module
from bodyimage_kin.published.foreknowledge import store as store_module
from bodyimage_kin.published.foreknowledge.cell import ESTIMATORS, predictors, run_cell
from bodyimage_kin.published.foreknowledge.evaluate import Combination, leave_one_condition_out
from bodyimage_kin.study import executors

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
        drawn, _ = fk.GaussianProcessPosterior(draws=16, most=200).worlds(known)
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
    true, estimated = arms.worlds(known)
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
    assert fk.PerturbedArms(body, 2, 0.0, 0.0).predict(known.about(Analytic(body))) < 1e-9


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
        assert one.r2.lower == pytest.approx(1.0)
    assert found["itself"].raw_r2 == 1.0
    assert np.isnan(found["power"].raw_r2)


def test_who_knows_nothing_has_no_r2():
    rng = np.random.default_rng(2)
    measured = np.exp(rng.normal(size=(20, 6)) * 0.1 + rng.normal(size=(20, 1)))
    r2 = [fk.evaluate(measured, {"shuffled": measured[rng.permutation(20)]}, resamples=0) for _ in range(20)]
    assert np.mean([one["shuffled"].r2.estimate for one in r2]) < 0.05
    assert r2[0]["mean_of_others"].r2.estimate < 0.0


def test_the_interval_is_of_recordings():
    rng = np.random.default_rng(3)
    true = np.linspace(0.3, 0.8, 8)[:, None]
    measured, predicted = (true * np.exp(0.1 * rng.normal(size=(8, 10))) for _ in "ab")
    one = fk.evaluate(measured, {"one": predicted})["one"]
    assert 0.5 < one.r2.lower < one.r2.estimate + 0.02 < one.r2.upper + 0.04 <= 1.04
    assert one.r2.recordings == 10
    assert one.r2_recordings < one.r2.estimate
    few = fk.evaluate(measured[:, :2], {"one": predicted[:, :2]})["one"].r2
    assert np.isnan(few.lower)


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


@pytest.fixture(scope="module")
def summary():
    settings = fk.Settings(seeds=1, touch_duration=10.0, arms=1, postures=10)
    conditions = [one for one in fk.CONDITIONS if one.name in ("kinematic, 3 cm", "kinematic, 8 cm", "one turn, 3 cm")]
    cells = {one.name: [run_cell(settings, one, 0)] for one in conditions}
    return cells, fk.summarise(settings, cells, conditions)


def test_a_run_is_summed_up(summary):
    cells, found = summary
    for e, estimator in enumerate(ESTIMATORS):
        one = found["estimators"][estimator]
        assert one["measured"] == pytest.approx([cell[0].measured[e] for cell in cells.values()], rel=1e-4)
        missing = {name for name, score in one["predictors"].items() if score.get("missing", 0)}
        assert missing == ({"perturbed_arms_rough"} if estimator == "rational_trig" else set())
        # Nothing is left to chance where images have no noise: the arm is found.
        calibrated = [cell[0].foreseen[list(found["predictors"]).index("calibrated_arm"), e] for cell in cells.values()]
        np.testing.assert_allclose(calibrated, [cell[0].measured_touching[e] for cell in cells.values()], rtol=0.05)
    page = fk.markdown(found)
    assert all(one["assumes"] in page for one in found["predictors"].values())


def test_who_refuses_is_never_crowned_and_its_first_words_are_shown(summary, monkeypatch):
    cells, found = summary

    def silence(one):
        refused = {name: dict.fromkeys(found["predictors"], "InvalidConfig: too dark") for name in ESTIMATORS}
        return dataclasses.replace(one, foreseen=one.foreseen * np.nan, refused=refused)

    settings = fk.Settings(**found["settings"])
    conditions = [fk.Condition(**{**one, "distances": tuple(one["distances"])}) for one in found["conditions"]]
    second = conditions[1].name
    page = fk.markdown(fk.summarise(settings, {**cells, second: [silence(cells[second][0])]}, conditions))
    assert page.count(f"distance of mean postures refused first in {second}, seed 0: InvalidConfig: too dark") == 3
    assert "none spoke of every condition" not in page
    assert "R2 of at least" not in page
    assert "refused" not in fk.markdown(found)
    for one in found["estimators"].values():
        for score in one["predictors"].values():
            monkeypatch.setitem(score["r2"], "estimate", None)
    assert fk.markdown(found).count("No predictor has an R2") == 3


def test_touch_and_circles_have_streams_of_their_own(body):
    noisy = next(one for one in fk.CONDITIONS if one.name == "noisy sensors, 3 cm")
    several = dataclasses.replace(noisy, dynamics=False, turns=0.2, distances=(0.03, 0.03))
    circles, touch = several.circle(body, 3), several.touch(body, 3, 2.0)
    noise = [one.q.values - one.true_q.values for one in (circles.isel(trial=0), circles.isel(trial=1), touch)]
    noise[2] = noise[2][0]
    count = min(map(len, noise))
    for one, other in ((0, 1), (0, 2), (1, 2)):
        assert abs(np.corrcoef(noise[one][:count].ravel(), noise[other][:count].ravel())[0, 1]) < 0.3
    alone = dataclasses.replace(several, name="another", distances=(0.03,))
    np.testing.assert_array_equal(alone.circle(body, 3).q[0], circles.q[0], "conditions are paired by seed")
    xr.testing.assert_equal(alone.touch(body, 3, 2.0), touch)


def test_a_touch_motion_is_shared_by_conditions_that_move_alike():
    alike = {cell_module._moved(one) for one in fk.CONDITIONS}
    assert len(alike) == 4, "driven, free, kinematic, noisy sensors"
    assert {(one.dynamics, one.torque_noise, one.encoder_noise, one.image_noise) for one in alike} == {
        (one.dynamics, one.torque_noise, one.encoder_noise, one.image_noise) for one in fk.CONDITIONS
    }


def test_what_fails_fails_alone_and_only_that_is_computed_again(summary, tmp_path, monkeypatch):
    cells, found = summary
    settings = fk.Settings(**found["settings"])
    conditions = [one for one in fk.CONDITIONS if one.name in cells]
    asked, done = [], []

    def work(settings, condition, seed, fail=True):
        asked.append(condition.name)
        if fail and condition is conditions[1]:
            raise ValueError("no\nlight")
        return cells[condition.name][seed]

    def run():
        return fk.run(
            settings, conditions, executor="in-process", store=tmp_path / "s", progress=lambda *one: done.append(one)
        )

    monkeypatch.setattr(cell_module, "run_cell", work)
    first = run()
    assert done == [(0, 3), (1, 3), (2, 3), (3, 3)]
    assert first[conditions[1].name] == [fk.Failed("ValueError: no light")]
    summed = fk.summarise(settings, first, conditions)
    page = fk.markdown(summed)
    assert summed["failed"] == [{"condition": conditions[1].name, "seed": 0, "words": "ValueError: no light"}]
    assert f"- {conditions[1].name}, seed 0: ValueError: no light" in page
    assert summed["estimators"]["least_squares"]["measured"][1] is None
    with pytest.raises(fk.NothingCame, match="no light"):
        fk.summarise(settings, dict.fromkeys(first, first[conditions[1].name]), conditions)

    monkeypatch.setattr(cell_module, "run_cell", lambda *job: work(*job, fail=False))
    asked.clear()
    again = run()
    assert asked == [conditions[1].name]
    for name, (cell,) in again.items():
        for field in dataclasses.fields(cell):
            np.testing.assert_array_equal(getattr(cell, field.name), getattr(cells[name][0], field.name))
    one = next((tmp_path / "s").iterdir())
    one.write_bytes(b"")
    with pytest.raises(OutputRefused, match=f"{one.name}' cannot be read"):
        run()


@pytest.mark.parametrize("problem", [executors.WorkerDied("no memory left"), executors.NoWorker("none can start")])
def test_a_process_that_dies_takes_its_own_cell_along(problem):
    class Dying(Executor):
        def submit(self, *_, **__):
            future = Future()
            future.set_exception(problem)
            return future

    conditions = fk.CONDITIONS[:2]
    if isinstance(problem, BodyImageKinError):
        with pytest.raises(executors.NoWorker):
            fk.run(fk.Settings(seeds=1), conditions, executor=Dying())
        return
    found = fk.run(fk.Settings(seeds=1), conditions, executor=Dying())
    assert found == {one.name: [fk.Failed("WorkerDied: no memory left")] for one in conditions}


def test_a_cell_is_kept_by_all_that_decides_it(tmp_path):
    settings, condition = fk.Settings(), fk.CONDITIONS[0]
    store = store_module.Store(tmp_path, settings, "body")
    same = dataclasses.replace(store, settings=fk.Settings(seeds=3))._path(condition, 1)
    assert same == store._path(condition, 1)
    others = [
        store._path(condition, 2),
        store._path(dataclasses.replace(condition, radius=0.04), 1),
        dataclasses.replace(store, settings=fk.Settings(arms=3))._path(condition, 1),
        dataclasses.replace(store, body="another")._path(condition, 1),
    ]
    assert len({same, *others}) == 5


def test_several_distances_are_trials_of_one_recording(body):
    condition = next(one for one in fk.CONDITIONS if len(one.distances) > 1)
    kinematic = dataclasses.replace(condition, dynamics=False, turns=0.2)
    seen = kinematic.circle(body, 0)
    assert seen.sizes["trial"] == len(condition.distances)
    for trial, distance in enumerate(condition.distances):
        own = kinematic.streams(0)[1 + trial]
        alone = bk.simulate(body, bk.motions.Circle(distance=distance, turns=0.2), own, dynamics=False)
        one = seen.isel(trial=[trial], time=slice(0, alone.sizes["time"]))
        xr.testing.assert_equal(one.drop_vars("trial"), alone.drop_vars("trial"))
        assert (seen["touched"].values[trial, alone.sizes["time"] :] == -1).all()
        assert {name: one[name].dtype for name in one} == {name: alone[name].dtype for name in alone}


def test_figures_show_the_numbers(summary):
    _, found = summary
    figure = foreknowledge_figures.predicted_against_measured(found, "least_squares")
    axes = figure.axes[0]
    drawn = [line.get_xydata()[0] for line in axes.get_lines()[1:]]
    one = found["estimators"]["least_squares"]
    wanted = np.c_[one["predictors"]["posture_distance"]["predicted"], one["measured"]]
    np.testing.assert_allclose(drawn, wanted)
    bars = foreknowledge_figures.r2_bars(found).axes[0].patches
    r2 = [score["r2"]["estimate"] for score in one["predictors"].values()]
    assert [bar.get_width() for bar in bars] == pytest.approx(np.maximum(r2, -1.0))
    with pytest.raises(UnknownName, match="no estimator 'least_sqares'; did you mean 'least_squares'"):
        foreknowledge_figures.predicted_against_measured(found, "least_sqares")


def test_all_predictors_say_what_they_assume(body):
    for name, one in predictors(fk.Settings(), body, fk.CONDITIONS[0], "least_squares").items():
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
        (lambda b, c, t: fk.Settings(seeds=0), InvalidConfig, "seeds=0"),
        (lambda b, c, t: fk.run(fk.Settings(), workers=0), InvalidConfig, "workers=0"),
        (lambda b, c, t: fk.run(fk.Settings(), workers=1.5), InvalidConfig, "workers=1.5"),
        (lambda b, c, t: fk.run(fk.Settings(), workers=True), InvalidConfig, "workers=True"),
    ],
)
def test_what_is_wrong_is_named(call, error, match, body, circle, touch):
    with pytest.raises(error, match=match):
        call(body, circle, touch)
    assert issubclass(error, BodyImageKinError)


@pytest.mark.slow
def test_no_bit_depends_on_the_number_of_workers():
    settings = fk.Settings(seeds=2, touch_duration=10.0, arms=1, postures=10)
    conditions = [one for one in fk.CONDITIONS if one.name in ("one turn, 3 cm", "noise-free, 3 cm")]
    done = []
    found = fk.run(settings, conditions, workers=2, progress=lambda *one: done.append(one))
    assert done == [(0, 4), (1, 4), (2, 4), (3, 4), (4, 4)]
    for condition in conditions:
        for seed in range(2):
            here, there = run_cell(settings, condition, seed), found[condition.name][seed]
            for field in dataclasses.fields(here):
                np.testing.assert_array_equal(getattr(here, field.name), getattr(there, field.name))
