"""A study as one page: scores, comparisons, failures, and why each learned Jacobian is wrong."""

from __future__ import annotations

import base64
import json
import math
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from bodyimage_kin._files import write_text
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.figures import figures, score_figures, study_maps, style
from bodyimage_kin.figures.atlas import face_atlas
from bodyimage_kin.study import summary
from bodyimage_kin.study.scores import PARTS, SCORES
from bodyimage_kin.study.statistics import PUBLISHED

_HEADLINE = "relative_error_use"
_COMPARED = "relative_error_use"
_TOGETHER = 6
"""Estimators that one figure can tell apart."""
_MOST = 4.0
"""Squared error up to which parts are drawn: twice the error of a Jacobian of zeros."""
_ON_TOUR = ("displacement_error", "trajectory_rmse", "velocity_correlation", "velocity_nrmse", "fit_seconds")
_ATLAS = {
    "relative_error_by_posture": "relative error",
    "scale_by_posture": "scale",
    "variation_by_posture": "variation",
    "critical_gain_by_posture": "critical gain",
    "basin_by_posture": "basin [mm]",
}
"""Scores that are drawn over the face, and what their panels are called."""
_BY_PROBE = ("relative_error_use", "relative_error", "scale_free_error")


def write(results: xr.Dataset, path: Path, baseline: str | None, atlas: str | None) -> Path:
    """See :func:`bodyimage_kin.report.write`."""
    if not {"embodiment", "recording", "estimator", "seed"} <= set(results.dims) or "failure" not in results:
        raise InvalidConfig("these are not the results of a study; give what Study.run returned")
    estimators = [str(name) for name in results["estimator"].values]
    for name in (baseline, atlas):
        if name is not None and name not in estimators:
            raise UnknownName("estimator in the results", name, estimators)
    means = {score: summary.summarise(results, score) for score in (*_BY_PROBE, *_ON_TOUR) if score in results}
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("bodyimage_kin.report"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    environment.globals.update(label=style.label, number=_number, interval=_interval)
    page = environment.get_template("study.html").render(
        sentences=_sentences(results, means),
        tables=_tables(results, means),
        comparison=_comparison(results, baseline or estimators[0], estimators),
        failures=summary.failures(results),
        pictures=_pictures(results, atlas),
        excitation=_excitation(results),
        maps=study_maps.section(results),
        recordings=results.sizes["seed"],
        published=PUBLISHED,
        config=json.dumps(json.loads(results.attrs.get("config", "{}")), indent=1),
        hashes={name: json.loads(results.attrs.get(name, "{}")) for name in ("urdf_sha256", "embodiment_sha256")},
        versions=json.loads(results.attrs.get("versions", "{}")),
        oracle=float(results["max_oracle_difference"].max()) if "max_oracle_difference" in results else math.nan,
    )
    write_text(path, page)
    return path


def _sentences(results: xr.Dataset, means: Mapping[str, xr.Dataset]) -> list[str]:
    """What was done, and what came out, every number from the results."""
    sizes = results.sizes
    said = [
        f"{_many(sizes['estimator'], 'estimator')} learned from {_many(sizes['seed'], 'recording')} of "
        f"{_many(sizes['recording'], 'motion')} in {_many(sizes['embodiment'], 'embodiment')}, and held against the "
        "analytic Jacobian at postures that leave what was seen step by step."
    ]
    if _HEADLINE in means:
        farthest = str(results["probe"].values[-2 if sizes["probe"] > 1 else -1])
        probe = "on_face" if "on_face" in results["probe"].values else farthest
        found = means[_HEADLINE]["mean"].sel(probe=probe).mean(("embodiment", "recording"))
        learned = found.where(found > summary.EXACT).dropna("estimator")
        if learned.size:
            best, worst = (learned.isel(estimator=int(at(learned.values))) for at in (np.argmin, np.argmax))
            said.append(
                f"{style.label(probe).capitalize()}, {style.label(str(best['estimator'].item()))} errs least "
                f"({100 * float(best):.0f} % in the motion's metric) and "
                f"{style.label(str(worst['estimator'].item()))} most ({100 * float(worst):.0f} %); a Jacobian of "
                "zeros errs by 100 %."
            )
    count = int((results["failure"] != "").sum())
    said.append(f"{_many(count, 'fit')} of {results['failure'].size} failed." if count else "No fit failed.")
    return said


def _tables(results: xr.Dataset, means: Mapping[str, xr.Dataset]) -> list[dict[str, Any]]:
    """For each embodiment and recording: a table by probe for each score, and one of the tour."""
    found = []
    for embodiment in results["embodiment"].values:
        for recording in results["recording"].values:
            at = {"embodiment": embodiment, "recording": recording}
            by_probe = [
                {
                    "title": SCORES[score].long_name,
                    "probes": [str(probe) for probe in results["probe"].values],
                    "rows": _rows(means[score].sel(at)),
                }
                for score in _BY_PROBE
                if score in means
            ]
            on_tour = {score: _rows(means[score].sel(at)) for score in _ON_TOUR if score in means}
            names = [str(name) for name in results["estimator"].values]
            found.append(
                {
                    "embodiment": str(embodiment),
                    "recording": str(recording),
                    "by_probe": by_probe,
                    "tour": {
                        "columns": [(score, SCORES[score]) for score in on_tour],
                        "rows": [
                            (name, [on_tour[score][index][1] for score in on_tour]) for index, name in enumerate(names)
                        ],
                    },
                }
            )
    return found


def _rows(means: xr.Dataset) -> list[tuple[str, list[tuple[float, float, float]]]]:
    """Estimator -> (mean, lower, upper) along a dimension, or alone."""
    rows = []
    for name in means["estimator"].values:
        one = means.sel(estimator=name)
        stacked = np.stack([np.atleast_1d(one[part].values) for part in ("mean", "lower", "upper")], axis=-1)
        rows.append((str(name), [(float(a), float(b), float(c)) for a, b, c in stacked]))
    return rows


def _comparison(results: xr.Dataset, baseline: str, estimators: Sequence[str]) -> dict[str, Any] | None:
    """Every estimator against the baseline, of those that are not the truth itself."""
    if _COMPARED not in results:
        return None
    learned = [name for name in estimators if name not in summary.exact(results, _COMPARED)]
    if baseline not in learned or len(learned) < 2:
        return None
    found = summary.compare(results.sel(estimator=learned), _COMPARED, baseline)
    groups = []
    for recording in found["recording"].values:
        one = found.sel(recording=recording).transpose("estimator", "probe")
        rows = [
            (
                str(name),
                [
                    {key: float(one[key].sel(estimator=name, probe=probe)) for key in one.data_vars}
                    for probe in one["probe"].values
                ],
            )
            for name in one["estimator"].values
        ]
        groups.append({"recording": str(recording), "probes": [str(p) for p in one["probe"].values], "rows": rows})
    return {"baseline": baseline, "groups": groups, "count": found["p"].size}


def _excitation(results: xr.Dataset) -> list[dict[str, Any]]:
    """Mean eigenvalues of each embodiment and recording."""
    if "excitation" not in results:
        return []
    mean = results["excitation"].mean("seed")
    return [
        {
            "embodiment": str(embodiment),
            "recording": str(recording),
            "values": mean.sel(embodiment=embodiment, recording=recording).values.tolist(),
        }
        for embodiment in mean["embodiment"].values
        for recording in mean["recording"].values
    ]


def _pictures(results: xr.Dataset, atlas: str | None) -> list[dict[str, str]]:
    """Every figure, drawn and encoded."""
    found: list[tuple[str, str, str, Figure]] = []
    for embodiment in results["embodiment"].values:
        for recording in results["recording"].values:
            one = results.sel(embodiment=embodiment, recording=recording)
            place = f"{embodiment}, {style.label(str(recording))}"
            found += [("attribution", *picture) for picture in _attributions(one, place)]
            found += [("distance", *picture) for picture in _distances(one, place)]
            found += [("atlas", *picture) for picture in _atlas(one, place, results, str(embodiment), atlas)]
    found += [("maps", *picture) for picture in study_maps.pictures(results)]
    drawn = []
    with tempfile.TemporaryDirectory() as folder:
        for index, (section, title, text, figure) in enumerate(found):
            svg, _ = style.save(figure, folder, f"figure{index}")
            data = base64.b64encode(svg.read_bytes()).decode()
            drawn.append({"section": section, "title": title, "text": text, "data": data})
    return drawn


def _learned(one: xr.Dataset, score: str) -> list[str]:
    """Estimators that have this score and are not the truth itself."""
    names = []
    for name in one["estimator"].values:
        values = one[score].sel(estimator=name).values
        if np.isfinite(values).any() and np.nanmax(values) > summary.EXACT:
            names.append(str(name))
    return names


def _attributions(one: xr.Dataset, place: str) -> list[tuple[str, str, Figure]]:
    if "attribution" not in one:
        return []
    mean = one["attribution"].mean("seed")
    names = _learned(one, "attribution")
    pictures = []
    for probe in mean["probe"].values:
        # A panel of its own scale each: beyond the face some err a thousandfold.
        bars = {
            name: {part: float(mean.sel(probe=probe, estimator=name, part=part)) for part in PARTS} for name in names
        }
        drawn = {name: bar for name, bar in bars.items() if sum(bar.values()) <= _MOST}
        beyond = [style.label(name) for name, bar in bars.items() if sum(bar.values()) > _MOST]
        text = "Mean over recordings of the squared relative error in the motion's metric, as a sum of four parts."
        if beyond:
            text += f" Not drawn, for they err more than {_MOST:g}: {', '.join(beyond)}."
        if drawn:
            figure = score_figures.attribution_bars({str(probe): drawn})
            pictures.append((f"{place}: parts of the error {style.label(str(probe))}", text, figure))
    return pictures


def _distances(one: xr.Dataset, place: str) -> list[tuple[str, str, Figure]]:
    score = "relative_error_by_posture"
    if score not in one:
        return []
    names = _learned(one, score)
    where = {"hand_distance_by_posture": "distance of the hand from where it was in training [cm]"}
    where["mahalanobis_distance_by_posture"] = "Mahalanobis distance from training in its joint space"
    pictures = []
    for probes in _near_and_far(one):
        for first in range(0, len(names), _TOGETHER):
            for distance, axis in where.items():
                away = one[distance].transpose("seed", "probe", "posture") * (100.0 if "hand" in distance else 1.0)
                there = {probe: np.isfinite(away.sel(probe=probe).values) for probe in probes}
                errors = {
                    name: {
                        probe: one[score].sel(estimator=name, probe=probe).transpose("seed", "posture").values[kept]
                        for probe, kept in there.items()
                    }
                    for name in names[first : first + _TOGETHER]
                }
                away_by_probe = {probe: away.sel(probe=probe).values[kept] for probe, kept in there.items()}
                figure = figures.error_by_distance(away_by_probe, errors, distance_label=axis)
                text = "Relative error at each posture, in the motion's metric; all recordings."
                pictures.append((f"{place}: error against distance", text, figure))
    return pictures


def _near_and_far(one: xr.Dataset) -> list[list[str]]:
    """Probes that share a scale: those of training and face, and those of the whole joint space."""
    kinds = json.loads(one.attrs.get("config", "{}")).get("probes", {})
    names = [
        str(probe)
        for probe in one["probe"].values
        if bool(one["hand_distance_by_posture"].sel(probe=probe).notnull().any())
    ]
    far = [name for name in names if "JointSpace" in kinds.get(name, {})]
    return [group for group in ([name for name in names if name not in far], far) if group]


def _atlas(
    one: xr.Dataset, place: str, results: xr.Dataset, embodiment: str, chosen: str | None
) -> list[tuple[str, str, Figure]]:
    """The face, for the chosen estimator or the one that errs least on it."""
    if "on_face" not in one["probe"].values or not any(score in one for score in _ATLAS):
        return []
    face = one.sel(probe="on_face")
    errors = [score for score in ("relative_error_by_posture", _HEADLINE) if score in face]
    names = _learned(face, errors[0]) if errors else []
    if chosen is None and names:
        chosen = min(names, key=lambda name: float(face[errors[0]].sel(estimator=name).mean()))
    shape = json.loads(results.attrs.get("skin_shape", "{}")).get(embodiment)
    if chosen is None or not shape:
        return []
    rows, columns = shape
    maps = {}
    for score, title in _ATLAS.items():
        if score in face:
            values = face[score].sel(estimator=chosen).mean("seed").values[: rows * columns]
            maps[title] = values.reshape(rows, columns) * (1000.0 if SCORES[score].units == "m" else 1.0)
    text = (
        f"{style.label(chosen)}, mean over recordings; the face as the eye sees it. Depth and variation are what each "
        "taxel adds to these parts of the squared error (the other two are the same everywhere); a servo with a gain "
        "above the critical one does not converge."
    )
    if "basin_by_posture" in face:
        text += (
            " Basin: how far away on the screen a servo may start, in any direction, and still arrive; no farther than "
            "50 mm is tried."
        )
    limits = {_ATLAS["critical_gain_by_posture"]: (0.0, 2.0), _ATLAS["basin_by_posture"]: (0.0, 50.0)}
    return [(f"{place}: the face, taxel by taxel", text, face_atlas(maps, limits=limits))]


def _many(count: int, noun: str) -> str:
    return f"{count} {noun}{'s' * (count != 1)}"


def _number(value: float, digits: int = 3) -> str:
    if not math.isfinite(value):
        return "–"  # noqa: RUF001
    return f"{value:.{digits}g}" if value != 0 else "0"


def _interval(values: tuple[float, float, float]) -> str:
    """Mean and interval in one cell."""
    mean, lower, upper = values
    return _number(mean) + (f" [{_number(lower)}, {_number(upper)}]" if math.isfinite(lower) else "")
