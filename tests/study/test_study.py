"""Studies: one written form, the same bits whoever works, and nothing lost but what failed."""

from __future__ import annotations

import json
import re
import shutil
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import odd_estimators
import pytest
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin.body.file import embodiment_folder
from bodyimage_kin.cli import study as commands
from bodyimage_kin.cli.status import FAILED, status_command
from bodyimage_kin.errors import BodyImageKinError, InvalidConfig, OutputRefused, UnknownName
from bodyimage_kin.recordings.motions import Circle, FaceTour, RandomTouch
from bodyimage_kin.study import PROBES, Row, Simulation, Study, read_study, recording_of, specs, statistics, summary
from bodyimage_kin.study.parts import parts_in
from bodyimage_kin.study.results import MISSING

STILL = Simulation(Circle(turns=0.5), RandomTouch(duration=5.0), FaceTour(speed=0.2), dynamics=False)


def small(**changes):
    """A study that takes seconds."""
    asked = {
        "embodiments": {"infant": "infant"},
        "recordings": {"still": STILL},
        "estimators": {"flat": "LeastSquares", "paper": {"PaperMLP": {"steps": 20}}, "truth": "Analytic"},
        "seeds": 3,
        "block": 2,
        "per_posture": True,
        "probes": {**PROBES, "joint_space": bk.probes.JointSpace(100)},
    }
    return Study(**asked | changes)


def reproducible(results):
    return results.drop_vars("fit_seconds")


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A small study, its results and its store."""
    store = tmp_path_factory.mktemp("study") / "run"
    study = small()
    return study, study.run(store, "in-process"), store


# As a file -----------------------------------------------------------------------------------------------------------


def test_a_study_is_read_as_it_was_written(tmp_path):
    study = small(
        estimators={
            "flat": bk.estimators.LeastSquares(scale=0.5),
            "truth": "Analytic",
            "many": bk.estimators.Ensemble(bk.estimators.PaperMLP(steps=7), members=3),
            "odd": odd_estimators.Odd("nan"),
            "plain": {"odd_estimators:Plain": {"scale": 2.0}},
            "told": Row(bk.estimators.LeastSquares(), told={"scale": "depth_ratio"}, on=("bare", "infant/deep")),
            "integrated": Row("Analytic", method="midpoint", substeps=2, reset="none", maps={"gamma": 1.0}),
            "direct": Row(),
        },
        recordings={
            "dragged": Simulation(Circle(), dynamics=bk.Drag(stiffness=50.0), noise=bk.Noise(torque=0.1)),
            "deep": Simulation((Circle(distance=0.02), Circle(distance=0.05)), stream="deep"),
            "bare": "Circle",
        },
        first_maps={3: 10},
        maps={"kernel": "plain"},
        facts=["depth_ratio"],
        time_limit=9.5,
        seeds=[7, 3],
    )
    study.to_toml(tmp_path / "study.toml")
    read = Study.from_toml(tmp_path / "study.toml")
    assert read == study
    assert read.table() == study.table()
    assert read.seeds == (7, 3)


@pytest.mark.parametrize("name", bk.estimators.names())
def test_every_estimator_survives_its_table(name, body):
    needed = {
        "Ensemble": {"spec": {"PaperMLP": {}}},
        "Conformal": {"spec": {"TrigRidge": {}}},
        "Misinformed": {"spec": {"SelfCalibration": {}}},
        "Nominal": {"embodiment": "infant"},
        "Given": {"p": 5, "m": 2, "jacobian": "mine:jacobian"},
        "Saved": {"folder": "learned"},
    }
    table = specs.ESTIMATOR.table({name: needed[name]} if name in needed else name)
    assert specs.ESTIMATOR.table(specs.ESTIMATOR.build(table, body=body)) == table


def test_touch_and_tour_move_as_the_motion_that_is_learned_from():
    table = small(recordings={"quick": Circle(speed=0.1, sampling=0.05)}).recordings["quick"]
    for role, name in (("use", "RandomTouch"), ("tour", "FaceTour")):
        assert (table[role][name]["speed"], table[role][name]["sampling"]) == (0.1, 0.05)
    assert table["use"]["RandomTouch"]["duration"] == 80.0
    # What a study says of the touches holds where an entry says nothing of its own.
    both = small(use=RandomTouch(duration=7.0), recordings={"a": Circle(), "b": STILL}).recordings
    assert [both[name]["use"]["RandomTouch"]["duration"] for name in ("a", "b")] == [7.0, 5.0]


@pytest.mark.parametrize("never", [None, "none"])
def test_a_hand_that_never_returns_can_be_written(never, tmp_path):
    touch = {"RandomTouch": {"duration": 25.0, "reset_interval": never}}
    study = small(recordings={"still": {"training": "Circle", "use": touch, "dynamics": False}})
    study.to_toml(tmp_path / "study.toml")
    read = Study.from_toml(tmp_path / "study.toml")
    assert read == study
    motion = specs.MOTION.build(read.recordings["still"]["use"])
    assert motion.reset_interval is None
    resets = bk.simulate(bk.load_embodiment("infant"), motion, dynamics=False)["at_reference"].values[0]
    assert resets[0]
    assert int((np.diff(resets.astype(int)) > 0).sum()) == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"estimators": {"a": "LeastSquare"}}, "no estimator 'LeastSquare'; did you mean 'LeastSquares'"),
        ({"estimators": {"a": {"PaperMLP": {"step": 3}}}}, "no setting of estimator PaperMLP 'step'"),
        ({"estimators": {"a": {"PaperMLP": {"steps": -3}}}}, "steps=-3"),
        ({"estimators": {"a": "no_such_module:Thing"}}, "no_such_module"),
        ({"estimators": {"../a": "LeastSquares"}}, "estimator name '../a'"),
        ({"estimators": {}}, "estimators: give at least one"),
        ({"recordings": {"a": {"Circle": {"radios": 1.0}}}}, "did you mean 'radius'"),
        ({"recordings": {"a": {"circle": {}}}}, "no motion 'circle'; did you mean 'Circle'"),
        ({"recordings": {"a": {"training": "Circle", "touch": {}}}}, "no setting of recording 'a' 'touch'"),
        ({"recordings": {"a": []}}, "give a motion or a recording"),
        ({"recordings": {"a": {"training": "Circle", "use": {"RandomTouch": {"sampling": 0.2}}}}}, "sampling"),
        ({"recordings": {"a": {"training": "Circle", "dynamics": False, "noise": {"torque": 0.1}}}}, "dynamics=true"),
        ({"recordings": {"a": {"training": "Circle", "use": {"RandomTouch": {"duration": None}}}}}, "duration=None"),
        ({"recordings": {"a": {"Circle": {"radius": "none"}}}}, "radius='none': give a number"),
        ({"estimators": {"a": Row("Ridge", on=("stil",))}}, "did you mean 'still'"),
        ({"estimators": {"a": Row("Ridge", told={"scale": "depth_ratio"})}}, "to be told 'scale'"),
        ({"estimators": {"a": Row("LeastSquares", told={"scale": "depth"})}}, "no score 'depth'"),
        ({"estimators": {"a": Row("Ridge", maps={"gama": 1.0})}}, "did you mean 'gamma'"),
        ({"first_maps": 0}, "first_maps=0"),
        ({"probes": {"a": "on_fase"}}, "no probe 'on_fase'"),
        ({"probes": {"a": {"JointSpace": {"count": 0}}}}, "count=0"),
        ({"scores": ["relative_eror"]}, "did you mean 'relative_error'"),
        ({"seeds": [1, 1]}, "none twice"),
        ({"seeds": 0}, "seeds="),
        ({"block": 0}, "block=0"),
        ({"time_limit": -1.0}, "time_limit=-1.0"),
    ],
)
def test_a_wrong_study_says_what_is_wrong(changes, message):
    with pytest.raises(BodyImageKinError, match=re.escape(message)):
        small(**changes)


def test_a_wrong_file_says_what_is_wrong(tmp_path):
    path = tmp_path / "study.toml"
    with pytest.raises(InvalidConfig, match="cannot read study"):
        Study.from_toml(path)
    path.write_text("seeds = = 3")
    with pytest.raises(InvalidConfig, match=r"study\.toml' is no valid TOML"):
        Study.from_toml(path)
    path.write_text("seed = 3\nestimator = 1")
    with pytest.raises(InvalidConfig, match="did you mean 'estimators'"):
        Study.from_toml(path)
    path.write_text("seed = 3")
    with pytest.raises(InvalidConfig, match="'embodiments' is missing"):
        Study.from_toml(path)


# What comes out ------------------------------------------------------------------------------------------------------


def test_the_truth_has_no_error_and_learners_have(done):
    _, results, _ = done
    truth = results.sel(estimator="truth")
    assert float(truth["relative_error_use"].max()) < 1e-9
    assert float(truth["displacement_error"].max()) < 1e-9
    assert float(results.sel(estimator="flat")["relative_error_use"].min()) > 0.05
    assert set(results["failure"].values.ravel()) == {""}


def test_parts_sum_to_the_squared_error_and_postures_to_the_parts(done):
    results = done[1]
    np.testing.assert_allclose(results["attribution"].sum("part"), results["relative_error_use"] ** 2, atol=1e-12)
    for part in ("scale", "variation"):
        mean = results[f"{part}_by_posture"].mean("posture")
        np.testing.assert_allclose(mean, results["attribution"].sel(part=part), atol=1e-12)


def test_probes_leave_what_was_seen_step_by_step(done):
    results = done[1]
    assert list(results["probe"].values) == ["training", "in_front", "on_face", "joint_space"]
    hand = results["hand_distance"].mean(("seed", "recording", "embodiment"))
    assert (np.diff(hand) > 0).all()
    assert float(results["hand_distance"].sel(probe="training").max()) == 0.0
    # Of the training postures themselves, the mean squared Mahalanobis distance is the number of joints.
    away = results["mahalanobis_distance_by_posture"].sel(probe="training")
    assert float((away**2).mean()) == pytest.approx(5.0, rel=0.05)
    # On the face the hand is a good 2 cm nearer than on a circle 3 cm in front of it.
    assert 0.02 < float(hand.sel(probe="on_face")) < 0.08


def test_every_result_says_where_it_comes_from(done, body):
    study, results, _ = done
    assert json.loads(results.attrs["config"]) == study.table()
    assert json.loads(results.attrs["urdf_sha256"]) == {"infant": body.robot.sha256}
    assert json.loads(results.attrs["seeds"]) == [0, 1, 2]
    assert "pin" in json.loads(results.attrs["versions"])
    assert 0.0 < float(results["max_oracle_difference"].max()) < 1e-9
    for name, score in results.data_vars.items():
        assert name == "failure" or {"units", "long_name"} <= set(score.attrs), name


def test_seeds_differ_and_estimators_share_their_recordings(done):
    _, results, store = done
    assert len(np.unique(results["relative_error"].sel(estimator="flat", probe="on_face"))) == 3
    recording = recording_of(store, "still", 1)
    assert recording.attrs["motion"] == "Circle"
    seed = json.loads(recording.attrs["config"])["seed"]
    again = bk.simulate(bk.load_embodiment("infant"), bk.motions.Circle(turns=0.5), seed, dynamics=False)
    np.testing.assert_array_equal(again["q"], recording["q"])


def test_a_seed_has_the_same_bits_in_any_study(done, tmp_path):
    alone = small(seeds=[2, 1], block=2, estimators={"paper": {"PaperMLP": {"steps": 20}}})
    found = alone.run(tmp_path / "run", "in-process")
    for seed in (1, 2):
        wanted = done[1].sel(seed=seed, estimator="paper")
        xr.testing.assert_identical(
            reproducible(found).sel(seed=seed, estimator="paper").drop_attrs(), reproducible(wanted).drop_attrs()
        )


# The store -----------------------------------------------------------------------------------------------------------


def test_only_what_is_missing_is_computed_and_it_is_the_same(done, tmp_path):
    study, results, store = done
    copy = shutil.copytree(store, tmp_path / "copy")
    totals = []
    xr.testing.assert_identical(study.run(copy, "in-process", progress=lambda n, total: totals.append(total)), results)
    assert max(totals) == 0
    gone = next(copy.glob("cells/infant/still/*.parts"))
    cells = [part.identity for part in parts_in(gone)]
    gone.unlink()
    failure = read_study(copy)["failure"].squeeze()
    assert (failure == MISSING).sum() == sum(len(one["seeds"]) for one in cells)
    assert all((failure.sel(estimator=one["estimator"], seed=one["seeds"]) == MISSING).all() for one in cells)
    again = study.run(copy, "in-process", progress=lambda n, total: totals.append(total))
    # Its recordings, which are there, and the cell.
    assert max(totals) == len({one["block"] for one in cells}) + len(cells)
    xr.testing.assert_identical(reproducible(again), reproducible(results))


def test_an_interrupted_run_keeps_what_is_done(tmp_path):
    study = small(seeds=2, block=1, estimators={"flat": "LeastSquares", "same": "LeastSquares"})

    def interrupt(done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        study.run(tmp_path, "in-process", progress=interrupt)
    assert len(list(tmp_path.glob("cells/**/*.parts"))) == 1
    assert not list(tmp_path.glob("**/*.tmp"))


def test_another_config_or_robot_is_refused_with_the_difference(done, tmp_path):
    _, _, store = done
    with pytest.raises(OutputRefused, match=r"config\.estimators\.paper\.PaperMLP\.steps is 20 in the store, 21 asked"):
        small(estimators={**small().estimators, "paper": {"PaperMLP": {"steps": 21}}}).run(store, "in-process")
    for name in ("infant.toml", "infant.urdf"):
        shutil.copy(embodiment_folder() / name, tmp_path)
    study = small(embodiments={"mine": "infant.toml"}, folder=tmp_path, seeds=1, estimators={"flat": "LeastSquares"})
    first = study.run(tmp_path / "run", "in-process")
    assert set(first["failure"].values.ravel()) == {""}
    urdf = tmp_path / "infant.urdf"
    urdf.write_text(urdf.read_text() + "<!-- touched -->")
    with pytest.raises(OutputRefused, match=r"urdf_sha256\.mine is"):
        study.run(tmp_path / "run", "in-process")


def test_a_store_grows_and_its_cells_stay_as_they_were(tmp_path):
    begun = small(seeds=[4, 2], estimators={"flat": "LeastSquares"}, probes={"on_face": "on_face"})
    first = begun.run(tmp_path, "in-process")
    cells = {path: path.read_bytes() for path in tmp_path.glob("cells/**/*.parts")}
    wider = {"flat": "LeastSquares", "truth": "Analytic"}
    quick = Simulation(Circle(turns=0.5), RandomTouch(duration=5.0), FaceTour(speed=0.3), dynamics=False)
    grown = small(
        seeds=[4, 2, 7],
        estimators=wider,
        probes={"on_face": "on_face"},
        recordings={**begun.recordings, "quick": quick},
    )
    found = grown.run(tmp_path, "in-process")
    assert {path: path.read_bytes() for path in cells} == cells
    assert set(found["failure"].values.ravel()) == {""}
    assert found.sizes["seed"] == 3
    old = found.sel(seed=[4, 2], estimator=["flat"], recording=["still"])
    xr.testing.assert_identical(old.drop_attrs(), first.drop_attrs())
    # The store is now of the study that it grew into, and nothing is left to do.
    totals = []
    grown.run(tmp_path, "in-process", progress=lambda n, total: totals.append(total))
    assert max(totals) == 0
    with pytest.raises(OutputRefused, match=r"config\.estimators\.truth is only in the store"):
        begun.run(tmp_path, "in-process")
    # The last block is incomplete, so another seed would change it.
    with pytest.raises(OutputRefused, match=r"config\.seeds is \[4, 2, 7\] in the store"):
        Study.from_table({**grown.table(), "seeds": [4, 2, 7, 8]}).run(tmp_path, "in-process")


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(OutputRefused, match="not a study"):
        small().run(tmp_path, "in-process")
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


# Commands and the page -----------------------------------------------------------------------------------------------


def test_the_page_stands_alone(done, tmp_path):
    page = bk.report.write(done[1], tmp_path / "report.html", baseline="flat").read_text()
    assert len(page) < 8e6
    assert not re.search(r'(src|href)\s*=\s*["\'](?!data:|#)', page)
    assert not re.search(r"@import|url\((?!#)", page)
    text = re.sub(r"data:[^\"]*", "", page)
    assert "nan" not in text.lower().split()
    assert "Fewer than 30 recordings" in text
    for section in ("Ranking", "Against flat", "Failures", "Error and distance", "The face"):
        assert section in text
    assert "From the Jacobian to the map" not in text
    assert page.count("<figure id=") == 1 + 1 + 2 + 1  # the ranking, attribution, near and far, the face
    assert page.count("Data (CSV)") == 5
    with pytest.raises(UnknownName, match="did you mean 'flat'"):
        bk.report.write(done[1], tmp_path / "report.html", baseline="flta")
    with pytest.raises(InvalidConfig, match="not the results of a study"):
        bk.report.write(xr.Dataset(), tmp_path / "report.html")


def test_a_summary_holds_estimators_against_each_other(done):
    means = summary.summarise(done[1], "relative_error_use")
    assert means["median"].dims == ("embodiment", "recording", "estimator", "probe")
    np.testing.assert_allclose(means["median"], done[1]["relative_error_use"].median("seed"))
    # Three recordings have no interval.
    assert means["lower"].isnull().all()
    assert (means["recordings"] == 3).all()
    found = summary.compare(done[1].sel(estimator=["flat", "paper"]), "relative_error_use", "flat")
    assert list(found["estimator"].values) == ["paper"]
    flat, paper = (done[1]["relative_error_use"].sel(estimator=name, probe="on_face") for name in ("flat", "paper"))
    on_face = found.sel(probe="on_face")
    assert float(on_face["ratio"].squeeze()) == pytest.approx(float(np.exp(np.log(paper / flat).mean())))
    assert float(on_face["p"].squeeze()) == statistics.sign_flip(np.log(paper / flat).squeeze())
    np.testing.assert_allclose(found["p_holm"], statistics.holm(found["p"].values.ravel()).reshape(found["p"].shape))


def test_the_commands_run_report_and_tell_how_far_it_is(tmp_path, capsys):
    (tmp_path / "study.toml").write_text(
        'seeds = 1\nembodiments.infant = "infant"\nestimators.flat = "LeastSquares"\n'
        'estimators.odd = "odd_estimators:Odd"\nprobes.on_face = "on_face"\n'
        "[recordings.still]\ntraining.Circle = {turns = 0.5}\nuse.RandomTouch = {duration = 5.0}\n"
        "tour.FaceTour = {speed = 0.2}\n"
    )
    out = tmp_path / "out"
    with pytest.raises(InvalidConfig, match="holds no study"):
        status_command(out)
    assert commands.study_command(tmp_path / "study.toml", out, scheduler="in-process") == FAILED
    assert "infant/still/odd, seeds 0: ValueError: nothing to learn" in capsys.readouterr().err
    assert status_command(out) == FAILED
    assert "infant/still/flat: 1 of 1 done\ninfant/still/odd: 0 of 1 done, 1 failed" in capsys.readouterr().out
    assert commands.report_command(out, baseline="flat", publish=tmp_path / "kept") == FAILED
    assert "| flat |" in (tmp_path / "kept/table.md").read_text()
    assert "nothing to learn" in (out / "report.html").read_text()
    with xr.open_dataset(out / "results.nc", engine="h5netcdf") as results:
        assert float(results["relative_error"].sel(estimator="flat").max()) > 0
    recording = tmp_path / "seen.nc"
    bk.write_recording(recording_of(out, "still", 0), recording)
    assert commands.fit_command("LeastSquares", recording, tmp_path / "learned") == 0
    assert bk.load_learned(tmp_path / "learned").p == 5
    with ThreadPoolExecutor(1) as threads:
        study = Study.from_toml(tmp_path / "study.toml")
        assert int((study.run(out, threads, retry=True)["failure"] != "").sum()) == 1
