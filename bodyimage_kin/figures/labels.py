"""What a reader calls each name: one table, which a study, a page or a user may override."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from types import MappingProxyType

__all__ = ["LABELS", "drawn", "label", "labelled", "role"]

LABELS: Mapping[str, str] = {
    "analytic": "analytic Jacobian",
    "analytic_midpoint": "analytic Jacobian, midpoint",
    "paper_mlp": "paper's network",
    "paper_mlp_500": "paper's network, 500 steps",
    "paper_mlp_tuned": "paper's network, tuned",
    "posture_mlp": "network of posture and motion",
    "jacobian_network": "Jacobian network",
    "forward_network": "forward network",
    "least_squares": "least squares",
    "least_squares_scaled": "least squares, told the depth",
    "ridge": "ridge regression",
    "nearest_neighbours": "nearest neighbours",
    "trig_ridge": "trigonometric ridge",
    "polynomial": "polynomial",
    "rational_polynomial": "rational polynomial",
    "kernel_ridge": "kernel ridge",
    "nominal": "nominal body",
    "misinformed": "misinformed of its body",
    "rational_trig": "rational trigonometric",
    "gaussian_process": "Gaussian process",
    "recursive_least_squares": "recursive least squares",
    "locally_weighted": "locally weighted regression",
    "broyden": "Broyden",
    "kalman": "Kalman filter",
    "forward_ensemble": "ensemble of forward networks",
    "self_calibration": "self-calibration",
    "null_zero": "null: zero",
    "null_scaled": "null: a tenth of the truth",
    "null_rotated": "null: truth turned by 30 degrees",
    "null_rank_one": "null: truth of rank one",
    "null_other_arm": "null: another arm's",
    "direct": "direct sight",
    "jacobian_error_use": "Jacobian error, motion's metric",
    "velocity_nrmse": "velocity NRMSE",
    "trajectory_rmse": "trajectory RMSE",
    "scale": "scale (one factor)",
    "mean_excited": "mean, excited directions",
    "mean_unexcited": "mean, unexcited directions",
    "variation": "variation with posture",
    "on_circle": "on the circle",
    "in_front": "in front of the face",
    "on_face": "on the face",
    "joint_space": "whole joint space",
    "training": "in training",
    "posture_distance": "mean postures",
    "posture_distance_seen": "mean postures, seen spreads",
    "posture_distance_use": "mean postures, touch steps",
    "excitation_deficit": "excitation (control)",
    "gaussian_process_radial": "Gaussian process, radial",
    "without_structure": "combined, structure unknown",
    "with_structure": "combined, structure known",
    "perturbed_arms_rough": "perturbed arms, rough",
    "mean_of_others": "mean of the others",
}
"""What this library's own names are called; any other is shown as it is, its underscores as spaces."""

_OVERRIDES: ContextVar[Mapping[str, str]] = ContextVar("labels", default=MappingProxyType({}))


def label(name: str) -> str:
    """What a reader calls a name: ``"PaperMLP"`` and ``"paper_mlp"`` are one, and one that nobody listed stays.

    Args:
        name: Of an estimator, a probe, a score, a landmark, a recording ...
    """
    key = role(name)
    overrides = _OVERRIDES.get()
    return overrides.get(name) or overrides.get(key) or LABELS.get(key) or name.replace("_", " ").strip() or name


@contextmanager
def labelled(labels: Mapping[str, str]) -> Iterator[None]:
    """Labels of one's own, before those of the table, for all that is drawn or written inside.

    Args:
        labels: Name -> what a reader calls it.
    """
    token = _OVERRIDES.set({**_OVERRIDES.get(), **labels})
    try:
        yield
    finally:
        _OVERRIDES.reset(token)


def role(name: str) -> str:
    """The key under which a name stands in tables: that of a class is the name it has in studies."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()


def drawn(name: str) -> str:
    """The label as matplotlib takes it: a dollar sign begins no formula."""
    return label(name).replace("$", r"\$")
