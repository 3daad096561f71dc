"""Doubt in a study: what the public functions say of it, nothing of who has none, and all of it on the page."""

from __future__ import annotations

import html
import json

import numpy as np
import pytest

import bodyimage_kin as bk
from bodyimage_kin import metrics, report
from bodyimage_kin.recordings.motions import Circle, FaceTour, RandomTouch
from bodyimage_kin.study import Simulation, Study, recording_of
from bodyimage_kin.study.doubt import DOUBT
from bodyimage_kin.study.random_streams import stream

ON_MAP = [one.name for one in DOUBT if one.name.startswith("map_")]
DRAWS = 12
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
def run(tmp_path_factory):
    """A study of who doubts and who does not, and its store; few functions are drawn, for the sake of time."""
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
    store = tmp_path_factory.mktemp("doubt") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bodyimage_kin.study.doubt._DRAWS", DRAWS)
        return study.run(store, "in-process"), store


@pytest.fixture(scope="module")
def done(run):
    return run[0]


def test_who_has_no_doubt_has_no_scores_of_it(done):
    assert not (done["failure"] != "").any()
    for name in (*AT_PROBES, *ON_MAP):
        assert not done[name].sel(estimator=["sure", "truth"]).notnull().any(), name
        assert done[name].sel(estimator="doubting").notnull().all(), name
    assert "what is learned gives no covariance" in json.loads(done.attrs["left_out"])["crps"]


def test_doubt_about_the_map_is_that_of_the_public_functions(run, body):
    """Functions are drawn, integrated and mapped, and held against the true Jacobian's map, integrated alike."""
    done, store = run
    training, touch = (bk.experience(recording_of(store, "still", 0, role)) for role in ("training", "use"))
    som_seed, first = stream(0, "infant/still/0/first maps", 2)
    q, seen = touch["q"].values[0][touch["touched"].values[0, :, 0] >= 0], training["hand_image"].values.reshape(-1, 2)
    settings = {
        "posture_som": bk.body_image.PostureSOM.fit(q, (8, 8), som_seed),
        "image_range": np.stack([seen.min(0), seen.max(0)], axis=1),
        "seed": first,
    }
    (fit_seed,) = stream(0, "infant/still/0/doubting", 1)
    drawn = bk.estimators.Ridge().fit(training, fit_seed).draws(DRAWS, fit_seed)
    maps = bk.BodyImageDraws.learn(touch, bk.integrate_draws(touch, drawn), **settings)
    truth = bk.integrate(touch, bk.estimators.Analytic(body).fit(training))
    true = bk.BodyImage.learn(touch, truth, **settings).tactile_map
    of = metrics.uncertainty_scores(true.reshape(-1, 2), maps.mean.reshape(-1, 2), maps.covariance.reshape(-1, 2, 2))
    found = done.sel(estimator="doubting").squeeze()
    for name, wanted in {"error_made": "error", "error_foretold": "sharpness", "crps": "crps"}.items():
        assert float(found[f"map_{name}"]) == pytest.approx(of[wanted], rel=1e-9), name
    for level in (50, 90, 95):
        assert float(found[f"map_coverage_{level}"]) == of[f"coverage_{level}"]
    assert found["map_error_made"].attrs["units"] == "m"
    # A constant Jacobian is wrong by far more than it foretells.
    assert of["error"] > 3 * of["sharpness"] > 0


def test_a_page_shows_them(done, tmp_path):
    text = html.unescape(report.write(done, tmp_path / "page.html").read_text())
    for name in ("relative_error_foretold", "coverage_90", "map_coverage_90", "map_crps"):
        assert done[name].attrs["long_name"] in text, name
