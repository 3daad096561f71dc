"""The command ``bodyimage-kin``: parse, call the library, print.

Nothing heavy is imported before a command runs, so that ``--help`` answers at once.
"""

from __future__ import annotations

import inspect
import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Annotated, Any, Union

import tyro

from bodyimage_kin import __version__
from bodyimage_kin.cli.arguments import Command
from bodyimage_kin.cli.bodies import Embodiment
from bodyimage_kin.cli.calibrate import Calibrate
from bodyimage_kin.cli.checks import Conform
from bodyimage_kin.cli.doctor import Doctor
from bodyimage_kin.cli.next import Next
from bodyimage_kin.cli.recordings import Fit, Import, Simulate
from bodyimage_kin.cli.score import Score
from bodyimage_kin.cli.studies import Report, Reproduce, Study
from bodyimage_kin.cli.viewing import View
from bodyimage_kin.errors import BodyImageKinError, DataWarning

__all__ = ["main"]

_COMMANDS: Mapping[str, type[Command]] = {
    "reproduce": Reproduce,
    "study": Study,
    "report": Report,
    "simulate": Simulate,
    "import": Import,
    "fit": Fit,
    "score": Score,
    "calibrate": Calibrate,
    "next": Next,
    "embodiment": Embodiment,
    "view": View,
    "conform": Conform,
    "doctor": Doctor,
}
_USER, _OURS, _PIPE = 2, 70, 141
_ABOUT = """\
Learned kinematics held against the analytic truth.

  bodyimage-kin COMMAND --help       its arguments, with examples
  bodyimage-kin COMMAND ... --debug  an error with its traceback
  bodyimage-kin --version            which one this is

Exit status: 0 all well; 1 done, but something that was asked failed (a cell, a law, a check); 2 a mistake in what was
given, told in one line; 70 an error of ours; 130, 143, 129 ended by Ctrl-C or a signal."""


def main(arguments: list[str] | None = None) -> int:
    """Entry point; a user's error is one line on standard error and exit status 2."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in given
    given = [argument for argument in given if argument != "--debug"]
    if given[:1] == ["--version"]:
        print(f"bodyimage-kin {__version__}")
        return 0
    command = _parsed(given)
    try:
        with _ended_by(signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)), _plain_warnings():
            status = int(command())
            sys.stdout.flush()
            return status
    except BrokenPipeError:
        # Whoever reads has seen enough (| head); what is left to flush has nowhere to go.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _PIPE
    except KeyboardInterrupt as end:
        print("bodyimage-kin: interrupted; what is finished is kept", file=sys.stderr)
        return 128 + (end.number if isinstance(end, _Ended) else signal.SIGINT)
    except Exception as problem:
        if debug:
            traceback.print_exc()
        return _told(problem)


def _told(problem: Exception) -> int:
    """One line of an error, and its exit status."""
    if isinstance(problem, BodyImageKinError):
        print(f"bodyimage-kin: {problem}", file=sys.stderr)
        return _USER
    said = " ".join(str(problem).split())
    if isinstance(problem, OSError):
        print(f"bodyimage-kin: {said}", file=sys.stderr)
        return _USER
    print(
        f"bodyimage-kin: an error of ours, {type(problem).__name__}: {said}; the same command with --debug shows where",
        file=sys.stderr,
    )
    return _OURS


# Help ----------------------------------------------------------------------------------------------------------------


def _parsed(given: list[str]) -> Command:
    """The command that the arguments mean; help and mistakes in them end the process."""
    config = (tyro.conf.FlagCreatePairsOff, tyro.conf.OmitArgPrefixes)
    if given and given[0] in _COMMANDS:
        kind: Any = _COMMANDS[given[0]]
        name = f"bodyimage-kin {given[0]}"
        if kind is Embodiment and given[1:2] and given[1] in Embodiment.ACTIONS:
            # With examples of its own, which the help of a subcommand would not have.
            action: Any = Embodiment.ACTIONS[given[1]]
            described, name = _described(action), f"{name} {given[1]}"
            return Embodiment(tyro.cli(action, prog=name, description=described, args=given[2:], config=config))
        return tyro.cli(kind, prog=name, description=_described(kind), args=given[1:], config=config)
    # Help, completion in a shell, and names that are none.
    kinds = tuple(
        Annotated[kind, tyro.conf.subcommand(name, description=_lines(kind)[0])] for name, kind in _COMMANDS.items()
    )
    every: Any = Union[kinds]  # noqa: UP007
    return tyro.cli(every, prog="bodyimage-kin", description=_ABOUT, args=given, config=config)


def _described(kind: type[Command]) -> str:
    """What a command does, with examples."""
    paragraphs = "\n".join(_lines(kind)).split("\n\n")
    said = "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)
    return f"{said}\n\nExamples:\n" + "\n".join(f"  {example}" for example in kind.EXAMPLES)


def _lines(kind: type[Command]) -> list[str]:
    return (inspect.getdoc(kind) or "").splitlines()


# Around a command ----------------------------------------------------------------------------------------------------


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """Shows what data cannot carry as a line of its own, and not where in the code it was noticed."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", DataWarning)
        shown = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            if issubclass(category, DataWarning):
                print(f"bodyimage-kin: note: {message}", file=sys.stderr)
            else:
                shown(message, category, *place, **more)

        warnings.showwarning = show
        yield


class _Ended(KeyboardInterrupt):
    """A signal asks for the end, as Ctrl-C does."""

    def __init__(self, number: int) -> None:
        self.number = number


@contextmanager
def _ended_by(*numbers: int) -> Iterator[None]:
    """Lets signals end what runs as Ctrl-C does: what it began is ended too; those that are ignored (nohup) stay so."""

    def end(number: int, frame: object) -> None:
        raise _Ended(number)

    before = {number: signal.getsignal(number) for number in numbers}
    caught = [number for number, how in before.items() if how is signal.SIG_DFL]
    if threading.current_thread() is not threading.main_thread():
        caught = []
    for number in caught:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in caught:
            signal.signal(number, before[number])
