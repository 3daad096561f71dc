"""Where to look next: by the prior alone, what is chosen tells most, and what is foretold comes about."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.calibration import Observed, calibrate, next_postures
from bodyimage_kin.errors import InvalidConfig

FACE = bk.probes.Face()
ANYWHERE = bk.probes.JointSpace(16)


@pytest.fixture(scope="module")
def aimed(body):
    return next_postures(body, None, FACE, 10)


def images_of(body, q, noise=2e-4, seed=0):
    """What a body shows at these postures."""
    image = body.hand_image(torch.from_numpy(q)).numpy()
    image = image + noise * np.random.default_rng(seed).standard_normal(image.shape)
    return bk.recording(q=q, hand_image=image, joints=list(body.joints), order="scattered", unit="m")


def test_each_posture_is_visible_apart_and_lowers_what_is_foretold(body, aimed):
    assert body.visible(torch.from_numpy(aimed.q)).all()
    apart = np.abs(aimed.q[:, None] - aimed.q[None]).max(-1) + np.eye(10)
    assert apart.min() > 1e-3
    assert (np.diff(aimed.predicted_error) < 0).all()
    assert len(aimed.predicted_error) == 11


def test_aiming_beats_chance_and_telling_everything(body, aimed):
    others = [next_postures(body, None, FACE, 10, aim=aim).predicted_error[-1] for aim in ("everything", "random")]
    assert aimed.predicted_error[-1] < min(others)


def test_the_choice_is_greedy(body):
    candidates = body.felt_robot.sample(60, seed=4)
    one = next_postures(body, None, FACE, 1, candidates=candidates)
    visible = np.flatnonzero(body.visible(candidates).numpy())
    alone = [
        next_postures(body, None, FACE, 1, candidates=candidates[[index]]).predicted_error[-1] for index in visible[:8]
    ]
    assert one.predicted_error[-1] <= min(alone) + 1e-12


def test_what_is_exchanged_leaves_less_than_what_is_chosen_one_by_one(body):
    """The best after those before need not be among the best together; no single exchange is left that would help."""
    candidates = body.felt_robot.sample(400, seed=2)
    candidates = candidates[body.visible(candidates)].numpy()[:60]
    count = 6
    chosen = next_postures(body, None, ANYWHERE, count, candidates=candidates)
    one_by_one = next_postures(body, None, ANYWHERE, count, candidates=candidates, exchange=False)
    assert chosen.predicted_error[-1] < 0.99 * one_by_one.predicted_error[-1]
    rows = chosen.chosen
    for place in range(count):
        for other in np.setdiff1d(np.arange(len(candidates)), rows)[:6]:
            tried = rows.copy()
            tried[place] = other
            of = next_postures(body, None, ANYWHERE, count, candidates=candidates[tried]).predicted_error[-1]
            assert of > 0.999 * chosen.predicted_error[-1]


@pytest.fixture(scope="module")
def recorded(body):
    """Poses of a recording, in the order in which somebody recorded them: along a line, then anywhere."""
    line = body.felt_home.numpy() + np.linspace(0.0, 0.1, 12)[:, None]
    anywhere = body.felt_robot.sample(80, seed=3).numpy()
    q = np.concatenate([line, anywhere])
    return q[body.visible(torch.from_numpy(q)).numpy()][:30]


def test_a_recorded_set_is_replayed_in_the_order_in_which_each_would_have_been_the_best(body, recorded):
    replay = next_postures(body, None, ANYWHERE, len(recorded), candidates=recorded)
    assert sorted(replay.chosen) == list(range(len(recorded)))
    few = next_postures(body, None, ANYWHERE, 4, candidates=recorded, exchange=False)
    np.testing.assert_array_equal(few.chosen, replay.chosen[:4])
    np.testing.assert_array_equal(replay.q, recorded[replay.chosen])
    # After so many of it, less is left than with any other next pose, and than after as many in the recorded order.
    for count in (3, 6):
        before, rest = replay.q[: count - 1], replay.chosen[count - 1 :][:8]
        left = [
            next_postures(body, None, ANYWHERE, count, candidates=np.vstack([before, recorded[row]])).predicted_error[
                -1
            ]
            for row in rest
        ]
        assert np.argmin(left) == 0
        assert min(left) == pytest.approx(replay.predicted_error[count])
        first = next_postures(body, None, ANYWHERE, count, candidates=recorded[:count]).predicted_error[-1]
        assert replay.predicted_error[count] < first


def test_a_replay_does_not_depend_on_how_the_set_was_sorted(body, recorded):
    order = np.random.default_rng(0).permutation(len(recorded))
    one, other = (next_postures(body, None, ANYWHERE, len(recorded), candidates=q) for q in (recorded, recorded[order]))
    np.testing.assert_array_equal(one.q, other.q)
    np.testing.assert_allclose(one.predicted_error, other.predicted_error, rtol=1e-9)


def test_a_pose_that_was_recorded_twice_is_replayed_once(body, recorded):
    twice = np.concatenate([recorded, recorded[:5]])
    replay = next_postures(body, None, ANYWHERE, len(recorded), candidates=twice)
    assert len(np.unique(replay.q, axis=0)) == len(recorded)
    with pytest.raises(InvalidConfig, match=f"only {len(recorded)} candidates"):
        next_postures(body, None, ANYWHERE, len(twice), candidates=twice)


def test_nothing_beyond_the_limits_is_chosen(body, recorded):
    far = np.concatenate([recorded[:3] + np.eye(5)[4] * 9.0, recorded[:3]])
    assert sorted(next_postures(body, None, ANYWHERE, 3, candidates=far).chosen) == [3, 4, 5]
    with pytest.raises(InvalidConfig, match="only 3 candidates in reach"):
        next_postures(body, None, ANYWHERE, 4, candidates=far)


def test_what_was_calibrated_before_counts_beside_what_is_seen(body, aimed):
    """Both together tell more than either; and the same images handed over twice count once."""
    first, second = (images_of(body, q) for q in (aimed.q[:5], aimed.q[5:]))
    fit = calibrate(body, Observed(first, use=["images"], noise={"images": 2e-4}), free=["axes", "offsets"], folds=2)
    candidates = body.felt_robot.sample(60, seed=5)
    alone, again, both = (
        next_postures(fit, seen, FACE, 1, candidates=candidates).predicted_error[0] for seen in (None, first, second)
    )
    assert again == alone
    assert both < 0.7 * alone


def test_what_is_foretold_comes_about(body, aimed):
    """Arms drawn from the prior, seen at the chosen postures: the error on the face is about as large as foretold."""
    thought = calibrate(
        body, Observed(images_of(body, aimed.q), noise={"images": 2e-4}), free=["axes", "offsets"], folds=2
    )
    sd = np.where(thought.fit.free, thought.prior.sds(thought.parameters), 0.0)
    q = body.touch_postures(range(0, 441, 7))
    errors = []
    for seed in range(8):
        true = thought.at(sd * np.random.default_rng(seed).standard_normal(len(sd)))
        exp = images_of(true, aimed.q, seed=seed)
        found = calibrate(body, Observed(exp, noise={"images": 2e-4}), free=["axes", "offsets"], robust=False, folds=2)
        J, Jh = (one.hand_image_jacobian(q, on_invisible="nan").numpy() for one in (true, found.body))
        seen = np.isfinite(J).all((1, 2)) & np.isfinite(Jh).all((1, 2))
        errors.append(metrics.pooled_relative_error(J[seen], Jh[seen]))
    assert 0.4 < np.median(errors) / aimed.predicted_error[-1] < 2.5


def test_what_was_seen_counts(body, aimed):
    more = next_postures(body, images_of(body, aimed.q), FACE, 3)
    assert more.predicted_error[0] < 0.2
    assert more.predicted_error[-1] < more.predicted_error[0]


def test_a_wider_prior_foretells_more_error(body):
    wide = bk.calibration.Prior(axes=0.1, offsets=0.01)
    errors = [next_postures(body, None, FACE, 3, prior=prior).predicted_error for prior in (None, wide)]
    assert errors[1][0] == pytest.approx(2 * errors[0][0], rel=0.05)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"count": 0}, "count=0"),
        ({"aim": "face"}, "aim='face'"),
        ({"candidates": np.zeros((4, 3))}, "candidates have shape"),
        ({"candidates": np.zeros((1, 5)), "count": 2}, "only"),
        ({"noise": -1.0}, "noise"),
    ],
)
@pytest.mark.usefixtures("unchecked")
def test_mistakes_are_named(body, changes, match):
    asked = {"count": 1, **changes}
    count = asked.pop("count")
    with pytest.raises(InvalidConfig, match=match):
        next_postures(body, None, FACE, count, **asked)


def test_pixels_must_say_their_noise(body):
    import dataclasses

    model = bk.Pinhole(fx=800.0, fy=800.0, cx=320.0, cy=240.0)
    eye = dataclasses.replace(body, camera=bk.Camera(body.camera.link, body.camera.link_T_camera, model))
    with pytest.raises(InvalidConfig, match=r"\[px\]"):
        next_postures(eye, None, FACE, 1)
    assert next_postures(eye, None, FACE, 1, noise=0.5).predicted_error[-1] < 1.0
