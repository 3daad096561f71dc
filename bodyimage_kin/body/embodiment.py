"""An embodiment: a robot, the joints it feels, its hand, its camera, its skin and its home posture.

Everything a study asks about the body in terms of felt joints is answered here: where the hand's image is, how it moves
with the joints (the analytic truth, right also when the camera is carried by a felt joint), and which postures touch a
taxel.
"""

from __future__ import annotations

import hashlib
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
from bodyimage_kin.body import reach
from bodyimage_kin.body._reach_kernels import point_in_frame
from bodyimage_kin.body._sight import Seen, Sight
from bodyimage_kin.body.cameras import Camera, VirtualScreen
from bodyimage_kin.body.skin import Skin
from bodyimage_kin.errors import (
    InvalidArray,
    InvalidConfig,
    InvalidPosture,
    NoSkin,
    NotVisible,
    UnknownName,
    Unreachable,
)
from bodyimage_kin.robot import Robot, shapes


@dataclass(frozen=True, eq=False)
class Hand:
    """A spherical hand on a link.

    Attributes:
        link: The link that carries it.
        offset: (3,) its centre, in the link [m].
        radius: [m].
    """

    link: str
    offset: Float[Tensor, "3"]
    radius: float


@dataclass(frozen=True, eq=False)
class Embodiment:
    """A body that feels p of its robot's joints. Load one with :func:`load_embodiment`.

    Unless said otherwise, postures are of the felt joints, ``(*batch, p)``; the other joints stay at home.

    Attributes:
        name: The embodiment's name.
        robot: The whole robot.
        joints: The p felt joints, in the robot's order.
        hand: The hand that is seen and that touches.
        camera: The eye that sees it.
        skin: The taxels it touches; None: none.
        home: (n,) rest posture of the whole robot.
        kinematics: Of ``felt_robot``, by the chosen backend.
        source: The configuration it was made from.
    """

    name: str
    robot: Robot
    joints: tuple[str, ...]
    hand: Hand
    camera: Camera
    skin: Skin | None
    home: Float[Tensor, "n"]
    kinematics: RobotKinematics
    source: bytes

    def __repr__(self) -> str:
        return f"Embodiment({self.name!r}, robot={self.robot.name!r}, joints={self.joints})"

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
    def sha256(self) -> str:
        """Hash of the configuration and of the robot's source, hexadecimal."""
        return hashlib.sha256(self.source + self.robot.source).hexdigest()

    @cached_property
    def _fixed_poses(self) -> dict[str, Tensor | None]:
        return {}

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
        position, _, _ = self._point(q, self.hand.link, self._offset(q, hand_offset))
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
        hand, _, _ = self._point(q, self.hand.link, self._offset(q, hand_offset))
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
        hand, _, hand_jacobian = self._point(q, self.hand.link, self._offset(q, hand_offset))
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
        the camera's axis), and, of a body with a skin, the segment from the eye (the landmark on the skin) to the hand
        does not pass through the shapes of the skin's link.

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
        eye = np.broadcast_to(self.skin.link_positions[self.skin.eye], in_skin.shape)
        hidden = torch.from_numpy(shapes.blocked(self.skin.shapes, eye, in_skin))
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
        hand, _, _ = self._point(q, self.hand.link, self._offset(q, hand_offset))
        skin, _ = self._pose_and_jacobian(q, link)
        return (skin[..., :3, :3].transpose(-1, -2) @ (hand - skin[..., :3, 3])[..., None])[..., 0]

    # What the hand reaches -------------------------------------------------------------------------------------------

    def touch_centres(self, taxels: ArrayLike, distance: float = 0.0) -> Float[Tensor, "count 3"]:
        """Where the hand's centre touches taxels, or is ``distance`` [m] in front of that, in the skin's link [m]."""
        skin = self.require_skin()
        indices = np.atleast_1d(np.asarray(taxels))
        if indices.dtype.kind not in "iu" or indices.ndim != 1:
            raise InvalidConfig("taxels must be a list of whole numbers")
        if indices.size and not (indices.min() >= 0 and indices.max() < skin.count):
            raise UnknownName(
                "taxel", int(indices[(indices < 0) | (indices >= skin.count)][0]), [f"0 to {skin.count - 1}"]
            )
        surface, normals = skin.link_positions[indices], skin.link_normals[indices]
        return torch.from_numpy(surface + self.hand.radius * normals + distance * skin.patch.forward)

    def touch_postures(self, taxels: ArrayLike, distance: float = 0.0) -> Float[Tensor, "count p"]:
        """Postures in which the hand touches taxels, displaced least from home, within the joint limits.

        Args:
            taxels: Taxel numbers.
            distance: How far in front of touching, along the patch's forward direction [m].

        Raises:
            Unreachable: Taxels that no posture within the limits touches; names them.
            UnknownName: A taxel that does not exist.
        """
        centres = self.touch_centres(taxels, distance)
        q, reached = self.reach(centres)
        if not bool(reached.all()):
            missed = np.atleast_1d(np.asarray(taxels))[~reached.numpy()].tolist()
            place = f"{distance} m in front of " if distance else ""
            raise Unreachable(
                f"the hand cannot reach {place}taxels {missed[:10]}{' ...' if len(missed) > 10 else ''} "
                f"({len(missed)} of {len(centres)}) within the joint limits",
                missed,
            )
        return q

    def reach(self, centres: Float[Tensor, "count 3"]) -> tuple[Float[Tensor, "count p"], Bool[Tensor, "count"]]:
        """Postures that bring the hand's centre to points given in the skin's link [m], displaced least from home.

        Returns:
            Postures, and whether each gets there (to a nanometre).
        """
        return reach.least_displacement(
            self.hand_in_skin_and_jacobian, centres, self.felt_home, self.felt_robot.lower, self.felt_robot.upper
        )

    def hand_in_skin_and_jacobian(
        self, q: Float[Tensor, "*batch p"]
    ) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch 3 p"]]:
        """The hand's centre in the axes of the skin's link [m], and its derivative [m/rad], without gradient."""
        flat = q.detach().reshape(-1, self.p).to("cpu", torch.float64)
        pose, jacobian = self._pose_and_jacobian(flat, self.hand.link)
        frame, frame_jacobian = self._skin_frame or tuple(
            part.numpy() for part in self._pose_and_jacobian(flat, self.require_skin().link)
        )
        position, moved = flat.new_empty(len(flat), 3), flat.new_empty(len(flat), 3, self.p)
        point_in_frame(
            pose.contiguous().numpy(), jacobian.contiguous().numpy(), self.hand.offset.numpy(), frame, frame_jacobian,
            position.numpy(), moved.numpy(),
        )  # fmt: skip
        return position.to(q).reshape(*q.shape[:-1], 3), moved.to(q).reshape(*q.shape[:-1], 3, self.p)

    @cached_property
    def _skin_frame(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Pose and Jacobian of the skin's link, one for all postures; None where a felt joint moves it."""
        fixed = self._fixed_pose(self.require_skin().link)
        return None if fixed is None else (fixed[None].numpy(), np.zeros((1, 6, self.p)))

    # Inner -----------------------------------------------------------------------------------------------------------

    def _pose_and_jacobian(
        self, q: Float[Tensor, "*batch p"], link: str
    ) -> tuple[Float[Tensor, "*batch 4 4"], Float[Tensor, "*batch 6 p"]]:
        """Of a link."""
        fixed = self._fixed_pose(link)
        if fixed is None:
            return self.kinematics.pose_and_jacobian(q, link)
        batch = q.shape[:-1]
        return fixed.to(q).expand(*batch, 4, 4), q.new_zeros(()).expand(*batch, 6, self.p)

    def _fixed_pose(self, link: str) -> Float[Tensor, "4 4"] | None:
        """Of a link that no felt joint moves, computed once; None of one that moves."""
        if link not in self._fixed_poses:
            moves = any(joint.kind != "fixed" for joint in self.felt_robot.path(link))
            self._fixed_poses[link] = None if moves else self.kinematics.pose(self.felt_home, link)
        return self._fixed_poses[link]

    def _point(
        self, q: ArrayLike, link: str, offset: Float[Tensor, "*given 3"]
    ) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch 3 3"], Float[Tensor, "*batch 6 p"]]:
        """A point fixed in a link: its position and the link's orientation in the root, and the point's Jacobian."""
        pose, jacobian = self._pose_and_jacobian(as_postures(q, self.p), link)
        rotation = pose[..., :3, :3]
        arm = (rotation @ offset.to(pose)[..., None])[..., 0]
        linear, angular = jacobian[..., :3, :], jacobian[..., 3:, :]
        moved = linear - torch.linalg.cross(arm[..., None].expand_as(angular), angular, dim=-2)
        return pose[..., :3, 3] + arm, rotation, torch.cat([moved, angular], dim=-2)

    def _camera(
        self, q: ArrayLike
    ) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch 3 3"], Float[Tensor, "*batch 6 p"]]:
        """The optical centre and the camera's orientation in the root, and the centre's Jacobian."""
        position, rotation, jacobian = self._point(q, self.camera.link, self.camera.link_T_camera[:3, 3])
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

    def check_felt(self, q: ArrayLike) -> Float[Tensor, "*batch p"]:
        """Postures of the felt joints, checked to lie within the joint limits (to a nanoradian).

        Raises:
            InvalidPosture: A joint beyond its limits; names it.
        """
        felt = as_postures(as_float_tensor(q), self.p)
        beyond = (felt < self.felt_robot.lower - 1e-9) | (felt > self.felt_robot.upper + 1e-9)
        if bool(beyond.any()):
            joint = self.joints[int(beyond.reshape(-1, self.p).any(0).to(torch.int8).argmax())]
            raise InvalidPosture(f"joint '{joint}' is beyond its limits")
        return felt
