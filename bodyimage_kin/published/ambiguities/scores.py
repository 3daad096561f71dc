"""What readings are held against each other by, beside the scores of every study."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from bodyimage_kin import metrics
from bodyimage_kin.published.fuke2007.scores import POSTURE_SPAN
from bodyimage_kin.study import Context, Fact, Score
from bodyimage_kin.study.answers import checked

__all__ = ["FACTS", "FELT_STEPS", "LEAST_JOINT_MOTION", "SCORES", "TOUCH_DISPLACEMENT_ERROR"]


def _touch_displacement_error(context: Context) -> Any:
    body, use = context.body, context.use
    assert body is not None
    assert use is not None
    q = torch.from_numpy(use["true_q"].values[0])
    before, dq = q[:-1], q[1:] - q[:-1]
    with torch.no_grad():
        linear = (body.hand_image_jacobian(before) @ dq[..., None])[..., 0].numpy()
        foreseen = context.learned.displacement(before, dq)
    return metrics.displacement_error(checked("displacement while touching", foreseen, linear.shape), linear)


def _felt_steps(context: Context) -> Any:
    return np.diff(context.felt_use["q"].values[0], axis=0)


def _least_joint_motion(context: Context) -> Any:
    singular = np.linalg.svd(np.diff(context.experience["q"].values[0], axis=0), compute_uv=False)
    return singular[-1] / singular[0]


# Each stands by its own name, so that workers find it.
TOUCH_DISPLACEMENT_ERROR = Score(
    "touch_displacement_error", (), "relative error of displacements while touching", _touch_displacement_error,
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
