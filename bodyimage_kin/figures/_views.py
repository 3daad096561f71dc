"""Where a drawing is seen from: the picture plane, and what the robot itself covers there.

Everything is in the root's coordinates until ``project`` puts it on the picture plane, in metres, true to scale however
far away it is. Taxels, paths and rays go through the same ``project`` as the robot, and ``hidden`` says which of their
points the robot covers.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.figures.visuals import Surface, triangles

Window: TypeAlias = tuple[float, float, float, float]
"""Left, right, bottom, top on the picture plane [m]."""


@dataclass(frozen=True)
class View:
    """An orthographic view.

    Attributes:
        target: (3,) the point in the middle of the picture, in the root [m].
        azimuth: Of the viewer, from x to y [degrees].
        elevation: Of the viewer [degrees].
    """

    target: Float[np.ndarray, "3"]
    azimuth: float | int
    elevation: float | int

    def axes(self) -> Float[np.ndarray, "3 3"]:
        """Right, up and forward in the root, as rows."""
        a, e = np.radians([self.azimuth, self.elevation])
        right = np.array([-np.sin(a), np.cos(a), 0.0])
        forward = -np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        return np.stack([right, np.cross(right, forward), forward])


def project(
    points: Float[np.ndarray, "*batch 3"], view: View
) -> tuple[Float[np.ndarray, "*batch 2"], Float[np.ndarray, "*batch"]]:
    """Points on the picture plane, and how far away they are.

    Args:
        points: In the root [m].
        view: Where they are seen from.

    Returns:
        Right and up from the middle of the picture, and the distance beyond it along the line of sight [m].
    """
    along = (points - view.target) @ view.axes().T
    return along[..., :2], along[..., 2]


def hidden(
    points: Float[np.ndarray, "points 3"], surface: Surface, view: View, *, margin: float = 1e-3
) -> Bool[np.ndarray, "points"]:
    """Whether the robot covers each of ``points`` (root, [m]), seen from the view.

    Args:
        points: The points of a path, taxels ...
        surface: What may cover them.
        view: Where they are seen from.
        margin: How far in front of a point a triangle must be to cover it [m]; taxels lie on triangles.
    """
    flat, depth = project(points, view)
    corners, corner_depth = project(surface.corners, view)
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    (left, bottom), (right, top) = np.nanmin(flat, 0), np.nanmax(flat, 0)
    low, high = corners.min(1), corners.max(1)
    near = (low[:, 0] <= right) & (high[:, 0] >= left) & (low[:, 1] <= top) & (high[:, 1] >= bottom)
    seen = near & (np.abs(area) > 1e-15)
    a, ab, ac, area, corner_depth = a[seen], ab[seen], ac[seen], area[seen], corner_depth[seen]
    covered = np.zeros(len(flat), dtype=bool)
    for index, point in enumerate(flat):
        offset = point - a
        u = (offset[:, 0] * ac[:, 1] - offset[:, 1] * ac[:, 0]) / area
        v = (ab[:, 0] * offset[:, 1] - ab[:, 1] * offset[:, 0]) / area
        inside = (u >= 0) & (v >= 0) & (u + v <= 1)
        met = corner_depth[inside]
        at = met[:, 0] + u[inside] * (met[:, 1] - met[:, 0]) + v[inside] * (met[:, 2] - met[:, 0])
        covered[index] = bool((at < depth[index] - margin).any())
    return covered


def clearest(
    views: Sequence[View], seen: Sequence[tuple[Surface, Float[np.ndarray, "points 3"]]], margin: float = 1e-3
) -> View:
    """The view in which fewest points are covered by the surfaces beside them; the first of equals."""

    def covered(view: View) -> int:
        return sum(int(hidden(points, surface, view, margin=margin).sum()) for surface, points in seen)

    return min(views, key=covered)


def window_of(
    flat: Float[np.ndarray, "*points 2"], edge: float = 0.03, *, below: float = 1.0, square: bool = False
) -> Window:
    """A window about points of the picture plane.

    Args:
        flat: What it shows [m]; NaN is left out.
        edge: Margin, as a share of the longer side.
        below: The lower margin, in margins.
        square: Whether it is as wide as tall.
    """
    points = flat.reshape(-1, 2)
    low, high = np.nanmin(points, 0), np.nanmax(points, 0)
    longer = float((high - low).max())
    if square:
        low, high = (low + high - longer) / 2, (low + high + longer) / 2
    margin = edge * longer
    return float(low[0] - margin), float(high[0] + margin), float(low[1] - below * margin), float(high[1] + margin)


def facing(body: Embodiment) -> tuple[float, float]:
    """Azimuth and elevation that the face looks to, the robot at home [degrees]: out of the skin, or as the eye does.

    What looks up or down is taken to have its lower edge towards x.
    """
    if body.skin is not None:
        forward = body.skin.root_T_link[:3, :3].numpy() @ body.skin.forward
    else:
        forward = camera_pose(body, body.felt_home)[:3, 2]
    elevation = float(np.degrees(np.arcsin(np.clip(forward[2], -1, 1))))
    azimuth = float(np.degrees(np.arctan2(forward[1], forward[0])))
    return (azimuth if abs(elevation) < 80 else 0.0), elevation


def felt_links(body: Embodiment) -> tuple[str, ...]:
    """The links that felt joints move, and the one that bears the skin."""
    bearing = body.skin.link if body.skin is not None else None
    return tuple(
        link
        for link in body.robot.link_names
        if link == bearing or any(joint.name in body.joints for joint in body.robot.path(link))
    )


def posed(
    body: Embodiment, q: ArrayLike | None, links: Iterable[str], mesh_folder: str | os.PathLike[str] | None = None
) -> Surface:
    """Some links at a felt posture (p,), the other joints at home; with no posture, the robot at zero."""
    posture = {} if q is None else body.robot.named(body.full_posture(q))
    return triangles(body.robot, posture, links=links, mesh_folder=mesh_folder)


def camera_pose(body: Embodiment, q: ArrayLike) -> Float[np.ndarray, "4 4"]:
    """Where the camera is at a felt posture (p,) [m]."""
    return (body.kinematics.pose(q, body.camera.link) @ body.camera.link_T_camera).detach().numpy()


def skin_places(body: Embodiment, q: ArrayLike) -> Float[np.ndarray, "taxels 3"]:
    """Where the taxels are in the root at a felt posture (p,) [m]."""
    skin = body.require_skin()
    pose = body.kinematics.pose(q, skin.link).detach().numpy()
    return skin.link_positions @ pose[:3, :3].T + pose[:3, 3]
