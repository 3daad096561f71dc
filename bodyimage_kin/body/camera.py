"""The virtual screen: a pinhole camera that looks along z, its image plane at a stated distance (paper, Fig. 6).

Camera axes: x to the image's right, y down, z forward; the optical centre is the origin. A point (x, y, z) is seen at
``screen_distance * (x, y) / z`` (equations 17 to 19).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera on a link.

    Attributes:
        link: The link that carries it.
        link_T_camera: (4, 4) where it is in the link.
        screen_distance: h_z, from the optical centre to the virtual screen [m].
        near: Depth below which nothing is seen [m].
        half_angle: Half the opening of the cone in which the hand is seen [rad].
    """

    link: str
    link_T_camera: Float[Tensor, "4 4"]
    screen_distance: float
    near: float
    half_angle: float

    def project(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 2"]:
        """Equations 18 and 19: the image of points given in the camera's axes [m]; NaN where depth is not positive."""
        depth = points[..., 2:]
        # Both branches of `where` are differentiated: the unseen one must be finite as well.
        safe = torch.where(depth > 0.0, depth, 1.0)
        return torch.where(depth > 0.0, self.screen_distance * points[..., :2] / safe, torch.nan)

    def project_derivative(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 2 3"]:
        """Derivative of :meth:`project` with respect to the points: ``h_z / z [[1, 0, -x/z], [0, 1, -y/z]]``."""
        depth = points[..., 2, None, None]
        slope = -points[..., :2, None] / depth
        identity = torch.eye(2, dtype=points.dtype, device=points.device).expand(*points.shape[:-1], 2, 2)
        return torch.cat([identity, slope], dim=-1) * (self.screen_distance / depth)

    def in_view(self, points: Float[Tensor, "*batch 3"]) -> Bool[Tensor, "*batch"]:
        """Whether points given in the camera's axes are beyond the near plane and inside the cone."""
        depth = points[..., 2]
        aside = torch.linalg.vector_norm(points[..., :2], dim=-1)
        return (depth >= self.near) & (aside <= depth * torch.tan(torch.tensor(self.half_angle, dtype=points.dtype)))
