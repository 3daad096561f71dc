"""Random robots are valid URDF, have every feature, and shrink to the smallest that has what is looked for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import HealthCheck, find, given, settings
from hypothesis import strategies as st

from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.robot import Robot
from bodyimage_kin.testing import Case, RobotSpec, batch_shapes, cases, postures, robots
from bodyimage_kin.testing.conform import random_cases
from bodyimage_kin.testing.strategies import KINDS

pytestmark = pytest.mark.filterwarnings("ignore:Do not use the `random` module inside strategies")
QUIET = settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)


@given(robot=robots())
@QUIET
def test_every_robot_reads_back_as_it_was_drawn(robot: RobotSpec) -> None:
    read = Robot.from_urdf(robot.to_urdf())
    assert read.joint_names == robot.joint_names
    assert read.link_names == robot.links
    assert read.root == robot.root
    for found, drawn in zip(RobotSpec.from_robot(read).joints, robot.explicit().joints, strict=True):
        # Both make axes unit vectors, each in its own rounding.
        assert replace(found, axis=None) == replace(drawn, axis=None)
        assert (found.axis or ()) == pytest.approx(drawn.axis or (), abs=1e-15)
    assert [read.source_of(name)[0] for name in robot.joint_names] == list(robot.joint_names)


@given(robot=robots(kinds=["revolute", "fixed"], mimics=False, branches=False, weird_names=False, shuffled=False))
@QUIET
def test_what_is_turned_off_does_not_occur(robot: RobotSpec) -> None:
    assert {joint.kind for joint in robot.joints} <= {"revolute", "fixed"}
    assert all(joint.mimic is None for joint in robot.joints)
    assert robot.links == tuple(f"link{index}" for index in range(len(robot.links)))
    assert [joint.parent for joint in robot.joints] == list(robot.links[:-1])


@given(data=st.data())
@QUIET
def test_postures_fit_and_keep_limits_when_asked(data: st.DataObject) -> None:
    robot = data.draw(robots())
    assert len(data.draw(postures(robot))) == robot.n
    for joint, value in zip(robot.free_joints, data.draw(postures(robot, within_limits=True)), strict=True):
        lower, upper = joint.limits if joint.kind != "continuous" else (-math.pi, math.pi)
        assert lower <= value <= upper


def _mimic_of_mimic(robot: RobotSpec) -> bool:
    followers = {joint.name: joint.mimic for joint in robot.joints if joint.mimic}
    return any(source in followers for source in followers.values())


def _source_after(robot: RobotSpec) -> bool:
    order = [joint.name for joint in robot.joints]
    return any(joint.mimic and order.index(joint.mimic) > index for index, joint in enumerate(robot.joints))


FEATURES: dict[str, Callable[[Case], Any]] = {
    "single link": lambda case: not case.robot.joints,
    "missing axis": lambda case: any(joint.axis is None and joint.kind != "fixed" for joint in case.robot.joints),
    "long axis": lambda case: any(joint.axis and math.hypot(*joint.axis) > 1.5 for joint in case.robot.joints),
    "pitch of a quarter turn": lambda case: any(
        joint.rpy and joint.rpy[1] == math.pi / 2 for joint in case.robot.joints
    ),
    "branch": lambda case: len({joint.parent for joint in case.robot.joints}) < len(case.robot.joints),
    "joint and link of one name": lambda case: any(joint.name in case.robot.links for joint in case.robot.joints),
    "moving link called world": lambda case: "world" in case.robot.links and case.robot.root != "world",
    "order that is not alphabetical": lambda case: list(case.robot.joint_names) != sorted(case.robot.joint_names),
    "missing limit": lambda case: any(joint.kind == "prismatic" and joint.lower is None for joint in case.robot.joints),
    "mimic of a mimic": lambda case: _mimic_of_mimic(case.robot),
    "follower before what it follows": lambda case: _source_after(case.robot),
    "huge angle": lambda case: any(abs(value) > 1e5 for value in case.q),
    "nearly zero": lambda case: any(0 < abs(value) < 1e-6 for value in case.q),
    "long path": lambda case: len(case.robot.path(case.link)) >= 5,
    **{kind: lambda case, kind=kind: any(joint.kind == kind for joint in case.robot.joints) for kind in KINDS},
}


@pytest.fixture(scope="module")
def drawn() -> list[Case]:
    return random_cases(robots(), 600)


@pytest.mark.parametrize("feature", FEATURES)
def test_every_feature_occurs(feature: str, drawn: list[Case]) -> None:
    assert any(FEATURES[feature](case) for case in drawn)


@given(shape=batch_shapes())
@settings(max_examples=30, derandomize=True)
def test_batch_shapes_are_small(shape: tuple[int, ...]) -> None:
    assert math.prod(shape) <= 6


def test_kinds_that_do_not_exist_are_refused() -> None:
    with pytest.raises(InvalidConfig, match="floating"):
        find(robots(kinds=["floating"]), lambda robot: True)


@given(case=cases())
@QUIET
def test_a_case_is_read_back_from_its_file(case: Case) -> None:
    robot = RobotSpec.from_robot(Robot.from_urdf(case.to_urdf()))
    read = Case.read(robot)
    assert read is not None
    assert (read.q, read.link) == (case.q, case.link)
