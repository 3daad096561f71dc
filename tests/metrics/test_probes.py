"""Laws of probes, of distances from what was seen, and of the ratio of depths."""

import dataclasses

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin import probes
from bodyimage_kin.errors import InvalidConfig, InvalidPosture, InvalidRecording, NotVisible


def test_training_is_true_where_there_is_a_truth_and_felt_where_there_is_none(body, circle):
    moved = circle.copy(deep=True)
    moved["q"] += 0.1
    moved["q"][0, 0] = moved["true_q"][0, 0] = np.nan
    true, felt = (probes.Training().postures(body, one) for one in (moved, bk.experience(moved)))
    np.testing.assert_array_equal(true, circle.true_q.values[0, 1:])
    np.testing.assert_array_equal(felt, circle.q.values[0, 1:] + 0.1)
    assert torch.equal(felt, probes.Training().postures(None, bk.experience(moved)))
    with pytest.raises(InvalidRecording, match="has no postures"):
        probes.Training().postures(body, moved.assign(true_q=np.nan * moved.true_q))
    with pytest.raises(InvalidRecording, match="no variable 'q'"):
        probes.Training().postures(body, circle.drop_vars(["q", "true_q"]))


def test_face_is_one_posture_a_taxel(body, circle):
    for distance in (0.0, 0.03):
        q = probes.Face(distance).postures(body, circle)
        assert torch.equal(q, body.touch_postures(range(body.skin.count), distance))
        assert q is probes.Face(distance).postures(body, circle), "an embodiment's face is found once"


def test_joint_space_is_the_same_for_every_recording(body, circle, touch):
    probe = probes.JointSpace(50, seed=5)
    q = probe.postures(body, circle)
    assert torch.equal(q, probe.postures(body, touch))
    assert q.shape == (50, 5)
    assert (body.hand_in_camera(q)[:, 2] >= body.camera.screen.near).all()
    assert not torch.equal(q, probes.JointSpace(50, seed=6).postures(body, circle))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: probes.Face(-0.01), "distance=-0.01: give a number of at least 0"),
        (lambda: probes.JointSpace(0), "count=0: give a whole number of at least 1"),
        (
            lambda: probes.JointSpace(10**12),
            "count=1000000000000: give a whole number of at least 1 and at most 1000000",
        ),
        (lambda: probes.JointSpace(True), "count=True: give a whole number"),
        (lambda: probes.JointSpace(seed=-1), "seed=-1"),
    ],
)
def test_settings_are_checked_by_name(make, message):
    with pytest.raises(InvalidConfig, match=message):
        make()


def test_probes_are_frozen_and_equal_by_their_settings():
    assert probes.Face(0) == probes.Face(0.0) == bk.probes.Face()
    assert hash(probes.Face(0)) == hash(probes.Face())
    assert repr(probes.Face(0)) == "Face(distance=0.0)"
    with pytest.raises(dataclasses.FrozenInstanceError):
        probes.Face().distance = 1.0


class Home:
    """Anybody's probe."""

    def postures(self, body, seen):
        return np.zeros((2, body.p)) + seen.q.values[0, 0]


def test_anybodys_probe_is_one_and_what_it_gives_is_checked(body, circle):
    found = probes.probe_postures(Home(), body, circle)
    np.testing.assert_array_equal(found, np.stack([circle.q.values[0, 0]] * 2))
    for wrong, message in (
        (np.zeros((2, 4)), "postures of probe Home .*must have 5 joint values"),
        (np.zeros((0, 5)), "at least one"),
        (np.zeros(5), r"shape \(5,\)"),
        (np.full((2, 5), np.nan), "NaN or infinite"),
    ):
        home = Home()
        home.postures = lambda body, seen, wrong=wrong: wrong
        with pytest.raises(InvalidPosture, match=message):
            probes.probe_postures(home, body, circle)
    for wrong in ("face", probes.Face, None):
        with pytest.raises(InvalidConfig, match=r"method postures\(body, seen\)"):
            probes.probe_postures(wrong, body, circle)


def test_distance_from_training_is_nothing_there_and_counts_in_its_own_spread(body, circle):
    q = circle.true_q.values[0]
    joint, hand = probes.distances(body, circle, q)
    np.testing.assert_allclose(hand, 0, atol=1e-15)
    # Mahalanobis distances of a set from itself: their mean square is p, but for the little added to the diagonal.
    assert np.mean(joint**2) == pytest.approx(body.p, rel=0.2)
    face = probes.Face().postures(body, circle)
    away, off = probes.distances(body, circle, face.tolist())
    assert away.min() > joint.max()
    places = circle.true_hand_position.values[0]
    nearest = np.linalg.norm(body.hand_position(face[:5]).numpy()[:, None] - places, axis=-1).min(1)
    np.testing.assert_allclose(off[:5], nearest, atol=1e-12)


def test_the_ratio_of_depths_is_of_the_hand_itself_and_not_of_the_screen(body, circle):
    depth = [
        body.hand_in_camera(q)[:, 2].mean().item()
        for q in (circle.true_q.values[0], probes.Face().postures(body, circle))
    ]
    ratio = bk.metrics.depth_ratio(body, circle)
    assert ratio == pytest.approx(depth[0] / depth[1])
    assert depth[1] == pytest.approx(0.0381, abs=5e-5)
    assert bk.metrics.depth_ratio(body, circle, probes.Training()) == 1
    assert bk.metrics.depth_ratio(body, circle, probes.Face(0.03)) == pytest.approx(1, rel=0.1)
    behind = circle.assign(true_q=0 * circle.true_q)
    if body.hand_in_camera(behind.true_q.values[0])[:, 2].mean() < 0:
        with pytest.raises(NotVisible, match="in front of the camera"):
            bk.metrics.depth_ratio(body, behind)


def test_a_jacobian_told_the_ratio_of_depths_errs_less_on_the_face(body, circle, touch):
    exp = bk.experience(circle)
    q = probes.Face().postures(body, circle)
    metric = bk.metrics.motion_metric(touch)
    errors = [
        bk.metrics.pooled_relative_error(body.hand_image_jacobian(q), spec.fit(exp).jacobian(q), metric)
        for spec in (
            bk.estimators.LeastSquares(),
            bk.estimators.LeastSquares(scale=bk.metrics.depth_ratio(body, circle)),
        )
    ]
    assert errors[1] < errors[0]
