"""Hypothesis strategies: random robots with everything URDF allows in kinematics, postures, links and batch shapes.

What is drawn first is simplest, so a failure shrinks to the fewest joints, in a chain, with plain names and with
everything left out that the failure does not need.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, TypeAlias, TypeVar

from hypothesis import strategies as st

from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.testing._spec import Case, JointSpec, RobotSpec, Vector

__all__ = ["KINDS", "NAMES", "batch_shapes", "cases", "postures", "robots"]

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

_Item = TypeVar("_Item")

# Hypothesis' own DrawFn cannot be checked at run time.
Draw: TypeAlias = Callable[[st.SearchStrategy[Any]], Any]

_LENGTHS = st.one_of(st.sampled_from([0.0, 1.0, -1.0, 0.1, -0.3]), st.floats(-1.5, 1.5))
_ANGLES = st.one_of(
    st.sampled_from([0.0, math.pi / 2, -math.pi / 2, math.pi, -math.pi, 0.1, 1.5707963]), st.floats(-7.0, 7.0)
)
_SIGNED = st.sampled_from([0.0, 1.0, -1.0, 0.1, 3.0, -1e-6, 1e5])


def _is_clear(axis: Vector) -> bool:
    """Whether an axis is not so near to one of the frame's that pin 4.1.0 takes it for that one (within 1e-12)."""
    longest = max(map(abs, axis))
    return all(value == 0.0 or abs(value) > 5e-12 * longest for value in axis)


_AXES: st.SearchStrategy[Vector] = st.one_of(
    st.sampled_from([(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -2.0), (1.0, 1.0, 0.0)]),
    st.tuples(_SIGNED, _SIGNED, _SIGNED).filter(any),
    st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda axis: math.hypot(*axis) > 1e-3),
).filter(_is_clear)
_MULTIPLIERS = st.one_of(st.sampled_from([None, -1.0, 2.0, 0.5, 0.0]), st.floats(-2.0, 2.0))
_OFFSETS = st.one_of(st.sampled_from([None, 0.1, -math.pi / 2]), st.floats(-2.0, 2.0))
_LIMITS = st.one_of(
    st.sampled_from([(-1.0, 1.0), (None, None), (None, 0.5), (-0.5, None), (0.2, 0.7), (-math.pi, math.pi)]),
    st.tuples(st.floats(-3.0, 0.0), st.floats(0.0, 3.0)),
)


@dataclass(frozen=True)
class _Part:
    """All that is drawn for one joint and its child link.

    It refers to other parts by how far back they are. So whatever other part shrinking takes away, this one still says
    something: the count is not drawn beforehand, nor is an order of all.
    """

    kind: str
    back: int
    follows: int
    names: tuple[str | None, str | None]
    places: tuple[int, int]
    xyz: Vector | None
    rpy: Vector | None
    axis: Vector | None
    limits: tuple[float | None, float | None]
    multiplier: float | None
    offset: float | None


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
    # Each feature is in half the robots: what hides behind one (a long path behind branches) shows in the others.
    some_mimics, some_branches, some_names, some_shuffled = (
        allowed and draw(st.booleans()) for allowed in (mimics, branches, weird_names, shuffled)
    )
    name = st.one_of(st.none(), st.sampled_from(NAMES)) if some_names else st.none()
    place = st.integers(0, 3 if some_shuffled else 0)
    part = st.builds(
        _Part,
        kind=st.sampled_from(kinds),
        back=st.sampled_from([0, 0, 1, 2, 3] if some_branches else [0]),
        follows=st.sampled_from([0, 1, 1, 2, 3] if some_mimics else [0]),
        names=st.tuples(name, name),
        places=st.tuples(place, place),
        xyz=st.one_of(st.none(), st.tuples(_LENGTHS, _LENGTHS, _LENGTHS)),
        rpy=st.one_of(st.none(), st.tuples(_ANGLES, _ANGLES, _ANGLES)),
        axis=st.one_of(st.none(), _AXES),
        limits=_LIMITS,
        multiplier=_MULTIPLIERS,
        offset=_OFFSETS,
    )
    root, root_place = draw(name), draw(place)
    sources_later = draw(st.booleans())
    # Left to itself, a list is empty too often and long too seldom.
    fewest = min(max(draw(st.sampled_from([1, 3, 5, 0])), min_joints), max_joints)
    parts = draw(st.lists(part, min_size=fewest, max_size=max_joints))
    return _assembled(parts, root, root_place, sources_later)


def _assembled(parts: list[_Part], root: str | None, root_place: int, sources_later: bool) -> RobotSpec:
    """The robot that parts make, put in the places of the file that they ask for."""
    links = _unlike("link", [root, *(part.names[1] for part in parts)])
    names = _unlike("joint", [part.names[0] for part in parts])
    joints = []
    for index, (name, part) in enumerate(zip(names, parts, strict=True)):
        parent = links[max(0, index - part.back)]
        joint = JointSpec(name, part.kind, parent, links[index + 1], part.xyz, part.rpy)
        if part.kind != "fixed":
            joint = replace(joint, axis=part.axis)
        if part.kind in ("revolute", "prismatic"):
            joint = replace(joint, lower=part.limits[0], upper=part.limits[1])
        joints.append(joint)
    # A joint follows one that stands before it in this order, so nobody follows in a circle.
    moving = [index for index, part in enumerate(parts) if part.kind != "fixed"]
    order = moving[::-1] if sources_later else moving
    for position, index in enumerate(order):
        part = parts[index]
        if part.follows and position:
            source = order[max(0, position - part.follows)]
            joints[index] = replace(joints[index], mimic=names[source], multiplier=part.multiplier, offset=part.offset)
    joint_places = [part.places[0] for part in parts]
    link_places = [root_place, *(part.places[1] for part in parts)]
    return RobotSpec(_placed(joints, joint_places), _placed(links, link_places))


def postures(robot: RobotSpec, *, within_limits: bool = False) -> st.SearchStrategy[tuple[float, ...]]:
    """Postures of a robot: zeros, limits, quarter and half turns, next to those, anything between, and huge angles.

    Args:
        robot: The robot.
        within_limits: Only postures within the joint limits, and angles of continuous joints in [-pi, pi].

    Returns:
        Joint values in the order of ``robot.joint_names`` [rad or m].
    """
    # A slide of a million metres, and a turn of a million behind it, would leave nothing to compare.
    slides = {robot.follows(joint.name)[0] for joint in robot.joints if joint.kind == "prismatic"}
    return st.tuples(
        *[_joint_values(joint, within_limits, huge=joint.name not in slides) for joint in robot.free_joints]
    )


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
    # Counted from the file's end, so that shrinking may take away what stands before.
    links = [*(joint.child for joint in reversed(robot.joints)), robot.root]
    link = draw(st.one_of(st.just(links[0]), st.sampled_from(links)))
    return Case(robot, draw(postures(robot, within_limits=within_limits)), link)


def batch_shapes() -> st.SearchStrategy[tuple[int, ...]]:
    """Shapes of batches: none at all, one, several, nested, and empty."""
    return st.sampled_from([(), (1,), (3,), (0,), (2, 3), (3, 1, 2), (2, 0), (1, 1)])


def _unlike(word: str, wanted: Sequence[str | None]) -> list[str]:
    """A name for each, as wanted or plain, no two alike."""
    given: dict[str, None] = {}
    for index, name in enumerate(wanted):
        name = f"{word}{index}" if name is None else name
        while name in given:
            name += "'"
        given[name] = None
    return list(given)


def _placed(items: Sequence[_Item], places: Sequence[int]) -> tuple[_Item, ...]:
    """The items by place, those of one place in their own order."""
    return tuple(item for _, item in sorted(zip(places, items, strict=True), key=lambda pair: pair[0]))


def _joint_values(joint: JointSpec, within_limits: bool, huge: bool) -> st.SearchStrategy[float]:
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
        special += [1e-9, -1e-9, quarter - 1e-8, math.pi - 1e-8]
        special += [1e3, -1e6] if huge else []
        widest = 2 * math.pi
    if within_limits:
        special, low, high = [value for value in special if lower <= value <= upper], lower, upper
    else:
        low, high = -widest, widest
    return st.one_of(st.sampled_from(list(dict.fromkeys(special))), st.floats(low, high))
