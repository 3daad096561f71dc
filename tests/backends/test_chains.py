"""Laws of every backend that have to do with its models of chains: threads, length, other processes."""

import os
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
import torch
from robots import infant, tricky

import bodyimage_kin as bk

BACKENDS = ("pinocchio", "pytorch_kinematics", "numba", "torch", "mujoco")


@pytest.fixture
def quick_switches():
    """Threads that take turns after every few instructions."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("make", [infant, tricky])
def test_threads_do_not_get_each_others_results(make, backend, quick_switches):
    robot = make()
    # Two links, so that threads meet in the same model, and postures enough for them to meet midway.
    links = sorted(robot.link_names, key=lambda link: len(robot.path(link)))[-2:]
    cases = [(robot.sample(300, seed=seed), links[seed % 2]) for seed in range(12)]
    alone = bk.kinematics(robot, backend)
    expected = [(*alone.pose_and_jacobian(*case), alone.hessian(*case)) for case in cases]
    # A new one: its models are built by whichever threads come first.
    shared = bk.kinematics(robot, backend)

    def compute(case):
        return *shared.pose_and_jacobian(*case), shared.hessian(*case)

    with ThreadPoolExecutor(4) as pool:
        for found, right in zip(pool.map(compute, cases), expected, strict=True):
            for one, other in zip(found, right, strict=True):
                assert torch.equal(one, other)


@pytest.mark.parametrize("backend", BACKENDS)
def test_kinematics_go_to_other_processes(backend):
    robot = tricky()
    q = robot.sample(3)
    kin = bk.kinematics(robot, backend)
    before = kin.pose(q, "tip")
    again = pickle.loads(pickle.dumps(kin))
    assert torch.equal(again.pose(q, "tip"), before)
    assert torch.equal(again.hessian(q, "gripper"), kin.hessian(q, "gripper"))


def chain(joints, kinds):
    parts = [f'<link name="l{joints}"/>']
    for index in range(joints):
        kind = kinds[index % len(kinds)]
        parts.append(
            f'<link name="l{index}"/><joint name="j{index}" type="{kind}"><parent link="l{index}"/>'
            f'<child link="l{index + 1}"/><origin xyz="0.01 0 {0.001 * (index % 7)}" rpy="0.1 {0.01 * (index % 5)} 0"/>'
            f'<axis xyz="0 {index % 3} 1"/><limit lower="-0.1" upper="0.1"/></joint>'
        )
    return bk.Robot.from_urdf(f'<robot name="chain">{"".join(parts)}</robot>')


@pytest.mark.parametrize("joints", [127, 128, 129, 300])
def test_long_chains_are_put_together(joints):
    robot = chain(joints, ("revolute", "fixed", "prismatic", "revolute", "continuous"))
    q = robot.sample(2) * 0.05
    expected = bk.kinematics(robot, "torch").pose_and_jacobian(q, f"l{joints}")
    for backend in ("pinocchio", "pytorch_kinematics", "mujoco", "numba"):
        found = bk.kinematics(robot, backend).pose_and_jacobian(q, f"l{joints}")
        for one, other in zip(found, expected, strict=True):
            torch.testing.assert_close(one, other, atol=1e-12, rtol=0)


@pytest.mark.parametrize("kind", ["fixed", "continuous"])
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_chain_of_1500_links_works(backend, kind):
    robot = chain(1500, (kind,))
    q = torch.zeros(1, robot.n, dtype=torch.float64)
    expected = torch.eye(4, dtype=torch.float64)
    for joint in robot.path("l1500"):
        expected = expected @ torch.tensor(joint.origin)
    pose, jacobian = bk.kinematics(robot, backend).pose_and_jacobian(q, "l1500")
    torch.testing.assert_close(pose[0], expected, atol=1e-11, rtol=0)
    assert jacobian.shape == (1, 6, robot.n)


def test_without_compilation_the_default_is_torch_and_numba_says_so():
    program = """
import bodyimage_kin as bk
robot = bk.Robot.from_urdf('<robot name="r"><link name="a"/></robot>')
print(bk.kinematics(robot).name)
try:
    bk.kinematics(robot, "numba")
except bk.errors.InvalidConfig as problem:
    print(problem)
"""
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    run = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert run.stdout.splitlines() == [
        "torch", "NUMBA_DISABLE_JIT=1 and backend 'numba' exclude each other; unset it, or use 'torch'",
    ]  # fmt: skip
