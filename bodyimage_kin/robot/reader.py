"""The strict URDF reader: bytes in, a checked kinematic tree out, or one clear reason why not.

Robot libraries guess: they repair broken XML, weld joints they do not know, and take NaN for a number. A ground truth
must not rest on a guess, so whatever could change the kinematics is either understood or refused. Whatever cannot
change them (geometry, inertia, transmissions, simulators' settings) is passed over unread.
"""

from __future__ import annotations

import difflib
import math
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NoReturn, get_args
from xml.parsers import expat

from bodyimage_kin.errors import InvalidURDF
from bodyimage_kin.robot.tree import Joint, JointKind, KinematicTree, Mimic, Vector

MAX_BYTES: Final = 64 * 2**20
"""The largest file that is read [bytes]."""
MAX_DEPTH: Final = 100
"""The deepest nesting of XML elements; a chain of links is flat in URDF, however long."""
MAX_JOINTS: Final = 20_000
"""The most joints a robot may have (and one link more)."""
MIN_AXIS_NORM: Final = 1e-9
"""An axis shorter than this has no direction."""

_KINDS: Final[dict[str, JointKind]] = {kind: kind for kind in get_args(JointKind)}
_ENCODINGS: Final = ("utf-8", "utf-16", "utf-16le", "utf-16be", "us-ascii", "iso-8859-1")
_READ_INSIDE: Final[dict[str, frozenset[str]]] = {
    "robot": frozenset({"link", "joint"}),
    "joint": frozenset({"origin", "axis", "limit", "mimic", "parent", "child"}),
}
"""The children that are read, by the tag of their parent."""
_READ_OF: Final[dict[str, frozenset[str]]] = {
    "robot": frozenset({"name"}),
    "link": frozenset({"name"}),
    "joint": frozenset({"name", "type"}),
    "origin": frozenset({"xyz", "rpy"}),
    "axis": frozenset({"xyz"}),
    "limit": frozenset({"lower", "upper"}),
    "mimic": frozenset({"joint", "multiplier", "offset"}),
    "parent": frozenset({"link"}),
    "child": frozenset({"link"}),
}
"""The attributes that are read, by tag."""

# What every parser of the field agrees on: Python's float would also take 1_0, nan and digits of other scripts.
_NUMBER: Final = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_SPACE: Final = " \t\r\n"
_REMEDIES: Final = (
    (re.compile(r"[+-]?(?:nan|inf)", re.IGNORECASE), "numbers must be finite"),
    (re.compile(r"[+-]?0x", re.IGNORECASE), "write it in decimal, not hexadecimal"),
    (re.compile(r"[^,]*,"), "write decimals with a point, and spaces between numbers"),
    (re.compile(r"[0-9+-]*_"), "write it without underscores"),
)


def read_urdf(data: bytes) -> KinematicTree:
    """Read and check the kinematics of a URDF.

    Args:
        data: The whole file, in the encoding it declares (UTF-8 if it declares none).

    Returns:
        Links and joints in order of appearance, known to form one tree. Axes have unit norm; a missing ``<axis>`` is
        x, a missing ``<origin>`` the identity, a missing lower or upper limit 0, as URDF says.

    Raises:
        InvalidURDF: For anything that would leave the kinematics in doubt, with the element and line at fault.
    """
    robot = _parse(data)
    name = _required(robot, "name")
    links: dict[str, _Element] = {}
    joints: dict[str, _Element] = {}
    for element in robot.children:
        known = links if element.tag == "link" else joints
        first = known.setdefault(_required(element, "name"), element)
        if first is not element:
            _refuse(element, f"the name is taken by the {element.tag} on line {first.line}", "give each its own name")
    if not links:
        _refuse(robot, "the robot has no link", "add at least one <link>")
    tree = {joint_name: _joint(joint_name, element) for joint_name, element in joints.items()}
    _check_mimics(tree, joints)
    root = _find_root(links, tree, joints, robot)
    return KinematicTree(name, root, tuple(links), tuple(tree.values()))


@dataclass(slots=True)
class _Element:
    """One XML element that matters.

    Attributes:
        tag: Its name.
        attributes: As in the file.
        line: Where it starts, from 1.
        title: How errors call it; the parts of a joint go by the joint's title.
        children: Those that matter, in order.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    title: str
    children: list[_Element] = field(default_factory=list)


class _Builder:
    """Collects the elements that matter while expat walks the file, and refuses what must not be in it."""

    def __init__(self) -> None:
        self.root: _Element | None = None
        self._open: list[_Element] = []
        self._depth = 0
        self._counts = {"link": 0, "joint": 0}
        # Without a namespace separator expat hands out prefixes as written, so they can be refused.
        self._parser = expat.ParserCreate()
        self._parser.XmlDeclHandler = self._declaration
        self._parser.StartDoctypeDeclHandler = self._doctype
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end

    def feed(self, data: bytes) -> None:
        self._parser.Parse(data, True)

    def _declaration(self, version: str, encoding: str | None, standalone: int) -> None:
        # Expat would ask Python for any other codec, some of which are no character sets at all.
        if encoding is not None and encoding.lower() not in _ENCODINGS:
            problem = f"the declared encoding {_quote(encoding)} is not read here"
            raise InvalidURDF(problem, line=1, remedy="save the file as UTF-8 and declare that")

    def _doctype(self, name: str, system_id: str | None, public_id: str | None, has_internal_subset: int) -> None:
        line = self._parser.CurrentLineNumber
        raise InvalidURDF("a DOCTYPE (and the entities it may define) is refused", line=line, remedy="remove it")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            line = self._parser.CurrentLineNumber
            raise InvalidURDF(f"elements are nested more than {MAX_DEPTH} deep", line=line)
        if self._depth > len(self._open) + 1:
            return  # inside something that is not read
        parent = self._open[-1] if self._open else None
        title = parent.title if parent and parent.tag == "joint" else _title(tag, attributes)
        element = _Element(tag, attributes, self._parser.CurrentLineNumber, title)
        if tag.startswith("xacro:"):
            _refuse(element, f"a leftover <{_shorten(tag)}>", "expand the file with xacro")
        read = _READ_INSIDE.get(parent.tag, frozenset()) if parent else frozenset({"robot"})
        if tag in read:
            self._keep(element, parent)
            return
        _refuse_misspelt(element, tag, read, "<{}>")
        if parent is None:
            _refuse(element, f"the root element is <{_shorten(tag)}>, not <robot>", "give a URDF")

    def _keep(self, element: _Element, parent: _Element | None) -> None:
        tag = element.tag
        if "xmlns" in element.attributes:
            _refuse(element, f"a default namespace on <{tag}>", "remove xmlns=")
        for key in element.attributes:
            if key not in _READ_OF[tag] and not key.startswith("xmlns:"):
                _refuse_misspelt(element, key, _READ_OF[tag], "{}=")
        if tag in self._counts:
            self._counts[tag] += 1
            most = MAX_JOINTS + (tag == "link")
            if self._counts[tag] > most:
                _refuse(element, f"the robot has more than {most} {tag}s")
        if parent is None:
            self.root = element
        else:
            # Refused while reading, so that a joint never holds more than one part of each kind.
            if parent.tag == "joint" and any(part.tag == tag for part in parent.children):
                _refuse(element, f"a second <{tag}> in one joint", "keep one")
            parent.children.append(element)
        self._open.append(element)

    def _end(self, tag: str) -> None:
        if self._depth == len(self._open):
            self._open.pop()
        self._depth -= 1


def _parse(data: bytes) -> _Element:
    """The robot element of a file, with the links, joints and parts of joints in it."""
    if len(data) > MAX_BYTES:
        raise InvalidURDF(f"the file has {len(data)} bytes, more than the {MAX_BYTES} that are read")
    if not data.strip():
        raise InvalidURDF("the file is empty")
    builder = _Builder()
    try:
        builder.feed(data)
    except expat.ExpatError as error:
        raise InvalidURDF(f"not well-formed XML: {expat.ErrorString(error.code)}", line=error.lineno) from error
    except (ValueError, LookupError, OverflowError, MemoryError) as error:
        raise InvalidURDF(f"not readable as XML: {error}") from error
    if builder.root is None:
        raise InvalidURDF("the file has no element")
    return builder.root


def _joint(name: str, element: _Element) -> Joint:
    kind_name = _required(element, "type")
    kind = _KINDS.get(kind_name)
    if kind is None:
        _refuse(element, f"joint type {_quote(kind_name)} is not supported", f"use one of {', '.join(_KINDS)}")
    parts = {part.tag: part for part in element.children}
    for tag in ("parent", "child"):
        if tag not in parts:
            _refuse(element, f"<{tag}> is missing", f'add <{tag} link="..."/>')
    parent, child = _required(parts["parent"], "link"), _required(parts["child"], "link")
    xyz = rpy = (0.0, 0.0, 0.0)
    if "origin" in parts:
        xyz, rpy = _origin(parts["origin"])
    if kind == "fixed":
        return Joint(name, kind, parent, child, xyz, rpy)
    axis = _axis(parts["axis"]) if "axis" in parts else (1.0, 0.0, 0.0)
    lower, upper = (-math.inf, math.inf) if kind == "continuous" else _limits(element, parts.get("limit"))
    mimic = _mimic(parts["mimic"]) if "mimic" in parts else None
    return Joint(name, kind, parent, child, xyz, rpy, axis, lower, upper, mimic)


def _origin(element: _Element) -> tuple[Vector, Vector]:
    # Newer URDF may give the orientation as a quaternion; to pass over it would turn the link.
    if "quat_xyzw" in element.attributes:
        _refuse(element, "<origin> with quat_xyzw is not supported", "write the orientation as rpy")
    zero = (0.0, 0.0, 0.0)
    return _vector(element, "xyz") or zero, _vector(element, "rpy") or zero


def _axis(element: _Element) -> Vector:
    axis = _vector(element, "xyz")
    if axis is None:
        _refuse(element, "<axis> has no xyz", 'write <axis xyz="..."/>, or leave it out for x')
    norm = math.hypot(*axis)
    if norm < MIN_AXIS_NORM:
        _refuse(element, f"the axis is zero: its norm is {norm!r}", "give the direction of the motion")
    if math.isinf(norm):
        _refuse(element, "the axis is too long for a float64", "give a unit vector")
    # A unit axis is kept to the bit, so that what was written from a tree reads back as the same tree.
    if abs(norm - 1.0) <= 4.0 * sys.float_info.epsilon:
        return axis
    x, y, z = axis
    return (x / norm, y / norm, z / norm)


def _limits(joint: _Element, element: _Element | None) -> tuple[float, float]:
    if element is None:
        _refuse(joint, "<limit> is missing", "add it, or make a turning joint continuous")
    lower, upper = _number(element, "lower", 0.0), _number(element, "upper", 0.0)
    if lower > upper:
        _refuse(element, f"the lower limit {lower!r} is above the upper limit {upper!r}", "swap or correct them")
    return lower, upper


def _mimic(element: _Element) -> Mimic:
    source = _required(element, "joint")
    return Mimic(source, _number(element, "multiplier", 1.0), _number(element, "offset", 0.0))


def _check_mimics(joints: Mapping[str, Joint], elements: Mapping[str, _Element]) -> None:
    followed = {name: joint.mimic.joint for name, joint in joints.items() if joint.mimic}
    for name, source in followed.items():
        if source not in joints:
            _refuse(elements[name], f"it mimics joint {_quote(source)}, which does not exist", _guess(source, joints))
        if source == name:
            _refuse(elements[name], "it mimics itself", "remove the <mimic> or name another joint")
        if joints[source].kind == "fixed":
            _refuse(elements[name], f"it mimics joint {_quote(source)}, which is fixed", "remove the <mimic>")
    cycle = _find_cycle(followed)
    if cycle:
        _refuse(elements[cycle[0]], f"joints mimic one another in a loop: {_list(cycle)}", "let one of them be free")


def _find_root(
    links: Mapping[str, _Element], joints: Mapping[str, Joint], elements: Mapping[str, _Element], robot: _Element
) -> str:
    """The one link without a parent, once the joints are known to make a tree of the links."""
    above: dict[str, Joint] = {}
    for name, joint in joints.items():
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                _refuse(elements[name], f"its {role} link {_quote(link)} does not exist", _guess(link, links))
        first = above.setdefault(joint.child, joint)
        if first is not joint:
            problem = f"link {_quote(joint.child)} has two parents: it is also the child of joint {_quote(first.name)}"
            _refuse(elements[name], problem, "a link hangs from one joint only")
    cycle = _find_cycle({child: joint.parent for child, joint in above.items()})
    if cycle:
        names = [above[link].name for link in (cycle[0], *cycle[:0:-1])]  # from parent to child
        _refuse(elements[names[0]], f"joints form a cycle: {_list(names)}", "a robot is a tree: cut the loop")
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        _refuse(robot, f"the robot has {len(roots)} roots: {_list(roots)}", "join them, so that one link has no parent")
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


def _attribute(element: _Element, key: str) -> str | None:
    value = element.attributes.get(key)
    if value is not None and ("${" in value or "$(" in value):
        _refuse(element, f"a leftover expression in {key}={_quote(value)}", "expand it with xacro")
    return value


def _required(element: _Element, key: str) -> str:
    value = _attribute(element, key)
    if value is None:
        _refuse(element, f"<{element.tag}> has no {key}", f'write {key}="..."')
    if not value.strip():
        _refuse(element, f"<{element.tag}> has an empty {key}", "fill it in")
    return value


def _vector(element: _Element, key: str) -> Vector | None:
    numbers = _numbers(element, key, 3)
    return (numbers[0], numbers[1], numbers[2]) if numbers else None


def _number(element: _Element, key: str, default: float) -> float:
    numbers = _numbers(element, key, 1)
    return numbers[0] if numbers else default


def _numbers(element: _Element, key: str, count: int) -> list[float] | None:
    text = _attribute(element, key)
    if text is None:
        return None
    place = f"<{element.tag}> {key}={_quote(text)}"
    words = re.split(f"[{_SPACE}]+", text.strip(_SPACE), maxsplit=count)
    if words == [""]:
        _refuse(element, f"{place} is empty", f"leave {key} out, or give {_amount(count)}")
    numbers = []
    for word in words[:count]:
        if not _NUMBER.fullmatch(word):
            remedy = next((remedy for pattern, remedy in _REMEDIES if pattern.match(word)), "")
            _refuse(element, f"{place}: {_quote(word)} is not a number", remedy)
        numbers.append(float(word))
        if math.isinf(numbers[-1]):
            _refuse(element, f"{place}: {_quote(word)} is too large for a float64", "numbers must be finite")
    if len(words) != count:
        given = f"more than {_amount(count)}" if len(words) > count else _amount(len(words))
        _refuse(element, f"{place} has {given}", f"give {count}")
    return numbers


def _refuse(element: _Element, problem: str, remedy: str = "") -> NoReturn:
    raise InvalidURDF(problem, element=element.title, line=element.line, remedy=remedy)


def _refuse_misspelt(element: _Element, name: str, read: Iterable[str], form: str) -> None:
    """Refuse a name that but for its prefix or its capitals would be read: to pass over it would change the robot."""
    plain = name.rpartition(":")[2].lower()
    if plain in read:
        problem = f"{form.format(_shorten(name))} is not {form.format(plain)}"
        _refuse(element, problem, "URDF knows no prefixes and no capitals here")


def _guess(name: str, known: Iterable[str]) -> str:
    matches = difflib.get_close_matches(_shorten(name), known, n=1)
    return f"did you mean {_quote(matches[0])}?" if matches else "correct the name"


def _title(tag: str, attributes: Mapping[str, str]) -> str:
    name = attributes.get("name")
    return f"{_shorten(tag)} {_quote(name)}" if name else _shorten(tag)


def _shorten(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:77]}..."


def _quote(text: str) -> str:
    return repr(_shorten(text))


def _list(names: Sequence[str]) -> str:
    """The names, quoted; of many only the first, enough to find the fault."""
    more = f" and {len(names) - 10} more" if len(names) > 10 else ""
    return ", ".join(_quote(name) for name in names[:10]) + more


def _amount(count: int) -> str:
    return f"{count} number{'s' if count != 1 else ''}"
