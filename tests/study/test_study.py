"""Studies: one written form, the same bits whoever works, and nothing lost but what failed."""

from __future__ import annotations

import pytest

import bodyimage_kin as bk
from bodyimage_kin.study import Study


def small(**changes):
    """A study that takes seconds."""
    asked = {
        "embodiments": {"infant": "infant"},
        "recordings": {"still": {"circle": {"turns": 0.5}, "touch": {"duration": 10.0}, "tour": {"speed": 0.1}}},
        "estimators": {"flat": "LeastSquares", "paper": {"PaperMLP": {"steps": 20}}},
        "seeds": 3,
        "block": 2,
    }
    return Study(**asked | changes)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A small study, its results and its store."""
    store = tmp_path_factory.mktemp("study") / "run"
    study = small(estimators={**small().estimators, "truth": "Analytic"}, per_posture=True)
    return study, study.run(store, "in-process"), store


def test_a_study_is_read_as_it_was_written(tmp_path):
    study = small(estimators={"flat": bk.estimators.LeastSquares(scale=0.5), "truth": "Analytic"}, time_limit=9.5)
    study.to_toml(tmp_path / "study.toml")
    assert Study.from_toml(tmp_path / "study.toml") == study
    assert Study.from_toml(tmp_path / "study.toml").table() == study.table()


def test_the_truth_has_no_error_and_learners_have(done):
    _, results, _ = done
    truth = results.sel(estimator="truth")
    assert float(truth["relative_error_use"].max()) < 1e-9
    assert float(truth["displacement_error"].max()) < 1e-9
    assert float(results.sel(estimator="flat")["relative_error_use"].min()) > 0.05
    assert set(results["failure"].values.ravel()) == {""}
