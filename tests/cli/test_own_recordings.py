"""Commands about one's own robot and recording: a table goes in, a page in plain words comes out."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin import cli


@pytest.fixture(scope="module")
def table(body, tmp_path_factory):
    """A laboratory's file: degrees, millimetres, one row a sample."""
    rec = bk.simulate(body, bk.motions.Circle(turns=1.0), seed=1, noise=bk.Noise(image=2e-4))
    q, image = np.degrees(rec.q.values[0]), 1e3 * rec.hand_image.values[0]
    columns = {f"q.{name}": q[:, index] for index, name in enumerate(body.joints)}
    columns |= {"hand_image.x": image[:, 0], "hand_image.y": image[:, 1], "time": rec.time.values}
    path = tmp_path_factory.mktemp("table") / "recording.csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    return str(path)


UNITS = ["--units", "q=deg", "hand_image=mm"]


def test_score_ranks_what_learns_from_a_table(table, tmp_path, capsys):
    page = tmp_path / "scores.html"
    arguments = ["score", table, *UNITS, "--estimators", "LeastSquares", "TrigRidge", "--out", str(page)]
    assert cli.main(arguments) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("trig_ridge: ")
    assert said[1].startswith("least_squares: ")
    assert "hidden from it" in page.read_text()


def test_score_with_a_robot_says_how_wrong_in_all_directions(table, tmp_path, capsys):
    page = tmp_path / "scores.html"
    arguments = ["score", table, *UNITS, "--robot", "infant", "--estimators", "LeastSquares", "--out", str(page)]
    assert cli.main([*arguments, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert list(told["estimators"]) == ["nominal", "least_squares"]
    one = told["estimators"]["least_squares"]
    assert 0.0 < one["interval"][0] <= one["relative_error"] <= one["interval"][1]
    assert one["failure"] == ""
    assert told["page"] == str(page)
    text = page.read_text()
    assert "Against the calibrated body" in text
    assert "nominal" in text
    assert "without that share" in text


def test_calibrate_writes_a_robot_that_others_read(body, table, tmp_path, capsys):
    out = tmp_path / "found"
    assert cli.main(["calibrate", table, "--robot", "infant", *UNITS, "--free", "axes", "--out", str(out)]) == 0
    assert "measures from" in capsys.readouterr().out
    found = bk.load_embodiment(out / "body.toml")
    assert found.joints == body.joints
    assert found.robot.source == (out / "robot.urdf").read_bytes()
    assert (out / "robot.urdf").read_text().count("<geometry>") == body.robot.source.decode().count("<geometry>")
    again = bk.calibrate(body, bk.read_recording(table, units={"q": "deg", "hand_image": "mm"}), free=["axes"])
    q = body.touch_postures([0, 440])
    torch.testing.assert_close(found.hand_image_jacobian(q), again.body.hand_image_jacobian(q), rtol=1e-12, atol=1e-14)
    measures = pd.read_csv(out / "measures.csv")
    assert set(measures.group[measures.fitted]) == {"axes"}
    assert (measures.change[~measures.fitted] == 0).all()
    assert "foretells where the hand is seen" in (out / "report.html").read_text()
    # Again into the same folder, never into anybody else's.
    capsys.readouterr()
    again_there = ["calibrate", table, "--robot", "infant", *UNITS, "--free", "axes", "--out", str(out), "--json"]
    assert cli.main(again_there) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["explains"] is True
    assert told["held_out"]["images"]["found"] < 1e-3
    (tmp_path / "other.txt").write_text("mine")
    assert cli.main(["calibrate", table, "--robot", "infant", *UNITS, "--out", str(tmp_path)]) == 2


def test_a_fit_that_explains_nothing_has_exit_status_one(table, tmp_path, capsys):
    wrong = pd.read_csv(table)
    wrong["hand_image.x"] = np.roll(wrong["hand_image.x"], 30)
    wrong.to_csv(tmp_path / "wrong.csv", index=False)
    arguments = ["calibrate", str(tmp_path / "wrong.csv"), "--robot", "infant", *UNITS, "--out", str(tmp_path / "out")]
    assert cli.main(arguments) == 1
    assert "explains nothing" in capsys.readouterr().out


def test_next_chooses_before_and_after_anything_was_seen(body, table, tmp_path, capsys):
    asked = ["next", "--robot", "infant", "--count", "2"]
    assert cli.main([*asked, "--out", str(tmp_path / "first")]) == 0
    capsys.readouterr()
    assert cli.main([*asked, "--seen", table, *UNITS, "--out", str(tmp_path / "then"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["joints"] == list(body.joints)
    assert np.shape(told["q"]) == (2, body.p)
    assert len(told["expected_error"]) == 3
    first, then = (pd.read_csv(tmp_path / name / "postures.csv") for name in ("first", "then"))
    assert [f"q.{name}" for name in body.joints] == list(first.columns[1:-1])
    assert (np.diff(first.expected_error) < 0).all()
    assert then.expected_error.iloc[0] < first.expected_error.iloc[0]
    assert body.visible(first.iloc[:, 1:-1].to_numpy()).all()
    assert "should fall from" in (tmp_path / "first" / "report.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["score", "missing.csv"], "missing.csv"),
        (["score", "TABLE", "--units", "q"], "NAME=VALUE"),
        (["score", "TABLE", *UNITS, "--estimators", "Analytic"], "--robot"),
        (["score", "TABLE", *UNITS, "--estimators", "LeastSqares"], "did you mean 'LeastSquares'"),
        (["score", "TABLE", "--units", "q=gon"], "gon"),
        (["calibrate", "TABLE", "--robot", "infant", *UNITS, "--free", "arms", "--out", "out"], "free='arms'"),
        (["calibrate", "--robot", "infant", "--out", "out"], "at least one recording"),
        (["next", "--robot", "infant", "--count", "0"], "count=0"),
        (["next", "--robot", "nobody"], "nobody"),
    ],
)
@pytest.mark.usefixtures("unchecked")
def test_a_wrong_argument_is_one_line_and_writes_nothing(table, arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main([table if one == "TABLE" else one for one in arguments]) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith("bodyimage-kin: ")
    assert message in error
    assert list(tmp_path.iterdir()) == []
