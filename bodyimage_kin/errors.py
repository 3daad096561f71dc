"""Every error a user can cause, typed: it names the thing that is wrong and the remedy, in one line."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from functools import partial
from typing import Any

__all__ = [
    "BodyImageKinError",
    "DataWarning",
    "FoldedLens",
    "InvalidArray",
    "InvalidConfig",
    "InvalidGeometry",
    "InvalidPosture",
    "InvalidRecording",
    "InvalidURDF",
    "ManyMistakes",
    "MissingDependency",
    "NoSkin",
    "NotDifferentiable",
    "NotVisible",
    "OutputRefused",
    "UnknownName",
    "Unreachable",
    "UnsupportedDevice",
]


_MOST_NAMES = 100
"""Valid names that an error lists."""
_LONGEST = 80
"""Characters of a name that was given, as an error shows it."""


def _printable(text: str, kept: str = "") -> str:
    """A message without what would break its line or speak to a terminal: names come from anybody's files."""
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() or one in kept else repr(one)[1:-1] for one in text)


class BodyImageKinError(Exception):
    """Base of all errors raised on purpose by this package; each says what it says in one line."""

    def __str__(self) -> str:
        return _printable(super().__str__())


class InvalidURDF(BodyImageKinError):
    """A robot description that is not a URDF this package can trust.

    Attributes:
        problem: What is wrong.
        element: The element at fault, e.g. ``joint 'left_elbow'``; empty when there is none to name.
        line: Line in the file, counted from 1; None when unknown.
        remedy: What to do about it.
    """

    def __init__(self, problem: str, *, element: str = "", line: int | None = None, remedy: str = "") -> None:
        self.problem, self.element, self.line, self.remedy = problem, element, line, remedy
        place = ", ".join(part for part in (element, f"line {line}" if line is not None else "") if part)
        super().__init__((f"{place}: " if place else "") + problem + (f"; {remedy}" if remedy else ""))

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(type(self), element=self.element, line=self.line, remedy=self.remedy), (self.problem,)


class UnknownName(BodyImageKinError):
    """A name that nothing here bears.

    Attributes:
        kind: What was looked for, e.g. ``"link"``.
        name: The name that was given.
        valid: Every name that would have been accepted.
        close_matches: Those of them that look like ``name``.
    """

    def __init__(self, kind: str, name: object, valid: Iterable[str]) -> None:
        self.kind, self.name, self.valid = kind, name, tuple(valid)
        # What is longer is no misspelt name, and takes long to compare.
        given = str(name) if len(str(name)) <= 2 * _LONGEST else ""
        self.close_matches = tuple(difflib.get_close_matches(given, self.valid, n=3))
        guess = (
            f"did you mean {' or '.join(repr(match) for match in self.close_matches)}? " if self.close_matches else ""
        )
        more = f" and {len(self.valid) - _MOST_NAMES} more" if len(self.valid) > _MOST_NAMES else ""
        listed = ", ".join(self.valid[:_MOST_NAMES]) + more
        shown = repr(name)
        shown = shown if len(shown) <= _LONGEST else f"{shown[: _LONGEST - 3]}..."
        super().__init__(f"no {kind} {shown}; {guess}valid: {listed or '(none)'}")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.kind, self.name, self.valid)


class InvalidPosture(BodyImageKinError):
    """Joint values of the wrong shape, kind or value."""


class InvalidRecording(BodyImageKinError):
    """A recording that lacks what is needed of it, or has no samples or no motion to learn from."""


class InvalidConfig(BodyImageKinError):
    """A setting out of its range, or a configuration file that cannot be read; names the field."""


class ManyMistakes(InvalidConfig):
    """Several things that are wrong at once, told together.

    Attributes:
        place: Where: a file, or what was to be built.
        mistakes: The error of each.
    """

    def __init__(self, place: str, mistakes: Iterable[BodyImageKinError]) -> None:
        self.place, self.mistakes = place, tuple(mistakes)
        lines = "".join(f"\n  {mistake}" for mistake in self.mistakes)
        super().__init__(f"{_printable(place)}: {len(self.mistakes)} mistakes:{lines}")

    def __str__(self) -> str:
        return _printable(Exception.__str__(self), kept="\n")

    def __reduce__(self) -> tuple[type[ManyMistakes], tuple[str, tuple[BodyImageKinError, ...]]]:
        return type(self), (self.place, self.mistakes)


class InvalidArray(BodyImageKinError):
    """An array of the wrong shape or kind, where no more particular error applies."""


class NotVisible(BodyImageKinError):
    """The hand has no image: it is not in front of the camera plane, or beyond where a lens folds."""


class NoSkin(BodyImageKinError):
    """What was asked needs a skin, and the embodiment has none.

    Attributes:
        embodiment: Its name.
    """

    def __init__(self, embodiment: str) -> None:
        self.embodiment = embodiment
        super().__init__(f"embodiment {embodiment!r} has no skin; give it one, or ask for what needs none")

    def __reduce__(self) -> tuple[type[NoSkin], tuple[str]]:
        return type(self), (self.embodiment,)


class FoldedLens(InvalidConfig):
    """A place where the polynomial of a lens' distortion has turned back, so that it describes no lens."""


class Unreachable(BodyImageKinError):
    """A place that the hand cannot reach within the joint limits.

    Attributes:
        taxels: The taxels that cannot be reached, empty when the place is not a taxel.
    """

    def __init__(self, message: str, taxels: Iterable[int] = ()) -> None:
        self.taxels = tuple(taxels)
        super().__init__(message)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.args[0], self.taxels)


class NotDifferentiable(BodyImageKinError):
    """A derivative was asked of something that has none."""


class UnsupportedDevice(BodyImageKinError):
    """A tensor lives on a device that the backend does not compute on; nothing is moved silently."""


class MissingDependency(BodyImageKinError):
    """An optional library is not installed; the message says how to install it."""


class InvalidGeometry(BodyImageKinError):
    """Geometry that is missing, of an unknown kind, or outside the allowed folders."""


class OutputRefused(BodyImageKinError):
    """An output place that exists and is not ours: it is never overwritten silently."""


class DataWarning(UserWarning):
    """Data that cannot carry what is asked of them, in one line: the result is what it is, and not to be trusted."""

    def __str__(self) -> str:
        return _printable(super().__str__())
