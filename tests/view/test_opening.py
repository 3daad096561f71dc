"""What a user names becomes a scene: a recording, a study, a body; anything else is told in one line."""

import numpy as np
import pytest

import bodyimage_kin as bk
from bodyimage_kin import view
from bodyimage_kin.cli import main
from bodyimage_kin.errors import InvalidConfig


def test_a_recording_says_whose_it_is(circle, tmp_path):
    bk.write_recording(circle, tmp_path / "seen.nc")
    scene = view.open_scene(tmp_path / "seen.nc")
    assert scene.body == bk.load_embodiment("infant")
    assert list(scene.recordings) == ["seen"]
    assert {"analytic", "least_squares"} <= set(scene.estimators)
    moment = scene.moment("seen", 30, "least_squares")
    assert np.isfinite(moment.estimate).all()
    bk.write_recording(circle.drop_attrs(), tmp_path / "whose.nc")
    with pytest.raises(InvalidConfig, match="give --embodiment"):
        view.open_scene(tmp_path / "whose.nc")
    again = view.open_scene(
        tmp_path / "whose.nc", embodiment="infant", learn_from=tmp_path / "seen.nc", next_postures=2
    )
    assert again.learn_from is not None
    assert again.q_ghosts.shape == (2, 5)


def test_a_study_shows_its_recordings_estimators_and_errors_on_the_skin(body, tmp_path):
    kinematic = bk.study.Simulation(bk.motions.Circle(turns=1.0), dynamics=False)
    study = bk.Study(
        "infant", {"near": kinematic}, {"mine": bk.estimators.LeastSquares()}, seeds=1,
        scores=["relative_error_use", "relative_error_by_posture"],
    )  # fmt: skip
    results = study.run(tmp_path / "out", "in-process")
    scene = view.open_scene(tmp_path / "out")
    assert "near, training" in scene.recordings
    assert list(scene.estimators) == ["mine"]
    assert "relative error, mine" in scene.colourings
    moment = scene.moment("near, training", 20, "mine", "relative error, mine")
    kept = results["relative_error_by_posture"].sel(estimator="mine", probe="on_face").values.ravel()
    np.testing.assert_allclose(moment.values, kept / kept.max())


def test_what_is_nothing_of_these_is_one_line(tmp_path, capsys):
    assert main(["view", str(tmp_path / "nothing.nc")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "no embodiment (" in said
    assert "infant" in said
