"""Laws of kinematics, held by every backend and between them."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import ARM, ONE_JOINT, STATUE, TRICKY, central, infant, kinematics, postures, tricky

import bodyimage_kin as bk
from bodyimage_kin.errors import (
    InvalidArray,
    InvalidConfig,
    InvalidPosture,
    MissingDependency,
    NotDifferentiable,
    UnknownName,
    UnsupportedDevice,
)

BACKENDS = ("pinocchio", "pytorch_kinematics", "numba", "torch", "mujoco")
REFERENCES = ("local_world_aligned", "local", "world")
MAKERS = [infant, tricky]
# torch 2.13 warns of itself in forward mode.
FORWARD_MODE = pytest.mark.filterwarnings("ignore:.torch.jit.script. is deprecated:DeprecationWarning")
BATCHES = [(), (1,), (3,), (0,), (0, 3), (2, 0, 4), (2, 3), (3, 1, 2)]


def close(actual, expected, tolerance):
    """Relative to the scale of what is compared."""
    scale = max(1.0, float(expected.abs().max())) if expected.numel() else 1.0
    torch.testing.assert_close(actual, expected, atol=tolerance * scale, rtol=0)


def rotation_rate(rotation, derivative):
    """Angular velocities w with dR = [w]x R, one for each joint: (3, n)."""
    turn = torch.einsum("ijk,lj->ilk", derivative, rotation)
    return torch.stack([turn[2, 1], turn[0, 2], turn[1, 0]])


# Between backends -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("backend", BACKENDS[1:])
def test_backends_agree_on_every_link(make, backend):
    robot = make()
    one, other = (kinematics(make, name) for name in (BACKENDS[0], backend))
    q = torch.cat([robot.sample(6, seed=0), torch.zeros(1, robot.n), robot.upper.clamp(max=100.0)[None]])
    for link in robot.link_names:
        close(other.pose(q, link), one.pose(q, link), 1e-12)
        for reference in REFERENCES:
            close(other.jacobian(q, link, reference), one.jacobian(q, link, reference), 1e-12)
        close(other.hessian(q, link), one.hessian(q, link), 1e-12)


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("backend", BACKENDS[1:])
@given(data=st.data())
@settings(max_examples=40)
def test_backends_agree_with_each_other_and_with_differences(make, backend, data):
    robot = make()
    q = data.draw(postures(robot), label="q")
    link = data.draw(st.sampled_from(robot.link_names), label="link")
    batch = data.draw(st.sampled_from(BATCHES), label="batch")
    reference = data.draw(st.sampled_from(REFERENCES), label="reference")
    one, other = (kinematics(make, name) for name in (BACKENDS[0], backend))
    pose, jacobian = one.pose_and_jacobian(q, link)
    many = q.expand(*batch, robot.n)
    close(one.pose(many, link), pose.expand(*batch, 4, 4), 1e-15)
    close(other.pose(many, link), pose.expand(*batch, 4, 4), 1e-12)
    close(other.jacobian(many, link), jacobian.expand(*batch, 6, robot.n), 1e-12)
    close(other.jacobian(many, link, reference), one.jacobian(many, link, reference), 1e-12)
    slope = central(lambda x: one.pose(x, link), q)
    close(jacobian[:3], slope[:3, 3], 1e-9)
    close(jacobian[3:], rotation_rate(pose[:3, :3], slope[:3, :3]), 1e-9)
    close(one.hessian(q, link), central(lambda x: one.jacobian(x, link), q), 1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("make", MAKERS)
def test_a_pose_is_a_rigid_motion_and_the_root_stays(make, backend):
    robot, kin = make(), kinematics(make, backend)
    q = robot.sample(5)
    for link in robot.link_names:
        pose = kin.pose(q, link)
        close(pose[:, :3, :3] @ pose[:, :3, :3].mT, torch.eye(3, dtype=q.dtype).expand(5, 3, 3), 1e-14)
        assert torch.equal(pose[:, 3], torch.tensor([[0.0, 0.0, 0.0, 1.0]], dtype=q.dtype).expand(5, 4))
    assert torch.equal(kin.pose(q, robot.root), torch.eye(4, dtype=q.dtype).expand(5, 4, 4))
    assert torch.equal(kin.jacobian(q, robot.root), torch.zeros(5, 6, robot.n, dtype=q.dtype))


# By hand --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_planar_arm_by_hand(backend):
    kin = bk.kinematics(bk.Robot.from_urdf(ARM), backend)
    a, b = 0.4, 0.9
    c, s, cc, ss = math.cos(a), math.sin(a), math.cos(a + b), math.sin(a + b)
    x, y = 0.3 * c + 0.2 * cc, 0.3 * s + 0.2 * ss
    pose = [[cc, -ss, 0, x], [ss, cc, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]]
    aligned = [[-y, -0.2 * ss], [x, 0.2 * cc], [0, 0], [0, 0], [0, 0], [1, 1]]
    # In the hand's own axes, forearm along x: the elbow moves it sideways alone.
    local = [[0.3 * math.sin(b), 0], [0.2 + 0.3 * math.cos(b), 0.2], [0, 0], [0, 0], [0, 0], [1, 1]]
    # What stands at the root's origin, carried by the elbow, moves about (0.3 c, 0.3 s).
    world = [[0, 0.3 * s], [0, -0.3 * c], [0, 0], [0, 0], [0, 0], [1, 1]]
    exact = {"atol": 1e-15, "rtol": 0}
    torch.testing.assert_close(kin.pose([a, b], "hand"), torch.tensor(pose, dtype=torch.float64), **exact)
    for reference, expected in zip(REFERENCES, (aligned, local, world), strict=True):
        actual = kin.jacobian([a, b], "hand", reference)
        torch.testing.assert_close(actual, torch.tensor(expected, dtype=torch.float64), **exact)
    hessian = torch.zeros(6, 2, 2, dtype=torch.float64)
    hessian[0] = torch.tensor([[-x, -0.2 * cc], [-0.2 * cc, -0.2 * cc]], dtype=torch.float64)
    hessian[1] = torch.tensor([[-y, -0.2 * ss], [-0.2 * ss, -0.2 * ss]], dtype=torch.float64)
    torch.testing.assert_close(kin.hessian([a, b], "hand"), hessian, **exact)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_angular_hessian_knows_which_joint_comes_first(backend):
    # d w_i / d q_k is w_k x w_i for k before i on the path, and zero for k at or after it: not symmetric.
    robot = tricky().unfolded
    kin = bk.kinematics(robot, backend)
    q = robot.sample((), seed=4)
    turning, angular = kin.jacobian(q, "tip")[3:], kin.hessian(q, "tip")[3:]
    first, last = robot.joint_index("base"), robot.joint_index("end")
    expected = torch.linalg.cross(turning[:, first], turning[:, last])
    close(angular[:, last, first], expected, 1e-15)
    assert not angular[:, first, last].any()
    assert not angular[:, first, first].any()


@pytest.mark.parametrize("backend", BACKENDS)
def test_followers_move_with_what_they_follow(backend):
    robot = tricky()
    kin, free = bk.kinematics(robot, backend), bk.kinematics(robot.unfolded, backend)
    matrix, offset = robot.folding
    q = robot.sample((4,), seed=2)
    unfolded = q @ matrix.T + offset
    for link in robot.link_names:
        close(kin.pose(q, link), free.pose(unfolded, link), 1e-14)
        close(kin.jacobian(q, link), free.jacobian(unfolded, link) @ matrix, 1e-14)
    # A sliding follower: 0.1 m/rad along the axis of its link.
    along = kin.pose(q, "gripper")[:, :3, 2]
    close(kin.jacobian(q, "gripper")[:, :3, robot.joint_index("alpha")], 0.1 * along, 1e-14)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_continuous_joint_is_one_angle(backend):
    robot = tricky()
    kin = bk.kinematics(robot, backend)
    q = robot.sample(5, seed=1)
    turned = q + torch.tensor([2 * math.pi, 0.0, 0.0, 0.0], dtype=torch.float64)
    close(kin.pose(turned, "tip"), kin.pose(q, "tip"), 1e-14)
    assert kin.jacobian(q, "zulu").shape == (5, 6, 4)
    assert kin.jacobian(q, "zulu")[:, 3:, 0].norm(dim=1) == pytest.approx(1.0)


@pytest.mark.parametrize("backend", BACKENDS)
def test_one_joint_and_none(backend):
    door = bk.kinematics(bk.Robot.from_urdf(ONE_JOINT), backend)
    assert door.jacobian([0.3], "leaf").tolist() == [[0.0], [0.0], [0.0], [0.0], [0.0], [1.0]]
    assert door.jacobian([[0.3]], "frame").shape == (1, 6, 1)
    statue = bk.kinematics(bk.Robot.from_urdf(STATUE), backend)
    for batch in BATCHES:
        q = torch.zeros(*batch, 0, dtype=torch.float64)
        pose, jacobian = statue.pose_and_jacobian(q, "head")
        assert (pose.shape, jacobian.shape) == ((*batch, 4, 4), (*batch, 6, 0))
        assert statue.hessian(q, "head").shape == (*batch, 6, 0, 0)
    assert statue.pose([], "head")[:3, 3].tolist() == [0.0, 0.0, 1.0]


# Shapes, dtypes, derivatives ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("batch", BATCHES)
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("make", MAKERS)
def test_every_batch_shape_is_that_many_single_postures(make, backend, batch):
    robot, kin = make(), kinematics(make, backend)
    link = robot.link_names[-1]
    q = robot.sample(batch)
    outputs = (kin.pose(q, link), *(kin.jacobian(q, link, r) for r in REFERENCES), kin.hessian(q, link))
    for output, tail in zip(outputs, [(4, 4), *[(6, robot.n)] * 3, (6, robot.n, robot.n)], strict=True):
        assert output.shape == batch + tail
        assert output.dtype == torch.float64
    for index in np.ndindex(batch):
        close(outputs[0][index], kin.pose(q[index], link), 1e-15)
        close(outputs[1][index], kin.jacobian(q[index], link), 1e-15)
        close(outputs[4][index], kin.hessian(q[index], link), 1e-15)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("make", MAKERS)
def test_float32_goes_in_and_comes_out(make, backend):
    robot, kin = make(), kinematics(make, backend)
    q = robot.sample((4,)).to(torch.float32)
    for link in robot.link_names:
        for function in (kin.pose, kin.jacobian, kin.hessian):
            single = function(q, link)
            assert single.dtype == torch.float32
            close(single.double(), function(q.double(), link), 5e-7)


@pytest.mark.parametrize("backend", BACKENDS)
def test_tensors_arrays_and_lists_are_the_same(backend):
    robot = tricky()
    kin = bk.kinematics(robot, backend)
    q = robot.sample((2, 3))
    reversed_view = q.numpy()[::-1]
    read_only = q.numpy().copy()
    read_only.flags.writeable = False
    transposed = torch.empty(4, 3, 2, dtype=torch.float64).permute(2, 1, 0).copy_(q)
    expected = kin.pose(q, "tip")
    assert torch.equal(kin.pose(q.tolist(), "tip"), expected)
    assert torch.equal(kin.pose(reversed_view, "tip"), expected.flip(0))
    assert torch.equal(kin.pose(read_only, "tip"), expected)
    assert torch.equal(kin.pose(transposed, "tip"), expected)


@pytest.mark.parametrize("backend", BACKENDS)
def test_nothing_that_was_handed_out_changes_afterwards(backend):
    robot = tricky()
    kin = bk.kinematics(robot, backend)
    q = robot.sample(3)
    for link in ("tip", "world"):
        before = kin.pose(q, link)
        kept = before.clone()
        kin.pose(q, link).fill_(7.0)
        kin.pose(q + 0.01, link)
        assert torch.equal(before, kept)
        assert torch.equal(kin.pose(q, link), kept)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("function", ["pose", "jacobian", "hessian"])
def test_first_and_second_derivatives_are_right(backend, function):
    robot = tricky()
    kin = bk.kinematics(robot, backend)
    q = robot.sample(2, seed=1).requires_grad_()
    for link in ("nail", "gripper"):
        assert torch.autograd.gradcheck(lambda x, link=link: getattr(kin, function)(x, link), q)
        assert torch.autograd.gradgradcheck(lambda x, link=link: getattr(kin, function)(x, link), q)


@FORWARD_MODE
@pytest.mark.parametrize("reference", REFERENCES)
def test_jacobians_are_differentiable_in_every_reference(reference):
    kin = bk.kinematics(tricky())
    q = tricky().sample(2, seed=1).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: kin.jacobian(x, "nail", reference), q, check_forward_ad=True)


@FORWARD_MODE
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("make", MAKERS)
def test_derivatives_by_autograd_are_jacobian_and_hessian(make, backend):
    robot, kin = make(), kinematics(make, backend)
    link = robot.link_names[-1]
    q = robot.sample((3,), seed=5)
    jacobian, hessian = kin.jacobian(q, link), kin.hessian(q, link)

    def position(x):
        return kin.pose(x, link)[..., :3, 3]

    for transform in (torch.func.jacrev, torch.func.jacfwd):
        close(torch.func.vmap(transform(position))(q), jacobian[:, :3], 1e-13)
        close(torch.func.vmap(transform(lambda x: kin.jacobian(x, link)))(q), hessian, 1e-13)
        close(transform(position)(q[0]), jacobian[0, :3], 1e-13)
    close(torch.func.vmap(lambda x: kin.pose(x, link), in_dims=1)(q.T), kin.pose(q, link), 1e-15)
    close(torch.func.vmap(torch.func.hessian(position))(q), hessian[:, :3], 1e-13)
    pose, speed = torch.func.jvp(position, (q,), (torch.ones_like(q),))
    close(speed, jacobian[:, :3].sum(-1), 1e-13)
    close(pose, position(q), 1e-15)


# A point of the link --------------------------------------------------------------------------------------------------


def with_nail(urdf, point):
    """The robot with one more link, fixed where the point is."""
    x, y, z = point
    nail = '<link name="point"/><joint name="point" type="fixed"><parent link="tip"/><child link="point"/>'
    return bk.Robot.from_urdf(urdf.replace("</robot>", f'{nail}<origin xyz="{x!r} {y!r} {z!r}"/></joint></robot>'))


@pytest.mark.parametrize("backend", BACKENDS)
@given(point=st.tuples(*[st.floats(-2, 2)] * 3), batch=st.sampled_from(BATCHES), each=st.booleans())
@settings(max_examples=8)
def test_a_point_is_a_link_that_is_fixed_there(backend, point, batch, each):
    robot = with_nail(TRICKY, point)
    kin, q = kinematics(tricky, backend), robot.sample(batch, seed=1)
    offset = torch.tensor(point, dtype=torch.float64).expand(*batch, 3) if each else list(point)
    link = bk.kinematics(robot, backend)
    close(kin.pose(q, "tip", offset), link.pose(q, "point"), 1e-14)
    close(kin.hessian(q, "tip", offset), link.hessian(q, "point"), 1e-14)
    pose, jacobian = kin.pose_and_jacobian(q, "tip", offset=offset)
    close(pose, link.pose(q, "point"), 1e-14)
    close(jacobian, link.jacobian(q, "point"), 1e-14)
    for reference in REFERENCES:
        close(kin.jacobian(q, "tip", reference, offset=offset), link.jacobian(q, "point", reference), 1e-14)
    out = torch.empty(*batch, 4, 4, dtype=q.dtype), torch.empty(*batch, 6, robot.n, dtype=q.dtype)
    kin.pose_and_jacobian(q, "tip", out, offset)
    assert torch.equal(out[0], pose)
    assert torch.equal(out[1], jacobian)


@FORWARD_MODE
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("function", ["pose", "jacobian", "hessian"])
def test_results_are_differentiable_in_the_point(backend, function):
    kin = kinematics(tricky, backend)
    q = tricky().sample(2, seed=1).requires_grad_()
    points = torch.tensor([[0.1, -0.2, 0.3], [0.0, 0.5, 1.0]], dtype=torch.float64, requires_grad=True)

    def compute(q, point):
        return getattr(kin, function)(q, "tip", offset=point)

    for point in (points, points[0].detach().requires_grad_()):
        assert torch.autograd.gradcheck(compute, (q, point), check_forward_ad=function != "hessian")
        assert torch.autograd.gradcheck(lambda point: compute(q.detach(), point), point)
        assert function == "hessian" or torch.autograd.gradgradcheck(compute, (q, point))
    mapped = torch.func.vmap(torch.func.jacrev(lambda point, q: kin.pose(q, "tip", point)[:3, 3]))
    close(mapped(points.detach(), q.detach()), kin.pose(q.detach(), "tip")[:, :3, :3], 1e-14)


def test_a_point_in_float32_is_rounded_once():
    kin = kinematics(infant, "numba")
    q, point = infant().sample(50).float(), torch.tensor([0.1, 0.2, 0.3])
    for one, other in zip(
        kin.pose_and_jacobian(q, "left_hand", offset=point),
        kin.pose_and_jacobian(q.double(), "left_hand", offset=point.double()),
        strict=True,
    ):
        assert one.dtype == torch.float32
        assert torch.equal(one, other.float())


@pytest.mark.parametrize(
    ("offset", "error", "message"),
    [
        ([0.0, 0.0], InvalidArray, r"shape \(2,\); give a point in the link, \(3,\) or \(2, 3\)"),
        (torch.zeros(3, 3), InvalidArray, r"shape \(3, 3\); give"),
        (torch.zeros(1, 3), InvalidArray, r"shape \(1, 3\); give"),
        ([0.0, math.nan, 0.0], InvalidArray, "offset has NaN or infinite values"),
        ("tip", InvalidArray, "offset .* not numbers"),
        (torch.zeros(3, device="meta"), UnsupportedDevice, "offset is on 'meta'"),
    ],
)
def test_what_is_no_point_is_refused(offset, error, message):
    kin = kinematics(tricky, "numba")
    for function in (kin.pose, kin.jacobian, kin.hessian, kin.pose_and_jacobian):
        with pytest.raises(error, match=message):
            function(tricky().sample(2), "tip", offset=offset)


def test_what_is_written_into_carries_no_gradient_of_the_point():
    kin, q = kinematics(tricky, "numba"), tricky().sample(2)
    out = torch.empty(2, 4, 4, dtype=q.dtype), torch.empty(2, 6, 4, dtype=q.dtype)
    with pytest.raises(NotDifferentiable, match=r"offset\.detach"):
        kin.pose_and_jacobian(q, "tip", out, torch.zeros(3, dtype=q.dtype, requires_grad=True))


# Autocast -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("make", MAKERS)
def test_autocast_rounds_nothing(make, backend):
    robot, kin = make(), kinematics(make, backend)
    q, link = robot.sample(3).float(), max(robot.link_names, key=lambda name: len(robot.path(name)))

    def everything():
        gradients = [
            torch.autograd.functional.jacobian(lambda x, f=function: f(x, link).square().sum(), q)
            for function in (kin.pose, kin.jacobian, kin.hessian)
        ]
        references = [kin.jacobian(q, link, reference, offset=[0.1, 0.2, 0.3]) for reference in REFERENCES]
        return [kin.pose(q, link), kin.hessian(q, link), *references, *gradients]

    expected = everything()
    with torch.autocast("cpu", dtype=torch.bfloat16):
        found = everything()
    for one, other in zip(found, expected, strict=True):
        assert torch.equal(one, other)


def test_a_chain_of_ones_own_is_not_rounded_by_autocast():
    origins, axes, q = torch.eye(4).repeat(3, 1, 1), torch.eye(3), torch.tensor([0.1, 0.2, 0.3])
    origins[:, :3, 3] = torch.tensor([0.123, 0.456, 0.789])

    def everything():
        inputs = [one.clone().requires_grad_() for one in (origins, axes, q)]
        pose = bk.backends.chain_pose(*inputs)
        return [pose, *torch.autograd.grad(pose.square().sum() + pose[0, 3], inputs)]

    expected = everything()
    with torch.autocast("cpu", dtype=torch.bfloat16):
        found = everything()
    for one, other in zip(found, expected, strict=True):
        assert one.dtype == torch.float32
        assert torch.equal(one, other)


def test_no_gradient_is_kept_where_none_was_asked_for():
    kin = bk.kinematics(tricky())
    q = tricky().sample(2)
    assert not kin.pose(q, "tip").requires_grad
    assert kin.pose(q.requires_grad_(), "tip").requires_grad


# What is refused ------------------------------------------------------------------------------------------------------

BAD_POSTURES = {
    "too few": ([0.0] * 3, "its last axis must have 4 joint values"),
    "too many": ([0.0] * 5, "its last axis must have 4"),
    "one column, never broadcast": ([[0.0], [0.0]], "its last axis must have 4"),
    "a number": (0.0, "its last axis must have 4"),
    "NaN": ([[0.0] * 4, [0.0, math.nan, 0.0, 0.0]], "NaN or infinite values in 1 of 2 postures"),
    "infinite": ([0.0, math.inf, 0.0, 0.0], "NaN or infinite"),
    "both infinities": ([math.inf, -math.inf, 0.0, 0.0], "NaN or infinite"),
    "huge and infinite": ([1e308, 1e308, -math.inf, 0.0], "NaN or infinite"),
    "complex": (torch.zeros(4, dtype=torch.complex128), "holds complex128, not numbers"),
    "complex array": (np.zeros(4, dtype=np.complex128), "holds complex128, not numbers"),
    "complex list": ([1j] * 4, "holds complex128, not numbers"),
    "bool": (torch.zeros(4, dtype=torch.bool), "holds bool, not numbers"),
    "a bool among numbers": ([0.0, True, 0.0, 0.0], "holds a bool, not numbers"),
    "a bool of numpy among numbers": ([[0, np.True_, 0, 0]], "holds a bool, not numbers"),
    "bools": ([True] * 4, "holds bool, not numbers"),
    "sparse": (torch.eye(4).to_sparse(), "sparse tensor"),
    "text": ("0 0 0 0", "not numbers"),
    "texts": (["a", "b", "c", "d"], "not numbers"),
    "ragged": ([[0.0] * 4, [0.0] * 3], "no array of numbers"),
    "nothing": (None, "no array of numbers"),
    "a mapping": ({"zulu": 1.0}, "no array of numbers"),
}

WHOLE_NUMBERS = {
    "list": [0, 1, 0, 1],
    "integers": torch.tensor([0, 1, 0, 1]),
    "integer array": np.array([0, 1, 0, 1], dtype=np.int32),
    "half": torch.tensor([0, 1, 0, 1], dtype=torch.float16),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("q", WHOLE_NUMBERS.values(), ids=WHOLE_NUMBERS)
def test_whole_numbers_are_numbers(backend, q):
    kin = bk.kinematics(tricky(), backend)
    link = kin.robot.link_names[-1]
    assert torch.equal(kin.pose(q, link), kin.pose([0.0, 1.0, 0.0, 1.0], link))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("bad", BAD_POSTURES)
def test_bad_postures_are_refused(backend, bad):
    q, message = BAD_POSTURES[bad]
    kin = bk.kinematics(tricky(), backend)
    for function in (kin.pose, kin.jacobian, kin.hessian, kin.pose_and_jacobian):
        with pytest.raises(InvalidPosture, match=message):
            function(q, "tip")


def test_the_largest_finite_postures_are_not_taken_for_infinite():
    kin = bk.kinematics(bk.Robot.from_urdf(ONE_JOINT))
    assert torch.isfinite(kin.pose([[1e308], [1e308]], "leaf")).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_unknown_links_never_reach_the_library(backend, monkeypatch):
    kin = bk.kinematics(tricky(), backend)
    monkeypatch.setattr(kin.backend, "pose_and_jacobian", lambda *_: pytest.fail("the library was asked"))
    for function in (kin.pose, kin.jacobian, kin.hessian, kin.pose_and_jacobian):
        with pytest.raises(UnknownName, match="no link 'tipp'; did you mean 'tip'") as caught:
            function([0.0] * 4, "tipp")
        assert caught.value.close_matches == ("tip",)


def test_a_posture_on_another_device_is_not_moved_silently():
    with pytest.raises(UnsupportedDevice, match=r"'meta'.*q\.cpu"):
        bk.kinematics(tricky()).pose(torch.zeros(4, dtype=torch.float64, device="meta"), "tip")


# Which backend --------------------------------------------------------------------------------------------------------


class Constant:
    """A backend for which nothing ever moves."""

    def __init__(self, robot):
        self.robot = robot

    def pose_and_jacobian(self, q, link):
        return torch.eye(4, dtype=q.dtype).repeat(len(q), 1, 1), q.new_zeros(len(q), 6, self.robot.n)


class Lacking:
    def __init__(self, robot):
        pass


def test_a_backend_by_name_class_or_object():
    robot = tricky()
    place = f"{__name__}:Constant"
    for backend, name in ((place, place), (Constant, "Constant"), (Constant(robot.unfolded), "Constant")):
        kin = bk.kinematics(robot, backend)
        assert kin.name == name
        assert isinstance(kin.backend, bk.Kinematics)
        # A backend never hears of followers.
        assert kin.backend.robot.joint_names == robot.unfolded.joint_names
        assert torch.equal(kin.pose([0.0, 0.0, 0.0, 0.5], "tip"), torch.eye(4, dtype=torch.float64))
        assert kin.jacobian([[0.0] * 4], "tip").shape == (1, 6, 4)


def test_the_default_is_the_first_that_is_installed():
    names = [name for name, state in bk.backends().items() if state == "installed"]
    assert set(BACKENDS) <= set(names)
    assert bk.kinematics(tricky()).name in names


@pytest.mark.parametrize(
    ("backend", "error", "message"),
    [
        ("pinochio", UnknownName, "did you mean 'pinocchio'"),
        ("", UnknownName, "no backend ''"),
        ("no_such_module:Class", InvalidConfig, "No module named 'no_such_module'; put no_such_module.py"),
        ("math:Class", InvalidConfig, "cannot load backend 'math:Class'"),
        (":Class", InvalidConfig, "cannot load backend ':Class'"),
        ("math:pi", InvalidConfig, "'math:pi' has no method pose_and_jacobian"),
        (f"{__name__}:Lacking", InvalidConfig, "Lacking' has no method pose_and_jacobian"),
        (Lacking, InvalidConfig, "'Lacking' has no method pose_and_jacobian"),
    ],
)
def test_a_bad_backend_is_named(backend, error, message):
    with pytest.raises(error, match=message):
        bk.kinematics(tricky(), backend)


def test_a_library_that_is_missing_says_how_to_install_it(monkeypatch):
    import importlib.util

    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: find(name) if name != "pinocchio" else None)
    assert bk.backends()["pinocchio"] == "pip install pin"
    with pytest.raises(MissingDependency, match="pip install pin"):
        bk.kinematics(tricky(), "pinocchio")
    assert bk.kinematics(tricky()).name != "pinocchio"


def test_an_unknown_reference_lists_the_known():
    with pytest.raises(InvalidConfig, match="reference='body': give one of 'local_world_aligned', 'local', 'world'"):
        bk.kinematics(tricky()).jacobian([0.0] * 4, "tip", reference="body")
