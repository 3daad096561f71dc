"""The compiled kernels give what Pinocchio gives, for every chain, batch size and angle."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.body import Pinhole
from bodyimage_kin.errors import InvalidArray, InvalidPosture, NotDifferentiable, NotVisible, UnknownName
from bodyimage_kin.robot.transforms import rpy_matrix, transform
from tests.robots import ARM, ONE_JOINT, STATUE, TRICKY

pytest.importorskip("numba")

from bodyimage_kin.backends import _numba_kernels as kernels
from bodyimage_kin.backends.numba_backend import NumbaBackend, _euler_zxz, _z_to

TORSO = """
<robot name="torso">
  <link name="pelvis"/><link name="chest"/><link name="head"/><link name="eye"/><link name="arm"/><link name="hand"/>
  <joint name="waist" type="revolute">
    <parent link="pelvis"/><child link="chest"/><origin xyz="0 0 0.1" rpy="0.1 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="nod" type="revolute">
    <parent link="chest"/><child link="head"/><origin xyz="0.02 0 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-0.4" upper="0.4" effort="1" velocity="1"/>
  </joint>
  <joint name="tilt" type="revolute">
    <parent link="head"/><child link="eye"/><origin xyz="0.05 0.03 0" rpy="0 0.2 0.3"/><axis xyz="1 0 1"/>
    <limit lower="-0.4" upper="0.4" effort="1" velocity="1"/><mimic joint="shoulder" multiplier="0.3" offset="0.05"/>
  </joint>
  <joint name="shoulder" type="revolute">
    <parent link="chest"/><child link="arm"/><origin xyz="0 0.15 0.2"/><axis xyz="1 2 2"/>
    <limit lower="-0.5" upper="0.5" effort="1" velocity="1"/>
  </joint>
  <joint name="reach" type="prismatic">
    <parent link="arm"/><child link="hand"/><origin xyz="0.3 -0.1 0.1" rpy="0.3 0.2 0.1"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.3" effort="1" velocity="1"/>
  </joint>
</robot>"""
"""A waist that carries hand and camera, a neck that carries the camera, a shoulder that moves both."""


def assert_as_pinocchio(robot: bk.Robot, link: str, q: torch.Tensor, tolerance: float = 1e-13) -> None:
    pose, jacobian = NumbaBackend(robot).pose_and_jacobian(q, link)
    true_pose, true_jacobian = bk.kinematics(robot, "pinocchio").pose_and_jacobian(q, link)
    torch.testing.assert_close(pose, true_pose, rtol=0, atol=tolerance)
    torch.testing.assert_close(jacobian, true_jacobian, rtol=0, atol=tolerance)


@pytest.mark.parametrize("text", [TRICKY, ARM, ONE_JOINT, STATUE, TORSO])
def test_every_link_is_where_pinocchio_says_followers_included(text: str) -> None:
    robot = bk.Robot.from_urdf(text)
    for link in robot.link_names:
        assert_as_pinocchio(robot, link, robot.sample(41, seed=3))


def test_the_infant_agrees_on_every_link() -> None:
    robot = bk.load_embodiment("infant").robot
    q = robot.sample(9, seed=1)
    for link in robot.link_names:
        assert_as_pinocchio(robot, link, q)


@pytest.mark.parametrize("seed", range(5))
def test_random_chains_agree(seed: int) -> None:
    random = np.random.default_rng(seed)
    # Fixed rotations that are nearly none, nearly half a turn, quarter turns and anything.
    angles = [0.0, 1e-9, math.pi / 2, math.pi, math.pi - 1e-9, -1e-15]
    links, joints = ['<link name="0"/>'], []
    for i in range(1, 12):
        rpy = [random.choice(angles) if random.random() < 0.7 else random.uniform(-4, 4) for _ in range(3)]
        axis = (
            np.eye(3)[random.integers(3)] * random.choice([-1, 1]) if random.random() < 0.5 else random.normal(size=3)
        )
        kind = random.choice(["continuous", "continuous", "prismatic", "fixed"])
        links.append(f'<link name="{i}"/>')
        joints.append(
            f'<joint name="{i}" type="{kind}"><parent link="{i - 1}"/><child link="{i}"/>'
            f'<origin xyz="{" ".join(map(str, random.normal(size=3)))}" rpy="{" ".join(map(str, rpy))}"/>'
            f'<axis xyz="{" ".join(map(str, axis))}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )
    robot = bk.Robot.from_urdf(f'<robot name="random">{"".join(links + joints)}</robot>')
    reach = 20.0
    assert_as_pinocchio(robot, "11", robot.sample(33, seed=seed), tolerance=1e-13 * reach)


@pytest.mark.parametrize("batch", [0, 1, 7, 8, 9, 31, 32, 33, 65])
def test_a_posture_gives_the_same_bits_in_every_batch(batch: int) -> None:
    robot = bk.Robot.from_urdf(TRICKY)
    backend = NumbaBackend(robot)
    q = robot.sample(batch, seed=2)
    pose, jacobian = backend.pose_and_jacobian(q, "nail")
    assert pose.shape == (batch, 4, 4)
    assert jacobian.shape == (batch, 6, robot.n)
    for index in range(batch):
        one_pose, one_jacobian = backend.pose_and_jacobian(q[index : index + 1], "nail")
        assert torch.equal(one_pose[0], pose[index])
        assert torch.equal(one_jacobian[0], jacobian[index])


def test_threads_give_the_same_bits() -> None:
    robot = bk.Robot.from_urdf(TORSO)
    backend = NumbaBackend(robot)
    q = robot.sample(50_001, seed=4)
    before = torch.get_num_threads()
    results = []
    try:
        for threads in (1, 3):
            torch.set_num_threads(threads)
            results.append(backend.pose_and_jacobian(q, "hand"))
    finally:
        torch.set_num_threads(before)
    assert torch.equal(results[0][0], results[1][0])
    assert torch.equal(results[0][1], results[1][1])


def angles() -> np.ndarray:
    random = np.random.default_rng(0)
    near = np.arange(-64, 65) * (math.pi / 4)
    return np.concatenate(
        [random.uniform(-7, 7, 4000), random.uniform(-1.6e6, 1.6e6, 4000), random.uniform(-1e14, 1e14, 100), near]
        + [np.nextafter(near, sign * np.inf) for sign in (-1, 1)]
        + [[1e6, -1.6e6, 1.6e6 + 1, 1e22, 0.0, 5e-324]]
    )


def test_sines_are_right_to_one_unit_in_the_last_place_at_any_angle() -> None:
    robot = bk.Robot.from_urdf(ONE_JOINT)
    q = angles()
    pose, _ = NumbaBackend(robot).pose_and_jacobian(torch.from_numpy(q[:, None]), "leaf")
    exact = q.astype(np.longdouble)
    np.testing.assert_allclose(pose[:, 1, 0].numpy(), np.sin(exact).astype(np.float64), rtol=0, atol=2**-53 * 1.01)
    np.testing.assert_allclose(pose[:, 0, 0].numpy(), np.cos(exact).astype(np.float64), rtol=0, atol=2**-53 * 1.01)


def test_angles_of_a_million_radians_keep_their_digits_behind_fixed_turns() -> None:
    robot = bk.Robot.from_urdf(ARM.replace('xyz="0.2 0 0"', 'xyz="0.2 0 0" rpy="0 0 1.234"'))
    q = torch.tensor([[1e6 + 0.123, -1e6 + 0.4]])
    assert_as_pinocchio(robot, "hand", q.double(), tolerance=1e-15)


def test_postures_that_are_not_finite_are_refused_and_spoil_only_themselves() -> None:
    robot = bk.Robot.from_urdf(ARM)
    q = robot.sample(70)
    q[3, 0], q[5, 1], q[66, 1] = math.nan, math.inf, -math.inf
    out = torch.zeros(70, 4, 4).double(), torch.zeros(70, 6, 2).double()
    for link in ("hand", "base"):
        with pytest.raises(InvalidPosture, match="in 3 of 70 postures"):
            NumbaBackend(robot).pose_and_jacobian(q, link, out=out)
        finite = out[0].isfinite().flatten(1).all(1) & out[1].isfinite().flatten(1).all(1)
        assert finite.tolist() == [link == "base" or index not in (3, 5, 66) for index in range(70)]
    with pytest.raises(InvalidPosture, match="in 3 of 70 postures"):
        NumbaBackend(robot).hand_image("hand", [0.0] * 3, "base", np.eye(4), [0.04]).image_and_jacobian(q)


def test_out_is_written_in_place_and_refused_when_it_cannot_hold_the_result() -> None:
    robot = bk.Robot.from_urdf(TRICKY)
    backend = NumbaBackend(robot)
    q = robot.sample(10)
    n = robot.n
    out = torch.full((10, 4, 4), math.nan).double(), torch.full((10, 6, n), math.nan).double()
    given = backend.pose_and_jacobian(q, "tip", out=out)
    assert given[0] is out[0]
    assert given[1] is out[1]
    fresh = backend.pose_and_jacobian(q, "tip")
    assert torch.equal(out[0], fresh[0])
    assert torch.equal(out[1], fresh[1])
    apart = torch.zeros(10, n, 6, dtype=torch.float64).transpose(1, 2)
    with pytest.raises(InvalidArray, match=r"contiguous float64 tensors of shapes \(10, 4, 4\)"):
        backend.pose_and_jacobian(q, "tip", out=(out[0], apart))


def test_what_the_kernels_would_misread_is_refused() -> None:
    backend = NumbaBackend(bk.Robot.from_urdf(ARM))
    with pytest.raises(InvalidPosture, match=r"take float64 \(batch, 2\)"):
        backend.pose_and_jacobian(torch.zeros(4, 3, dtype=torch.float64), "hand")
    with pytest.raises(NotDifferentiable, match="keep no gradient"):
        backend.pose_and_jacobian(torch.zeros(4, 2, dtype=torch.float64, requires_grad=True), "hand")
    with pytest.raises(UnknownName, match="hnad"):
        backend.pose_and_jacobian(torch.zeros(4, 2, dtype=torch.float64), "hnad")


def test_results_do_not_share_memory() -> None:
    robot = bk.Robot.from_urdf(ARM)
    backend = NumbaBackend(robot)
    q = robot.sample(3)
    first = backend.pose_and_jacobian(q, "hand")[1]
    copy = first.clone()
    backend.pose_and_jacobian(q + 1.0, "hand")
    assert torch.equal(first, copy)


@pytest.mark.parametrize("tilt", [0.0, 1e-300, 1e-16, 1e-12, 1e-9, 1e-4, 1.0, math.pi / 2, math.pi - 1e-9, math.pi])
def test_three_turns_make_up_any_rotation(tilt: float) -> None:
    for seed in range(20):
        spin, twist = np.random.default_rng(seed).uniform(-4, 4, 2).tolist()
        rotation = rpy_matrix((0.0, 0.0, spin)) @ rpy_matrix((tilt, 0.0, 0.0)) @ rpy_matrix((0.0, 0.0, twist))
        a, b, c = np.angle(_euler_zxz(rotation)).tolist()
        again = rpy_matrix((0.0, 0.0, a)) @ rpy_matrix((b, 0.0, 0.0)) @ rpy_matrix((0.0, 0.0, c))
        np.testing.assert_allclose(again, rotation, rtol=0, atol=1e-15)


def test_axes_are_turned_onto_z() -> None:
    for axis in [*np.eye(3), *-np.eye(3), (1.0, 2.0, -2.0), (1e-9, 0.0, 1.0)]:
        rotation = _z_to(tuple(axis))
        np.testing.assert_allclose(rotation[:, 2], np.array(axis) / np.linalg.norm(axis), rtol=0, atol=1e-16)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), rtol=0, atol=1e-15)
        assert np.linalg.det(rotation) > 0


LINK_T_CAMERA = transform(rpy_matrix((-math.pi / 2 + 0.1, 0.0, -math.pi / 2 + 0.2)), (0.01, 0.02, 0.03))
OFFSET = np.array([0.02, -0.03, 0.05])


def point_by_formula(
    robot: bk.Robot, q: torch.Tensor, camera_link: str, offsets: np.ndarray = OFFSET
) -> tuple[np.ndarray, np.ndarray]:
    """The hand in the camera's axes and its derivative, as they stand, from Pinocchio's poses and Jacobians."""
    kin = bk.kinematics(robot, "pinocchio")
    (hand, hand_J), (carrier, carrier_J) = (
        tuple(part.numpy() for part in kin.pose_and_jacobian(q, link)) for link in ("hand", camera_link)
    )
    camera = carrier @ LINK_T_CAMERA
    R = camera[:, :3, :3].transpose(0, 2, 1)

    def at(pose: np.ndarray, J: np.ndarray, point: np.ndarray) -> np.ndarray:
        return J[:, :3] + np.cross(J[:, 3:], (point - pose[:, :3, 3])[:, :, None], axis=1)

    p = hand[:, :3, 3] + np.einsum("bij,bj->bi", hand[:, :3, :3], np.broadcast_to(offsets, (len(q), 3)))
    # The camera's body extended to the hand: its velocity there is v_c + w_c x (p_h - p_c).
    c = (R @ (p - camera[:, :3, 3])[:, :, None])[..., 0]
    return c, R @ (at(hand, hand_J, p) - at(carrier, carrier_J, p))


def image_by_formula(robot: bk.Robot, q: torch.Tensor, camera_link: str) -> tuple[np.ndarray, ...]:
    """Equations 17 to 19 and their derivative."""
    c, dc = point_by_formula(robot, q, camera_link)
    x, y, z = c.T
    zero, one = np.zeros_like(z), np.ones_like(z)
    A = np.array([[one, zero, -x / z], [zero, one, -y / z]]).transpose(2, 0, 1) * (0.04 / z)[:, None, None]
    return 0.04 * c[:, :2] / z[:, None], z, A @ dc


@pytest.mark.parametrize("camera_link", ["eye", "head", "chest", "pelvis", "arm"])
def test_image_and_jacobian_are_the_formulas_wherever_the_camera_sits(camera_link: str) -> None:
    robot = bk.Robot.from_urdf(TORSO)
    hand_image = NumbaBackend(robot).hand_image("hand", OFFSET.tolist(), camera_link, LINK_T_CAMERA, [0.04])
    q = robot.sample(200, seed=5)
    image, depth, jacobian = (part.numpy() for part in hand_image.image_and_jacobian(q))
    true_image, true_depth, true_jacobian = image_by_formula(robot, q, camera_link)
    np.testing.assert_allclose(depth, true_depth, rtol=0, atol=1e-14)
    assert (true_depth > 0.05).sum() > 20, "the camera has to see something in this test"
    seen = true_depth > 0.05
    np.testing.assert_allclose(image[seen], true_image[seen], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(jacobian[seen], true_jacobian[seen], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("camera_link", ["eye", "head", "chest", "pelvis", "arm"])
@pytest.mark.parametrize("varied", [False, True])
def test_other_cameras_get_the_point_or_project_it_by_opencvs_formulas(camera_link: str, varied: bool) -> None:
    robot = bk.Robot.from_urdf(TORSO)
    q = robot.sample(200, seed=5)
    offsets = np.random.default_rng(0).uniform(-0.05, 0.05, (200, 3)) if varied else OFFSET
    each = torch.from_numpy(offsets) if varied else None
    point, moved = point_by_formula(robot, q, camera_link, offsets)
    backend, hand = NumbaBackend(robot), ("hand", OFFSET.tolist(), camera_link, LINK_T_CAMERA)
    found, depth, jacobian = backend.hand_image(*hand, []).image_and_jacobian(q, offsets=each)
    np.testing.assert_allclose(found, point, rtol=0, atol=1e-14)
    np.testing.assert_allclose(depth, point[:, 2], rtol=0, atol=1e-14)
    np.testing.assert_allclose(jacobian, moved, rtol=0, atol=1e-13)
    lens = Pinhole(615.0, 620.0, 322.5, 238.0, distortion=(-0.28, 0.09, 1.1e-3, -0.6e-3, -0.013))
    seen, _, jacobian = backend.hand_image(
        *hand, [lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion, lens.fold**2]
    ).image_and_jacobian(q, offsets=each)
    true = lens.project(torch.from_numpy(point))
    slope = lens.derivative(torch.from_numpy(point)) @ torch.from_numpy(moved)
    torch.testing.assert_close(seen, true, rtol=1e-12, atol=1e-9, equal_nan=True)
    there = ~true.isnan().any(1)
    assert int(there.sum()) > 20, "the camera has to see something in this test"
    torch.testing.assert_close(jacobian[there], slope[there], rtol=1e-11, atol=1e-9)


def test_what_carries_hand_and_camera_alike_does_not_move_the_image() -> None:
    robot = bk.Robot.from_urdf(TORSO)
    hand_image = NumbaBackend(robot).hand_image("hand", (0.0, 0.0, 0.0), "head", LINK_T_CAMERA, [0.04])
    jacobian = hand_image.image_and_jacobian(robot.sample(5))[2]
    assert (jacobian[..., robot.joint_index("waist")] == 0.0).all()


def test_image_columns_are_those_asked_for_in_that_order() -> None:
    robot = bk.Robot.from_urdf(TORSO)
    backend = NumbaBackend(robot)
    q = robot.sample(70)
    every = backend.hand_image("hand", OFFSET.tolist(), "eye", LINK_T_CAMERA, [0.04]).image_and_jacobian(q)
    columns = [3, 1]
    some = backend.hand_image("hand", OFFSET.tolist(), "eye", LINK_T_CAMERA, [0.04], columns)
    out = torch.zeros(70, 2).double(), torch.zeros(70).double(), torch.zeros(70, 2, 2).double()
    some.image_and_jacobian(q, out=out)
    assert torch.equal(out[0], every[0])
    assert torch.equal(out[1], every[1])
    assert torch.equal(out[2], every[2][..., columns])


@pytest.mark.parametrize("batch", [0, 1, 7, 8, 33, 70])
@pytest.mark.parametrize("link", ["nail", "gripper", "slide", "world"])
@pytest.mark.parametrize("parts", [(1.0, 1.0), (1.0, 0.0), (0.0, 1.0)])
def test_the_compiled_gradient_is_that_of_the_formulas(batch: int, link: str, parts: tuple[float, float]) -> None:
    robot = bk.Robot.from_urdf(TRICKY)
    q = robot.sample(batch, seed=6).requires_grad_()
    generator = torch.Generator().manual_seed(1)
    weights = [torch.randn(batch, *shape, generator=generator).double() for shape in ((4, 4), (6, robot.n))]

    def gradient(backend: str, create_graph: bool) -> torch.Tensor:
        values = bk.kinematics(robot, backend).pose_and_jacobian(q, link)
        chosen = [(v * w).sum() for v, w, part in zip(values, weights, parts, strict=True) if part]
        return torch.autograd.grad(sum(chosen), q, create_graph=create_graph)[0]

    expected = gradient("pinocchio", create_graph=False)
    torch.testing.assert_close(gradient("numba", create_graph=False), expected, rtol=0, atol=1e-13)
    torch.testing.assert_close(gradient("numba", create_graph=True), expected, rtol=0, atol=1e-13)


def test_the_compiled_gradient_is_used_when_nobody_differentiates_it(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = bk.Robot.from_urdf(ARM)
    kin = bk.kinematics(robot, "numba")
    used = []
    monkeypatch.setattr(kernels, "gradient", lambda *arguments: used.append(arguments[-1].fill(0.0)))
    q = robot.sample(3).requires_grad_()
    kin.pose(q, "hand").sum().backward()
    assert len(used) == 1
    torch.autograd.grad(kin.pose(q, "hand").sum(), q, create_graph=True)
    torch.func.grad(lambda x: kin.pose(x, "hand").sum())(q.detach())
    assert len(used) == 1


def test_out_goes_through_the_shared_code_and_back() -> None:
    robot = bk.Robot.from_urdf(TRICKY)
    for backend in ("numba", "pinocchio", "torch"):
        kin = bk.kinematics(robot, backend)
        for batch, dtype in (
            ((), torch.float64),
            ((2, 3), torch.float64),
            ((0,), torch.float64),
            ((4,), torch.float32),
        ):
            q = robot.sample(batch, seed=7).to(dtype)
            out = torch.full((*batch, 4, 4), math.nan, dtype=dtype), torch.full((*batch, 6, 4), math.nan, dtype=dtype)
            given = kin.pose_and_jacobian(q, "nail", out=out)
            for one, other, expected in zip(given, out, kin.pose_and_jacobian(q, "nail"), strict=True):
                assert one is other
                assert torch.equal(one, expected)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda pose, jacobian: (pose, jacobian[:2]),
        lambda pose, jacobian: (pose.float(), jacobian),
        lambda pose, jacobian: (pose, jacobian.mT.contiguous().mT),
        lambda pose, jacobian: (pose.requires_grad_(), jacobian),
        lambda pose, _: (pose,),
        lambda pose, _: pose,
        lambda pose, jacobian: (pose.numpy(), jacobian.numpy()),
    ],
)
def test_out_that_cannot_hold_the_result_is_refused(spoil) -> None:
    robot = bk.Robot.from_urdf(TRICKY)
    kin = bk.kinematics(robot)
    out = torch.zeros(3, 4, 4, dtype=torch.float64), torch.zeros(3, 6, 4, dtype=torch.float64)
    with pytest.raises(InvalidArray, match=r"contiguous tensors of shapes \(3, 4, 4\) and \(3, 6, 4\)"):
        kin.pose_and_jacobian(robot.sample(3), "nail", out=spoil(*out))


def test_out_carries_no_gradient_and_says_so() -> None:
    robot = bk.Robot.from_urdf(ARM)
    kin = bk.kinematics(robot)
    out = torch.zeros(3, 4, 4, dtype=torch.float64), torch.zeros(3, 6, 2, dtype=torch.float64)
    q = robot.sample(3).requires_grad_()
    with pytest.raises(NotDifferentiable, match=r"give q\.detach"):
        kin.pose_and_jacobian(q, "hand", out=out)
    with torch.no_grad():
        kin.pose_and_jacobian(q, "hand", out=out)
    assert torch.equal(out[0], kin.pose(q.detach(), "hand"))


def test_what_the_hand_looks_like_is_what_the_formulas_say(body: bk.Embodiment) -> None:
    plain = bk.load_embodiment("infant", backend="pinocchio")
    assert body.kinematics.name == "numba"
    q = plain.touch_postures([0, 100, 220, 440], distance=0.03).reshape(2, 2, -1)
    for dtype, tolerance in ((torch.float64, 1e-14), (torch.float32, 1e-7)):
        for function in ("hand_image", "hand_image_jacobian"):
            actual, expected = (getattr(each, function)(q.to(dtype)) for each in (body, plain))
            torch.testing.assert_close(actual, expected, rtol=0, atol=tolerance)
    everywhere = body.felt_robot.sample(300)
    seen = body.hand_image(everywhere, on_invisible="nan")
    torch.testing.assert_close(
        seen, plain.hand_image(everywhere, on_invisible="nan"), rtol=1e-9, atol=1e-12, equal_nan=True
    )
    assert 0 < int(seen.isnan().any(-1).sum()) < 300
    for function in (body.hand_image, body.hand_image_jacobian):
        with pytest.raises(NotVisible, match=r"in \d+ of 300 postures"):
            function(everywhere)
        with pytest.raises(InvalidPosture, match="1 of 1"):
            function(torch.full((body.p,), math.nan, dtype=torch.float64))
        assert torch.autograd.gradcheck(function, q[0].clone().requires_grad_())


@pytest.mark.slow
def test_compiling_is_announced_once_and_kept(tmp_path: Path) -> None:
    code = (
        "import bodyimage_kin as bk; body = bk.load_embodiment('infant', backend='numba'); "
        "q = body.felt_home[None]; body.hand_image_jacobian(q); body.kinematics.pose(q.requires_grad_(), "
        "body.hand.link).sum().backward()"
    )
    said = []
    for _ in range(2):
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
        done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
        said.append(done.stderr)
    assert said[0].count("compiling for this") == 1
    assert said[1] == ""
