"""Laws of the Jacobian scores."""

import numpy as np
import pytest
import scipy.linalg
import torch
import xarray as xr

from bodyimage_kin import metrics
from bodyimage_kin.errors import InvalidArray

RNG = np.random.default_rng(0)
TRUE, ESTIMATED = RNG.normal(size=(2, 3, 7, 2, 5))
METRIC = np.cov(RNG.normal(size=(5, 50)))


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
    whole = np.arange(10).reshape(2, 5), np.ones((2, 5), dtype=np.int64)
    assert metrics.relative_error(*whole) == metrics.relative_error(*(a.astype(float) for a in whole))
    for wrong in (torch.ones(2, 2, dtype=torch.bool), np.ones((2, 2), complex), [["a", "b"]], torch.eye(2).to_sparse()):
        with pytest.raises(InvalidArray, match="true"):
            metrics.relative_error(wrong, ESTIMATED)


@pytest.mark.parametrize(
    "metric", [-np.eye(5), np.triu(np.ones((5, 5))), np.eye(4), np.full((5, 5), np.nan), "ident", None]
)
def test_a_metric_that_is_none_is_refused(metric):
    with pytest.raises(InvalidArray, match="metric"):
        metrics.relative_error(TRUE, ESTIMATED, metric)


ROTATION = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])


def test_axis_relative_error_by_hand():
    found = metrics.axis_relative_error([[3.0, 4.0], [0.0, 2.0]], [[3.0, 4.5], [1.0, 2.0]])
    np.testing.assert_allclose(found, [0.1, 0.5])


def test_scale_free_error_forgives_the_scale_alone():
    np.testing.assert_allclose(metrics.scale_free_error(TRUE, 0.1 * TRUE, METRIC), 0, atol=1e-14)
    # <J, R J> = cos |J|^2 whatever J, so the error is the squared sine.
    np.testing.assert_allclose(metrics.scale_free_error(TRUE, ROTATION @ TRUE, METRIC), np.sin(0.5) ** 2)
    assert metrics.scale_free_error([[1.0, 0.0]], [[1.0, 1.0]]) == pytest.approx(1 / 2)


def test_pooled_scale_free_error_allows_one_scale_for_all_postures():
    assert metrics.pooled_scale_free_error(TRUE, 0.1 * TRUE, METRIC) == pytest.approx(0, abs=1e-14)
    # Scales 1 and 3 of equal Jacobians: <Jh, J> = 4, |Jh|^2 = 10, |J|^2 = 2.
    J = np.ones((2, 1, 1))
    assert metrics.pooled_scale_free_error(J, J * [[[1.0]], [[3.0]]]) == pytest.approx(1 - 16 / 20)
    best = min(metrics.pooled_relative_error(TRUE, s * ESTIMATED, METRIC) for s in np.linspace(-1, 1, 2001))
    assert metrics.pooled_scale_free_error(TRUE, ESTIMATED, METRIC) == pytest.approx(best**2, abs=1e-5)


def test_columns_by_hand():
    J, Jh = [[1.0, 0.0, 3.0], [0.0, 2.0, 4.0]], [[1.0, 0.0, 0.0], [1.0, -2.0, 10.0]]
    np.testing.assert_allclose(metrics.column_cosine(J, Jh), [np.sqrt(0.5), -1, 0.8])
    np.testing.assert_allclose(metrics.column_log_norm_ratio(J, Jh), np.log([np.sqrt(2), 1, 2]), atol=1e-15)
    np.testing.assert_array_equal(metrics.column_log_norm_ratio([[1.0, 0.0]], [[0.0, 1.0]]), [-np.inf, np.nan])
    np.testing.assert_array_equal(metrics.column_cosine([[1.0, 0.0]], [[0.0, 1.0]]), [np.nan, np.nan])


def test_singular_values_by_hand():
    J, Jh = np.diag([4.0, 1.0]), np.diag([4.0, 3.0])
    np.testing.assert_allclose(metrics.singular_value_ratios(J, Jh), [1, 3])
    assert metrics.log_condition_difference(J, Jh) == pytest.approx(np.log(4 / 3) - np.log(4))
    assert metrics.manipulability_ratio(J, Jh) == pytest.approx(3)
    # W = diag(1, 16) makes the true one isotropic.
    np.testing.assert_allclose(metrics.singular_value_ratios(J, Jh, np.diag([1.0, 16.0])), [12 / 4, 4 / 4])


def test_manipulability_is_the_root_of_the_determinant():
    volumes = [np.sqrt(np.linalg.det(J @ METRIC @ J.swapaxes(-1, -2))) for J in (TRUE, ESTIMATED)]
    np.testing.assert_allclose(metrics.manipulability_ratio(TRUE, ESTIMATED, METRIC), volumes[1] / volumes[0])


def test_row_space_angles_by_hand():
    plane = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    for angle in (1e-10, 0.3, np.pi / 2 - 1e-10):
        tilted = [[2.0, 0.0, 0.0], [5.0, np.cos(angle), np.sin(angle)]]
        np.testing.assert_allclose(metrics.row_space_angles(plane, tilted), [0, angle], atol=1e-14)
    assert np.isnan(metrics.row_space_angles(plane, [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])).all()


def test_row_space_angles_do_not_see_what_happens_in_the_image():
    found = metrics.row_space_angles(TRUE, RNG.normal(size=(3, 7, 2, 2)) @ TRUE, METRIC)
    np.testing.assert_allclose(found, 0, atol=1e-11)


@pytest.mark.parametrize("shape", [(1, 1), (1, 4), (3, 3), (3, 7), (4, 2)])
def test_general_sizes_of_image_and_body(shape):
    true, estimated = np.random.default_rng(1).normal(size=(2, 6, *shape))
    found = metrics.jacobian_errors(true, estimated)
    assert dict(found.sizes) == {"posture": 6, "axis": shape[0], "joint": shape[1], "direction": min(shape)}
    assert not any(found[name].isnull().any() for name in found)
    S, Sh = (np.linalg.svd(a, compute_uv=False) for a in (true, estimated))
    np.testing.assert_allclose(found.singular_value_ratios, Sh / S)
    largest = [scipy.linalg.subspace_angles(J.T, Jh.T)[0] for J, Jh in zip(true, estimated, strict=True)]
    np.testing.assert_allclose(found.row_space_angles[:, -1], largest, atol=1e-7)


def test_all_scores_at_once_are_those_one_by_one():
    found = metrics.jacobian_errors(TRUE, ESTIMATED, metric=METRIC, joints=list("abcde"), dims=("trial", "time"))
    assert found.relative_error.dims == ("trial", "time")
    assert list(found.joint.values) == list("abcde")
    for name, variable in found.items():
        score = getattr(metrics, name)
        arguments = (TRUE, ESTIMATED) if name.startswith("column") else (TRUE, ESTIMATED, METRIC)
        np.testing.assert_array_equal(variable, score(*arguments))
        assert variable.attrs["units"] == ("rad" if name == "row_space_angles" else "1")
        assert variable.attrs["source"] == f"bodyimage_kin.metrics.jacobian.{name}"
    flat = metrics.jacobian_errors(TRUE, ESTIMATED, metric=METRIC)
    np.testing.assert_array_equal(flat.column_cosine, found.column_cosine.values.reshape(21, 5))
    assert metrics.jacobian_errors(TRUE[0, 0], ESTIMATED[0, 0]).sizes["posture"] == 1
    assert metrics.jacobian_errors(TRUE[:0], ESTIMATED[:0]).sizes["posture"] == 0


def test_chunks_do_not_change_the_result(monkeypatch):
    whole = metrics.jacobian_errors(TRUE, ESTIMATED, metric=METRIC)
    pooled = metrics.pooled_relative_error(TRUE, ESTIMATED, METRIC)
    monkeypatch.setattr("bodyimage_kin.metrics._postures.CHUNK", 4)
    xr.testing.assert_allclose(metrics.jacobian_errors(TRUE, ESTIMATED, metric=METRIC), whole)
    assert metrics.pooled_relative_error(TRUE, ESTIMATED, METRIC) == pytest.approx(pooled)


def test_every_null_estimator_is_caught():
    rank_one = TRUE * [[1.0], [0.0]]
    caught = {
        "scaled": metrics.jacobian_errors(TRUE, 0.1 * TRUE).relative_error,
        "rotated": metrics.jacobian_errors(TRUE, ROTATION @ TRUE).scale_free_error,
        "rank one": metrics.jacobian_errors(TRUE, rank_one).log_condition_difference,
        "another": metrics.jacobian_errors(TRUE, ESTIMATED).row_space_angles[..., -1],
        "zero": metrics.jacobian_errors(TRUE, 0 * TRUE).relative_error,
    }
    assert all((error > 0.1).all() for error in caught.values())
    assert np.isposinf(caught["rank one"]).all()
    np.testing.assert_allclose(caught["scaled"], 0.9)
    np.testing.assert_array_equal(caught["zero"], 1)


def test_missing_degenerate_and_huge_values_never_raise():
    true, estimated = TRUE.copy(), ESTIMATED.copy()
    true[0, 0], true[0, 1], estimated[0, 2], estimated[0, 3, 1, 1], estimated[0, 4] = 0, np.nan, 0, np.inf, 1e200
    found = metrics.jacobian_errors(true, estimated, dims=("trial", "time"))
    for variable in found.values():
        assert variable[0, [1, 3]].isnull().all()
        assert not variable[1:].isnull().any()
    assert found.relative_error[0, 2] == 1


def test_names_must_fit():
    with pytest.raises(InvalidArray, match="2 joint names for a Jacobian of 5 columns"):
        metrics.jacobian_errors(TRUE, ESTIMATED, joints=["a", "b"])
    with pytest.raises(InvalidArray, match=r"3 dims for a batch of shape \(3, 7\)"):
        metrics.jacobian_errors(TRUE, ESTIMATED, dims=("a", "b", "c"))
