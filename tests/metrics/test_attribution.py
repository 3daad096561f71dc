"""Laws of excitation and of the attribution of an error to its causes."""

import numpy as np
import pytest
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.errors import InvalidArray, InvalidConfig, InvalidRecording

RNG = np.random.default_rng(0)
TRUE, ESTIMATED = RNG.normal(size=(2, 40, 2, 5))
METRIC = np.cov(RNG.normal(size=(5, 50)))
PROJECTOR = np.diag([1.0, 1.0, 1.0, 0.0, 0.0])
PARTS = ("scale", "mean_excited", "mean_unexcited", "variation")


def parts(found):
    return np.array([getattr(found, part) for part in PARTS])


def rotated_projector():
    Q, _ = np.linalg.qr(RNG.normal(size=(5, 5)))
    return Q[:, :2] @ Q[:, :2].T


@pytest.mark.parametrize("metric", ["identity", METRIC])
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
    assert found.best_scale == pytest.approx(2 / 7)
    assert found.scale == pytest.approx((5 / 7) ** 2 * 14 / 2)
    # s Jh - J = (-5, 4)/7 and (-1, 0)/7: mean (-3, 2)/7, deviations (-2, 2)/7 and (2, -2)/7.
    assert found.mean_excited == pytest.approx(9 / 49)
    assert found.mean_unexcited == pytest.approx(4 / 49)
    assert found.variation == pytest.approx(8 / 49)


def test_a_scale_is_scale_and_nothing_else():
    found = metrics.attribute(TRUE, 2 * TRUE, METRIC, PROJECTOR)
    np.testing.assert_allclose(parts(found), [1, 0, 0, 0], atol=1e-25)
    assert found.best_scale == 0.5
    assert found.scale_along_truth == 1


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


def test_a_zero_estimate_has_no_scale():
    found = metrics.attribute(TRUE, 0 * TRUE, METRIC, PROJECTOR)
    assert (found.best_scale, found.scale) == (0, 0)
    assert found.total == pytest.approx(1, abs=1e-12)


def test_undefined_is_nan_and_missing_postures_are_left_out():
    assert np.isnan(parts(metrics.attribute(0 * TRUE, TRUE, "identity", PROJECTOR))).all()
    assert np.isnan(parts(metrics.attribute(TRUE[:0], TRUE[:0], "identity", PROJECTOR))).all()
    true, estimated = TRUE.copy(), ESTIMATED.copy()
    true[0, 0, 0], estimated[1, 1, 1] = np.nan, np.inf
    found = metrics.attribute(true.reshape(4, 10, 2, 5), estimated.reshape(4, 10, 2, 5), METRIC, PROJECTOR)
    assert found == metrics.attribute(TRUE[2:], ESTIMATED[2:], METRIC, PROJECTOR)


def test_error_along_the_truth_is_its_own_projection():
    # An error orthogonal to the truth is all scale by the first projection's reckoning of -J, none by the second's.
    J, E = TRUE, ESTIMATED - (ESTIMATED * TRUE).sum() / (TRUE * TRUE).sum() * TRUE
    assert metrics.attribute(J, J + E).scale_along_truth == pytest.approx(0, abs=1e-25)
    assert metrics.attribute(J, J + E).scale > 0.1
    assert metrics.attribute(J, -J).scale_along_truth == pytest.approx(4)
    # What it takes off leaves the squared distance of Jh from the line through J.
    found = metrics.attribute(J, 0.3 * J + E)
    left = (E**2).sum() / (J**2).sum()
    assert found.total - found.scale_along_truth == pytest.approx(left)
    assert found.scale_along_truth == pytest.approx(0.49)


def test_defaults_take_the_identity_and_leave_the_mean_whole():
    found = metrics.attribute(TRUE, ESTIMATED)
    whole = metrics.attribute(TRUE, ESTIMATED, np.eye(5), PROJECTOR)
    assert found.total == pytest.approx(metrics.pooled_relative_error(TRUE, ESTIMATED) ** 2)
    assert found.mean_unexcited == 0
    assert found.mean_excited == pytest.approx(whole.mean_excited + whole.mean_unexcited)
    assert (found.scale, found.variation) == pytest.approx((whole.scale, whole.variation))


@pytest.mark.parametrize("of_truth", [1e-300, 1e-200, 1.0, 1e200])
@pytest.mark.parametrize("of_estimate", [1e-300, 1e-200, 1.0, 1e200])
@pytest.mark.parametrize("metric", ["identity", METRIC])
def test_no_scale_is_too_small_or_too_large(of_truth, of_estimate, metric):
    true, estimated = of_truth * TRUE, of_estimate * ESTIMATED
    found = metrics.attribute(true, estimated, metric, PROJECTOR)
    squared = metrics.pooled_relative_error(true, estimated, metric)
    squared = squared * squared
    assert (parts(found) >= 0).all()
    if of_estimate > 1e150 * of_truth:
        assert found.total == squared == np.inf
    else:
        assert found.total == pytest.approx(squared, rel=1e-10)
    # All but the first part see the estimate through its best scale alone, so they are the same for any.
    same = metrics.attribute(TRUE, ESTIMATED, metric, PROJECTOR)
    np.testing.assert_allclose(parts(found)[1:], parts(same)[1:], rtol=1e-10)
    assert metrics.pooled_scale_free_error(true, estimated, metric) == pytest.approx(parts(same)[1:].sum())


def test_an_excitation_projects_in_whatever_metric_is_asked_for():
    train, use = RNG.normal(size=(30, 5)) * [1, 1, 1, 0.01, 0.01], RNG.normal(size=(300, 5)) @ RNG.normal(size=(5, 5))
    found = metrics.excitation(train, use, cut=0.01)
    own = metrics.attribute(TRUE, ESTIMATED, found.motion_metric, found.projector())
    assert metrics.attribute(TRUE, ESTIMATED, found.motion_metric, found) == own
    np.testing.assert_allclose(found.projector(metric=found.motion_metric * (1 + 1e-15)), found.projector(), atol=1e-9)
    # In any metric the excited motions are the same: P of the identity keeps motions G v of excited v, and no others.
    P = found.projector(metric="identity")
    excited = found.eigenvalues >= 0.01
    motions = found.motion_metric @ found.eigenvectors
    np.testing.assert_allclose(P @ motions[:, excited], motions[:, excited], atol=1e-10)
    assert round(np.trace(P)) == excited.sum() < 5
    np.testing.assert_allclose(P @ found.eigenvectors[:, ~excited], 0, atol=1e-10)
    assert metrics.attribute(TRUE, ESTIMATED, excited=found) == metrics.attribute(TRUE, ESTIMATED, excited=P)


def test_recordings_give_felt_motion_unless_the_true_one_is_asked_for(circle, touch):
    noisy = circle.assign(q=circle.q + xr.DataArray(RNG.normal(0, 0.1, circle.q.shape), dims=circle.q.dims))
    felt, true = metrics.excitation(noisy, touch), metrics.excitation(noisy, touch, of="true")
    assert (felt.of, true.of) == ("felt", "true")
    for found, name in ((felt, "q"), (true, "true_q")):
        by_hand = metrics.excitation(np.diff(noisy[name], axis=1), np.diff(touch[name], axis=1))
        np.testing.assert_array_equal(found.eigenvalues, by_hand.eigenvalues)
    assert felt.eigenvalues[-1] > 10 * true.eigenvalues[-1]
    np.testing.assert_array_equal(metrics.motion_metric(noisy), metrics.motion_metric(np.diff(noisy.q, axis=1)))
    assert metrics.motion_metric(noisy)[0, 0] > 10 * metrics.motion_metric(noisy, "true")[0, 0]
    with pytest.raises(InvalidRecording, match="no variable 'true_q', its true postures"):
        metrics.motion_metric(bk.experience(circle), "true")
    with pytest.raises(InvalidConfig, match="of='real'"):
        metrics.motion_metric(circle, "real")


def test_the_metric_of_a_motion_by_hand():
    dq = np.array([[1.0, 0.0], [1.0, 2.0], [np.nan, 0.0]])
    # mean of [[1, 0], [0, 0]] and [[1, 2], [2, 4]], trace 3.
    np.testing.assert_allclose(metrics.motion_metric(dq), [[1 + 1.5e-6, 1], [1, 2 + 1.5e-6]], rtol=1e-12)
    with pytest.raises(InvalidArray, match="does not move"):
        metrics.motion_metric(np.zeros((4, 2)))
    with pytest.raises(InvalidArray, match="no finite row"):
        metrics.motion_metric(np.full((4, 2), np.nan))


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
    np.testing.assert_allclose(left, found.motion_metric @ found.eigenvectors * found.eigenvalues, atol=1e-10)
    np.testing.assert_allclose(found.eigenvectors.T @ found.motion_metric @ found.eigenvectors, np.eye(4), atol=1e-10)
    assert (np.diff(found.eigenvalues) <= 0).all()
    P = found.projector()
    np.testing.assert_allclose(P @ P, P, atol=1e-11)
    assert round(np.trace(P)) == (found.eigenvalues >= 0.01).sum() == 2


def test_bad_inputs_are_named():
    with pytest.raises(InvalidConfig, match="cut=-1"):
        metrics.excitation(np.eye(3), np.eye(3), cut=-1.0)
    with pytest.raises(InvalidArray, match="training has 2 joints but use has 3"):
        metrics.excitation(np.eye(2), np.eye(3))
    for projector in (2 * np.eye(5), np.eye(4), np.full((5, 5), np.nan)):
        with pytest.raises(InvalidArray, match="excited"):
            metrics.attribute(TRUE, ESTIMATED, "identity", projector)


@pytest.mark.parametrize("size", [5e-324, 1e-310, 1.0, 1e308])
@pytest.mark.parametrize("other", [5e-324, 1e-310, 1.0, 1e308])
@pytest.mark.parametrize("weight", [None, 1e-320, 1e300])
def test_no_scale_however_tiny_or_huge_raises(size, other, weight):
    rng = np.random.default_rng(0)
    J, Jh = rng.uniform(-1, 1, (2, 4, 2, 3))
    metric = "identity" if weight is None else weight * np.eye(3)
    for estimated in (other * Jh, size * J, -size * J):
        found = metrics.attribute(size * J, estimated, metric)
        assert all(part >= 0 or np.isnan(part) for part in parts(found))
