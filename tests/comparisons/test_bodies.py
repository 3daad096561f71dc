"""The comparison over bodies: its summary is that of its infants, and these are of the population that is stated."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "comparisons" / "bodies"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(FOLDER)
    spec = importlib.util.spec_from_file_location("comparison_of_bodies", FOLDER / "run.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def found():
    return json.loads((FOLDER / "results.json").read_text(encoding="utf-8"))


def test_the_summary_and_the_table_are_those_of_the_infants(script, found):
    assert script.summarised(found["bodies"]) == found["summary"]
    assert script.table(found) == (FOLDER / "table.md").read_text(encoding="utf-8")


def test_there_are_enough_infants_and_each_is_of_the_population(found):
    people = [body["individual"] for body in found["bodies"]]
    assert len(people) >= 30
    for name, least, most in (
        ("arm", 0.7, 1.5), ("optical_centre", 0.02, 0.08), ("radius", 0.025, 0.06), ("distance", 0.015, 0.06),
        ("torque", 0.05, 0.2), ("encoder", 5e-4, 2e-3), ("image", 1e-4, 4e-4),
    ):  # fmt: skip
        values = [one[name] for one in people]
        assert least <= min(values) < max(values) <= most, name
        assert len(set(values)) == len(people), name
    assert len({one["face"] for one in people}) == 5
    assert np.std([one["tilt"] for one in people]) == pytest.approx(3.0, abs=0.3)


def test_an_infant_is_drawn_again_the_same_and_is_what_it_says(script, found, tmp_path, body):
    kept = found["bodies"][3]["individual"]
    one, drawn = script.drawn(3, tmp_path)
    assert json.loads(json.dumps(vars(one))) == kept
    # Its arm is so much longer, and its optical centre so far behind the face.
    usual, own = ({joint.name: joint.origin for joint in each.robot.tree.joints} for each in (body, drawn))
    for joint in ("left_elbow", "left_wrist", "left_hand_centre"):
        lengths = [np.linalg.norm(origin[joint][:3, 3]) for origin in (own, usual)]
        assert lengths[0] / lengths[1] == pytest.approx(kept["arm"])
    moved = own["right_eye_centre"][0, 3] - usual["right_eye_centre"][0, 3]
    assert moved == pytest.approx(0.02 - kept["optical_centre"])
    assert drawn.camera.model.near == pytest.approx(kept["optical_centre"] + 0.03)
