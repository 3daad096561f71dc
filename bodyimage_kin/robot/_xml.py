"""XML in, the elements that are read out; whatever else stands in the file is either known to move no link or refused.

Geometry is held to the same words as kinematics, but a fault in it stays with the part that has it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Final, NoReturn
from xml.parsers import expat

from bodyimage_kin.errors import InvalidURDF
from bodyimage_kin.robot import _text
from bodyimage_kin.robot._numbers import NUMBER
from bodyimage_kin.robot._vocabulary import (
    GEOMETRIC,
    KINEMATIC,
    MANY,
    VOCABULARY,
    remedy_for,
    remedy_for_attribute,
)
from bodyimage_kin.robot._wording import Notes, shorten, title

MAX_BYTES: Final = 64 * 2**20
"""The largest file that is read [bytes]."""
MAX_DEPTH: Final = 100
"""The deepest nesting of XML elements; a chain of links is flat in URDF, however long."""
MAX_JOINTS: Final = 20_000
"""The most joints a robot may have (and one link more)."""

_MOST: Final = {"joint": MAX_JOINTS, "link": MAX_JOINTS + 1}
_XACRO: Final = re.compile(r"\bxacro[/#]*$", re.IGNORECASE)
"""The end of every address that xacro has had as a namespace."""
_NO_PREFIX: Final = "URDF knows no prefixes and no capitals here"
_EXPAND: Final = "expand the file with xacro"


@dataclass(slots=True)
class Element:
    """One XML element that matters.

    Attributes:
        tag: Its name.
        attributes: As in the file.
        line: Where it starts, from 1.
        title: How errors call it; parts go by the title of their joint or link.
        children: Those that matter, in order.
        fault: Of a part of the geometry: the first thing in it that is not known.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    title: str
    children: list[Element] = field(default_factory=list)
    fault: InvalidURDF | None = None

    def refuse(self, problem: str, remedy: str = "") -> NoReturn:
        """Raises the error of this element."""
        raise InvalidURDF(problem, element=self.title, line=self.line, remedy=remedy)

    def parts(self, tag: str) -> list[Element]:
        """The children of a tag."""
        return [child for child in self.children if child.tag == tag]

    def part(self, tag: str) -> Element | None:
        """The one child of a tag, None when there is none."""
        return next(iter(self.parts(tag)), None)


def parse(data: bytes, notes: Notes) -> Element:
    """The robot element of a file, with all in it that is read.

    Raises:
        InvalidURDF: No XML, more than is read, or words that are not known.
    """
    if len(data) > MAX_BYTES:
        raise InvalidURDF(f"the file has {len(data)} bytes, more than the {MAX_BYTES} that are read")
    text, blank_lines = _text.decode(data, notes)
    if not text:
        raise InvalidURDF("the file is empty")
    builder = _Builder(notes, blank_lines)
    try:
        builder.feed(text)
    except expat.ExpatError as error:
        line = error.lineno + blank_lines
        raise InvalidURDF(f"not well-formed XML: {expat.ErrorString(error.code)}", line=line) from error
    except (ValueError, LookupError, OverflowError, MemoryError) as error:
        raise InvalidURDF(f"not readable as XML: {error}") from error
    if builder.root is None:
        raise InvalidURDF("the file has no element")
    return builder.root


class _Builder:
    """Collects the elements that matter while expat walks the file, and refuses what must not be in it."""

    def __init__(self, notes: Notes, blank_lines: int) -> None:
        self.root: Element | None = None
        self._notes, self._blank_lines = notes, blank_lines
        self._open: list[Element] = []
        self._depth = 0
        self._counts = dict.fromkeys(_MOST, 0)
        self._prefixes = {"xacro": True, "drake": False}
        """Namespace prefixes so far, and whether they are xacro's."""
        # The text has been decoded by now, whatever it declares. Without a namespace separator expat hands out
        # prefixes as written, so they can be looked at.
        self._parser = expat.ParserCreate("utf-8")
        self._parser.StartDoctypeDeclHandler = self._doctype
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._characters

    def feed(self, text: str) -> None:
        self._parser.Parse(text.encode(), True)

    @property
    def _line(self) -> int:
        return int(self._parser.CurrentLineNumber) + self._blank_lines

    def _doctype(self, name: str, system_id: str | None, public_id: str | None, has_internal_subset: int) -> None:
        raise InvalidURDF("a DOCTYPE (and the entities it may define) is refused", line=self._line, remedy="remove it")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise InvalidURDF(f"elements are nested more than {MAX_DEPTH} deep", line=self._line)
        if self._depth > len(self._open) + 1:
            return  # inside something that is not read
        parent = self._open[-1] if self._open else None
        inside = parent is not None and parent.tag != "robot"
        element = Element(tag, attributes, self._line, parent.title if inside and parent else title(tag, attributes))
        self._learn_prefixes(element)
        if parent is None:
            self._check_root(element)
            self.root = element
        elif not self._is_read(element, parent) or self._repeats(element, parent):
            return  # not opened, and so nothing in it is looked at
        else:
            parent.children.append(element)
        self._open.append(element)
        self._check_namespace(element)
        self._count(element)
        self._check_attributes(element)

    def _end(self, tag: str) -> None:
        if self._depth == len(self._open):
            self._open.pop()
        self._depth -= 1

    def _characters(self, data: str) -> None:
        if self._depth != len(self._open) or not self._open or not data.strip():
            return
        element = self._open[-1]
        if VOCABULARY[element.tag].text:
            self._notes.pass_over(f"text in <{element.tag}>", self._line)
        else:
            at = Element(element.tag, {}, self._line, element.title)
            self._report(at, f"text inside <{element.tag}>", "numbers and names are attributes: remove it")

    def _learn_prefixes(self, element: Element) -> None:
        for key, address in element.attributes.items():
            if key.startswith("xmlns:"):
                # That of xacro itself is known by its name too, whatever a file binds it to.
                self._prefixes[key[6:]] = key == "xmlns:xacro" or bool(_XACRO.search(address))

    def _check_namespace(self, element: Element) -> None:
        address = element.attributes.get("xmlns")
        if address is None:
            return
        if _XACRO.search(address):
            element.refuse("the default namespace is xacro's", _EXPAND)
        problem, reading = f"a default namespace on <{element.tag}>", "read as if it were not there"
        self._notes.allow(problem, reading, element=element.title, line=element.line, remedy="remove xmlns=")

    def _check_root(self, element: Element) -> None:
        tag = element.tag
        prefix, _, local = tag.rpartition(":")
        if self._prefixes.get(prefix):
            element.refuse(f"a leftover <{shorten(tag)}>", _EXPAND)
        if tag != "robot":
            if local.lower() == "robot":
                element.refuse(f"<{shorten(tag)}> is not <robot>", _NO_PREFIX)
            element.refuse(f"the root element is <{shorten(tag)}>, not <robot>", "give a URDF")

    def _is_read(self, element: Element, parent: Element) -> bool:
        """Whether an element is read; what is not must be known to say nothing of what is read."""
        tag, known = element.tag, VOCABULARY[parent.tag]
        if tag in known.read:
            return True
        prefix, _, local = tag.rpartition(":")
        place = f"<{shorten(tag)}> in <{parent.tag}>"
        if self._prefixes.get(prefix):
            self._report(element, f"a leftover <{shorten(tag)}>", _EXPAND)
        elif local.lower() in known.read:
            self._report(element, f"<{shorten(tag)}> is not <{local.lower()}>", _NO_PREFIX)
        elif prefix and local in KINEMATIC:
            self._report(element, f"{place} may move links, and is not read", "expand it, or leave it out")
        elif prefix and prefix not in self._prefixes:
            self._report(element, f"{place} has a prefix that nothing declares", f"remove it, or declare {prefix!r}")
        elif prefix or tag in known.passed_over:
            self._notes.pass_over(place, element.line)
        else:
            known_word = "is not read" if tag in KINEMATIC else "is not known"
            self._report(element, f"{place} {known_word}", remedy_for(tag, parent.tag))
        return False

    def _repeats(self, element: Element, parent: Element) -> bool:
        """Whether an element that may stand only once says again what an earlier one said."""
        first = None if (parent.tag, element.tag) in MANY else parent.part(element.tag)
        if first is None:
            return False
        problem = f"a second <{element.tag}> in one {'joint' if parent.tag == 'joint' else f'<{parent.tag}>'}"
        if element.tag in GEOMETRIC:
            element.fault = InvalidURDF(problem, element=element.title, line=element.line, remedy="keep one")
            return False
        if not first.children and _same(first, element):
            reading = "it says the same, and is passed over"
            self._notes.allow(problem, reading, element=element.title, line=element.line, remedy="keep one")
        else:
            self._report(element, problem, "keep one")
        return True

    def _count(self, element: Element) -> None:
        if element.tag in self._counts and len(self._open) == 2:
            self._counts[element.tag] += 1
            if self._counts[element.tag] > _MOST[element.tag]:
                element.refuse(f"the robot has more than {_MOST[element.tag]} {element.tag}s")

    def _check_attributes(self, element: Element) -> None:
        known = VOCABULARY[element.tag]
        for key in element.attributes:
            if key in known.attributes or key in known.ignored or key == "xmlns" or key.startswith("xmlns:"):
                continue
            prefix, _, local = key.rpartition(":")
            place = f"{shorten(key)}= in <{element.tag}>"
            if local.lower() in known.attributes:
                self._report(element, f"{shorten(key)}= is not {local.lower()}=", _NO_PREFIX)
            elif self._prefixes.get(prefix):
                self._report(element, f"a leftover {place}", _EXPAND)
            elif prefix:
                self._notes.pass_over(place, element.line)
            else:
                self._report(element, f"{place} is not known", remedy_for_attribute(key, element.tag))

    def _report(self, element: Element, problem: str, remedy: str) -> None:
        """Refuse the file; or, inside the geometry, the part."""
        error = InvalidURDF(problem, element=element.title, line=element.line, remedy=remedy)
        part = next((opened for opened in reversed(self._open) if opened.tag in GEOMETRIC), None)
        if part is None:
            raise error
        part.fault = part.fault or error


def _same(one: Element, other: Element) -> bool:
    """Whether two elements give every attribute that is read the same value."""
    keys = VOCABULARY[one.tag].attributes
    return all(_words(one.attributes.get(key)) == _words(other.attributes.get(key)) for key in keys)


def _words(text: str | None) -> list[float | str] | None:
    """The words of an attribute, numbers as numbers."""
    if text is None:
        return None
    return [float(word) if NUMBER.fullmatch(word) else word for word in text.split()]
