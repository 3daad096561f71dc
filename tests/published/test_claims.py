"""The criteria are what they say, and intervals are honest."""

from __future__ import annotations

import pytest

from bodyimage_kin.published.fuke2007 import CLAIMS

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
