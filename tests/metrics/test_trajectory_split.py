"""Laws of the split of an integrated path's error, on a planar arm and on linear fields with a known curl."""

from itertools import pairwise

import numpy as np
import pytest
from planar_arm import image, jacobian

from bodyimage_kin import metrics
from bodyimage_kin.errors import InvalidArray, InvalidConfig

PARTS = ("discretisation", "position", "circulation")
CONSTANT = np.array([[0.1, -0.2, 0.05], [0.3, 0.1, -0.1]])


def constant(q):
    return np.broadcast_to(CONSTANT, (len(q), 2, 3))


def swirl(q):
    """Not the derivative of anything: its curl d_0 J_01 - d_1 J_00 is -3 everywhere."""
    J = np.zeros((len(q), 2, 3))
    J[:, 0, 0], J[:, 0, 1] = 2 * q[:, 1], -q[:, 0]
    return J


def linear(field):
    return lambda q, dq: np.einsum("kmp,kp->km", field(q), dq)


def walk(*batch, seed=0, length=40):
    return np.random.default_rng(seed).normal(scale=0.1, size=(*batch, length, 3)).cumsum(-2)


def split(q, field=swirl, displacement=None, **settings):
    return metrics.error_split(q, image(q), displacement or linear(field), field, **settings)


def square(side, steps):
    """Once around a square in the first two joints, anticlockwise, from a corner back to it."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]], dtype=float) * side + [0.3, -0.2, 0.5]
    along = np.linspace(0, 1, steps, endpoint=False)[:, None]
    sides = [a + along * (b - a) for a, b in pairwise(corners)]
    return np.concatenate([*sides, corners[-1:]])


@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
@pytest.mark.parametrize("field", [jacobian, constant, swirl])
def test_the_parts_sum_to_the_error_of_the_integrated_image(batch, field):
    q = walk(*batch)
    dq = np.diff(q, axis=-2)
    steps = np.tanh(linear(field)(q[..., :-1, :].reshape(-1, 3), dq.reshape(-1, 3)) + 0.01).reshape(*batch, -1, 2)
    estimated = image(q)[..., :1, :] + np.concatenate([np.zeros((*batch, 1, 2)), steps.cumsum(-2)], -2)
    found = split(q, field, lambda q, dq: np.tanh(linear(field)(q, dq) + 0.01))
    np.testing.assert_allclose(found.total, estimated - image(q), atol=1e-13)
    assert found.rms["total"] == pytest.approx(metrics.trajectory_rmse(image(q), estimated))
    for part in PARTS:
        assert getattr(found, part).shape == (*batch, 40, 2)
        np.testing.assert_allclose(getattr(found, part)[..., 0, :], 0, atol=1e-16)


def test_the_truth_errs_by_its_steps_alone():
    q = walk(2)
    found = split(q, jacobian)
    np.testing.assert_allclose(found.position, 0, atol=1e-14)
    np.testing.assert_allclose(found.circulation, 0, atol=1e-12)
    steps = linear(jacobian)(q[:, :-1].reshape(-1, 3), np.diff(q, axis=1).reshape(-1, 3)).reshape(2, -1, 2)
    drift = steps.cumsum(1) - (image(q) - image(q[:, :1]))[:, 1:]
    np.testing.assert_allclose(found.discretisation[:, 1:], drift, atol=1e-12)
    assert np.abs(drift).max() > 1e-3


def test_a_constant_jacobian_errs_by_position_alone():
    q = walk(2)
    found = split(q, constant)
    np.testing.assert_allclose(found.discretisation, 0, atol=1e-14)
    np.testing.assert_allclose(found.circulation, 0, atol=1e-14)
    moved = q - q[:, :1]
    np.testing.assert_allclose(found.position, moved @ CONSTANT.T - (image(q) - image(q[:, :1])), atol=1e-14)


def test_the_derivative_of_any_function_does_not_circulate():
    # Of the image bent by a cube: wrong everywhere, and still undone on the way back.
    found = split(walk(3), lambda q: 3 * image(q)[..., None] ** 2 * jacobian(q))
    np.testing.assert_allclose(found.circulation, 0, atol=1e-10)
    assert min(found.rms["position"], found.rms["discretisation"]) > 1e-3


@pytest.mark.parametrize("steps", [1, 7])
@pytest.mark.parametrize("side", [0.1, 0.5])
def test_a_closed_square_by_hand(side, steps):
    found = split(square(side, steps))
    np.testing.assert_allclose(found.circulation[-1], [-3 * side**2, 0], atol=1e-14)
    np.testing.assert_allclose(found.position[-1], 0, atol=1e-14)
    # Only J_00 changes with q_1 and J_01 with q_0, so that no side of the square changes what it is integrated with.
    np.testing.assert_allclose(found.discretisation[-1], 0, atol=1e-14)
    # There and back is no loop.
    q = square(side, steps)[: steps + 1]
    np.testing.assert_allclose(split(np.concatenate([q, q[::-1]])).circulation, 0, atol=1e-14)


def test_a_small_loop_over_its_area_is_the_curl():
    def field(q):
        return np.stack([np.sin(q[:, [1]]) * q, np.cos(q[:, [0]]) * q[:, [2, 0, 1]]], -2)

    at, side, step = np.array([0.3, -0.2, 0.5]), 1e-3, 1e-5
    shifts = step * np.eye(3)
    derivative = np.stack([(field((at + s)[None]) - field((at - s)[None]))[0] / (2 * step) for s in shifts], -1)
    found = split(square(side, 1) - [side / 2, side / 2, 0], field).circulation[-1] / side**2
    # The loop turns from joint 0 to joint 1: d_0 J_i1 - d_1 J_i0.
    np.testing.assert_allclose(found, metrics.curl(derivative)[:, 1, 0], rtol=1e-5)
    assert np.abs(found).min() > 0.1


def test_a_bias_circulates():
    bias = np.array([0.001, -0.002])
    found = split(walk(), jacobian, lambda q, dq: linear(jacobian)(q, dq) + bias)
    np.testing.assert_allclose(found.circulation, np.arange(40)[:, None] * bias, atol=1e-12)
    np.testing.assert_allclose(found.position, 0, atol=1e-14)


def test_discretisation_halves_with_the_step_and_a_straight_path_does_not_circulate():
    def rms(steps):
        return split(np.linspace([0.1, -0.3, 0.2], [1.2, 0.6, 0.9], steps + 1)).rms

    coarse, fine = rms(400), rms(800)
    assert fine["discretisation"] == pytest.approx(coarse["discretisation"] / 2, rel=0.01)
    assert max(coarse["circulation"], fine["circulation"]) < 1e-14


def test_a_path_ends_at_a_gap_and_begins_at_the_first_known_sample():
    q, whole = walk(4), split(walk(4))
    q[1, 30:] = np.nan  # padded
    q[2, :5] = np.nan
    seen = image(q)
    seen[3, 20] = np.nan
    found = metrics.error_split(q, seen, linear(swirl), swirl)
    for part in PARTS:
        values, expected = getattr(found, part), getattr(whole, part)
        np.testing.assert_allclose(values[0], expected[0], atol=1e-15)
        np.testing.assert_allclose(values[1, :30], expected[1, :30], atol=1e-15)
        np.testing.assert_allclose(values[3, :20], expected[3, :20], atol=1e-15)
        np.testing.assert_allclose(values[2, 5:], getattr(split(walk(4)[2, 5:]), part), atol=1e-15)
        assert np.isnan(values[1, 30:]).all()
        assert np.isnan(values[2, :5]).all()
        assert np.isnan(values[3, 20:]).all()
    assert np.isfinite(list(found.rms.values())).all()


def test_nothing_known_is_undefined():
    q = np.full((2, 5, 3), np.nan)
    found = metrics.error_split(q, np.zeros((2, 5, 2)), linear(swirl), swirl)
    assert np.isnan(found.total).all()
    assert np.isnan(list(found.rms.values())).all()
    one = split(walk(length=1))
    np.testing.assert_array_equal(one.total, [[0, 0]])


def test_long_recordings_are_worked_off_in_blocks(monkeypatch):
    whole = split(walk(2))
    monkeypatch.setattr("bodyimage_kin.metrics._fields._CHUNK", 100)
    for part in PARTS:
        np.testing.assert_allclose(getattr(split(walk(2)), part), getattr(whole, part), atol=1e-15)


def test_bad_inputs_are_named():
    q = walk(2)
    with pytest.raises(InvalidArray, match=r"q has shape \(2, 40, 3\) but true_image \(2, 39, 2\)"):
        metrics.error_split(q, image(q)[:, :-1], linear(swirl), swirl)
    with pytest.raises(InvalidArray, match="the value of displacement"):
        split(q, displacement=lambda q, dq: dq)
    with pytest.raises(InvalidArray, match="the value of estimated_jacobian"):
        split(q, lambda q: swirl(q)[:1], linear(swirl))
    with pytest.raises(InvalidConfig, match="nodes=0: give a whole number"):
        split(q, nodes=0)
