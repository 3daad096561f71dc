"""The smallest case that still fails: what random shrinking leaves over, and all of a published robot, cut down."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from bodyimage_kin.testing._spec import Case, JointSpec, RobotSpec, rename


def reduced(case: Case, fails: Callable[[Case], bool], attempts: int = 1500) -> Case:
    """The case made smaller, one piece at a time, for as long as it fails.

    Args:
        case: A case that fails.
        fails: Whether another one does, in the same way.
        attempts: The most cases to try.
    """
    smaller = True
    while smaller and attempts > 0:
        smaller = False
        for candidate in _smaller(case):
            attempts -= 1
            if candidate != case and fails(candidate):
                case, smaller = candidate, True
                break
            if attempts == 0:
                break
    return case


def _smaller(case: Case) -> Iterator[Case]:
    """Cases simpler than this one, the simplest first."""
    robot = replace(case.robot, text=None)
    values = dict(zip(case.robot.joint_names, case.q, strict=True))
    kept = _needed(case)
    if len(kept) < len(robot.joints):
        yield _case(replace(robot, joints=kept), values, case.link)
    for joint in robot.joints:
        if all(other.mimic != joint.name for other in robot.joints):
            yield _without(robot, joint, values, case.link)
        elif joint.mimic is not None:
            past = [_past(one, joint) if one.mimic == joint.name else one for one in robot.joints]
            yield _without(replace(robot, joints=tuple(past)), joint, values, case.link)
    if any(values.values()):
        yield _case(robot, dict.fromkeys(values, 0.0), case.link)
    for name, value in values.items():
        simple = (0.0, 1.0, 0.5)
        for other in simple[: simple.index(value) if value in simple else None]:
            yield _case(robot, values | {name: other}, case.link)
    for index, joint in enumerate(robot.joints):
        for simpler in _simpler(joint):
            joints = (*robot.joints[:index], simpler, *robot.joints[index + 1 :])
            yield _case(replace(robot, joints=joints), values, case.link)
    yield _plainly_named(robot, values, case.link)
    yield from _in_order(robot, values, case.link)


def _simpler(joint: JointSpec) -> Iterator[JointSpec]:
    """The joint with one thing less."""
    less: dict[str, Any] = dict.fromkeys(("xyz", "rpy", "axis", "multiplier", "offset"))
    yield from (replace(joint, **{field: value}) for field, value in less.items() if getattr(joint, field) is not None)
    for field, vector in (("xyz", joint.xyz), ("rpy", joint.rpy)):
        for k in range(3):
            if vector is not None and vector[k] != 0.0 and sum(map(bool, vector)) > 1:
                less = {field: (*vector[:k], 0.0, *vector[k + 1 :])}
                yield replace(joint, **less)
    if joint.kind in ("prismatic", "continuous") and joint.mimic is None:
        yield replace(joint, kind="revolute", lower=-1.0, upper=1.0)
    if joint.kind in ("revolute", "prismatic") and joint.limits != (-1.0, 1.0):
        yield replace(joint, lower=-1.0, upper=1.0)
    if joint.mimic is not None:
        yield replace(joint, mimic=None, multiplier=None, offset=None)


def _needed(case: Case) -> tuple[JointSpec, ...]:
    """The joints that lead to the link, all that lead to what these follow, and so on."""
    by_name = {joint.name: joint for joint in case.robot.joints}
    wanted = [joint.name for joint in case.robot.path(case.link)]
    needed: set[str] = set()
    while wanted:
        joint = by_name[wanted.pop()]
        if joint.name not in needed:
            needed.add(joint.name)
            if joint.mimic is not None:
                wanted += [above.name for above in case.robot.path(by_name[joint.mimic].child)]
    return tuple(joint for joint in case.robot.joints if joint.name in needed)


def _without(robot: RobotSpec, gone: JointSpec, values: Mapping[str, float], link: str) -> Case:
    """The case without one joint: its child's place is taken by its parent."""
    joints = (
        replace(joint, parent=gone.parent) if joint.parent == gone.child else joint
        for joint in robot.joints
        if joint is not gone
    )
    return _case(replace(robot, joints=tuple(joints)), values, gone.parent if link == gone.child else link)


def _past(follower: JointSpec, followed: JointSpec) -> JointSpec:
    """The follower tied to what the followed joint follows itself, its values unchanged."""
    multiplier = 1.0 if follower.multiplier is None else follower.multiplier
    onward = 1.0 if followed.multiplier is None else followed.multiplier
    offset = (follower.offset or 0.0) + multiplier * (followed.offset or 0.0)
    return replace(follower, mimic=followed.mimic, multiplier=multiplier * onward, offset=offset)


def _plainly_named(robot: RobotSpec, values: Mapping[str, float], link: str) -> Case:
    links = {name: f"link{index}" for index, name in enumerate(robot.links)}
    joints = {joint.name: f"joint{index}" for index, joint in enumerate(robot.joints)}
    renamed = {joints[name]: value for name, value in values.items()}
    return _case(rename(robot, links, joints), renamed, links[link])


def _in_order(robot: RobotSpec, values: Mapping[str, float], link: str) -> Iterator[Case]:
    """The case with links, and joints too, in the order of the tree."""
    links = tuple(sorted(robot.links, key=lambda name: len(robot.path(name))))
    joints = tuple(sorted(robot.joints, key=lambda joint: len(robot.path(joint.child))))
    yield _case(replace(robot, links=links), values, link)
    yield _case(replace(robot, links=links, joints=joints), values, link)


def _case(robot: RobotSpec, values: Mapping[str, float], link: str) -> Case:
    """The case with just the links that its joints name, a joint without a value being at zero."""
    named = {link, *(name for joint in robot.joints for name in (joint.parent, joint.child))}
    robot = replace(robot, links=tuple(name for name in robot.links if name in named))
    return Case(robot, tuple(values.get(name, 0.0) for name in robot.joint_names), link)
