"""Pages that answer one question say it in a sentence, a picture and a table, and say what is not known."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin import report
from bodyimage_kin.errors import InvalidConfig

HOSTILE = "<script>alert(1)</script>"


def rows_of(names, errors, floor=float("nan"), failure=None, share=0.5):
    """Scores of estimators, made up."""
    errors = np.asarray(errors, dtype=float)
    numbers = {
        "pair_error": 1e-3 * errors, "pair_error_relative": errors, "pair_error_relative_lower": 0.9 * errors,
        "pair_error_relative_upper": 1.1 * errors, "pair_error_relative_corrected": 0.5 * errors,
        "image_error": np.full(len(names), np.nan),
    }  # fmt: skip
    found = xr.Dataset(
        {name: ("estimator", one) for name, one in numbers.items()}
        | {"by_fold": (("estimator", "fold"), np.outer(errors, [1.0, 2.0]))}
        | {"failure": ("estimator", np.array(failure or [""] * len(names), dtype=object))}
        | {"noise_floor": floor, "moved_share": share, "local_spectrum": ("direction", [1.0, 0.3, 0.01])},
        {"estimator": list(names), "fold": [0, 1]},
        {"postures": 10, "pairs": 20, "stretches": 20},
    )
    found["pair_error"].attrs["units"] = "m"
    return found


def test_the_best_is_named_first_and_what_is_not_known_is_said(tmp_path):
    rows = rows_of(["least_squares", "rational_trig"], [0.4, 0.2])
    text = report.write_scores(rows, tmp_path / "new" / "page.html").read_text()
    assert "the best of 2 maps, rational trigonometric," in text
    assert "20 % of the motion" in text
    assert "(0.2 mm)" in text
    assert "50 % of their directions only" in text
    assert "is not known" in text
    assert text.index("rational trigonometric</td>") < text.index("least squares</td>")
    for tag in ("<script", "http://", "https://"):
        assert tag not in text.replace("http://www.w3.org", "")


def test_known_noise_is_taken_off_in_words(tmp_path):
    rows = rows_of(["least_squares"], [0.4], floor=1e-4, share=1.0)
    text = report.write_scores(rows, tmp_path / "page.html").read_text()
    assert "without that share the error is 20 %" in text
    assert "of their directions only" not in text


def test_failures_and_warnings_are_texts(tmp_path):
    rows = rows_of(["least_squares", "broyden"], [0.4, np.nan], failure=["", HOSTILE])
    text = report.write_scores(rows, tmp_path / "page.html", said=[HOSTILE]).read_text()
    assert HOSTILE not in text
    assert text.count("&lt;script&gt;") == 2
    assert "What could not learn" in text


def test_nobody_learned_anything(tmp_path):
    rows = rows_of(["broyden"], [np.nan], failure=["needs a stream"])
    assert "No learner could learn" in report.write_scores(rows, tmp_path / "page.html").read_text()


def test_other_results_are_refused(tmp_path):
    with pytest.raises(InvalidConfig, match="no scores of estimators"):
        report.write_scores(xr.Dataset(), tmp_path / "page.html")


def test_a_calibration_says_what_changed_and_what_nobody_knows(body, tmp_path):
    exp = bk.experience(bk.simulate(body, bk.motions.Circle(turns=1.0), seed=1, noise=bk.Noise(image=2e-4)))
    found = bk.calibrate(body, exp, free=["axes", "offsets"], folds=2)
    text = report.write_calibration(found, tmp_path / "page.html", said=[HOSTILE]).read_text()
    assert "foretells where the hand is seen to within" in text
    assert f"Of {found.free} measures, {len(found.unobservable)} combinations" in text
    assert found.unobservable[0] in text
    assert all(joint in text for joint in body.joints)
    assert HOSTILE not in text


def test_postures_are_in_degrees_with_what_is_expected_after_each(body, tmp_path):
    chosen = bk.next_postures(body, None, bk.probes.Face(), 2, candidates=body.felt_robot.sample(300, seed=1))
    text = report.write_next_postures(chosen, body, ["on_face"], tmp_path / "page.html").read_text()
    assert "these 2 postures" in text
    assert f"{np.degrees(chosen.q[0, 0]):.1f}".replace("-", "\N{MINUS SIGN}") in text
    assert text.count("<tr>") == 1 + 1 + 2
