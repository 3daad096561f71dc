"""How one score goes with another, over estimators: near copies once, and no interval of a few families."""

from __future__ import annotations

import json

import numpy as np
import pytest
import scipy.stats
import xarray as xr

from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.study import chain, markdown_table, plain_numbers

COUNT = 24
ESTIMATORS = [f"e{n:02d}" for n in range(COUNT)]


def results(error, map_error, embodiments=1):
    """Two scores (recording, estimator, seed), as a study gives them."""
    dims = ("embodiment", "recording", "estimator", "seed")
    error, map_error = (np.broadcast_to(one, (embodiments, *np.shape(one))) for one in (error, map_error))
    return xr.Dataset(
        {
            "relative_error_use": ((*dims, "probe"), np.stack([error, np.ones_like(error)], -1)),
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
    """Recordings differ little, estimators much."""
    rng = np.random.default_rng(0)
    return np.exp(rng.normal(size=(1, COUNT, 1)) + 0.05 * rng.normal(size=(2, COUNT, 30)))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_score_that_rises_or_falls_with_another_has_correlation_one(error, sign):
    one = found(error, error**sign)
    for name in ("correlation", "lower", "upper", "within", "within_low", "within_high"):
        assert float(one[name]) == pytest.approx(sign), name
    assert (int(one["families"]), int(one["estimators"]), int(one["recordings"])) == (COUNT, COUNT, 60)


def test_it_is_spearmans_of_the_medians_over_recordings_and_of_each_recording(error):
    other = np.exp(np.random.default_rng(1).normal(size=error.shape))
    one = found(error, other)
    medians = [np.median(values.transpose(1, 0, 2).reshape(COUNT, -1), axis=1) for values in (error, other)]
    assert float(one["correlation"]) == pytest.approx(scipy.stats.spearmanr(*medians).statistic)
    inside = [scipy.stats.spearmanr(error[r, :, s], other[r, :, s]).statistic for r in range(2) for s in range(30)]
    assert float(one["within"]) == pytest.approx(np.median(inside))
    assert float(one["within_low"]) == pytest.approx(np.quantile(inside, 0.1))


def test_estimators_are_resampled_and_not_recordings(error):
    # By chance the estimators' two scores go together somewhat; that recordings agree on it makes it no surer.
    draw = np.random.default_rng(2)
    other = np.exp(draw.normal(size=(1, COUNT, 1)) + 0.01 * draw.normal(size=error.shape))
    one = found(error, other)
    assert float(one["within_high"] - one["within_low"]) < 0.1
    assert float(one["upper"] - one["lower"]) > 0.5
    assert float(one["lower"]) < float(one["correlation"]) < float(one["upper"])


def test_the_interval_covers_as_often_as_it_says():
    draw, covered = np.random.default_rng(3), []
    for _ in range(60):
        error, other = (np.exp(draw.normal(size=(1, COUNT, 1)) + np.zeros((1, COUNT, 8))) for _ in range(2))
        one = found(error, other)
        covered.append(bool(one["lower"] <= 0 <= one["upper"]))
    assert np.mean(covered) > 0.85


def test_near_copies_count_once_and_few_families_have_no_interval(error):
    copies = dict.fromkeys(ESTIMATORS[:8], "copies")
    other = np.exp(np.random.default_rng(4).normal(size=(1, COUNT, 1)) + np.zeros(error.shape))
    alike, unlike = error.copy(), other.copy()
    alike[:, :8], unlike[:, :8] = error[:, :1], other[:, :1]
    few = found(alike, unlike, families=copies)
    assert (int(few["families"]), int(few["estimators"])) == (COUNT - 7, COUNT)
    alone = found(alike[:, 7:], unlike[:, 7:])
    assert float(few["correlation"]) == pytest.approx(float(alone["correlation"]))
    assert np.isnan(float(few["lower"]))
    with pytest.raises(UnknownName, match="did you mean 'e01'"):
        found(error, other, families={"e001": "copies"})


def test_an_estimator_far_from_all_others_is_left_out_by_choice(error):
    other = np.exp(np.random.default_rng(1).normal(size=error.shape))
    error[:, 3], other[:, 3] = 1e-9, 1e-9
    both, without = found(error, other), found(error, other, leave_out=["e03"])
    assert float(both["correlation"]) > float(without["correlation"])
    assert without.attrs["left_out"] == '["e03"]'


def test_failures_are_left_out_and_what_does_not_vary_has_no_rank(error):
    other = error.copy()
    other[:, 2, :7] = np.nan
    other[0, :, 9] = np.nan
    one = found(error, other)
    assert (float(one["correlation"]), int(one["recordings"])) == (pytest.approx(1.0), 59)
    flat = found(error, np.zeros_like(error))
    assert np.isnan([float(flat[name]) for name in ("correlation", "lower", "within", "within_high")]).all()


def test_embodiments_stand_alone_and_nonsense_is_refused(error):
    both = results(error, error, embodiments=2)
    both["map_error"] = both["map_error"] * xr.DataArray([1.0, -1.0], dims=["embodiment"])
    one = chain(both, "relative_error_use", "map_error")
    np.testing.assert_allclose(one["correlation"], [1.0, -1.0])
    with pytest.raises(UnknownName, match="did you mean 'on_face'"):
        chain(both, "relative_error_use", "map_error", probe="on_fase")
    with pytest.raises(UnknownName, match="no estimator 'e'"):
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


def test_plain_numbers_have_few_digits_and_none_where_they_are_not_finite():
    found = plain_numbers({"a": [1.23456789, float("nan"), np.float32(2.0)], "b": (np.int64(3), "x", True, None)})
    assert found == {"a": [1.2346, None, 2.0], "b": [3, "x", True, None]}
    assert plain_numbers(1.23456789, 3) == 1.23
    json.dumps(plain_numbers({"inf": np.float64("inf"), "count": np.int64(2)}), allow_nan=False)
