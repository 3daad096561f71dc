"""What is held out is never trained on."""

import numpy as np
import pytest
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin.estimators import pairs
from bodyimage_kin.metrics.held_out import hold_out, image_regions

SPECS = [bk.estimators.LeastSquares(), bk.estimators.PaperMLP(steps=5), bk.estimators.NearestNeighbours()]


def instants(exp, rows):
    """Which samples of an experience have these postures."""
    known = {tuple(q) for q in rows.tolist()}
    return np.array([[tuple(q) in known for q in trial.tolist()] for trial in exp["q"].values])


@pytest.fixture(scope="module")
def exp(circle):
    return bk.experience(circle)


@pytest.mark.parametrize("regions", [2, 3, 5])
def test_a_region_is_hidden_over_all_turns_and_each_sample_once(exp, regions):
    image = exp["hand_image"].values
    hidden = []
    for one in hold_out(exp, regions):
        seen = np.isfinite(one.seen["hand_image"].values).all(-1)
        assert not (instants(exp, one.hidden.q) & seen).any(), "a hidden step is seen"
        np.testing.assert_array_equal(one.seen["hand_image"].values[seen], image[seen])
        hidden.append(np.isfinite(image).all(-1) & ~seen)
        assert hidden[-1].any()
    np.testing.assert_array_equal(np.sum(hidden, axis=0), np.isfinite(image).all(-1))


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: type(spec).__name__)
def test_nothing_that_is_learned_depends_on_what_is_hidden(exp, spec):
    region = image_regions(exp["hand_image"].values[0], 3)
    for index, one in enumerate(hold_out(exp, 3)):
        # What is left of the experience when the region is taken out of it by hand.
        there = xr.DataArray((region != index)[None], dims=("trial", "time"))
        left = exp.assign(hand_image=exp["hand_image"].where(there))
        q = exp["q"].values[0]
        np.testing.assert_array_equal(spec.fit(one.seen).jacobian(q), spec.fit(left).jacobian(q))
        assert not np.array_equal(spec.fit(one.seen).jacobian(q), spec.fit(exp).jacobian(q))


def test_hidden_steps_are_those_of_the_experience(exp):
    everything = {tuple(row) for row in np.hstack([pairs(exp).q, pairs(exp).dr]).tolist()}
    for one in hold_out(exp, 3):
        rows = {tuple(row) for row in np.hstack([one.hidden.q, one.hidden.dr]).tolist()}
        assert rows
        assert rows <= everything
        assert not rows & {tuple(row) for row in np.hstack([pairs(one.seen).q, pairs(one.seen).dr]).tolist()}
