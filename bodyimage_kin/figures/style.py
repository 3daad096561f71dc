"""One look for every figure: sizes, fonts, and what stands for whom.

Colour never carries a meaning alone: every name also has a line style and a marker, and the colours differ in
lightness, so that figures can be read by everybody and in grey. The landmarks have colours of Okabe and Ito (2008), the
estimators others in the manner of Tol's muted scheme; the two sets share none.
"""

from __future__ import annotations

import io
import os
import re
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypedDict

import matplotlib as mpl
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as OutlinePath

from bodyimage_kin.errors import InvalidConfig

MILLIMETRE = 1 / 25.4
"""[inch]"""
SINGLE_COLUMN = 88 * MILLIMETRE
"""Width of a figure in one column of a journal [inch]."""
DOUBLE_COLUMN = 180 * MILLIMETRE
"""Width of a figure across the page [inch]."""

COLOURS: dict[str, str] = {
    "truth": "#000000",
    "analytic": "#332288",
    "paper_mlp": "#c2407e",
    "least_squares": "#4aa8e0",
    "direct": "#8a8a1c",
    "left_eye": "#d55e00",
    "right_eye": "#009e73",
    "mouth": "#e69f00",
    "nose": "#0072b2",
}
"""Colour by role. The landmarks keep the paper's hues: left eye red, right eye green, mouth yellow, nose blue."""

LINE_STYLES: dict[str, Any] = {
    "truth": "-",
    "analytic": (0, (6, 1.5, 1, 1.5)),
    "paper_mlp": "-",
    "least_squares": (0, (4, 1.5)),
    "direct": (0, (1, 1)),
}
"""Line style by role."""

MARKERS: dict[str, str] = {
    "truth": ".",
    "analytic": "D",
    "paper_mlp": "o",
    "least_squares": "s",
    "direct": "^",
    "left_eye": "s",
    "right_eye": "o",
    "mouth": "v",
    "nose": "D",
}
"""Marker by role."""

LABELS: dict[str, str] = {
    "truth": "truth",
    "analytic": "analytic Jacobian",
    "analytic_midpoint": "analytic Jacobian, midpoint",
    "paper_mlp": "paper's network",
    "paper_mlp_500": "paper's network, 500 steps",
    "paper_mlp_tuned": "paper's network, tuned",
    "posture_mlp": "network of posture and motion",
    "jacobian_network": "Jacobian network",
    "forward_network": "forward network",
    "least_squares": "least squares",
    "least_squares_scaled": "least squares, told the depth",
    "ridge": "ridge regression",
    "nearest_neighbours": "nearest neighbours",
    "trig_ridge": "trigonometric ridge",
    "rational_trig": "rational trigonometric",
    "gaussian_process": "Gaussian process",
    "recursive_least_squares": "recursive least squares",
    "locally_weighted": "locally weighted regression",
    "broyden": "Broyden",
    "kalman": "Kalman filter",
    "forward_ensemble": "ensemble of forward networks",
    "self_calibration": "self-calibration",
    "null_zero": "null: zero",
    "null_scaled": "null: a tenth of the truth",
    "null_rotated": "null: truth turned by 30 degrees",
    "null_rank_one": "null: truth of rank one",
    "null_other_arm": "null: another arm's",
    "direct": "direct sight",
    "jacobian_error_use": "Jacobian error, motion's metric",
    "velocity_correlation": "velocity correlation",
    "velocity_nrmse": "velocity NRMSE",
    "trajectory_rmse": "trajectory RMSE",
    "topological_error": "topological error",
    "folded_cells": "folded cells",
    "map_span": "map span",
    "map_disparity": "map disparity",
    "map_scale": "map scale",
    "scale": "scale",
    "rotation": "rotation",
    "rank": "rank",
    "noise": "noise",
    "left_eye": "left eye",
    "right_eye": "right eye",
    "training": "in training",
    "on_circle": "on the circle",
    "in_front": "in front of the face",
    "on_face": "on the face",
    "joint_space": "whole joint space",
}
"""What a reader of the figure calls it."""

_OTHERS = (
    ("#882255", (0, (8, 2)), "P"),
    ("#44aa99", (0, (3, 1, 1, 1)), "X"),
    ("#7a7a7a", "-", "*"),
    ("#b06a3b", (0, (2, 1)), "<"),
    ("#117733", (0, (6, 1, 1, 1, 1, 1)), ">"),
    ("#9c7fd6", (0, (5, 3)), "h"),
)
_RC: dict[str, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "legend.handlelength": 2.6,
    "legend.borderaxespad": 0.2,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "lines.linewidth": 1.0,
    "lines.markersize": 3.5,
    "patch.linewidth": 0.6,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "text.usetex": False,
    # Text stays text: it can be searched, read aloud and edited, and a figure is a third smaller than with outlines.
    "svg.fonttype": "none",
    "svg.hashsalt": "bodyimage-kin",
}


class Appearance(TypedDict):
    """Keyword arguments of a matplotlib line."""

    color: str
    linestyle: Any
    marker: str


@contextmanager
def style() -> Iterator[None]:
    """The look of all figures, as a context (or decorator) inside which figures are made; nothing outlives it.

    It starts from matplotlib's own defaults, so that no user's matplotlibrc can change a published figure.
    """
    with mpl.rc_context():
        # The backend is the one setting that must stay: resetting it would make pyplot choose anew for the user.
        settings: dict[Any, Any] = {key: mpl.rcParamsDefault[key] for key in mpl.rcParams if "backend" not in key}
        mpl.rcParams.update(settings | _RC)
        yield


def role(name: str) -> str:
    """The key under which a name is found in the tables here: ``"PaperMLP"`` and ``"paper_mlp"`` are one."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()


def label(name: str) -> str:
    """What a reader calls it; a name nobody listed is shown as it is, underscores as spaces."""
    return LABELS.get(role(name), name.replace("_", " "))


def appearances(names: Iterable[str]) -> dict[str, Appearance]:
    """How each name is drawn: roles as the tables say, other names in turn from a fixed cycle, never two alike.

    Raises:
        InvalidConfig: More names without a role than the cycle can tell apart.
    """
    found: dict[str, Appearance] = {}
    others = iter(_OTHERS)
    for name in names:
        key = role(name)
        if key in LINE_STYLES:
            found[name] = Appearance(color=COLOURS[key], linestyle=LINE_STYLES[key], marker=MARKERS[key])
            continue
        try:
            colour, line_style, marker = next(others)
        except StopIteration:
            raise InvalidConfig(
                f"a figure can tell only {len(_OTHERS)} names without a role apart; draw {name!r} in another figure"
            ) from None
        found[name] = Appearance(color=colour, linestyle=line_style, marker=marker)
    return found


def landmark(name: str) -> dict[str, Any]:
    """How a landmark is drawn, as keyword arguments of a matplotlib line: a marker with a black edge."""
    key = role(name)
    colour, marker = COLOURS.get(key, "#7a7a7a"), MARKERS.get(key, "*")
    return {"color": colour, "marker": marker, "markeredgecolor": "black", "markeredgewidth": 0.4, "linestyle": ""}


def dots(axes: Axes, points: Float[np.ndarray, "points 2"], *, size: float | int, **look: Any) -> None:
    """Dots as lines next to no length with round ends: a tenth of what as many markers take in an SVG."""
    points = points[np.isfinite(points).all(1)]
    reach = float(np.ptp(points[:, 0])) if len(points) else 0.0
    ends = points + np.array([1e-4 * reach, 0.0])
    vertices = np.stack([points, ends], axis=1).reshape(-1, 2)
    outline = OutlinePath(
        vertices, np.tile(np.array([OutlinePath.MOVETO, OutlinePath.LINETO], dtype=OutlinePath.code_type), len(points))
    )
    colour = look.pop("color")
    axes.add_patch(
        PathPatch(outline, facecolor="none", edgecolor=colour, linewidth=size, capstyle="round", snap=False, **look)
    )


def new_figure(width: float | int, height: float | int) -> Figure:
    """An empty figure of width x height [inch], laid out so that nothing overlaps, unknown to pyplot."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, folder: str | os.PathLike[str], name: str) -> tuple[Path, Path]:
    """Write ``folder/name.svg`` and ``folder/name.png`` (200 dpi), each atomically and the same bytes every time.

    The figure stays usable. It was never registered anywhere, so there is nothing to close.

    Args:
        figure: A figure made here; its layout is settled now and stays.
        folder: Made when missing.
        name: A plain file name without suffix.

    Returns:
        The two paths, SVG first.

    Raises:
        InvalidConfig: The name is not a plain file name.
    """
    if not re.fullmatch(r"\w[\w.-]*", name):
        raise InvalidConfig(f"figure name {name!r} is not a plain file name; use letters, digits, '_', '-' and '.'")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with style():
        engine = figure.get_layout_engine()
        if engine is not None:
            # The constrained layout moves at every draw; settled once, every file shows the same figure. One pass does
            # not settle axes of equal aspect under a legend.
            for _ in range(3):
                engine.execute(figure)
            figure.set_layout_engine("none")
        svg, png = io.BytesIO(), io.BytesIO()
        # Not savefig: it draws everything once more to settle a layout that is settled.
        figure.set_dpi(200)
        FigureCanvasSVG(figure).print_svg(svg, metadata={"Date": None, "Creator": None})  # type: ignore[no-untyped-call]
        figure.set_dpi(200)  # a drawing in SVG leaves it at 72
        FigureCanvasAgg(figure).print_png(png, metadata={"Software": None})  # type: ignore[no-untyped-call]
    paths = folder / f"{name}.svg", folder / f"{name}.png"
    _replace(paths[0], _rounded(svg.getvalue()))
    _replace(paths[1], png.getvalue())
    return paths


def _rounded(svg: bytes) -> bytes:
    """The same drawing with path coordinates in hundredths of a point: four micrometres, and half the bytes."""

    def shorter(match: re.Match[bytes]) -> bytes:
        return re.sub(rb"-?\d+\.\d{3,}", lambda number: b"%g" % round(float(number[0]), 2), match[0])

    return re.sub(rb' d="[^"]*"', shorter, svg)


def _replace(path: Path, data: bytes) -> None:
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    try:
        temporary.write_bytes(data)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
