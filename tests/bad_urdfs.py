"""One good URDF, and many ways to spoil it: each with the problem, the element and the line that must be named.

Those in :data:`BAD` are never read; those in :data:`CARELESS` are read with a note, and refused by a strict reader.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

from bodyimage_kin.robot.reader import MAX_BYTES, MAX_DEPTH, MAX_JOINTS

GOOD = """<?xml version="1.0" encoding="utf-8"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper"/>
  <link name="lower"/>
  <link name="finger"/>
  <link name="wheel"/>
  <link name="tip"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <origin xyz="0.1 2e-1 -.3" rpy="0.4 0.5 0.6"/>
    <axis xyz="0.0 3.0 4.0"/>
    <limit lower="-1.25" upper="2.5" effort="10" velocity="3"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="upper"/>
    <child link="lower"/>
    <limit upper="0.125"/>
  </joint>
  <joint name="grip" type="revolute">
    <parent link="lower"/>
    <child link="finger"/>
    <limit lower="-7" upper="7"/>
    <mimic joint="shoulder" multiplier="-2.75" offset="0.375"/>
  </joint>
  <joint name="spin" type="continuous">
    <parent link="upper"/>
    <child link="wheel"/>
    <axis xyz="0 1 0"/>
  </joint>
  <joint name="weld" type="fixed">
    <parent link="wheel"/>
    <child link="tip"/>
  </joint>
</robot>
"""


class BadURDF(NamedTuple):
    """A file that must be refused, or one that a strict reader refuses.

    Attributes:
        id: What is bad about it.
        data: The file.
        problem: A regular expression that the message matches.
        element: The element that the error names.
        line: The line that it names; None when it has none to name.
        reading: A regular expression that the note of a lenient reader matches.
    """

    id: str
    data: bytes
    problem: str
    element: str = ""
    line: int | None = None
    reading: str = ""


def line_of(text: str) -> int:
    """The line of the good file on which a text, unique in it, begins."""
    assert GOOD.count(text) == 1, f"{GOOD.count(text)} times in the good file: {text!r}"
    return GOOD[: GOOD.index(text)].count("\n") + 1


def spoil(id: str, old: str, new: str, problem: str, element: str, at: str | None = None) -> BadURDF:
    """The good file with one text replaced; the fault lies where `at` (default: the replaced text) begins."""
    line = line_of(old if at is None else at)
    return BadURDF(id, GOOD.replace(old, new).encode(), problem, element, line)


def allow(reading: str, bad: BadURDF) -> BadURDF:
    """The file as one that is read with a note."""
    return bad._replace(reading=reading)


SHOULDER, SLIDE, GRIP, SPIN, WELD = (f"joint '{name}'" for name in ("shoulder", "slide", "grip", "spin", "weld"))
ROBOT = "robot 'arm'"
MISSPELT = "is not .*; URDF knows no prefixes and no capitals here"

# Where each number that is read stands: the text around it, and the joint it belongs to.
NUMBERS = {
    "origin xyz": ("0.1 2e-1 -.3", "0.1 {} -.3", SHOULDER),
    "origin rpy": ("0.4 0.5 0.6", "{} 0.5 0.6", SHOULDER),
    "axis xyz": ("0.0 3.0 4.0", "0.0 3.0 {}", SHOULDER),
    "limit lower": ("-1.25", "{}", SHOULDER),
    "limit upper": ("0.125", "{}", SLIDE),
    "mimic multiplier": ("-2.75", "{}", GRIP),
    "mimic offset": ("0.375", "{}", GRIP),
}
BAD_NUMBERS = {
    "nan": ("nan", "'nan' is not a number; numbers must be finite"),
    "signed nan": ("-NaN", "'-NaN' is not a number; numbers must be finite"),
    "infinity": ("inf", "'inf' is not a number; numbers must be finite"),
    "infinity in full": ("-Infinity", "'-Infinity' is not a number; numbers must be finite"),
    "overflow": ("1e999", "'1e999' is too large for a float64; numbers must be finite"),
    "hexadecimal": ("0x10", "'0x10' is not a number; write it in decimal, not hexadecimal"),
    "hexadecimal float": ("-0X1.8p3", "'-0X1.8p3' is not a number; write it in decimal"),
    "decimal comma": ("1,5", "'1,5' is not a number; write decimals with a point"),
    "underscore": ("1_0", "'1_0' is not a number; write it without underscores"),
    "word": ("left", "'left' is not a number"),
    "unit": ("1m", "'1m' is not a number"),
    "suffix": ("1.0f", "'1.0f' is not a number"),
    "empty exponent": ("1e", "'1e' is not a number"),
    "fraction of exponent": ("1e2.5", "'1e2.5' is not a number"),
    "point alone": (".", "'.' is not a number"),
    "sign alone": ("-", "'-' is not a number"),
    "two signs": ("--1", "'--1' is not a number"),
    "two points": ("1.2.3", "'1.2.3' is not a number"),
    "quotient": ("1/2", "'1/2' is not a number"),
    "foreign digit": ("\u0661", "'\u0661' is not a number"),
    "typographic minus": ("\u22121", "'\u22121' is not a number"),
    "no-break space": ("1\u00a0", r"'1\\xa0' is not a number"),
    "escaped control": ("1&#x1c;", "reference to invalid character number"),
    "complex": ("1j", "'1j' is not a number"),
    "xacro expression": ("${pi/2}", "a leftover expression in .*; expand it with xacro"),
    "xacro argument": ("$(arg angle)", "a leftover expression in .*; expand it with xacro"),
    "one too many": ("1 000", "has more than (1|3) numbers?; give (1|3)"),
}


def _bad_numbers() -> list[BadURDF]:
    cases = []
    for (place, (old, form, joint)), (kind, (text, problem)) in product(NUMBERS.items(), BAD_NUMBERS.items()):
        element = "" if kind == "escaped control" else joint
        cases.append(spoil(f"{place}: {kind}", old, form.format(text), problem, element))
    for place, (old, _, joint) in NUMBERS.items():
        wanted = 3 if place.endswith(("xyz", "rpy")) else 1
        tag, key = place.split()
        empty = f"<{tag}> {key}='' is empty; leave {key} out, or give {wanted} number"
        cases.append(spoil(f"{place}: empty", old, "", empty, joint))
        cases.append(spoil(f"{place}: blank", old, " \t ", "is empty; leave", joint))
        if wanted == 3:
            cases.append(spoil(f"{place}: one number", old, "1", "has 1 number; give 3", joint))
            cases.append(spoil(f"{place}: two numbers", old, "1 2", "has 2 numbers; give 3", joint))
            cases.append(spoil(f"{place}: four numbers", old, "1 2 3 4", "has more than 3 numbers; give 3", joint))
            cases.append(spoil(f"{place}: separated by commas", old, "1,2,3", "spaces between numbers", joint))
            cases.append(spoil(f"{place}: separated by semicolons", old, "1;2;3", "'1;2;3' is not a number", joint))
    return cases


def _bad_joints() -> list[BadURDF]:
    shoulder, grip, spin, weld = (f'<joint name="{name}"' for name in ("shoulder", "grip", "spin", "weld"))
    source, misspelt = 'mimic joint="shoulder"', 'mimic joint="shuolder"'
    rpy = 'rpy="0.4 0.5 0.6"'
    cases = [
        spoil("no name", spin, "<joint", '<joint> has no name; write name="..."', "joint"),
        spoil("empty name", 'name="spin"', 'name=""', "<joint> has an empty name", "joint"),
        spoil("blank name", 'name="spin"', 'name="&#9; "', "<joint> has an empty name", r"joint '\t '"),
        spoil("duplicate name", 'name="spin"', 'name="slide"', "taken by the joint on line 16; give each", SLIDE),
        spoil("name with expression", 'name="spin"', 'name="${s}_spin"', "leftover .* name=", "joint '${s}_spin'"),
        spoil("no type", ' type="continuous"', "", "<joint> has no type", SPIN),
        spoil("no parent", '    <parent link="wheel"/>\n', "", "<parent> is missing; add", WELD, at=weld),
        spoil("no child", '    <child link="tip"/>\n', "", "<child> is missing; add", WELD, at=weld),
        spoil("no parent link", '<parent link="wheel"/>', "<parent/>", "<parent> has no link", WELD),
        spoil("empty parent link", '<parent link="wheel"/>', '<parent link=""/>', "<parent> has an empty link", WELD),
        spoil("no child link", '<child link="tip"/>', "<child/>", "<child> has no link", WELD),
        spoil("blank child link", '<child link="tip"/>', '<child link=" "/>', "<child> has an empty link", WELD),
        spoil("zero axis", "0.0 3.0 4.0", "0 0 0", "the axis is zero: its norm is 0.0; give", SHOULDER),
        spoil("tiny axis", "0.0 3.0 4.0", "0 0 9e-10", "the axis is zero: its norm is 9e-10", SHOULDER),
        spoil("zero axis, continuous", "0 1 0", "0 -0 0", "the axis is zero", SPIN),
        spoil("huge axis", "0.0 3.0 4.0", "0 1.7e308 1.7e308", "the axis is too long", SHOULDER),
        spoil("axis without xyz", '<axis xyz="0 1 0"/>', "<axis/>", "<axis> has no xyz; .* leave it out for x", SPIN),
        spoil("axis turned", 'xyz="0 1 0"', 'xyz="0 1 0" rpy="0 0 1"', "an rpy, which .* turn xyz instead", SPIN),
        spoil("quaternion and rpy", rpy, f'{rpy} quat_xyzw="0 0 0 1"', "both rpy and quat_xyzw; keep one", SHOULDER),
        spoil("zero quaternion", rpy, 'quat_xyzw="0 0 0 0"', "no direction: its norm is 0.0; give one", SHOULDER),
        spoil("short quaternion", rpy, 'quat_xyzw="0 0 1"', "has 3 numbers; give 4", SHOULDER),
        spoil("huge quaternion", rpy, 'quat_xyzw="0 0 1e308 1.7e308"', "no direction: its norm is inf", SHOULDER),
        spoil("mimic without joint", source, "mimic", "<mimic> has no joint", GRIP),
        spoil("mimic of nothing", source, 'mimic joint=""', "<mimic> has an empty joint", GRIP),
        spoil("mimic of unknown", source, misspelt, "'shuolder', which .*; did you mean 'shoulder'", GRIP, at=grip),
        spoil("mimic of a link", source, 'mimic joint="base"', "'base', which does not exist", GRIP, at=grip),
        spoil("mimic of itself", source, 'mimic joint="grip"', "it mimics itself", GRIP, at=grip),
        spoil("mimic of an expression", source, 'mimic joint="${j}"', "leftover expression", GRIP),
        spoil("mimics in a loop", '"2.5" effort="10" velocity="3"/>', '"2.5"/><mimic joint="grip"/>',
              "mimic one another in a loop: 'shoulder', 'grip'", SHOULDER, at=shoulder),
    ]  # fmt: skip
    loop = GOOD.replace('<limit upper="0.125"/>', '<limit/><mimic joint="grip"/>')
    loop = loop.replace(source, 'mimic joint="spin"').replace('<axis xyz="0 1 0"/>', '<mimic joint="slide"/>')
    cases.append(BadURDF("mimics in a loop of three", loop.encode(), "loop: 'slide', 'grip', 'spin'", SLIDE, 16))
    remedies = {
        "planar": "two prismatic joints and a continuous one",
        "floating": "only the joint under the root may float: make it fixed",
        **dict.fromkeys(("spherical", "ball"), "three revolute joints"),
        **dict.fromkeys(("Revolute", "revolute ", "revolut"), "did you mean 'revolute'"),
        **dict.fromkeys(("screw", "hinge", "0"), "use one of revolute, continuous, prismatic, fixed"),
    }
    for kind, remedy in remedies.items():
        problem = f"joint type '{kind}' is not supported; .*{remedy}"
        cases.append(spoil(f"type {kind!r}", 'type="continuous"', f'type="{kind}"', problem, SPIN))
    cases.append(spoil("empty type", 'type="continuous"', 'type=""', "<joint> has an empty type", SPIN))
    parts = {
        "parent": '<parent link="base"/>',
        "child": '<child link="upper"/>',
        "origin": '<origin xyz="0.1 2e-1 -.3" rpy="0.4 0.5 0.6"/>',
        "axis": '<axis xyz="0.0 3.0 4.0"/>',
        "limit": '<limit lower="-1.25" upper="2.5" effort="10" velocity="3"/>',
        "mimic": '<mimic joint="shoulder" multiplier="-2.75" offset="0.375"/>',
    }
    for tag, text in parts.items():
        joint = GRIP if tag == "mimic" else SHOULDER
        other = f"<{tag}/>"
        cases.append(spoil(f"two <{tag}>", text, text + other, f"a second <{tag}> in one joint; keep one", joint))
        cases.append(spoil(f"text in <{tag}>", text, text.replace("/>", f">1 2 3</{tag}>"), f"text inside <{tag}>; .* "
                           "are attributes: remove it", joint))  # fmt: skip
        element = f"<{tag}><xyz>1 2 3</xyz></{tag}>"
        cases.append(spoil(f"element in <{tag}>", text, element, f"<xyz> in <{tag}> is not known", joint))
        cases.append(spoil(f"prefixed <{tag}>", text, text.replace("<", "<u:"), f"<u:{tag}> {MISSPELT}", joint))
        capital = text.replace(f"<{tag}", f"<{tag.title()}")
        cases.append(spoil(f"capital <{tag}>", text, capital, f"<{tag.title()}> {MISSPELT}", joint))
    for key, joint in (('xyz="0.0', SHOULDER), ('rpy="0.4', SHOULDER), ('lower="-1.25', SHOULDER), ('offset="', GRIP)):
        plain = key.partition("=")[0]
        cases.append(spoil(f"capital {plain}", key, key.upper(), f"{plain.upper()}= {MISSPELT}", joint))
        cases.append(spoil(f"prefixed {plain}", key, f"u:{key}", f"u:{plain}= {MISSPELT}", joint))
    return cases


def _bad_trees() -> list[BadURDF]:
    weld, wheel = '<joint name="weld"', '<parent link="wheel"/>'
    robot = '<robot name="arm">'
    chain = "".join(f'<link name="l{index}"/>' for index in range(30))
    two_links = '<robot name="a"><link name="b"/><link name="c"/>'
    joint = '<joint name="{}" type="fixed"><parent link="{}"/><child link="{}"/></joint>'
    ring = [joint.format(f"j{index}", f"l{index}", f"l{(index + 1) % 30}") for index in range(30)]
    cycle = two_links + joint.format("go", "b", "c") + joint.format("back", "c", "b") + "</robot>"
    beside = (
        two_links + '<link name="root"/>' + joint.format("go", "b", "c") + joint.format("back", "c", "b") + "</robot>"
    )
    hanging = (
        two_links + '<link name="d"/>' + joint.format("off", "c", "d") + joint.format("self", "c", "c") + "</robot>"
    )
    return [
        spoil("robot name an expression", robot, '<robot name="$(arg n)">', "leftover .* name=", "robot '$(arg n)'"),
        spoil("no link name", '<link name="tip"/>', "<link/>", "<link> has no name", "link"),
        spoil("empty link name", '<link name="tip"/>', '<link name=""/>', "<link> has an empty name", "link"),
        spoil("duplicate link", '<link name="tip"/>', '<link name="base"/>', "the link on line 3; give", "link 'base'"),
        spoil("link an expression", '<link name="tip"/>', '<link name="${t}"/>', "leftover .* name=", "link '${t}'"),
        spoil("unknown parent", wheel, '<parent link="wheal"/>',
              "its parent link 'wheal' does not exist; did you mean 'wheel'", WELD, at=weld),
        spoil("unknown child", '<child link="tip"/>', '<child link="zzz"/>',
              "its child link 'zzz' does not exist; correct the name", WELD, at=weld),
        spoil("parent of other case", wheel, '<parent link="Wheel"/>', "'Wheel' does not exist", WELD, at=weld),
        spoil("parent with a space", wheel, '<parent link="wheel "/>', "'wheel ' does not exist", WELD, at=weld),
        spoil("parent a joint", wheel, '<parent link="spin"/>', "'spin' does not exist", WELD, at=weld),
        spoil("two parents", '<child link="tip"/>', '<child link="finger"/>',
              "link 'finger' has two parents: it is also the child of joint 'grip'", WELD, at=weld),
        spoil("own parent", wheel, '<parent link="tip"/>', "form a cycle: 'weld'; .* cut", WELD, at=weld),
        spoil("two roots", "</robot>", '<link name="stray"/></robot>', "2 roots: 'base', 'stray';", ROBOT, at=robot),
        spoil("many roots", "</robot>", f"{chain}</robot>", "31 roots: 'base', 'l0', .*'l8' and 21", ROBOT, at=robot),
        spoil("too many links", "</robot>", '<link name="l"/>' * MAX_JOINTS + "</robot>",
              f"more than {MAX_JOINTS + 1} links", "link 'l'"),
        spoil("too many joints", "</robot>", '<joint name="j"/>' * MAX_JOINTS + "</robot>",
              f"more than {MAX_JOINTS} joints", "joint 'j'"),
        BadURDF("no link", b'<robot name="arm"></robot>', "has no link; add at least one", ROBOT, 1),
        BadURDF("only a joint", f'<robot name="arm">{joint.format(*"jab")}</robot>'.encode(), "no link", ROBOT, 1),
        BadURDF("cycle of two", cycle.encode(), "joints form a cycle: 'go', 'back'", "joint 'go'", 1),
        BadURDF("cycle beside a root", beside.encode(), "joints form a cycle: 'go', 'back'", "joint 'go'", 1),
        BadURDF("cycle with a tail", hanging.encode(), "joints form a cycle: 'self'", "joint 'self'", 1),
        BadURDF("long cycle", f'<robot name="a">{chain}{"".join(ring)}</robot>'.encode(),
                "cycle: 'j0', 'j1', .*'j9' and 20 more; a robot is a tree", "joint 'j0'", 1),
    ]  # fmt: skip


def _bad_xml() -> list[BadURDF]:
    robot, end = '<robot name="arm">', "</robot>"
    declaration = '<?xml version="1.0" encoding="utf-8"?>'
    entities = '<!DOCTYPE robot [<!ENTITY a "1"><!ENTITY b "&a;&a;">]>\n'
    outside = '<!DOCTYPE robot SYSTEM "file:///etc/hostname">\n'
    body = GOOD.partition("\n")[2]
    last = GOOD.count("\n") + 1
    cases = [
        BadURDF("empty", b"", "^the file is empty$"),
        BadURDF("blank", b" \n\t\r\n ", "^the file is empty$"),
        BadURDF("byte order mark alone", b"\xef\xbb\xbf", "^the file is empty$"),
        BadURDF("declaration alone", declaration.encode(), "no element found", line=1),
        BadURDF("comment alone", b"<!-- robot -->", "no element found", line=1),
        BadURDF("plain text", b"robot", "not well-formed XML: syntax error", line=1),
        BadURDF("JSON", b'{"robot": 1}', "not well-formed", line=1),
        BadURDF("zero byte", b"\0", "not well-formed", line=1),
        BadURDF("cut off", GOOD[:-25].encode(), "unclosed token", line=line_of('<child link="tip"/>')),
        BadURDF("root never closed", GOOD.replace(end, "").encode(), "no element found", line=last),
        BadURDF("two roots of XML", (GOOD + "<robot/>").encode(), "junk after document element", line=last),
        BadURDF("text after the end", (GOOD + "x").encode(), "junk after document element", line=last),
        BadURDF("zero bytes after the end", GOOD.encode() + b"\0\0", "not well-formed", line=last),
        BadURDF("too large", b" " * (MAX_BYTES + 1), f"{MAX_BYTES + 1} bytes, more than the {MAX_BYTES}"),
        spoil("tags crossed", '<child link="tip"/>', '<child link="tip"></joint>', "mismatched tag", ""),
        spoil("no quotes", 'name="tip"', "name=tip", "not well-formed", ""),
        spoil("attribute without value", 'name="tip"', "name", "not well-formed", ""),
        spoil("attribute twice", 'name="tip"', 'name="tip" name="top"', "duplicate attribute", ""),
        spoil("bare ampersand", 'name="tip"', 'name="t&p"', "not well-formed", ""),
        spoil("bare less-than", 'name="tip"', 'name="t<p"', "not well-formed", ""),
        spoil("unknown entity", 'name="tip"', 'name="&tip;"', "undefined entity", ""),
        spoil("control character", 'name="tip"', 'name="t\x01p"', "not well-formed", ""),
        spoil("reference to zero", 'name="tip"', 'name="&#0;"', "reference to invalid character number", ""),
        spoil("double hyphen in comment", '<link name="tip"/>', "<!-- a -- b -->", "not well-formed", ""),
        BadURDF("entities defined", (entities + body).encode(), "a DOCTYPE .* is refused; remove it", line=1),
        BadURDF("external document type", (outside + body).encode(), "a DOCTYPE", line=1),
        BadURDF("document type on line 2", (declaration + "\n<!DOCTYPE robot>" + body).encode(), "a DOCTYPE", line=2),
        spoil("document type inside", '<link name="tip"/>', "<!DOCTYPE robot>", "not well-formed", ""),
        spoil("deep nesting", '<link name="tip"/>', "<gazebo>" * MAX_DEPTH, f"nested more than {MAX_DEPTH} deep", ""),
        spoil("deep in a joint", '<axis xyz="0 1 0"/>', "<gazebo>" * MAX_DEPTH, f"more than {MAX_DEPTH} deep", ""),
        spoil("prefixed root", robot, '<u:robot name="arm">', f"<u:robot> {MISSPELT}", "u:robot 'arm'"),
        spoil("capital root", robot, '<Robot name="arm">', f"<Robot> {MISSPELT}", "Robot 'arm'"),
        spoil("xacro root", robot, '<xacro:robot name="arm">', "leftover <xacro:robot>", "xacro:robot 'arm'"),
        spoil("prefixed link", '<link name="tip"/>', '<u:link name="tip"/>', f"<u:link> {MISSPELT}", "u:link 'tip'"),
        spoil("capital link", '<link name="tip"/>', '<Link name="tip"/>', f"<Link> {MISSPELT}", "Link 'tip'"),
        spoil("prefixed joint", '<joint name="weld"', '<u:joint name="w"', f"<u:joint> {MISSPELT}", "u:joint 'w'"),
        spoil("capital name", '<link name="tip"/>', '<link Name="tip"/>', f"Name= {MISSPELT}", "link"),
    ]  # fmt: skip
    for root in ("sdf", "mujoco", "html", "robots", "model"):
        data = f'<{root} name="arm"><link name="a"/></{root}>'.encode()
        cases.append(BadURDF(f"root <{root}>", data, f"the root element is <{root}>, not <robot>", f"{root} 'arm'", 1))
    for tag in ("include", "property", "macro", "if", "arm_macro"):
        leftover = f"<xacro:{tag}/>"
        problem = f"a leftover {leftover.replace('/', '')}; expand the file with xacro"
        cases.append(spoil(f"{leftover} in the robot", '<link name="tip"/>', leftover, problem, f"xacro:{tag}"))
        cases.append(spoil(f"{leftover} in a joint", '<axis xyz="0 1 0"/>', leftover, problem, SPIN))
        inside = f'<link name="tip">{leftover}</link>'
        cases.append(spoil(f"{leftover} in a link", '<link name="tip"/>', inside, problem, "link 'tip'"))
    for encoding in ("rot13", "idna", "unicode_escape", "ebcdic", "utf-7", "x", "utf-32", "zlib"):
        data = GOOD.replace("utf-8", encoding).encode()
        problem = f"the declared encoding '{encoding}' is not read here; save the file as UTF-8"
        cases.append(BadURDF(f"encoding {encoding}", data, problem, line=1))
    for encoding in ("utf-16", "utf-16le", "utf-16be"):
        data = GOOD.replace("utf-8", encoding).encode()
        problem = f"the declared encoding '{encoding}' is not that of the file; declare"
        cases.append(BadURDF(f"UTF-8 declared {encoding}", data, problem, line=1))
    for name, byte in {"Latin-1": b"\xe9", "cut sequence": b"\xe2\x82", "surrogate": b"\xed\xa0\x80"}.items():
        data = GOOD.encode().replace(b'link name="tip"', b'link name="t' + byte + b'p"')
        problem = "not text in utf-8: .*; save the file as UTF-8, or declare its encoding"
        cases.append(BadURDF(f"{name} in UTF-8", data, problem, line=8))
    foreign = GOOD.replace("utf-8", "us-ascii").replace('link name="tip"', 'link name="t\u00e9p"').encode()
    cases.append(BadURDF("UTF-8 declared ASCII", foreign, "not text in ascii", line=8))
    undefined = GOOD.replace("utf-8", "windows-1252").encode().replace(b'link name="tip"', b'link name="t\x81p"')
    cases.append(BadURDF("undefined in Windows-1252", undefined, "not text in cp1252", line=8))
    return cases


def _unknown_words() -> list[BadURDF]:
    robot, tip, spin = '<robot name="arm">', '<link name="tip"/>', '<axis xyz="0 1 0"/>'
    cases = [
        spoil(
            "loop joint", tip, '<loop_joint name="l"/>', "<loop_joint> in <robot> .* loops are not", "loop_joint 'l'"
        ),
        spoil("nested robot", tip, '<robot name="r"/>', "<robot> in <robot> .* one file is one robot", "robot 'r'"),
        spoil("group", tip, "<group/>", "<group> in <robot> is not read; groups belong into an SRDF", "group"),
        spoil("macro call", tip, '<arm_v2 side="left"/>', "<arm_v2> in <robot> .* a macro is expanded", "arm_v2"),
        spoil("misspelt link", tip, '<lnik name="tip"/>', "<lnik> .*; did you mean <link>", "lnik 'tip'"),
        spoil("misspelt gazebo", tip, "<gazbo/>", "<gazbo> in <robot> is not known; did you mean <gazebo>", "gazbo"),
        spoil(
            "link in a link",
            tip,
            '<link name="tip"><link name="t"/></link>',
            "<link> in <link> .* directly in",
            "link 'tip'",
        ),
        spoil(
            "joint in a link",
            tip,
            '<link name="tip"><joint name="t"/></link>',
            "<joint> in <link> .* directly in <robot>",
            "link 'tip'",
        ),
        spoil("unknown in a link", tip, '<link name="tip"><visuall/></link>', "did you mean <visual>", "link 'tip'"),
        spoil("misspelt origin", spin, f'{spin}<orgin xyz="1 2 3"/>', "<orgin> in <joint> .* mean <origin>", SPIN),
        spoil("misspelt limit", spin, f"{spin}<limits/>", "<limits> in <joint> .* mean <limit>", SPIN),
        spoil(
            "something in a joint",
            spin,
            f"{spin}<qqq/>",
            "<qqq> .* known here: <axis>, <child>, <limit>, <mimic>",
            SPIN,
        ),
        spoil("text in a joint", spin, f"{spin} rpy=&quot;0 0 1&quot;/>", "text inside <joint>; .* remove it", SPIN),
        spoil(
            "misspelt multiplier", 'multiplier="', 'multiplyer="', "multiplyer= in <mimic> .* mean multiplier=", GRIP
        ),
        spoil(
            "misspelt position",
            'xyz="0.1 2e',
            'pos="0.1 2e',
            "pos= in <origin> .* known here: quat_xyzw=, rpy=, xyz=",
            SHOULDER,
        ),
        spoil("misspelt axis", 'xyz="0 1 0"', 'xzy="0 1 0"', "xzy= in <axis> is not known; did you mean xyz=", SPIN),
        spoil("misspelt upper", 'upper="2.5"', 'uper="2.5"', "uper= in <limit> .* mean upper=", SHOULDER),
        spoil("misspelt effort", 'effort="10"', 'efort="10"', "efort= in <limit> .* mean effort=", SHOULDER),
        spoil("misspelt type", 'type="continuous"', 'typ="continuous"', "typ= in <joint> .* mean type=", SPIN),
        spoil(
            "something of a link",
            tip,
            '<link name="tip" pose="1"/>',
            "pose= in <link> .* known here: name=",
            "link 'tip'",
        ),
        spoil(
            "something of the robot", robot, '<robot name="arm" root="base">', "root= in <robot> is not known", ROBOT
        ),
        spoil("undeclared prefix", tip, '<u:arm side="left"/>', "<u:arm> .* a prefix that nothing declares", "u:arm"),
        spoil(
            "joint of another standard",
            tip,
            '<drake:joint name="j"/>',
            "<drake:joint> is not <joint>",
            "drake:joint 'j'",
        ),
        spoil(
            "loop of another standard",
            tip,
            "<drake:loop_joint/>",
            "<drake:loop_joint> .* may move links",
            "drake:loop_joint",
        ),
        spoil("mimic of another standard", spin, "<drake:mimic/>", "<drake:mimic> is not <mimic>", SPIN),
    ]
    bound = GOOD.replace(robot, '<robot name="arm" xmlns:xacro="urn:other">').replace(tip, "<xacro:arm/>")
    cases.append(BadURDF("xacro bound elsewhere", bound.encode(), "a leftover <xacro:arm>", "xacro:arm", line_of(tip)))
    included = GOOD.replace(robot, '<robot name="arm" xmlns:xi="http://www.w3.org/2001/XInclude">')
    included = included.replace(tip, '<xi:include href="a.urdf"/>')
    problem = "<xi:include> in <robot> may move links, and is not read; expand it, or leave it out"
    cases.append(BadURDF("inclusion", included.encode(), problem, "xi:include", line_of(tip)))
    for tag in ("include", "macro", "property", "if", "unless", "insert_block"):
        problem = f"<{tag}> in <robot> is not read; expand the file with xacro"
        cases.append(spoil(f"<{tag}> without a prefix", '<link name="tip"/>', f"<{tag}/>", problem, tag))
    for address in ("http://www.ros.org/wiki/xacro", "http://wiki.ros.org/xacro/", "http://ros.org/wiki/Xacro#"):
        bound = GOOD.replace(robot, f'<robot name="arm" xmlns:x="{address}">').replace(tip, "<x:arm/>")
        problem = "a leftover <x:arm>; expand the file with xacro"
        cases.append(BadURDF(f"prefix bound to {address}", bound.encode(), problem, "x:arm", line_of(tip)))
        new = f'<robot name="arm" xmlns="{address}">'
        cases.append(spoil(f"default namespace {address}", robot, new, "the default namespace is xacro's", ROBOT))
    return cases


def _careless() -> list[BadURDF]:
    robot, grip = '<robot name="arm">', '<joint name="grip"'
    limits, unlimited = 'lower="-7" upper="7"', "^joint .*; read without limits$"
    base, source = '  <link name="base"/>\n', 'mimic joint="shoulder"'
    below = GOOD.replace(base, "").replace('"base"', '"world"')
    floating = '<joint name="free" type="floating"><parent link="world"/><child link="base"/></joint>'
    free = f'<link name="world"/>{floating}</robot>'
    cases = [
        allow(unlimited, spoil("inverted limits", limits, 'lower="7" upper="-7"', "7.0 is above .* -7.0; swap", GRIP)),
        allow(unlimited, spoil("lower above omitted upper", limits, 'lower="7"', "7.0 is above .* 0.0", GRIP)),
        allow(
            unlimited, spoil("upper below omitted lower", 'upper="0.125"', 'upper="-1"', "0.0 is above .* -1.0", SLIDE)
        ),
        allow(
            unlimited,
            spoil(
                "no limit, revolute", '<limit lower="-7" upper="7"/>', "", "<limit> is missing; add it", GRIP, at=grip
            ),
        ),
        allow(
            unlimited,
            spoil(
                "no limit, prismatic",
                '<limit upper="0.125"/>',
                "",
                "<limit> is missing; add it",
                SLIDE,
                at='<joint name="slide"',
            ),
        ),
        allow(
            "welded at 0.375",
            spoil("mimic of fixed", source, 'mimic joint="weld"', "'weld', which is fixed; make", GRIP, at=grip),
        ),
        allow(
            "it is called 'fallback'", spoil("no robot name", robot, "<robot>", "<robot> has no name; write", "robot")
        ),
        allow("it is called 'fallback'", spoil("empty robot name", robot, '<robot name="">', "an empty name", "robot")),
        allow(
            "it is called 'fallback'", spoil("blank robot name", robot, '<robot name=" ">', "an empty name", "robot")
        ),
        allow(
            "without them", BadURDF("blank before the declaration", b" " + GOOD.encode(), "blanks before <.xml", "", 1)
        ),
        allow("without them", BadURDF("blank lines", b"\n\r\n\t" + GOOD.encode(), "let the file begin with <", "", 1)),
        allow(
            "it is added",
            BadURDF(
                "undeclared world",
                below.encode(),
                "its parent link 'world' is not declared; add",
                SHOULDER,
                line_of('<joint name="shoulder"') - 1,
            ),
        ),
        allow(
            "without link 'world': 'base' is the root",
            spoil("floating under the root", "</robot>", free, "leave it and link 'world' out", "joint 'free'"),
        ),
        allow(
            "without link 'world': 'base' is the root",
            spoil(
                "floating under an undeclared world",
                "</robot>",
                f"{floating}</robot>",
                "is not declared",
                "joint 'free'",
            ),
        ),
    ]
    parts = [
        '<parent link="base"/>',
        '<child link="upper"/>',
        '<axis xyz="0.0 3.0 4.0"/>',
        '<mimic joint="shoulder" multiplier="-2.75" offset="0.375"/>',
        '<origin xyz="0.1 2e-1 -.3" rpy="0.4 0.5 0.6"/>',
    ]
    for text in parts:
        tag = text[1 : text.index(" ")]
        joint, reading = GRIP if tag == "mimic" else SHOULDER, "it says the same, and is passed over"
        case = spoil(f"two <{tag}> that agree", text, text + text, f"a second <{tag}> in one joint; keep one", joint)
        cases.append(allow(reading, case))
        spaced = text.replace(f"<{tag}", f'<{tag} xmlns="http://ros.org"')
        case = spoil(f"namespace on <{tag}>", text, spaced, f"default namespace on <{tag}>; remove", joint)
        cases.append(allow("as if it were not there", case))
    agree = '<axis xyz="0.0 3.0 4.0"/><axis xyz="0 3 4.00"/>'
    cases.append(allow("says the same", spoil("two axes in other words", parts[2], agree, "a second", SHOULDER)))
    for place, title in ((robot, ROBOT), ('<link name="tip"', "link 'tip'"), ('<joint name="spin"', SPIN)):
        tag = place[1 : place.index(" ")]
        spaced = place.replace(f"<{tag}", f'<{tag} xmlns="urdf"')
        case = spoil(f"namespace on {title}", place, spaced, f"default namespace on <{tag}>; remove", title)
        cases.append(allow("as if it were not there", case))
    for bom, codec in ((b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be")):
        problem = "the declared encoding 'utf-8' is not that of the file; declare"
        data = bom + GOOD.encode(codec)
        cases.append(allow("read as utf-16", BadURDF(f"{codec} declared UTF-8", data, problem, "", 1)))
    marked = b"\xef\xbb\xbf" + GOOD.replace("utf-8", "iso-8859-1").encode()
    cases.append(allow("read as utf-8", BadURDF("UTF-8 mark, Latin-1 declared", marked, "is not that of", "", 1)))
    return cases


BAD = [*_bad_xml(), *_bad_trees(), *_bad_joints(), *_bad_numbers(), *_unknown_words()]
CARELESS = _careless()
