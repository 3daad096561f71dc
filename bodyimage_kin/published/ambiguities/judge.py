"""What each reading is worth: values of every recording, their means and differences, and tables of them."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float

from bodyimage_kin._files import write_text
from bodyimage_kin.published.ambiguities.readings import AMBIGUITIES, Place
from bodyimage_kin.study import WrongResult, markdown_table, plain_numbers
from bodyimage_kin.study.statistics import PUBLISHED, holm, interval, sign_flip
from bodyimage_kin.study.summary import refuse_failed

__all__ = ["DRAWN", "MEASURES", "Measure", "judge", "markdown", "summarise", "write_summary"]


@dataclass(frozen=True)
class Measure:
    """A score, as tables show it.

    Attributes:
        title: What they call it.
        digits: After the point.
        score: Its name in the study's results.
        scale: Factor of it.
    """

    title: str
    digits: int
    score: str
    scale: float = 1.0


MEASURES: Mapping[str, Measure] = {
    "displacement": Measure("displacement error", 3, "touch_displacement_error"),
    "face": Measure("Jacobian error on the face", 3, "relative_error_use"),
    "tour": Measure("tour RMSE [mm]", 1, "trajectory_rmse", 1e3),
    "touch": Measure("hand RMSE [mm]", 1, "touch_trajectory_rmse", 1e3),
    "span": Measure("map span", 3, "map_span"),
    "disparity": Measure("map disparity", 3, "map_disparity"),
    "topological": Measure("topological error", 1, "map_topological_error"),
    "posture_span": Measure("posture map span", 3, "posture_span"),
    "excitation": Measure("least / largest joint motion", 2, "least_joint_motion"),
}
DRAWN = ("displacement", "touch", "span", "topological")
"""Measures along the chain from Jacobian to map; the first only where readings differ in the Jacobian."""
_DIVERGED = 1e4
"""A score beyond is of a network that diverged, as is one that is not finite."""
_STAR = 0.05


def judge(results: xr.Dataset, ambiguities: Sequence[str] = tuple(AMBIGUITIES)) -> dict[str, Any]:
    """The run in numbers.

    Args:
        results: Of the study that :func:`bodyimage_kin.published.ambiguities.grid` gives.
        ambiguities: Of the study.

    Returns:
        Plain numbers, lists and tables: ``seeds``, ``duration`` of touching [s], ``versions``, ``urdf_sha256`` of the
        infant, ``measures`` of each table, ``summary`` (:func:`summarise`), and ``values``: ambiguity -> reading ->
        motion -> measure -> one value a seed, None where it diverged.

    Raises:
        InvalidConfig: A cell failed for another reason than that its network diverged; says which, and why.
    """
    refuse_failed(results, but=WrongResult.__name__)
    measures = {name: list(AMBIGUITIES[name].measures) for name in ambiguities}
    values = {
        name: {
            reading.name: {
                motion: {measure: _values(results, reading.place(motion), measure) for measure in _kept(measures[name])}
                for motion in AMBIGUITIES[name].motions
            }
            for reading in AMBIGUITIES[name].readings
        }
        for name in ambiguities
    }
    config = json.loads(results.attrs["config"])
    touching = next(iter(config["recordings"].values()))["use"]["RandomTouch"]
    return {
        "seeds": int(results.sizes["seed"]),
        "duration": touching["duration"],
        "versions": json.loads(results.attrs["versions"]),
        "urdf_sha256": next(iter(json.loads(results.attrs["urdf_sha256"]).values())),
        "measures": measures,
        "summary": summarise(values, measures),
        "values": values,
    }


def summarise(values: Mapping[str, Any], measures: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """What can be said over recordings, nested as the values.

    Args:
        values: Of :func:`judge`.
        measures: Likewise.

    Returns:
        Each measure's mean with its 95 % BCa interval, the number of recordings in which it diverged, and for what the
        table shows, p of no paired difference from the first reading, adjusted over the table.
    """
    return {ambiguity: _summary(readings, measures[ambiguity]) for ambiguity, readings in values.items()}


def markdown(found: Mapping[str, Any]) -> str:
    """A page: one table an ambiguity, between markers by which documentation includes it.

    Args:
        found: Of :func:`judge`, with the ``command`` that it was made by.
    """
    seeds = found["seeds"]
    publishable = seeds >= PUBLISHED
    legend = (
        r"A star: differs from the first reading (sign flips of paired differences, Holm over the table, 5 %)."
        if publishable
        else f"Fewer than {PUBLISHED} recordings: intervals are for orientation, and no differences are tested."
    )
    lines = [
        "# What each ambiguity of the paper is worth",
        "",
        f"Made by `{found['command']}`; mean and 95 % BCa interval over {seeds} recordings of each motion, "
        f"{found['duration']:g} s of touching.",
        f"Versions: {', '.join(f'{name} {version}' for name, version in found['versions'].items())}.",
        f"The first reading of each table is the library's. {legend}",
        "",
    ]
    for ambiguity, readings in found["summary"].items():
        shown = [MEASURES[name] for name in found["measures"][ambiguity]]
        motions = list(next(iter(readings.values())))
        several = len(motions) > 1
        head = [f"{one.title}{f', {motion}' if several else ''}" for one in shown for motion in motions]
        rows = [
            [
                reading,
                *(
                    _cell(by_motion[motion][name], MEASURES[name].digits, seeds, publishable)
                    for name in found["measures"][ambiguity]
                    for motion in motions
                ),
            ]
            for reading, by_motion in readings.items()
        ]
        lines += [
            f"<!-- begin {ambiguity} -->",
            "",
            markdown_table(["reading", *head], rows),
            "",
            f"<!-- end {ambiguity} -->",
            "",
        ]
    return "\n".join(lines).rstrip() + "\n"


def write_summary(found: Mapping[str, Any], folder: Path) -> None:
    """Writes ``results.json`` and ``table.md``, each atomically; what is judged anew goes by :func:`summarise`."""
    folder.mkdir(parents=True, exist_ok=True)
    # A line for each row of numbers, and for each summary.
    text = re.sub(
        r"\[[^][{}]*\]|\{[^][{}]*\}",
        lambda one: re.sub(r"\s+", " ", one[0]),
        json.dumps(found, indent=1, allow_nan=False, ensure_ascii=False),
    )
    write_text(folder / "results.json", text + "\n")
    write_text(folder / "table.md", markdown(found))


# Inner ---------------------------------------------------------------------------------------------------------------


def _kept(shown: Sequence[str]) -> list[str]:
    """Measures of an ambiguity: what its table shows, and what a figure of all of them draws."""
    drawn = [name for name in DRAWN if name != "displacement" or name in shown]
    return list(dict.fromkeys([*shown, *drawn]))


def _values(results: xr.Dataset, place: Place, measure: str) -> list[float | None]:
    """One a seed; the mean over the axes of the image where there are several."""
    at = {"embodiment": place.embodiment, "recording": place.recording, "estimator": place.name, "probe": "on_face"}
    one = results[MEASURES[measure].score]
    one = one.sel({dim: name for dim, name in at.items() if dim in one.dims}).transpose("seed", ...)
    scores: Float[np.ndarray, "seed"] = one.values.reshape(one.sizes["seed"], -1).mean(axis=1)
    return [_rounded(MEASURES[measure].scale * score) for score in scores]


def _rounded(value: float) -> float | None:
    """Four digits that count."""
    found: float | None = plain_numbers(value, digits=4)
    return found if abs(value) <= _DIVERGED else None


def _summary(readings: Mapping[str, Any], shown: Sequence[str]) -> dict[str, Any]:
    rows = {
        (reading, motion, measure): np.array(found, dtype=float)
        for reading, by_motion in readings.items()
        for motion, by_measure in by_motion.items()
        for measure, found in by_measure.items()
    }
    own = next(iter(readings))
    compared = [row for row in rows if row[0] != own and row[2] in shown]
    flips = [_p(rows[row] - rows[own, *row[1:]]) for row in compared]
    p = dict(zip(compared, holm(flips), strict=True))
    summary: dict[str, Any] = {}
    for row, found in rows.items():
        reading, motion, measure = row
        mean = interval(found)
        one = {"mean": mean.estimate, "lower": mean.lower, "upper": mean.upper, "p_holm": p.get(row, np.nan)}
        place = summary.setdefault(reading, {}).setdefault(motion, {})
        place[measure] = {name: _rounded(value) for name, value in one.items()}
        place[measure]["diverged"] = int(np.isnan(found).sum())
    return summary


def _p(differences: Float[np.ndarray, "seed"]) -> float:
    """Of no difference; NaN where too few recordings have one."""
    finite = differences[np.isfinite(differences)]
    return sign_flip(finite) if len(finite) > 1 else np.nan


def _cell(one: Mapping[str, Any], digits: int, seeds: int, publishable: bool) -> str:
    if one["mean"] is None:
        return "diverges"
    text = f"{one['mean']:.{digits}f}"
    if one["lower"] is not None and one["lower"] < one["upper"]:
        text += f" [{one['lower']:.{digits}f}, {one['upper']:.{digits}f}]"
    if publishable and one["p_holm"] is not None and one["p_holm"] < _STAR:
        text += r" \*"
    return f"{text}, {one['diverged']} of {seeds} diverge" if one["diverged"] else text
