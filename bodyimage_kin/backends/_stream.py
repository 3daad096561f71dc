"""Kinematics of more postures than memory holds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin._arrays import as_postures
from bodyimage_kin.errors import InvalidPosture, NotDifferentiable

Compute = Callable[[Tensor, tuple[Tensor, Tensor]], tuple[Tensor, Tensor]]


def chunks(source: Any, n: int, batch: int) -> Iterator[Float[Tensor, "batch n"]]:
    """The postures of a source in its order, at most ``batch`` at a time; only those are ever read from a file."""
    parts = [source] if isinstance(source, np.ndarray | Tensor) and source.ndim == 2 else source
    for part in parts:
        if np.ndim(part) != 2:
            shape = tuple(np.shape(part))
            raise InvalidPosture(f"a stream is made of arrays (batch, {n}), and this one is of shape {shape}")
        for first in range(0, len(part), batch):
            yield as_postures(part[first : first + batch], n)


def stream(
    postures: Iterator[Float[Tensor, "batch n"]], compute: Compute, n: int, batch: int
) -> Iterator[tuple[Float[Tensor, "batch 4 4"], Float[Tensor, "batch 6 n"]]]:
    """Pose and Jacobian of each chunk, in memory that is used again for the next."""
    buffers: tuple[Tensor, Tensor] | None = None
    for q in postures:
        if q.requires_grad and torch.is_grad_enabled():
            raise NotDifferentiable("a stream uses its memory again and keeps no gradient; give q.detach()")
        # Grown at most to `batch`: nobody pays for more than the chunks need.
        if buffers is None or len(buffers[0]) < len(q) or buffers[0].dtype != q.dtype or buffers[0].device != q.device:
            size = min(batch, len(q))
            buffers = q.new_empty(size, 4, 4), q.new_empty(size, 6, n)
        yield compute(q, (buffers[0][: len(q)], buffers[1][: len(q)]))
