"""Laws of finding misplaced units: nothing where nothing moved, and what moved where something did."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodyimage_kin import metrics
from bodyimage_kin.errors import InvalidArray, InvalidConfig

TRIANGLE = np.array([(column + row / 2, row * 0.866) for row in range(4) for column in range(4 - row)]) * 0.0065
TRIANGLE = TRIANGLE - TRIANGLE.mean(0)
MIDDLES = np.stack(np.meshgrid(np.arange(6), np.arange(4)), axis=-1).reshape(-1, 2) * 0.03
UNITS = np.repeat(np.arange(24), 10)
PUBLISHED = (MIDDLES[:, None] + TRIANGLE).reshape(-1, 2)


def turned(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def felt(seed, true=PUBLISHED, warp=0.002, wild=0.02, touches=500):
    """Touches of a skin through a map that is moved, turned, shrunk and warped: places felt, taxels."""
    rng = np.random.default_rng(seed)
    taxel = rng.integers(len(true), size=touches)
    at = true[taxel] + 0.0025 * rng.normal(size=(touches, 2))
    wave = rng.normal(size=(2, 2)) @ (at.T / 0.15 * 2) + rng.uniform(0, 6, size=(2, 1))
    at = at + warp * np.sin(wave).T
    lost = rng.random(touches) < wild
    at[lost] = true[rng.integers(len(true), size=lost.sum())]
    return rng.uniform(0.3, 3) * at @ turned(rng.uniform(-3, 3)).T + rng.normal(size=2), taxel


def found(seed, true=PUBLISHED, **settings):
    map, taxel = felt(seed, true, **settings)
    return metrics.misplaced_units(map, PUBLISHED[taxel], UNITS[taxel], resamples=200, seed=seed)


def altered(kind):
    true = PUBLISHED.copy()
    if kind == "swapped":
        true[UNITS == 3], true[UNITS == 20] = PUBLISHED[UNITS == 20], PUBLISHED[UNITS == 3]
    elif kind == "turned":
        true[UNITS == 8] = MIDDLES[8] + TRIANGLE @ turned(2 * np.pi / 3).T
    else:
        true[UNITS == 8] += (0.008, -0.006)
    return true


MISPLACED = {"swapped": [3, 20], "turned": [8], "moved": [8]}
DRAWS = [20, pytest.param(200, marks=pytest.mark.slow)]


@pytest.mark.parametrize("draws", DRAWS)
@pytest.mark.parametrize("warp", [0.0, 0.003])
def test_where_nothing_moved_nothing_is_found(draws, warp):
    false = sum(len(found(seed, warp=warp).misplaced) > 0 for seed in range(draws))
    # The 99 % quantile of as many draws at the level of 5 %.
    assert false <= {20: 4, 200: 18}[draws]


@pytest.mark.parametrize("draws", DRAWS)
@pytest.mark.parametrize("kind", MISPLACED)
def test_what_is_misplaced_is_found_and_nothing_else(draws, kind):
    true, wanted = altered(kind), MISPLACED[kind]
    every = [found(1000 + seed, true) for seed in range(draws)]
    assert np.mean([set(wanted) <= set(one.misplaced) for one in every]) >= 0.95
    assert np.mean([set(one.misplaced) <= set(wanted) for one in every]) >= 0.9
    if kind == "swapped":
        assert np.mean([one.places == {3: 20, 20: 3} for one in every]) >= 0.95
    else:
        # Off, but in nobody else's place.
        assert all(one.places == {} for one in every)
        assert np.mean([one.turned[8] == (kind == "turned") for one in every]) >= 0.95


def test_frames_and_units_of_the_map_do_not_matter():
    map, taxel = felt(0, altered("moved"))
    one = metrics.misplaced_units(map, PUBLISHED[taxel], UNITS[taxel])
    other = metrics.misplaced_units(1e3 * map @ turned(1.0).T - 7.0, PUBLISHED[taxel], UNITS[taxel])
    assert other.scale == pytest.approx(1e3 * one.scale)
    for name in ("displacement", "spread", "turn", "p_moved", "p_turned"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-6, atol=1e-9)


def test_displacement_and_turn_are_those_that_were_made():
    # Every taxel touched as often, without noise.
    taxel = np.repeat(np.arange(len(PUBLISHED)), 2)
    true = altered("turned")
    true[UNITS == 3] += (0.004, -0.003)
    one = metrics.misplaced_units(true[taxel], PUBLISHED[taxel], UNITS[taxel])
    expected = np.zeros((24, 2))
    expected[3] = 0.004, -0.003
    np.testing.assert_allclose(one.displacement, expected, atol=1e-4)
    assert one.turn[8] == pytest.approx(2 * np.pi / 3, abs=1e-6)
    assert one.misplaced.tolist() == [3, 8]
    assert one.touches.tolist() == [20] * 24


def test_in_space_too():
    rng = np.random.default_rng(4)
    bent = np.column_stack([PUBLISHED, 4 * (PUBLISHED[:, 0] - 0.07) ** 2])
    true = bent.copy()
    true[UNITS == 5], true[UNITS == 18] = bent[UNITS == 18], bent[UNITS == 5]
    middle = bent[UNITS == 10].mean(0)
    true[UNITS == 10] = (bent[UNITS == 10] - middle) @ Rotation.from_euler("z", 2.0).as_matrix().T + middle
    taxel = rng.integers(len(bent), size=600)
    turn = Rotation.random(random_state=1).as_matrix()
    map = (true[taxel] + 0.0025 * rng.normal(size=(600, 3))) @ turn.T
    one = metrics.misplaced_units(map, bent[taxel], UNITS[taxel])
    assert one.misplaced.tolist() == [5, 10, 18]
    assert one.places == {5: 18, 18: 5}
    assert one.turn[10] == pytest.approx(2.0, abs=0.3)
    assert (one.moved[10], one.turned[10]) == (False, True)


def test_of_a_unit_with_few_touches_nothing_is_said():
    map, taxel = felt(2)
    rows = np.flatnonzero(UNITS[taxel] != 4).tolist() + np.flatnonzero(UNITS[taxel] == 4)[:7].tolist()
    unit = np.where(UNITS[taxel] == 5, -1, UNITS[taxel])
    map[UNITS[taxel] == 6] = np.nan
    one = metrics.misplaced_units(map[rows], PUBLISHED[taxel][rows], unit[rows])
    assert not set(one.units) & {-1, 5, 6}
    few = one.units == 4
    assert one.touches[few] == 7
    assert np.isnan(one.p_moved[few] + one.displacement[few, 0] + one.turn[few])
    assert np.isfinite(one.p_moved[~few]).all()
    none = metrics.misplaced_units(map[:7], PUBLISHED[taxel][:7], UNITS[taxel][:7])
    assert np.isnan(none.p_moved).all()
    assert len(none.misplaced) == 0


def test_what_does_not_fit_together_is_refused():
    map, taxel = felt(0)
    places, units = PUBLISHED[taxel], UNITS[taxel]
    with pytest.raises(InvalidArray, match="they must be the same"):
        metrics.misplaced_units(map[:-1], places, units)
    with pytest.raises(InvalidArray, match="a whole number a touch"):
        metrics.misplaced_units(map, places, units * 1.0)
    with pytest.raises(InvalidArray, match="in different places"):
        metrics.misplaced_units(map, places, np.full(len(units), -1))
    with pytest.raises(InvalidArray, match="no similarity carries it"):
        metrics.misplaced_units(np.zeros_like(map), places, units)
    with pytest.raises(InvalidConfig, match="level"):
        metrics.misplaced_units(map, places, units, level=1.0)
    with pytest.raises(InvalidConfig, match="resamples"):
        metrics.misplaced_units(map, places, units, resamples=10)
