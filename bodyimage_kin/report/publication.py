"""A study as a published comparison: numbers, a table and a figure, small enough to be kept beside its config."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from bodyimage_kin._files import write_text
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.report import error_figures, style
from bodyimage_kin.study import summary
from bodyimage_kin.study.scores import PARTS

_HEADLINE = "relative_error_use"
_OTHERS = ("relative_error", "scale_free_error", "displacement_error", "trajectory_rmse", "fit_seconds")
_EXACT = 1e-6
"""Below this an estimator is the truth itself, and ratios to it mean nothing."""


def write(results: xr.Dataset, folder: Path, baseline: str | None) -> Path:
    """See :func:`bodyimage_kin.report.publish`."""
    if _HEADLINE not in results:
        raise InvalidConfig(f"these results have no '{_HEADLINE}', which a comparison is about; give a study's results")
    names = [str(name) for name in results["estimator"].values]
    if baseline is not None and baseline not in names:
        raise UnknownName("estimator in the results", baseline, names)
    numbers = _numbers(results, baseline or names[0])
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "results.json", json.dumps(numbers, indent=1, allow_nan=False) + "\n")
    write_text(folder / "table.md", _table(numbers))
    style.save(error_figures.by_probe(numbers["scores"], numbers["probes"]), folder, "errors")
    return folder / "table.md"


def _numbers(results: xr.Dataset, baseline: str) -> dict[str, Any]:
    """Everything that table and figure say, ready for JSON: numbers to four digits, none as None."""
    found: dict[str, Any] = {
        "baseline": baseline,
        "seeds": results.sizes["seed"],
        "probes": [str(probe) for probe in results["probe"].values],
        "versions": json.loads(results.attrs.get("versions", "{}")),
        "urdf_sha256": json.loads(results.attrs.get("urdf_sha256", "{}")),
        "failures": summary.failures(results),
        "scores": {},
    }
    scores = [score for score in (_HEADLINE, *_OTHERS) if score in results]
    means = {score: summary.summarise(results, score) for score in scores}
    ratios = _ratios(results, baseline)
    parts = results["attribution"].mean("seed") if "attribution" in results else None
    for embodiment in results["embodiment"].values:
        for recording in results["recording"].values:
            rows = {}
            for estimator in results["estimator"].values:
                at = {"embodiment": embodiment, "recording": recording, "estimator": estimator}
                row: dict[str, Any] = {score: _mean(mean.sel(at)) for score, mean in means.items()}
                if parts is not None:
                    there = parts.sel(at)
                    row["attribution"] = {
                        str(probe): {part: _digits(there.sel(probe=probe, part=part)) for part in PARTS}
                        for probe in there["probe"].values
                    }
                if ratios is not None and str(estimator) in ratios["estimator"].values:
                    ratio = ratios.sel(recording=recording, estimator=estimator)
                    row["ratio"] = {
                        str(probe): {key: _digits(ratio[key].sel(probe=probe)) for key in ratio.data_vars}
                        for probe in ratio["probe"].values
                    }
                rows[str(estimator)] = row
            found["scores"][_place(results, str(embodiment), str(recording))] = rows
    return found


def _place(results: xr.Dataset, embodiment: str, recording: str) -> str:
    return recording if results.sizes["embodiment"] == 1 else f"{embodiment}, {recording}"


def _ratios(results: xr.Dataset, baseline: str) -> xr.Dataset | None:
    """Each estimator over the baseline, of those that are not the truth itself."""
    names = [
        str(name)
        for name in results["estimator"].values
        if not bool((results[_HEADLINE].sel(estimator=name) < _EXACT).any())
    ]
    if baseline not in names or len(names) < 2:
        return None
    return summary.compare(results.sel(estimator=names), _HEADLINE, baseline)


def _mean(one: xr.Dataset) -> Any:
    """Mean and interval; by probe, where there are probes."""
    if "probe" in one.dims:
        return {str(probe): _mean(one.sel(probe=probe)) for probe in one["probe"].values}
    return {name: _digits(one[name]) for name in ("mean", "lower", "upper", "recordings")}


def _digits(value: Any) -> float | None:
    number = float(value)
    return float(f"{number:.4g}") if math.isfinite(number) else None


def _table(numbers: Mapping[str, Any]) -> str:
    """One table a recording, the smallest error on the face first."""
    probes = numbers["probes"]
    last = "on_face" if "on_face" in probes else probes[-1]
    lines = [
        f"Relative error of the Jacobian in the motion's metric, mean over {numbers['seeds']} recordings with its 95 % "
        f"interval (BCa bootstrap) {style.label(last)}. *ratio*: geometric mean over that of "
        f"{style.label(numbers['baseline'])}, paired by recording; p by flipped signs, after Holm. *depth*, "
        "*variation*: these parts of the squared error. *fit*: seconds a recording.",
    ]
    for place, rows in numbers["scores"].items():
        head = [
            "estimator",
            *(style.label(probe) for probe in probes),
            "ratio",
            "p",
            "depth",
            "variation",
            "tour",
            "fit",
        ]
        lines += ["", f"### {style.label(place)}", "", _line(head), _line(["---"] + ["---:"] * (len(head) - 1))]
        for name, row in sorted(rows.items(), key=lambda item: _sortable(item[1][_HEADLINE][last]["mean"])):
            lines.append(_line([style.label(name), *_cells(row, probes, last)]))
    lines += ["", "*tour*: relative error of displacements on the tour of the face."]
    said = ", ".join(f"{name} {version}" for name, version in numbers["versions"].items())
    return "\n".join([*lines, "", f"Versions: {said}.", ""])


def _cells(row: Mapping[str, Any], probes: list[str], last: str) -> list[str]:
    errors = row[_HEADLINE]
    ratio = row.get("ratio", {}).get(last)
    parts = row.get("attribution", {}).get(last, {})
    return [
        *(_number(errors[probe]["mean"]) + (_interval(errors[probe]) if probe == last else "") for probe in probes),
        _number(ratio["ratio"]) + _interval(ratio) if ratio else "",
        ("< .001" if ratio["p_holm"] < 1e-3 else _number(ratio["p_holm"]))
        if ratio and ratio["p_holm"] is not None
        else "",
        _number(parts.get("depth")),
        _number(parts.get("variation")),
        _number(row.get("displacement_error", {}).get("mean")),
        _number(row.get("fit_seconds", {}).get("mean")),
    ]


def _sortable(value: float | None) -> float:
    return np.inf if value is None else value


def _number(value: float | None) -> str:
    if value is None:
        return "–"  # noqa: RUF001
    return f"{value:.3f}" if 5e-4 <= abs(value) < 100 or value == 0 else f"{value:.1e}"


def _interval(one: Mapping[str, Any]) -> str:
    lower, upper = one["lower"], one["upper"]
    return "" if lower is None or upper is None else f" [{_number(lower)}, {_number(upper)}]"


def _line(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"
