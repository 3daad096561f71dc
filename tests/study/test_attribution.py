"""Each part of the attributed error is moved by an intervention of its own, on the infant itself."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.body.file import embodiment_folder
from bodyimage_kin.study.scores import PARTS


@pytest.fixture(scope="module")
def seen():
    return bk.simulate(bk.load_embodiment("infant"), bk.motions.Circle(), seed=3)


@pytest.fixture(scope="module")
def use(body):
    touch = bk.simulate(body, bk.motions.RandomTouch(duration=40.0), seed=3)
    return np.diff(touch.q.values[0], axis=0)


@pytest.fixture(scope="module")
def body():
    return bk.load_embodiment("infant")


def attributed(body, jacobian, train, use, taxels=None):
    excitation = metrics.excitation(train, use)
    q = body.touch_postures(np.arange(body.skin.count))
    true = body.hand_image_jacobian(q).numpy()
    found = metrics.attribute(true, np.broadcast_to(jacobian, true.shape), excitation.motion_metric, excitation)
    total = metrics.pooled_relative_error(true, np.broadcast_to(jacobian, true.shape), excitation.motion_metric)
    assert found.total == pytest.approx(total**2, abs=1e-10)
    return found


def least_squares(dq, dr):
    return np.linalg.lstsq(dq, dr, rcond=1e-9)[0].T


@pytest.fixture(scope="module")
def steps(seen):
    data = bk.estimators.pairs(bk.experience(seen))
    return data.dq.numpy(), data.dr.numpy()


def test_scaling_the_jacobian_moves_the_scale_alone(body, steps, use):
    dq, dr = steps
    jacobian = least_squares(dq, dr)
    before, after = (attributed(body, factor * jacobian, dq, use) for factor in (1.0, 0.5))
    assert after.scale > before.scale + 0.1
    for part in ("mean_excited", "mean_unexcited", "variation"):
        assert getattr(after, part) == pytest.approx(getattr(before, part), abs=1e-10)


@pytest.mark.parametrize("joint", range(5))
def test_silencing_a_joint_moves_the_unexcited_part(body, steps, use, joint):
    dq, _ = steps
    q = body.touch_postures(np.arange(body.skin.count))
    mean = body.hand_image_jacobian(q).numpy().mean(0)
    # The best constant Jacobian is learned without a flaw from displacements that it makes itself.
    whole = attributed(body, least_squares(dq, dq @ mean.T), use, use)
    assert whole.mean_excited + whole.mean_unexcited + whole.scale < 0.02
    silent = dq.copy()
    silent[:, joint] = 0.0
    train = use.copy()
    train[:, joint] = 0.0
    deaf = attributed(body, least_squares(silent, silent @ mean.T), train, use)
    # A column less is a smaller Jacobian as well, and so moves the one scale that is split off first.
    gained = {part: getattr(deaf, part) - getattr(whole, part) for part in PARTS if part != "scale"}
    assert max(gained, key=gained.__getitem__) == "mean_unexcited"
    assert gained["mean_unexcited"] > 1e-4
    assert gained["variation"] == pytest.approx(0.0, abs=1e-10)


def test_widening_the_face_moves_the_variation_most(body, steps, use, tmp_path):
    source = (embodiment_folder() / "infant.toml").read_text()
    (tmp_path / "infant.urdf").write_bytes(body.robot.source)
    (tmp_path / "narrow.toml").write_text(source.replace("size = [0.06, 0.06]", "size = [0.02, 0.02]"))
    jacobian = least_squares(*steps)
    narrow = attributed(bk.load_embodiment(tmp_path / "narrow.toml"), jacobian, steps[0], use)
    wide = attributed(body, jacobian, steps[0], use)
    gained = {
        part: getattr(wide, part) - getattr(narrow, part) for part in ("mean_excited", "mean_unexcited", "variation")
    }
    assert max(gained, key=gained.__getitem__) == "variation"
    assert wide.variation > 3 * narrow.variation


def test_the_true_jacobian_has_no_part(body, use):
    q = body.touch_postures(np.arange(body.skin.count))
    true = body.hand_image_jacobian(q)
    excitation = metrics.excitation(use, use)
    found = metrics.attribute(true, true, excitation.motion_metric, excitation)
    assert found.total < 1e-20
    assert torch.is_tensor(true)
