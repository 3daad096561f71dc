"""One look for every figure: sizes, fonts, and what stands for whom.

Colour never carries a meaning alone: every name also has a line style and a marker, and the colours differ in
lightness, so that figures can be read by everybody and in grey. The landmarks have colours of Okabe and Ito (2008), the
estimators others in the manner of Tol's muted scheme; the two sets share none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypedDict

import matplotlib as mpl

from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.figures.labels import role

_ROLES: Mapping[str, tuple[str, Any, str]] = {
    "truth": ("#000000", "-", "."),
    "analytic": ("#332288", (0, (6, 1.5, 1, 1.5)), "D"),
    "paper_mlp": ("#c2407e", "-", "o"),
    "least_squares": ("#4aa8e0", (0, (4, 1.5)), "s"),
    "direct": ("#8a8a1c", (0, (1, 1)), "^"),
}
"""Colour, line style and marker of those who estimate."""
_OTHERS: tuple[tuple[str, Any, str], ...] = (
    ("#882255", (0, (8, 2)), "P"),
    ("#44aa99", (0, (3, 1, 1, 1)), "X"),
    ("#d9a514", "-", "*"),
    ("#b06a3b", (0, (2, 1)), "<"),
    ("#117733", (0, (6, 1, 1, 1, 1, 1)), ">"),
    ("#9c7fd6", (0, (5, 3)), "h"),
)
"""Of names without a role, in turn."""
_LANDMARKS: Mapping[str, tuple[str, str]] = {
    "left_eye": ("#d55e00", "s"),
    "right_eye": ("#009e73", "o"),
    "mouth": ("#e69f00", "v"),
    "nose": ("#0072b2", "D"),
}
"""Colour and marker; the paper's hues: left eye red, right eye green, mouth yellow, nose blue."""
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


class Look(TypedDict):
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


def looks(names: Iterable[str]) -> dict[str, Look]:
    """How each name is drawn, as keyword arguments of a line: never two alike, in colour or in grey.

    Args:
        names: Those with a role (truth, paper_mlp ...) always look the same, others take turns in their order.

    Raises:
        InvalidConfig: More names without a role than can be told apart.
    """
    found: dict[str, Look] = {}
    others = iter(_OTHERS)
    for name in names:
        known = _ROLES.get(role(name)) or next(others, None)
        if known is None:
            raise InvalidConfig(
                f"a figure can tell only {len(_OTHERS)} names without a role apart; draw {name!r} in another figure"
            )
        found[name] = Look(color=known[0], linestyle=known[1], marker=known[2])
    return found


def landmark_look(name: str) -> dict[str, Any]:
    """How a landmark is drawn, as keyword arguments of a line: a marker with a black edge."""
    colour, marker = _LANDMARKS.get(role(name), ("#7a7a7a", "*"))
    return {"color": colour, "marker": marker, "markeredgecolor": "black", "markeredgewidth": 0.4, "linestyle": ""}
