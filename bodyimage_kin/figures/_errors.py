"""Errors of learned Jacobians: ranked, in parts, against distance, and as far as scores go together or notice them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin._checks import number, whole
from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.figures._images import note, shaped
from bodyimage_kin.figures._layout import drawing_on
from bodyimage_kin.figures._marks import DASHED, UNLISTED, decades, dots, reference
from bodyimage_kin.figures._style import Look, looks
from bodyimage_kin.figures.labels import drawn

_PROBES = (("#9a9a9a", "D"), ("#6fa3cf", "s"), ("#c2407e", "o"), ("#5b3a8e", "^"), ("#117733", "v"), ("#9a6b12", "P"))
"""Colour and marker of each probe, in the order in which they leave what was seen."""
_LEAST, _MOST = 1e-3, 30.0
"""Errors beyond are open marks at the edge: of the truth itself, and of what extrapolates wildly."""
_PARTS = ("#24405e", "#5f93bd", "#c9dcea", "#e8b04a", "#8c8c8c", "#f3e3c3")
"""Of the parts of a squared error, from the axis on: told apart by their lightness, at any size."""
_MOST_POINTS = 400  # of a series: enough to see a spread, few enough for an SVG
_MORE = (
    Look(color="#000000", linestyle="-", marker="o"),
    Look(color="#d55e00", linestyle=(0, (4, 1.5)), marker="v"),
    Look(color="#0072b2", linestyle=(0, (1, 1)), marker="s"),
    Look(color="#c9a227", linestyle="-", marker="^"),
)
"""Of measures, which have no roles, beside those of estimators."""


def errors(
    medians: xr.Dataset, ax: Axes | None = None, *, ranked_at: str | None = None, xlabel: str = "relative error"
) -> Axes:
    """Estimators ranked by their error, the smallest on top, a mark for each probe with its interval.

    Args:
        medians: ``median``, ``lower`` and ``upper`` over (estimator, probe): of ``study.summarise``, at one embodiment
            and recording.
        ax: Axes to draw on; None: those of a new figure.
        ranked_at: The probe whose errors rank them; None: the last.
        xlabel: What the errors are.

    Returns:
        The axes. Errors below 0.001 or above 30 are open marks at the edge; a Jacobian of zeros has 1, dashed.

    Raises:
        InvalidConfig: More probes than can be told apart, or no such probe.
    """
    probes = [str(name) for name in medians["probe"].values]
    if len(probes) > len(_PROBES):
        raise InvalidConfig(f"{len(probes)} probes; at most {len(_PROBES)} can be told apart, select some of them")
    last = ranked_at or probes[-1]
    if last not in probes:
        raise InvalidConfig(f"ranked_at={last!r}: give one of {', '.join(probes)}")
    order = medians["median"].sel(probe=last).fillna(np.inf).argsort().values[::-1]
    one = medians.isel(estimator=order)
    heights = np.arange(one.sizes["estimator"], dtype=float)
    drawn_there = np.stack([one[name].values for name in ("median", "lower", "upper")])
    inside = np.clip(drawn_there[np.isfinite(drawn_there)], _LEAST, _MOST)
    low, high = (float(inside.min()), float(inside.max())) if inside.size else (1.0, 1.0)
    with drawing_on(ax, height=0.9 + 0.16 * len(heights)) as axes:
        if any(other.has_data() for other in axes.get_shared_x_axes().get_siblings(axes) if other is not axes):
            # Panels that share an axis show all of each other's.
            least, most = axes.get_xlim()
            low, high = min(low, 1.4 * least), max(high, most / 1.4)
        beyond = False
        for probe, (colour, marker) in zip(probes, _PROBES, strict=False):
            median, lower, upper = (one[name].sel(probe=probe).values for name in ("median", "lower", "upper"))
            reach = np.nan_to_num(np.stack([median - lower, upper - median]).clip(0))
            look: dict[str, Any] = {"color": colour, "marker": marker, "linestyle": "", "markersize": 3.5}
            zorder = 3 if probe == last else 2
            axes.errorbar(median, heights, xerr=reach, **look, elinewidth=1.4, label=drawn(probe), zorder=zorder)
            outside = np.isfinite(median) & ((median < _LEAST) | (median > _MOST))
            beyond |= bool(outside.any())
            places = np.clip(median[outside], _LEAST, _MOST)
            axes.plot(places, heights[outside], **look, markerfacecolor="white", zorder=zorder + 1)
        axes.axvline(1.0, **DASHED)
        decades(axes, "x", [low, high, 1.0])
        names = [drawn(str(name)) for name in one["estimator"].values]
        top = len(heights) + (0.4 if beyond else -0.4)
        axes.set(xlim=(low / 1.4, max(high, 1.0) * 1.4), ylim=(-0.6, top), xlabel=xlabel)
        axes.set_yticks(heights, names)
        axes.grid(axis="x", color="0.92", linewidth=0.6)
        if beyond:
            note(axes, f"open: below {_LEAST:g} or above {_MOST:g}", above=True)
        return axes


def attribution(parts: Mapping[str, Mapping[str, float]], ax: Axes | None = None) -> Axes:
    """The squared relative error of learned Jacobians as the sum of its parts, a stacked bar an estimator.

    Args:
        parts: By estimator and part, in the order in which they are stacked (``metrics.attribute``).
        ax: Axes to draw on; None: those of a new figure.

    Returns:
        The axes. Bars of more than thrice the usual error are cut, with their number; the error 1 of a Jacobian of
        zeros is marked where bars come near it.

    Raises:
        InvalidConfig: No estimator, or others' parts.
        InvalidArray: A part that is negative or not a number.
    """
    if not parts:
        raise InvalidConfig("parts is empty; give at least one estimator")
    names = list(next(iter(parts.values())))
    if not 0 < len(names) <= len(_PARTS):
        raise InvalidConfig(f"{len(names)} parts; one to {len(_PARTS)} can be told apart")
    for estimator, of in parts.items():
        if list(of) != names:
            raise InvalidConfig(f"{estimator!r} has parts {', '.join(of)}; give {', '.join(names)}")
    widths = shaped([[of[part] for part in names] for of in parts.values()], "parts", None, len(names))
    if not (widths >= 0).all():
        raise InvalidArray("a part is negative or not a number; leave that estimator out")
    totals = widths.sum(1)
    # One bar of four decades would leave nothing to see of the others.
    most = max(1.2, 3 * float(np.median(totals)))
    top = float(totals[totals <= most].max(initial=0.0)) or most
    top = max(top, 1e-3, most if (totals > most).any() else 0.0, 1.0 if top > 0.6 else 0.0)
    rows = np.arange(len(parts))
    with drawing_on(ax, height=0.9 + 0.24 * len(rows)) as axes:
        left = np.zeros(len(rows))
        for part, width, colour in zip(names, widths.T, _PARTS, strict=False):
            axes.barh(rows, width, 0.7, left, color=colour, edgecolor="black", linewidth=0.4, label=drawn(part))
            left = left + width
        for row, total in zip(rows, totals, strict=True):
            cut = total > most
            text = f"{total:.3g} \N{BLACK RIGHT-POINTING TRIANGLE}" if cut else f"{total:.2f}"
            look: dict[str, Any] = {"va": "center", "fontsize": 6.5, "textcoords": "offset points"}
            if cut:
                look |= {"bbox": {"facecolor": "white", "edgecolor": "none", "pad": 1.0}, "ha": "right"}
            axes.annotate(text, (1.18 * top if cut else total, row), (-1 if cut else 2, 0), **look)
        if top > 0.6:
            axes.axvline(1.0, **DASHED)
            axes.plot([], [], **DASHED, label="Jacobian of zeros")
        axes.set_yticks(rows, [drawn(name) for name in parts])
        axes.tick_params(axis="y", length=0)
        axes.set(xlim=(0, 1.18 * top), ylim=(len(rows) - 0.4, -0.6), xlabel="squared relative error")
        return axes


def error_by_distance(
    distance: ArrayLike,
    errors: Mapping[str, ArrayLike],
    ax: Axes | None = None,
    *,
    xlabel: str = "distance from what was seen",
    named: Collection[str] | None = None,
    bins: int = 5,
) -> Axes:
    """The relative error of learned Jacobians against how far from what was seen they are asked.

    Args:
        distance: (posture,)
        errors: By estimator, (posture,) or (seed, posture) relative errors, 1 for a Jacobian of zeros; NaN left out.
        ax: Axes to draw on; None: those of a new figure.
        xlabel: What the distance is, with its unit.
        named: Estimators that are told apart; of the others a grey line of medians. None: all.
        bins: Bins of equally many postures.

    Returns:
        The axes: faint points are some postures (median over the seeds), markers medians of a bin, bars its quartiles
        over postures and seeds.

    Raises:
        InvalidArray: Shapes that do not fit together.
        InvalidConfig: Fewer than one bin, or more estimators than can be told apart.
    """
    whole("bins", bins, least=1)
    place = shaped(distance, "distance", None)
    edges = np.quantile(place, np.linspace(0, 1, bins + 1))
    bin_of = np.clip(np.searchsorted(edges, place, side="right") - 1, 0, bins - 1)
    told = looks([name for name in errors if named is None or name in named])
    reach = max(float(np.ptp(place)), 1e-12)
    with drawing_on(ax, height=2.7) as axes:
        for name, given in errors.items():
            values = np.atleast_2d(as_float_array(given, f"errors of {name!r}"))
            values = shaped(values, f"errors of {name!r}", None, len(place))
            rows = np.array(list(_quartiles(place, values, bin_of, bins))).reshape(-1, 4)
            if name not in told:
                axes.plot(*rows[:, :2].T, color="0.75", linewidth=0.8, zorder=1, label=UNLISTED + drawn(name))
                continue
            there = np.isfinite(values).any(0)
            points = np.stack([place[there], np.nanmedian(values[:, there], axis=0)], axis=1)
            colour = told[name]["color"]
            dots(axes, points[:: 1 + len(points) // _MOST_POINTS], size=1.2, color=colour, alpha=0.3, zorder=1)
            if not len(rows):
                continue
            x, median, lower, upper = rows.T
            # Side by side, or the bars of several estimators hide each other.
            x = x + (list(told).index(name) - (len(told) - 1) / 2) * 0.006 * reach
            bars = [median - lower, upper - median]
            axes.errorbar(x, median, bars, **told[name], elinewidth=0.8, capsize=1.5, zorder=3, label=drawn(name))
        if len(told) < len(errors):
            axes.plot([], [], color="0.75", linewidth=0.8, label="others")
        axes.set(yscale="log", xlabel=xlabel, ylabel="relative error of the Jacobian")
        axes.yaxis.set_major_formatter("{x:g}")
        reference(axes, 1.0, "Jacobian of zeros")
        return axes


def score_chain(
    drives: Mapping[str, ArrayLike],
    follows: Mapping[str, ArrayLike],
    ax: Axes | None = None,
    *,
    named: Collection[str] | None = None,
    xlabel: str = "",
    ylabel: str = "",
) -> Axes:
    """One score of each cell against another that it should drive, on axes of decades.

    Args:
        drives: By estimator, (cells,); NaN, or a value that is not positive, has no point.
        follows: Likewise, of the same estimators and cells.
        ax: Axes to draw on; None: those of a new figure.
        named: Estimators that are told apart; the others are grey. None: all.
        xlabel: What drives.
        ylabel: What follows.

    Raises:
        InvalidConfig: No estimator, or more than can be told apart.
        InvalidArray: Other estimators or cells on one axis than on the other.
    """
    if not drives:
        raise InvalidConfig("drives is empty; give at least one estimator")
    if set(drives) != set(follows):
        raise InvalidArray(
            f"one axis has {', '.join(drives)}, the other {', '.join(follows)}; give the same estimators"
        )
    told = looks([name for name in drives if named is None or name in named])
    x = {name: _positive(shaped(values, f"{xlabel} of {name!r}", None)) for name, values in drives.items()}
    y = {name: _positive(shaped(follows[name], f"{ylabel} of {name!r}", len(of))) for name, of in x.items()}
    with drawing_on(ax, height=3.0) as axes:
        for name in sorted(drives, key=lambda name: name in told):
            look = told.get(name, Look(color="0.75", linestyle="", marker="."))
            label = drawn(name) if name in told else UNLISTED + drawn(name)
            style: dict[str, Any] = {"color": look["color"], "marker": look["marker"], "linestyle": ""}
            axes.plot(x[name], y[name], **style, markersize=4.0, markeredgewidth=0.0, alpha=0.85, label=label)
        if len(told) < len(drives):
            axes.plot([], [], color="0.75", marker=".", linestyle="", label="others")
        axes.set(xlabel=xlabel, ylabel=ylabel)
        for which, of in (("x", x), ("y", y)):
            decades(axes, which, np.concatenate(list(of.values())))
        return axes


def dose_response(
    doses: ArrayLike,
    power: Mapping[str, ArrayLike],
    ax: Axes | None = None,
    *,
    false_alarms: float | int = 0.05,
    xlabel: str = "dose",
) -> Axes:
    """The power of measures to notice a corrupted Jacobian, against how badly it is corrupted.

    Args:
        doses: (dose,) the mildest first; any unit.
        power: By measure, (dose,) the share of corrupted Jacobians that are noticed; NaN leaves a gap.
        ax: Axes to draw on; None: those of a new figure.
        false_alarms: The share of sound Jacobians that every measure calls corrupted.
        xlabel: What the dose is, with its unit.

    Raises:
        InvalidArray: Shapes that do not fit together, or a power outside 0 to 1.
        InvalidConfig: No measure, or more than can be told apart.
    """
    if not power:
        raise InvalidConfig("power is empty; give at least one measure")
    alarms = number("false_alarms", false_alarms, least=0.0, most=1.0)
    dose = shaped(doses, "doses", None)
    with drawing_on(ax, height=2.4) as axes:
        for index, (name, look) in enumerate(_of_measures(list(power)).items()):
            curve = shaped(power[name], f"power of {name!r}", len(dose))
            if ((curve < 0) | (curve > 1)).any():
                raise InvalidArray(f"power of {name!r} is no probability; give 0 to 1")
            # Markers of curves that coincide, as at power 1, take turns.
            axes.plot(dose, curve, **look, markevery=(index % 2, 2) if len(dose) > 6 else 1, label=drawn(name))
        if (dose > 0).all() and dose.max() > 20 * dose.min():
            decades(axes, "x", dose)
        if dose[-1] < dose[0]:
            axes.invert_xaxis()
        axes.axhline(alarms, **DASHED)
        axes.plot([], [], **DASHED, label=f"false alarms, {alarms:g}")
        axes.set(ylim=(-0.03, 1.05), xlabel=xlabel, ylabel="power")
        axes.margins(x=0.04)
        return axes


def _quartiles(
    place: Float[np.ndarray, "posture"], values: Float[np.ndarray, "seed posture"], bin_of: np.ndarray, bins: int
) -> Iterator[list[float]]:
    """Of each bin that has any: the middle of its postures, then median and quartiles of their errors."""
    for one in range(bins):
        inside = values[:, bin_of == one]
        if np.isfinite(inside).any():
            yield [float(np.median(place[bin_of == one])), *np.nanquantile(inside, [0.5, 0.25, 0.75]).tolist()]


def _of_measures(names: list[str]) -> dict[str, Look]:
    """As ``looks``, with more that are free where no estimator is drawn."""
    first = names[: max(0, len(names) - 6)]
    if len(first) > len(_MORE):
        raise InvalidConfig(f"{len(names)} measures; a figure can tell only {len(_MORE) + 6} apart")
    return dict(zip(first, _MORE, strict=False)) | looks(names[len(first) :])


def _positive(values: Float[np.ndarray, "cells"]) -> Float[np.ndarray, "cells"]:
    return np.where(values > 0, values, np.nan)
