"""How blind is each measure? What it makes of true Jacobians that are corrupted by known doses.

What a measure makes of the uncorrupted truth over recordings says where it raises a false alarm; the share of
recordings in which it goes beyond that is its power to see the corruption.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from bodyimage_kin import metrics
from bodyimage_kin.published.fuke2007.conditions import Conditions
from bodyimage_kin.published.fuke2007.corruption import DOSES
from bodyimage_kin.published.fuke2007.grid import BLINDNESS, DIRECT, corrupted_row

__all__ = ["FALSE_ALARMS", "MEASURES", "permuted_error", "power"]

FALSE_ALARMS = 0.05
"""Share of uncorrupted recordings that a measure may take for corrupted."""
_TRUTH = "analytic"


def _score(name: str, worst: Callable[..., Any] | None = None, **at: object) -> Callable[[Conditions, str], Any]:
    def of(found: Conditions, row: str) -> Any:
        values = found.row(BLINDNESS, row, name, **at)
        return values if worst is None else worst(values, axis=1)

    return of


def _beyond_sight(of: Callable[[Conditions, str], Any]) -> Callable[[Conditions, str], Any]:
    """Distance of the logarithm from that of direct sight."""

    def values(found: Conditions, row: str) -> Any:
        away = np.abs(np.log(np.maximum(of(found, row), 1e-9) / of(found, DIRECT)))
        return away.max(axis=1) if away.ndim > 1 else away

    return values


MEASURES: Mapping[str, Callable[[Conditions, str], Float[np.ndarray, "seed"]]] = {
    "jacobian_error_use": _score("relative_error_use", probe="on_face"),
    "velocity_correlation": lambda found, row: 1.0 - _score("velocity_correlation", np.min)(found, row),
    "velocity_nrmse": _score("velocity_nrmse", np.max),
    "trajectory_rmse": _score("trajectory_rmse"),
    "topological_error": lambda found, row: found.row(BLINDNESS, row, "topological_errors")[:, 0, -1],
    "map_span": _beyond_sight(lambda found, row: found.row(BLINDNESS, row, "spans")[:, -1]),
    "folded_cells": _score("folded_cells"),
    "map_disparity": _score("disparity"),
    "map_scale": _beyond_sight(_score("map_scale")),
}
"""Measure -> what it makes of a row, one value a recording, more being worse."""


def power(found: Conditions) -> dict[str, dict[str, list[float]]]:
    """Corruption -> measure -> share of recordings in which each dose is seen.

    A dose is seen where the measure goes beyond the quantile of the uncorrupted recordings that leaves
    :data:`FALSE_ALARMS` of them above it.
    """
    seen: dict[str, dict[str, list[float]]] = {}
    for kind, doses in DOSES.items():
        seen[kind] = {}
        for measure, of in MEASURES.items():
            limit = float(np.quantile(of(found, _TRUTH), 1.0 - FALSE_ALARMS, method="higher"))
            values = np.stack([of(found, corrupted_row(kind, dose)) for dose in doses], axis=1)
            # Rounding differs between a rotation by nothing and nothing: what is equal but for that is not beyond.
            beyond = values > limit + 1e-9 * max(1.0, abs(limit))
            seen[kind][measure] = beyond.mean(axis=0).tolist()
    return seen


def permuted_error(found: Conditions) -> float:
    """Mean topological error of true Jacobians' maps with their taxels' labels permuted: what chance makes of them."""
    maps = found.row(BLINDNESS, _TRUTH, "tactile_maps")[:, -1]
    errors = [
        metrics.topological_error(metrics.permuted(map, seed=seed)) for map, seed in zip(maps, found.seeds, strict=True)
    ]
    return float(np.mean(errors))
