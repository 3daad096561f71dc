"""Images of any camera as points in space: on the picture that stands before the camera, and at any depth."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from bodyimage_kin.body import Camera, Pinhole, Stereo, Tracker, VirtualScreen
from bodyimage_kin.errors import FoldedLens

Points = Float[np.ndarray, "_ 3"]
Images = Float[np.ndarray, "_ m"]
_ROUND = 48
"""Corners of an ellipse."""


class Sight:
    """How images of one camera are shown in its axes.

    A tracker's image is the point itself; of two cameras the left one's is shown; of a model of one's own nothing is.
    """

    def __init__(self, camera: Camera, depth: float, images: Images) -> None:
        """Chooses where the picture stands.

        Args:
            camera: The camera.
            depth: Of the hand at home [m].
            images: That are to fit on the picture, (count, m), NaN for none.
        """
        model = camera.model
        self.model = model.left if isinstance(model, Stereo) else model
        if isinstance(self.model, VirtualScreen):
            self.depth = self.model.distance
        else:
            self.depth = 0.3 * depth if depth > 0 else 0.1
        self._extent = _extent(images)

    @property
    def shows(self) -> bool:
        """Whether images of this camera can be shown in space."""
        return isinstance(self.model, VirtualScreen | Pinhole | Tracker)

    def place(self, images: Images, depth: float | None = None) -> Points:
        """Where images are in the camera's axes [m]; NaN where there is none.

        Args:
            images: (count, m) in the camera's unit.
            depth: Along the camera's axis [m]; None: on the picture. A tracker needs none.
        """
        at = self.depth if depth is None else depth
        if isinstance(self.model, VirtualScreen):
            flat = images[:, :2] / self.model.distance
        elif isinstance(self.model, Pinhole):
            flat = _directions(self.model, images[:, :2])
        elif isinstance(self.model, Tracker):
            return images
        else:
            return np.full((len(images), 3), np.nan)
        return np.concatenate([flat, np.where(np.isfinite(flat).all(1), 1.0, np.nan)[:, None]], axis=1) * at

    def frame(self) -> Points:
        """The four corners of the picture in the camera's axes [m]; none of a tracker."""
        if isinstance(self.model, Tracker) or not self.shows:
            return np.empty((0, 3))
        if isinstance(self.model, Pinhole) and self.model.size is not None:
            wide, high = self.model.size
            (left, top), (right, bottom) = (0.0, 0.0), (wide - 1.0, high - 1.0)
            flat = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
            return self.place(flat)
        (left, top), (right, bottom) = self._extent[:, :2]
        return self.place(np.array([[left, top], [right, top], [right, bottom], [left, bottom]]))

    def ellipse(self, image: Float[np.ndarray, "m"], half_axes: Float[np.ndarray, "m k"]) -> Points:
        """An ellipse about an image, as a closed line on the picture [m].

        Args:
            image: Its middle.
            half_axes: (m, k) columns: a matrix that maps the unit ball onto the ellipse, in the camera's unit.
        """
        shown = half_axes[:2]
        left, sizes, _ = np.linalg.svd(shown, full_matrices=False)
        angles = np.linspace(0.0, 2 * np.pi, _ROUND + 1)
        flat = image[:2] + (np.stack([np.cos(angles), np.sin(angles)], axis=1) * sizes[:2]) @ left[:, :2].T
        if isinstance(self.model, Tracker):
            return np.concatenate([flat, np.full((len(flat), 1), image[2])], axis=1)
        return self.place(flat)

    @property
    def size(self) -> float:
        """Of the picture, in the camera's unit."""
        return float(np.linalg.norm(self._extent[1, :2] - self._extent[0, :2]))


def _directions(model: Pinhole, images: Images) -> Images:
    """Tangents (x / z, y / z) of the lines of sight; of pixels that the lens never shows, without its distortion."""
    plain = (images - [model.cx, model.cy]) / [model.fx, model.fy]
    try:
        return model.undistort(images).numpy()
    except FoldedLens:
        return np.asarray(plain)


def _extent(images: Images) -> Float[np.ndarray, "2 m"]:
    """Lowest and highest of some images, a fifth wider."""
    known = images[np.isfinite(images).all(1)]
    if not len(known):
        return np.array([[-1.0] * images.shape[1], [1.0] * images.shape[1]])
    low, high = np.quantile(known, [0.01, 0.99], axis=0)
    margin = 0.2 * np.maximum(high - low, 1e-3 * np.abs(high).max() + 1e-9)
    return np.stack([low - margin, high + margin])
