"""What a study's page says of maps: an error of the Jacobian becomes one of the touched path, and then of the maps."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bodyimage_kin import figures
from bodyimage_kin.report._page import Picture
from bodyimage_kin.report._results import (
    HEADLINE,
    Interval,
    intervals_of,
    learned,
    names_of,
    place_of,
    probe_of_use,
    title_of,
)
from bodyimage_kin.study import summary

JACOBIAN, PATH, MAP = HEADLINE, "touch_trajectory_rmse", "map_error"
OF_MAPS = (
    PATH,
    MAP,
    "posture_map_error",
    "map_error_to_truth",
    "map_span",
    "map_disparity",
    "map_folded_cells",
    "map_topological_error",
)
_LINKS = ((JACOBIAN, PATH), (PATH, MAP), (JACOBIAN, MAP), (JACOBIAN, "map_topological_error"))
_DIRECT = {
    "map_error_to_truth": "direct_map_error_to_truth",
    "map_span": "direct_map_span",
    "map_topological_error": "direct_map_topological_error",
}
_LEAST = 1e-3
"""Least Jacobian error that is drawn: where an estimator is next to exact, it matters only that it is."""


def section(results: xr.Dataset) -> dict[str, Any] | None:
    """All that the page's section on maps shows; None without scores of maps.

    Args:
        results: Of a study. The truth itself is left out of correlations and figures.
    """
    if MAP not in results and PATH not in results:
        return None
    names = learned(results)
    left_out = [name for name in names_of(results, "estimator") if name not in names]
    links = []
    for source, target in _LINKS:
        if source in results and target in results and names:
            found = summary.chain(results, source, target, probe=probe_of_use(results), leave_out=left_out)
            for embodiment in found["embodiment"].values:
                one = {name: float(value) for name, value in found.sel(embodiment=embodiment).data_vars.items()}
                links.append(one | {"from": source, "to": target, "embodiment": str(embodiment)})
    return {
        "links": links,
        "tables": _tables(results),
        "left_out": [figures.label(name) for name in left_out],
        "probe": probe_of_use(results),
        "flattery": _flattery(results),
        "titles": {score: title_of(results, score) for score in (*OF_MAPS, JACOBIAN) if score in results},
        "first_maps": _first_maps(results),
    }


def pictures(results: xr.Dataset, named: Sequence[str]) -> list[Picture]:
    """For each embodiment, every link of the chain as a scatter."""
    if not {JACOBIAN, PATH, MAP} <= set(results.data_vars):
        return []
    text = f"A point for each estimator, motion and recording. Jacobian errors below {_LEAST:g} are drawn there."
    if len(named) < len(learned(results)):
        text += f" Grey: all but the {len(named)} that err least."
    return [
        Picture(
            f"chain_{embodiment}",
            "maps",
            partial(_chain, results.sel(embodiment=embodiment), probe_of_use(results), learned(results), named),
            "From the Jacobian to the map"
            + (f": {figures.label(str(embodiment))}" if results.sizes["embodiment"] > 1 else ""),
            text,
        )
        for embodiment in results["embodiment"].values
    ]


def _chain(one: xr.Dataset, probe: str, names: Sequence[str], named: Sequence[str]) -> Figure:
    steps = {
        f"relative error of the Jacobian, {figures.label(probe)}": one[JACOBIAN].sel(probe=probe).clip(min=_LEAST),
        "error of the touched path [mm]": one[PATH] * 1000.0,
        "error of the map, kernel's share out": one[MAP],
    }
    cells = {
        axis: {name: values.sel(estimator=name).values.ravel() for name in names} for axis, values in steps.items()
    }
    there = [name for name in names if all(np.isfinite(of[name]).any() for of in cells.values())]
    return figures.row(*(partial(_link, cells, there, named, link) for link in pairwise(cells)), height=3.1)


def _link(
    cells: Mapping[str, Mapping[str, np.ndarray]],
    names: Sequence[str],
    named: Sequence[str],
    link: tuple[str, str],
    axes: Axes,
) -> None:
    x, y = ({name: cells[axis][name] for name in names} for axis in link)
    figures.score_chain(x, y, axes, named=named, xlabel=link[0], ylabel=link[1])


def _first_maps(results: xr.Dataset) -> int:
    """The most of any seed."""
    asked = json.loads(results.attrs.get("config", "{}")).get("first_maps", 1)
    return max(asked.values(), default=1) if isinstance(asked, dict) else int(asked)


def _tables(results: xr.Dataset) -> list[dict[str, Any]]:
    """For each embodiment and recording: medians of the scores of maps, and those of direct sight."""
    medians = {score: summary.summarise(results, score) for score in OF_MAPS if score in results}
    found = []
    for embodiment in names_of(results, "embodiment"):
        for recording in names_of(results, "recording"):
            at = {"embodiment": embodiment, "recording": recording}
            rows = [
                (name, [intervals_of(one.sel(at).sel(estimator=name)) for one in medians.values()])
                for name in names_of(results, "estimator")
            ]
            direct = [_direct(results, score, at) for score in medians]
            if any(direct):
                rows.append(("direct", direct))
            found.append({"place": place_of(results, embodiment, recording), "columns": list(medians), "rows": rows})
    return found


def _direct(results: xr.Dataset, score: str, at: dict[str, Any]) -> list[Interval]:
    """Mean of direct sight's own score, where it has one."""
    name = _DIRECT.get(score)
    if name not in results:
        return []
    mean = results[name].sel(at).mean("seed").values
    return [(float(value), np.nan, np.nan) for value in np.atleast_1d(mean)]


def _flattery(results: xr.Dataset) -> str:
    """What the topological error can say in these results."""
    if "map_topological_error" not in results:
        return ""
    errors = results["map_topological_error"]
    if not bool(errors.notnull().any()):
        return ""
    most = float(errors.max())
    if most > 0:
        return f"The topological error of the maps goes from {float(errors.min()):.3g} to {most:.3g}."
    return (
        "The topological error is 0 for every map of every estimator here, so it tells none of them apart: it is a "
        "flattering measure, which even a map shrunk to next to nothing passes. Hold the other scores beside it."
    )
