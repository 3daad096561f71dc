"""The scores of a study: name, dimensions, unit and meaning, in one place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

PARTS = ("scale", "mean_excited", "mean_unexcited", "variation")
"""What a squared Jacobian error is the sum of (:class:`bodyimage_kin.metrics.Attribution`)."""

CAUSES = ("discretisation", "position", "circulation")
"""What the error of an integrated path is the sum of (:class:`bodyimage_kin.metrics.ErrorSplit`)."""


@dataclass(frozen=True)
class Score:
    """One score of a learned Jacobian.

    Attributes:
        dims: Beside embodiment, recording, estimator and seed.
        long_name: What it is.
        units: ``"1"`` where it has none.
        source: Where its formula is.
        ratio: Whether it is positive and compared by ratios.
        optional: Whether it is computed only when a study asks for it by name, for it takes its time.
    """

    dims: tuple[str, ...]
    long_name: str
    units: str = "1"
    source: str = ""
    ratio: bool = True
    optional: bool = False

    @property
    def attributes(self) -> dict[str, str]:
        """As attributes of a variable."""
        found = {"long_name": self.long_name, "units": self.units}
        return found | ({"source": f"bodyimage_kin.metrics.{self.source}"} if self.source else {})


_BY_POSTURE = ("probe", "posture")
SCORES: Mapping[str, Score] = {
    "relative_error": Score(
        ("probe",), "relative error of the Jacobian, every joint alike", source="pooled_relative_error"
    ),
    "relative_error_use": Score(
        ("probe",), "relative error of the Jacobian in the motion's metric", source="pooled_relative_error"
    ),
    "scale_free_error": Score(
        ("probe",), "squared error left after the best scaling, motion's metric", source="pooled_scale_free_error"
    ),
    "attribution": Score(
        ("probe", "part"), "parts of the squared relative error, motion's metric", source="attribute", ratio=False
    ),
    "scale": Score(("probe",), "best single scale of the estimate", source="attribute", ratio=False),
    "displacement_error": Score((), "relative error of displacements on the tour", source="displacement_error"),
    "velocity_correlation": Score(
        ("axis",), "correlation of velocities on the tour", source="velocity_correlation", ratio=False
    ),
    "velocity_nrmse": Score(("axis",), "velocity error over the range of the true one", source="velocity_nrmse"),
    "trajectory_rmse": Score((), "position error of the integrated tour", "m", "trajectory_rmse"),
    "fit_seconds": Score(
        (), "processor time to fit, the block's over its seeds; measured, so never twice the same", "s"
    ),
    "relative_error_by_posture": Score(_BY_POSTURE, "relative error, motion's metric", source="relative_error"),
    "scale_free_error_by_posture": Score(_BY_POSTURE, "scale-free error, motion's metric", source="scale_free_error"),
    "scale_by_posture": Score(_BY_POSTURE, "what each posture adds to the part scale, times their number"),
    "variation_by_posture": Score(_BY_POSTURE, "what each posture adds to the part variation, times their number"),
    "critical_gain_by_posture": Score(
        _BY_POSTURE, "gain below which a sampled visual servo converges", source="critical_gain", ratio=False
    ),
    "trajectory_split": Score(
        ("cause",),
        "parts of the position error of the tour integrated from true postures",
        "m",
        "error_split",
        ratio=False,
        optional=True,
    ),
    "basin_by_posture": Score(
        _BY_POSTURE,
        "distance on the screen from which a servo still converges; of probes of the face only",
        "m",
        "servo_basin",
        ratio=False,
        optional=True,
    ),
    "touch_trajectory_rmse": Score(
        (), "position error of the integrated touching", "m", "trajectory_rmse", optional=True
    ),
    "map_error": Score((), "distance from the map of direct sight, over that map's extent", optional=True),
    "map_error_to_truth": Score(
        (), "distance of the map from the true taxels, the kernel's share included", "m", optional=True
    ),
    "map_topological_error": Score(
        (), "taxels out of order with a neighbour", source="topological_error", ratio=False, optional=True
    ),
    "map_span": Score(("axis",), "extent of the map over the true one", source="span", ratio=False, optional=True),
    "map_disparity": Score(
        (), "squared error of the map left after the best similarity", source="procrustes", optional=True
    ),
    "map_folded_cells": Score(
        (), "cells of the map turned over or flattened", source="folded_cells", ratio=False, optional=True
    ),
    "posture_map_error": Score(
        (), "distance from the posture map of direct sight, over that map's extent", optional=True
    ),
}
"""Name -> score; those by posture are kept on request, optional ones when they are named."""
MAP_SCORES = tuple(name for name in SCORES if "map_" in name or name.startswith("touch_"))
"""Scores for which a cell integrates the touches and learns maps (:mod:`bodyimage_kin.study.maps`)."""
DEFAULT = tuple(name for name, score in SCORES.items() if not score.optional)
"""Scores that a study keeps unless it says otherwise."""
