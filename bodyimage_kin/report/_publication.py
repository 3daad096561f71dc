"""A study as a published comparison: numbers, a table and a figure, small enough to be kept beside its config."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from bodyimage_kin import figures
from bodyimage_kin._files import write_json, write_text
from bodyimage_kin.errors import InvalidConfig, OutputRefused, UnknownName
from bodyimage_kin.report._latex import latex_table
from bodyimage_kin.report._page import labels_of
from bodyimage_kin.report._results import HEADLINE, asked, learned, names_of, probe_of_use, ranking
from bodyimage_kin.study import summary
from bodyimage_kin.study.results import MISSING
from bodyimage_kin.study.scores import PARTS
from bodyimage_kin.study.statistics import PUBLISHED
from bodyimage_kin.study.summary import markdown_table, plain_markdown, plain_numbers

_OTHERS = (
    "relative_error", "scale_free_error", "displacement_error", "trajectory_rmse", "touch_trajectory_rmse", "map_error",
    "map_topological_error", "fit_seconds",
)  # fmt: skip
_COLUMNS = {
    "displacement_error": ("tour", 1.0, "relative error of displacements on the tour of the face"),
    "touch_trajectory_rmse": ("path [mm]", 1e3, "RMS error of the path integrated while touching"),
    "map_error": ("map", 1.0, "RMS distance from the map of direct sight, over that map's extent"),
    "map_topological_error": ("order", 1.0, "taxels out of order, of 440"),
    "fit_seconds": ("fit [s]", 1.0, "time to fit a recording"),
}
"""Score -> head of its column, factor, and what it is."""


def write(results: xr.Dataset, folder: Path, baseline: str | None, labels: Mapping[str, str] | None) -> Path:
    """See :func:`bodyimage_kin.report.publish`."""
    if HEADLINE not in results:
        raise InvalidConfig(f"these results have no '{HEADLINE}', which a comparison is about; give a study's results")
    names = names_of(results, "estimator")
    if baseline is not None and baseline not in names:
        raise UnknownName("estimator in the results", baseline, names)
    if missing := int((results["failure"] == MISSING).sum()):
        raise InvalidConfig(
            f"{missing} of {results['failure'].size} fits are {MISSING}; run the study to its end first"
        )
    medians = {score: summary.summarise(results, score) for score in (HEADLINE, *_OTHERS) if score in results}
    with figures.labelled(labels_of(results, labels)):
        numbers = _numbers(results, medians, baseline or next(iter(learned(results)), names[0]))
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            raise OutputRefused(f"cannot write to '{folder}': {problem.strerror}; name another folder") from None
        write_json(folder / "results.json", numbers)
        write_text(folder / "table.md", _table(numbers))
        write_text(folder / "table.tex", _latex(numbers))
        with figures.style():
            figures.save(ranking(results, medians[HEADLINE], columns=3), folder, "errors")
    return folder / "table.md"


def _numbers(results: xr.Dataset, medians: Mapping[str, xr.Dataset], baseline: str) -> dict[str, Any]:
    """Everything that table and figure say, ready for JSON: numbers to four digits, none as None."""
    probes, last = names_of(results, "probe"), probe_of_use(results)
    found: dict[str, Any] = {
        "baseline": baseline,
        "seeds": results.sizes["seed"],
        "probes": probes,
        "compared_at": last,
        "versions": json.loads(results.attrs.get("versions", "{}")),
        "urdf_sha256": json.loads(results.attrs.get("urdf_sha256", "{}")),
        "failures": summary.failures(results),
        "scores": {},
    }
    parts = results["attribution"].median("seed") if "attribution" in results else None
    for embodiment in results["embodiment"].values:
        ratios = _ratios(results.sel(embodiment=[embodiment], probe=last), baseline)
        for recording in results["recording"].values:
            rows = {}
            for estimator in results["estimator"].values:
                at = {"embodiment": embodiment, "recording": recording, "estimator": estimator}
                if not asked(results.sel(at), medians):
                    continue
                row: dict[str, Any] = {score: _spread(one.sel(at)) for score, one in medians.items()}
                if parts is not None:
                    there = parts.sel(at)
                    row["attribution"] = {
                        str(probe): {part: plain_numbers(float(there.sel(probe=probe, part=part)), 4) for part in PARTS}
                        for probe in there["probe"].values
                    }
                if ratios is not None and str(estimator) in ratios["estimator"].values:
                    ratio = ratios.sel(recording=recording, estimator=estimator)
                    row["ratio"] = {str(key): plain_numbers(float(ratio[key]), 4) for key in ratio.data_vars}
                    found["family"] = ratios.attrs["family"]
                rows[str(estimator)] = row
            found["scores"][_place(results, str(embodiment), str(recording))] = rows
    return found


def _place(results: xr.Dataset, embodiment: str, recording: str) -> str:
    return recording if results.sizes["embodiment"] == 1 else f"{embodiment}, {recording}"


def _ratios(results: xr.Dataset, baseline: str) -> xr.Dataset | None:
    """Each estimator over the baseline, of those that are not the truth itself."""
    names = learned(results)
    if baseline not in names or len(names) < 2:
        return None
    return summary.compare(results.sel(estimator=names), HEADLINE, baseline)


def _spread(one: xr.Dataset) -> Any:
    """Median, interval and quantiles; by probe, where there are probes."""
    if "probe" in one.dims:
        return {str(probe): _spread(one.sel(probe=probe)) for probe in one["probe"].values}
    return {str(name): plain_numbers(float(value), 4) for name, value in one.data_vars.items()}


def _table(numbers: Mapping[str, Any]) -> str:
    """One table a recording, the smallest error on the face first."""
    lines = [
        f"{_caption(numbers)} *ratio*: geometric mean over that of {figures.label(numbers['baseline'])}, paired by "
        f"recording; p by flipped signs, adjusted (Holm){_family(numbers)}. *scale*, *variation*: these "
        f"parts of the squared error {figures.label(numbers['compared_at'])}. (k of n): recordings that did not fail.",
    ]
    columns = _columns(numbers)
    for place in numbers["scores"]:
        table = markdown_table(_head(numbers), _rows(numbers, place))
        lines += ["", f"### {plain_markdown(figures.label(place))}", "", table]
    lines += ["", "; ".join(f"*{_COLUMNS[score][0]}*: {_COLUMNS[score][2]}" for score in columns) + "."]
    said = ", ".join(f"{name} {version}" for name, version in numbers["versions"].items())
    return "\n".join([*lines, "", f"Versions: {said}.", ""])


def _family(numbers: Mapping[str, Any]) -> str:
    """Over what p-values are adjusted."""
    of_each = " of each embodiment" if len(numbers["urdf_sha256"]) > 1 else ""
    return f" over {numbers['family']} {figures.label(numbers['compared_at'])}{of_each}" if "family" in numbers else ""


def _latex(numbers: Mapping[str, Any]) -> str:
    """The same tables for a paper."""
    head, caption = _head(numbers), _caption(numbers)
    tables = [
        latex_table(f"{figures.label(place)}. {caption}", head, _rows(numbers, place), f"tab:{place}")
        for place in numbers["scores"]
    ]
    return "\n\n".join(["% Needs \\usepackage{booktabs}.", *tables]) + "\n"


def _caption(numbers: Mapping[str, Any]) -> str:
    return (
        f"Relative error of the Jacobian in the motion's metric: median over {numbers['seeds']} recordings, "
        f"{figures.label(numbers['compared_at'])} with its 95 % interval (between two of the values; none of fewer "
        f"than {PUBLISHED}), the tenth and ninetieth percentile, and the share of recordings above 1, the error of a "
        "Jacobian of zeros."
    )


def _columns(numbers: Mapping[str, Any]) -> list[str]:
    rows = [row for rows in numbers["scores"].values() for row in rows.values()]
    return [score for score in _COLUMNS if any(score in row for row in rows)]


def _head(numbers: Mapping[str, Any]) -> list[str]:
    names = [figures.label(probe) for probe in numbers["probes"]]
    others = [_COLUMNS[score][0] for score in _columns(numbers)]
    return ["estimator", *names, "10 % to 90 %", "above 1", "ratio", "p", "scale", "variation", *others]


def _rows(numbers: Mapping[str, Any], place: str) -> list[list[str]]:
    """A row an estimator, the smallest error where they are compared first."""
    probes, last, columns = numbers["probes"], numbers["compared_at"], _columns(numbers)
    found = []
    of = numbers["scores"][place]
    for name, row in sorted(of.items(), key=lambda item: _sortable(item[1][HEADLINE][last]["median"])):
        done = row[HEADLINE][last]["recordings"]
        some = f" ({done:.0f} of {numbers['seeds']})" if done < numbers["seeds"] else ""
        found.append([figures.label(name) + some, *_cells(row, probes, last, columns)])
    return found


def _cells(row: Mapping[str, Any], probes: list[str], last: str, columns: list[str]) -> list[str]:
    errors = row[HEADLINE]
    ratio = row.get("ratio")
    parts = row.get("attribution", {}).get(last, {})
    return [
        *(_number(errors[probe]["median"]) + (_interval(errors[probe]) if probe == last else "") for probe in probes),
        f"{_number(errors[last]['low'])} to {_number(errors[last]['high'])}",
        _share(errors[last]["above_one"]),
        _number(ratio["ratio"]) + _interval(ratio) if ratio else "",
        _p(ratio["p_holm"]) if ratio else "",
        _number(parts.get("scale")),
        _number(parts.get("variation")),
        *(_number(row.get(score, {}).get("median"), _COLUMNS[score][1]) for score in columns),
    ]


def _share(value: float | None) -> str:
    return _number(None) if value is None else f"{100 * value:.0f} %"


def _p(value: float | None) -> str:
    return "< .001" if value is not None and value < 1e-3 else _number(value)


def _sortable(value: float | None) -> float:
    return np.inf if value is None else value


def _number(value: float | None, factor: float = 1.0) -> str:
    if value is None:
        return "–"  # noqa: RUF001
    value *= factor
    return f"{value:.3f}" if 5e-4 <= abs(value) < 100 or value == 0 else f"{value:.1e}"


def _interval(one: Mapping[str, Any]) -> str:
    lower, upper = one["lower"], one["upper"]
    few = (one["recordings"] or 0) < PUBLISHED
    return "" if lower is None or upper is None or few else f" [{_number(lower)}, {_number(upper)}]"
