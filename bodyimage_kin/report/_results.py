"""What pages read from a study's results: names, the probe of use, who is the truth itself, medians with intervals."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TypeAlias

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from bodyimage_kin import figures
from bodyimage_kin.study import summary

HEADLINE = "relative_error_use"
"""The score by which estimators are ranked and compared."""
Interval: TypeAlias = tuple[float, float, float]
"""Mean, lower and upper end."""


def names_of(results: xr.Dataset | xr.DataArray, dimension: str) -> list[str]:
    """The names along a dimension; none where it is missing."""
    return [str(name) for name in results[dimension].values] if dimension in results.dims else []


def probe_of_use(results: xr.Dataset) -> str:
    """Where a learned Jacobian is used: on the face, or else at the last probe."""
    probes = names_of(results, "probe")
    return "on_face" if "on_face" in probes or not probes else probes[-1]


def place_of(results: xr.Dataset, embodiment: str, recording: str) -> str:
    """What a reader calls an embodiment's recording, the embodiment only where there are several."""
    said = figures.label(recording)
    return said if results.sizes["embodiment"] == 1 else f"{figures.label(embodiment)}, {said}"


def learned(results: xr.Dataset) -> list[str]:
    """Estimators that are not the truth itself."""
    exact = summary.exact(results, HEADLINE) if HEADLINE in results else []
    return [name for name in names_of(results, "estimator") if name not in exact]


def title_of(results: xr.Dataset, score: str) -> str:
    """What a score is, with its unit."""
    about = results[score].attrs
    unit = about.get("units", "1")
    said = about.get("long_name") or figures.label(score)
    said += f" [{unit}]" if unit not in ("1", "") else ""
    return f"{said} (each axis)" if "axis" in results[score].dims else str(said)


def errs(values: xr.DataArray, name: str) -> bool:
    """Whether an estimator has this score and is not the truth itself."""
    of = values.sel(estimator=name).values
    return bool(np.isfinite(of).any() and np.nanmax(of) > summary.EXACT)


def intervals_of(medians: xr.Dataset) -> list[Interval]:
    """Along the one dimension that is left, or of the one value."""
    stacked = np.stack([np.atleast_1d(medians[part].values) for part in ("median", "lower", "upper")], axis=-1)
    return [(float(a), float(b), float(c)) for a, b, c in stacked]


def asked(row: xr.Dataset, scores: Iterable[str]) -> bool:
    """Whether a row of a study was asked on this recording: it failed somewhere, or has some of these scores."""
    return bool((row["failure"] != "").any()) or any(bool(row[score].notnull().any()) for score in scores)


def ranking(results: xr.Dataset, medians: xr.Dataset, columns: int) -> Figure:
    """Estimators ranked by their error where they are used, a panel for each embodiment and recording of ``medians``.

    Args:
        results: Of a study.
        medians: Of :data:`HEADLINE`, with its intervals; of all embodiments or of some.
        columns: Panels in a row at the most.
    """
    places = [(e, r) for e in names_of(medians, "embodiment") for r in names_of(medians, "recording")]
    panels = []
    for embodiment, recording in places:
        at = {"embodiment": embodiment, "recording": recording}
        there = [
            name for name in names_of(medians, "estimator") if asked(results.sel(at | {"estimator": name}), [HEADLINE])
        ]
        panels.append(medians.sel(at | {"estimator": there}))
    columns = min(columns, len(places))
    rows = math.ceil(len(places) / columns)
    height = 0.5 + rows * (0.6 + 0.16 * max(one.sizes["estimator"] for one in panels))
    figure, grid = figures.panels(rows, columns, height=height, sharex=True)
    xlabel = "relative error of the Jacobian" if columns < 3 else "relative error"
    for axes, (embodiment, recording), one in zip(grid.flat, places, panels, strict=False):
        figures.errors(one, axes, ranked_at=probe_of_use(results), xlabel=xlabel)
        axes.set_title(figures.drawn(place_of(results, embodiment, recording)))
        axes.tick_params(labelbottom=True)
    for axes in grid.flat[len(places) :]:
        axes.remove()
    figures.legend(figure)
    return figure
