"""The URDF reader: bytes in, a checked kinematic tree and its geometry out, or one clear reason why not.

Robot libraries guess: they repair broken XML, weld joints they do not know, and take NaN for a number. A ground truth
must not rest on a guess, so whatever could change the kinematics is either understood or refused. What others write
carelessly and can be meant in one way only is read that way, and noted; a strict reader refuses that as well.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Mapping
from typing import Final, NamedTuple, get_args

from bodyimage_kin.robot._geometry_reader import read_geometry
from bodyimage_kin.robot._numbers import MIN_NORM, number, numbers, placement, required, vector
from bodyimage_kin.robot._wording import Notes, closest, guess, listed, quote
from bodyimage_kin.robot._xml import MAX_BYTES as MAX_BYTES
from bodyimage_kin.robot._xml import MAX_DEPTH as MAX_DEPTH
from bodyimage_kin.robot._xml import MAX_JOINTS as MAX_JOINTS
from bodyimage_kin.robot._xml import Element, parse
from bodyimage_kin.robot.geometry import LinkGeometry
from bodyimage_kin.robot.transforms import Vector
from bodyimage_kin.robot.tree import UNLIMITED, Joint, JointKind, KinematicTree, Mimic, welded

__all__ = ["MAX_BYTES", "MAX_DEPTH", "MAX_JOINTS", "Reading", "read_urdf"]

_KINDS: Final[dict[str, JointKind]] = {kind: kind for kind in get_args(JointKind)}
_INSTEAD: Final = {
    "planar": "write it as two prismatic joints and a continuous one",
    "floating": "only the joint under the root may float: make it fixed, or let its child be a robot of its own",
    **dict.fromkeys(("ball", "spherical"), "write it as three revolute joints about x, y and z"),
}
"""What to write in place of a joint of more than one value."""


class Reading(NamedTuple):
    """What a URDF says.

    Attributes:
        tree: Links and joints.
        geometry: What each link has beside its frame.
        notes: A line for each thing that was read leniently, left out or passed over.
    """

    tree: KinematicTree
    geometry: Mapping[str, LinkGeometry]
    notes: tuple[str, ...]


def read_urdf(data: bytes, *, name: str = "robot", strict: bool = False) -> Reading:
    """Read and check a URDF.

    Args:
        data: The whole file, in the encoding that its byte order mark shows or that it declares, else UTF-8.
        name: The robot's name if the file gives none.
        strict: Refuse what is written carelessly, even if it can be meant in one way only.

    Returns:
        Links and joints in order of appearance, known to form one tree. Axes have unit norm; a missing ``<axis>`` is
        x, a missing ``<origin>`` the identity, a missing lower or upper limit 0, as URDF says.

    Raises:
        InvalidURDF: For anything that would leave the kinematics in doubt, with the element and line at fault.
    """
    notes = Notes(strict)
    robot = parse(data, notes)
    name = _robot_name(robot, name, notes)
    links, joints = _named(robot, "link"), _named(robot, "joint")
    if not links:
        robot.refuse("the robot has no link", "add at least one <link>")
    links = _with_world(links, joints, notes)
    links, joints = _without_floating_root(links, joints, notes)
    tree = {name: _joint(name, element, notes) for name, element in joints.items()}
    tree = _checked_mimics(tree, joints, notes)
    root = _find_root(links, tree, joints, robot)
    checked = KinematicTree(name, root, tuple(links), tuple(tree.values()))
    return Reading(checked, read_geometry(robot, links, notes), notes.lines())


def _robot_name(robot: Element, fallback: str, notes: Notes) -> str:
    if robot.attributes.get("name", "").strip():
        return required(robot, "name")
    problem = "<robot> has an empty name" if "name" in robot.attributes else "<robot> has no name"
    notes.allow(problem, f"it is called {quote(fallback)}", element="robot", line=robot.line, remedy='write name="..."')
    return fallback


def _named(robot: Element, tag: str) -> dict[str, Element]:
    found: dict[str, Element] = {}
    for element in robot.parts(tag):
        first = found.setdefault(required(element, "name"), element)
        if first is not element:
            element.refuse(f"the name is taken by the {tag} on line {first.line}", "give each its own name")
    return found


def _linked(joint: Element, role: str) -> str:
    """The parent or child link that a joint names."""
    part = joint.part(role)
    if part is None:
        joint.refuse(f"<{role}> is missing", f'add <{role} link="..."/>')
    return required(part, "link")


def _with_world(links: dict[str, Element], joints: Mapping[str, Element], notes: Notes) -> dict[str, Element]:
    """The links, and the link ``world`` where a joint hangs from it and nobody declares it."""
    if "world" in links:
        return links
    joint = next((element for element in joints.values() if _linked(element, "parent") == "world"), None)
    if joint is None:
        return links
    problem, remedy = "its parent link 'world' is not declared", 'add <link name="world"/>'
    notes.allow(problem, "it is added", element=joint.title, line=joint.line, remedy=remedy)
    return {"world": Element("link", {"name": "world"}, joint.line, "link 'world'"), **links}


def _without_floating_root(
    links: dict[str, Element], joints: dict[str, Element], notes: Notes
) -> tuple[dict[str, Element], dict[str, Element]]:
    """Links and joints without a root from which nothing but one floating joint hangs: its child is the root."""
    floating = [name for name, joint in joints.items() if joint.attributes.get("type") == "floating"]
    if not floating:
        return links, joints
    carried = Counter(_linked(joint, "parent") for joint in joints.values())
    children = {_linked(joint, "child") for joint in joints.values()}
    for name in floating:
        joint = joints[name]
        parent, child = _linked(joint, "parent"), _linked(joint, "child")
        if parent in children or parent not in links or child not in links:
            continue
        if carried[parent] > 1:
            problem = f"a floating joint under the root {quote(parent)}, which carries other links as well"
            joint.refuse(problem, f"make it fixed, or let {quote(child)} be a robot of its own")
        problem = "a floating joint under the root"
        reading = f"read without it and without link {quote(parent)}: {quote(child)} is the root"
        remedy = f"leave it and link {quote(parent)} out"
        notes.allow(problem, reading, element=joint.title, line=joint.line, remedy=remedy)
        links, joints = dict(links), dict(joints)
        del links[parent], joints[name]
        break
    return links, joints


def _joint(name: str, element: Element, notes: Notes) -> Joint:
    kind = _kind(element)
    parent, child = _linked(element, "parent"), _linked(element, "child")
    xyz, rpy = placement(element.part("origin"))
    if kind == "fixed":
        return Joint(name, kind, parent, child, xyz, rpy)
    axis = _axis(element.part("axis"))
    lower, upper = (-math.inf, math.inf) if kind == "continuous" else _limits(element, notes)
    return Joint(name, kind, parent, child, xyz, rpy, axis, lower, upper, _mimic(element.part("mimic")))


def _kind(element: Element) -> JointKind:
    name = required(element, "type")
    kind = _KINDS.get(name)
    if kind is None:
        meant = closest(name.strip().lower(), _KINDS)
        remedy = _INSTEAD.get(name) or (f"did you mean {quote(meant)}?" if meant else f"use one of {', '.join(_KINDS)}")
        element.refuse(f"joint type {quote(name)} is not supported", remedy)
    return kind


def _axis(element: Element | None) -> Vector:
    if element is None:
        return (1.0, 0.0, 0.0)
    if any(numbers(element, "rpy", 3) or ()):
        element.refuse("<axis> has an rpy, which URDF does not know", "turn xyz instead")
    axis = vector(element, "xyz")
    if axis is None:
        element.refuse("<axis> has no xyz", 'write <axis xyz="..."/>, or leave it out for x')
    norm = math.hypot(*axis)
    if norm < MIN_NORM:
        element.refuse(f"the axis is zero: its norm is {norm!r}", "give the direction of the motion")
    if math.isinf(norm):
        element.refuse("the axis is too long for a float64", "give a unit vector")
    # A unit axis is kept to the bit, so that what was written from a tree reads back as the same tree.
    if abs(norm - 1.0) <= 4.0 * sys.float_info.epsilon:
        return axis
    x, y, z = axis
    return (x / norm, y / norm, z / norm)


def _limits(joint: Element, notes: Notes) -> tuple[float, float]:
    element = joint.part("limit")
    if element is None:
        remedy = "add it, or make a turning joint continuous"
        notes.allow("<limit> is missing", "read without limits", element=joint.title, line=joint.line, remedy=remedy)
        return -math.inf, math.inf
    lower, upper = number(element, "lower", 0.0), number(element, "upper", 0.0)
    if lower > upper:
        problem = f"the lower limit {lower!r} is above the upper limit {upper!r}"
        remedy = "swap or correct them"
        notes.allow(problem, "read without limits", element=element.title, line=element.line, remedy=remedy)
        return -math.inf, math.inf
    return -math.inf if lower <= -UNLIMITED else lower, math.inf if upper >= UNLIMITED else upper


def _mimic(element: Element | None) -> Mimic | None:
    if element is None:
        return None
    return Mimic(required(element, "joint"), number(element, "multiplier", 1.0), number(element, "offset", 0.0))


def _checked_mimics(joints: dict[str, Joint], elements: Mapping[str, Element], notes: Notes) -> dict[str, Joint]:
    """The joints, those that follow a joint which does not move welded where they then stand."""
    followed = {name: joint.mimic.joint for name, joint in joints.items() if joint.mimic}
    for name, source in followed.items():
        if source not in joints:
            elements[name].refuse(f"it mimics joint {quote(source)}, which does not exist", guess(source, joints))
        if source == name:
            elements[name].refuse("it mimics itself", "remove the <mimic> or name another joint")
    cycle = _find_cycle(followed)
    if cycle:
        elements[cycle[0]].refuse(f"joints mimic one another in a loop: {listed(cycle)}", "let one of them be free")
    # Where a joint stands that cannot move; None: it moves.
    standing = {name: 0.0 if joint.kind == "fixed" else None for name, joint in joints.items() if not joint.mimic}
    checked = dict(joints)
    for name in followed:
        trail, here = [], name
        while here not in standing:
            trail.append(here)
            here = followed[here]
        for follower in reversed(trail):
            joint, place = joints[follower], standing[followed[follower]]
            if place is None or joint.mimic is None:
                standing[follower] = None
                continue
            value = standing[follower] = joint.mimic.multiplier * place + joint.mimic.offset
            problem, element = f"it mimics joint {quote(followed[follower])}, which is fixed", elements[follower]
            reading, remedy = f"welded at {value!r}", "make it fixed"
            notes.allow(problem, reading, element=element.title, line=element.line, remedy=remedy)
            checked[follower] = welded(joint, value)
    return checked


def _find_root(
    links: Mapping[str, Element], joints: Mapping[str, Joint], elements: Mapping[str, Element], robot: Element
) -> str:
    """The one link without a parent, once the joints are known to make a tree of the links."""
    above: dict[str, Joint] = {}
    for name, joint in joints.items():
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                elements[name].refuse(f"its {role} link {quote(link)} does not exist", guess(link, links))
        first = above.setdefault(joint.child, joint)
        if first is not joint:
            problem = f"link {quote(joint.child)} has two parents: it is also the child of joint {quote(first.name)}"
            elements[name].refuse(problem, "a link hangs from one joint only")
    cycle = _find_cycle({child: joint.parent for child, joint in above.items()})
    if cycle:
        names = [above[link].name for link in (cycle[0], *cycle[:0:-1])]  # from parent to child
        elements[names[0]].refuse(f"joints form a cycle: {listed(names)}", "a robot is a tree: cut the loop")
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        robot.refuse(f"the robot has {len(roots)} roots: {listed(roots)}", "join them, so that one link has no parent")
    return roots[0]


def _find_cycle(successor: Mapping[str, str]) -> list[str]:
    """The names on a cycle of a graph in which each name leads to at most one other; empty if there is none."""
    cleared: set[str] = set()
    for name in successor:
        trail: dict[str, None] = {}
        while name in successor and name not in cleared:
            if name in trail:
                trailed = list(trail)
                return trailed[trailed.index(name) :]
            trail[name] = None
            name = successor[name]
        cleared.update(trail)
    return []
