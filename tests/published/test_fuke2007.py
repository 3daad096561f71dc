"""The reproduction: one quick run, looked at from all sides."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest

from bodyimage_kin import cli
from bodyimage_kin.published import fuke2007
from bodyimage_kin.recordings import read_recording

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
    for motion in fuke2007.MOTIONS:
        for seed in (0, 1):
            for kind, cls in {"circle": "Circle", "face_tour": "FaceTour", "random_touch": "RandomTouch"}.items():
                recording = read_recording(folder / "recordings" / f"{motion.name}_seed{seed}_{kind}.nc")
                assert recording.attrs["motion"] == cls


def test_every_figure_is_there_twice(folder):
    names = {path.stem for path in (folder / "figures").glob("*.svg")}
    assert names == {path.stem for path in (folder / "figures").glob("*.png")}
    for number in range(3, 12):
        assert any(name.startswith(f"fig{number:02d}") for name in names), number


def test_the_page_stands_alone(folder):
    page = (folder / "report.html").read_text()
    assert len(page) < 8e6
    assert not re.search(r'(src|href)\s*=\s*["\'](?!data:|#)', page)
    assert not re.search(r"@import|url\(", page)
    assert "nan" not in re.sub(r"data:[^\"]*", "", page).lower().split()


def test_a_cell_is_the_same_bits_alone_and_in_the_pool(summary, tmp_path):
    settings = fuke2007.Settings(seeds=2, quick=True)
    one, again = (fuke2007.run_cell(settings, fuke2007.MOTIONS[2], 1, tmp_path) for _ in range(2))
    for cell, same in zip(one, again, strict=True):
        for name, scored in cell.scored.items():
            for field in dataclasses.fields(scored):
                np.testing.assert_equal(getattr(scored, field.name), getattr(same.scored[name], field.name))
        np.testing.assert_array_equal(cell.mapped["paper_mlp"].maps, same.mapped["paper_mlp"].maps)


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
    settings = fuke2007.Settings(seeds=2, quick=True)
    one, two = (
        fuke2007.summarise(settings, fuke2007.run(settings, tmp_path / str(workers), workers=workers))
        for workers in (1, 2)
    )
    assert json.dumps(one) == json.dumps(two)
