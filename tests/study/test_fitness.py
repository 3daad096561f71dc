"""A study of a body with which it cannot work ends before it begins, and says what to mend."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig


def study(body, motion):
    return bk.Study(body, {"mine": motion}, [bk.estimators.LeastSquares()], probes=["training"], seeds=1)


def turned_away(body):
    """The infant with eyes in the back of its head."""
    pose = body.camera.link_T_camera.numpy() @ np.diag([-1.0, 1.0, -1.0, 1.0])
    return dataclasses.replace(body, camera=bk.Camera(body.camera.link, pose, body.camera.model))


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        (bk.motions.Circle(radius=3.0), "circle: the hand cannot reach 72 of 72 places of the circle of radius 3 m"),
        ([bk.motions.Circle(), bk.motions.Circle(distance=5.0)], "circle: the hand cannot reach 72 of 72"),
    ],
)
def test_a_circle_out_of_reach_is_told_before_a_folder_is_made(tmp_path, body, motion, message):
    given = bk.study.Simulation(motion) if isinstance(motion, list) else motion
    with pytest.raises(InvalidConfig, match=message):
        study(body, given).run(tmp_path / "out", "in-process")
    assert not (tmp_path / "out").exists()


def test_an_eye_that_never_sees_the_hand_is_told(tmp_path, body):
    with pytest.raises(InvalidConfig, match=r"embodiment 'infant'(.|\n)*eye"):
        study(turned_away(body), bk.motions.Circle()).run(tmp_path / "out", "in-process")
    assert not (tmp_path / "out").exists()


def test_recordings_that_are_there_need_no_circle(tmp_path, body, circle):
    assert (study(body, circle).run(tmp_path / "out", "in-process")["failure"] == "").all()
