"""Tuning: one budget for all, judged on what was seen alone, everything recorded."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import torch
import xarray as xr
from experiences import taught
from hypothesis import given
from hypothesis import strategies as st

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig, InvalidRecording, UnknownName
from bodyimage_kin.estimators import ConstantJacobian, Estimator, LeastSquares, Ridge, pairs
from bodyimage_kin.metrics.held_out import hold_out, hold_out_far, image_regions
from bodyimage_kin.study.random_streams import stream
from bodyimage_kin.study.spaces import SPACES, checked_space, points
from bodyimage_kin.study.specs import ESTIMATOR
from bodyimage_kin.study.tuning import read_tuning, tune, write_tuning

PENALTIES = {"penalty": {"log_uniform": [1e-8, 1.0]}}
QUICK = ("Ridge", "NearestNeighbours", "Broyden", "RecursiveLeastSquares", "Kalman", "TrigRidge")


def motion(noise=0.0, steps=120, seed=0, p=4, excited=1.0):
    """Three turns of a circle in the image, by a constant Jacobian; joints beyond the second move as `excited`."""
    rng = np.random.default_rng(seed)
    phase = np.linspace(0.0, 6.0 * np.pi, steps + 1)
    q = np.stack([np.cos(phase), np.sin(phase)], 1)
    q = np.concatenate([q, excited * 0.1 * rng.standard_normal((steps + 1, p - 2)).cumsum(0)], 1)
    J = np.concatenate([np.eye(2), 0.1 * rng.standard_normal((2, p - 2))], 1)
    dq = np.diff(q, axis=0)
    return taught(dq, dq @ J.T + noise * rng.standard_normal((steps, 2)))


SPIED: list[xr.Dataset] = []


@dataclass(frozen=True)
class Spy(Estimator):
    """Keeps what it is taught."""

    scale: float = 1.0

    def fit(self, exp, seed=0):
        SPIED.append(exp)
        return LeastSquares(self.scale).fit(exp, seed)


@dataclass(frozen=True)
class Memory(Estimator):
    """Says what it saw at a posture, and nothing elsewhere: knows hidden steps only if they leak."""

    scale: float = 1.0

    def fit(self, exp, seed=0):
        data = pairs(exp)
        seen = {tuple(q): dr for q, dr in zip(data.q.tolist(), data.dr, strict=True)}

        class Remembered(ConstantJacobian):
            def _displacement(self, q, dq):
                return torch.stack([seen.get(tuple(one), torch.zeros(2, dtype=q.dtype)) for one in q.tolist()])

        return Remembered(torch.zeros(data.dr.shape[1], data.q.shape[1], dtype=torch.float64))


class Blinking(ConstantJacobian):
    """Foretells all steps but one."""

    def _displacement(self, q, dq):
        foreseen = super()._displacement(q, dq)
        foreseen[0] = torch.nan
        return foreseen


@dataclass(frozen=True)
class Moody(Estimator):
    """Goes wrong in all ways but one."""

    way: str = "fits"

    def fit(self, exp, seed=0):
        if self.way == "raises":
            raise ValueError("no such\nluck")
        matrix = LeastSquares().fit(exp, seed).matrix
        if self.way == "leaves":
            raise SystemExit(1)
        if self.way == "blinks":
            return Blinking(matrix)
        wrong = {"nan": torch.full_like(matrix, torch.nan), "shape": matrix[:1], "huge": matrix * 1e200, "fits": matrix}
        return ConstantJacobian(wrong[self.way])


class Loose:
    """No subclass, no dataclass; `fit` alone."""

    def __init__(self, factor=2.0):
        self.factor = factor

    def fit(self, exp, seed=0):
        return LeastSquares(self.factor).fit(exp, seed)


# What is hidden ------------------------------------------------------------------------------------------------------


@given(
    count=st.integers(0, 60), m=st.integers(1, 4), regions=st.integers(1, 6), seed=st.integers(0, 9), flat=st.booleans()
)
def test_regions_are_of_equal_numbers_whatever_the_image(count, m, regions, seed, flat):
    image = np.random.default_rng(seed).standard_normal((count, m)) * (0.0 if flat else 1.0)
    sizes = np.bincount(image_regions(image, regions), minlength=regions)
    assert len(sizes) == regions
    assert sizes.sum() == count
    assert sizes.max() - sizes.min() <= 1


@pytest.mark.parametrize("regions", [2, 3, 4])
def test_regions_of_a_circle_are_arcs_and_the_same_in_every_turn(regions):
    phase = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False) + 0.001
    turn = np.stack([np.cos(phase), np.sin(phase)], 1)
    region = image_regions(np.concatenate([turn, turn]), regions)
    # Equal images of the two turns may be parted at a cut only.
    assert (region[:360] != region[360:]).sum() <= 2 * regions
    once = region[:360]
    assert (once != np.roll(once, 1)).sum() <= regions + 2


def test_regions_of_a_line_are_stretches_of_it():
    line = np.linspace(-1.0, 1.0, 90)[:, None] * [0.6, 0.8, 0.0]
    np.testing.assert_array_equal(image_regions(line, 3), np.repeat([0, 1, 2], 30))


def test_every_step_is_hidden_or_seen_or_crosses_a_border():
    exp = motion()
    whole = {tuple(q) for q in pairs(exp).q.tolist()}
    found = hold_out(exp, 3)
    assert len(found) == 3
    for lesson in found:
        seen, hidden = ({tuple(q) for q in part.q.tolist()} for part in (pairs(lesson.seen), lesson.hidden))
        assert not seen & hidden
        assert seen | hidden <= whole
        assert len(whole - seen - hidden) < 0.2 * len(whole)
    steps = np.concatenate([lesson.hidden.q for lesson in found])
    assert len({tuple(q) for q in steps.tolist()}) == len(steps)


def test_what_lies_farthest_is_hidden_and_a_gap_left_beside_it():
    exp = motion()
    q = exp["q"].values[0]
    for index, one in enumerate(hold_out_far(exp, 6, seed=3)):
        rng = np.random.default_rng(3)
        direction = rng.standard_normal((index + 1, q.shape[1]))[index]
        kept = np.isfinite(one.seen["hand_image"].values[0]).all(-1)
        assert (q[kept] @ direction).max() < (one.hidden.q.numpy() @ direction).min()
        assert kept.mean() == pytest.approx(0.65, abs=0.02)
        assert 0.15 < len(one.hidden.q) / len(q) <= 0.25
    # The first directions are those of fewer.
    for one, other in zip(hold_out_far(exp, 2, seed=3), hold_out_far(exp, 6, seed=3)[:2], strict=True):
        xr.testing.assert_identical(one.seen, other.seen)
    with pytest.raises(InvalidConfig, match=r"gap=0\.8"):
        hold_out_far(exp, share=0.25, gap=0.8)


def test_of_several_circles_one_goes_when_postures_lie_along_their_distance():
    one = motion()
    far = one.assign(q=one["q"] + 100.0)
    exp = xr.concat([one, far, far.assign(q=far["q"] + 100.0)], "trial", data_vars="minimal", coords="minimal")
    for lesson in hold_out_far(exp, 4, share=1 / 3, gap=0.0):
        seen = np.isfinite(lesson.seen["hand_image"].values).all(-1).mean(1)
        assert sorted(seen.round(1)) == [0.0, 1.0, 1.0]
        assert seen[1] == 1.0


def test_points_fill_a_space_more_evenly_than_chance_and_are_the_same_for_everybody():
    space = {"a": {"uniform": [0.0, 1.0]}, "b": {"uniform": [0.0, 1.0]}}
    found = np.array([[one["a"], one["b"]] for one in points(space, 64, 5)])
    cells = np.histogram2d(*found.T, bins=4, range=[[0, 1], [0, 1]])[0]
    assert cells.min() >= 2
    assert list(points(space, 8, 5)) == list(points(space, 64, 5))[:8]
    assert list(points(space, 8, 6)) != list(points(space, 8, 5))


def test_trials_and_unseen_samples_are_handled():
    one = motion()
    exp = xr.concat([one, one], "trial", data_vars="minimal", coords="minimal", compat="equals")
    exp["hand_image"].values[1, 10:40] = np.nan
    exp["q"].values[0, -20:] = np.nan
    for lesson in hold_out(exp, 4):
        assert np.isnan(lesson.seen["hand_image"].values[1, 10:40]).all()
        assert np.isfinite(lesson.hidden.q.numpy()).all()


def test_what_is_hidden_is_never_given_to_the_learner(circle):
    SPIED.clear()
    exp = bk.experience(circle)
    before = exp.copy(deep=True)
    # The recording itself, truth and all, as a careless user would.
    tune(Spy(), [circle], budget=2, space={"scale": {"uniform": [0.5, 2.0]}}, draws=3)
    assert len(SPIED) == 6
    images = []
    hidden_in_turn = hold_out_far(exp, 3, seed=stream(0, "tuning/directions/0")[0])
    for given_, lesson in zip(SPIED, 2 * hidden_in_turn, strict=True):
        assert not [name for name in given_.variables if str(name).startswith("true_")]
        xr.testing.assert_identical(given_, lesson.seen)
        images.append(given_["hand_image"].values[0])
        hidden = {tuple(r) for r in lesson.hidden.q.tolist()}
        assert not hidden & {tuple(r) for r in given_["q"].values[0][np.isfinite(images[-1]).all(-1)].tolist()}
    # A quarter is hidden each time, and a tenth beside it left out.
    np.testing.assert_allclose(np.isnan(images[:3]).any(-1).mean(1), 0.35, atol=0.02)
    xr.testing.assert_identical(bk.experience(circle), before)


def test_memory_alone_is_worth_nothing():
    found = tune(Memory(), [motion()], budget=1, space={})
    assert found.candidates[0].errors == ((1.0,) * 4,)


# The search ----------------------------------------------------------------------------------------------------------


def test_least_squares_of_a_linear_world_has_no_error_but_rounding():
    found = tune("LeastSquares", [motion(), motion(seed=1)])
    assert found.candidates[0].errors == ((1e-6,) * 4, (1e-6,) * 4)
    assert found.chosen == {"LeastSquares": {"scale": 1.0}}
    assert len(found.candidates) == 1
    assert found.space == {}


def test_the_score_is_the_relative_displacement_error():
    found = tune(LeastSquares(scale=1.25), [motion(), motion(seed=1)], budget=3)
    np.testing.assert_allclose(found.candidates[0].errors, 0.25)
    assert found.candidates[0].score() == pytest.approx(0.25)


def test_ridge_shrinks_the_more_the_noisier_the_images_are():
    chosen = []
    for noise in (0.0, 0.3, 30.0):
        exps = [motion(noise, seed=seed, p=12, steps=60, excited=0.3) for seed in range(3)]
        found = tune(Ridge(penalty=1e-3), exps, budget=20, space=PENALTIES)
        chosen.append(found.best().settings["penalty"])
    quiet, noisy, drowned = chosen
    assert quiet < 1e-5 < noisy < drowned


def test_what_is_best_of_a_grid_is_found():
    grid = [2.0, 1.5, 1.1, 0.7, 1.0, 0.3]
    found = tune(Spy(scale=5.0), [motion(0.01)], budget=30, space={"scale": {"choice": grid}})
    assert found.chosen == {f"{Spy.__module__}:Spy": {"scale": 1.0}}
    # All of a small space, the spec as given first, and none twice.
    tried = [one.settings["scale"] for one in found.candidates]
    assert tried[0] == 5.0
    assert sorted(tried) == sorted([5.0, *grid])


def test_one_setting_is_chosen_for_all_experiences_and_the_best_of_each_is_known():
    exps = [motion(seed=0), motion(30.0, seed=1, p=4)]
    found = tune(Ridge(penalty=1e-3), exps, budget=12, space=PENALTIES)
    for one in found.candidates:
        assert one.score() == pytest.approx(np.exp(np.log(one.errors).mean()))
        assert found.best().score() <= one.score()
        assert found.best([0]).score([0]) <= one.score([0])
        assert found.best([1]).score([1]) <= one.score([1])
        for draw, best in enumerate(found.by_draw()):
            assert best.score(draws=[draw]) <= one.score(draws=[draw])
    assert found.best([0]).settings != found.best([1]).settings
    assert found.chosen == ESTIMATOR.table({"Ridge": dict(found.best().settings)})


def test_the_same_seed_gives_the_same_search_whatever_else_is_tuned():
    exps = [motion(0.1)]
    first = tune("Ridge", exps, budget=6, seed=3)
    tune("Kalman", exps, budget=6, seed=3)
    torch.rand(5)
    np.random.default_rng().random()
    assert tune("Ridge", exps, budget=6, seed=3) == first
    other = tune("Ridge", exps, budget=6, seed=4)
    assert [one.settings for one in other.candidates] != [one.settings for one in first.candidates]
    # A larger budget goes on where the smaller one ended.
    assert tune("Ridge", exps, budget=9, seed=3).candidates[:6] == first.candidates


@pytest.mark.parametrize("name", QUICK)
def test_every_estimator_gets_the_same_budget_and_its_default_first(name):
    found = tune(name, [motion(0.05, p=3)], budget=7)
    assert len(found.candidates) == found.budget == 7
    (default,) = ESTIMATOR.table(name).values()
    assert found.candidates[0].settings == {key: default.get(key) for key in SPACES[name]}
    assert found.best().score() <= found.candidates[0].score()
    assert all(one.seconds > 0 for one in found.candidates)


def test_networks_are_trained_together_and_judged(circle):
    found = tune(
        bk.estimators.ForwardNetwork(hidden=(4,), steps=30),
        [circle],
        budget=2,
        space={"hidden": {"choice": [[4], [6], [3, 3]]}, "steps": {"uniform": [5, 20]}},
    )
    assert not any(one.failure for one in found.candidates)
    assert isinstance(found.candidates[1].settings["steps"], int)


def test_an_estimator_with_a_body_gets_it(body, circle):
    spec = {"SelfCalibration": {"starts": 1, "steps": 3}}
    found = tune(spec, [circle], budget=2, body=body, space={"steps": {"choice": [1, 2, 3]}})
    assert "body" not in found.chosen["SelfCalibration"]
    assert found.chosen["SelfCalibration"]["starts"] == 1
    assert tune("Analytic", [circle], body=body).best().score() < 0.05
    with pytest.raises(InvalidConfig, match="SelfCalibration wants an embodiment; give body="):
        tune("SelfCalibration", [circle])


def test_an_estimator_of_the_users_own_is_tuned():
    name = "odd_estimators:Plain"
    found = tune(name, [motion()], budget=8, space={"scale": {"choice": [3.0, 1.0, 0.5]}})
    assert found.chosen[name] == dict(found.best().settings)
    assert found.best().errors == ((1e-6,) * 4,)
    assert [one.settings["scale"] for one in found.candidates] in ([1.0, 3.0, 0.5], [1.0, 0.5, 3.0])


# Failures ------------------------------------------------------------------------------------------------------------


def test_candidates_that_fail_are_recorded_and_never_chosen():
    ways = ["raises", "leaves", "nan", "blinks", "shape", "huge"]
    found = tune(Moody(), [motion(0.1)], budget=40, space={"way": {"choice": ways}})
    failures = {one.settings["way"]: one.failure for one in found.candidates}
    assert found.best().settings == {"way": "fits"}
    assert failures["fits"] == ""
    assert failures["raises"] == "ValueError: no such luck"
    assert "SystemExit" in failures["leaves"]
    assert "not finite" in failures["nan"]
    assert "not finite" in failures["blinks"]
    assert "not finite" in failures["huge"]
    assert "InvalidArray" in failures["shape"]
    for one in found.candidates:
        assert (one.score() == np.inf) == bool(one.failure) == (not one.errors)


def test_a_setting_that_its_class_refuses_is_a_failure_of_the_candidate():
    found = tune("Ridge", [motion(0.1)], budget=9, space={"penalty": {"choice": [-1.0, 1e-3]}})
    assert any("penalty=-1.0" in one.failure for one in found.candidates)
    assert found.best().settings["penalty"] != -1.0


def test_when_nothing_succeeds_it_says_why():
    with pytest.raises(InvalidConfig, match="no candidate succeeded; the first: ValueError: no such luck"):
        tune(Moody("raises"), [motion()], space={})


@pytest.mark.parametrize(
    ("spec", "settings", "error", "says"),
    [
        ("Ridge", {"budget": 0}, InvalidConfig, "budget=0"),
        ("Ridge", {"budget": True}, InvalidConfig, "budget=True"),
        ("Ridge", {"draws": 0}, InvalidConfig, "draws=0"),
        ("Ridge", {"seed": -1}, InvalidConfig, "seed=-1"),
        ("Rigde", {}, UnknownName, "did you mean 'Ridge'"),
        (Spy(), {}, InvalidConfig, "has no space of its own; give space="),
        ("Ridge", {"space": {"penlaty": {"choice": [1.0]}}}, InvalidConfig, "did you mean 'penalty'"),
        ("Ridge", {"space": [1.0]}, InvalidConfig, "space of Ridge"),
        ("Ridge", {"space": {"penalty": [1.0]}}, InvalidConfig, "give one range"),
        ("Ridge", {"space": {"penalty": {"chioce": [1.0]}}}, UnknownName, "did you mean 'choice'"),
        ("Ridge", {"space": {"penalty": {"choice": []}}}, InvalidConfig, "give a list"),
        ("Ridge", {"space": {"penalty": {"uniform": [1.0]}}}, InvalidConfig, "least, most"),
        ("Ridge", {"space": {"penalty": {"uniform": [2.0, 1.0]}}}, InvalidConfig, "least, most"),
        ("Ridge", {"space": {"penalty": {"uniform": [0.0, np.nan]}}}, InvalidConfig, "least, most"),
        ("Ridge", {"space": {"penalty": {"log_uniform": [0.0, 1.0]}}}, InvalidConfig, "positive bounds"),
        ("Ridge", {"space": {"penalty": {"choice": [1.0, {"log_uniform": ["a", 1.0]}]}}}, InvalidConfig, "least"),
        ("Ridge", {"space": {"penalty": {"choice": [object()]}}}, InvalidConfig, "object"),
    ],
)
def test_errors_name_the_thing(spec, settings, error, says):
    with pytest.raises(error, match=says):
        tune(spec, [motion()], **settings)


def test_experiences_that_cannot_be_divided_are_refused():
    with pytest.raises(InvalidRecording, match="give at least one"):
        tune("Ridge", [])
    with pytest.raises(InvalidRecording, match="draw 0 of 4 cannot be held out"):
        tune("Ridge", [motion(steps=2)])
    rests = motion()
    rests["hand_image"].values[:] = 0.0
    with pytest.raises(InvalidRecording, match="rests"):
        tune("Ridge", [rests])


# The record ----------------------------------------------------------------------------------------------------------


def test_a_search_survives_its_file(tmp_path):
    found = {
        "mine": tune(Moody(), [motion(0.1)], budget=9, space={"way": {"choice": ["raises", "nan", "fits"]}}),
        "Ridge": tune("Ridge", [motion(0.1), motion(0.2)], budget=5),
        "LeastSquares": tune("LeastSquares", [motion()]),
    }
    path = tmp_path / "tuning.json"
    write_tuning(path, found, versions={"numpy": "2"})
    assert read_tuning(path) == found
    table = json.loads(path.read_text())
    assert table["versions"] == {"numpy": "2"}
    assert table["tuned"]["Ridge"]["candidates"][0]["score"] > 0
    assert table["tuned"]["mine"]["candidates"][0]["score"] == pytest.approx(found["mine"].best().score(), rel=1e-4)
    assert "along 4 directions" in found["Ridge"].criterion
    study = bk.Study(
        {"infant": "infant"}, {"circle": bk.motions.Circle()}, {key: one.chosen for key, one in found.items()}
    )
    assert study.estimators["Ridge"] == found["Ridge"].chosen


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": "bodyimage_kin tuning", "version": 9, "tuned": {}}'])
def test_a_file_that_is_no_tuning_is_refused(tmp_path, text):
    path = tmp_path / "tuning.json"
    path.write_text(text)
    with pytest.raises(InvalidConfig, match="holds no tuning"):
        read_tuning(path)
    with pytest.raises(InvalidConfig, match="holds no tuning"):
        read_tuning(tmp_path / "missing.json")


def test_a_record_that_lacks_something_is_refused(tmp_path):
    path = tmp_path / "tuning.json"
    write_tuning(path, {"Ridge": tune("Ridge", [motion()], budget=2)})
    table = json.loads(path.read_text())
    del table["tuned"]["Ridge"]["space"]
    path.write_text(json.dumps(table))
    with pytest.raises(InvalidConfig, match="no record of a tuning: KeyError 'space'"):
        read_tuning(path)


# Spaces --------------------------------------------------------------------------------------------------------------


def test_every_estimator_has_a_space_and_only_of_its_own_settings():
    assert set(SPACES) == set(bk.estimators.names())
    for name, space in SPACES.items():
        fields = {field.name for field in dataclasses.fields(getattr(bk.estimators, name))}
        assert set(space) <= fields - {"body", "spec"}
        assert checked_space(name, space) == space
        assert json.loads(json.dumps(space)) == space


@pytest.mark.parametrize("name", [name for name, space in SPACES.items() if space and name != "SelfCalibration"])
def test_all_that_is_drawn_can_be_built_and_written_to_a_study(name):
    drawn = list(points(SPACES[name], 200))
    for settings in drawn:
        table = ESTIMATOR.table({name: settings})
        assert ESTIMATOR.table(table) == table
    # Each setting really varies.
    assert all(len({str(one[setting]) for one in drawn}) > 1 for setting in SPACES[name])


def test_ranges_are_kept_and_whole_numbers_stay_whole():
    space = {
        "whole": {"log_uniform": [2, 9]},
        "log": {"log_uniform": [0.0123456, 0.0123457]},
        "even": {"uniform": [-1.0, 1.0]},
        "mixed": {"choice": [None, "a", [3, 3], {"uniform": [5, 6]}]},
    }
    drawn = list(points(space, 300))
    assert {one["whole"] for one in drawn} == set(range(2, 10))
    assert all(0.0123456 <= one["log"] <= 0.0123457 and -1.0 <= one["even"] <= 1.0 for one in drawn)
    assert {str(one["mixed"]) for one in drawn} == {"None", "a", "[3, 3]", "5", "6"}


def test_log_uniform_is_uniform_in_the_logarithm():
    logs = np.log10([one["a"] for one in points({"a": {"log_uniform": [1e-6, 1.0]}}, 4000)])
    assert np.mean(logs) == pytest.approx(-3.0, abs=0.1)
    assert np.mean(logs < -4.5) == pytest.approx(0.25, abs=0.03)


def test_ridge_without_a_penalty_of_its_own_is_among_the_candidates():
    found = tune(Ridge(), [motion(0.1)], budget=12)
    assert None in [one.settings["penalty"] for one in found.candidates]


PUBLISHED = Path(__file__).parents[2] / "comparisons" / "estimators" / "tuning.json"


@pytest.mark.skipif(not PUBLISHED.exists(), reason="no search is published: comparisons/estimators/tune.py makes one")
def test_the_published_search_gave_all_the_same_budget_and_can_be_read():
    published = read_tuning(PUBLISHED)
    assert set(published) == set(bk.estimators.names()) - {
        "Ensemble",
        "Conformal",
        "Misinformed",
        "Given",
        "Saved",
        "Nominal",
    }
    assert len({(one.budget, one.seed, one.draws, one.criterion) for one in published.values()}) == 1
    for name, one in published.items():
        assert one.space == SPACES[name]
        assert len(one.candidates) == (one.budget if one.space else 1)
        assert one.chosen == ESTIMATOR.table({name: one.chosen[name] | dict(one.best().settings)})
