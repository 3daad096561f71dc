"""``python -m bodyimage_kin.study.child``: a process that does one call after the other until its parent ends.

Calls come by the standard input, answers go to the standard output; all that is printed meanwhile goes to a log.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bodyimage_kin.errors import BodyImageKinError

if TYPE_CHECKING:
    from bodyimage_kin.study.calls import Call

__all__ = ["live"]


def live(lifeline: int) -> None:
    """Answers calls; the first answer says that this process is ready.

    Args:
        lifeline: A pipe that ends with the process that began this one, however that ends.
    """
    # An interrupt from the terminal reaches every process; the one that began the study decides what follows.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, args=(lifeline,), daemon=True).start()
    calls, answers = Connection(os.dup(0), writable=False), Connection(os.dup(1), readable=False)
    with open(os.devnull) as nothing:
        os.dup2(nothing.fileno(), 0)
    _print_into(None)
    # What cells need is loaded before the first limit runs.
    import bodyimage_kin.study.cells  # noqa: F401

    answers.send("ready")
    while True:
        try:
            call: Call = calls.recv()
        except EOFError:
            return
        except Exception as problem:
            answers.send((False, RuntimeError(f"cannot read the work: {problem}")))
            continue
        answer = _answer(call, answers)
        _print_into(None)
        try:
            answers.send(answer)
        except Exception as problem:
            answers.send((False, RuntimeError(f"what came of it cannot be sent: {problem}")))


def _answer(call: Call, answers: Connection) -> tuple[bool, Any]:
    """Whether it was done, and what came of it."""
    from bodyimage_kin.study.calls import Step, run

    steps = 0
    try:
        if call.prepare is not None:
            call.prepare(call.arguments[0])
        answers.send((None, -1))
        for said in run(call):
            if isinstance(said, Step):
                _print_into(said.log)
                answers.send((None, steps))
                steps += 1
        return True, said
    except BodyImageKinError as problem:
        return False, problem
    except Exception as problem:
        # Said in words: not every error can travel between processes.
        return False, RuntimeError(f"{type(problem).__name__}: {problem}")


def _end_with_parent(lifeline: int) -> None:
    """Ends this process as soon as the one that began it has ended, whatever is at work here."""
    with contextlib.suppress(OSError):
        os.read(lifeline, 1)
    os._exit(1)


_PRINTED: dict[str, Path] = {}
"""The log that this process prints into."""


def _print_into(log: str | None) -> None:
    """From now on all that this process prints goes to a file, also what libraries print past Python."""
    for printed in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            printed.flush()
    before = _PRINTED.pop("log", None)
    place = Path(log or os.devnull)
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        file = place.open("ab")
    except OSError:
        place = Path(os.devnull)
        file = place.open("ab")
    with file:
        for number, name in ((1, "stdout"), (2, "stderr")):
            os.dup2(file.fileno(), number)
            # Anew each time: a step before may have closed or replaced it.
            stream = open(number, "w", buffering=1, errors="backslashreplace", closefd=False)  # noqa: SIM115
            setattr(sys, name, stream)
    if log is not None:
        _PRINTED["log"] = place
    if before is not None:
        with contextlib.suppress(OSError):
            if before.is_file() and before.stat().st_size == 0:
                before.unlink()


if __name__ == "__main__":
    # Modules are imported by their own names, so that what travels is the same here and there.
    from bodyimage_kin.study import child

    child.live(int(sys.argv[1]))
