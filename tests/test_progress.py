"""Progress: sparse lines where nobody watches, with the rate and the time left."""

from __future__ import annotations

import re

import pytest

from bodyimage_kin import _progress


@pytest.fixture
def clock(monkeypatch):
    """A clock that goes when it is told."""
    now = [100.0]
    monkeypatch.setattr(_progress.time, "monotonic", lambda: now[0])
    return now


def told(capsys):
    return capsys.readouterr().err.splitlines()


def test_a_log_gets_a_line_a_tenth_with_rate_and_time_left(clock, capsys):
    with _progress.progress("cells") as tell:
        for done in range(101):
            tell(done, 100)
            clock[0] += 2.0
    lines = told(capsys)
    assert lines[0] == "cells: 0 of 100"
    assert lines[1] == "cells: 10 of 100, 2.0 s each, 3 min left"
    assert lines[-1] == "cells: 100 of 100, 2.0 s each"
    assert len(lines) == 11
    assert not any(re.search(r"[\x1b\r]", line) for line in lines)


def test_what_an_earlier_run_has_done_does_not_count_into_the_rate(clock, capsys):
    with _progress.progress("cells") as tell:
        tell(50, 100)
        clock[0] += 10.0
        tell(70, 100)
    assert told(capsys) == ["cells: 50 of 100", "cells: 70 of 100, 2 a second, 15 s left"]


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.04, "0.0 s"), (9.4, "9.4 s"), (42.0, "42 s"), (130.0, "2 min"), (5400.0, "90 min"), (7 * 3600.0, "7 h 00 min")],
)
def test_durations_are_said_as_people_say_them(seconds, words):
    assert _progress._duration(seconds) == words


def test_a_terminal_gets_a_bar(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    with _progress.progress("cells") as tell:
        tell(1, 4)
        tell(4, 4)
    shown = capsys.readouterr().err
    assert "4/4" in shown
    assert "left" in shown
