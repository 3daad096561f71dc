"""What a monocular learner cannot know: how much nearer the hand is where its Jacobian is used."""

from __future__ import annotations

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float

from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import NotVisible
from bodyimage_kin.metrics.probes import Face, Probe, Training, probe_postures

__all__ = ["depth_ratio"]


def depth_ratio(body: Embodiment, seen: xr.Dataset, use: Probe | None = None) -> float:
    """Mean depth of the hand in training over its true mean depth where the Jacobian is used.

    An image shrinks with depth, so a Jacobian learned at one depth is too small at a lesser one by about this ratio. It
    is what a learner is given that is "told the depth" (``LeastSquares(scale=...)``). Depths are of the hand's centre
    along the camera's axis, not the distance of any screen.

    Args:
        body: The embodiment.
        seen: The recording that is learned from.
        use: Probe whose postures the Jacobian is used at; touching the face, ``Face()``, when None.

    Raises:
        InvalidRecording: A recording without postures.
        NotVisible: The hand is on the mean not in front of the camera, in training or in use.
    """
    depth = [_mean_depth(body, probe_postures(probe, body, seen)) for probe in (Training(), use or Face())]
    if not min(depth) > 0:
        raise NotVisible(
            f"embodiment '{body.name}': the hand's mean depth is {depth[0]:.3g} m in training and {depth[1]:.3g} m in "
            "use; both must lie in front of the camera"
        )
    return depth[0] / depth[1]


def _mean_depth(body: Embodiment, q: Float[torch.Tensor, "postures p"]) -> float:
    with torch.no_grad():
        return float(np.mean(body.hand_in_camera(q)[:, 2].numpy()))
