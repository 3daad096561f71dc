"""What a body's eye sees of its hand: places in the camera, images, how they move, and what hides the hand."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike, as_float_tensor, as_postures, refuse_not_finite
from bodyimage_kin._checks import choice
from bodyimage_kin.backends import RobotKinematics, somebody_differentiates
from bodyimage_kin.body._places import Places
from bodyimage_kin.body._sight import Seen, Sight
from bodyimage_kin.body.cameras import Camera, VirtualScreen
from bodyimage_kin.body.hand import Hand
from bodyimage_kin.body.skin import Skin
from bodyimage_kin.errors import InvalidArray, NoSkin, NotVisible
from bodyimage_kin.robot import Robot, shapes


@dataclass(frozen=True, eq=False)
class SeeingBody:
    """The parts of a body, and what its eye sees. :class:`bodyimage_kin.Embodiment` says what they are."""

    name: str
    robot: Robot
    joints: tuple[str, ...]
    hand: Hand
    camera: Camera
    skin: Skin | None
    home: Float[Tensor, "n"]
    kinematics: RobotKinematics

    @property
    def felt_robot(self) -> Robot:
        """The smaller robot that moves hand, camera and skin by the felt joints alone."""
        return self.kinematics.robot

    @property
    def p(self) -> int:
        """Number of felt joints."""
        return len(self.joints)

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return self.camera.model.m

    @cached_property
    def felt_home(self) -> Float[Tensor, "p"]:
        """The home posture's felt joints."""
        return self.home[self._columns]

    @cached_property
    def _places(self) -> Places:
        return Places(self.kinematics, self.felt_home)

    @cached_property
    def _columns(self) -> Tensor:
        return torch.tensor([self.robot.joint_index(name) for name in self.joints], dtype=torch.long)

    def require_skin(self) -> Skin:
        """The skin, for what needs one.

        Raises:
            NoSkin: There is none.
        """
        if self.skin is None:
            raise NoSkin(self.name)
        return self.skin

    def full_posture(self, q: ArrayLike) -> Float[Tensor, "*batch n"]:
        """Postures of the whole robot, the joints that are not felt at home.

        Raises:
            InvalidPosture: The last axis is not of the p felt joints.
        """
        felt = as_postures(q, self.p)
        home = self.home.to(felt).expand(*felt.shape[:-1], self.robot.n)
        return home.index_copy(-1, self._columns, felt)

    # What the eye sees -----------------------------------------------------------------------------------------------

    def hand_position(self, q: ArrayLike, hand_offset: ArrayLike | None = None) -> Float[Tensor, "*batch 3"]:
        """The hand's centre in the root [m].

        Args:
            q: Postures ``(*batch, p)``.
            hand_offset: As in :meth:`hand_image`.

        Raises:
            InvalidPosture: As in :meth:`hand_image`.
            InvalidArray: As in :meth:`hand_image`.
        """
        q = as_postures(q, self.p)
        position, _, _ = self._places.point(q, self.hand.link, self._offset(q, hand_offset))
        return position

    def hand_in_camera(self, q: ArrayLike, hand_offset: ArrayLike | None = None) -> Float[Tensor, "*batch 3"]:
        """The hand's centre in the camera's axes [m]: ``c = R (p_h - p_c)`` (equation 17).

        Args:
            q: Postures ``(*batch, p)``.
            hand_offset: As in :meth:`hand_image`.

        Raises:
            InvalidPosture: As in :meth:`hand_image`.
            InvalidArray: As in :meth:`hand_image`.
        """
        q = as_postures(q, self.p)
        hand, _, _ = self._places.point(q, self.hand.link, self._offset(q, hand_offset))
        camera, root_R_camera, _ = self._camera(q)
        return (root_R_camera.transpose(-1, -2) @ (hand - camera)[..., None])[..., 0]

    def hand_image(
        self,
        q: ArrayLike,
        hand_offset: ArrayLike | None = None,
        on_invisible: Literal["raise", "nan"] | str = "raise",
    ) -> Float[Tensor, "*batch m"]:
        """What the camera reports of the hand, in its unit, differentiable (equations 6 and 17 to 19).

        Args:
            q: Postures ``(*batch, p)``.
            hand_offset: Another point that is observed in place of the hand's centre, (3,) or ``(*batch, 3)`` in the
                hand's link [m]; None: the hand's centre.
            on_invisible: What happens when the hand has no image: it is not in front of the camera plane (z <= 0), or
                so far aside that the lens' distortion has turned back.

        Raises:
            NotVisible: No image, with ``on_invisible="raise"``.
            InvalidPosture: Wrong last axis, dtype, or a value that is not finite.
            InvalidArray: A ``hand_offset`` of another shape, or not finite.
        """
        choice("on_invisible", on_invisible, ("raise", "nan"))
        q = as_postures(q, self.p)
        if (seen := self._seen(q, hand_offset, with_jacobian=False)) is not None:
            self._told(seen.none, on_invisible)
            return seen.image
        image = self.camera.model.project(self.hand_in_camera(q, hand_offset))
        if on_invisible == "raise":
            self._told(image.isnan().any(-1), on_invisible)
        return image

    def hand_image_jacobian(
        self,
        q: ArrayLike,
        hand_offset: ArrayLike | None = None,
        on_invisible: Literal["raise", "nan"] | str = "raise",
    ) -> Float[Tensor, "*batch m p"]:
        """How the hand image moves with the felt joints [unit of the image/rad]: the analytic truth.

        With everything in the root's axes, hand point p_h and camera at p_c::

            dc = R (J_vh - [R_link o]x J_wh - J_vc + [p_h - p_c]x J_wc) dq

        and then the derivative of the camera's projection; of the virtual screen it is
        ``h_z/z [[1, 0, -x/z], [0, 1, -y/z]]``.

        Args:
            q: Postures ``(*batch, p)``.
            hand_offset: As in :meth:`hand_image`; fixed in the hand's link.
            on_invisible: As in :meth:`hand_image`.

        Raises:
            NotVisible: As in :meth:`hand_image`.
            InvalidPosture: As in :meth:`hand_image`.
            InvalidArray: As in :meth:`hand_image`.
        """
        choice("on_invisible", on_invisible, ("raise", "nan"))
        q = as_postures(q, self.p)
        if (seen := self._seen(q, hand_offset, with_jacobian=True)) is not None:
            self._told(seen.none, on_invisible)
            return seen.jacobian
        hand, _, hand_jacobian = self._places.point(q, self.hand.link, self._offset(q, hand_offset))
        camera, root_R_camera, camera_jacobian = self._camera(q)
        away = hand - camera
        camera_R_root = root_R_camera.transpose(-1, -2)
        point = (camera_R_root @ away[..., None])[..., 0]
        linear, angular = camera_jacobian[..., :3, :], camera_jacobian[..., 3:, :]
        turned = torch.linalg.cross(away[..., None].expand_as(angular), angular, dim=-2)
        moved = camera_R_root @ (hand_jacobian[..., :3, :] - linear + turned)
        jacobian = self.camera.model.derivative(point) @ moved
        if on_invisible == "raise":
            self._told(jacobian.isnan().flatten(-2).any(-1), on_invisible)
        return jacobian

    def visible(self, q: ArrayLike, hand_offset: ArrayLike | None = None) -> Bool[Tensor, "*batch"]:
        """Whether the eye sees the hand.

        The camera's model says so (a virtual screen: the hand's centre is beyond the near plane, inside the cone about
        the camera's axis), and, of a body with a skin, the segment from the eye (the landmark on the skin, or the
        optical centre where the skin names none) to the hand does not pass through the shapes of the skin's link.

        Args:
            q: Postures ``(*batch, p)``.
            hand_offset: As in :meth:`hand_image`.

        Raises:
            InvalidPosture: As in :meth:`hand_image`.
            InvalidArray: As in :meth:`hand_image`.
        """
        q = as_postures(q, self.p)
        with torch.no_grad():
            in_view = self.camera.model.visible(self.hand_in_camera(q, hand_offset))
            if self.skin is None:
                return in_view
            in_skin = self.hand_in_skin(q, hand_offset).reshape(-1, 3).to(torch.float64).numpy()
            if self.skin.eye is None:
                eye = self._in_link(q, self._camera(q)[0], self.skin.link).reshape(-1, 3).to(torch.float64).numpy()
            else:
                eye = np.broadcast_to(self.skin.link_positions[self.skin.eye], in_skin.shape)
        hidden = torch.from_numpy(shapes.blocked(self.skin.surface or (), eye, in_skin))
        return in_view & ~hidden.reshape(in_view.shape)

    def hand_in_skin(self, q: ArrayLike, hand_offset: ArrayLike | None = None) -> Float[Tensor, "*batch 3"]:
        """The hand's centre in the axes of the skin's link [m].

        Args:
            q: Postures ``(*batch, p)``.
            hand_offset: As in :meth:`hand_image`.

        Raises:
            NoSkin: The body has none.
            InvalidPosture: As in :meth:`hand_image`.
            InvalidArray: As in :meth:`hand_image`.
        """
        link = self.require_skin().link
        q = as_postures(q, self.p)
        hand, _, _ = self._places.point(q, self.hand.link, self._offset(q, hand_offset))
        return self._in_link(q, hand, link)

    # Inner -----------------------------------------------------------------------------------------------------------

    def _in_link(
        self, q: Float[Tensor, "*batch p"], points: Float[Tensor, "*batch 3"], link: str
    ) -> Float[Tensor, "*batch 3"]:
        """Points of the root in the axes of a link [m]."""
        pose, _ = self._places.pose_and_jacobian(q, link)
        return (pose[..., :3, :3].transpose(-1, -2) @ (points - pose[..., :3, 3])[..., None])[..., 0]

    def _camera(
        self, q: ArrayLike
    ) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch 3 3"], Float[Tensor, "*batch 6 p"]]:
        """The optical centre and the camera's orientation in the root, and the centre's Jacobian."""
        position, rotation, jacobian = self._places.point(q, self.camera.link, self.camera.link_T_camera[:3, 3])
        return position, rotation @ self.camera.link_T_camera[:3, :3].to(rotation), jacobian

    def _offset(self, q: Float[Tensor, "*batch p"], hand_offset: ArrayLike | None) -> Float[Tensor, "*given 3"]:
        """The observed point in the hand's link, (3,) or one a posture."""
        if hand_offset is None:
            return self.hand.offset
        offset = as_float_tensor(hand_offset, "hand_offset").to(q)
        if tuple(offset.shape) not in ((3,), (*q.shape[:-1], 3)):
            raise InvalidArray(
                f"hand_offset has shape {tuple(offset.shape)}; give (3,), or one for each of the postures "
                f"{tuple(q.shape[:-1])}: {(*q.shape[:-1], 3)}"
            )
        refuse_not_finite(offset, "hand_offset", InvalidArray)
        return offset

    @cached_property
    def _sight(self) -> Sight | None:
        return Sight.of(self.kinematics, self.hand.link, self.hand.offset, self.camera)

    def _seen(self, q: Float[Tensor, "*batch p"], hand_offset: ArrayLike | None, with_jacobian: bool) -> Seen | None:
        """What the camera reports, in one go, where nobody differentiates it."""
        if self._sight is None or not q.is_cpu or somebody_differentiates(q):
            return None
        offsets = None
        if hand_offset is not None:
            offset = self._offset(q, hand_offset)
            if somebody_differentiates(offset):
                return None
            offsets = offset.detach().to(torch.float64).expand(*q.shape[:-1], 3).reshape(-1, 3)
        flat = q.detach().reshape(-1, self.p).to(torch.float64)
        image, none, jacobian = self._sight(flat, offsets, with_jacobian)
        batch = q.shape[:-1]
        return Seen(
            image.to(q.dtype).reshape(*batch, image.shape[-1]),
            none.reshape(batch),
            jacobian.to(q.dtype).reshape(*batch, *jacobian.shape[1:]),
        )

    def _told(self, none: Bool[Tensor, "*batch"], on_invisible: str) -> None:
        if on_invisible == "raise" and bool(none.any()):
            lens = "" if isinstance(self.camera.model, VirtualScreen) else ", or beyond what its model can show,"
            raise NotVisible(
                f"the hand is behind the camera plane{lens} in {int(none.sum())} of {none.numel()} postures and has no "
                "image there; leave these out, or ask for on_invisible='nan'"
            )
