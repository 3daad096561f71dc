"""What foretold errors are worth: scores of every predictor for every estimator, as numbers and as a page."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Shaped

from bodyimage_kin._files import write_json
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import BodyImageKinError
from bodyimage_kin.published.foreknowledge.evaluate import Combination, Score, evaluate, evaluate_by_posture
from bodyimage_kin.published.foreknowledge.grid import CONDITIONS, ESTIMATORS, Condition
from bodyimage_kin.published.foreknowledge.scores import PREDICTORS, predictors
from bodyimage_kin.recordings import Noise
from bodyimage_kin.study import failures, markdown_table, plain_numbers
from bodyimage_kin.study.statistics import NEEDED, Interval

__all__ = [
    "COMBINATIONS",
    "MEAN_OF_OTHERS",
    "TARGET",
    "NothingCame",
    "judge",
    "label",
    "markdown",
    "verdict",
    "write_summary",
]

TARGET = 0.85
"""The R2 that a predictor should reach."""
MEAN_OF_OTHERS = "mean_of_others"
COMBINATIONS: Mapping[str, Combination] = {
    "without_structure": Combination(("posture_distance", "excitation_deficit", "gaussian_process")),
    "with_structure": Combination(("posture_distance", "gaussian_process", "perturbed_arms")),
}


class NothingCame(BodyImageKinError):
    """Every condition and seed failed."""


def judge(results: xr.Dataset, body: Embodiment, conditions: Sequence[Condition] = CONDITIONS) -> dict[str, Any]:
    """The run in numbers: scores of every predictor for every estimator, and the conditions' means behind them.

    Args:
        results: Of the study that :func:`bodyimage_kin.published.foreknowledge.grid` gives.
        body: The embodiment.
        conditions: Of the study.

    Returns:
        Plain numbers, lists and tables, not-a-number as None. ``"failed"`` has what failed, with its words.

    Raises:
        NothingCame: All failed.
    """
    failed = [
        {"condition": one["recording"], "estimator": one["estimator"], "seed": seed, "words": one["failure"]}
        for one in failures(results)
        for seed in one["seeds"]
    ]
    count = len(conditions) * results.sizes["seed"] * results.sizes["estimator"]
    if len(failed) == count:
        raise NothingCame(f"every condition and seed failed; the first: {failed[0]['words']}")

    def table(name: str, estimator: str) -> Shaped[np.ndarray, "conditions recordings *rest"]:
        found = results[name].isel(embodiment=0).sel(recording=[one.recording for one in conditions])
        return (
            found.sel(estimator=estimator)
            .transpose("recording", "seed", "predictor", ..., missing_dims="ignore")
            .values
        )

    specs = predictors(body, Noise(), "")
    absolute = [name for name, spec in specs.items() if spec.absolute]
    families = [condition.family for condition in conditions]
    groups = families if len(set(families)) > 1 else None
    scores: dict[str, Any] = {}
    for estimator in ESTIMATORS:
        measured, touching = table("measured", estimator), table("measured_touching", estimator)
        every, refused = table("foreseen", estimator), table("refused", estimator)
        foreseen = {name: every[:, :, p] for p, name in enumerate(PREDICTORS) if name in specs}
        of = {name: _score(one) for name, one in evaluate(measured, foreseen, COMBINATIONS, absolute=absolute).items()}
        for name, one in evaluate(touching, foreseen, COMBINATIONS, absolute=absolute, resamples=0).items():
            of[name]["touching"] = {"r2": one.r2.estimate, "slope": one.slope.estimate, "raw_r2": one.raw_r2}
        for name, one in evaluate(measured, foreseen, COMBINATIONS, groups=groups, resamples=0).items():
            of[name]["r2_families"] = one.r2.estimate
        by_posture = table("foreseen_by_posture", estimator)
        for p, name in enumerate(PREDICTORS):
            of[name]["by_posture"] = dataclasses.asdict(
                evaluate_by_posture(table("measured_by_posture", estimator), by_posture[:, :, p])
            )
            of[name]["foreseen"] = _mean(foreseen[name]).tolist()
            of[name]["missing"] = int((np.isfinite(measured) & ~np.isfinite(foreseen[name])).sum())
            of[name]["refused"] = next(
                (
                    f"{condition.name}, seed {seed}: {refused[c, s, p]}"
                    for c, condition in enumerate(conditions)
                    for s, seed in enumerate(results["seed"].values)
                    if refused[c, s, p]
                ),
                None,
            )
        scores[estimator] = {"measured": _mean(measured).tolist(), "predictors": of}
    described = {name: {"assumes": spec.assumes, "absolute": spec.absolute} for name, spec in specs.items()}
    for name, combination in COMBINATIONS.items():
        parts = " + ".join(label(one) for one in combination.of)
        described[name] = {"assumes": f"what its parts do: {parts}", "absolute": False}
    described[MEAN_OF_OTHERS] = {
        "assumes": "the error measured in other conditions (its geometric mean), and nothing else",
        "absolute": False,
    }
    found = {
        "seeds": int(results.sizes["seed"]),
        "conditions": [dataclasses.asdict(condition) for condition in conditions],
        "predictors": described,
        "estimators": scores,
        "failed": failed,
        "config": json.loads(results.attrs["config"]),
        "versions": json.loads(results.attrs["versions"]),
    }
    return dict(plain_numbers(found))


def write_summary(found: Mapping[str, Any], path: Path) -> None:
    """Writes what was judged as JSON, atomically."""
    write_json(path, found)


def label(name: str) -> str:
    """What a reader calls a predictor or an estimator."""
    return _LABELS.get(name, name.replace("_", " "))


def markdown(found: Mapping[str, Any]) -> str:
    """A summary as a page: what each predictor assumes, and for each estimator what it is worth."""
    seeds, conditions = found["seeds"], found["conditions"]
    enough = len(conditions) >= NEEDED["conditions"]
    brackets = (
        " In brackets 95 % over conditions, drawn and calibrated anew."
        if enough
        else f" Fewer than {NEEDED['conditions']} conditions, which are what varies here: values, and no interval."
    )
    lines = [
        "# Foreknowledge",
        "",
        f"{len(conditions)} conditions, {seeds} recordings of each. R2 and slope are out of sample: each condition is "
        "predicted by a calibration on the others (family out: on those that differ in more than distance)."
        f"{brackets} The error is that on the face, or where said over the touch motion. Who is "
        "silent on a whole condition has no score.",
        "",
        markdown_table(
            ("predictor", "assumes"), [(label(n), one["assumes"]) for n, one in found["predictors"].items()], words=2
        ),
    ]
    for estimator, one in found["estimators"].items():
        lines += [
            "",
            f"## {label(estimator)}",
            "",
            verdict(found, estimator),
            "",
            markdown_table(_HEAD, _rows(one["predictors"])),
        ]
        refused = {name: score["refused"] for name, score in one["predictors"].items() if score.get("refused")}
        lines += ["", *(f"- {label(name)} refused first in {words}" for name, words in refused.items())] * bool(refused)
    if found["failed"]:
        lines += ["", "## Failed", ""]
        lines += [
            f"- {one['condition']}/{one['estimator']}, seed {one['seed']}: {one['words']}" for one in found["failed"]
        ]
    return "\n".join(lines) + "\n"


def verdict(found: Mapping[str, Any], estimator: str) -> str:
    """One sentence: who reaches ``TARGET`` for an estimator, or who comes nearest and how near."""
    r2 = {name: one["r2"]["estimate"] for name, one in found["estimators"][estimator]["predictors"].items()}
    r2 = {name: value for name, value in r2.items() if value is not None}
    if not r2:
        return "No predictor has an R2: none spoke of every condition."
    reached = sorted((name for name in r2 if r2[name] >= TARGET), key=lambda name: -r2[name])
    if reached:
        return f"R2 of at least {TARGET}: " + ", ".join(f"{label(name)} ({r2[name]:.2f})" for name in reached) + "."
    best = max(r2, key=lambda name: r2[name])
    return f"No predictor reaches R2 {TARGET}; the best is {label(best)} with {r2[best]:.2f}."


# Inner ---------------------------------------------------------------------------------------------------------------

_LABELS = {
    "least_squares": "Least squares",
    "paper_mlp": "The paper's network",
    "polynomial": "Cubic polynomial",
    "rational_trig": "Rational trigonometric",
    "posture_distance": "distance of mean postures",
    "posture_distance_seen": "distance of mean postures, in seen spreads",
    "posture_distance_use": "distance of mean postures, in steps of touching",
    "excitation_deficit": "excitation deficit (control)",
    "gaussian_process": "Gaussian process posterior",
    "gaussian_process_radial": "Gaussian process posterior, radial",
    "perturbed_arms": "perturbed arms (spreads 0.05 and 5 mm)",
    "perturbed_arms_rough": "perturbed arms (spreads 0.2 and 20 mm)",
    "without_structure": "combined, structure unknown",
    "with_structure": "combined, structure known",
    MEAN_OF_OTHERS: "geometric mean of the other conditions",
}
_HEAD = (
    "predictor", "R2", "slope", "R2 of logs", "R2, single recordings", "R2, family out", "R2 uncalibrated",
    "R2 over the touch motion", "the same uncalibrated", "rank correlation by posture", "R2 by posture", "missing",
)  # fmt: skip


def _rows(of: Mapping[str, Any]) -> list[list[str]]:
    found = []
    for name, one in of.items():
        by_posture = one.get("by_posture", {})
        cells = [
            label(name),
            _ends(one["r2"]),
            # That of the mean of all others is one less their number, whatever was measured.
            "" if name == MEAN_OF_OTHERS else _ends(one["slope"]),
            _number(one["r2_log"]),
            _number(one["r2_recordings"]),
            _number(one["r2_families"]),
            _number(one["raw_r2"]),
            _number(one["touching"]["r2"]),
            _number(one["touching"]["raw_r2"]),
            _number(by_posture.get("rank_correlation")),
            _number(by_posture.get("r2")),
            str(one.get("missing", "")),
        ]
        found.append(cells)
    return found


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}" if abs(value) < 100 else f"{value:.0f}"


def _ends(one: Mapping[str, Any]) -> str:
    ends = "" if one["lower"] is None else f" [{_number(one['lower'])}, {_number(one['upper'])}]"
    return _number(one["estimate"]) + ends


def _score(one: Score) -> dict[str, Any]:
    def ends(interval: Interval) -> dict[str, float]:
        return {"estimate": interval.estimate, "lower": interval.lower, "upper": interval.upper}

    return {
        "r2": ends(one.r2),
        "r2_log": one.r2_log,
        "r2_recordings": one.r2_recordings,
        "slope": ends(one.slope),
        "raw_r2": one.raw_r2,
        "raw_slope": one.raw_slope,
        "predicted": _mean(one.predicted).tolist(),
    }


def _mean(values: np.ndarray) -> np.ndarray:
    """Over the recordings that are finite; NaN without any."""
    there = np.isfinite(values)
    return np.asarray(np.where(there, values, 0.0).sum(1) / np.where(there.any(1), there.sum(1), np.nan))
