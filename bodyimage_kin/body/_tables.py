"""Tables of a file, read field by field: what is wrong is noted, and reading goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from bodyimage_kin import _checks
from bodyimage_kin.body._build import Mistakes
from bodyimage_kin.errors import BodyImageKinError, FoldedLens, InvalidConfig, UnknownName

NEEDED = object()
"""The default of a field that has none."""


class Table:
    """A table whose every field is asked for by name; what nobody asks for is a mistake.

    Attributes:
        values: What the file has.
        place: File and table, for messages.
        mistakes: Where what is wrong is noted.
        broken: Whether a field of it is wrong or missing, so that nothing can be built of it.
    """

    def __init__(self, values: Mapping[str, Any], place: str, mistakes: Mistakes) -> None:
        self.values, self.place, self.mistakes, self.broken = values, place, mistakes, False
        self._asked: list[str] = []

    def take(self, field: str, check: Callable[[str, Any], Any], default: Any = NEEDED, wanted: str = "") -> Any:
        """A field's value, checked; its default, or None where it is wrong.

        Args:
            field: Its name.
            check: Of its name in an error, and the value: what is to be used; may raise.
            default: Of a field that may be missing.
            wanted: What to give, in the error of a missing field.
        """
        self._asked.append(field)
        if field not in self.values:
            if default is NEEDED:
                self.note(InvalidConfig(f"{self.place}: field '{field}' is missing" + (wanted and f"; give {wanted}")))
                return None
            return default
        try:
            return check(f"{self.place}: {field}", self.values[field])
        except BodyImageKinError as mistake:
            self.note(mistake)
            return None

    def text(self, field: str, wanted: str = "a name") -> Any:
        """Text that is not empty."""
        return self.take(field, _checks.text, wanted=wanted)

    def number(self, field: str, default: Any = NEEDED, **bounds: Any) -> Any:
        """A finite number within bounds."""
        return self.take(field, lambda name, value: _checks.number(name, value, **bounds), default, "a number")

    def numbers(self, field: str, count: int | None, default: Any = NEEDED, **bounds: Any) -> Any:
        """Several finite numbers."""
        wanted = "a list of numbers" if count is None else f"{count} numbers"
        return self.take(field, lambda name, value: _checks.numbers_of(name, value, count, **bounds), default, wanted)

    def table(self, field: str, default: Any = NEEDED) -> Any:
        """A table in this one."""

        def check(name: str, value: Any) -> Table:
            if not isinstance(value, dict):
                _checks.refuse(name, value, f"a table: [{field}] and its fields below")
            # The file, then the table's whole name: my.toml [camera.left].
            inside = f"{self.place[:-1]}.{field}]" if self.place.endswith("]") else f"{self.place} [{field}]"
            return Table(value, inside, self.mistakes)

        return self.take(field, check, default, f"a table [{field}]")

    def make(self, build: Callable[[], Any]) -> Any:
        """What is built of the fields; None where one of them is wrong. A mistake is noted with the table's place."""
        if self.broken:
            return None
        try:
            return build()
        except InvalidConfig as mistake:
            # A lens that folds, or a pose that is none: the message does not know where it was written.
            kind = FoldedLens if isinstance(mistake, FoldedLens) else InvalidConfig
            self.note(kind(f"{self.place}: {mistake}"))
            return None

    def note(self, mistake: BodyImageKinError) -> None:
        """Notes what is wrong."""
        self.broken = True
        self.mistakes.found.append(mistake)

    def close(self, also: Iterable[str] = ()) -> None:
        """Notes every field that was not asked for.

        Args:
            also: Fields that are valid beside those asked for.
        """
        valid = sorted({*self._asked, *also})
        for field in self.values:
            if field not in valid:
                self.note(InvalidConfig(str(UnknownName(f"field in {self.place}", field, valid))))
