"""What a study can be asked for: rows, recordings, scores and bodies of every kind, each held against its meaning."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import my_scores
import numpy as np
import pytest
import torch
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig, InvalidRecording
from bodyimage_kin.recordings.motions import Circle, FaceTour, RandomTouch
from bodyimage_kin.study import Row, Simulation, Study, read_study, recording_of, scoring

STILL = Simulation(Circle(turns=0.5), RandomTouch(duration=20.0), FaceTour(speed=0.2), dynamics=False)
MAPS = ("relative_error_use", "touch_trajectory_rmse", "map_error", "map_span")


def squeezed(results, **at):
    return results.sel(**at).squeeze()


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """One study with rows of every kind, and its store."""
    store = tmp_path_factory.mktemp("rows") / "run"
    study = Study(
        "infant",
        {"still": STILL, "deep": replace(STILL, training=(Circle(turns=0.5), Circle(turns=0.3, distance=0.06)))},
        {
            "flat": "LeastSquares",
            "told": Row("LeastSquares", told={"scale": "depth_ratio"}),
            "halved": bk.estimators.LeastSquares(scale=0.5),
            "euler": Row("Analytic", on=("still",)),
            "midpoint": Row("Analytic", method="midpoint", on=("infant/still",)),
            "unreset": Row("LeastSquares", reset="none", on=("still",)),
            "true_reset": Row("LeastSquares", reset="true", on=("still",)),
            "plain": Row("LeastSquares", maps={"kernel": "plain"}, on=("still",)),
            "direct": Row(),
            "direct_plain": Row(maps={"kernel": "plain"}, on=("still",)),
            "peeks": Row({"odd_estimators:Odd": {"way": "peeks"}}, on=("still",)),
            "seen": Row({"PaperMLP": {"steps": 5}}, stream="one", on=("still",)),
            "again": Row({"PaperMLP": {"steps": 5}}, stream="one", method="midpoint", on=("still",)),
        },
        probes=["on_face", "training"],
        seeds=[3, 8],
        scores=[*MAPS, "trajectory_rmse", my_scores.PATH, "my_scores:LARGEST", my_scores.SNAPSHOTS, my_scores.WORDS],
        facts=["depth_ratio", "excitation", my_scores.STEPS],
        first_maps={8: 3},
        maps={"snapshots": [0, 100]},
    )
    return study, study.run(store, "in-process"), store


def test_nothing_failed_and_rows_are_only_where_they_belong(done):
    results = done[1]
    assert (results["failure"] == "").all()
    errors = results["relative_error_use"].sel(probe="on_face")
    assert np.isfinite(squeezed(errors, recording="deep", estimator=["flat", "told", "halved"])).all()
    assert np.isnan(squeezed(errors, recording="deep", estimator=["euler", "plain", "again"])).all()
    assert not list((done[2] / "cells/infant/deep").glob("euler"))


def test_what_is_told_is_the_fact_of_its_recording(done, body):
    _, results, store = done
    for recording in ("still", "deep"):
        for seed in (3, 8):
            seen = recording_of(store, recording, seed)
            ratio = bk.metrics.depth_ratio(body, seen)
            assert float(squeezed(results["depth_ratio"], recording=recording, seed=seed)) == ratio
            told = bk.estimators.LeastSquares(scale=ratio).fit(bk.experience(seen))
            wanted = abs(told.jacobian(torch.zeros(1, 5)).numpy()).max()
            found = squeezed(results["largest_entry"], recording=recording, seed=seed, estimator="told")
            assert float(found) == pytest.approx(wanted, rel=1e-12)


def test_several_motions_are_trials_of_one_recording(done, body):
    _, results, store = done
    seen, alone = recording_of(store, "deep", 3), recording_of(store, "still", 3)
    assert seen.sizes["trial"] == 2
    assert alone.sizes["trial"] == 1
    q = seen["q"].values
    # The shorter one is padded with nothing.
    assert np.isnan(q[0]).any() != np.isnan(q[1]).any()
    depth = body.hand_in_camera(np.nan_to_num(seen["true_q"].values))[..., 2].numpy()[np.isfinite(q[..., 0])]
    assert depth.max() - depth.min() > 0.02
    assert float(squeezed(results["felt_steps"], recording="deep", seed=3)) == seen.sizes["time"] - 1


def test_rules_of_integration_and_resets_change_what_they_should(done, body):
    _, results, store = done
    one = squeezed(results, recording="still")
    assert (one["trajectory_rmse"].sel(estimator="midpoint") < one["trajectory_rmse"].sel(estimator="euler")).all()
    felt, learned = bk.experience(recording_of(store, "still", 3, "use")), None
    use, seen = recording_of(store, "still", 3, "use"), recording_of(store, "still", 3)
    learned = bk.estimators.LeastSquares().fit(bk.experience(seen))
    settings = {"reset": "none", "initial": felt["reference_image"].values}
    for name, hand in {
        "flat": bk.integrate(felt, learned),
        "unreset": bk.integrate(felt, learned, **settings),
        "true_reset": bk.integrate(use, learned, reset="true"),
    }.items():
        wanted = bk.metrics.trajectory_rmse(use["true_hand_image"].values, hand.values)
        assert float(one["touch_trajectory_rmse"].sel(estimator=name, seed=3)) == wanted
    # They differ in how the maps are learned, not in what is learned.
    assert (
        float(
            abs(
                one["relative_error_use"].sel(estimator="plain") - one["relative_error_use"].sel(estimator="flat")
            ).max()
        )
        == 0.0
    )
    assert (one["map_span"].sel(estimator="plain") < 0.5 * one["map_span"].sel(estimator="flat")).all()


def test_direct_sight_has_maps_and_no_jacobian(done):
    results = done[1]
    direct = squeezed(results, estimator="direct")
    assert float(direct["map_error"].max()) == 0.0
    # Other settings of maps hold for direct sight too.
    other = squeezed(results, estimator="direct_plain", recording="still")
    assert float(abs(other["map_error"]).max()) == 0.0
    assert (other["map_span"] < 0.5 * squeezed(direct, recording="still")["map_span"]).all()
    assert float(direct["touch_trajectory_rmse"].max()) == 0.0
    assert np.isnan(direct["relative_error_use"]).all()
    left_out = json.loads(results.attrs["left_out"])
    assert left_out["relative_error_use"] == {
        "there is no learned": ["infant/still/direct", "infant/still/direct_plain", "infant/deep/direct"]
    }
    assert "map_error" not in left_out


def test_rows_of_one_stream_learn_the_same_and_others_do_not(done):
    errors = squeezed(done[1]["relative_error_use"], recording="still", probe="on_face")
    np.testing.assert_array_equal(errors.sel(estimator="seen"), errors.sel(estimator="again"))


def test_first_maps_of_some_seeds(done):
    snapshots = squeezed(done[1]["snapshots"], recording="still", estimator="flat")
    assert snapshots.dims == ("seed", "first_map", "snapshot")
    assert np.isfinite(snapshots.sel(seed=3)).all("snapshot").values.tolist() == [True, False, False]
    assert np.isfinite(snapshots.sel(seed=8)).all()
    assert snapshots.sizes["snapshot"] == 3  # as asked, and the last


def test_scores_of_ones_own_have_dimensions_units_and_words_of_their_own(done):
    _, results, store = done
    assert results["largest_entry"].attrs["units"] == "m/rad"
    assert results["words"].sel(word="y", estimator="flat", recording="still", seed=3).item() == "bcé"
    path = squeezed(results["tour_image"], recording="still", estimator="euler", seed=3)
    tour = recording_of(store, "still", 3, "tour")
    assert list(path["axis"].values) == ["x", "y"]
    wanted = bk.metrics.trajectory_rmse(tour["true_hand_image"].values, path.values[None])
    assert float(squeezed(results["trajectory_rmse"], recording="still", estimator="euler", seed=3)) == wanted


def test_before_the_first_reset_nobody_knows_where_the_hand_is(done, tmp_path):
    seen, use = (recording_of(done[2], "still", 3, role) for role in ("training", "use"))
    late = use.assign(at_reference=use["at_reference"].where(use["time"] > 1.0, False))
    study = Study(
        "infant", {"late": Simulation(seen, use=late)}, ["LeastSquares"], seeds=1, scores=["touch_trajectory_rmse"]
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bk.errors.DataWarning)
        found = study.run(tmp_path, "in-process")
    assert found["failure"].item() == ""
    assert 0 < found["touch_trajectory_rmse"].item() < 0.1


def test_bk_score_gives_what_the_cells_give(done, body):
    _, results, store = done
    seen, use, tour = (recording_of(store, "still", 3, role) for role in ("training", "use", "tour"))
    learned = bk.estimators.LeastSquares().fit(bk.experience(seen))
    found = bk.score(learned, body, seen, use, ["on_face", bk.probes.Training()], tour=tour)
    cell = squeezed(results, recording="still", estimator="flat", seed=3)
    for name in ("relative_error_use", "trajectory_rmse"):
        np.testing.assert_array_equal(found[name], cell[name])
    assert list(found["probe"].values) == ["on_face", "training"]
    assert (found["relative_error"] != found["relative_error_use"]).all()
    assert found.attrs["motion_metric"] == "felt motion of use"
    # Without a use the training's own metric counts, and nothing is split.
    alone = bk.score(learned, body, seen)
    assert alone.attrs["motion_metric"] == "felt motion of what was seen"
    assert float(abs(alone["attribution"].sel(part="mean_unexcited")).max()) == 0.0
    assert "trajectory_rmse" in json.loads(alone.attrs["left_out"])
    assert bk.score(learned, None, seen, scores=["relative_error"]).sizes == {}


def test_a_study_of_recordings_takes_them_as_they_are(done, body, tmp_path):
    _, results, store = done
    seen = [recording_of(store, "still", seed) for seed in (3, 8)]
    use = [recording_of(store, "still", seed, "use") for seed in (3, 8)]
    study = Study(
        body,
        {"mine": Simulation(seen, use=use), "alone": seen[0]},
        [bk.estimators.LeastSquares()],
        probes=["on_face", "training"],
        seeds=[3, 8],
        scores=["relative_error_use", "relative_error", "trajectory_rmse", "map_error"],
        first_maps=1,
    )
    assert list(study.estimators) == ["least_squares"]
    found = study.run(tmp_path / "run", "in-process")
    assert (found["failure"] == "").all()
    wanted = squeezed(results["relative_error_use"], recording="still", estimator="flat")
    np.testing.assert_array_equal(squeezed(found["relative_error_use"], recording="mine"), wanted)
    alone = squeezed(found, recording="alone")
    assert (alone["relative_error"].sel(seed=3) == alone["relative_error"].sel(seed=8)).all()
    left_out = json.loads(found.attrs["left_out"])
    assert left_out["trajectory_rmse"]["there is no tour"] == [
        "infant/mine/least_squares",
        "infant/alone/least_squares",
    ]
    xr.testing.assert_identical(read_study(tmp_path / "run"), found)
    # It resumes without them, and can be written down with them.
    xr.testing.assert_identical(study.run(tmp_path / "run", "in-process"), found)
    study.to_toml(tmp_path / "study.toml")
    assert Study.from_toml(tmp_path / "study.toml") == study
    missing = Study.from_table(study.table())
    with pytest.raises(Exception, match="not in the store"):
        missing.run(tmp_path / "other", "in-process").pipe(lambda one: _raise(one))
    with pytest.raises(InvalidConfig, match="2 recordings for 3 seeds; give one a seed"):
        Study(body, {"mine": seen}, ["LeastSquares"], seeds=3)


def _raise(results):
    raise InvalidRecording(results["failure"].values.ravel()[0])


def test_a_study_without_a_body_scores_what_needs_none(done, tmp_path):
    seen = recording_of(done[2], "still", 3)
    study = Study(
        None, {"mine": bk.experience(seen)}, ["LeastSquares"], seeds=1, scores=["relative_error", "fit_seconds"]
    )
    found = study.run(tmp_path, "in-process")
    assert (found["failure"] == "").all()
    assert float(found["fit_seconds"].squeeze()) > 0
    assert json.loads(found.attrs["left_out"])["relative_error"] == {"there is no body": ["unknown/mine/least_squares"]}


def test_entries_of_one_stream_are_paired(tmp_path):
    near = Simulation(Circle(turns=0.3), RandomTouch(duration=4.0), dynamics=False, stream="one")
    study = Study(
        "infant",
        {"near": near, "noisy": replace(near, noise=bk.Noise(encoder=1e-3)), "own": replace(near, stream="")},
        ["LeastSquares"],
        seeds=1,
        probes=["on_face"],
    )
    study.run(tmp_path, "in-process")
    q = {name: recording_of(tmp_path, name, 0)["true_q"].values for name in ("near", "noisy", "own")}
    np.testing.assert_array_equal(q["near"], q["noisy"])
    assert not np.array_equal(q["near"], q["own"])


def test_a_hand_that_touches_counts_as_unseen_on_request(body, tmp_path):
    eye = replace(body.camera, model=replace(body.camera.screen, near=0.01))
    sees = replace(body, camera=eye)
    blind = Simulation(Circle(turns=0.3), RandomTouch(duration=4.0), dynamics=False, touch_seen=False)
    study = Study(sees, {"blind": blind}, ["LeastSquares"], seeds=1, probes=["on_face"])
    assert study.recordings["blind"]["touch_seen"] is False
    study.to_toml(tmp_path / "study.toml")
    assert "touch_seen = false" in (tmp_path / "study.toml").read_text()
    assert Study.from_toml(tmp_path / "study.toml").recordings == study.recordings
    assert (study.run(tmp_path / "run", "in-process")["failure"] == "").all()
    use = recording_of(tmp_path / "run", "blind", 0, "use")
    touching = (use["true_touched"].values >= 0).any(-1)
    seen_by_eye = sees.visible(use["true_q"].values).numpy()
    assert (touching & seen_by_eye).any()
    np.testing.assert_array_equal(np.isfinite(use["hand_image"].values).all(-1), seen_by_eye & ~touching)
    assert np.isfinite(recording_of(tmp_path / "run", "blind", 0)["hand_image"].values).all()


def test_a_study_that_says_nothing_of_touches_that_are_seen_is_what_it_was():
    plain = {"training": "Circle"}
    tables = [Study("infant", {"a": one}, ["Ridge"]).recordings["a"] for one in (plain, {**plain, "touch_seen": True})]
    assert tables[0] == tables[1]
    assert "touch_seen" not in tables[0]
    with pytest.raises(InvalidConfig, match="recording 'a': touch_seen='no'"):
        Study("infant", {"a": {**plain, "touch_seen": "no"}}, ["Ridge"])


def test_a_motion_of_ones_own_by_object_and_by_name(tmp_path):
    by_name = {"my_scores:Wave": {"height": 0.02}}
    studies = [
        Study("infant", {"wave": one}, ["LeastSquares"], seeds=1, use=RandomTouch(duration=4.0), probes=["on_face"])
        for one in (my_scores.Wave(), by_name)
    ]
    assert studies[0] == studies[1]
    assert (studies[0].run(tmp_path, "in-process")["failure"] == "").all()


def test_a_score_that_is_none_and_one_that_breaks_its_word(tmp_path):
    with pytest.raises(InvalidConfig, match=r"is int; give a bk\.study\.Score"):
        Study("infant", {"a": "Circle"}, ["Ridge"], scores=["my_scores:NO_SCORE"])
    here = bk.study.Score("here", (), "nobody finds it", lambda context: 0.0)
    with pytest.raises(InvalidConfig, match="cannot be found by workers"):
        Study("infant", {"a": "Circle"}, ["Ridge"], scores=[here])
    found = Study("infant", {"a": STILL}, ["Ridge"], scores=["my_scores:BROKEN"], seeds=1).run(tmp_path, "in-process")
    assert "score 'broken' has 0 dimensions, but says ('probe',)" in found["failure"].item()


def test_learners_never_see_the_truth(done, tmp_path):
    """Every ``true_*`` replaced by noise leaves all that is learned as it was, for every estimator."""
    rng = np.random.default_rng(0)
    seen, use = (recording_of(done[2], "still", 3, role) for role in ("training", "use"))
    scrambled = [
        one.assign(
            {
                name: one[name] + rng.normal(size=one[name].shape)
                for name in one
                if str(name).startswith("true_") and one[name].dtype.kind == "f"
            }
        )
        for one in (seen, use)
    ]
    needy = ("Ensemble", "Conformal", "Misinformed", "Given", "Saved", "Nominal")
    names = [name for name in bk.estimators.names() if name not in needy]
    scores = ["my_scores:LARGEST", "my_scores:SNAPSHOTS"]
    found = [
        Study(
            "infant",
            {"a": Simulation(*pair)},
            {name: name for name in names},
            seeds=1,
            scores=scores,
            probes=["on_face"],
        ).run(tmp_path / str(index), "in-process")
        for index, pair in enumerate(((seen, use), scrambled))
    ]
    assert (found[0]["failure"] == "").all()
    for name in ("largest_entry", "snapshots"):
        np.testing.assert_array_equal(*(one[name] for one in found))


def test_a_reader_passes_few_functions(tmp_path, monkeypatch):
    """From ``Study.run`` in this process to what computes a relative error: nine, those that docs/design.md names."""
    study = Study("infant", {"a": STILL}, ["LeastSquares"], seeds=1, scores=["relative_error"], probes=["on_face"])
    stacks = []

    def watch(frame, event, argument):
        if event == "call" and frame.f_code.co_filename.endswith("metrics/jacobian.py"):
            stack = []
            while frame is not None:
                if "bodyimage_kin" in frame.f_code.co_filename and "tests" not in frame.f_code.co_filename:
                    stack.append(f"{frame.f_code.co_filename.rpartition('/')[2][:-3]}.{frame.f_code.co_qualname}")
                frame = frame.f_back
            stacks.append(list(dict.fromkeys(reversed(stack))))

    sys.setprofile(watch)
    try:
        study.run(tmp_path, "in-process")
    finally:
        sys.setprofile(None)
    page = (Path(__file__).parents[2] / "docs" / "design.md").read_text(encoding="utf-8")
    told = re.findall(r"^\| `([\w.]+)` \|", page[page.index("a reader who steps from") :], re.MULTILINE)
    assert "passes nine functions" in page
    assert len(told) == 9
    # The page calls modules as a reader imports them.
    named = [name.replace("metrics.", "jacobian.") for name in told]
    assert stacks[0] == named


def test_a_page_and_the_status_import_nothing_that_a_store_names(tmp_path):
    (tmp_path / "watched.py").write_text(
        "from bodyimage_kin.estimators import LeastSquares\nimport pathlib\n"
        "pathlib.Path(__file__).with_name('imported').touch()\nclass Mine(LeastSquares): ...\n"
    )
    (tmp_path / "study.toml").write_text(
        'seeds = 1\nembodiments.infant = "infant"\nestimators.a = "watched:Mine"\nestimators.b = "Ridge"\n'
        'probes.on_face = "on_face"\nrecordings.a = {training = "Circle", dynamics = false}\n'
    )
    script = (
        f"import bodyimage_kin as bk\nbk.Study.from_toml(r'{tmp_path}/study.toml').run(r'{tmp_path}/out', 'in-process')"
    )
    subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, cwd=tmp_path.parent)
    (tmp_path / "imported").unlink()
    for command in (["study", "--status", str(tmp_path / "out")], ["report", str(tmp_path / "out")]):
        subprocess.run(
            [sys.executable, "-m", "bodyimage_kin.cli", *command], check=True, capture_output=True, cwd=tmp_path
        )
    assert not (tmp_path / "imported").exists()


def test_default_probes_and_scores_are_those_of_the_tables():
    assert list(scoring.PROBES) == ["training", "in_front", "on_face", "joint_space"]
    assert set(scoring.default_scores(True)) - set(scoring.default_scores()) == {
        name for name in scoring.SCORES if name.endswith("_by_posture") and name != "basin_by_posture"
    }
