"""The image Jacobian of a camera that moves, with every backend and model, against images computed without them.

The images come from the conformance oracle's poses of the whole robot, in plain numpy; their derivative by differences.
The oracle of studies, Pinocchio, has no compiled engine for images: it takes the path that is written out in torch.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.body import Camera, Embodiment, Stereo, Tracker, VirtualScreen
from bodyimage_kin.body.file import embodiment_folder
from bodyimage_kin.robot import transforms
from bodyimage_kin.testing import Case, RobotSpec, oracle

ARM = ("left_shoulder_pitch", "left_elbow")
# Apart from each other and turned, so that no term of one is a term of the other.
BETWEEN = transforms.transform(transforms.rpy_matrix((0.02, -0.3, 0.1)), (0.06, 0.01, -0.02))
MODELS = {
    "screen": VirtualScreen(0.04),
    "stereo": Stereo(VirtualScreen(0.04), VirtualScreen(0.07), torch.from_numpy(BETWEEN)),
    "tracker": Tracker(),
}
# Carried by a joint that moves nothing else, by one that moves the hand as much, by another arm.
MOUNTS = {
    "neck": ("head", (*ARM, "neck")),
    "own shoulder": ("left_shoulder_pitch_link", (*ARM, "left_shoulder_roll")),
    "other arm": ("right_forearm", (*ARM, "right_shoulder_roll", "right_elbow")),
}


def seen_by_hand(model: object, point: np.ndarray) -> np.ndarray:
    """The image of a point in the camera's axes, by the definition of each model."""
    if isinstance(model, Tracker):
        return point
    if isinstance(model, Stereo):
        turn, away = np.asarray(model.left_T_right)[:3, :3], np.asarray(model.left_T_right)[:3, 3]
        return np.concatenate([seen_by_hand(model.left, point), seen_by_hand(model.right, turn.T @ (point - away))])
    assert isinstance(model, VirtualScreen)
    return model.distance * point[:2] / point[2]


def image_by_hand(body: Embodiment) -> Callable[[np.ndarray], np.ndarray]:
    """The hand image of a posture, from poses of the whole robot by the conformance oracle."""
    spec = RobotSpec.from_robot(body.robot)
    mount = np.asarray(body.camera.link_T_camera)

    def pose(q: np.ndarray, link: str) -> np.ndarray:
        full = body.full_posture(torch.from_numpy(q)).tolist()
        return oracle(Case(spec, tuple(full), link)).pose

    def image(q: np.ndarray) -> np.ndarray:
        hand = pose(q, body.hand.link) @ np.array([*body.hand.offset.tolist(), 1.0])
        return seen_by_hand(body.camera.model, np.linalg.solve(pose(q, body.camera.link) @ mount, hand)[:3])

    return image


def derivative(image: Callable[[np.ndarray], np.ndarray], q: np.ndarray, step: float = 1e-3) -> np.ndarray:
    columns = []
    for one in step * np.eye(len(q)):
        near, far = image(q + one) - image(q - one), image(q + 2 * one) - image(q - 2 * one)
        columns.append((8.0 * near - far) / (12.0 * step))
    return np.stack(columns, axis=-1)


@pytest.fixture(scope="module")
def infants(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Embodiment]:
    """The infant feeling other joints, its hand's point off every axis."""
    text = (embodiment_folder() / "infant.toml").read_text()
    before, _, after = text.partition('joints = ["left_shoulder_pitch"')
    after = after.partition("\n")[2].replace("offset = [0.0, 0.0, 0.0]", "offset = [0.013, -0.021, 0.034]")
    before = before.replace('urdf = "infant.urdf"', f'urdf = "{(embodiment_folder() / "infant.urdf").resolve()}"')
    bodies = {}
    for name, (_, joints) in MOUNTS.items():
        file = tmp_path_factory.mktemp("infants") / "infant.toml"
        file.write_text(f"{before}joints = {list(joints)}\n{after}".replace("'", '"'))
        bodies[name] = bk.load_embodiment(file)
    return bodies


def facing(body: Embodiment, link: str, model: object) -> Embodiment:
    """The body with an eye on a link, some way from its origin, that looks about at the hand when at home."""
    pose = body.kinematics.pose(body.felt_home, link).numpy()
    hand = body.hand_position(body.felt_home).numpy()
    eye = pose[:3, :3] @ np.array([0.05, -0.04, 0.09]) + pose[:3, 3]
    forward = (hand - eye) / np.linalg.norm(hand - eye)
    right = np.cross(forward, [0.3, 0.2, 0.9])
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(forward, right), forward], axis=1) @ transforms.rpy_matrix((0.2, -0.15, 0.4))
    mount = np.linalg.solve(pose, transforms.transform(turn, eye))
    return dataclasses.replace(body, camera=Camera(link, torch.from_numpy(mount), model))


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("backend", ["pinocchio", "mujoco", "numba"])
def test_the_image_jacobian_is_the_derivative_of_what_is_seen(
    infants: dict[str, Embodiment], backend: str, mount: str, model: str
) -> None:
    body = facing(infants[mount], MOUNTS[mount][0], MODELS[model])
    body = dataclasses.replace(body, kinematics=bk.kinematics(body.felt_robot, backend))
    image = image_by_hand(body)
    away = np.random.default_rng(3).uniform(-0.2, 0.2, (3, body.p))
    postures = body.felt_home.numpy() + away
    images = body.hand_image(postures).numpy()
    jacobians = body.hand_image_jacobian(postures).numpy()
    assert jacobians.shape == (3, body.m, body.p)
    for q, seen, found in zip(postures, images, jacobians, strict=True):
        np.testing.assert_allclose(seen, image(q), rtol=0, atol=1e-13)
        expected = derivative(image, q)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * max(1.0, np.abs(expected).max()))
        # The shoulder that carries both moves neither as seen by the other; every other joint counts.
        moved = np.abs(expected).max(axis=0) > 1e-3
        assert moved.tolist() == [mount != "own shoulder" or name != ARM[0] for name in body.joints]
