"""How one score drives another: rank correlations over cells, and intervals over recordings."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats
import xarray as xr

from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.study import chain, markdown_table

ESTIMATORS = ["a", "b", "c", "d"]


def results(error, map_error, embodiments=1):
    """Two scores (recording, estimator, seed), as a study gives them."""
    dims = ("embodiment", "recording", "estimator", "seed")
    error, map_error = (np.broadcast_to(one, (embodiments, *np.shape(one))) for one in (error, map_error))
    return xr.Dataset(
        {
            "relative_error_use": ((*dims, "probe"), np.stack([error, np.zeros_like(error)], -1)),
            "map_error": (dims, map_error),
            "failure": (dims, np.full(error.shape, "")),
        },
        {
            "embodiment": [f"body{n}" for n in range(embodiments)],
            "recording": [f"motion{n}" for n in range(error.shape[1])],
            "estimator": ESTIMATORS[: error.shape[2]],
            "seed": np.arange(error.shape[3]),
            "probe": ["on_face", "on_circle"],
        },
    )


def found(error, map_error, **settings):
    return chain(results(error, map_error), "relative_error_use", "map_error", **settings).squeeze()


@pytest.fixture
def error():
    return np.random.default_rng(0).normal(size=(2, 4, 30))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_score_that_rises_or_falls_with_another_has_correlation_one(error, sign):
    one = found(error, sign * np.exp(error))
    for name in ("correlation", "lower", "upper", "within", "within_lower", "within_upper"):
        assert float(one[name]) == pytest.approx(sign), name
    assert (int(one["cells"]), int(one["recordings"])) == (240, 60)


def test_scores_that_have_nothing_to_do_with_each_other_have_none(error):
    one = found(error, np.random.default_rng(1).normal(size=error.shape))
    assert float(one["lower"]) < 0 < float(one["upper"])
    assert float(one["within_lower"]) < 0 < float(one["within_upper"])
    assert abs(float(one["correlation"])) < 0.2


def test_it_is_spearmans_with_ties_over_all_cells_and_within_recordings(error):
    error, other = np.round(error), np.round(error + np.random.default_rng(1).normal(size=error.shape))
    one = found(error, other)
    assert float(one["correlation"]) == pytest.approx(scipy.stats.spearmanr(error.ravel(), other.ravel()).statistic)
    with np.errstate(all="ignore"):
        inside = [
            scipy.stats.spearmanr(error[r, :, s], other[r, :, s]).statistic
            for r in range(2)
            for s in range(30)
            if np.ptp(error[r, :, s]) > 0 and np.ptp(other[r, :, s]) > 0
        ]
    assert float(one["within"]) == pytest.approx(np.mean(inside))


def test_recordings_are_resampled_and_not_cells():
    # The recording decides both scores, so its four cells say no more than one of them does.
    draw = np.random.default_rng(2)
    of_recording = draw.normal(size=(1, 1, 20))
    error = np.broadcast_to(of_recording, (1, 4, 20)) + 1e-3 * draw.normal(size=(1, 4, 20))
    other = np.broadcast_to(of_recording + draw.normal(size=(1, 1, 20)), (1, 4, 20)) + 1e-3 * draw.normal(
        size=(1, 4, 20)
    )
    four, single = found(error, other), found(error[:, :1], other[:, :1])
    width = [float(one["upper"] - one["lower"]) for one in (four, single)]
    assert width[0] == pytest.approx(width[1], rel=0.15)
    assert abs(float(four["within"])) < 0.3 < float(four["correlation"])


def test_an_estimator_far_from_all_others_is_left_out_by_choice(error):
    other = np.random.default_rng(1).normal(size=error.shape)
    error[:, 3], other[:, 3] = -10.0, -10.0
    assert float(found(error, other)["correlation"]) > 0.3
    assert abs(float(found(error, other, leave_out=["d"])["correlation"])) < 0.2
    assert found(error, other, leave_out=["d"]).attrs["left_out"] == '["d"]'


def test_failures_are_left_out_and_what_does_not_vary_has_no_rank(error):
    other = np.exp(error)
    other[:, 2, :7] = np.nan
    one = found(error, other)
    assert (float(one["correlation"]), int(one["cells"])) == (pytest.approx(1.0), 240 - 14)
    flat = found(error, np.zeros_like(error))
    assert np.isnan([float(flat[name]) for name in ("correlation", "lower", "within", "within_upper")]).all()
    few = found(error[..., :2], np.exp(error[..., :2]))
    assert float(few["correlation"]) == pytest.approx(1.0)
    assert np.isnan(float(few["lower"]))


def test_the_interval_covers_as_often_as_it_says():
    draw, covered = np.random.default_rng(3), []
    for _ in range(60):
        error = draw.normal(size=(1, 3, 30))
        one = found(error, draw.normal(size=error.shape), resamples=400)
        covered.append(bool(one["lower"] <= 0 <= one["upper"]))
    assert np.mean(covered) > 0.85


def test_embodiments_stand_alone_and_nonsense_is_refused(error):
    both = results(error, error, embodiments=2)
    both["map_error"] = both["map_error"] * xr.DataArray([1.0, -1.0], dims=["embodiment"])
    one = chain(both, "relative_error_use", "map_error")
    np.testing.assert_allclose(one["correlation"], [1.0, -1.0])
    with pytest.raises(UnknownName, match="did you mean 'on_face'"):
        chain(both, "relative_error_use", "map_error", probe="on_fase")
    with pytest.raises(UnknownName, match="no estimator to leave out 'e'"):
        chain(both, "relative_error_use", "map_error", leave_out=["e"])
    with pytest.raises(InvalidConfig, match="leave at least one in"):
        chain(both, "relative_error_use", "map_error", leave_out=ESTIMATORS)
    with pytest.raises(InvalidConfig, match="level=2"):
        chain(both, "relative_error_use", "map_error", level=2)
    both["map_span"] = both["map_error"].expand_dims({"axis": ["x", "y"]})
    with pytest.raises(InvalidConfig, match="choose along axis"):
        chain(both, "relative_error_use", "map_span")


def test_a_table_is_read_as_a_table_whatever_its_cells_say():
    found = markdown_table(["name", "a"], [["x|y", 1.5], ["two\nlines", ""]]).splitlines()
    assert found == ["| name | a |", "| --- | ---: |", "| x\\|y | 1.5 |", "| two lines |  |"]
