"""The experiment in numbers: means over recordings, claims, and what measures see of corrupted truths."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from bodyimage_kin._files import write_json
from bodyimage_kin.published.fuke2007.blindness import FALSE_ALARMS, permuted_error, power
from bodyimage_kin.published.fuke2007.claims import judged
from bodyimage_kin.published.fuke2007.conditions import Conditions
from bodyimage_kin.published.fuke2007.corruption import DOSES
from bodyimage_kin.published.fuke2007.grid import CONDITIONS, DIRECT, ESTIMATORS, Condition
from bodyimage_kin.study.summary import plain_numbers, refuse_failed

__all__ = ["PROBES", "judge", "write_summary"]

PROBES = ("on_circle", "in_front", "on_face")
"""Posture sets that leave what was seen step by step: seen postures, taxels 3 cm off, taxels touched."""
_OF_THE_TOUR = (
    "velocity_correlation", "velocity_nrmse", "displacement_error", "trajectory_rmse", "relations_kept", "loop_drift",
    "training_residual",
)  # fmt: skip
_OF_THE_POSTURE_MAP = {
    "rmse": "posture_rmse", "span": "posture_span", "disparity": "posture_disparity", "scale": "posture_map_scale",
    "quantization_error": "quantization_error", "topographic_error": "topographic_error",
}  # fmt: skip


def judge(results: xr.Dataset) -> dict[str, Any]:
    """The run in numbers: means over seeds, not-a-number as None.

    ``jacobian_relative_error_use`` alone is the root of the mean square over seeds, so that the parts of
    ``attribution`` sum to its square on the face.

    Args:
        results: Of the study that :func:`bodyimage_kin.published.fuke2007.grid` gives.

    Returns:
        ``{"conditions": {condition: {estimator: scores}}, "claims": [...], "blindness": {...}, "seeds": N,
        "versions": {...}}``.

    Raises:
        InvalidConfig: A cell failed; says which, and why.
    """
    refuse_failed(results)
    found = Conditions(results)
    return dict(
        plain_numbers(
            {
                "conditions": {
                    one.name: {estimator: _scores(found, one, estimator) for estimator in ESTIMATORS}
                    for one in CONDITIONS
                },
                "claims": judged(found),
                "blindness": {
                    "false_alarms": FALSE_ALARMS,
                    "doses": {kind: list(doses) for kind, doses in DOSES.items()},
                    "power": power(found),
                    "permuted_topological_error": permuted_error(found),
                },
                "seeds": len(found.seeds),
                "versions": json.loads(results.attrs["versions"]),
            },
            digits=None,
        )
    )


def write_summary(found: Mapping[str, Any], path: Path) -> None:
    """Writes what was judged as JSON, atomically."""
    write_json(path, found, indent=2)


def _scores(found: Conditions, condition: Condition, estimator: str) -> dict[str, Any]:
    def mean(name: str, **at: object) -> Any:
        return found.score(condition.name, estimator, name, **at).mean(axis=0).tolist()

    errors = found.score(condition.name, estimator, "topological_errors")[:, 0]
    spread = errors.std(axis=0, ddof=1) if len(errors) > 1 else np.full(errors.shape[1], np.nan)
    maps = {
        "map": {
            "steps": json.loads(found.results.attrs["config"])["maps"]["snapshots"],
            "topological_error_mean": errors.mean(axis=0).tolist(),
            "topological_error_sd": spread.tolist(),
            "span": found.score(condition.name, estimator, "spans")[:, -1].mean(axis=0).tolist(),
            "folded_cells": mean("folded_cells"),
            "disparity": mean("disparity"),
            "scale": mean("map_scale"),
            "edge_correlation": mean("edge_correlation"),
        },
        "posture_map": {name: mean(score) for name, score in _OF_THE_POSTURE_MAP.items()},
    }
    if estimator == DIRECT:
        return maps
    parts = [str(part) for part in found.results["part"].values]
    by_probe = {probe: dict(zip(parts, mean("attribution", probe=probe), strict=True)) for probe in PROBES}
    finite = np.isfinite(found.score(condition.name, estimator, "displacement_error"))
    finite &= np.isfinite(found.score(condition.name, estimator, "trajectory_rmse"))
    return {
        **{name: mean(name) for name in _OF_THE_TOUR},
        "jacobian_relative_error": {probe: mean("relative_error", probe=probe) for probe in PROBES},
        "jacobian_relative_error_use": {
            probe: math.sqrt((found.score(condition.name, estimator, "relative_error_use", probe=probe) ** 2).mean())
            for probe in PROBES
        },
        "attribution": by_probe["on_face"],
        "attribution_by_probe": by_probe,
        "scale_along_truth": {probe: mean("scale_along_truth", probe=probe) for probe in PROBES},
        "diverged_seeds": [seed for seed, there in zip(found.seeds, finite, strict=True) if not there],
        **maps,
    }
