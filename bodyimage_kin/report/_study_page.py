"""A study as one page: who errs least, why each learned Jacobian is wrong, and what that does to the maps."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bodyimage_kin import figures
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.report import _study_maps
from bodyimage_kin.report._page import Picture, csv_of, inlined, labels_of, write_page
from bodyimage_kin.report._results import HEADLINE, errs, learned, names_of, place_of, probe_of_use, ranking
from bodyimage_kin.report._study_tables import comparison_with, judged_by_hidden, tables
from bodyimage_kin.study import summary
from bodyimage_kin.study.scores import PARTS
from bodyimage_kin.study.statistics import PUBLISHED

_TOGETHER = 6
"""Estimators that one panel can tell apart."""
_ATLAS = {
    "relative_error_by_posture": ("relative error", None),
    "scale_by_posture": ("scale", None),
    "variation_by_posture": ("variation", None),
    "critical_gain_by_posture": ("critical gain", (0.0, 2.0)),
    "basin_by_posture": ("basin [mm]", (0.0, 50.0)),
}
"""Scores that are drawn over the face, what their panels are called, and the limits of their colours."""
_DISTANCES = {
    "hand_distance_by_posture": (100.0, "distance of the hand [cm]"),
    "mahalanobis_distance_by_posture": (1.0, "Mahalanobis distance of the joints"),
}


def write(
    results: xr.Dataset, path: Path, baseline: str | None, atlas: str | None, labels: Mapping[str, str] | None
) -> Path:
    """See :func:`bodyimage_kin.report.write`."""
    if not {"embodiment", "recording", "estimator", "seed"} <= set(results.dims) or "failure" not in results:
        raise InvalidConfig("these are not the results of a study; give what Study.run returned")
    estimators = names_of(results, "estimator")
    for name in (baseline, atlas):
        if name is not None and name not in estimators:
            raise UnknownName("estimator in the results", name, estimators)
    results = _computed(results)
    medians = {score: summary.summarise(results, score) for score in _scores(results)}
    with figures.labelled(labels_of(results, labels)):
        comparison = comparison_with(results, baseline)
        write_page(
            path,
            "study.html",
            sentences=_sentences(results, medians),
            probe=probe_of_use(results),
            held_out=judged_by_hidden(medians),
            tables=tables(results, medians, comparison),
            comparison=comparison,
            failures=summary.failures(results),
            left_out=_left_out(results),
            pictures=_drawn(_pictures(results, medians, atlas)),
            excitation=_excitation(results),
            maps=_study_maps.section(results),
            recordings=results.sizes["seed"],
            published=PUBLISHED,
            several=results.sizes["embodiment"] > 1,
            config=json.dumps(json.loads(results.attrs.get("config", "{}")), indent=1),
            hashes={name: json.loads(results.attrs.get(name, "{}")) for name in ("urdf_sha256", "embodiment_sha256")},
            versions=json.loads(results.attrs.get("versions", "{}")),
            oracle=float(results["max_oracle_difference"].max()) if "max_oracle_difference" in results else math.nan,
        )
    return path


def _computed(results: xr.Dataset) -> xr.Dataset:
    """Without the scores that were asked for, but of which nothing could be computed."""
    nothing = [name for name, one in results.data_vars.items() if one.dtype.kind == "f" and not one.notnull().any()]
    return results.drop_vars(nothing)


def _scores(results: xr.Dataset) -> list[str]:
    """Names of the scores that tables hold, a user's own too: one number an estimator, or one a probe or image axis."""
    cell = {"embodiment", "recording", "estimator", "seed"}
    return [
        str(name)
        for name, one in results.data_vars.items()
        if cell <= set(one.dims)
        and set(one.dims) - cell in (set(), {"probe"}, {"axis"})
        and one.dtype.kind == "f"
        and name not in _study_maps.OF_MAPS
    ]


def _left_out(results: xr.Dataset) -> list[tuple[str, str, int]]:
    """What could not be computed, why, and for how many estimators and recordings."""
    found = json.loads(results.attrs.get("left_out", "{}"))
    return [(score, why, len(places)) for score, of in found.items() for why, places in of.items()]


def told_apart(results: xr.Dataset, medians: Mapping[str, xr.Dataset]) -> list[str]:
    """As many estimators as a panel can tell apart: those that err least where they are used."""
    names = learned(results)
    if len(names) <= _TOGETHER or HEADLINE not in medians:
        return names[:_TOGETHER]
    found = medians[HEADLINE]["median"].sel(estimator=names, probe=probe_of_use(results))
    found = found.mean(("embodiment", "recording"))
    return [names[index] for index in np.argsort(found.fillna(np.inf).values)[:_TOGETHER]]


def _sentences(results: xr.Dataset, medians: Mapping[str, xr.Dataset]) -> list[str]:
    """What was done, and what came out, every number from the results."""
    sizes = results.sizes
    said = [
        f"{_many(sizes['estimator'], 'estimator')} watched a hand move and learned from it how joint motion moves the "
        f"hand in the image ({_many(sizes['seed'], 'recording')} of {_many(sizes['recording'], 'motion')}, "
        f"{_many(sizes['embodiment'], 'body', 'bodies')}); "
        + (
            "each is asked for the motion between neighbouring postures of a part that was hidden from it."
            if judged_by_hidden(medians)
            else "each learned Jacobian is held against the true one, also where the hand was never seen."
        )
    ]
    names = learned(results)
    if HEADLINE in medians and names:
        probe = probe_of_use(results)
        found = medians[HEADLINE]["median"].sel(probe=probe, estimator=names).mean(("embodiment", "recording"))
        ranked = found.dropna("estimator").sortby(found)
        if ranked.size:
            best, worst = ((figures.label(str(one["estimator"].item())), 100 * float(one)) for one in ranked[[0, -1]])
            said.append(
                f"{figures.label(probe).capitalize()}, {best[0]} errs least ({best[1]:.0f} %) and {worst[0]} most "
                f"({worst[1]:.0f} %); whoever predicts no motion at all errs by 100 %."
            )
    failed = results["failure"] != ""
    tried = failed
    for score in medians:
        within = [dim for dim in results[score].dims if dim not in failed.dims]
        tried = tried | results[score].notnull().any(within)
    count = int(failed.sum())
    said.append(f"{_many(count, 'fit')} of {int(tried.sum())} failed." if count else "No fit failed.")
    return said


def _excitation(results: xr.Dataset) -> list[tuple[str, list[float]]]:
    """Mean eigenvalues of each embodiment and recording."""
    if "excitation" not in results:
        return []
    mean = results["excitation"].mean("seed")
    return [
        (place_of(results, embodiment, recording), mean.sel(embodiment=embodiment, recording=recording).values.tolist())
        for embodiment in names_of(results, "embodiment")
        for recording in names_of(results, "recording")
    ]


def _drawn(pictures: Sequence[Picture]) -> list[dict[str, Any]]:
    found = []
    for index, picture in enumerate(pictures):
        with figures.style():
            figure = picture.draw()
        found.append(inlined(picture, figures.svg(figure), csv_of(figure), index))
    return found


def _pictures(results: xr.Dataset, medians: Mapping[str, xr.Dataset], atlas: str | None) -> list[Picture]:
    """Every figure, in the order of the page."""
    found: list[Picture] = []
    named = told_apart(results, medians)
    for embodiment in names_of(results, "embodiment"):
        if HEADLINE in medians:
            found.append(_ranking(results, medians[HEADLINE], embodiment, bool(found)))
        for recording in names_of(results, "recording"):
            one = results.sel(embodiment=embodiment, recording=recording)
            place = place_of(results, embodiment, recording)
            found += _attribution(one, place)
            found += _distances(one, place, named)
            found += _face(one, place, results, embodiment, atlas)
    return [*found, *_study_maps.pictures(results, named)]


def _ranking(results: xr.Dataset, medians: xr.Dataset, embodiment: str, later: bool) -> Picture:
    text = (
        "Who errs least is on top. Marks: medians over recordings, with 95 % intervals; a Jacobian of zeros has error "
        "1, and the farther right the last mark from the first, the less an estimator holds where the hand was not "
        "seen."
    )
    title = "How wrong each learned Jacobian is"
    title += f": {figures.label(embodiment)}" if results.sizes["embodiment"] > 1 else ""
    one = medians.sel(embodiment=[embodiment])
    return Picture(
        f"errors_{embodiment}", "scores" if later else "first", partial(ranking, results, one, 2), title, text
    )


def _attribution(one: xr.Dataset, place: str) -> list[Picture]:
    if "attribution" not in one:
        return []
    mean = one["attribution"].mean("seed").transpose("probe", "estimator", "part")
    names = [name for name in names_of(mean, "estimator") if errs(one["attribution"], name)]
    parts = [name for name in PARTS if name in names_of(mean, "part")]
    bars = {
        probe: {
            name: {part: float(mean.sel(probe=probe, estimator=name, part=part)) for part in parts} for name in names
        }
        for probe in names_of(mean, "probe")
    }
    bars = {
        probe: {name: bar for name, bar in of.items() if np.isfinite([*bar.values()]).all()}
        for probe, of in bars.items()
    }
    bars = {probe: of for probe, of in bars.items() if of}
    if not bars:
        return []

    def draw() -> Figure:
        figure, grid = figures.panels(1, len(bars), height=0.9 + 0.24 * max(map(len, bars.values())))
        for axes, (probe, of) in zip(grid[0], bars.items(), strict=True):
            figures.attribution(of, axes)
            axes.set_title(figures.drawn(probe))
            if axes is not grid[0, 0] and list(of) == list(next(iter(bars.values()))):
                axes.set_yticklabels([])
        figures.legend(figure)
        return figure

    text = (
        "Mean over recordings of the squared relative error in the motion's metric, as a sum of parts; every panel has "
        "a scale of its own, and bars far beyond the others are cut."
    )
    return [Picture(f"attribution_{place}", "attribution", draw, f"Parts of the error: {place}", text)]


def _distances(one: xr.Dataset, place: str, named: Sequence[str]) -> list[Picture]:
    score = "relative_error_by_posture"
    if score not in one:
        return []
    names = [name for name in names_of(one, "estimator") if errs(one[score], name)]

    def draw(probes: Sequence[str]) -> Figure:
        shared: dict[str, Any] = {"sharex": "row", "sharey": True}
        figure, grid = figures.panels(len(_DISTANCES), len(probes), height=0.5 + 2.2 * len(_DISTANCES), **shared)
        for row, (distance, (factor, axis)) in zip(grid, _DISTANCES.items(), strict=True):
            for axes, probe in zip(row, probes, strict=True):
                away = one[distance].sel(probe=probe).transpose("seed", "posture").values * factor
                there = np.isfinite(away)
                at = one[score].sel(probe=probe).transpose("estimator", "seed", "posture")
                errors = {name: at.sel(estimator=name).values[there] for name in names}
                figures.error_by_distance(away[there], errors, axes, xlabel=axis, named=named)
                axes.set(title=figures.drawn(probe), ylabel=axes.get_ylabel() if axes is row[0] else "")
        figures.legend(figure)
        return figure

    text = (
        "Relative error at each posture, in the motion's metric, over its distance from training; dots are postures, "
        "marks medians of a fifth of them, bars their quartiles."
    )
    text += f" Grey: medians of all but the {len(named)} that err least." if len(names) > len(named) else ""
    return [
        Picture(
            f"distance_{place}_{index}", "distance", partial(draw, probes), f"Error against distance: {place}", text
        )
        for index, probes in enumerate(_near_and_far(one))
    ]


def _near_and_far(one: xr.Dataset) -> list[list[str]]:
    """Probes that share a scale: those of training and face, and those of the whole joint space."""
    kinds = json.loads(one.attrs.get("config", "{}")).get("probes", {})
    away = one["hand_distance_by_posture"]
    names = [probe for probe in names_of(one, "probe") if bool(away.sel(probe=probe).notnull().any())]
    far = [name for name in names if "JointSpace" in kinds.get(name, {})]
    return [group for group in ([name for name in names if name not in far], far) if group]


def _face(one: xr.Dataset, place: str, results: xr.Dataset, embodiment: str, chosen: str | None) -> list[Picture]:
    """The face, for the chosen estimator or the one that errs least on it."""
    if "on_face" not in names_of(one, "probe") or not any(score in one for score in _ATLAS):
        return []
    face = one.sel(probe="on_face")
    errors = next((score for score in ("relative_error_by_posture", HEADLINE) if score in face), None)
    names = [name for name in names_of(one, "estimator") if errors and errs(face[errors], name)]
    if chosen is None and names:
        chosen = min(names, key=lambda name: float(face[errors].sel(estimator=name).mean()))
    shape = json.loads(results.attrs.get("skin_shape", "{}")).get(embodiment)
    if chosen is None or not shape:
        return []
    shown = {score: of for score, of in _ATLAS.items() if score in face}

    def draw(score: str, axes: Axes) -> None:
        title, limits = shown[score]
        values = face[score].sel(estimator=chosen).mean("seed").values[: math.prod(shape)].reshape(shape)
        factor = 1000.0 if face[score].attrs.get("units") == "m" else 1.0
        figures.grid(values * factor, axes, label=title, limits=limits)

    draws = [partial(draw, score) for score in shown]
    height = 0.7 + figures.DOUBLE_COLUMN / len(shown)
    text = (
        f"{figures.label(chosen)}, mean over recordings; the face as the eye sees it. Scale and variation are what "
        "each taxel adds to these parts of the squared error (the other two are the same everywhere); a servo with a "
        "gain above the critical one does not converge."
    )
    if "basin_by_posture" in shown:
        text += (
            " Basin: how far away on the screen a servo may start, in any direction, and still arrive; no farther than "
            "50 mm is tried."
        )
    drawn = partial(figures.row, *draws, lettered=False, height=height)
    return [Picture(f"face_{place}", "atlas", drawn, f"The face, taxel by taxel: {place}", text)]


def _many(count: int, noun: str, plural: str | None = None) -> str:
    return f"{count} {noun if count == 1 else plural or noun + 's'}"
