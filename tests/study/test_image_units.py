"""Scores of images are in the unit of the image: metres on the paper's screen, pixels of a lens."""

from __future__ import annotations

import dataclasses

import pytest

import bodyimage_kin as bk

LENS = bk.Pinhole(600.0, 600.0, 320.0, 240.0, distortion=(-0.1, 0.01, 0.0, 0.0, 0.0))
SHIFT = [[1.0, 0.0, 0.0, 0.05], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
IN_IMAGE = ("trajectory_rmse", "map_error_to_truth")
SCORES = (*IN_IMAGE, "relative_error")


def looking(body, model):
    return dataclasses.replace(body, camera=bk.Camera(body.camera.link, body.camera.link_T_camera, model))


@pytest.mark.parametrize(
    ("model", "unit"), [(None, "m"), (LENS, "px"), (bk.Stereo(LENS, LENS, SHIFT), "px"), (bk.Tracker(), "m")]
)
@pytest.mark.filterwarnings("ignore::bodyimage_kin.errors.DataWarning")  # these eyes see the touching hand
def test_a_study_and_a_score_say_the_unit_of_the_image(tmp_path, body, model, unit):
    body = body if model is None else looking(body, model)
    recordings = bk.study.Simulation(bk.motions.Circle(turns=0.3), bk.motions.RandomTouch(duration=5.0), dynamics=False)
    study = bk.Study(body, {"near": recordings}, ["LeastSquares"], probes=["training"], seeds=1, scores=SCORES)
    results = study.run(tmp_path / "run", "in-process")
    assert (results["failure"] == "").all()
    learned = bk.estimators.LeastSquares().fit(bk.experience(circle := bk.simulate(body, bk.motions.Circle(turns=0.3))))
    tour = bk.simulate(body, bk.motions.FaceTour(("nose", "mouth")), dynamics=False)
    scores = bk.score(learned, body, circle, tour=tour, probes=["training"], scores=["trajectory_rmse"])
    for name in IN_IMAGE:
        assert results[name].attrs["units"] == unit
    assert scores["trajectory_rmse"].attrs["units"] == unit
    assert results["relative_error"].attrs["units"] == "1"
