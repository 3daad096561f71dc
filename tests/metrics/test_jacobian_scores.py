"""Laws of the Jacobian scores."""

import numpy as np
import pytest
import torch

from bodyimage_kin import metrics
from bodyimage_kin.errors import InvalidArray, UnknownName

RNG = np.random.default_rng(0)
TRUE, ESTIMATED = RNG.normal(size=(2, 3, 7, 2, 5))
METRIC = np.cov(RNG.normal(size=(5, 50)))


def test_unit_metrics_by_hand():
    np.testing.assert_array_equal(metrics.unit_metric("identity", p=3), np.eye(3))
    limits = {"lower": [-1.0, 0.0, -np.inf], "upper": [1.0, 0.5, np.inf]}
    np.testing.assert_allclose(metrics.unit_metric("range", **limits), np.diag([4, 0.25, 4 * np.pi**2]))
    dq = np.array([[1.0, 0.0], [1.0, 2.0], [np.nan, 0.0]])
    # mean of [[1, 0], [0, 0]] and [[1, 2], [2, 4]], trace 3.
    np.testing.assert_allclose(metrics.unit_metric("use", dq=dq), [[1 + 1.5e-6, 1], [1, 2 + 1.5e-6]], rtol=1e-12)


def test_unit_metrics_say_what_they_need():
    with pytest.raises(UnknownName, match="unit metric 'rang'; did you mean 'range'"):
        metrics.unit_metric("rang")
    for kind, message in (("identity", "needs p"), ("range", "needs lower"), ("use", "needs dq")):
        with pytest.raises(InvalidArray, match=message):
            metrics.unit_metric(kind)
    with pytest.raises(InvalidArray, match="no motion"):
        metrics.unit_metric("use", dq=np.zeros((4, 2)))
    with pytest.raises(InvalidArray, match="no finite row"):
        metrics.unit_metric("use", dq=np.full((4, 2), np.nan))
    with pytest.raises(InvalidArray, match="below"):
        metrics.unit_metric("range", lower=[0.0], upper=[np.inf])


def test_relative_error_by_hand():
    J, Jh = [[3.0, 0.0], [0.0, 4.0]], [[3.0, 0.0], [0.0, 3.0]]
    assert metrics.relative_error(J, Jh) == pytest.approx(1 / 5)
    # W = diag(0, 1) sees the second joint alone.
    assert metrics.relative_error(J, Jh, np.diag([0.0, 1.0])) == pytest.approx(1 / 4)


def test_pooled_relative_error_by_hand():
    J, Jh = [[[1.0, 0.0]], [[0.0, 3.0]]], [[[2.0, 0.0]], [[0.0, 3.0]]]
    assert metrics.pooled_relative_error(J, Jh) == pytest.approx(np.sqrt(1 / 10))


def test_in_the_motions_metric_the_error_is_that_of_the_displacements():
    dq = RNG.normal(size=(400, 5)) @ RNG.normal(size=(5, 5))
    metric = dq.T @ dq / len(dq)
    d, truth = (dq @ J[0, 0].T for J in (ESTIMATED, TRUE))
    expected = metrics.relative_error(TRUE[0, 0], ESTIMATED[0, 0], metric)
    assert metrics.displacement_error(d, truth) == pytest.approx(float(expected))


def test_displacement_error_by_hand():
    d = np.array([[1.0, 0.0], [0.0, 0.0], [np.nan, 0.0]])
    truth = np.array([[1.0, 0.0], [0.0, 2.0], [5.0, 5.0]])
    assert metrics.displacement_error(d, truth) == pytest.approx(np.sqrt(4 / 5))
    assert np.isnan(metrics.displacement_error(truth, 0 * truth))
    assert np.isnan(metrics.displacement_error(truth[:0], truth[:0]))


@pytest.mark.parametrize("batch", [(), (0,), (1,), (3, 7)])
def test_every_batch_shape(batch):
    true, estimated = RNG.normal(size=(2, *batch, 3, 4))
    found = metrics.relative_error(true, estimated, np.eye(4))
    assert found.shape == batch
    np.testing.assert_allclose(
        found, np.linalg.norm(estimated - true, axis=(-2, -1)) / np.linalg.norm(true, axis=(-2, -1))
    )


def test_undefined_postures_are_nan_and_left_out_of_the_pool():
    true, estimated = TRUE.copy(), ESTIMATED.copy()
    true[0, 0], true[0, 1, 0, 0], estimated[2, 6, 1, 4] = 0, np.nan, np.inf
    found = metrics.relative_error(true, estimated, METRIC)
    bad = np.zeros((3, 7), bool)
    bad[0, :2] = bad[2, 6] = True
    np.testing.assert_array_equal(np.isnan(found), bad)
    bad[0, 0] = False
    pooled = metrics.pooled_relative_error(true[~bad], estimated[~bad], METRIC)
    assert metrics.pooled_relative_error(true, estimated, METRIC) == pytest.approx(pooled)
    assert np.isnan(metrics.pooled_relative_error(true[:0], estimated[:0]))
    assert np.isnan(metrics.pooled_relative_error(0 * TRUE, TRUE))


def test_tensors_arrays_and_lists_are_alike():
    tensors = torch.tensor(TRUE, requires_grad=True), torch.tensor(ESTIMATED)
    expected = metrics.relative_error(TRUE, ESTIMATED)
    np.testing.assert_array_equal(metrics.relative_error(*tensors), expected)
    np.testing.assert_array_equal(metrics.relative_error(TRUE.tolist(), ESTIMATED.tolist()), expected)
    with pytest.raises(InvalidArray, match=r"holds int64, not floats"):
        metrics.relative_error(torch.ones(2, 2, dtype=torch.int64), ESTIMATED)


@pytest.mark.parametrize("metric", [-np.eye(5), np.triu(np.ones((5, 5))), np.eye(4), np.full((5, 5), np.nan)])
def test_a_metric_that_is_none_is_refused(metric):
    with pytest.raises(InvalidArray, match="metric"):
        metrics.relative_error(TRUE, ESTIMATED, metric)
