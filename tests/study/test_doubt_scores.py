"""Doubt in a study: what the public functions say of it, nothing of who has none, and all of it on the page."""

from __future__ import annotations

import json

import numpy as np
import pytest

import bodyimage_kin as bk
from bodyimage_kin import metrics, report
from bodyimage_kin.recordings.motions import Circle, FaceTour, RandomTouch
from bodyimage_kin.study import Simulation, Study
from bodyimage_kin.study.doubt import DOUBT

ON_MAP = [one.name for one in DOUBT if one.name.startswith("map_")]
AT_PROBES = [one.name for one in DOUBT if one.name not in ON_MAP]


@pytest.fixture(scope="module")
def learned(circle):
    return bk.estimators.TrigRidge(degree=2).fit(bk.experience(circle))


@pytest.fixture(scope="module")
def scored(learned, body, circle):
    return bk.score(learned, body, circle, probes=["on_face"], scores=["relative_error_use", *AT_PROBES])


def test_what_is_foretold_is_the_displacement_along_each_direction_of_the_motion(scored, learned, body, circle):
    q = bk.probes.Face().postures(body, circle)
    values, vectors = np.linalg.eigh(metrics.motion_metric(circle))
    along = (vectors * np.sqrt(values)).T
    J, Jh = body.hand_image_jacobian(q).numpy(), learned.jacobian(q).numpy()
    true, mean = (np.stack([one @ dq for dq in along], axis=1) for one in (J, Jh))
    # One at a time, by the learner's own covariance of a displacement.
    S = np.stack([learned.displacement_covariance(q, np.broadcast_to(dq, q.shape)).numpy() for dq in along], axis=1)
    of = metrics.uncertainty_scores(true, mean, S)
    here = scored.sel(probe="on_face")
    for name in ("negative_log_likelihood", "crps", "coverage_50", "coverage_90", "coverage_95", "sparsification_gain"):
        assert float(here[name]) == pytest.approx(of[name], rel=1e-6), name
    size = np.sqrt((true**2).sum(-1).mean())
    assert float(here["relative_error_use"]) == pytest.approx(of["error"] / size)
    assert float(here["relative_error_foretold"]) == pytest.approx(of["sharpness"] / size)


def test_the_interval_of_a_coverage_holds_it(scored):
    here = scored.sel(probe="on_face")
    for level in ("50", "90", "95"):
        lower, upper = here["coverage_interval"].sel(level=level).values
        assert lower <= float(here[f"coverage_{level}"]) <= upper


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A study of who doubts and who does not; few functions are drawn, for the sake of time."""
    study = Study(
        embodiments={"infant": "infant"},
        recordings={
            "still": Simulation(Circle(turns=0.5), RandomTouch(duration=10.0), FaceTour(speed=0.2), dynamics=False)
        },
        estimators={"sure": "LeastSquares", "doubting": {"Ridge": {}}, "truth": "Analytic"},
        seeds=1,
        probes=["on_face"],
        scores=["relative_error_use", *AT_PROBES, *ON_MAP],
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bodyimage_kin.study.doubt._DRAWS", 12)
        return study.run(tmp_path_factory.mktemp("doubt") / "run", "in-process")


def test_who_has_no_doubt_has_no_scores_of_it(done):
    assert not (done["failure"] != "").any()
    for name in (*AT_PROBES, *ON_MAP):
        assert not done[name].sel(estimator=["sure", "truth"]).notnull().any(), name
        assert done[name].sel(estimator="doubting").notnull().all(), name
    assert "what is learned gives no covariance" in json.loads(done.attrs["left_out"])["crps"]


def test_a_map_is_held_against_that_of_the_true_jacobian(done):
    """A constant Jacobian is wrong on the map by far more than it foretells, and no taxel is where it thinks."""
    here = done.sel(estimator="doubting").squeeze()
    assert float(here["map_error_made"]) > 3 * float(here["map_error_foretold"]) > 0
    assert float(here["map_coverage_90"]) < 0.5
    assert done["map_error_made"].attrs["units"] == "m"


def test_a_page_shows_them(done, tmp_path):
    text = report.write(done, tmp_path / "page.html").read_text()
    for name in ("relative_error_foretold", "coverage_90", "map_coverage_90", "map_crps"):
        assert done[name].attrs["long_name"] in text, name
