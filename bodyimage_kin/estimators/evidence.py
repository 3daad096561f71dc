"""What tells a body's measures: images, a tracker's points, touches of a skin, points on a plane.

Each kind predicts what was observed from a :class:`~bodyimage_kin.estimators.parametric.ParametricBody`, and gives the
derivative of what is left in all parameters, in closed form.
"""

from __future__ import annotations

import abc
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from jaxtyping import Bool, Float

from bodyimage_kin.body import Tracker
from bodyimage_kin.estimators._products import products
from bodyimage_kin.estimators.intrinsics import Intrinsics
from bodyimage_kin.estimators.parametric import ParametricBody

__all__ = ["Images", "Planes", "Points", "Touches"]

_NEAREST = 1e-3
"""Depth below which a fit must not divide by it [m]."""

Residual = tuple[Float[np.ndarray, "count m"], Float[np.ndarray, "count m parameters"]]


@dataclass(frozen=True, eq=False)
class _Evidence(abc.ABC):
    """What all kinds share.

    Attributes:
        name: What it is.
        body: With parameters.
        q: (count, p) felt postures [rad or m].
        offset: (count, 3) the observed point in the hand's frame [m].
        sigma: Standard deviation of the noise in each coordinate [unit of what is observed]; None: unknown.
        point: Name of the mount whose point is observed.
    """

    name: str
    body: ParametricBody
    q: Float[np.ndarray, "count p"]
    offset: Float[np.ndarray, "count 3"]
    sigma: float | None
    point: str

    @property
    @abc.abstractmethod
    def size(self) -> float:
        """Spread of what was observed [its unit]."""

    @abc.abstractmethod
    def residual(self, theta: Float[np.ndarray, "parameters"]) -> Residual:
        """Predicted less observed. See :class:`~bodyimage_kin.estimators.map_fit.Term`."""

    def point_seen(
        self, theta: Float[np.ndarray, "parameters"], observer: str | None = None
    ) -> tuple[Float[np.ndarray, "count 3"], Float[np.ndarray, "count 3 parameters"]]:
        """The observed point in a mount's axes, or the root's [m], and its derivative in the parameters."""
        return self.body.seen(self.q, theta, self.point, self.offset, observer)

    def taken(self, rows: Bool[np.ndarray, "count"]) -> _Evidence:
        """The same evidence with some of its rows."""
        values = {
            field.name: getattr(self, field.name)[rows]
            for field in fields(self)
            if field.name in ("q", "offset", "image", "observed", "target")
        }
        return replace(self, **values)


@dataclass(frozen=True, eq=False)
class Images(_Evidence):
    """Hand images.

    Attributes:
        camera: Name of the camera's mount.
        intrinsics: How it projects.
        first: Index of the first parameter of these, if they have any.
        image: (count, m) what it reported [its unit]; NaN in what was not seen.
    """

    camera: str
    intrinsics: Intrinsics
    first: int
    image: Float[np.ndarray, "count m"]

    @property
    def size(self) -> float:
        """Spread of the images [their unit]."""
        return float(np.nanstd(self.image, axis=0).max())

    def residual(self, theta: Float[np.ndarray, "parameters"]) -> Residual:
        """Predicted less seen. See :class:`~bodyimage_kin.estimators.map_fit.Term`."""
        point, moved = self.point_seen(theta, self.camera)
        values = theta[self.first : self.first + len(self.intrinsics.parameters)]
        model = self.intrinsics.at(values)
        if isinstance(model, Tracker):
            left, derivative = point - self.image, moved
        else:
            # What a fit puts behind the camera on its way is brought before it.
            point[:, 2] = np.maximum(point[:, 2], _NEAREST)
            seen = torch.from_numpy(point)
            left, derivative = model.project(seen).numpy() - self.image, products(model.derivative(seen).numpy(), moved)
        if len(values):
            derivative[:, :, self.first : self.first + len(values)] += self.intrinsics.slope(model, point)
        unseen = np.isnan(left)
        if unseen.any():
            left[unseen], derivative[unseen] = 0.0, 0.0
        return left, derivative

    def jacobian(self, theta: Float[np.ndarray, "parameters"]) -> Float[np.ndarray, "count m p"]:
        """The image Jacobian of a body with these parameters [unit/rad]."""
        frames = self.body.frames(self.q, theta, by_joints=True)
        point, moved = frames[self.camera].seen(*frames[self.point].point(self.offset))
        model = self.intrinsics.at(theta[self.first : self.first + len(self.intrinsics.parameters)])
        return np.asarray(model.derivative(torch.from_numpy(point)).numpy() @ moved)


@dataclass(frozen=True, eq=False)
class Points(_Evidence):
    """A tracker's points, in a frame of its own.

    Attributes:
        tracker: Name of the tracker's mount.
        observed: (count, 3) what it reported [m].
    """

    tracker: str
    observed: Float[np.ndarray, "count 3"]

    @property
    def size(self) -> float:
        """Spread of the points [m]."""
        return float(self.observed.std(axis=0).max())

    def residual(self, theta: Float[np.ndarray, "parameters"]) -> Residual:
        """Predicted less measured [m]. See :class:`~bodyimage_kin.estimators.map_fit.Term`."""
        point, moved = self.point_seen(theta, self.tracker)
        return point - self.observed, moved


@dataclass(frozen=True, eq=False)
class Touches(_Evidence):
    """Touches: where the hand is, against the taxels that felt it.

    Attributes:
        skin: Name of the skin's mount.
        target: (count, 3) where the hand's centre is when these taxels feel it, in the skin's frame [m].
    """

    skin: str
    target: Float[np.ndarray, "count 3"]

    @property
    def size(self) -> float:
        """Spread of the touched places [m]."""
        return float(self.target.std(axis=0).max())

    def residual(self, theta: Float[np.ndarray, "parameters"]) -> Residual:
        """Hand less touched place, in the skin's frame [m]. See :class:`~bodyimage_kin.estimators.map_fit.Term`."""
        point, moved = self.point_seen(theta, self.skin)
        return point - self.target, moved


@dataclass(frozen=True, eq=False)
class Planes(_Evidence):
    """Hand points that lie on a plane that stands in the root, its place unknown.

    The plane is ``n(a, b) . x = d``: the start's normal turned by two angles, and its distance shifted, which are three
    of the body's other parameters.

    Attributes:
        plane: Index of the first of its three parameters.
        normal: (3,) where it is thought to face, in the root.
        distance: From the root's origin along the normal [m].
    """

    plane: int
    normal: Float[np.ndarray, "3"]
    distance: float

    @property
    def size(self) -> float:
        """One metre: there is nothing observed to measure by."""
        return 1.0

    def residual(self, theta: Float[np.ndarray, "parameters"]) -> Residual:
        """Distance from the plane [m]. See :class:`~bodyimage_kin.estimators.map_fit.Term`."""
        place, slope = self.point_seen(theta)
        first, second = _across(self.normal)
        a, b, shift = theta[self.plane : self.plane + 3]
        raw = self.normal + a * first + b * second
        length = float(np.linalg.norm(raw))
        normal = raw / length
        left = place @ normal - (self.distance + shift)
        moved = np.einsum("i,nik->nk", normal, slope)
        for index, direction in enumerate((first, second)):
            moved[:, self.plane + index] += place @ ((direction - normal * (normal @ direction)) / length)
        moved[:, self.plane + 2] -= 1.0
        return left[:, None], moved[:, None, :]


def _across(normal: Float[np.ndarray, "3"]) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across a unit vector."""
    first = np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())])
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)
