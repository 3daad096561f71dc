"""What pages share: figures inside them with their data, numbers in tables, names in files."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import jinja2
import xarray as xr
from markupsafe import Markup
from matplotlib.figure import Figure

from bodyimage_kin import figures
from bodyimage_kin._files import write_text


@dataclass(frozen=True, eq=False)
class Picture:
    """One figure of a page.

    Attributes:
        name: Of its files, and of its data.
        section: Which part of the page it stands in.
        draw: Draws it.
        title: One line.
        text: What it shows.
    """

    name: str
    section: str
    draw: Callable[[], Figure]
    title: str
    text: str


def write_page(path: Path, template: str, **content: Any) -> None:
    """Renders a page that needs nothing beside it, and asks for nothing when it is opened."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("bodyimage_kin.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals.update(label=figures.label, number=number, interval=interval, fixed=fixed)
    write_text(path, environment.get_template(template).render(**content))


def inlined(picture: Picture, svg: str, csv: str, index: int) -> dict[str, Any]:
    """A picture as a template shows it.

    Args:
        picture: Its words.
        svg: As :func:`bodyimage_kin.figures.svg` drew it.
        csv: Its values; empty where it has none.
        index: Of the picture in its page: names inside the SVG are its own.
    """
    own = f"figure{index}"
    drawing = svg[svg.index("<svg") :]
    drawing = re.sub(r"<metadata>.*?</metadata>", "", drawing, flags=re.DOTALL)
    drawing = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{own}-", drawing)
    drawing = drawing.replace("*{stroke", f"#{own} *{{stroke")
    width = float(re.search(r'width="([\d.]+)pt"', drawing)[1]) / 72  # type: ignore[index]
    return {
        "id": own,
        "section": picture.section,
        "title": picture.title,
        "text": picture.text,
        "svg": Markup(drawing),
        "wide": width > figures.SINGLE_COLUMN + 0.1,
        "rem": round(8.7 * width, 1),  # one size of letters on all figures, near that of the text
        # Turned dark with the page, what is a photograph of values or of a robot would lie.
        "dark": "<image" not in drawing,
        "file": f"{file_name(picture.name)}.csv",
        "csv": f"data:text/csv;charset=utf-8,{quote(csv, safe=_PLAIN)}" if csv else "",
    }


_PLAIN = ",.-_()[]=;:'/!*@$|+"


def csv_of(figure: Figure) -> str:
    """The values of a figure as CSV; empty where it has none."""
    found = figures.values(figure)
    return found.to_csv(index=False, lineterminator="\n") if len(found) else ""


def file_name(name: str) -> str:
    """A name as part of a file's: itself where that is plain, otherwise with a hash, so that no two become one."""
    plain = re.sub(r"[^\w.-]+", "-", name, flags=re.ASCII).strip("-.")[:60]
    return plain if plain and plain == name else f"{plain or 'name'}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def labels_of(results: xr.Dataset, labels: Mapping[str, str] | None) -> dict[str, str]:
    """The labels of a study's own config, and those that were given before these."""
    own = json.loads(results.attrs.get("config", "{}")).get("labels", {})
    return {str(name): str(text) for name, text in {**own, **(labels or {})}.items()}


def number(value: float | None, digits: int = 3) -> str:
    """Significant digits; a dash for none."""
    if value is None or not math.isfinite(value):
        return "–"  # noqa: RUF001
    return _signed(f"{value:.{digits}g}") if value != 0 else "0"


def fixed(value: float | None, digits: int = 2, factor: float | int = 1.0) -> str:
    """Digits after the point; a dash for none."""
    if value is None or not math.isfinite(value):
        return "–"  # noqa: RUF001
    return _signed(f"{factor * value:.{digits}f}")


def _signed(text: str) -> str:
    return text.replace("-", "\N{MINUS SIGN}")


def interval(values: tuple[float, float, float]) -> str:
    """Mean and interval in one cell."""
    mean, lower, upper = values
    return number(mean) + (f" [{number(lower)}, {number(upper)}]" if math.isfinite(lower) else "")
