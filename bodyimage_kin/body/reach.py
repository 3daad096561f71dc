"""Inverse kinematics with the least joint displacement."""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from bodyimage_kin.body import _reach_kernels

__all__ = ["TOLERANCE", "Forward", "least_displacement", "step"]

Forward = Callable[[Float[Tensor, "count p"]], tuple[Float[Tensor, "count 3"], Float[Tensor, "count 3 p"]]]

TOLERANCE = 1e-9
"""Largest distance to the target that counts as reached [m]."""
_STEPS, _POLISH, _STARTS = 60, 20, 8
_LONGEST = 0.5  # rad
_DAMPING = 1e-6


@torch.no_grad()
def least_displacement(
    forward: Forward,
    targets: Float[Tensor, "count 3"],
    home: Float[Tensor, "p"],
    lower: Float[Tensor, "p"],
    upper: Float[Tensor, "p"],
) -> tuple[Float[Tensor, "count p"], Bool[Tensor, "count"]]:
    """Postures that bring a point to its targets within limits, displaced from home as little as possible.

    Minimises ``|q - home|^2`` subject to ``forward(q) = target`` and the limits by sequential quadratic programming:
    each step solves the linearised problem, ``dq = J^+ e + (I - J^+ J)(home - q)``, over the joints that no limit
    holds back. It starts at home; targets it misses are tried again from fixed postures spread over the joint space.

    Args:
        forward: Position [m] and its Jacobian [m/rad] at postures.
        targets: Where to bring it [m].
        home: Posture to stay near [rad].
        lower: Joint limits [rad].
        upper: Joint limits [rad].

    Returns:
        Postures, and whether each is within :data:`TOLERANCE` of its target.
    """
    span = torch.where((upper - lower).isfinite(), upper - lower, torch.pi)
    engine = torch.quasirandom.SobolEngine(len(home))  # type: ignore[no-untyped-call]
    starts = engine.draw(_STARTS).to(home.dtype)
    best = _solve(forward, targets, home, home.expand(len(targets), -1), lower, upper)
    for start in starts:
        missed = ~_reached(forward, best, targets)
        if not bool(missed.any()):
            break
        begin = (torch.where(lower.isfinite(), lower, -torch.pi / 2) + start * span).clamp(lower, upper)
        best[missed] = _solve(forward, targets[missed], home, begin.expand(int(missed.sum()), -1), lower, upper)
    return best, _reached(forward, best, targets)


def _solve(
    forward: Forward, targets: Tensor, home: Tensor, start: Tensor, lower: Tensor, upper: Tensor
) -> Float[Tensor, "count p"]:
    q = start.clone()
    for iteration in range(_STEPS + _POLISH):
        position, jacobian = forward(q)
        error = targets - position
        # The last steps only close the remaining distance.
        pull = home - q if iteration < _STEPS else torch.zeros_like(q)
        q = step(jacobian, error, pull, q, lower, upper)
    return q


def step(
    jacobian: Float[Tensor, "count 3 p"],
    error: Float[Tensor, "count 3"],
    pull: Float[Tensor, "count p"],
    q: Float[Tensor, "count p"],
    lower: Float[Tensor, "p"],
    upper: Float[Tensor, "p"],
) -> Float[Tensor, "count p"]:
    """The postures one step on: ``q + J^+ e + (I - J^+ J) pull`` over the joints that no limit holds back.

    Args:
        jacobian: At q.
        error: What remains to the target [m].
        pull: Where the joints would go if the hand let them [rad].
        q: Postures.
        lower: Joint limits.
        upper: Joint limits.
    """
    result = torch.empty_like(q)
    arrays = [tensor.contiguous().numpy() for tensor in (jacobian, error, pull, q, lower, upper)]
    # A long step leaves the region in which the linearised problem means anything.
    _reach_kernels.step(*arrays, _DAMPING, _LONGEST, result.numpy())
    return result


def _reached(forward: Forward, q: Tensor, targets: Tensor) -> Bool[Tensor, "count"]:
    return torch.linalg.vector_norm(forward(q)[0] - targets, dim=-1) <= TOLERANCE
