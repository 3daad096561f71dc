"""How wrong learned maps are on what was hidden from them, as a page for whoever made the recording."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from bodyimage_kin import figures
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.report._answer import Section, Table, percent, size, write_answer
from bodyimage_kin.report._page import Picture, number

_LABELS = {"held_out": "on hidden parts of the recording", "training": "where it was seen", "joint_space": "anywhere"}


def write(
    rows: xr.Dataset,
    path: Path,
    against: Mapping[str, xr.Dataset] | None = None,
    verdict: str = "",
    said: Sequence[str] = (),
) -> Path:
    """See :func:`bodyimage_kin.report.write_scores`."""
    if "pair_error_relative" not in rows or "estimator" not in rows.dims:
        raise InvalidConfig(
            "these are no scores of estimators on hidden parts; give what bk.score(estimators, ...) gave"
        )
    with figures.labelled(_LABELS):
        ranked = [str(name) for name in rows["estimator"].values[_order(rows)]]
        sections = [_meaning(rows), _folds(rows, ranked), _directions(rows)]
        if against:
            sections.insert(1, _against(against, ranked, verdict))
        if failed := _failed(rows):
            sections.append(Section("What could not learn", items=failed))
        if said:
            sections.append(Section("Said on the way", items=list(said)))
        return write_answer(
            path, "How wrong is the learned map?", _sentences(rows, ranked, against or {}), _picture(rows),
            _table(rows, ranked), notes=[_note(rows)], sections=sections,
        )  # fmt: skip


def _order(rows: xr.Dataset) -> np.ndarray:
    return np.asarray(np.argsort(np.nan_to_num(rows["pair_error_relative"].values, nan=np.inf), kind="stable"))


def _unit(rows: xr.Dataset) -> str:
    return str(rows["pair_error"].attrs.get("units", ""))


def _sentences(rows: xr.Dataset, ranked: Sequence[str], against: Mapping[str, xr.Dataset]) -> list[str]:
    learned = [name for name in ranked if math.isfinite(float(rows["pair_error_relative"].sel(estimator=name)))]
    if not learned:
        return ["No learner could learn from this recording; why not is said below."]
    best = rows.sel(estimator=learned[0])
    who = f"the best of {len(learned)} maps, {figures.label(learned[0])}," if len(learned) > 1 else "the map"
    found = [
        f"When the joints move the hand between neighbouring postures, {who} foretells how it moves in the image with "
        f"an error of {percent(float(best['pair_error_relative']))} of the motion "
        f"({size(float(best['pair_error']), _unit(rows))}), on parts of the recording that were hidden from it."
    ]
    floor = float(rows["noise_floor"])
    if math.isfinite(floor) and floor > 0:
        found.append(
            f"An observed image is off by {size(floor, _unit(rows))} at each of the two postures, which no map can "
            f"foretell; without that share the error is {percent(float(best['pair_error_relative_corrected']))}."
        )
    if learned[0] in against:
        one = against[learned[0]]
        there = [float(one[name].sel(probe="training")) for name in ("relative_error", "relative_error_sd")]
        moved = [float(one[name]) for name in ("relative_error_moved", "relative_error_moved_sd")]
        found.append(
            f"Against the body calibrated on the same recording, its whole Jacobian is off by {percent(there[0])} "
            f"where it was seen, and by {percent(moved[0])} in the directions in which the joints moved there. The "
            f"calibrated body is itself in doubt, and these numbers with it by {percent(there[1])} and "
            f"{percent(moved[1])}."
        )
    share = float(rows["moved_share"])
    if share < 0.95:
        found.append(
            f"Around each posture the joints moved in {percent(share)} of their directions only: how wrong the map is "
            "in the others, this recording cannot say."
        )
    return found


def _picture(rows: xr.Dataset) -> Picture:
    found = xr.concat([rows[f"pair_error_relative{end}"] for end in ("", "_lower", "_upper")], "end")
    found = found.expand_dims(probe=["held_out"]).transpose("estimator", "probe", "end")
    ends = [found.isel(end=index, drop=True) for index in range(3)]
    data = xr.Dataset(dict(zip(("median", "lower", "upper"), ends, strict=True)))

    def draw() -> Figure:
        figure, grid = figures.panels(1, 1, height=0.9 + 0.2 * data.sizes["estimator"])
        figures.errors(data, grid[0, 0], xlabel="error over the motion, on hidden parts")
        return figure

    text = (
        "The best is on top. A map that says that nothing ever moves has 1 (dashed); bars are 95 % intervals over "
        "stretches of the recording."
    )
    return Picture("held_out", "first", draw, "How wrong each learned map is", text)


def _table(rows: xr.Dataset, ranked: Sequence[str]) -> Table:
    unit = _unit(rows)
    lines = []
    for name in ranked:
        one = {str(key): rows[key].sel(estimator=name).item() for key in rows if rows[key].dims == ("estimator",)}
        ends = (one["pair_error_relative_lower"], one["pair_error_relative_upper"])
        between = f"{percent(ends[0])} to {percent(ends[1])}" if math.isfinite(ends[0]) else number(math.nan)
        lines.append(
            [
                figures.label(name), percent(one["pair_error_relative"]), between,
                percent(one["pair_error_relative_corrected"]), size(one["pair_error"], unit)
                if math.isfinite(one["pair_error"]) else number(math.nan),
                size(one["image_error"], unit) if math.isfinite(one["image_error"]) else number(math.nan),
            ]
        )  # fmt: skip
    columns = ("learner", "error", "95 % interval", "without noise", "error of a motion", "error of a place")
    return Table(columns, lines, "On parts of the recording that were hidden")


def _note(rows: xr.Dataset) -> str:
    return (
        "Error: root mean squared error of the foretold motion of the hand image between neighbouring postures, over "
        "the root mean square of the observed motion. Error of a place: of the foretold image itself, for learners "
        "that foretell it."
    )


def _meaning(rows: xr.Dataset) -> Section:
    about = rows.attrs
    floor = float(rows["noise_floor"])
    noise = (
        f"The noise of one image, {size(floor, _unit(rows))} (root mean square over its coordinates), is known from "
        "repeats, was stated, or is what the calibrated body leaves; squares are subtracted."
        if math.isfinite(floor)
        else "How much of the errors is noise of the observations is not known: visit some postures twice and number "
        "them in a column 'repeat', or state the noise."
    )
    return Section(
        "What was done",
        [
            f"{about.get('postures', 0)} postures in which the hand was seen were divided into {rows.sizes['fold']} "
            f"parts; each was hidden in turn while every learner learned from the others, and its "
            f"{about.get('pairs', 0)} motions were foretold. Intervals come from drawing the recording's "
            f"{about.get('stretches', 0)} stretches anew, not its samples, for neighbours are nearly copies.",
            noise,
        ],
    )


def _folds(rows: xr.Dataset, ranked: Sequence[str]) -> Section:
    table = Table(
        ("learner", *(f"part {int(fold) + 1}" for fold in rows["fold"].values)),
        [[figures.label(name), *map(percent, rows["by_fold"].sel(estimator=name).values.tolist())] for name in ranked],
    )
    return Section(
        "Part by part", ["Where one part is far worse than the others, the map does not reach there."], tables=[table]
    )


def _directions(rows: xr.Dataset) -> Section:
    values = rows["local_spectrum"].values
    table = Table(
        ("direction", "motion"), [[str(index + 1), percent(float(value))] for index, value in enumerate(values)]
    )
    return Section(
        "In which directions the joints moved",
        [
            "Around each posture, motion along each direction of joint space, over that along the most moved one (mean "
            "over postures, joints over their spread). Directions below a tenth count as not moved."
        ],
        tables=[table],
    )


def _against(against: Mapping[str, xr.Dataset], ranked: Sequence[str], verdict: str) -> Section:
    probes = [str(name) for name in next(iter(against.values()))["probe"].values]
    lines = []
    for name in (name for name in ranked if name in against):
        one = against[name]
        places = [(one["relative_error_moved"], one["relative_error_moved_sd"])]
        error, doubt = one["relative_error"], one["relative_error_sd"]
        places += [(error.sel(probe=probe), doubt.sel(probe=probe)) for probe in probes]
        cells = [f"{percent(float(mean))} \N{PLUS-MINUS SIGN} {percent(float(sd))}" for mean, sd in places]
        lines.append([figures.label(name), *cells])
    return Section(
        "Against the calibrated body",
        [
            "The body was fitted to the same recording; its Jacobian, every joint alike, is held against each learned "
            "one. What follows the plus-minus sign is the doubt about the body itself: the standard deviation "
            "over bodies that explain the recording as well.",
            f"The body: {verdict}",
        ],
        tables=[
            Table(
                ("learner", "in moved directions", *map(figures.label, probes)), lines, "relative error of the Jacobian"
            )
        ],
    )


def _failed(rows: xr.Dataset) -> list[str]:
    failures = {str(name): str(rows["failure"].sel(estimator=name).item()) for name in rows["estimator"].values}
    return [f"{figures.label(name)}: {why}" for name, why in failures.items() if why]
