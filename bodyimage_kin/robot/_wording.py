"""How the reader speaks: names cut to a line, guesses at misspelt ones, and notes of what it passed over."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from bodyimage_kin.errors import InvalidURDF


def shorten(text: str) -> str:
    """At most 80 characters of a text."""
    return text if len(text) <= 80 else f"{text[:77]}..."


def quote(text: str) -> str:
    """A text in quotes, on one line."""
    return repr(shorten(text))


def listed(names: Sequence[str]) -> str:
    """The names, quoted; of many only the first, enough to find the fault."""
    more = f" and {len(names) - 10} more" if len(names) > 10 else ""
    return ", ".join(quote(name) for name in names[:10]) + more


def amount(count: int) -> str:
    """How many numbers, in words."""
    return f"{count} number{'s' if count != 1 else ''}"


def closest(name: str, known: Iterable[str]) -> str:
    """The known name that looks most like another, empty when none does."""
    matches = difflib.get_close_matches(shorten(name), sorted(known), n=1)
    return matches[0] if matches else ""


def guess(name: str, known: Iterable[str]) -> str:
    """A remedy for a name that does not exist."""
    match = closest(name, known)
    return f"did you mean {quote(match)}?" if match else "correct the name"


def title(tag: str, attributes: Mapping[str, str]) -> str:
    """What errors call an element."""
    name = attributes.get("name")
    return f"{shorten(tag)} {quote(name)}" if name else shorten(tag)


@dataclass
class Notes:
    """What was read although a strict reader would refuse it, and what was passed over.

    Attributes:
        strict: Refuse the former.
    """

    strict: bool = False
    _lenient: list[str] = field(default_factory=list)
    _passed_over: dict[str, tuple[int, int]] = field(default_factory=dict)

    def allow(
        self, problem: str, reading: str, *, element: str = "", line: int | None = None, remedy: str = ""
    ) -> None:
        """Notes a problem and how it is read.

        Raises:
            InvalidURDF: The reader is strict.
        """
        error = InvalidURDF(problem, element=element, line=line, remedy=remedy if self.strict else reading)
        if self.strict:
            raise error
        self._lenient.append(str(error))

    def lose(self, problem: str) -> None:
        """Notes a part of the geometry that cannot be read."""
        self._lenient.append(problem)

    def pass_over(self, what: str, line: int) -> None:
        """Counts something that says nothing of what is read here."""
        count, first = self._passed_over.get(what, (0, line))
        self._passed_over[what] = count + 1, first

    def lines(self) -> tuple[str, ...]:
        """One line for each, what is passed over counted by kind."""
        counted = (
            f"line {first}: passed over {what}" + (f" ({count} in all)" if count > 1 else "")
            for what, (count, first) in self._passed_over.items()
        )
        return (*self._lenient, *counted)
