"""Progress with rate and time left: a bar on a terminal, sparse lines in a log."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

Tell = Callable[[int, int], None]
"""Called with the number of things done and their total."""


@contextmanager
def progress(what: str) -> Iterator[Tell]:
    """Shows how much is done on standard error; a bar on a terminal, a line at each tenth elsewhere.

    Args:
        what: What is counted, in the plural.
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        yield _lines(console, what)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), _Rate(), TimeElapsedColumn())
    with Progress(*columns, TextColumn("left"), TimeRemainingColumn(), console=console) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


class _Rate(ProgressColumn):
    """How many are done in a second, or how many seconds one takes."""

    def render(self, task: Task) -> Text:
        """The rate so far."""
        return Text(_rate(task.speed) if task.speed else "")


def _lines(console: Console, what: str) -> Tell:
    """A line at the beginning, and one whenever another tenth is done."""
    begin, first, shown = time.monotonic(), 0, -1

    def line(done: int, total: int) -> None:
        nonlocal first, shown
        if shown < 0:
            # What was there before this run took it no time.
            first = done
        if (tenth := 10 * done // max(total, 1)) <= shown:
            return
        shown = tenth
        said = f"{what}: {done} of {total}"
        seconds = time.monotonic() - begin
        if done > first and seconds > 0.0:
            speed = (done - first) / seconds
            said += f", {_rate(speed)}"
            if total > done:
                said += f", {_duration((total - done) / speed)} left"
        console.print(said, highlight=False, soft_wrap=True)

    return line


def _rate(speed: float) -> str:
    return f"{speed:.3g} a second" if speed >= 1.0 else f"{_duration(1.0 / speed)} each"


def _duration(seconds: float) -> str:
    if seconds < 99.5:
        return f"{seconds:.0f} s" if seconds >= 9.5 else f"{seconds:.1f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60:02d} min"
