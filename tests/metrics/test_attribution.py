"""Laws of excitation and of the attribution of an error to its causes."""

import numpy as np
import pytest

from bodyimage_kin import metrics
from bodyimage_kin.errors import InvalidArray, InvalidConfig

RNG = np.random.default_rng(0)
TRUE, ESTIMATED = RNG.normal(size=(2, 40, 2, 5))
METRIC = np.cov(RNG.normal(size=(5, 50)))
PROJECTOR = np.diag([1.0, 1.0, 1.0, 0.0, 0.0])
PARTS = ("depth", "mean_excited", "mean_unexcited", "variation")


def parts(found):
    return np.array([getattr(found, part) for part in PARTS])


def rotated_projector():
    Q, _ = np.linalg.qr(RNG.normal(size=(5, 5)))
    return Q[:, :2] @ Q[:, :2].T


@pytest.mark.parametrize("metric", [None, METRIC])
@pytest.mark.parametrize("projector", [np.zeros((5, 5)), PROJECTOR, rotated_projector(), np.eye(5)])
@pytest.mark.parametrize("estimated", [ESTIMATED, -TRUE, TRUE, 1e-6 * ESTIMATED + TRUE, 0 * TRUE])
def test_the_parts_are_nonnegative_and_sum_to_the_squared_error(metric, projector, estimated):
    found = metrics.attribute(TRUE, estimated, metric, projector)
    squared = metrics.pooled_relative_error(TRUE, estimated, metric) ** 2
    assert (parts(found) >= 0).all()
    assert found.total == pytest.approx(squared, rel=1e-10, abs=1e-28)
    assert found.total == parts(found).sum()


def test_by_hand():
    # Whitened by W = diag(1, 4): J = (1, 0), (1, 0) and Jh = (1, 2), (3, 0), so <Jh, J> = 4, |Jh|^2 = 14, |J|^2 = 2.
    J, Jh = [[[1.0, 0.0]], [[1.0, 0.0]]], [[[1.0, 1.0]], [[3.0, 0.0]]]
    found = metrics.attribute(J, Jh, np.diag([1.0, 4.0]), np.diag([1.0, 0.0]))
    assert found.scale == pytest.approx(2 / 7)
    assert found.depth == pytest.approx((5 / 7) ** 2 * 14 / 2)
    # s Jh - J = (-5, 4)/7 and (-1, 0)/7: mean (-3, 2)/7, deviations (-2, 2)/7 and (2, -2)/7.
    assert found.mean_excited == pytest.approx(9 / 49)
    assert found.mean_unexcited == pytest.approx(4 / 49)
    assert found.variation == pytest.approx(8 / 49)


def test_a_scale_is_depth_and_nothing_else():
    found = metrics.attribute(TRUE, 2 * TRUE, METRIC, PROJECTOR)
    np.testing.assert_allclose(parts(found), [1, 0, 0, 0], atol=1e-25)
    assert found.scale == 0.5


@pytest.mark.parametrize("part", ["mean_excited", "mean_unexcited", "variation"])
def test_each_part_is_moved_by_an_intervention_of_its_own(part):
    values, vectors = np.linalg.eigh(METRIC)
    inverse_root = vectors / np.sqrt(values) @ vectors.T
    projector = rotated_projector()
    # In the whitened space the truth varies about zero, so that no constant change is a scale of it.
    J = TRUE - TRUE.mean(0)
    constant = np.broadcast_to(RNG.normal(size=(2, 5)), J.shape)
    change = {
        "mean_excited": constant @ projector,
        "mean_unexcited": constant @ (np.eye(5) - projector),
        "variation": J[::-1] - (J[::-1] * J).sum() / (J * J).sum() * J,
    }[part]
    found = metrics.attribute(J @ inverse_root, (J + 0.01 * change) @ inverse_root, METRIC, projector)
    moved = dict(zip(PARTS, parts(found), strict=True))
    expected = 1e-4 * (change**2).sum() / (J**2).sum()
    assert moved.pop(part) == pytest.approx(expected, rel=0.01)
    assert max(moved.values()) < 0.01 * expected


def test_a_zero_estimate_has_no_scale_and_no_depth():
    found = metrics.attribute(TRUE, 0 * TRUE, METRIC, PROJECTOR)
    assert (found.scale, found.depth) == (0, 0)
    assert found.total == pytest.approx(1, abs=1e-12)


def test_undefined_is_nan_and_missing_postures_are_left_out():
    assert np.isnan(parts(metrics.attribute(0 * TRUE, TRUE, None, PROJECTOR))).all()
    assert np.isnan(parts(metrics.attribute(TRUE[:0], TRUE[:0], None, PROJECTOR))).all()
    true, estimated = TRUE.copy(), ESTIMATED.copy()
    true[0, 0, 0], estimated[1, 1, 1] = np.nan, np.inf
    found = metrics.attribute(true.reshape(4, 10, 2, 5), estimated.reshape(4, 10, 2, 5), METRIC, PROJECTOR)
    assert found == metrics.attribute(TRUE[2:], ESTIMATED[2:], METRIC, PROJECTOR)


def test_excitation_by_hand():
    train, use = np.diag([2.0, 0.0, 1.0]), np.eye(3)
    found = metrics.excitation(train, use)
    np.testing.assert_allclose(found.eigenvalues, [4, 1, 0], rtol=1e-5, atol=1e-12)
    np.testing.assert_allclose(found.projector(), np.diag([1, 0, 1]), atol=1e-12)
    np.testing.assert_allclose(found.projector(2.0), np.diag([1, 0, 0]), atol=1e-12)


def test_excitation_is_per_sample():
    train, use = RNG.normal(size=(30, 4)), RNG.normal(size=(300, 4))
    once, often = metrics.excitation(train, use), metrics.excitation(np.tile(train, (20, 1)), use)
    np.testing.assert_allclose(once.eigenvalues, often.eigenvalues)


def test_excitation_solves_its_eigenproblem_and_projects_in_the_whitened_space():
    train, use = RNG.normal(size=(30, 4)) * [1, 1, 0.01, 0.01], RNG.normal(size=(300, 4)) @ RNG.normal(size=(4, 4))
    train[3, 1] = np.nan
    found = metrics.excitation(train, use, cut=0.01)
    seen = np.delete(train, 3, axis=0)
    left = seen.T @ seen / 29 @ found.eigenvectors
    np.testing.assert_allclose(left, found.metric @ found.eigenvectors * found.eigenvalues, atol=1e-10)
    np.testing.assert_allclose(found.eigenvectors.T @ found.metric @ found.eigenvectors, np.eye(4), atol=1e-10)
    assert (np.diff(found.eigenvalues) <= 0).all()
    P = found.projector()
    np.testing.assert_allclose(P @ P, P, atol=1e-11)
    assert round(np.trace(P)) == (found.eigenvalues >= 0.01).sum() == 2


def test_bad_inputs_are_named():
    with pytest.raises(InvalidConfig, match="cut is -1"):
        metrics.excitation(np.eye(3), np.eye(3), cut=-1.0)
    with pytest.raises(InvalidArray, match="train_dq has 2 joints but use_dq 3"):
        metrics.excitation(np.eye(2), np.eye(3))
    for projector in (2 * np.eye(5), np.eye(4), np.full((5, 5), np.nan)):
        with pytest.raises(InvalidArray, match="projector"):
            metrics.attribute(TRUE, ESTIMATED, None, projector)
