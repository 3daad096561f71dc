"""Comparisons on recordings that are not shipped: skipped with a word without them, and right with them."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

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
    body = run.nao.nominal(run.nao.TORSO, real_data)
    touches = run.unstuck(run.nao.touches(run.nao.TORSO, body, real_data, run.BLOCKS))
    found = run.triangles.misplaced(run.nao.TORSO, real_data, touches)
    assert found["misplaced"] == []
    assert found["found_if"]["swapped"] == 1.0
