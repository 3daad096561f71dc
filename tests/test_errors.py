"""Laws of every error: one line that nobody's names can break, and the same error in another process."""

from __future__ import annotations

import inspect
import pickle
import time

import pytest

from bodyimage_kin import errors
from bodyimage_kin.errors import BodyImageKinError, DataWarning, InvalidConfig, InvalidURDF, ManyMistakes, UnknownName

HOSTILE = "a\n\x1b[31m\r\x00\u202e\u2028<b>'\"\ud800"
"""A line break, colours of a terminal, text turned round, half a character."""
CLASSES = [
    one for one in vars(errors).values() if inspect.isclass(one) and issubclass(one, BodyImageKinError | DataWarning)
]
NEED_MORE = {
    "UnknownName": ("link", HOSTILE, (HOSTILE, "b")),
    "ManyMistakes": (HOSTILE, (InvalidConfig(HOSTILE), InvalidURDF(HOSTILE, line=2))),
    "Unreachable": (HOSTILE, (3, 4)),
}


def made(cls):
    return cls(*NEED_MORE.get(cls.__name__, (HOSTILE,)))


@pytest.mark.parametrize("cls", CLASSES)
def test_a_message_is_one_line_that_no_name_can_break(cls):
    said = str(made(cls))
    for line in said.split("\n"):
        assert line.isprintable()
    assert said.count("\n") == (2 if cls is ManyMistakes else 0)
    assert "<b>" in said


@pytest.mark.parametrize("cls", CLASSES)
def test_an_error_is_the_same_in_another_process(cls):
    one = made(cls)
    other = pickle.loads(pickle.dumps(one))
    assert type(other) is cls
    assert str(other) == str(one)
    assert {key: str(value) for key, value in vars(other).items()} == {
        key: str(value) for key, value in vars(one).items()
    }


def test_where_a_urdf_is_wrong_is_known_in_another_process():
    one = InvalidURDF("no", element="joint 'a'", line=3, remedy="mend it")
    other = pickle.loads(pickle.dumps(one))
    assert (other.problem, other.element, other.line, other.remedy) == ("no", "joint 'a'", 3, "mend it")
    assert str(other) == "joint 'a', line 3: no; mend it"


def test_a_name_without_end_is_cut_and_compared_with_nothing():
    begin = time.monotonic()
    said = str(UnknownName("link", "a" * 10**6, [f"link{index}" for index in range(20_000)]))
    assert time.monotonic() - begin < 1.0
    assert len(said) < 2000
    assert "'aaa" in said
    assert said.endswith("link98, link99 and 19900 more")
    assert UnknownName("link", "left_hnad", ["left_hand"]).close_matches == ("left_hand",)
