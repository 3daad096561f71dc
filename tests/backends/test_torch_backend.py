"""Plain torch: the poses of Pinocchio on whatever device, and gradients that reach lengths and axes."""

from __future__ import annotations

import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.backends import _numba_kernels as kernels
from bodyimage_kin.backends import chain_pose
from bodyimage_kin.errors import InvalidArray, InvalidPosture, UnsupportedDevice
from bodyimage_kin.robot import transforms
from tests.robots import ARM, ONE_JOINT, STATUE, TRICKY

# torch 2.13 warns of itself in forward mode.
FORWARD_MODE = pytest.mark.filterwarnings("ignore:.torch.jit.script. is deprecated:DeprecationWarning")


class Elsewhere(torch.Tensor):
    """A tensor that says it is not on the CPU: the machines of the tests have nothing else."""

    is_cpu = False


@pytest.mark.parametrize("text", [TRICKY, ARM, ONE_JOINT, STATUE])
def test_every_link_is_where_pinocchio_says_followers_included(text: str) -> None:
    robot = bk.Robot.from_urdf(text)
    ours, oracle = bk.kinematics(robot, "torch"), bk.kinematics(robot, "pinocchio")
    for batch in (0, 1, 41):
        q = robot.sample(batch, seed=3)
        for link in robot.link_names:
            pairs = zip(ours.pose_and_jacobian(q, link), oracle.pose_and_jacobian(q, link), strict=True)
            for actual, expected in pairs:
                torch.testing.assert_close(actual, expected, rtol=0, atol=1e-14)
                assert actual.is_contiguous()


def chain(axes: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Origins with an end, and postures."""
    generator = torch.Generator().manual_seed(0)
    turns, places = torch.rand(2, len(axes) + 1, 3, generator=generator, dtype=torch.float64)
    origins = torch.stack(
        [
            torch.from_numpy(transforms.transform(transforms.rpy_matrix(rpy), xyz))
            for rpy, xyz in zip(turns.tolist(), places.tolist(), strict=True)
        ]
    )
    return origins, torch.rand(6, len(axes), generator=generator, dtype=torch.float64) * 6 - 3


AXES = torch.tensor(
    [[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, -2, 0], [1, 2, -2], [1e-9, 0, -1], [3, 4, 1e-12]], dtype=torch.float64
)


def by_products(
    origins: torch.Tensor, axes: torch.Tensor, q: torch.Tensor, prismatic: tuple[bool, ...]
) -> torch.Tensor:
    """One posture by matrices, as the definition says."""
    pose = torch.eye(4, dtype=torch.float64)
    for origin, axis, value, slides in zip(origins, axes, q, prismatic, strict=False):
        move = torch.eye(4, dtype=torch.float64)
        unit = axis / axis.norm()
        if slides:
            move[:3, 3] = unit * value
        else:
            move[:3, :3] = torch.from_numpy(transforms.axis_angle_matrix(unit.tolist(), float(value)))
        pose = pose @ origin @ move
    return pose @ origins[-1]


@pytest.mark.parametrize("sliding", [False, True])
def test_a_chain_is_the_product_of_its_parts_whatever_the_axes(sliding: bool) -> None:
    origins, q = chain(AXES)
    prismatic = tuple(sliding and index % 3 == 0 for index in range(len(AXES)))
    expected = torch.stack([by_products(origins, AXES, posture, prismatic) for posture in q])
    actual = chain_pose(origins, AXES, q.reshape(2, 3, -1), prismatic)
    torch.testing.assert_close(actual, expected.reshape(2, 3, 4, 4), rtol=0, atol=1e-14)
    # Without an end of its own, the last joint's frame is the end.
    back = actual @ torch.linalg.inv(origins[-1])
    torch.testing.assert_close(chain_pose(origins[:-1], AXES, q.reshape(2, 3, -1), prismatic), back, rtol=0, atol=1e-14)


@pytest.mark.parametrize("prismatic", [None, [False, True, False]])
def test_gradients_reach_origins_axes_and_values_twice(prismatic: list[bool] | None) -> None:
    axes = AXES[[1, 4, 6]]
    origins, q = chain(axes)
    inputs = origins.requires_grad_(), axes.clone().requires_grad_(), q[:2].clone().requires_grad_()

    def pose(o: torch.Tensor, a: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        return chain_pose(o, a, x, prismatic)

    assert torch.autograd.gradcheck(pose, inputs)
    assert torch.autograd.gradgradcheck(pose, inputs)


@FORWARD_MODE
def test_a_chain_goes_through_vmap_jacrev_and_jacfwd() -> None:
    origins, q = chain(AXES)
    both = (torch.func.jacrev(chain_pose, argnums=1), torch.func.jacfwd(chain_pose, argnums=1))
    first, second = (transform(origins, AXES, q[0]) for transform in both)
    torch.testing.assert_close(first, second, rtol=0, atol=1e-13)
    many = torch.stack([AXES, AXES.flip(0)])
    mapped = torch.func.vmap(chain_pose, in_dims=(None, 0, None))(origins, many, q)
    torch.testing.assert_close(mapped[1], chain_pose(origins, many[1], q))


@pytest.mark.parametrize(
    ("origins", "axes", "q"), [((3, 4, 4), (1, 3), (1,)), ((1, 4, 3), (1, 3), (1,)), ((1, 4, 4), (1, 3), (2,))]
)
def test_chains_that_do_not_fit_are_refused(origins: tuple, axes: tuple, q: tuple) -> None:
    with pytest.raises(InvalidArray, match=r"make no chain|one entry for each of the 1 joints"):
        chain_pose(torch.ones(origins), torch.ones(axes), torch.ones(q))


@pytest.mark.parametrize("backend", ["numba", "torch"])
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_other_devices_are_served_where_they_are(backend: str, dtype: torch.dtype, monkeypatch) -> None:
    robot = bk.Robot.from_urdf(TRICKY)
    kin = bk.kinematics(robot, backend)
    q = robot.sample(5).to(dtype)
    expected = bk.kinematics(robot, "pinocchio").pose_and_jacobian(q, "nail")
    monkeypatch.setattr(kernels, "pose_and_jacobian", lambda *_: pytest.fail("moved to the CPU"))
    actual = kin.pose_and_jacobian(q.as_subclass(Elsewhere), "nail")
    tolerance = 1e-14 if dtype == torch.float64 else 1e-6
    for one, other in zip(actual, expected, strict=True):
        assert isinstance(one, Elsewhere)
        assert one.dtype == dtype
        torch.testing.assert_close(one.as_subclass(torch.Tensor), other, rtol=0, atol=tolerance)
    q[1, 2] = torch.nan
    with pytest.raises(InvalidPosture, match="1 of 5"):
        kin.pose(q.as_subclass(Elsewhere), "nail")


def test_other_devices_are_refused_by_what_computes_on_the_cpu() -> None:
    robot = bk.Robot.from_urdf(ARM)
    with pytest.raises(UnsupportedDevice, match=r"'pinocchio' computes on the CPU.*q\.cpu"):
        bk.kinematics(robot, "pinocchio").pose(robot.sample(2).as_subclass(Elsewhere), "hand")
    with pytest.raises(UnsupportedDevice, match="'torch' needs values"):
        bk.kinematics(robot, "torch").pose(torch.zeros(2, dtype=torch.float64, device="meta"), "hand")
