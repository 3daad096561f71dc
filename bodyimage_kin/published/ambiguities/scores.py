"""What readings are held against each other by, beside the scores of every study."""

from __future__ import annotations

from typing import Any

import numpy as np

from bodyimage_kin.published.fuke2007.scores import POSTURE_SPAN
from bodyimage_kin.study import Context, Fact, Score
from bodyimage_kin.study.scores import displacement_error_along

__all__ = ["FACTS", "FELT_STEPS", "LEAST_JOINT_MOTION", "SCORES", "TOUCH_DISPLACEMENT_ERROR"]


def _felt_steps(context: Context) -> Any:
    return np.diff(context.felt_use["q"].values[0], axis=0)


def _least_joint_motion(context: Context) -> Any:
    singular = np.linalg.svd(np.diff(context.experience["q"].values[0], axis=0), compute_uv=False)
    return singular[-1] / singular[0]


# Each stands by its own name, so that workers find it.
TOUCH_DISPLACEMENT_ERROR = Score(
    "touch_displacement_error", (), "relative error of displacements while touching",
    lambda context: displacement_error_along(context, context.use, "while touching"),
    needs=("body", "learned", "true_use"), source="displacement_error",
)  # fmt: skip
FELT_STEPS = Fact(
    "felt_steps", ("step", "joint"), "felt displacements of the joints while touching", _felt_steps, "rad",
    needs=("use",), ratio=False, optional=True,
)  # fmt: skip
LEAST_JOINT_MOTION = Fact(
    "least_joint_motion", (), "least over largest singular value of the felt displacements that are learned from",
    _least_joint_motion,
)  # fmt: skip
SCORES: tuple[str | Score, ...] = (
    TOUCH_DISPLACEMENT_ERROR, "relative_error_use", "trajectory_rmse", "touch_trajectory_rmse", "map_span",
    "map_disparity", "map_topological_error", POSTURE_SPAN,
)  # fmt: skip
"""Names of a study's own scores, and further ones."""
FACTS: tuple[str | Fact, ...] = (LEAST_JOINT_MOTION,)
"""Likewise of the recordings."""
