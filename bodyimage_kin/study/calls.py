"""What is handed out, and how it is done: in this process, or in a *child*, a process that can be killed.

A crash, a kill or a time limit costs the step of a child that was at work, and no other. Children end with the process
that began them, however that ended.

Pebble 5.2.3 was tried for the children, and cannot keep three of their promises: that the time limit begins when a call
is prepared (its embodiment loaded; Pebble's begins before), that a killed child is replaced at once (there, after four
seconds), and that a script needs no ``if __name__ == "__main__":`` (there it ends in ``BrokenProcessPool``).
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from bodyimage_kin._checks import number
from bodyimage_kin.errors import BodyImageKinError

__all__ = [
    "Call",
    "Child",
    "NoWorker",
    "Step",
    "Stopped",
    "TimeLimitExceeded",
    "WorkerDied",
    "here",
    "in_child",
    "run",
]


class Stopped(Exception):
    """A call came to no end.

    Attributes:
        step: The step that was at work, from 0; -1: none.
        alone: Whether its process had done nothing before, so that nothing but this step can be to blame.
    """

    step: int = -1
    alone: bool = True


class TimeLimitExceeded(Stopped):
    """A step took longer than it may."""


class WorkerDied(Stopped):
    """The process of a call ended: a crash, or no memory left."""


class NoWorker(BodyImageKinError):
    """No process can be started here; nothing a task is to blame for."""


@dataclass(frozen=True)
class Step:
    """What work yields at the beginning of each of its steps.

    Attributes:
        log: File for all that it prints; None: nowhere.
    """

    log: str | None = None


@dataclass(frozen=True)
class Call:
    """Something to do, as it travels.

    Attributes:
        work: A function that processes can import, called with the arguments; or a generator, which yields a
            :class:`Step` at the beginning of each of its steps, and in the end what came of it.
        arguments: What it is called with.
        prepare: Called with the first argument before the time begins to run.
        limit: Time that each step may take [s]; None: any.
        alone: Whether it is done by a process that has done nothing before.
    """

    work: Callable[..., Any]
    arguments: tuple[Any, ...] = ()
    prepare: Callable[[Any], Any] | None = None
    limit: float | None = None
    alone: bool = False


def run(call: Call) -> Iterator[Any]:
    """Does a call, all in the thread of whoever asks for the next thing, whatever time it takes.

    Yields:
        Each step as it begins; last, what came of the call.
    """
    done = call.work(*call.arguments)
    return done if isinstance(done, Generator) else iter([done])


def here(call: Call, begin: Callable[[Any], None] = lambda said: None) -> Any:
    """Does a call in this process, or gives it up after its time.

    Args:
        call: What is to be done; of a single step if there is a limit.
        begin: Called with all that :func:`run` yields.

    Raises:
        TimeLimitExceeded: It took longer. The thread that works is left behind, and ends with its process.
    """
    if call.prepare is not None:
        call.prepare(call.arguments[0])
    future: Future[Any] = Future()

    def work() -> None:
        try:
            for said in run(call):
                begin(said)
            future.set_result(said)
        except BaseException as problem:
            future.set_exception(problem)

    if call.limit is None:
        work()
        return future.result()
    threading.Thread(target=work, daemon=True).start()
    try:
        return future.result(number("limit", call.limit, above=0.0))
    except TimeoutError:
        if future.done():
            raise
        raise TimeLimitExceeded(_too_long(call.limit)) from None


def in_child(call: Call) -> Any:
    """Does a call in a child of this thread's own; what a worker of Dask does."""
    child: Child | None = getattr(_OWN, "child", None)
    if child is not None and call.alone and child.used:
        child.end()
    if child is None or not child.alive:
        child = _OWN.child = Child()
    return child.call(call)


class Child:
    """A process that does one call after the other (:mod:`bodyimage_kin.study.child`)."""

    def __init__(self) -> None:
        # Begun anew, not forked: a fork would inherit torch's threads in whatever state they are.
        paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
        ours, self._lifeline = os.pipe()
        with tempfile.TemporaryFile() as said:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "bodyimage_kin.study.child", str(ours)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=said,
                pass_fds=[ours],
                env={**os.environ, "PYTHONPATH": paths},
            )
            os.close(ours)
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            self._calls = Connection(os.dup(self._process.stdin.fileno()), readable=False)
            self._answers = Connection(os.dup(self._process.stdout.fileno()), writable=False)
            self._process.stdin.close()
            self._process.stdout.close()
            self.alive, self.used = True, False
            try:
                self._answers.recv()
            except (EOFError, OSError) as problem:
                self.kill()
                said.seek(0)
                last = said.read().decode(errors="replace").strip().splitlines()[-1:] or [type(problem).__name__]
                raise NoWorker(f"a worker could not start: {last[0]}") from None

    def call(self, call: Call) -> Any:
        """What comes of it, or what went wrong."""
        step, alone, self.used = -1, not self.used, True
        try:
            self._calls.send(call)
            done, value = self._answers.recv()
            while done is None:
                step, alone = value, alone and value < 1
                if not self._answers.poll(call.limit):
                    self.kill()
                    raise _at(step, alone, TimeLimitExceeded(_too_long(call.limit or 0.0)))
                done, value = self._answers.recv()
        except (EOFError, OSError):
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(5)
            code = self._process.returncode
            self.kill()
            died = WorkerDied(f"the process ended with status {code}: a crash, or no memory left")
            raise _at(step, alone, died) from None
        if done:
            return value
        raise value

    def end(self) -> None:
        """Lets it finish."""
        self._calls.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(5)
        self.kill()

    def __del__(self) -> None:
        # A thread that works for Dask ends without a word.
        self.kill()

    def kill(self) -> None:
        """Ends it at once."""
        if getattr(self, "alive", False):
            self.alive = False
            self._process.kill()
            self._process.wait()
            for pipe in (self._calls, self._answers):
                pipe.close()
            os.close(self._lifeline)


# Inner ---------------------------------------------------------------------------------------------------------------


_OWN = threading.local()
"""The child of each thread that works for Dask."""


def _at(step: int, alone: bool, problem: Stopped) -> Stopped:
    problem.step, problem.alone = step, alone
    return problem


def _too_long(limit: float) -> str:
    return f"took longer than the time limit of {limit:g} s"
