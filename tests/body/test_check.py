"""What a look at a body tells before anything is computed."""

import dataclasses
import math

import numpy as np
import pytest
import torch
from robots import ARM

import bodyimage_kin as bk
from bodyimage_kin import cli
from bodyimage_kin.body.check import check_embodiment, refuse_errors
from bodyimage_kin.errors import InvalidConfig, ManyMistakes
from bodyimage_kin.published import fuke2007
from bodyimage_kin.robot.transforms import rpy_matrix, transform

DOWN = transform(np.diag([1.0, -1.0, -1.0]), (0.3, 0.0, 1.0))
CAMERA = bk.Pinhole(500.0, 500.0, 320.0, 240.0, size=(640, 480))


def told(found, about):
    return [(one.level, one.text) for one in found if one.about == about]


def planar(**changes):
    parts = {
        "joints": ["shoulder", "elbow"],
        "hand": bk.Hand("hand"),
        "camera": bk.Camera("base", DOWN, CAMERA),
        "home": {"shoulder": 0.3, "elbow": -0.6},
    }
    return bk.Embodiment.build(bk.Robot.from_urdf(ARM), **parts | changes)


def sees_touch(body, near=0.01):
    model = dataclasses.replace(body.camera.screen, near=near)
    return dataclasses.replace(body, camera=dataclasses.replace(body.camera, model=model))


def test_of_the_infant_there_is_nothing_to_tell(body):
    assert check_embodiment(body, paper=True) == ()
    refuse_errors(body, ())


def test_an_eye_that_sees_the_touching_hand_is_wrong_for_the_paper_and_a_note_elsewhere(body):
    sees = sees_touch(body)
    (error,) = told(check_embodiment(sees, paper=True), "touch")
    (note,) = told(check_embodiment(sees), "touch")
    q = body.touch_postures(range(441))
    seen, depth = sees.visible(q), body.hand_in_camera(q)[:, 2]
    deepest = int(torch.where(seen, depth, -1.0).argmax())
    for text in (error[1], note[1]):
        assert (
            f"touches {int(seen.sum())} of 441 taxels, up to {float(depth[deepest]):.3g} m deep (taxel {deepest})"
            in text
        )
        assert "near = 0.01 m" in text
    assert (error[0], note[0]) == ("error", "note")
    assert f"give near above {float(depth[deepest]):.3g} m" in error[1]
    # The advice is right: with near there, the eye sees none.
    assert not told(check_embodiment(sees_touch(body, near=float(depth[deepest]) + 1e-6), paper=True), "touch")
    with pytest.raises(InvalidConfig, match="embodiment 'infant': touch: the eye sees the hand"):
        refuse_errors(sees, check_embodiment(sees, paper=True))


def test_unseen_circles_and_taxels_out_of_reach_are_told(body):
    far = dataclasses.replace(body.camera.screen, near=0.09)
    blind = dataclasses.replace(body, camera=dataclasses.replace(body.camera, model=far))
    ((level, text),) = told(check_embodiment(blind, paper=True), "circle")
    assert level == "error"
    assert "72 of 72 places of the circle of radius 0.05 m at distance 0.03 m (depths 0.07" in text
    assert "near = 0.09 m" in text
    ((level, text), *_) = told(check_embodiment(body, radius=0.2), "circle")
    assert level == "note"
    assert "the hand cannot reach" in text
    narrow = bk.Embodiment.build(
        body.robot, joints=body.joints[:3], hand=body.hand, camera=body.camera, skin=body.skin, home=body.home
    )
    ((level, text), *_) = told(check_embodiment(narrow, paper=True), "touch")
    assert level == "error"
    with pytest.raises(bk.errors.Unreachable) as caught:
        narrow.touch_postures(range(441))
    assert f"cannot reach {len(caught.value.taxels)} of 441 taxels" in text
    with pytest.raises(ManyMistakes, match=r"\d mistakes:"):
        refuse_errors(narrow, check_embodiment(narrow, paper=True))


def test_a_skinless_arm_seen_from_above():
    body = planar()
    found = check_embodiment(body)
    assert {one.level for one in found} == {"note"}
    # All joints move in one plane: of a frontal circle 1 m in front of the camera all is within reach and in view.
    assert not told(found, "circle")
    assert told(found, "dynamics") == [
        (
            "note",
            "the arm cannot be dragged: no link that the felt joints move has a mass; simulate with dynamics=False",
        )
    ]
    ((level, text),) = told(check_embodiment(body, paper=True), "touch")
    assert (level, text) == ("error", "it has no skin, on which the paper's hand touches; give it one")
    away = planar(camera=bk.Camera("base", transform(rpy_matrix((0.0, 0.0, 0.0)), (0.3, 0.0, 1.0)), CAMERA))
    ((level, text),) = told(check_embodiment(away), "eye")
    assert level == "error"
    assert "in none of 2000 postures" in text
    assert "depths -1 to -1 m" in text
    ((level, text),) = told(check_embodiment(away), "circle")
    assert "at home the hand is behind the camera (depth -1 m)" in text


def test_joints_that_the_eye_never_sees_move_the_hand_are_told():
    carried = planar(camera=bk.Camera("upper", np.eye(4), bk.Tracker()))
    assert told(check_embodiment(carried), "joints") == [
        ("note", "'shoulder' never move the hand as the eye sees it: their columns of Jacobians are 0")
    ]
    hangs = planar(camera=bk.Camera("lower", np.eye(4), bk.Tracker()))
    ((level, _),) = told(check_embodiment(hangs), "joints")
    assert level == "error"
    assert "felt joint 'elbow' moves 'lower'" in told(check_embodiment(hangs), "dynamics")[0][1]


def test_missing_meshes_are_counted(tmp_path):
    seen = '<visual><geometry><mesh filename="{}.stl"/></geometry></visual>'
    text = ARM
    for link, name in (("upper", "there"), ("lower", "not"), ("hand", "not")):
        text = text.replace(f'<link name="{link}"/>', f'<link name="{link}">{seen.format(name)}</link>')
    (tmp_path / "arm.urdf").write_text(text)
    (tmp_path / "there.stl").write_bytes(b"")
    robot = bk.Robot.from_urdf(tmp_path / "arm.urdf")
    body = bk.Embodiment.build(robot, joints=["elbow"], hand=bk.Hand("hand"), camera=bk.Camera("base", DOWN, CAMERA))
    ((level, text),) = told(check_embodiment(body), "meshes")
    assert level == "note"
    assert text.startswith("1 of 2 mesh files are not found, the first: link 'lower': mesh 'not.stl' is not in")


def test_bad_circles_are_refused():
    with pytest.raises(InvalidConfig, match=r"radius=0\.0: give a number above 0"):
        check_embodiment(planar(), radius=0.0)
    with pytest.raises(InvalidConfig, match="distance=nan"):
        check_embodiment(planar(), distance=math.nan)


def test_the_command_prints_what_is_found_and_ends_with_its_verdict(tmp_path, capsys, body):
    assert cli.main(["embodiment", "check", "infant", "--paper"]) == 0
    assert "nothing to tell" in capsys.readouterr().out
    file = sees_touch(body).save(tmp_path / "sees.toml")
    assert cli.main(["embodiment", "check", str(file)]) == 0
    assert "note: touch: the eye sees the hand" in capsys.readouterr().out
    assert cli.main(["embodiment", "check", str(file), "--paper"]) == 1
    assert "error: touch: the eye sees the hand" in capsys.readouterr().out
    file.write_text(file.read_text().replace("left_hand", "left_hnad").replace("near = ", "naer = "))
    assert cli.main(["embodiment", "check", str(file)]) == 2
    said = capsys.readouterr().err
    assert "sees.toml: 2 mistakes:" in said
    assert "did you mean 'left_hand'" in said


def test_the_paper_is_not_begun_with_a_body_that_is_unfit(tmp_path, body):
    file = sees_touch(body).save(tmp_path / "sees.toml")
    with pytest.raises(InvalidConfig, match="the eye sees the hand while it touches"):
        fuke2007.check(str(file))


def test_a_circle_that_is_too_wide_is_told_beside_one_that_would_do():
    body = bk.load_embodiment("infant")
    (wide,) = [
        one for one in check_embodiment(body, radius=0.3) if "cannot reach" in one.text and one.about == "circle"
    ]
    assert "radius (0.04 m would do)" in wide.text
    assert not [one for one in check_embodiment(body, radius=0.04) if one.about == "circle"]
