"""The reproduction: one quick run, looked at from all sides."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import bodyimage_kin as bk
from bodyimage_kin import cli
from bodyimage_kin.published import fuke2007

INFANT = Path(__file__).parents[2] / "urdf" / "infant.toml"

SCORES = {
    "velocity_correlation",
    "velocity_nrmse",
    "displacement_error",
    "trajectory_rmse",
    "jacobian_relative_error",
    "jacobian_relative_error_use",
    "attribution",
    "map",
    "posture_map",
}
MAP = {"steps", "topological_error_mean", "topological_error_sd", "span", "folded_cells", "disparity", "scale"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("reproduction") / "out"
    assert cli.main(["reproduce", "--out", str(out), "--quick", "--seeds", "2"]) == 0
    return out


@pytest.fixture(scope="module")
def summary(folder):
    return json.loads((folder / "summary.json").read_text())


def test_summary_has_every_condition_estimator_and_score(summary):
    assert list(summary["conditions"]) == [
        "kinematic",
        "noise_free_200",
        "noise_free_500",
        "noisy_200",
        "noisy_500",
    ]
    for scores in summary["conditions"].values():
        assert {"paper_mlp", "least_squares", "analytic", "analytic_midpoint", "direct"} <= set(scores)
        for name, score in scores.items():
            assert set(score) >= ({"map", "posture_map"} if name == "direct" else SCORES)
            assert set(score["map"]) >= MAP
            assert score["map"]["steps"][0] == 0
            assert len(score["map"]["topological_error_mean"]) == len(score["map"]["steps"])
    assert summary["seeds"] == 2
    assert {"bodyimage-kin", "pin", "torch"} <= set(summary["versions"])


def test_attribution_sums_to_the_square_of_the_error(summary):
    for scores in summary["conditions"].values():
        for name, score in scores.items():
            if name != "direct":
                assert sum(score["attribution"].values()) == pytest.approx(
                    score["jacobian_relative_error_use"]["on_face"] ** 2, abs=1e-10
                )


def test_the_truth_is_exact_and_only_its_integration_errs(summary):
    for scores in summary["conditions"].values():
        euler, midpoint = scores["analytic"], scores["analytic_midpoint"]
        assert max(euler["jacobian_relative_error"].values()) < 1e-9
        assert euler["displacement_error"] < 1e-9
        assert midpoint["trajectory_rmse"] < euler["trajectory_rmse"] / 3


def test_kinematic_displacements_are_learned_less_well_than_known(summary):
    scores = summary["conditions"]["kinematic"]
    assert 0.2 < scores["paper_mlp"]["displacement_error"] < 0.9
    assert min(scores["paper_mlp"]["velocity_correlation"]) > 0.9


def test_claims_carry_measure_interval_criterion_and_verdict(summary):
    names = [claim["name"] for claim in summary["claims"]]
    assert len(names) == len(set(names)) >= 15
    for claim in summary["claims"]:
        assert {"name", "measured", "interval", "criterion", "holds"} <= set(claim)
        # Two recordings decide nothing.
        assert (claim["holds"] is None) == (claim["interval"] is None)


def test_recordings_are_kept(folder):
    for name in fuke2007.MOTIONS:
        for seed in (0, 1):
            for role, cls in {"training": "Circle", "tour": "FaceTour", "use": "RandomTouch"}.items():
                assert bk.study.recording_of(folder / "study", name, seed, role).attrs["motion"] == cls


def test_every_figure_is_there_twice(folder):
    names = {path.stem for path in (folder / "figures").glob("*.svg")}
    assert names == {path.stem for path in (folder / "figures").glob("*.png")}
    # Each with its values: also of postures and of joints.
    assert names == {path.stem for path in (folder / "figures").glob("*.csv")}
    for number in range(3, 12):
        assert any(name.startswith(f"fig{number:02d}") for name in names), number


def test_the_page_stands_alone(folder):
    page = (folder / "report.html").read_text()
    assert len(page) < 8e6
    assert not re.search(r'(src|href)\s*=\s*["\'](?!data:|#)', page)
    assert not re.search(r"@import|url\((?!#)", page)
    assert "nan" not in re.sub(r"data:[^\"]*", "", page).lower().split()


def test_a_reproduction_is_taken_up_where_it_ended(folder, summary, capsys):
    cell = next((folder / "study" / "cells").rglob("paper_mlp_500.*"))
    kept = {path: path.stat().st_mtime_ns for path in (folder / "study" / "cells").rglob("*") if path.is_file()}
    cell.unlink()
    assert cli.main(["reproduce", "--out", str(folder), "--quick", "--seeds", "2"]) == 0
    again = {path: path.stat().st_mtime_ns for path in (folder / "study" / "cells").rglob("*") if path.is_file()}
    changed = [path for path in again if again[path] != kept.get(path)]
    assert [path.name.partition(".")[0] for path in changed] == ["paper_mlp_500"]
    assert len(again) == len(kept)
    assert json.loads((folder / "summary.json").read_text()) == summary


def test_another_experiment_needs_another_folder(folder, capsys):
    assert cli.main(["reproduce", "--out", str(folder), "--quick", "--seeds", "2", "--embodiment", str(INFANT)]) == 2
    assert "name another folder" in capsys.readouterr().err


def test_an_earlier_reproduction_may_be_written_again_but_nothing_else(folder, tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("mine")
    assert cli.main(["reproduce", "--out", str(tmp_path), "--quick"]) == 2
    assert "not a reproduction" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--embodiment", "infnat"], "no embodiment 'infnat'; did you mean 'infant'"),
        (["--seeds", "0"], "seeds=0"),
    ],
)
def test_a_wrong_argument_is_one_line_and_touches_nothing(arguments, message, tmp_path, capsys):
    out = tmp_path / "out"
    assert cli.main(["reproduce", "--out", str(out), *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not out.exists()


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path, capsys):
    (tmp_path / "out").write_text("a file")
    assert cli.main(["reproduce", "--out", str(tmp_path / "out")]) == 2
    assert "is not a folder" in capsys.readouterr().err


@pytest.mark.slow
def test_two_runs_are_the_same_to_the_bit_whatever_the_workers(tmp_path):
    study = fuke2007.grid(seeds=2, quick=True)
    one, two = (study.run(tmp_path / str(workers), workers=workers) for workers in (1, 2))
    assert json.dumps(fuke2007.judge(one)) == json.dumps(fuke2007.judge(two))
