"""Where the hand is seen and how motion moves its image, in one compiled go, where the backend has such a thing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from bodyimage_kin.backends import RobotKinematics
from bodyimage_kin.body.cameras import Camera, CameraModel, Stereo, Tracker, VirtualScreen
from bodyimage_kin.body.pinhole import Pinhole

if TYPE_CHECKING:
    from bodyimage_kin.backends.numba_backend import HandImage


class Seen(NamedTuple):
    """What a camera reports of the hand.

    Attributes:
        image: (batch, m) in the camera's unit; NaN where there is none.
        none: (batch,) whether a part of the image is missing.
        jacobian: (batch, m, p) of the image; NaN where there is none.
    """

    image: Float[Tensor, "batch m"]
    none: Bool[Tensor, "batch"]
    jacobian: Float[Tensor, "batch m p"]


class Sight(NamedTuple):
    """The compiled chain from camera to hand, and what projects behind it.

    Attributes:
        chain: Gives the image where the model's formula is compiled, else the hand in the camera's axes; None for two
            cameras of one mount.
        model: The camera's.
        both: The sights of two cameras of one mount.
    """

    chain: HandImage | None
    model: CameraModel
    both: tuple[Sight, ...] = ()

    @classmethod
    def of(cls, kinematics: RobotKinematics, link: str, offset: Float[Tensor, "3"], camera: Camera) -> Sight | None:
        """The sight of a hand; None where the backend has no such thing.

        Args:
            kinematics: Of the felt robot.
            link: The hand's.
            offset: The hand's centre in its link [m].
            camera: What looks.
        """
        backend: Any = kinematics.backend
        if not hasattr(backend, "hand_image") or backend.robot is not kinematics.robot:
            return None
        model = camera.model
        if type(model) is Stereo:
            mounts = camera.link_T_camera, camera.link_T_camera @ model.left_T_right
            sides = (
                cls.of(kinematics, link, offset, Camera(camera.link, mount, side))
                for mount, side in zip(mounts, (model.left, model.right), strict=True)
            )
            return cls(None, model, tuple(side for side in sides if side is not None))
        chain = backend.hand_image(link, offset.tolist(), camera.link, camera.link_T_camera.numpy(), _lens(model))
        return cls(chain, model)

    def __call__(
        self, q: Float[Tensor, "batch p"], offsets: Float[Tensor, "batch 3"] | None, with_jacobian: bool
    ) -> Seen:
        """What the camera reports at postures, without a gradient.

        Args:
            q: Postures, float64.
            offsets: The observed point of each, in the hand's link [m]; None: the hand's centre.
            with_jacobian: Whether the Jacobian is wanted; if not, it may mean nothing.
        """
        if self.chain is None:
            left, right = (side(q, offsets, with_jacobian) for side in self.both)
            image, jacobian = torch.cat([left.image, right.image], 1), torch.cat([left.jacobian, right.jacobian], 1)
            return Seen(image, left.none | right.none, jacobian)
        image, depth, jacobian = self.chain.image_and_jacobian(q, offsets=offsets)
        if type(self.model) in (VirtualScreen, Pinhole):
            none = depth <= 0.0 if type(self.model) is VirtualScreen else image[:, 0].isnan()
            if bool(none.any()):
                image[none] = torch.nan
                jacobian[none] = torch.nan
            return Seen(image, none, jacobian)
        if type(self.model) is Tracker:
            return Seen(image, torch.zeros_like(depth, dtype=torch.bool), jacobian)
        with torch.no_grad():
            point, image = image, self.model.project(image)
            jacobian = self.model.derivative(point) @ jacobian if with_jacobian else jacobian
        return Seen(image, image.isnan().any(-1), jacobian)


def _lens(model: CameraModel) -> tuple[float, ...]:
    """A model's numbers, as the compiled chain takes them; none of a model that it does not know."""
    if type(model) is VirtualScreen:
        return (model.distance,)
    if type(model) is Pinhole:
        return (model.fx, model.fy, model.cx, model.cy, *model.distortion, model.fold**2)
    return ()
