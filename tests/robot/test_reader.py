"""The strict reader: what it accepts it reads exactly, and all else it refuses with one typed error."""

from __future__ import annotations

import math
import re
import sysconfig
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bad_urdfs import BAD, CARELESS, GOOD, BadURDF, line_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bodyimage_kin.errors import InvalidURDF
from bodyimage_kin.robot.reader import MAX_BYTES, MAX_DEPTH, MAX_JOINTS, _find_cycle, read_urdf
from bodyimage_kin.robot.transforms import axis_angle_matrix
from bodyimage_kin.robot.tree import UNLIMITED, Joint, KinematicTree, Mimic, write_core

ROBOTS = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/share/example-robot-data/robots"


def read(text: str) -> KinematicTree:
    return read_urdf(text.encode()).tree


def good_with(old: str, new: str) -> KinematicTree:
    assert GOOD.count(old) == 1
    return read(GOOD.replace(old, new))


def joint_of(tree: KinematicTree, name: str) -> Joint:
    return next(joint for joint in tree.joints if joint.name == name)


# What is read


def test_everything_is_read_as_it_stands_in_the_file():
    xyz, rpy, axis = (0.1, 0.2, -0.3), (0.4, 0.5, 0.6), (0.0, 0.6, 0.8)
    assert read(GOOD) == KinematicTree(
        name="arm",
        root="base",
        links=("base", "upper", "lower", "finger", "wheel", "tip"),
        joints=(
            Joint("shoulder", "revolute", "base", "upper", xyz, rpy, axis, -1.25, 2.5),
            Joint("slide", "prismatic", "upper", "lower", lower=0.0, upper=0.125),
            Joint("grip", "revolute", "lower", "finger", lower=-7.0, upper=7.0, mimic=Mimic("shoulder", -2.75, 0.375)),
            Joint("spin", "continuous", "upper", "wheel", axis=(0.0, 1.0, 0.0), lower=-math.inf, upper=math.inf),
            Joint("weld", "fixed", "wheel", "tip"),
        ),
    )  # fmt: skip


def test_a_robot_of_one_link_is_a_robot():
    assert read('<robot name="stone"><link name="rock"/></robot>') == KinematicTree("stone", "rock", ("rock",), ())


def test_order_is_the_order_of_the_file_whatever_hangs_from_what():
    joint = '<joint name="{}" type="fixed"><parent link="{}"/><child link="{}"/></joint>'
    links = '<link name="c"/><link name="a"/><link name="b"/>'
    tree = read(f'<robot name="r">{joint.format("2", "b", "c")}{links}{joint.format("1", "a", "b")}</robot>')
    assert (tree.root, tree.links, [joint.name for joint in tree.joints]) == ("a", ("c", "a", "b"), ["2", "1"])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<link name="tip"/>', '<link name="tip"><origin xyz="1 2 nan"/><origin/></link>'),
        ('<link name="tip"/>', '<link name="tip"><visual><xacro:x/><origin xyz="${x}"/></visual><inertial/></link>'),
        (
            '<link name="tip"/>',
            '<link name="tip" type="${t}"><collision><geometry><Joint/></geometry></collision></link>',
        ),
        ('<link name="tip"/>', '<link name="tip"><collision><orgin xyz="1 2 3"/></collision>text</link>'),
        ("</robot>", '<gazebo reference="tip"><joint name="j" type="ball"/><xacro:y/></gazebo></robot>'),
        ("</robot>", '<transmission name="t"><joint name="spin"/><joint name="spin"/></transmission></robot>'),
        ("</robot>", '<material name="tip"/><ros2_control/><sensor/><drake:link_group name="q"/>-</robot>'),
        ("</robot>", '<gazebo xmlns="http://ros.org/wiki/xacro"/><frame name="f" link="tip" xyz="x"/></robot>'),
        ('<parent link="wheel"/>', '<parent link="wheel"/><axis xyz="0 0 0"/><limit lower="2" upper="1"/>'),
        ('<parent link="wheel"/>', '<parent link="wheel"/><mimic joint="nobody" multiplier="nan"/>'),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><limit lower="2" upper="${pi}"/>'),
        (
            '<axis xyz="0 1 0"/>',
            '<axis xyz="0 1 0"/><calibration/><calibration/><dynamics/><safety_controller k="nan"/>',
        ),
        ('<robot name="arm">', '<robot name="arm" version="1.0" xmlns:xacro="http://ros.org/wiki/xacro">'),
        ('<robot name="arm">', '<robot name="arm" xmlns:x="http://example.org" x:y="${z}">'),
        ('<axis xyz="0 1 0"/>', '<axis rpy="0 0 -0" xyz=" 0\n\t1\r\n+0.0 "/><!-- <axis/> --><?editor axis?>'),
        ('effort="10" velocity="3"', 'effort="strong" velocity="" acceleration="${a}" drake:acceleration="nan"'),
        ('<joint name="spin"', '<joint dont_collapse="true" name="spin"'),
        ('<parent link="wheel"/>', '<origin/><parent link="wheel"/>'),
        ('<parent link="wheel"/>', '<origin quat_xyzw="0 0 0 2"/><parent link="wheel"/>'),
        ('<?xml version="1.0" encoding="utf-8"?>\n', ""),
        ('<?xml version="1.0" encoding="utf-8"?>', '\ufeff<?xml version="1.0" encoding="UTF-8" standalone="yes"?>'),
        ("\n", "\r\n"),
    ],
)
def test_what_cannot_move_a_link_is_passed_over(old: str, new: str):
    assert read(GOOD.replace(old, new)) == read(GOOD)


ENCODINGS = ["utf-8", "utf8", "utf-8-sig", "utf-16", "utf-16le", "utf-16be", "iso-8859-1", "latin-1", "windows-1252"]


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("before", ["", "\n \r\n"])
def test_a_file_is_read_in_the_encoding_it_declares(encoding: str, before: str):
    text = before + GOOD.replace("utf-8", encoding.removesuffix("-sig")).replace('"arm"', '"b\u00e9b\u00e9"')
    assert read_urdf(text.encode(encoding)).tree.name == "b\u00e9b\u00e9"
    with pytest.raises(InvalidURDF, match="has no type") as caught:
        read_urdf(text.replace(' type="continuous"', "").encode(encoding))
    assert caught.value.line == line_of('<joint name="spin"') + before.count("\n")


def test_a_joint_and_a_link_may_share_a_name():
    assert joint_of(good_with('name="spin"', 'name="tip"'), "tip").child == "wheel"


def test_names_keep_their_characters():
    tree = good_with('name="arm"', "name=' a&amp;&lt;&quot;\u706b&#10;'")
    assert tree.name == ' a&<"\u706b\n'


@pytest.mark.parametrize(
    "text", ["1.5", "+1.5", "1.5e0", "15.E-1", ".15e+1", "001.50", "1." + "5" + "0" * 400, " 1.5\n"]
)
def test_numbers_may_be_written_in_every_decimal_way(text: str):
    assert joint_of(good_with("0.375", text), "grip").mimic == Mimic("shoulder", -2.75, 1.5)


def test_omitted_numbers_are_what_urdf_says():
    tree = good_with(' multiplier="-2.75" offset="0.375"', "")
    assert joint_of(tree, "grip").mimic == Mimic("shoulder", 1.0, 0.0)
    slide = joint_of(good_with('<limit upper="0.125"/>', '<limit effort="1"/>'), "slide")
    assert (slide.lower, slide.upper, slide.axis, slide.xyz, slide.rpy) == (0, 0, (1, 0, 0), (0, 0, 0), (0, 0, 0))


@given(quaternion=st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda xyzw: math.hypot(*xyzw) > 1e-3))
def test_an_orientation_may_be_a_quaternion(quaternion: tuple[float, ...]):
    x, y, z, w = quaternion
    text = f'quat_xyzw="{x!r} {y!r} {z!r} {w!r}"'
    joint = joint_of(good_with('rpy="0.4 0.5 0.6"', text), "shoulder")
    # Rodrigues' formula, on the quaternion's own axis and angle.
    length = math.hypot(x, y, z)
    axis = (x / length, y / length, z / length) if length else (1.0, 0.0, 0.0)
    expected = axis_angle_matrix(axis, 2.0 * math.atan2(length, w))
    np.testing.assert_allclose(joint.origin[:3, :3], expected, atol=2e-15)
    assert joint.origin[:3, 3].tolist() == [0.1, 0.2, -0.3]


def test_every_origin_may_have_a_quaternion():
    turned = '<origin quat_xyzw="0 0 0.5 0.5"/>'
    shapes = f"<visual>{turned}<geometry><box size='1 2 3'/></geometry></visual>"
    shapes += shapes.replace("visual", "collision") + f'<inertial>{turned}<mass value="1"/></inertial>'
    link = read_urdf(GOOD.replace('<link name="tip"/>', f'<link name="tip">{shapes}</link>').encode()).geometry["tip"]
    for part in (link.visuals[0], link.collisions[0], link.inertial):
        np.testing.assert_allclose(part.origin, [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-15)


@pytest.mark.parametrize("name", ["shoulder", "slide", "grip"])
def test_no_limit_is_no_limit_whoever_reads_the_core(name: str):
    pinocchio = pytest.importorskip("pinocchio")
    whole = next(text for text in re.findall(r'<joint name="\w+".*?</joint>', GOOD, re.DOTALL) if f'"{name}"' in text)
    tree = read(GOOD.replace(whole, re.sub("<limit[^>]*>", "", whole)))
    assert (joint_of(tree, name).lower, joint_of(tree, name).upper) == (-math.inf, math.inf)
    assert read_urdf(write_core(tree).encode(), strict=True) == read_urdf(write_core(tree).encode())
    assert read(write_core(tree)) == tree
    assert pinocchio.buildModelFromXML(write_core(tree)).njoints == 5


def test_a_follower_of_what_stands_still_stands_still():
    follows = 'mimic joint="weld" multiplier="2" offset="0.5"'
    text = GOOD.replace('mimic joint="shoulder" multiplier="-2.75" offset="0.375"', follows)
    text = text.replace('<limit upper="0.125"/>', '<limit/><mimic joint="grip" multiplier="-3" offset="1"/>')
    reading = read_urdf(text.encode())
    # grip = 0.5 and slide = -3 * 0.5 + 1, along x.
    grip, slide = joint_of(reading.tree, "grip"), joint_of(reading.tree, "slide")
    assert grip.kind == slide.kind == "fixed"
    np.testing.assert_allclose(grip.rpy, (0.5, 0.0, 0.0), atol=1e-15)
    assert slide.xyz == (-0.5, 0.0, 0.0)
    assert {note.partition(":")[0] for note in reading.notes} == {"joint 'grip', line 21", "joint 'slide', line 16"}


def test_what_is_passed_over_is_counted():
    spin = '<axis xyz="0 1 0"/>'
    text = GOOD.replace("</robot>", "<gazebo/><gazebo/><transmission/></robot>").replace(spin, f"{spin}<dynamics/>")
    assert read_urdf(text.encode(), strict=True).notes == (
        f"line {line_of(spin)}: passed over <dynamics> in <joint>",
        f"line {line_of('</robot>')}: passed over <gazebo> in <robot> (2 in all)",
        f"line {line_of('</robot>')}: passed over <transmission> in <robot>",
    )
    assert read_urdf(GOOD.encode()).notes == ()


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
def test_every_moving_joint_may_mimic_and_be_mimicked_in_chains(kind: str):
    tree = good_with('type="continuous">', f'type="{kind}"><limit/><mimic joint="grip"/>')
    assert joint_of(tree, "spin").mimic == Mimic("grip")


@pytest.mark.parametrize("scale", [1e-8, 1e-3, 0.5, 3.0, 1e150, 1e307])
def test_axes_have_unit_norm(scale: float):
    axis = joint_of(good_with("0.0 3.0 4.0", f"{scale!r} {-2 * scale!r} {2 * scale!r}"), "shoulder").axis
    assert axis == pytest.approx((1 / 3, -2 / 3, 2 / 3), rel=1e-15)
    assert math.hypot(*axis) == pytest.approx(1.0, abs=4e-16)


# What is refused


@pytest.mark.parametrize("bad", [*BAD, *CARELESS], ids=[bad.id for bad in [*BAD, *CARELESS]])
def test_a_bad_file_is_refused_by_name_and_line(bad: BadURDF):
    with pytest.raises(InvalidURDF, match=bad.problem) as caught:
        read_urdf(bad.data, strict=bad in CARELESS)
    assert (caught.value.element, caught.value.line) == (bad.element, bad.line)
    assert str(caught.value).isprintable(), "an error is one line"
    assert len(str(caught.value)) < 700


@pytest.mark.parametrize("bad", CARELESS, ids=[bad.id for bad in CARELESS])
def test_a_careless_file_is_read_with_a_note(bad: BadURDF):
    reading = read_urdf(bad.data, name="fallback")
    assert any(re.search(bad.reading, note) for note in reading.notes), reading.notes
    assert all(note.isprintable() for note in reading.notes)
    # Nothing else about the robot changes.
    changed = {"grip"} if "mimic of fixed" in bad.id else set()
    expected = {joint.name: joint for joint in read(GOOD).joints if joint.name not in changed}
    for joint in reading.tree.joints:
        if joint.name in expected:
            limits = {"lower": joint.lower, "upper": joint.upper} if "limits" in bad.reading else {}
            parent = {"parent": joint.parent} if joint.parent == "world" else {}
            assert replace(expected.pop(joint.name), **limits, **parent) == joint
    assert not expected
    assert read_urdf(write_core(reading.tree).encode(), strict=True).tree == reading.tree


@pytest.mark.parametrize("error", [ValueError, LookupError, OverflowError, MemoryError, UnicodeError])
def test_whatever_the_parser_raises_is_typed(error: type[Exception], monkeypatch: pytest.MonkeyPatch):
    def feed(self: object, text: str) -> None:
        raise error("out of something")

    monkeypatch.setattr("bodyimage_kin.robot._xml._Builder.feed", feed)
    with pytest.raises(InvalidURDF, match="not readable as XML: out of something"):
        read(GOOD)


def test_the_bad_files_differ():
    every = [*BAD, *CARELESS]
    assert len({bad.data for bad in every}) == len(every) >= 400


# The core


@st.composite
def trees(draw: st.DrawFn) -> dict[str, Any]:
    """The fields of any checked tree: links and joints in any order, finite numbers, mimics of earlier joints."""
    text = st.text(st.characters(exclude_categories=("Cs", "Cc", "Cn")) | st.sampled_from("\t\n\r&<>'\""), min_size=1)
    name = text.filter(lambda text: text.strip() and "${" not in text and "$(" not in text)
    names = st.lists(name, unique=True, max_size=6)
    joint_names = draw(names)
    link_names = draw(st.lists(name, unique=True, min_size=len(joint_names) + 1, max_size=len(joint_names) + 1))
    number = st.floats(allow_nan=False, allow_infinity=False)
    vector = st.tuples(number, number, number)
    joints: list[Joint] = []
    for index, joint_name in enumerate(joint_names):
        kind = draw(st.sampled_from(("revolute", "continuous", "prismatic", "fixed")))
        parent, child = draw(st.sampled_from(link_names[: index + 1])), link_names[index + 1]
        xyz, rpy = draw(vector), draw(vector)
        if kind == "fixed":
            joints.append(Joint(joint_name, kind, parent, child, xyz, rpy))
            continue
        unit = st.floats(-1.0, 1.0)
        direction = draw(st.tuples(unit, unit, unit).filter(lambda axis: math.hypot(*axis) > 1e-9))
        axis = tuple(value / math.hypot(*direction) for value in direction)
        lower, upper = sorted(draw(st.tuples(number, number))) if kind != "continuous" else (-math.inf, math.inf)
        # The largest number is how no limit is written.
        lower, upper = (-math.inf if lower == -UNLIMITED else lower), (math.inf if upper == UNLIMITED else upper)
        sources = [joint.name for joint in joints if joint.kind != "fixed"]
        mimic = draw(st.none() | st.builds(Mimic, st.sampled_from(sources), number, number)) if sources else None
        joints.append(Joint(joint_name, kind, parent, child, xyz, rpy, axis, lower, upper, mimic))
    links, shuffled = draw(st.permutations(link_names)), draw(st.permutations(joints))
    return {"name": draw(name), "root": link_names[0], "links": tuple(links), "joints": tuple(shuffled)}


@given(trees())
@settings(deadline=None)
def test_a_tree_reads_back_from_its_core_to_the_bit(fields: dict[str, Any]):
    tree = KinematicTree(**fields)
    again = read(write_core(tree))
    assert again == tree
    assert repr(again) == repr(tree), "the sign of zero too"


def test_the_core_says_everything_and_nothing_else():
    core = ElementTree.fromstring(write_core(read(GOOD)))
    assert {element.tag for element in core} == {"link", "joint"}
    parts = {joint.get("name"): [part.tag for part in joint] for joint in core.iter("joint")}
    assert parts == {
        "shoulder": ["parent", "child", "origin", "axis", "limit"],
        "slide": ["parent", "child", "origin", "axis", "limit"],
        "grip": ["parent", "child", "origin", "axis", "limit", "mimic"],
        "spin": ["parent", "child", "origin", "axis"],
        "weld": ["parent", "child", "origin"],
    }


# Size


def chain(joints: int, backwards: bool = False) -> bytes:
    """A serial chain in which each joint mimics the next, its joints listed from the root or from the tip."""
    links = "".join(f'<link name="l{index}"/>' for index in range(joints + 1))
    form = (
        '<joint name="j{0}" type="revolute"><origin xyz="0 0 0.1"/><parent link="l{0}"/><child link="l{1}"/>'
        '<axis xyz="0 1 1"/><limit lower="-1" upper="1"/>{2}</joint>'
    )
    mimic = '<mimic joint="j{}"/>'
    parts = [form.format(i, i + 1, mimic.format(i + 1) if i + 1 < joints else "") for i in range(joints)]
    return f'<robot name="chain">{links}{"".join(parts[::-1] if backwards else parts)}</robot>'.encode()


def timed(data: bytes) -> tuple[float, KinematicTree]:
    start = time.perf_counter()
    tree = read_urdf(data).tree
    return time.perf_counter() - start, tree


@pytest.mark.parametrize("backwards", [False, True])
def test_a_chain_of_3000_links_loads_in_linear_time_without_recursion(backwards: bool):
    short = min(timed(chain(100, backwards))[0] for _ in range(3))
    seconds, tree = timed(chain(3000, backwards))
    assert len(tree.links) == 3001
    assert seconds < 150 * short, "30 is linear, 900 quadratic"


@pytest.mark.parametrize("step", [1, -1])
def test_cycles_are_sought_with_few_looks_at_each_joint(step: int):
    class Counted(dict[str, str]):
        looks = 0

        def __getitem__(self, name: str) -> str:
            self.looks += 1
            return super().__getitem__(name)

    chained = Counted({str(index): str(index + 1) for index in range(3000)[::step]})
    assert _find_cycle(chained) == []
    assert chained.looks <= 2 * len(chained), "some room for the type checker's own looks"


@pytest.mark.slow
def test_the_largest_robot_loads():
    links = "".join(f'<link name="{index}"/>' for index in range(MAX_JOINTS + 1))
    form = '<joint name="{0}" type="fixed"><parent link="{0}"/><child link="{1}"/></joint>'
    joints = "".join(form.format(index, index + 1) for index in range(MAX_JOINTS))
    assert len(read(f'<robot name="largest">{joints}{links}</robot>').links) == MAX_JOINTS + 1


def test_the_limits_themselves_are_allowed():
    nested = "<gazebo>" * (MAX_DEPTH - 1) + "</gazebo>" * (MAX_DEPTH - 1)
    assert good_with("</robot>", f"{nested}</robot>") == read(GOOD)
    assert read_urdf(GOOD.encode().ljust(MAX_BYTES)).tree == read(GOOD)


# Anything at all

PIECES = [
    *(b"<", b">", b'"', b"'", b"&", b"/", b"=", b" ", b"\0", b"\xff", b"\xc3", b"\xef\xbb\xbf", b"]]>", b"&#55;"),
    *(b"<!--", b"-->", b"<![CDATA[", b"<?x ?>", b"<!DOCTYPE robot>", b"<joint>", b"</joint>", b'<link name="a"/>'),
    *(b"<axis/>", b"<origin/>", b"<limit/>", b'<mimic joint="grip"/>', b"xacro:", b"u:", b' xmlns="u"', b"utf-16"),
]  # fmt: skip
VALUES = [
    *(b"", b" ", b"nan", b"-inf", b"1e999", b"0x1", b"1_0", b"1,5", b"9" * 400, b"0 0 0", b"1e308 1e308 0", b"${x}"),
    *(b"fixed", b"continuous", b"prismatic", b"revolute", b"planar", b"base", b"tip", b"grip", b"spin"),
]  # fmt: skip
ATTRIBUTE = re.compile(rb'(\w+)="([^"]*)"')


def _swap(data: bytes, one: tuple[int, int], other: tuple[int, int]) -> bytes:
    """Exchange two stretches, or nothing if they overlap."""
    (a, b), (c, d) = sorted((one, other))
    return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:] if b <= c else data


@st.composite
def spoilt_urdfs(draw: st.DrawFn) -> bytes:
    """The good file after accidents to lines and attributes (mostly still XML), in half the cases to bytes too."""
    data = GOOD.encode()
    whole = draw(st.booleans())
    for _ in range(draw(st.integers(1, 6))):
        # Small numbers are the commonest draw: they shall mean the middle of the file, not the declaration.
        start, other = ((draw(st.integers(0, 4000)) + len(data) // 2) % (len(data) + 1) for _ in range(2))
        length = draw(st.integers(1, 40))
        attributes = list(ATTRIBUTE.finditer(data)) or [re.match(b"()()", data)]
        left, right = attributes[start % len(attributes)], attributes[other % len(attributes)]
        lines = data.splitlines(keepends=True) or [b""]
        line = start % len(lines)
        match draw(st.integers(0, 5 if whole else 9)):
            case 0 | 1 as group:  # the names, or the values, of two attributes swapped
                data = _swap(data, left.span(group + 1), right.span(group + 1))
            case 2:
                data = data[: left.start(2)] + draw(st.sampled_from(VALUES)) + data[left.end(2) :]
            case 3:
                data = data[: left.start()] + data[left.end() :]
            case 4:
                data = b"".join(lines[:line] + lines[line + 1 :])
            case 5:
                data = b"".join(lines[: line + 1] + lines[line:])
            case 6:
                data = data[:start] + bytes([draw(st.integers(0, 255))]) + data[start + 1 :]
            case 7:
                data = data[:start] + data[start + length :]
            case 8:
                data = data[:start] + draw(st.sampled_from(PIECES)) + data[start:]
            case 9:
                data = _swap(data, (start, start + length), (other, other + length))
    return data


def read_or_refuse(data: bytes) -> KinematicTree | InvalidURDF:
    try:
        return read_urdf(data).tree
    except InvalidURDF as error:
        return error


def check_that_only_a_tree_or_a_typed_error_comes_out(data: bytes) -> None:
    tree = read_or_refuse(data)
    if isinstance(tree, InvalidURDF):
        assert tree.problem
        assert str(tree).isprintable()
        return
    assert len(tree.links) == len(set(tree.links)) == len({joint.name for joint in tree.joints}) + 1
    assert {joint.child for joint in tree.joints} | {tree.root} == set(tree.links)
    for joint in tree.joints:
        assert joint.lower <= joint.upper
        assert math.isclose(math.hypot(*joint.axis), 1.0, abs_tol=1e-15)
        assert all(map(math.isfinite, joint.xyz + joint.rpy))
    assert read(write_core(tree)) == tree


@given(spoilt_urdfs())
@settings(max_examples=300, deadline=None)
def test_a_spoilt_file_is_refused_or_read_but_never_crashes(data: bytes):
    check_that_only_a_tree_or_a_typed_error_comes_out(data)


@pytest.mark.slow
@given(spoilt_urdfs())
@settings(max_examples=100_000, deadline=None, database=None, suppress_health_check=[HealthCheck.too_slow])
def test_100_000_spoilt_files_are_refused_or_read_but_never_crash(data: bytes):
    check_that_only_a_tree_or_a_typed_error_comes_out(data)


@given(st.binary() | st.text().map(str.encode))
@settings(deadline=None)
def test_any_bytes_at_all_are_refused(data: bytes):
    with pytest.raises(InvalidURDF):
        read_urdf(data)


# Robots of the field


def _has_no_link(robot: ElementTree.Element) -> bool:
    return robot.find("link") is None


def _mimics_an_unknown_joint(robot: ElementTree.Element) -> bool:
    joints = {joint.get("name") for joint in robot.findall("joint")}
    return any(mimic.get("joint") not in joints for mimic in robot.findall("joint/mimic"))


REFUSED: dict[str, tuple[str, Callable[[ElementTree.Element], bool]]] = {
    "ur3.urdf": ("the robot has no link", _has_no_link),
    "alex_psyonic_hands.urdf": ("mimics joint 'index_q1', which does not exist", _mimics_an_unknown_joint),
}
"""Published robots that are refused: the message, and an independent check that it is true."""


@pytest.mark.parametrize("path", sorted(ROBOTS.rglob("*.urdf")), ids=lambda path: path.stem)
def test_published_robots_load_or_are_refused_for_a_true_reason(path: Path):
    data = path.read_bytes()
    robot = ElementTree.fromstring(data)
    if path.name in REFUSED:
        problem, holds = REFUSED[path.name]
        assert holds(robot)
        with pytest.raises(InvalidURDF, match=problem):
            read_urdf(data)
        return
    tree = read_urdf(data).tree
    assert tree.links == tuple(link.get("name") for link in robot.findall("link"))
    assert [joint.name for joint in tree.joints] == [joint.get("name") for joint in robot.findall("joint")]
    assert read(write_core(tree)) == tree


@pytest.mark.parametrize("path", sorted(ROBOTS.rglob("*.urdf")), ids=lambda path: path.stem)
def test_pinocchio_sees_the_same_robot_in_the_core_as_in_the_file(path: Path):
    pinocchio = pytest.importorskip("pinocchio")
    if path.name in REFUSED:
        pytest.skip("refused")
    whole = pinocchio.buildModelFromUrdf(str(path))
    core = pinocchio.buildModelFromXML(write_core(read_urdf(path.read_bytes()).tree))
    assert list(core.names) == list(whole.names)
    posture = pinocchio.randomConfiguration(whole)
    seen = []
    for model in (whole, core):
        data = model.createData()
        pinocchio.framesForwardKinematics(model, data, posture)
        links = {
            frame.name: place
            for frame, place in zip(model.frames, data.oMf, strict=True)
            if frame.type == pinocchio.BODY
        }
        seen.append(links)
    assert seen[0].keys() == seen[1].keys()
    for link, place in seen[0].items():
        assert seen[1][link].isApprox(place, 1e-12), link
