"""Scores that a study computes only when they are named: the servo's basin, and why the tour's path is wrong."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.metrics import probes
from bodyimage_kin.recordings.motions import Circle, FaceTour, RandomTouch
from bodyimage_kin.study import Simulation, Study, answers, recording_of, scores, scoring


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A small study with the optional scores of a Jacobian, and its store."""
    store = tmp_path_factory.mktemp("optional") / "run"
    study = Study(
        embodiments={"infant": "infant"},
        recordings={"still": Simulation(Circle(turns=1.0), RandomTouch(duration=5.0), FaceTour(speed=0.2))},
        estimators={"waving": "TrigRidge"},
        seeds=1,
        probes={"on_face": "on_face", "joint_space": probes.JointSpace(30)},
        scores=["trajectory_rmse", "basin_by_posture", "trajectory_split"],
    )
    return study.run(store, "in-process"), store


@pytest.fixture(scope="module")
def learned(done):
    return bk.estimators.TrigRidge().fit(bk.experience(recording_of(done[1], "still", 0)))


def test_the_basin_is_that_of_the_public_function(done, learned, body):
    basin = done[0]["basin_by_posture"].squeeze()
    assert basin.attrs["units"] == "m"
    some = [0, 200, 440]
    wanted = metrics.servo_basin(
        lambda q: body.hand_image(torch.from_numpy(q), on_invisible="nan").numpy(),
        lambda q: body.hand_image_jacobian(torch.from_numpy(q)).numpy(),
        lambda q: learned.jacobian(torch.from_numpy(q)).numpy(),
        body.touch_postures(some).numpy(),
        lower=body.felt_robot.lower,
        upper=body.felt_robot.upper,
    ).radius
    np.testing.assert_array_equal(basin.sel(probe="on_face", posture=some), wanted)
    assert float(basin.sel(probe="on_face").max()) > 0
    # Of the face only: elsewhere a servo has no task here.
    assert np.isnan(basin.sel(probe="joint_space")).all()


def test_the_split_is_that_of_the_public_function(done, learned):
    results, store = done[0].squeeze(), done[1]
    tour = recording_of(store, "still", 0, "tour")
    wanted = metrics.error_split(
        tour["true_q"].values,
        tour["true_hand_image"].values,
        lambda q, dq: learned.displacement(torch.from_numpy(q), torch.from_numpy(dq)).numpy(),
        lambda q: learned.jacobian(torch.from_numpy(q)).numpy(),
    )
    split = results["trajectory_split"]
    assert list(split["cause"].values) == list(scores.CAUSES)
    for cause in scores.CAUSES:
        assert float(split.sel(cause=cause)) == wanted.rms[cause]
    assert float(results["trajectory_rmse"]) == pytest.approx(wanted.rms["total"], rel=1e-9)
    # It is the derivative of a function of the posture, and so goes back the way it came.
    assert float(split.sel(cause="circulation")) < 1e-9 < float(split.sel(cause="discretisation"))


def test_the_page_draws_the_basin_over_the_face(done, tmp_path):
    page = bk.report.write(done[0], tmp_path / "report.html", atlas="waving").read_text()
    assert "Basin: how far away on the screen a servo may start" in page
    assert page.count("<figure id=") == 1


def test_both_are_computed_only_when_they_are_named(monkeypatch, tmp_path):
    def refuse(*_, **__):
        raise AssertionError("nobody asked")

    monkeypatch.setattr(metrics, "servo_basin", refuse)
    monkeypatch.setattr(metrics, "error_split", refuse)
    study = Study(
        embodiments={"infant": "infant"},
        recordings={"still": Simulation(Circle(turns=0.5), RandomTouch(duration=5.0), dynamics=False)},
        estimators={"flat": "LeastSquares"},
        seeds=1,
        probes={"on_face": "on_face"},
    )
    assert study.run(tmp_path, "in-process")["failure"].item() == ""
    assert not {"basin_by_posture", "trajectory_split", "map_error"} & set(study.scores)


def test_a_wide_probe_is_worked_off_in_parts_and_scores_the_same(done, learned, body, monkeypatch):
    store = done[1]
    training, use, tour = (recording_of(store, "still", 0, role) for role in ("training", "use", "tour"))
    asked = []

    class Watched:
        displacement = staticmethod(learned.displacement)

        def jacobian(self, q):
            asked.append(len(q))
            return learned.jacobian(q)

    def score(chunk):
        monkeypatch.setattr(answers, "_CHUNK", chunk)
        wide = {"wide": probes.JointSpace(1000)}
        return bk.score(Watched(), body, training, use, wide, tour=tour, scores=scoring.default_scores(True))

    whole, parts = score(5000), score(300)
    assert asked == [1000, 300, 300, 300, 100]
    for name, value in whole.items():
        np.testing.assert_allclose(parts[name], value, rtol=1e-12, atol=1e-15, err_msg=name)


def test_a_wider_probe_of_the_joint_space_begins_with_the_narrower_one(body):
    narrow, wide = (probes._joint_space(body, count, 5) for count in (50, 2000))
    assert torch.equal(narrow, wide[:50])
    drawn = body.felt_robot.sample(20_000, seed=5)
    assert torch.equal(wide, drawn[body.hand_in_camera(drawn)[:, 2] >= body.camera.screen.near][:2000])
