"""The open benchmark: what a row says, that a wrong split is told, and that anybody's class can be scored."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np
import pytest

import bodyimage_kin as bk
from bodyimage_kin.study.specs import ESTIMATOR

FOLDER = Path(__file__).parents[2] / "comparisons" / "benchmark"


@pytest.fixture
def run(monkeypatch):
    spec = importlib.util.spec_from_file_location("benchmark_run", FOLDER / "run.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def linear(run):
    """Two parts of an arm whose image is linear in its joints: least squares is perfect, standing still has error 1."""
    rng = np.random.default_rng(0)
    matrix = rng.standard_normal((2, 3))

    def exp(count):
        q = rng.uniform(-1.0, 1.0, (count, 3))
        return bk.recording(q=q, hand_image=q @ matrix.T, joints=["a", "b", "c"], order="scattered", unit="m")

    def part():
        hidden = exp(40)
        return run.Part(exp(40), run._displacements(hidden, np.arange(40) // 4))

    return {"bodies": [part(), part()]}


def test_a_row_has_the_error_of_the_whole_and_of_each_unit(run, linear):
    right = run.row("right", bk.estimators.LeastSquares(), linear)["tasks"]["bodies"]
    half = run.row("half", bk.estimators.LeastSquares(scale=0.5), linear)["tasks"]["bodies"]
    assert right["units"] == 20
    assert right["error"] < 1e-9
    assert half["error"] == pytest.approx(0.5)
    np.testing.assert_allclose(half["each"], 0.5)
    assert json.loads(json.dumps(half)) == half


def test_a_class_of_anybodys_is_scored_by_its_name(run, linear, tmp_path, monkeypatch):
    text = "import bodyimage_kin as bk\nclass Mine(bk.estimators.LeastSquares):\n    pass\n"
    (tmp_path / "my_learner.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    spec = ESTIMATOR.build({"my_learner:Mine": {"scale": 2.0}}, Path())
    assert run.row("mine", spec, linear)["tasks"]["bodies"]["error"] == pytest.approx(1.0)


def test_who_fails_is_in_the_table_and_last(run, linear):
    unfit = bk.estimators.RecursiveLeastSquares()  # it wants a stream
    rows = [run.row("fails", unfit, linear), run.row("right", bk.estimators.LeastSquares(), linear)]
    assert "scattered" in rows[0]["tasks"]["bodies"]["failed"]
    lines = run.table(rows).splitlines()
    assert lines[-2].startswith("| right | 1.0 | 1: ")
    assert lines[-1] == "| fails | 2.0 | failed |"


def test_rows_of_other_splits_or_versions_do_not_compete(run, linear):
    row = run.row("right", bk.estimators.LeastSquares(), linear)
    found = run.splits(linear)
    assert run.differing(found) == ["bodies"]
    published = json.loads((FOLDER / "splits.json").read_text(encoding="utf-8"))
    assert run.differing(published) == []
    for other in ({"not_as_published": ["bodies"]}, {"version": run.VERSION + 1}):
        assert "| right |" not in run.table([row | other])


def test_the_published_table_is_that_of_the_published_rows(run):
    rows = [json.loads(file.read_text(encoding="utf-8")) for file in sorted((FOLDER / "rows").glob("*.json"))]
    assert {row["name"] for row in rows} >= set(run.OURS)
    assert run.table(rows) == (FOLDER / "table.md").read_text(encoding="utf-8")
