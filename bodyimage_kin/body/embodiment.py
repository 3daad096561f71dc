"""An embodiment: a robot, the joints it feels, its hand, its camera, its skin (or none) and its home posture.

Everything a study asks about the body in terms of felt joints is answered here: where the hand's image is, how it moves
with the joints (the analytic truth, right also when the camera is carried by a felt joint), and which postures touch a
taxel.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike, as_float_tensor, as_postures
from bodyimage_kin._checks import number, text
from bodyimage_kin._shown import table
from bodyimage_kin.backends import Kinematics, backends, kinematics
from bodyimage_kin.body import reach
from bodyimage_kin.body._build import Mistakes, check_parts, put_together
from bodyimage_kin.body._description import describe
from bodyimage_kin.body._reach_kernels import point_in_frame
from bodyimage_kin.body._seeing import SeeingBody
from bodyimage_kin.body.cameras import Camera
from bodyimage_kin.body.hand import Hand
from bodyimage_kin.body.skin import Skin
from bodyimage_kin.errors import InvalidConfig, InvalidPosture, UnknownName, Unreachable
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.geometry import Mesh

__all__ = ["Embodiment", "Frame"]

_LIST = re.compile(r"\[\n(?:[^\[\]\n]*,\n|\s*\[[^\[\]\n]*\],\n)+\s*\]")
_WIDTH = 100


class Frame(NamedTuple):
    """A place and directions in the axes of a link, where a motion takes place.

    Attributes:
        origin: (3,) [m].
        right: (3,) unit vector, to the right as the eye sees it.
        down: (3,) unit vector.
        forward: (3,) unit vector, away from what is behind the motion: out of the face, or along the camera's axis.
    """

    origin: Float[np.ndarray, "3"]
    right: Float[np.ndarray, "3"]
    down: Float[np.ndarray, "3"]
    forward: Float[np.ndarray, "3"]


@dataclass(frozen=True, eq=False)
class Embodiment(SeeingBody):
    """A body that feels p of its robot's joints. Put one together with :meth:`build`, or load one from its file.

    Unless said otherwise, postures are of the felt joints, ``(*batch, p)``; the other joints stay at home. Two bodies
    are equal when their parts and their backends are, wherever they came from.

    Attributes:
        name: The embodiment's name.
        robot: The whole robot.
        joints: The p felt joints, in the order they were given: that of every posture, Jacobian and recording.
        hand: The hand that is seen and that touches.
        camera: The eye that sees it.
        skin: The taxels it touches; None: none.
        home: (n,) rest posture of the whole robot.
        kinematics: Of ``felt_robot``, by the chosen backend.
    """

    @classmethod
    def build(
        cls,
        robot: Robot,
        *,
        joints: Sequence[str],
        hand: Hand,
        camera: Camera,
        skin: Skin | None = None,
        home: Mapping[str, float] | ArrayLike | None = None,
        name: str | None = None,
        backend: str | Kinematics | type | None = None,
    ) -> Embodiment:
        """A body put together in code.

        Args:
            robot: The whole robot.
            joints: The joints it feels; their order is that of every posture, Jacobian and recording.
            hand: On a link of the robot.
            camera: On a link: the root of a camera that stands in the world, a link of the arm for an eye in hand.
            skin: On a link, such as ``bk.Skin.grid(...)`` or ``bk.Skin.points(...)``; None: none.
            home: Rest posture, by name [rad or m] or as (n,); joints not named are at 0, or at the limit next to it.
            name: The embodiment's name; None: the robot's.
            backend: As in :func:`bodyimage_kin.kinematics`.

        Raises:
            UnknownName: A joint or link that the robot does not have.
            InvalidConfig: A joint that is fixed, follows another or stands twice, or a home beyond the limits.
            ManyMistakes: Several such things, all told at once.
        """
        for what, part, kind in (("robot", robot, Robot), ("hand", hand, Hand), ("camera", camera, Camera)):
            if not isinstance(part, kind):
                raise InvalidConfig(f"{what} is {type(part).__name__}; give a bk.{kind.__name__}")
        called = text("name", robot.name if name is None else name)
        mistakes = Mistakes(f"embodiment '{called}'")
        links = {"hand": hand.link, "camera": camera.link} | ({} if skin is None else {"skin": skin.link})
        felt, posture = check_parts(mistakes, robot, joints, links, home)
        mistakes.tell()
        built = put_together(robot, felt, list(links.values()), posture, backend)
        body = cls(called, robot, felt, hand, camera, None, posture, built)
        return body if skin is None else replace(body, skin=skin.borne_by(robot, built.pose(body.felt_home, skin.link)))

    def __repr__(self) -> str:
        skin = "no skin" if self.skin is None else f"{self.skin.count} taxels on '{self.skin.link}'"
        model = type(self.camera.model).__name__
        return (
            f"Embodiment({self.name!r}: feels {self.p} of {self.robot.n} joints, hand '{self.hand.link}', "
            f"{model} on '{self.camera.link}', {skin})"
        )

    def _repr_html_(self) -> str:
        """The same for notebooks: a table of the parts."""
        model = self.camera.model
        skin = "none" if self.skin is None else f"{self.skin.count} taxels on {self.skin.link}"
        rows = {
            "robot": f"{self.robot.name}, {self.robot.n} joints, {len(self.robot.link_names)} links",
            "feels": ", ".join(self.joints),
            "hand": f"{self.hand.link}, {tuple(self.hand.offset.tolist())} m, radius {self.hand.radius:g} m",
            "camera": f"{model!r} on {self.camera.link}: {', '.join(model.names)} [{model.unit}]",
            "skin": skin,
            "sha256": self.sha256[:12],
        }
        return table(self.name, "an embodiment", rows)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Embodiment):
            return NotImplemented
        if self is other:
            return True
        # Two backends differ in the last bits, and what is kept for a body is kept for its equals.
        same = self.sha256 == other.sha256 and self.kinematics.name == other.kinematics.name
        return same and self.camera == other.camera

    def __hash__(self) -> int:
        return int(self.sha256[:15], 16)

    def __getstate__(self) -> dict[str, Any]:
        """Fields alone; kinematics by the name of its backend, as what libraries hold cannot always be copied."""
        state = {field.name: getattr(self, field.name) for field in fields(self)}
        if self.kinematics.name in backends() or ":" in self.kinematics.name:
            state["kinematics"] = (self.kinematics.robot, self.kinematics.name)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        if isinstance(state["kinematics"], tuple):
            state = state | {"kinematics": kinematics(*state["kinematics"])}
        self.__dict__.update(state)

    @cached_property
    def sha256(self) -> str:
        """Hash of the robot's source and of everything else the body is made of, hexadecimal."""
        told = json.dumps(describe(self, strict=False), sort_keys=True)
        return hashlib.sha256(f"{self.robot.sha256}\n{told}".encode()).hexdigest()

    def to_toml(self, urdf: str | None = None) -> str:
        """The body as the text of a TOML file, from which :func:`bodyimage_kin.load_embodiment` builds an equal one.

        Args:
            urdf: Where the robot's file is, as seen from the TOML's folder; None: where the robot was read from, or
                NAME.urdf of one that was not read from a file.

        Raises:
            InvalidConfig: A camera model of one's own that holds more than plain values.
        """
        tables = describe(self)
        place = urdf or (f"{self.name}.urdf" if self.robot.file is None else str(self.robot.file))
        told = {"name": tables.pop("name"), "urdf": place, **self._meshes(urdf), **tables}
        return _short_lists_in_one_line(tomli_w.dumps(told))

    def _meshes(self, urdf: str | None) -> dict[str, str]:
        """Where a file tells meshes to lie: as the robot says, or where they lay beside a URDF that is written anew."""
        robot = self.robot
        if robot.mesh_folder is not None:
            return {"mesh_folder": robot.mesh_folder.absolute().as_posix()}
        moved = urdf is not None and robot.file is not None and Path(urdf).name != robot.file.name
        shapes = [one.shape for part in robot.geometry.values() for one in part.visuals]
        shapes += [one.shape for part in robot.geometry.values() for one in part.collisions]
        if not moved or robot.file is None or not any(isinstance(shape, Mesh) for shape in shapes):
            return {}
        return {"mesh_folder": robot.file.absolute().parent.as_posix()}

    def save(self, path: str | Path) -> Path:
        """Writes the body as a TOML file; beside it the robot's URDF where it has no file of its own.

        Args:
            path: Name of the file, ending in ``.toml``.

        Returns:
            The path.

        Raises:
            InvalidConfig: As :meth:`to_toml`, or another ending.
        """
        from bodyimage_kin.body.file import save_embodiment

        return save_embodiment(self, path)

    # What the hand reaches -------------------------------------------------------------------------------------------

    @property
    def front_link(self) -> str:
        """The link in whose axes the hand is led: the skin's; of a body without skin, the camera's."""
        return self.camera.link if self.skin is None else self.skin.link

    def circle_frame(self, distance: float) -> Frame:
        """Where a frontal circle has its centre, in the axes of :attr:`front_link`.

        Of a body with a skin it is where the hand is in front of the middle taxel, facing it; of one without, on the
        camera's axis.

        Args:
            distance: In front of touching, along the skin's forward direction; or the depth in front of the camera,
                which must then be above 0 [m].

        Raises:
            InvalidConfig: No number, or no depth.
        """
        if self.skin is not None:
            skin = self.skin
            centre = self.touch_centres([skin.middle], distance)[0].numpy()
            return Frame(centre, skin.right, skin.down, np.asarray(skin.forward))
        depth = number(
            f"embodiment '{self.name}' has no skin, so that a circle stands in front of its camera; distance",
            distance,
            above=0.0,
        )
        right, down, forward, origin = self.camera.link_T_camera[:3].numpy().T
        return Frame(origin + depth * forward, right, down, forward)

    def touch_centres(self, taxels: ArrayLike, distance: float = 0.0) -> Float[Tensor, "count 3"]:
        """Where the hand's centre touches taxels, or is ``distance`` [m] in front of that, in the skin's link [m].

        Raises:
            NoSkin: The body has none.
            UnknownName: A taxel that does not exist.
        """
        skin = self.require_skin()
        indices = np.atleast_1d(np.asarray(taxels))
        if indices.dtype.kind not in "iu" or indices.ndim != 1:
            raise InvalidConfig("taxels must be a list of whole numbers")
        if indices.size and not (indices.min() >= 0 and indices.max() < skin.count):
            raise UnknownName(
                "taxel", int(indices[(indices < 0) | (indices >= skin.count)][0]), [f"0 to {skin.count - 1}"]
            )
        surface, normals = skin.link_positions[indices], skin.link_normals[indices]
        return torch.from_numpy(surface + self.hand.radius * normals + distance * skin.forward)

    def touch_postures(self, taxels: ArrayLike, distance: float = 0.0) -> Float[Tensor, "count p"]:
        """Postures in which the hand touches taxels, displaced least from home, within the joint limits.

        Args:
            taxels: Taxel numbers.
            distance: How far in front of touching, along the skin's forward direction [m].

        Raises:
            NoSkin: The body has none.
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
        """Postures that bring the hand's centre to points given in :attr:`front_link` [m], displaced least from home.

        Returns:
            Postures, and whether each gets there (to a nanometre).
        """
        return reach.least_displacement(
            self.hand_in_front_and_jacobian, centres, self.felt_home, self.felt_robot.lower, self.felt_robot.upper
        )

    def hand_in_front_and_jacobian(
        self, q: Float[Tensor, "*batch p"]
    ) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch 3 p"]]:
        """The hand's centre in the axes of :attr:`front_link` [m], and its derivative [m/rad], without gradient."""
        flat = q.detach().reshape(-1, self.p).to("cpu", torch.float64)
        pose, jacobian = self._places.pose_and_jacobian(flat, self.hand.link)
        frame, frame_jacobian = self._front_frame or tuple(
            part.numpy() for part in self._places.pose_and_jacobian(flat, self.front_link)
        )
        position, moved = flat.new_empty(len(flat), 3), flat.new_empty(len(flat), 3, self.p)
        point_in_frame(
            pose.contiguous().numpy(), jacobian.contiguous().numpy(), self.hand.offset.numpy(), frame, frame_jacobian,
            position.numpy(), moved.numpy(),
        )  # fmt: skip
        return position.to(q).reshape(*q.shape[:-1], 3), moved.to(q).reshape(*q.shape[:-1], 3, self.p)

    @cached_property
    def _front_frame(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Pose and Jacobian of the link in front, one for all postures; None where a felt joint moves it."""
        fixed = self._places.fixed_pose(self.front_link)
        return None if fixed is None else (fixed[None].numpy(), np.zeros((1, 6, self.p)))

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


def _short_lists_in_one_line(toml: str) -> str:
    """The same TOML as a person would write it; texts with a bracket or a line's end in them are left alone."""
    return _LIST.sub(lambda found: _one_line(found[0]), _LIST.sub(lambda found: _one_line(found[0]), toml))


def _one_line(listed: str) -> str:
    told = " ".join(listed.split()).replace("[ ", "[").replace(", ]", "]")
    return told if len(told) <= _WIDTH else listed
