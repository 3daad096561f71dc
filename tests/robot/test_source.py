"""Text is text: whatever a robot is read from, it is the same robot, and no message ever quotes the file."""

from __future__ import annotations

import io
import random

import pytest
from bad_urdfs import GOOD

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidURDF

ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "utf-16le", "utf-16be", "iso-8859-1", "windows-1252"]
NAMED = GOOD.replace('"arm"', '"b\u00e9b\u00e9"')


def declared(encoding):
    return NAMED.replace("utf-8", encoding.removesuffix("-sig"))


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("before", ["", "\n", " \r\n\t"])
def test_the_same_robot_from_everything(encoding, before, tmp_path):
    text = before + declared(encoding)
    data, path = text.encode(encoding), tmp_path / "robot.urdf"
    path.write_bytes(data)
    sources = [text, data, bytearray(data), memoryview(data), path, str(path), io.StringIO(text), io.BytesIO(data)]
    robots = [bk.Robot.from_urdf(source) for source in sources]
    with path.open("rb") as file, path.open(encoding=encoding, newline="") as text_file:
        robots += [bk.Robot.from_urdf(file), bk.Robot.from_urdf(text_file)]
    assert all(robot.tree == robots[0].tree for robot in robots)
    assert robots[0].name == "b\u00e9b\u00e9"
    # The bytes are those of the file, but for the mark that a text has lost.
    assert len({robot.sha256 for robot in robots if robot.source == data}) == 1
    assert robots[1].source == robots[4].source == data
    assert [robot.file for robot in robots] == [None, None, None, None, path, path, None, None, path, path]
    assert all(bk.Robot.from_urdf(robot.source) == robot for robot in robots)


@pytest.mark.parametrize("encoding", ["iso-8859-1", "utf-16", "us-ascii"])
def test_text_may_declare_what_cannot_hold_it(encoding):
    robot = bk.Robot.from_urdf(declared(encoding).replace("b\u00e9b\u00e9", "\u706b"))
    assert robot.name == "\u706b"
    assert bk.Robot.from_urdf(robot.source) == robot


def test_a_mark_left_in_the_text_is_no_part_of_it():
    assert bk.Robot.from_urdf("\ufeff" + NAMED).tree == bk.Robot.from_urdf(NAMED).tree
    assert bk.Robot.from_urdf("\ufeff\n" + declared("iso-8859-1")).tree == bk.Robot.from_urdf(NAMED).tree


def test_a_robot_without_a_name_is_called_as_its_file(tmp_path):
    text = '<robot><link name="a"/></robot>'
    path = tmp_path / "left arm.urdf"
    path.write_text(text)
    with path.open() as file:
        assert [bk.Robot.from_urdf(source).name for source in (path, file, text)] == ["left arm", "left arm", "robot"]


SECRET = "the-password"
NO_ROBOTS = {
    "nothing": (None, "cannot be read from NoneType"),
    "a number": (5, "cannot be read from int"),
    "a list": ([GOOD], "cannot be read from list"),
    "a parsed tree": (object(), "cannot be read from object"),
    "a class": (io.StringIO, "cannot"),
    "a file of numbers": (type("Numbers", (), {"read": lambda self, size: 5})(), "gives int, not text"),
    "a closed file": (io.StringIO("x"), "cannot read the open file: I/O operation on closed file"),
    "a text file of other encoding": (
        io.TextIOWrapper(io.BytesIO(b"<\xff>"), encoding="utf-8"),
        "cannot read the open",
    ),
    "JSON": ('{"robot": "' + SECRET + '"}\n', "neither XML nor a path"),
    "text before the robot": (f"{SECRET}\n{GOOD}", "neither XML nor a path"),
    "an empty text": ("", "the text is empty; give a path"),
    "blanks": (b" \n\t", "the text is empty"),
    "bytes with a zero": (b"\x1f\x8b\x08\0" + SECRET.encode(), "neither XML nor a path"),
    "long": (SECRET * 1000, "neither XML nor a path"),
    "bytes before the robot": (f"{SECRET} {GOOD}".encode(), "neither XML nor a path"),
    "random bytes": (random.Random(0).randbytes(5000), "neither XML nor a path"),
    "half a character": (GOOD.replace('"arm"', '"\ud800"'), "line 2: the text has half a character"),
    "UTF-16 cut": (GOOD.encode("utf-16")[:-1], "not text in utf-16le: truncated data"),
    "a broken robot": (GOOD.replace("</robot>", f'<robt secret="{SECRET}"'), "not well-formed XML: unclosed token"),
    "an unknown word": (GOOD.replace("</robot>", f'<robt secret="{SECRET}"/></robot>'), "<robt> in <robot>"),
}


@pytest.mark.parametrize("source", NO_ROBOTS)
def test_what_is_no_robot_is_refused_without_being_quoted(source):
    thing, message = NO_ROBOTS[source]
    if source == "a closed file":
        thing.close()
    with pytest.raises(InvalidURDF, match=message) as caught:
        bk.Robot.from_urdf(thing)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 300
    assert SECRET not in str(caught.value)
