"""What is said, in one line, where data cannot carry what is learned from them."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin.errors import DataWarning

_HARDLY = 1e-4
"""Share of the motion along its widest direction below which another one has hardly been moved along."""


def warn_unmoved(learner: str, motion: Float[Tensor, "rows p"], joints: Sequence[str]) -> None:
    """Warns where a joint, or a direction of the joints, has hardly moved.

    Args:
        learner: Who learns.
        motion: Displacements of the joints, or postures less their mean [rad or m].
        joints: Their names.
    """
    moved = motion.abs().amax(0) > 0
    still = [name for name, moves in zip(joints, moved.tolist(), strict=True) if not moves]
    if still:
        _warn(
            f"{learner}: {', '.join(still)} never moves, so nothing is learned of it; record it moving, or leave it out"
        )
    _, strengths, directions = torch.linalg.svd(motion[:, moved], full_matrices=False)
    if len(strengths) and float(strengths[-1]) < _HARDLY * float(strengths[0]):
        condition = float(strengths[0] / strengths[-1].clamp(min=1e-300))
        names = [name for name, moves in zip(joints, moved.tolist(), strict=True) if moves]
        along = _said(directions[-1], names)
        _warn(
            f"{learner}: the joints hardly move along {along} (condition number {condition:.1e}), so what is learned "
            "there is a guess; record a motion along it, or score excited directions alone"
        )


def warn_few(learner: str, told: int, numbers: int) -> None:
    """Warns where fewer numbers were seen than are to be learned."""
    if told < numbers:
        _warn(f"{learner}: {told} numbers seen cannot tell the {numbers} to be learned; record more")


def _said(direction: Float[Tensor, "p"], names: Sequence[str]) -> str:
    """The largest parts of a direction, as a sum of joints."""
    largest = direction.abs().argsort(descending=True)[:3].tolist()
    parts = [
        f"{float(direction[index]):+.2f} {names[index]}" for index in largest if abs(float(direction[index])) > 0.1
    ]
    return " ".join(parts)


def _warn(message: str) -> None:
    # Told of the line outside this package that asked for the fit, however deep the learner lies.
    frame, level, outermost = inspect.currentframe(), 0, 0
    while frame is not None:
        level += 1
        if str(frame.f_globals.get("__name__", "")).partition(".")[0] == "bodyimage_kin":
            outermost = level
        frame = frame.f_back
    warnings.warn(message, DataWarning, stacklevel=outermost + 1)
