"""A figure as files: SVG with the values under the pointer, PNG, and what it shows as a table."""

from __future__ import annotations

import io
import os
import re
from pathlib import Path

import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from bodyimage_kin._files import atomic_path, write_text
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.figures._style import style
from bodyimage_kin.figures._values import hover, shown, table

_DPI = 200


def save(figure: Figure, folder: str | os.PathLike[str], name: str) -> tuple[Path, ...]:
    """Writes ``folder/name.svg``, ``name.png`` (200 dpi) and ``name.csv``, each atomically, the same bytes every time.

    The figure stays usable. Values stand under the pointer in the SVG, where a browser shows it, and as
    :func:`values` in the CSV, which is left out where there are none.

    Args:
        figure: Any figure; its layout is settled now and stays.
        folder: Made when missing.
        name: A plain file name without suffix.

    Returns:
        The paths, SVG first.

    Raises:
        InvalidConfig: The name is not a plain file name.
    """
    if not re.fullmatch(r"\w[\w.-]*", name):
        raise InvalidConfig(f"figure name {name!r} is not a plain file name; use letters, digits, '_', '-' and '.'")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{name}.svg", folder / f"{name}.png"]
    write_text(paths[0], svg(figure))
    png = io.BytesIO()
    with style():
        figure.set_dpi(_DPI)
        FigureCanvasAgg(figure).print_png(png, metadata={"Software": None})  # type: ignore[no-untyped-call]
    with atomic_path(paths[1]) as temporary:
        temporary.write_bytes(png.getvalue())
    found = values(figure)
    if len(found):
        paths.append(folder / f"{name}.csv")
        write_text(paths[2], found.to_csv(index=False, lineterminator="\n"))
    return tuple(paths)


def svg(figure: Figure) -> str:
    """A figure as SVG: text as text, path coordinates to four micrometres, each value with a title for the pointer.

    Args:
        figure: Its layout is settled now and stays.
    """
    with style():
        _settle(figure)
        figure.set_dpi(_DPI)  # of pictures inside
        buffer = io.BytesIO()
        # Not savefig: it draws everything once more to settle a layout that is settled.
        FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None, "Creator": None})  # type: ignore[no-untyped-call]
    drawn = _rounded(buffer.getvalue()).decode()
    return drawn.replace("</svg>", hover(figure) + "</svg>")


def values(figure: Figure) -> pd.DataFrame:
    """What a figure shows, as a table: a row for each value that has a label, in the units that are drawn.

    Args:
        figure: Drawn already.

    Returns:
        Columns ``panel`` and ``series``; the two axes, by their labels where all panels share these; ``lower`` and
        ``upper`` of error bars and bands, ``value`` of coloured cells. What nothing has is left out.
    """
    return table(shown(figure))


def _settle(figure: Figure) -> None:
    engine = figure.get_layout_engine()
    if engine is not None:
        # The constrained layout moves at every draw; settled once, every file shows the same figure. One pass does not
        # settle axes of equal aspect under a legend.
        for _ in range(3):
            engine.execute(figure)
        figure.set_layout_engine("none")


def _rounded(drawing: bytes) -> bytes:
    """The same drawing with path coordinates in hundredths of a point: four micrometres, and half the bytes."""

    def shorter(match: re.Match[bytes]) -> bytes:
        return re.sub(rb"-?\d+\.\d{3,}", lambda number: b"%g" % round(float(number[0]), 2), match[0])

    return re.sub(rb' d="[^"]*"', shorter, drawing)
