"""The criteria are what they say, and intervals are honest."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from bodyimage_kin.published.fuke2007 import CLAIMS, Conditions
from bodyimage_kin.published.fuke2007.claims import judged
from bodyimage_kin.published.fuke2007.grid import NETWORK

RANGES = {
    "velocity_follows_noise_free": ((0.91, 0.99), (0.89, 0.99)),
    "velocity_has_the_right_size": ((0.1, 0.19), (0.1, 0.21)),
    "noise_needs_more_steps": ((-0.3, -0.1), (-0.3, -0.01)),
    "no_gain_without_noise": ((-0.04, 0.1), (-0.06, 0.1)),
    "errors_at_rarely_touched_edges": ((-0.6, -0.31), (-0.6, -0.2)),
    "map_has_the_right_size": ((0.91, 1.09), (0.91, 1.2)),
    "network_beats_least_squares": ((-0.2, -0.01), (-0.2, 0.01)),
}


@pytest.mark.parametrize(("name", "ends"), RANGES.items())
def test_a_criterion_looks_at_the_interval(name, ends):
    claim = next(claim for claim in CLAIMS if claim.name == name)
    assert claim.holds(*ends[0])
    assert not claim.holds(*ends[1])


def test_names_are_unique_and_askers_known():
    assert len({claim.name for claim in CLAIMS}) == len(CLAIMS)
    assert {claim.asked_by for claim in CLAIMS} == {"paper", "us"}


class Told(Conditions):
    """Results in which all scores of an estimator are about one number."""

    def __init__(self, **told):
        super().__init__(xr.Dataset({"steps": ("snapshot", [0, 1])}, {"seed": range(10)}))
        object.__setattr__(self, "told", told)

    def score(self, condition, estimator, name, **at):
        more = {"velocity_correlation": (2,), "topological_errors": (10, 2), "spans": (2, 2)}.get(name, ())
        by_recording = 1 + 1e-6 * np.arange(10).reshape(10, *[1] * len(more))
        return np.broadcast_to(self.told.get(estimator, 0.5) * by_recording, (10, *more))

    def fact(self, recording, name, **at):
        return np.full(10, 0.1)


def judged_as(found, name):
    return next(one for one in judged(found) if one["name"] == name)


def test_a_claim_that_a_spoiled_truth_meets_too_cannot_fail_and_never_holds():
    met = judged_as(Told(paper_mlp=0.97), "velocity_follows_noisy")
    assert (met["met"], met["passed_by"], met["cannot_fail"], met["holds"]) == (True, [], False, True)
    idle = judged_as(Told(paper_mlp=0.97, null_rotated=0.97), "velocity_follows_noisy")
    assert (idle["met"], idle["passed_by"], idle["cannot_fail"], idle["holds"]) == (True, ["null_rotated"], True, False)


def test_a_claim_about_recordings_alone_is_put_to_no_null():
    one = judged_as(Told(paper_mlp=0.97, null_rotated=0.97), "posture_has_little_effect")
    assert (one["met"], one["passed_by"], one["holds"]) == (True, [], True)


ERRORS = {"noisy_500": 0.2, "noisy_200": 0.4, "noise_free_500": 0.1, "noise_free_200": 0.05}


class Known(Conditions):
    """Results in which each score of each condition is a number of its own."""

    def __init__(self):
        super().__init__(xr.Dataset({"steps": ("snapshot", [0, 1])}, {"seed": range(10)}))

    def score(self, condition, estimator, name, **at):
        ours = estimator == NETWORK
        told = {
            "velocity_correlation": [0.95, 0.7] if condition == "noisy_500" else [0.6, 0.99],
            "displacement_error": ERRORS[condition] * (1.0 if ours else 4.0),
            # Of each first map, before and after; the last one was never learned.
            "topological_errors": [[200.0, 10.0], [100.0, 30.0], [np.nan, np.nan]],
            "spans": [[9.0, 9.0], [0.9, 0.6] if ours else [1.0, 0.5]],
            "disparity": 0.3 if ours else 0.1,
        }
        value = np.asarray(told.get(name, 0.5))
        return np.broadcast_to(value, (10, *value.shape))


@pytest.mark.parametrize(
    ("name", "value"),
    {
        "velocity_follows_noise_free": 0.6,
        "velocity_follows_noisy": 0.7,
        "velocity_has_the_right_size": 0.2,
        "noise_needs_more_steps": np.log(0.2 / 0.4),
        "no_gain_without_noise": np.log(0.1 / 0.05),
        "topological_error_falls": 0.05,
        "from_any_first_map": 0.3,
        "map_has_the_right_size": 1.05,
        "map_has_the_right_shape": 0.2,
        "network_beats_least_squares": np.log(0.2 / 0.8),
    }.items(),
)
def test_a_claim_is_measured_by_what_it_says(name, value):
    claim = next(claim for claim in CLAIMS if claim.name == name)
    np.testing.assert_allclose(claim.values(Known(), NETWORK), value, rtol=1e-12)
