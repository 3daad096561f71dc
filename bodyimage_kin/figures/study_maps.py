"""What a study's page says of maps: an error of the Jacobian becomes one of the touched path, and then of the maps."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from bodyimage_kin.figures import score_figures, style
from bodyimage_kin.study import summary
from bodyimage_kin.study.scores import SCORES

JACOBIAN, PATH, MAP = "relative_error_use", "touch_trajectory_rmse", "map_error"
_OF_MAPS = (
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
_AXES = {
    JACOBIAN: "relative error of the Jacobian, {probe}",
    PATH: "error of the touched path [mm]",
    MAP: "error of the map, kernel's share out",
}
_DIRECT = {
    "map_error_to_truth": "direct_map_error_to_truth",
    "map_span": "direct_map_span",
    "map_topological_error": "direct_map_topological_error",
}
_TOGETHER = 6
"""Estimators that one figure can tell apart."""
_LEAST = 1e-3
"""Least Jacobian error that is drawn: where an estimator is next to exact, it matters only that it is."""


def section(results: xr.Dataset) -> dict[str, Any] | None:
    """All that the page's section on maps shows; None without scores of maps.

    Args:
        results: Of a study. The truth itself is left out of correlations and figures.
    """
    if MAP not in results and PATH not in results:
        return None
    probes = [str(name) for name in results["probe"].values] if "probe" in results.dims else []
    probe = "on_face" if "on_face" in probes or not probes else probes[-1]
    left_out = summary.exact(results, JACOBIAN) if JACOBIAN in results else []
    links = []
    for source, target in _LINKS:
        if source in results and target in results and len(left_out) < results.sizes["estimator"]:
            found = summary.chain(results, source, target, probe=probe, leave_out=left_out)
            for embodiment in found["embodiment"].values:
                one = {name: float(value) for name, value in found.sel(embodiment=embodiment).data_vars.items()}
                links.append(one | {"from": source, "to": target, "embodiment": str(embodiment)})
    return {
        "links": links,
        "several": results.sizes["embodiment"] > 1,
        "tables": _tables(results),
        "left_out": [style.label(name) for name in left_out],
        "probe": probe,
        "flattery": _flattery(results),
        "scores": SCORES,
        "first_maps": _first_maps(results),
    }


def pictures(results: xr.Dataset) -> list[tuple[str, str, Figure]]:
    """Title, text and figure of each scatter of the chain."""
    if not {JACOBIAN, PATH, MAP} <= set(results.data_vars):
        return []
    probes = [str(name) for name in results["probe"].values]
    probe = "on_face" if "on_face" in probes else probes[-1]
    left_out = summary.exact(results, JACOBIAN) if JACOBIAN in results else []
    names = [str(name) for name in results["estimator"].values if str(name) not in left_out]
    found = []
    for embodiment in results["embodiment"].values:
        one = results.sel(embodiment=embodiment)
        steps = {
            _AXES[JACOBIAN].format(probe=style.label(probe)): one[JACOBIAN].sel(probe=probe).clip(min=_LEAST),
            _AXES[PATH]: one[PATH] * 1000.0,
            _AXES[MAP]: one[MAP],
        }
        cells = {
            axis: {name: values.sel(estimator=name).values.ravel() for name in names} for axis, values in steps.items()
        }
        there = [name for name in names if all(np.isfinite(of[name]).any() for of in cells.values())]
        for first in range(0, len(there), _TOGETHER):
            text = (
                "A point for each estimator, motion and recording; both axes are logarithmic. Jacobian errors below "
                f"{_LEAST:g} are drawn there."
            )
            if len(there) > _TOGETHER:
                text += " Grey: the other estimators."
            cells_there = {axis: {name: of[name] for name in there} for axis, of in cells.items()}
            figure = score_figures.score_chain(cells_there, named=there[first : first + _TOGETHER])
            found.append((f"{embodiment}: from the Jacobian to the map", text, figure))
    return found


def _tables(results: xr.Dataset) -> list[dict[str, Any]]:
    """For each embodiment and recording: means of the scores of maps, and those of direct sight."""
    means = {score: summary.summarise(results, score) for score in _OF_MAPS if score in results}
    found = []
    for embodiment in results["embodiment"].values:
        for recording in results["recording"].values:
            at = {"embodiment": embodiment, "recording": recording}
            rows = [
                (str(name), [_triples(one.sel(at).sel(estimator=name)) for one in means.values()])
                for name in results["estimator"].values
            ]
            direct = [_direct(results, score, at) for score in means]
            if any(direct):
                rows.append(("direct", direct))
            found.append({**{key: str(value) for key, value in at.items()}, "columns": list(means), "rows": rows})
    return found


def _triples(one: xr.Dataset) -> list[tuple[float, float, float]]:
    stacked = np.stack([np.atleast_1d(one[part].values) for part in ("mean", "lower", "upper")], axis=-1)
    return [(float(a), float(b), float(c)) for a, b, c in stacked]


def _direct(results: xr.Dataset, score: str, at: dict[str, Any]) -> list[tuple[float, float, float]]:
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


def _first_maps(results: xr.Dataset) -> int:
    asked = json.loads(results.attrs.get("config", "{}")).get("first_maps", 1)
    return max(asked.values(), default=1) if isinstance(asked, dict) else int(asked)
