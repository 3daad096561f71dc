"""Hypothesis strategies: random robots with everything URDF allows in kinematics, postures, links and batch shapes.

What is drawn first is simplest, so a failure shrinks to the fewest joints, in a chain, with plain names and with
everything left out that the failure does not need.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final, TypeAlias

from hypothesis import strategies as st

from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.testing._spec import Case, JointSpec, RobotSpec, Vector

KINDS: Final = ("revolute", "continuous", "prismatic", "fixed")
"""Every joint kind that has a posture of one value, or of none."""
NAMES: Final = (
    *("left hand", "a__b", "world", "universe", "root_joint", "base", "Zebra", "joint10", "joint2", "10", "9", "-1"),
    *(
        "hånd",
        "ha\u030and",
        "関節",
        "\U0001f9be",
        "x/y",
        "a.b",
        "a:b",
        "#",
        "<&\"'>",
        " padded ",
        "None",
        "link0_joint",
    ),
)
"""Names that URDF allows and libraries stumble over: their own words, separators, unicode, what XML escapes."""

# Hypothesis' own DrawFn cannot be checked at run time.
Draw: TypeAlias = Callable[[st.SearchStrategy[Any]], Any]

_LENGTHS = st.one_of(st.sampled_from([0.0, 1.0, -1.0, 0.1, -0.3]), st.floats(-1.5, 1.5))
_ANGLES = st.one_of(
    st.sampled_from([0.0, math.pi / 2, -math.pi / 2, math.pi, -math.pi, 0.1, 1.5707963]), st.floats(-7.0, 7.0)
)
_SIGNED = st.sampled_from([0.0, 1.0, -1.0, 0.1, 3.0, -1e-6, 1e5])
_AXES: st.SearchStrategy[Vector] = st.one_of(
    st.sampled_from([(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -2.0), (1.0, 1.0, 0.0)]),
    st.tuples(_SIGNED, _SIGNED, _SIGNED).filter(any),
    st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda axis: math.hypot(*axis) > 1e-3),
)
_MULTIPLIERS = st.one_of(st.sampled_from([None, -1.0, 2.0, 0.5, 0.0]), st.floats(-2.0, 2.0))
_OFFSETS = st.one_of(st.sampled_from([None, 0.1, -math.pi / 2]), st.floats(-2.0, 2.0))
_LIMITS = st.one_of(
    st.sampled_from([(-1.0, 1.0), (None, None), (None, 0.5), (-0.5, None), (0.2, 0.7), (-math.pi, math.pi)]),
    st.tuples(st.floats(-3.0, 0.0), st.floats(0.0, 3.0)),
)


@st.composite
def robots(
    draw: Draw,
    *,
    min_joints: int = 0,
    max_joints: int = 6,
    kinds: Sequence[str] = KINDS,
    mimics: bool = True,
    branches: bool = True,
    weird_names: bool = True,
    shuffled: bool = True,
) -> RobotSpec:
    """Random URDF trees; turn off what a library does not claim to support.

    Args:
        draw: Given by Hypothesis.
        min_joints: The fewest joints; a robot of none is a single link.
        max_joints: The most joints, fixed ones included.
        kinds: Joint kinds to draw from, out of :data:`KINDS`.
        mimics: Joints may follow others, chains and any order of them included.
        branches: The tree may branch.
        weird_names: Names out of :data:`NAMES`, a joint and a link of one name included.
        shuffled: Links and joints may stand in any order in the file.

    Returns:
        A strategy of :class:`RobotSpec`; ``to_urdf()`` gives the text.

    Raises:
        InvalidConfig: A joint kind that is not in :data:`KINDS`.
    """
    if not kinds or not set(kinds) <= set(KINDS):
        raise InvalidConfig(f"kinds is {tuple(kinds)}; give some of {', '.join(KINDS)}")
    count = draw(st.integers(min_joints, max_joints))
    links = _names(draw, "link", count + 1, weird_names)
    names = _names(draw, "joint", count, weird_names)
    joints = []
    for index, name in enumerate(names):
        back = draw(st.integers(0, index)) if branches else 0
        joints.append(_joint(draw, name, draw(st.sampled_from(kinds)), links[index - back], links[index + 1]))
    if mimics:
        joints = _with_mimics(draw, joints)
    if shuffled:
        return RobotSpec(tuple(draw(st.permutations(joints))), tuple(draw(st.permutations(links))))
    return RobotSpec(tuple(joints), tuple(links))


def postures(robot: RobotSpec, *, within_limits: bool = False) -> st.SearchStrategy[tuple[float, ...]]:
    """Postures of a robot: zeros, limits, quarter and half turns, next to those, anything between, and huge angles.

    Args:
        robot: The robot.
        within_limits: Only postures within the joint limits, and angles of continuous joints in [-pi, pi].

    Returns:
        Joint values in the order of ``robot.joint_names`` [rad or m].
    """
    return st.tuples(*[_joint_values(joint, within_limits) for joint in robot.free_joints])


@st.composite
def cases(
    draw: Draw,
    robots: st.SearchStrategy[RobotSpec] = robots(),  # noqa: B008  (strategies are immutable and lazy)
    *,
    within_limits: bool = False,
) -> Case:
    """A robot, a posture of it and one of its links: what a law is checked on.

    Args:
        draw: Given by Hypothesis.
        robots: Where the robot is drawn from.
        within_limits: See :func:`postures`.
    """
    robot = draw(robots)
    # The links in order of depth, deepest first: where most can go wrong is tried most and shrunk to least.
    deepest_first = sorted(robot.links, key=lambda link: -len(robot.path(link)))
    return Case(robot, draw(postures(robot, within_limits=within_limits)), draw(st.sampled_from(deepest_first)))


def batch_shapes() -> st.SearchStrategy[tuple[int, ...]]:
    """Shapes of batches: none at all, one, several, nested, and empty."""
    return st.sampled_from([(), (1,), (3,), (0,), (2, 3), (3, 1, 2), (2, 0), (1, 1)])


def _names(draw: Draw, word: str, count: int, weird: bool) -> list[str]:
    """Plain names, some of them replaced by weird ones."""
    plain = [f"{word}{index}" for index in range(count)]
    if not weird or not draw(st.booleans()):
        return plain
    chosen = draw(st.lists(st.one_of(st.none(), st.sampled_from(NAMES)), min_size=count, max_size=count))
    given: dict[str, None] = {}
    for fallback, name in zip(plain, chosen, strict=True):
        name = fallback if name is None else name
        while name in given:
            name += "'"
        given[name] = None
    return list(given)


def _joint(draw: Draw, name: str, kind: str, parent: str, child: str) -> JointSpec:
    xyz = draw(st.one_of(st.none(), st.tuples(_LENGTHS, _LENGTHS, _LENGTHS)))
    rpy = draw(st.one_of(st.none(), st.tuples(_ANGLES, _ANGLES, _ANGLES)))
    joint = JointSpec(name, kind, parent, child, xyz, rpy)
    if kind == "fixed":
        return joint
    joint = replace(joint, axis=draw(st.one_of(st.none(), _AXES)))
    if kind == "continuous":
        return joint
    lower, upper = draw(_LIMITS)
    return replace(joint, lower=lower, upper=upper)


def _with_mimics(draw: Draw, joints: list[JointSpec]) -> list[JointSpec]:
    """The joints, some of them now following others, never in a circle; in either direction along the tree."""
    moving = [index for index, joint in enumerate(joints) if joint.kind != "fixed"]
    if len(moving) < 2 or not draw(st.booleans()):
        return joints
    if draw(st.booleans()):
        moving.reverse()
    for position in range(1, len(moving)):
        if draw(st.booleans()):
            source = joints[moving[position - 1 - draw(st.integers(0, position - 1))]].name
            multiplier, offset = draw(_MULTIPLIERS), draw(_OFFSETS)
            follower = joints[moving[position]]
            joints[moving[position]] = replace(follower, mimic=source, multiplier=multiplier, offset=offset)
    return joints


def _joint_values(joint: JointSpec, within_limits: bool) -> st.SearchStrategy[float]:
    lower, upper = joint.limits
    if math.isinf(lower):
        lower, upper = -math.pi, math.pi
    limits = [lower, upper]
    if joint.kind == "prismatic":
        special, widest = [0.0, *limits, 1e-9], 2.0
    else:
        quarter = math.pi / 2
        special = [0.0, quarter, -quarter, 2 * quarter, -2 * quarter, *limits]
        # Next to a singularity, where formulas divide by what is nearly zero; and where argument reduction is tested.
        special += [1e-9, -1e-9, quarter - 1e-8, math.pi - 1e-8, 1e3, -1e6]
        widest = 2 * math.pi
    if within_limits:
        special, low, high = [value for value in special if lower <= value <= upper], lower, upper
    else:
        low, high = -widest, widest
    return st.one_of(st.sampled_from(list(dict.fromkeys(special))), st.floats(low, high))
