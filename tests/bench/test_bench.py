"""The bench runs, measures what it says, and its files say what it measured."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from bodyimage_kin import bench
from bodyimage_kin.bench import measure, others
from bodyimage_kin.bench.engines import arms, engines
from bodyimage_kin.errors import InvalidConfig


def test_every_engine_computes_the_same_thing() -> None:
    for arm in arms():
        q = arm.robot.sample(40)
        found = {engine.name: engine for engine in engines(arm)}
        truth = found["Pinocchio, arm alone"].forward(q)
        for name, engine in found.items():
            # Taken as it comes, pytorch-kinematics reads the URDF's numbers in float32.
            tolerance = 1e-6 if name == "pytorch-kinematics" else 1e-13
            for actual, expected in zip(engine.forward(q), truth, strict=True):
                torch.testing.assert_close(torch.as_tensor(actual), expected, rtol=0, atol=tolerance)
        gradients = {name: engine.backward(q)[2] for name, engine in found.items() if engine.backward}
        assert set(gradients) == {"pytorch-kinematics", "numba", "torch"}
        for gradient in gradients.values():
            torch.testing.assert_close(gradient, gradients["numba"], rtol=0, atol=1e-5)


def test_turns_are_taken_and_short_work_is_repeated() -> None:
    calls: list[str] = []
    now = 0.0

    def work(name: str, seconds: float) -> None:
        nonlocal now
        calls.append(name)
        now += seconds

    long, short = 4 * measure._LEAST, measure._LEAST / 100
    each = {"long": lambda: work("long", long), "short": lambda: work("short", short)}
    seconds = measure.turns(each, 3, lambda: now)
    assert seconds["long"] == pytest.approx([long] * 3)
    assert seconds["short"] == pytest.approx([short] * 3)
    # Twice to find out how long it takes, then once a turn, or as often as makes a turn long enough.
    assert calls.count("long") == 2 + 3
    assert calls.count("short") == pytest.approx(2 + 3 * 100, abs=3)
    rounds = [name for name, before in zip(calls[1:], calls, strict=False) if name != before]
    assert rounds == ["short", "long", "short", "long", "short", "long", "short"]


def test_a_run_is_written_as_tables_json_and_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure, "_threads", lambda *_: [])
    for name in ("growth", "images", "maps"):
        monkeypatch.setattr(others, name, lambda _: [])
    told: list[str] = []
    settings = bench.Settings(batches=(1, 50), rounds=3, robots=("infant arm",), stream=100_000)
    result = bench.run(settings, report=told.append)
    page = bench.write(result, tmp_path).read_text()
    assert json.loads((tmp_path / "speed.json").read_text()) == json.loads(json.dumps(result))
    assert {row["batch"] for row in result["forward"]} == {1, 50}
    for row in result["forward"]:
        low, middle, high = row["seconds"]
        assert 0 < low <= middle <= high
        assert row["error"] <= (1e-6 if row["engine"] == "pytorch-kinematics" else 1e-13)
        assert f"| {row['engine']} |" in page
    assert result["stream"]["postures"] == 100_000
    assert (tmp_path / "speed.svg").stat().st_size > 1000
    assert (tmp_path / "speed.png").stat().st_size > 1000
    assert any("infant arm" in line for line in told)
    assert torch.get_num_threads() == 1


def test_images_in_one_pass_are_measured_against_images_that_are_not() -> None:
    rows = others.images(1)
    seconds = {row["what"]: row["seconds"][1] for row in rows}
    assert seconds["image Jacobian, one pass"] < seconds["image Jacobian, from 6 x n ones"]


@pytest.mark.parametrize("settings", [{"batches": ()}, {"batches": (0,)}, {"rounds": 0}])
def test_impossible_settings_are_refused(settings: dict) -> None:
    with pytest.raises(InvalidConfig, match="positive"):
        bench.Settings(**settings)
