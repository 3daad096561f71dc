"""Cameras: where an eye is mounted, and how it projects.

A mount is a link and a pose in it; a model turns points in the camera's axes into what the camera reports. Camera axes:
x to the image's right, y down, z forward; the optical centre is the origin. Everything the library asks of a model is
the protocol :class:`CameraModel`; a model of one's own is any object that has it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin._checks import number, refuse, text, whole
from bodyimage_kin.body._rigid import rigid
from bodyimage_kin.errors import InvalidConfig

__all__ = ["Camera", "CameraModel", "Stereo", "Tracker", "VirtualScreen"]


@runtime_checkable
class CameraModel(Protocol):
    """How a camera projects: what it reports of a point in its axes.

    All methods take points of any batch shape, float32 or float64, and keep their dtype. ``project`` and
    ``derivative`` are made of differentiable torch operations.
    """

    @property
    def m(self) -> int:
        """Number of coordinates of an image."""
        ...

    @property
    def unit(self) -> str:
        """Unit of an image's coordinates: ``"m"``, ``"px"``."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the m coordinates."""
        ...

    def project(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch m"]:
        """The image [unit] of points in the camera's axes [m]; NaN where a point has none."""
        ...

    def derivative(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch m 3"]:
        """Derivative of :meth:`project` with respect to the points [unit/m]; NaN where a point has no image."""
        ...

    def visible(self, points: Float[Tensor, "*batch 3"]) -> Bool[Tensor, "*batch"]:
        """Whether the camera sees points in its axes [m]."""
        ...


@dataclass(frozen=True, eq=False, init=False)
class Camera:
    """A camera on a link: of the arm, of a felt neck, or the robot's root for one that stands in the world.

    Attributes:
        link: The link that carries it.
        link_T_camera: (4, 4) where it is in the link: x to the image's right, y down, z forward [m]. Given as tensor,
            array or lists; a rotation that was typed with six digits becomes the nearest exact one.
        model: How it projects.

    Raises:
        InvalidConfig: A pose that is no rotation and translation, or a model that lacks part of the protocol.
    """

    link: str
    link_T_camera: Float[Tensor, "4 4"]
    model: CameraModel

    def __init__(self, link: str, link_T_camera: ArrayLike, model: CameraModel) -> None:
        object.__setattr__(self, "link", text("camera link", link))
        object.__setattr__(self, "link_T_camera", torch.from_numpy(rigid("link_T_camera", link_T_camera)))
        object.__setattr__(self, "model", check_model("camera model", model))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Camera):
            return NotImplemented
        return (
            self.link == other.link
            and torch.equal(self.link_T_camera, other.link_T_camera)
            and self.model == other.model
        )

    def __hash__(self) -> int:
        return hash((self.link, tuple(self.link_T_camera.flatten().tolist())))

    def __repr__(self) -> str:
        return f"Camera({self.link!r}, {self.model!r})"

    @property
    def screen(self) -> VirtualScreen:
        """The model, of a camera that is a virtual screen.

        Raises:
            InvalidConfig: Another model: what asks is about the virtual screen of Fuke et al. (2007) alone.
        """
        if not isinstance(self.model, VirtualScreen):
            raise InvalidConfig(
                f"this needs a virtual screen, and the camera on '{self.link}' is a {type(self.model).__name__}; "
                "give the embodiment a VirtualScreen"
            )
        return self.model


@dataclass(frozen=True)
class VirtualScreen:
    """The virtual screen of Fuke et al. (2007), Fig. 6: (x, y, z) is seen at ``distance * (x, y) / z`` [m].

    Attributes:
        distance: h_z, from the optical centre to the screen [m].
        near: Depth below which nothing is seen [m].
        half_angle: Half the opening of the cone in which points are seen [rad].

    Raises:
        InvalidConfig: A distance or near plane that is not positive, or a half angle outside of (0, pi/2).
    """

    distance: float
    near: float = 0.05
    half_angle: float = math.radians(60.0)

    m = 2
    unit = "m"
    names = ("x", "y")

    def __post_init__(self) -> None:
        object.__setattr__(self, "distance", number("distance", self.distance, above=0.0))
        object.__setattr__(self, "near", number("near", self.near, above=0.0))
        half_angle = number("half_angle", self.half_angle, above=0.0, below=math.pi / 2)
        object.__setattr__(self, "half_angle", half_angle)

    def project(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 2"]:
        """Equations 18 and 19: the image [m on the screen] of points [m]; NaN where depth is not positive."""
        depth = points[..., 2:]
        # Both branches of `where` are differentiated: the unseen one must be finite as well.
        safe = torch.where(depth > 0.0, depth, 1.0)
        return torch.where(depth > 0.0, self.distance * points[..., :2] / safe, torch.nan)

    def derivative(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 2 3"]:
        """Derivative of :meth:`project`: ``h_z / z [[1, 0, -x/z], [0, 1, -y/z]]``; NaN where depth is not positive."""
        depth = points[..., 2, None, None]
        safe = torch.where(depth > 0.0, depth, 1.0)
        slope = -points[..., :2, None] / safe
        identity = torch.eye(2, dtype=points.dtype, device=points.device).expand(*points.shape[:-1], 2, 2)
        return torch.where(depth > 0.0, torch.cat([identity, slope], dim=-1) * (self.distance / safe), torch.nan)

    def visible(self, points: Float[Tensor, "*batch 3"]) -> Bool[Tensor, "*batch"]:
        """Whether points [m] are beyond the near plane and inside the cone about the camera's axis."""
        depth = points[..., 2]
        aside = torch.linalg.vector_norm(points[..., :2], dim=-1)
        return (depth >= self.near) & (aside <= depth * torch.tan(torch.tensor(self.half_angle, dtype=points.dtype)))


@dataclass(frozen=True)
class Tracker:
    """A tracker: it reports the point itself, in its own axes [m], wherever that is."""

    m = 3
    unit = "m"
    names = ("x", "y", "z")

    def project(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """The points [m]."""
        return points

    def derivative(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
        """The identity [m/m]."""
        identity = torch.eye(3, dtype=points.dtype, device=points.device)
        return identity.expand(*points.shape[:-1], 3, 3)

    def visible(self, points: Float[Tensor, "*batch 3"]) -> Bool[Tensor, "*batch"]:
        """Whether points [m] are finite."""
        return points.isfinite().all(-1)


@dataclass(frozen=True, eq=False, init=False)
class Stereo:
    """Two cameras of one mount: the image is the left one's, then the right one's.

    Attributes:
        left: The left camera's model; the mount's pose is its own.
        right: The right camera's model.
        left_T_right: (4, 4) where the right camera is in the left one's axes [m].

    Raises:
        InvalidConfig: A pose that is no rotation and translation, or two models of different units.
    """

    left: CameraModel
    right: CameraModel
    left_T_right: Float[Tensor, "4 4"]

    def __init__(self, left: CameraModel, right: CameraModel, left_T_right: ArrayLike) -> None:
        object.__setattr__(self, "left", check_model("left", left))
        object.__setattr__(self, "right", check_model("right", right))
        object.__setattr__(self, "left_T_right", torch.from_numpy(rigid("left_T_right", left_T_right)))
        if self.left.unit != self.right.unit:
            raise InvalidConfig(
                f"the left camera speaks {self.left.unit}, the right one {self.right.unit}; give two of one unit"
            )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Stereo):
            return NotImplemented
        same = self.left == other.left and self.right == other.right
        return same and torch.equal(self.left_T_right, other.left_T_right)

    def __hash__(self) -> int:
        return hash((self.left, self.right, tuple(self.left_T_right.flatten().tolist())))

    def __repr__(self) -> str:
        return f"Stereo({self.left!r}, {self.right!r})"

    @property
    def m(self) -> int:
        """Coordinates of both images."""
        return self.left.m + self.right.m

    @property
    def unit(self) -> str:
        """That of both."""
        return self.left.unit

    @property
    def names(self) -> tuple[str, ...]:
        """``left u``, ``left v``, ``right u``, ``right v``."""
        return tuple(
            f"{side} {name}" for side, model in (("left", self.left), ("right", self.right)) for name in model.names
        )

    def project(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch m"]:
        """Both images of points in the left camera's axes [m]; NaN in the one where a point has none."""
        return torch.cat([self.left.project(points), self.right.project(self._in_right(points))], dim=-1)

    def derivative(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch m 3"]:
        """Derivative of :meth:`project`; NaN in the rows of the image where a point has none."""
        right_R_left = self.left_T_right[:3, :3].T.to(points)
        return torch.cat(
            [self.left.derivative(points), self.right.derivative(self._in_right(points)) @ right_R_left], dim=-2
        )

    def visible(self, points: Float[Tensor, "*batch 3"]) -> Bool[Tensor, "*batch"]:
        """Whether both see points in the left camera's axes [m]."""
        return self.left.visible(points) & self.right.visible(self._in_right(points))

    def _in_right(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        pose = self.left_T_right.to(points)
        return (points - pose[:3, 3]) @ pose[:3, :3]


def check_model(field: str, model: object) -> CameraModel:
    """The model itself; refused if it lacks part of :class:`CameraModel`, or whose answers have other shapes.

    Args:
        field: Its name in an error.
        model: What was given.

    Raises:
        InvalidConfig: Names what is missing, or what came back.
    """
    asked = ("m", "unit", "names", "project", "derivative", "visible")
    lacking = [name for name in asked if not hasattr(model, name)] if not isinstance(model, type) else asked
    if lacking or not isinstance(model, CameraModel):
        refuse(field, model, f"an object with {', '.join(asked)}; it lacks {', '.join(lacking)}")
    m, unit, names = whole(f"{field}.m", model.m, least=1), text(f"{field}.unit", model.unit), model.names
    if not isinstance(names, tuple) or len(names) != m or not all(isinstance(name, str) for name in names):
        refuse(f"{field}.names", names, f"a tuple of {m} names")
    ahead = torch.tensor([[0.0, 0.0, 1.0], [0.01, -0.01, 2.0]], dtype=torch.float64)
    wanted = {"project": (2, m), "derivative": (2, m, 3), "visible": (2,)}
    for name, shape in wanted.items():
        found = getattr(model, name)(ahead)
        if not isinstance(found, Tensor) or tuple(found.shape) != shape:
            came = tuple(found.shape) if isinstance(found, Tensor) else type(found).__name__
            raise InvalidConfig(f"{field}.{name}: of points (2, 3) comes {came}; give a tensor {shape} [{unit}]")
    return model
