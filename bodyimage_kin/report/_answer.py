"""Pages that answer one question: a sentence, a picture, a table, then the details."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bodyimage_kin import figures
from bodyimage_kin.recordings.schema import versions
from bodyimage_kin.report._page import Picture, csv_of, inlined, number, write_page

_BEYOND = 10.0
"""A relative error above it is no number that anybody would compare."""


@dataclass(frozen=True)
class Table:
    """Rows of cells that are texts already.

    Attributes:
        columns: Headings.
        rows: One cell a column.
        caption: What they are of.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """One part of the details.

    Attributes:
        heading: Its title.
        text: Paragraphs.
        items: A list below them.
        tables: Below that.
    """

    heading: str
    text: Sequence[str] = ()
    items: Sequence[str] = ()
    tables: Sequence[Table] = ()


def write_answer(
    path: Path,
    title: str,
    sentences: Sequence[str],
    picture: Picture,
    table: Table,
    *,
    notes: Sequence[str] = (),
    sections: Sequence[Section] = (),
) -> Path:
    """Writes the page; its folder is made when missing."""
    with figures.style():
        figure = picture.draw()
    drawn = inlined(picture, figures.svg(figure), csv_of(figure), 0)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_page(
        path,
        "answer.html",
        title=title,
        sentences=sentences,
        pictures=[drawn],
        table=table,
        notes=notes,
        sections=sections,
        origin="Made by " + ", ".join(f"{name} {one}" for name, one in versions().items()) + ".",
    )
    return path


def size(value: float, unit: str) -> str:
    """A distance in the unit of what was observed; metres as millimetres."""
    return f"{number(1e3 * value)} mm" if unit == "m" else f"{number(value)} {unit}".strip()


def percent(value: float) -> str:
    """A share, in per cent."""
    if value > _BEYOND:
        return f"over {100 * _BEYOND:.0f} %"
    return f"{number(100 * value, 3)} %" if value == value else number(value)


def names(of: Sequence[str]) -> str:
    """One, two and three."""
    return of[0] if len(of) == 1 else f"{', '.join(of[:-1])} and {of[-1]}"
