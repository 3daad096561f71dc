"""Streams give what the whole batch gives, in memory that does not grow."""

from __future__ import annotations

import re
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig, InvalidPosture, NotDifferentiable, UnknownName
from tests.robots import ARM, TRICKY

MEGABYTE = 1 << 20


def joined(pairs) -> tuple[torch.Tensor, torch.Tensor]:
    poses, jacobians = zip(*((pose.clone(), jacobian.clone()) for pose, jacobian in pairs), strict=True)
    return torch.cat(poses), torch.cat(jacobians)


def assert_same(actual: tuple, expected: tuple) -> None:
    for one, other in zip(actual, expected, strict=True):
        assert torch.equal(one, other)


@pytest.mark.parametrize("backend", ["numba", "pinocchio"])
@pytest.mark.parametrize("batch", [1, 7, 64, 1000])
def test_a_stream_is_the_whole_batch_whatever_the_source(backend: str, batch: int, tmp_path: Path) -> None:
    robot = bk.Robot.from_urdf(TRICKY)
    kin = bk.kinematics(robot, backend)
    q = robot.sample(100)
    expected = kin.pose_and_jacobian(q, "nail")
    np.save(tmp_path / "q.npy", q.numpy())
    mapped = np.load(tmp_path / "q.npy", mmap_mode="r")
    sources = q, q.numpy(), mapped, iter([q[:3], q[3:60].numpy(), q[60:60], q[60:]]), (part for part in q.split(33))
    for source in sources:
        assert_same(joined(kin.stream(source, "nail", batch=batch)), expected)
    assert all(len(pose) <= batch for pose, _ in kin.stream(q, "nail", batch=batch))


def test_memory_is_used_again_and_float32_stays_float32() -> None:
    robot = bk.Robot.from_urdf(ARM)
    kin = bk.kinematics(robot)
    places = {pose.data_ptr() for pose, _ in kin.stream(robot.sample(100), "hand", batch=10)}
    assert len(places) == 1
    mixed = [robot.sample(3).float(), robot.sample(3)]
    assert [pose.dtype for pose, _ in kin.stream(mixed, "hand")] == [torch.float32, torch.float64]


def test_a_bad_stream_says_so() -> None:
    robot = bk.Robot.from_urdf(ARM)
    kin = bk.kinematics(robot)
    with pytest.raises(UnknownName, match="hnad"):
        kin.stream(robot.sample(3), "hnad")
    for batch in (0, -1):
        with pytest.raises(InvalidConfig, match=r"batch=.*: give a whole number of at least 1"):
            kin.stream(robot.sample(3), "hand", batch=batch)
    with pytest.raises(InvalidPosture, match=r"arrays \(batch, 2\), and this one is of shape \(2,\)"):
        next(kin.stream([robot.sample(())], "hand"))
    with pytest.raises(InvalidPosture, match="must have 2 joint values"):
        next(kin.stream(np.zeros((4, 3)), "hand"))
    with pytest.raises(InvalidPosture, match="1 of 4"):
        next(kin.stream(np.array([[0.0, np.nan]] + [[0.0, 0.0]] * 3), "hand"))
    with pytest.raises(NotDifferentiable, match="keeps no gradient"):
        next(kin.stream(robot.sample(3).requires_grad_(), "hand"))


def resident() -> int:
    """Memory of this process that is its own, not a file's [byte]."""
    found = re.search(r"RssAnon:\s+(\d+) kB", Path("/proc/self/status").read_text())
    return int(found[1]) * 1024 if found else 0


def repeated(q: torch.Tensor, total: int) -> Iterator[torch.Tensor]:
    for first in range(0, total, len(q)):
        yield q[: total - first]


def stream_in_constant_memory(total: int) -> None:
    robot = bk.load_embodiment("infant").robot
    kin = bk.kinematics(robot.subtree(["left_hand"]))
    link = "left_hand"
    q = kin.robot.sample(16384)
    for _ in kin.stream(q, link):
        pass
    before, most, seen = resident(), 0, 0
    tracemalloc.start()
    for pose, jacobian in kin.stream(repeated(q, total), link):
        seen += len(pose)
        assert jacobian.shape == (len(pose), 6, kin.robot.n)
        most = max(most, resident())
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert seen == total
    assert peak < 10 * MEGABYTE
    assert most - before < 50 * MEGABYTE


def test_two_million_postures_take_no_more_memory_than_a_few_thousand() -> None:
    stream_in_constant_memory(2_000_000)


@pytest.mark.slow
def test_a_hundred_million_postures_take_no_more_memory_than_a_few_thousand() -> None:
    stream_in_constant_memory(100_000_000)


def test_a_memory_map_is_read_piece_by_piece(tmp_path: Path) -> None:
    robot = bk.Robot.from_urdf(ARM)
    kin = bk.kinematics(robot)
    total = 500_000
    mapped = np.lib.format.open_memmap(tmp_path / "q.npy", mode="w+", dtype=np.float64, shape=(total, 2))
    mapped[:] = 0.1
    mapped.flush()
    mapped = np.load(tmp_path / "q.npy", mmap_mode="r")
    tracemalloc.start()
    seen = sum(len(pose) for pose, _ in kin.stream(mapped, "hand", batch=8192))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert seen == total
    assert peak < 2 * MEGABYTE
