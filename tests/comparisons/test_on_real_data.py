"""Comparisons on recordings that are not shipped: skipped with a word without them, and right with them."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

import bodyimage_kin as bk

COMPARISONS = Path(__file__).parents[2] / "comparisons"


def script(name: str, monkeypatch: pytest.MonkeyPatch, file: str = "run"):
    monkeypatch.syspath_prepend(COMPARISONS / name)
    spec = importlib.util.spec_from_file_location(f"{name}_{file}_on_real_data", COMPARISONS / name / f"{file}.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["motoman", "tactile_arm"])
def test_without_the_files_nothing_is_done_and_that_is_said(name, monkeypatch, tmp_path, capsys):
    run = script(name, monkeypatch)
    run.main(["--data", str(tmp_path), "--out", str(tmp_path / "out")])
    assert capsys.readouterr().out.startswith(f"skipped: no {name}/")
    assert not (tmp_path / "out").exists()


def test_the_arm_before_a_tracker_stands_where_its_rows_say(real_data, monkeypatch):
    motoman = script("motoman", monkeypatch, "motoman")
    exp = motoman.tracker_points(real_data, "updated_leica")
    body = motoman.tracked(exp)
    assert (exp.sizes["time"], body.camera.model.unit) == (587, "m")
    off = np.linalg.norm(body.hand_image(exp.q.values[0]).numpy() - exp.hand_image.values[0], axis=1)
    # An axis or a sign astray gives decimetres.
    assert 2e-3 < np.median(off) < 2.5e-3
    assert len(np.unique(exp.block.values)) == motoman.BLOCKS


def test_a_real_link_that_grew_is_measured_by_touch_alone(real_data, monkeypatch):
    run = script("tactile_arm", monkeypatch)
    old = run.arm()
    before = run.Touches.read(real_data, "no_tool")
    pad = run.fitted_pad(before, old)
    for file, grown in (("tool_l1plus20mm", [0.02, 0.0]), ("tool_l2plus20mm", [0.0, 0.02])):
        touches = run.Touches.read(real_data, file)
        found, gain = run.growth(run.off(touches, old, pad), touches.grown(old, pad))
        np.testing.assert_allclose(found, grown, atol=2.5e-3)
        assert gain > 100


def test_the_slope_of_the_foreseen_taxel_is_that_of_the_body(monkeypatch):
    run = script("tactile_arm", monkeypatch)
    rng = np.random.default_rng(0)
    touches = run.Touches(rng.uniform(-1.0, 1.0, (6, 2)), np.zeros((6, 2)))
    pad = rng.standard_normal((3, 2))
    slope = touches.grown(run.arm(), pad)
    for link, lengths in enumerate([(run.LINK + 1e-3, run.LINK), (run.LINK, run.LINK + 1e-3)]):
        moved = run.off(touches, run.arm(), pad) - run.off(touches, run.arm(lengths), pad)
        np.testing.assert_allclose(moved / 1e-3, slope[:, :, link], atol=1e-9)
    assert isinstance(run.arm(), bk.Embodiment)


def test_the_triangles_of_a_real_torso_are_in_their_places_and_would_be_found_elsewhere(real_data, monkeypatch):
    run = script("nao", monkeypatch)
    found = run.triangles.misplaced(run.nao.TORSO, real_data)
    assert found["misplaced"] == []
    assert found["found_if"]["swapped"] == 1.0


def test_of_the_skin_of_an_arm_every_place_is_where_it_touches(real_data, monkeypatch):
    run = script("nao", monkeypatch)
    found = run.fitting.found(run.nao.BY_ARM["torso_by_right_arm"], real_data, quick=True)
    before, after = found.told["calibration"].values()
    assert before["held_out_mm"] > 30
    assert (after["numbers"], after["held_out_mm"] < 3) == (12, True)
    # Blocks that no fit saw, each touch by another place of the arm.
    q, offset = found.touches["q"].values[0], found.touches["hand_offset"].values[0]
    sight = found.body.hand_in_skin(q, offset).numpy()
    skin = found.body.require_skin()
    places = np.stack([skin.link_positions[one[one >= 0]].mean(0) for one in found.touches["touched"].values[0]])
    assert np.ptp(offset, axis=0).max() > 0.05
    assert np.median(np.linalg.norm(sight - places, axis=1)) < 4e-3
    one_place = found.body.hand_in_skin(q).numpy()
    assert np.median(np.linalg.norm(one_place - places, axis=1)) > 8e-3


@pytest.mark.parametrize(("part", "wrist"), [("torso", "r_wrist"), ("head", "l_wrist")])
def test_the_public_file_of_nao_and_its_table_are_one_robot(real_data, monkeypatch, part, wrist):
    run = script("nao", monkeypatch)
    public = bk.Robot.from_urdf(real_data / "nao" / "nao.urdf")
    table = run.nao.robot_of(run.nao.RECORDINGS[part])
    q = public.sample(200, seed=0)
    shared = [name for name in table.joint_names if name in public.joint_names]
    values = torch.zeros((len(q), len(table.joint_names)), dtype=torch.float64)
    for name in shared:
        values[:, table.joint_index(name)] = q[:, public.joint_index(name)]
    ends = {"hand": (wrist, (0.05775, 0.0, 0.0))} | ({"head": ("Head", None)} if part == "head" else {})
    one, other = bk.kinematics(public), bk.kinematics(table)
    for end, (link, offset) in ends.items():
        in_torso = torch.linalg.inv(one.pose(q, "torso")) @ one.pose(q, link, offset)
        by_table = torch.linalg.inv(other.pose(values, "torso")) @ other.pose(values, end)
        torch.testing.assert_close(in_torso[:, :3, 3], by_table[:, :3, 3], rtol=0.0, atol=1e-12)
        turned = in_torso[:, :3, :3].mT @ by_table[:, :3, :3]
        torch.testing.assert_close(turned, turned[:1].expand_as(turned), rtol=0.0, atol=1e-12)


def test_nao_by_its_public_file_reaches_its_face(real_data, tmp_path):
    text = (COMPARISONS / "nao" / "nao.toml").read_text(encoding="utf-8")
    (tmp_path / "nao.toml").write_text(
        text.replace('"nao.urdf"', f'"{(real_data / "nao" / "nao.urdf").as_posix()}"'), encoding="utf-8"
    )
    body = bk.load_embodiment(tmp_path / "nao.toml")
    assert (body.name, body.p) == ("nao", len(body.joints))
    corners = [0, 20, 220, 420, 440]
    q = body.touch_postures(corners)
    skin = body.require_skin()
    away = body.hand_in_skin(q).numpy() - skin.link_positions[corners]
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), body.hand.radius, atol=1e-6)
    assert not body.visible(q).any()
